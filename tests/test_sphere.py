"""Contact constants of the paper's spheres, held against the numbers of the derivation."""

from math import isclose, pi, sqrt

import numpy as np
import pytest

from granular_lmp.modes import bloch_modes
from granular_lmp.packing import lattice_constant, unit_lattice
from granular_lmp.sphere import Sphere

SILICA = Sphere(radius=0.5e-6, youngs_modulus=73e9, poisson_ratio=0.17, work_of_adhesion=0.063, density=2200.0)


def test_static_overlap_and_stiffness_ratio_of_the_paper() -> None:
    # Derived with computer algebra in 13 digits
    assert isclose(SILICA.static_overlap, 2.498514361612e-10, rel_tol=1e-12)
    assert isclose(SILICA.stiffness_ratio, 0.9071038251366, rel_tol=1e-12)
    assert isclose(SILICA.nonlinearity(0.2), -0.106708864438, rel_tol=1e-11)


def test_stiffness_ratio_is_that_of_the_stiffnesses() -> None:
    for poisson_ratio in (-0.9, -0.5, 0.0, 0.3, 0.5):
        sphere = Sphere(1e-6, 1e9, poisson_ratio, 0.1, 1000.0)
        assert isclose(sphere.shear_stiffness / sphere.normal_stiffness, sphere.stiffness_ratio, rel_tol=1e-14)


def test_force_vanishes_at_the_static_overlap() -> None:
    repulsion = SILICA.normal_coefficient * SILICA.static_overlap**1.5
    assert isclose(repulsion, SILICA.pull_off_force, rel_tol=1e-14)
    assert isclose(SILICA.pull_off_force, 2 * pi * 0.063 * 0.25e-6, rel_tol=1e-14)


@pytest.mark.parametrize("poisson_ratio", [-0.9, -0.5, 0.0, 0.17, 0.5])
def test_highest_frequency_is_the_top_of_the_spectrum_of_the_whole_zone(poisson_ratio: float) -> None:
    sphere = Sphere(0.5e-6, 73e9, poisson_ratio, 0.063, 2200.0)
    lattice = unit_lattice(sphere)
    # A triangle Γ, M, K repeats the zone by symmetry; |K| = 4π/3a
    corner = 4 * pi / 3 / lattice_constant(sphere)
    highest = 0.0
    for s in np.linspace(0, 1, 25):
        for t in np.linspace(0, 1, 13):
            k = corner * s * np.array([0.75 + 0.25 * t, sqrt(3) / 4 * (1 - t)])
            highest = max(highest, bloch_modes(lattice, sphere, k)[0][-1])
    assert isclose(highest, sphere.highest_frequency, rel_tol=1e-12)
