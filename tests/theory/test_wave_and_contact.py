"""One contact and one wave: checked once, and what does not belong together is refused, never taken for another."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from granular_analysis import second_harmonic as sh
from granular_analysis.theory import bloch
from granular_analysis.theory.bloch import hexagonal
from granular_analysis.theory.contact import Contact, ratios_of
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.hierarchy import hierarchy_orders
from granular_analysis.theory.wave import Wave, residual
from granular_lmp import Scene

NU = 0.17
CONTACTS: dict[str, Contact] = {
    "paper": Contact(NU),
    "LAMMPS's geometry": Contact(NU, overlap_ratio=0.02),
    "compressed": Contact(NU, overlap_ratio=0.02, prestress=1.0, restitution=0.9),
    "hollow": Contact(-0.5, inertia=2 / 3),
    "no rotation": Contact(NU, rotation=False, viscosity=0.1),
    "no shear": Contact(NU, shear=False),
    "incremental": Contact(0.4, law="incremental", overlap_ratio=1e-3),
    "potential": Contact(NU, law="potential"),
}


def names(contact: Contact) -> tuple[sh.ModeName, ...]:
    return ("L", "TR", "RT") if contact.turns else ("L", "TR")


@pytest.mark.parametrize("contact", CONTACTS.values(), ids=CONTACTS)
def test_every_mode_of_a_contact_is_a_wave_of_it(contact: Contact) -> None:
    for name in names(contact):
        for xi in (1e-3, 0.3, 0.802, 1.475, 2.127, 3.0, np.pi):
            # Rounding of numbers of order one, summed over three bonds
            assert residual(Wave.of_mode(name, xi, 0.2, contact).mode, contact) < 1e-14
        for direction in (0.0, 17.0, -41.0):
            assert residual(bloch.mode(name, 1.1, direction, contact), contact) < 1e-14


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("TR", {"poisson_ratio": NU + 1e-4}),
        ("RT", {"inertia": 0.4001}),
        ("RT", {"overlap_ratio": 2.5e-4}),
        ("TR", {"rotation": False}),
        ("L", {"shear": False}),
        ("L", {"overlap_ratio": 0.01, "prestress": 1.0}),
    ],
    ids=str,
)
def test_a_mode_of_another_contact_is_refused(name: sh.ModeName, changes: dict[str, Any]) -> None:
    right = Wave.of_mode(name, 1.1, 0.2, Contact(NU))
    other = replace(right.contact, **changes)
    with pytest.raises(ValueError, match=f"mode {name} at wavenumber = 1.1 is no wave of this contact"):
        replace(right, contact=other)
    with pytest.raises(ValueError, match="is no wave of this contact"):
        hierarchy_orders(right.mode, other, [0.0, 1.0])


def test_the_closed_form_is_given_the_paper_s_contact_alone() -> None:
    assert Contact(NU, overlap_ratio=0.01, inertia=0.5).closed == sh.ratios(NU, 0.5, 0.01)
    for other in (
        *({"law": law} for law in ("incremental", "potential")),
        *({name: False} for name in ("shear", "rotation")),
        {"prestress": 0.1, "overlap_ratio": 0.01},
        {"adhesion_law": "jkr"},
    ):
        contact = Contact(NU, **other)
        with pytest.raises(ValueError, match=f"closed form does not include .*{next(iter(other))}"):
            _ = contact.closed


@pytest.mark.parametrize("contact", CONTACTS.values(), ids=CONTACTS)
def test_closed_form_and_crystal_are_of_one_contact(contact: Contact) -> None:
    crystal = hexagonal(contact)
    assert contact.shear_stiffness == crystal.bonds.law.shear[0]
    assert contact.masses[2] == pytest.approx(crystal.mass[0, 5] / crystal.mass[0, 0], rel=1e-15)
    assert crystal.turns == contact.turns
    if not contact.departures:
        assert (contact.closed.kappa, contact.closed.inertia) == (contact.kappa, contact.masses[2])


def test_the_constants_of_a_scene_are_those_of_its_spheres_or_are_refused() -> None:
    scene = Scene.load("tr_resonant")
    sphere = scene.sphere
    assert ratios_of(scene) == sh.ratios(sphere.poisson_ratio, overlap_ratio=sphere.overlap_ratio)
    for name, message in {
        "steel_compressed": "does not include prestress = 1",
        "tr_square": "does not include packing.lattice = 'square' in 2D",
        "fcc_transverse": "does not include packing.lattice = 'fcc' in 3D",
    }.items():
        with pytest.raises(TheoryError, match=message):
            ratios_of(Scene.load(name))
    with pytest.raises(TheoryError, match="does not include rotation = False"):
        ratios_of(scene.with_values({"effects.rotation": False}))
