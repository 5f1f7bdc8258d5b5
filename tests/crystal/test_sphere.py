"""Contact constants of the paper's spheres, held against the numbers of the derivation."""

from dataclasses import replace
from math import isclose, pi

from granular_lmp.crystal.sphere import Sphere

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


def test_a_compressed_hertz_contact_with_the_same_holding_force_has_the_same_constants() -> None:
    pressed = replace(SILICA, work_of_adhesion=0.0, contact_force=SILICA.pull_off_force)
    for name in ("static_overlap", "normal_stiffness", "shear_stiffness", "time_scale"):
        assert getattr(pressed, name) == getattr(SILICA, name)
    assert SILICA.prestress == 0
    # F0 = AΔ0^{3/2} and k1 = 1.5 A√Δ0, so χ = (2/3) Δ0/(2R−Δ0)
    assert isclose(pressed.prestress, 2 / 3 * SILICA.static_overlap / SILICA.lattice_constant, rel_tol=1e-14)


def test_half_the_holding_force_from_outside_gives_half_the_prestress() -> None:
    half = replace(SILICA, work_of_adhesion=SILICA.work_of_adhesion / 2, contact_force=SILICA.pull_off_force / 2)
    assert isclose(half.static_overlap, SILICA.static_overlap, rel_tol=1e-14)
    assert isclose(half.prestress, SILICA.static_overlap / SILICA.lattice_constant / 3, rel_tol=1e-14)
