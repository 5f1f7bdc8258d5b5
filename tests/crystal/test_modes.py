"""Numerical Bloch modes against the closed form of the independent theory, and their limits."""

from dataclasses import replace
from math import pi, sqrt

import numpy as np
import pytest

from granular_analysis import second_harmonic
from granular_analysis.theory import bloch
from granular_analysis.theory.contact import Contact
from granular_lmp.crystal.contacts import find_contacts
from granular_lmp.crystal.lattices import lattice_constant, unit_cell, unit_lattice
from granular_lmp.crystal.mode import Physics
from granular_lmp.crystal.modes import MODES, bloch_mode, bloch_modes, contact_stretches, decay_rate, highest_frequency
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.errors import SceneError
from tests.crystal.test_sphere import SILICA

pytestmark = pytest.mark.rounding  # matrices of an eigenvalue problem, sines and cosines

LATTICE = unit_lattice(SILICA)


@pytest.mark.parametrize("name", MODES)
@pytest.mark.parametrize("poisson_ratio", [-0.9, -0.5, 0.0, 0.17, 0.5])
def test_modes_equal_the_closed_form_along_y(name: str, poisson_ratio: float) -> None:
    sphere = Sphere(0.5e-6, 73e9, poisson_ratio, 0.063, 2200.0)
    lattice = unit_lattice(sphere)
    constants = second_harmonic.ratios(poisson_ratio, overlap_ratio=sphere.overlap_ratio)
    for xi in (1e-3, 0.1, 0.802, 1.475, 2.127, 3.0, pi - 1e-3):
        closed = second_harmonic.mode(name, xi, constants)
        mode = bloch_mode(lattice, sphere, WaveVector.of(xi), name)
        # 1e-12: 13 digits of the singular values, less one for the smallest of them at ξ = 1e-3
        assert abs(mode.frequency / closed.frequency - 1) < 1e-12
        np.testing.assert_allclose([mode.uy, -mode.ux, mode.f], [closed.p, closed.q, closed.f], atol=1e-12)


def test_translation_and_rotation_part_at_the_zone_boundary() -> None:
    tr, rt = (bloch_mode(LATTICE, SILICA, WaveVector.of(pi), name) for name in ("TR", "RT"))
    assert (tr.ux, tr.f) == pytest.approx((-1, 0), abs=1e-12)
    assert (rt.ux, rt.f) == pytest.approx((0, -1), abs=1e-12)
    near = bloch_mode(LATTICE, SILICA, WaveVector.of(pi - 1e-6), "RT")
    assert near.frequency == pytest.approx(rt.frequency, abs=1e-11)  # dΩ/dξ vanishes at π
    assert near.f == pytest.approx(rt.f, abs=1e-9)


def test_a_longitudinal_wave_stretches_inclined_contacts_and_shears_them() -> None:
    xi = 0.802
    stretches = contact_stretches(LATTICE, SILICA, bloch_mode(LATTICE, SILICA, WaveVector.of(xi), "L"))
    normal, shear = (np.abs(stretch).max() for stretch in stretches)
    # Contacts at 60° to x: δN = sin 60° Δv, δS = cos 60° Δv with Δv = 2 sin(ξ/2)
    assert normal == pytest.approx(sqrt(3) * np.sin(xi / 2), rel=1e-9)
    assert shear == pytest.approx(np.sin(xi / 2), rel=1e-9)


@pytest.mark.parametrize("direction", [-110.0, 0.0, 17.0, 40.0, 63.0, 90.0, 150.0])
@pytest.mark.parametrize("name", MODES)
def test_modes_of_any_direction_equal_those_of_the_independent_theory(direction: float, name: str) -> None:
    for xi in (0.05, 0.802, 2.0):
        mode = bloch_mode(LATTICE, SILICA, WaveVector.of(xi, direction), name)
        other = bloch.mode(name, xi, direction, Contact(0.17, overlap_ratio=SILICA.overlap_ratio))
        assert mode.frequency == pytest.approx(other.frequency, rel=1e-11)
        np.testing.assert_allclose([mode.p, mode.q, mode.f], [other.p, other.q, other.f], atol=1e-9)


def test_the_modes_of_a_wave_vector_are_three_different_ones() -> None:
    vector = WaveVector.of(1.9, 75.0)
    frequencies = [bloch_mode(LATTICE, SILICA, vector, name).frequency for name in MODES]
    expected, _ = bloch_modes(LATTICE, SILICA, np.array(vector.components) / lattice_constant(SILICA))
    np.testing.assert_allclose(sorted(frequencies), expected, rtol=1e-12)


def test_an_unknown_mode_is_refused() -> None:
    with pytest.raises(SceneError, match="wave.mode = 'X'"):
        bloch_mode(LATTICE, SILICA, WaveVector.of(1.0), "X")


def test_names_are_refused_to_another_lattice_than_that_of_the_sphere() -> None:
    pressed = replace(SILICA, contact_force=SILICA.pull_off_force)
    for lattice, sphere in ((LATTICE, pressed), (find_contacts(unit_cell(SILICA).repeat((1, 2, 1)), [SILICA]), SILICA)):
        with pytest.raises(ValueError, match="belong to no hexagonal, square, chain, honeycomb lattice of this sphere"):
            bloch_mode(lattice, sphere, WaveVector.of(1.0), "L")


def test_all_spheres_turning_in_phase_is_the_highest_mode() -> None:
    kappa, eta = SILICA.stiffness_ratio, SILICA.overlap_ratio
    assert highest_frequency(LATTICE, SILICA) == pytest.approx(sqrt(15 * kappa / (kappa + 3) * (1 - eta)), rel=1e-12)


def test_without_rotation_a_transverse_wave_only_shifts_and_rt_is_refused() -> None:
    for physics in (Physics(rotation=False), Physics(shear=False, rotation=False)):
        mode = bloch_mode(LATTICE, SILICA, WaveVector.of(0.802), "TR", physics)
        assert (mode.ux, mode.uy, mode.f) == (-1, 0, 0)
    with pytest.raises(SceneError, match="needs effects.rotation"):
        bloch_mode(LATTICE, SILICA, WaveVector.of(1.0), "RT", Physics(rotation=False))


def test_decay_of_a_longitudinal_wave_is_that_of_its_springs_as_dashpots() -> None:
    # δN² + δS² of the contacts is |Δu|² without rotation: two contacts a row step, |2 sin(ξ/2)|² each
    for xi in (0.3, 0.802, 2.0):
        mode = bloch_mode(LATTICE, SILICA, WaveVector.of(xi), "L")
        assert decay_rate(LATTICE, SILICA, mode, 0.01) == pytest.approx(0.04 * np.sin(xi / 2) ** 2, rel=1e-12)
