"""Compression instead of adhesion, no rotation, no shear: theory against the exact lattice, and a wrong one."""

import numpy as np
import pytest

from granular_analysis import second_harmonic as sh
from granular_analysis.measure.norms import relative_error
from granular_analysis.theory import bloch, lattice
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.hierarchy import hierarchy
from granular_analysis.theory.resonance import three_mode
from granular_analysis.theory.wave import (
    Wave,
    antiresonance,
    generated,
    residual,
    resonance,
    shift,
    shifted_second_order,
    trajectory,
)
from tests.conftest import latin

NU = 0.17
ETA = 0.02  # Δ0/2R: large enough for every term in it to be seen
SMALL, SHORT = 2e-3, np.linspace(0, 30, 31)

# Physics that a scene can call for, in the words of `granular_analysis.theory.contact.Contact`
EFFECTS = {
    "compression": {"overlap_ratio": ETA, "prestress": 1.0},
    "half": {"overlap_ratio": 0.1, "prestress": 0.5},
    "no rotation": {"rotation": False},
    "no rotation, compression": {"rotation": False, "overlap_ratio": ETA, "prestress": 1.0},
    "no shear": {"shear": False},
    "no shear, compression": {"shear": False, "overlap_ratio": ETA, "prestress": 1.0},
}


@pytest.mark.parametrize("name", ["L", "TR", "RT"])
def test_a_prestress_left_out_is_seen_in_the_linear_mode(name):
    mode = sh.mode(name, 0.802, sh.ratios(NU, overlap_ratio=ETA))
    # χ = 0.014 of the stiffness, of which RT feels a hundredth; rounding is 1e-16
    assert residual(mode, Contact(NU, overlap_ratio=ETA, prestress=1.0)) > 1e-5


def test_a_prestress_does_nothing_where_normals_do_not_turn():
    mode = sh.mode("TR", 0.802, sh.ratios(NU))
    assert residual(mode, Contact(NU, prestress=1.0)) < 1e-15
    with_it, without = (lattice.torus(Wave(mode, 0.2, Contact(NU, prestress=c)), SHORT) for c in (1.0, 0.0))
    assert np.allclose(with_it, without, rtol=0, atol=1e-9)  # the integrator's own steps


def test_without_rotation_silica_resonates_in_long_waves():
    contact = Contact(NU, rotation=False)
    assert resonance(contact) == pytest.approx(2 * np.arccos(np.sqrt(sh.ratios(NU).mu1)), rel=1e-12)
    assert resonance(contact) == pytest.approx(0.43966, abs=5e-6)  # five digits are known
    assert antiresonance(contact) is None


def test_without_rotation_the_lattice_resonates_there_and_not_elsewhere():
    contact, tau = Contact(NU, rotation=False), np.linspace(0, 400, 401)
    at = resonance(contact)

    def late_over_early(xi):
        p = lattice.torus(Wave.of_mode("TR", xi, SMALL, contact), tau, points=11, rtol=1e-9)[0]
        return np.max(np.abs(p[350:])) / np.max(np.abs(p[50:100]))

    assert late_over_early(at) == pytest.approx(4, rel=0.05)  # p ∝ τ, whole periods at w̃ = 0.43: 1/20 of the window
    assert late_over_early(1.475) < 1.2


@pytest.mark.parametrize("nu", [-0.5, 0.0])
def test_without_rotation_there_is_no_resonance_for_auxetic_spheres(nu):
    assert resonance(Contact(nu, rotation=False)) is None


@pytest.mark.parametrize("effects", EFFECTS.values(), ids=EFFECTS)
def test_resonance_is_where_twice_the_frequency_is_that_of_l(effects):
    contact = Contact(NU, **effects)
    at = resonance(contact)
    wave = Wave.of_mode("TR", at, SMALL, contact)
    assert 2 * wave.mode.frequency == pytest.approx(wave.free_frequency, rel=1e-12)
    folded = min(2 * at, 2 * np.pi - 2 * at)
    assert 2 * wave.mode.frequency == pytest.approx(bloch.mode("L", folded, 90.0, contact).frequency, rel=1e-12)


def test_antiresonance_under_compression_is_where_the_second_harmonic_vanishes():
    contact = Contact(NU, overlap_ratio=ETA, prestress=1.0)
    at = antiresonance(contact)
    assert abs(generated("TR", at, contact)) < 1e-13  # rounding
    assert abs(at - antiresonance(Contact(NU, overlap_ratio=ETA))) > 1e-3


def test_without_rotation_no_sphere_turns():
    contacts = (Contact(NU, rotation=rotation, overlap_ratio=ETA) for rotation in (False, True))
    phi, turned = (lattice.torus(Wave.of_mode("TR", 0.802, 0.2, contact), SHORT)[2] for contact in contacts)
    assert np.all(phi == 0)
    assert np.max(np.abs(turned)) > 0.1


def test_without_rotation_is_the_limit_of_a_large_moment_of_inertia():
    held = np.stack(lattice.torus(Wave.of_mode("TR", 0.802, 0.2, Contact(NU, rotation=False)), SHORT))
    # Where spheres hardly turn, the upper of the two transverse modes is the translation
    heavy = [
        np.stack(lattice.torus(Wave.of_mode("RT", 0.802, 0.2, Contact(NU, inertia=inertia)), SHORT))
        for inertia in (1e5, 1e6)
    ]
    off = [np.max(np.abs(values - held)) for values in heavy]
    assert off[0] / off[1] == pytest.approx(10, rel=0.1)  # the difference falls as 1/Ĩ
    assert off[1] < 1e-3


def test_without_shear_the_unit_of_time_stays_that_of_the_spheres():
    contact = Contact(NU, shear=False)
    frequency = {name: bloch.mode(name, 0.802, 90.0, contact).frequency for name in ("L", "TR")}
    # Central springs on a triangular lattice: transverse waves √3 slower than longitudinal ones.
    assert frequency["TR"] / frequency["L"] == pytest.approx(np.sqrt(1 / 3), rel=1e-13)
    speed = frequency["L"] / np.sin(0.401)
    assert speed**2 == pytest.approx(3 / (3 + contact.kappa), rel=1e-13)
    assert contact.kappa == sh.ratios(NU).kappa


# --- the other theories ---


@pytest.mark.parametrize(
    ("name", "effects"),
    latin(
        ["TR", "L"],
        [*EFFECTS.values(), {"law": "incremental"}, {"law": "incremental", "overlap_ratio": ETA}, {"law": "potential"}],
    ),
    ids=str,
)
def test_the_hierarchy_holds_the_lattice_with_every_effect(name, effects):
    mode = bloch.mode(name, 0.802, 90.0, Contact(NU, **effects))
    exact = lattice.torus(Wave(mode, 0.02, Contact(NU, **effects)), SHORT, points=21, rtol=1e-9)
    theory = hierarchy(Wave(mode, 0.02, Contact(NU, **effects)), SHORT, rtol=1e-8)
    # a⁶ times a coefficient that the steepening of L takes to 1e4 at most; and the errors of the integrations.
    assert np.max(np.abs(np.subtract(theory, exact))) < 1e-6
    if "law" in effects and name == "TR":
        secant = hierarchy(Wave(mode, 0.02, Contact(NU, **{**effects, "law": "secant"})), SHORT)
        assert np.max(np.abs(np.subtract(secant, exact))) > 1e-4


@pytest.mark.parametrize(
    ("name", "xi", "effects"),
    latin([("TR", 0.95), ("L", 0.95), ("TR", 2.6)], ["no rotation", "no shear"]),
)
def test_frequency_shift_and_three_waves_hold_without_rotation_and_shear(name, xi, effects):
    wave, tau = Wave.of_mode(name, xi, 0.05, Contact(NU, **EFFECTS[effects])), np.linspace(0, 60, 121)
    exact = lattice.torus(wave, tau, points=21, rtol=1e-9)
    component = 0 if name == "L" else 1
    second, shifted, three = (
        relative_error(exact[component], theory(wave, tau)[component])
        for theory in (trajectory, shifted_second_order, three_mode)
    )
    assert shift(wave).total != 0
    assert shifted < second / 3
    assert three < second / 3
