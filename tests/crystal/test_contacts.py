"""Contacts from geometry: who touches whom, in any cell, and the constants of each contact."""

from dataclasses import replace

import ase
import numpy as np
import pytest
from ase.neighborlist import neighbor_list

from granular_lmp.crystal.contacts import find_contacts
from granular_lmp.crystal.lattices import LATTICES, Shape, packed, unit_cell, unit_lattice
from granular_lmp.crystal.search import overlapping
from granular_lmp.crystal.sphere import Sphere
from tests.crystal.test_sphere import SILICA

STEEL = Sphere(radius=1e-6, youngs_modulus=210e9, poisson_ratio=0.3, work_of_adhesion=0.4, density=7850.0)
PRESSED = replace(SILICA, contact_force=3e-7)
# A constant is a product of some ten factors, each rounded once
ROUNDED = 1e-14


def crowd(seed: int, pbc: list[bool]) -> ase.Atoms:
    """Return spheres of random places and sizes in a skew cell, a few of them outside it."""
    random = np.random.default_rng(seed)
    cell = np.diag([3.0, 2.5, 2.0]) + random.uniform(-0.8, 0.8, (3, 3))
    crystal = ase.Atoms("X12", scaled_positions=random.uniform(-0.5, 1.5, (12, 3)), cell=cell, pbc=pbc)
    crystal.set_array("radius", random.uniform(0.5, 1.0, 12))
    return crystal


# --- the search ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pbc", [[True] * 3, [True, True, False], [False, True, False], [False] * 3])
@pytest.mark.parametrize("seed", range(5))
def test_the_pairs_are_those_of_ase(seed: int, pbc: list[bool]) -> None:
    crystal = crowd(seed, pbc)
    i, j, vector = overlapping(crystal)
    first, second, expected = neighbor_list("ijD", crystal, crystal.arrays["radius"])
    # ASE gives each contact from both sides
    ours = sorted([(a, b, *np.round(d, 9) + 0.0) for a, b, d in zip(i, j, vector, strict=True)])
    ours = sorted(ours + [(b, a, *np.round(-d, 9) + 0.0) for a, b, d in zip(i, j, vector, strict=True)])
    theirs = sorted((a, b, *np.round(d, 9) + 0.0) for a, b, d in zip(first, second, expected, strict=True))
    assert len(ours) == len(theirs) >= 8
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=2e-9)


@pytest.mark.parametrize(("name", "count"), [("hexagonal", 3), ("square", 2), ("chain", 1)])
def test_a_contact_of_a_lattice_is_found_once_in_any_supercell(name: str, count: int) -> None:
    for repeats in ((1, 1, 1), (1, 2, 1), (1, 3, 1)):
        crystal = unit_cell(SILICA, LATTICES[name]).repeat(repeats)
        contacts = find_contacts(crystal, [SILICA])
        assert len(contacts) == count * len(crystal)
        assert (contacts.per_sphere == 2 * count).all()


def test_held_ends_leave_out_two_contacts_a_column() -> None:
    assert len(find_contacts(packed(SILICA, Shape(7, 5, "fixed")), [SILICA])) == 3 * 35 - 2 * 5


def test_spheres_that_do_not_touch_have_no_contacts() -> None:
    crystal = ase.Atoms("X2", positions=[[0, 0, 0], [2.5, 0, 0]], cell=[9, 9, 9])
    crystal.set_array("radius", np.ones(2))
    assert len(find_contacts(crystal, [SILICA])) == 0


# --- constants -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sphere", [SILICA, PRESSED, STEEL, replace(PRESSED, work_of_adhesion=0.0)])
def test_equal_spheres_have_the_constants_of_the_sphere(sphere: Sphere) -> None:
    contacts = unit_lattice(sphere)
    np.testing.assert_allclose(contacts.overlap, sphere.static_overlap, rtol=ROUNDED)
    np.testing.assert_allclose(contacts.normal_stiffness, sphere.normal_stiffness, rtol=ROUNDED)
    np.testing.assert_allclose(contacts.shear_stiffness, sphere.shear_stiffness, rtol=ROUNDED)
    np.testing.assert_allclose(contacts.adhesive_force, sphere.pull_off_force, rtol=ROUNDED)
    np.testing.assert_allclose(contacts.length, sphere.lattice_constant, rtol=ROUNDED)
    np.testing.assert_allclose(contacts.mass, sphere.mass, rtol=ROUNDED)
    assert (contacts.contact_force == sphere.contact_force).all()


def test_the_contacts_of_a_lattice_are_found_once_and_cannot_be_changed() -> None:
    assert unit_lattice(SILICA) is unit_lattice(replace(SILICA))
    with pytest.raises(ValueError, match="read-only"):
        unit_lattice(SILICA).mass[0] = 1.0


def test_overlap_and_force_follow_from_the_positions_where_no_force_is_given() -> None:
    for sphere in (SILICA, PRESSED):
        contacts = find_contacts(unit_cell(sphere), [sphere])
        # A position near 1 R holds 1e-16 R, and the overlap is 5e-4 R and more
        np.testing.assert_allclose(contacts.overlap, sphere.static_overlap, rtol=1e-12)
        np.testing.assert_allclose(
            contacts.contact_force, sphere.contact_force, rtol=0, atol=1e-11 * sphere.holding_force
        )


def test_a_force_that_the_positions_do_not_have_is_refused() -> None:
    with pytest.raises(ValueError, match=r"contact_force = 1e-06: causes an overlap of .* of this crystal"):
        find_contacts(unit_cell(SILICA), [SILICA], 1e-6)


def pair(materials: list[Sphere], radii: tuple[float, float], gap: float) -> ase.Atoms:
    """Return two spheres along (3, 4, 0)/5, one of each material, that overlap by `gap` radii of the first."""
    place = (sum(radii) - gap) * np.array([0.6, 0.8, 0.0])
    crystal = ase.Atoms("X2", positions=[[0, 0, 0], place], cell=[9, 9, 9])
    crystal.set_array("radius", np.array(radii))
    crystal.set_array("material", np.array([0, len(materials) - 1]))
    return crystal


def test_two_materials_and_radii_mix_as_springs_in_series() -> None:
    contacts = find_contacts(pair([SILICA, STEEL], (1.0, 2.0), 2.0**-10), [SILICA, STEEL])
    # Written out with numbers: E*, G*, Rc, w
    compliance = (1 - 0.17**2) / 73e9 + (1 - 0.3**2) / 210e9
    shear_compliance = (2 - 0.17) * 2 * 1.17 / 73e9 + (2 - 0.3) * 2 * 1.3 / 210e9
    curvature, adhesion = 1 / 0.5e-6 + 1 / 1e-6, (0.063 * 0.4) ** 0.5
    overlap = 2.0**-10 * 0.5e-6
    repulsion = 4 / 3 / compliance * curvature**-0.5 * overlap**1.5
    # The overlap is what is left of 3 R, so it holds 12 digits
    np.testing.assert_allclose(contacts.overlap, overlap, rtol=1e-12)
    np.testing.assert_allclose(contacts.normal_stiffness, 1.5 * repulsion / overlap, rtol=1e-12)
    np.testing.assert_allclose(
        contacts.shear_stiffness, 8 / shear_compliance * (overlap / curvature) ** 0.5, rtol=1e-12
    )
    np.testing.assert_allclose(contacts.adhesive_force, 2 * np.pi * adhesion / curvature, rtol=ROUNDED)
    np.testing.assert_allclose(contacts.contact_force, repulsion - contacts.adhesive_force, rtol=1e-11)
    np.testing.assert_allclose(contacts.mass, [SILICA.mass, STEEL.mass], rtol=ROUNDED)


def test_a_contact_does_not_depend_on_which_sphere_comes_first() -> None:
    there = find_contacts(pair([SILICA, STEEL], (1.0, 2.0), 1e-3), [SILICA, STEEL])
    back = pair([SILICA, STEEL], (1.0, 2.0), 1e-3)[[1, 0]]
    here = find_contacts(back, [SILICA, STEEL])
    for name in ("overlap", "normal_stiffness", "shear_stiffness", "adhesive_force", "contact_force"):
        np.testing.assert_allclose(getattr(there, name), getattr(here, name), rtol=1e-11)
    np.testing.assert_allclose(there.vector, -here.vector, rtol=1e-14)


def test_radii_and_densities_of_the_spheres_give_their_masses() -> None:
    crystal = pair([SILICA], (1.0, 0.5), 1e-3)
    crystal.set_array("density", np.array([1000.0, 3000.0]))
    expected = 4 / 3 * np.pi * SILICA.radius**3 * np.array([1000.0, 375.0])
    np.testing.assert_allclose(find_contacts(crystal, [SILICA]).mass, expected, rtol=ROUNDED)


# --- directions ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, -1), (1, -2, 3), (0.1, 0, 1)])
def test_normal_and_tangents_are_a_right_handed_frame(direction: tuple[float, float, float]) -> None:
    unit = np.array(direction) / np.linalg.norm(direction)
    crystal = ase.Atoms("X2", positions=[np.zeros(3), 1.999 * unit], cell=[9, 9, 9])
    crystal.set_array("radius", np.ones(2))
    contacts = find_contacts(crystal, [SILICA])
    frame = np.array([contacts.normals[0], *contacts.tangents[0]])
    np.testing.assert_allclose(frame[0], unit, rtol=0, atol=1e-15)
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), rtol=0, atol=1e-14)
    assert np.linalg.det(frame) == pytest.approx(1, abs=1e-14)


def test_in_the_plane_the_first_tangent_is_the_normal_turned_by_a_right_angle() -> None:
    contacts = unit_lattice(SILICA)
    turned = np.column_stack([-contacts.normals[:, 1], contacts.normals[:, 0], np.zeros(3)])
    np.testing.assert_allclose(contacts.tangents[:, 0], turned, rtol=0, atol=1e-15)
