"""One contact and one wave: checked once, and what does not belong together is refused, never taken for another."""

from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest

from benchmarks import paper_rows
from cases.timestep.stepped import limit, stepped
from granular_analysis import second_harmonic as sh
from granular_analysis.second_harmonic import ModeName
from granular_analysis.theory import bloch, lattice
from granular_analysis.theory.bloch import hexagonal
from granular_analysis.theory.contact import LAWS, Contact, Law, ratios_of
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.hierarchy import hierarchy_orders
from granular_analysis.theory.wave import Wave, residual, second_harmonic
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


def test_a_mode_turned_or_detuned_is_refused() -> None:
    contact = Contact(NU, overlap_ratio=0.01)
    mode = bloch.mode("TR", 1.1, 17.0, contact)
    for wrong in (replace(mode, direction=17.1), replace(mode, frequency=mode.frequency * 1.0001)):
        with pytest.raises(ValueError, match="is no wave of this contact"):
            Wave(wrong, 0.2, contact)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"poisson_ratio": 0.51}, r"poisson_ratio = 0\.51 is outside \[-1, 0\.5\]"),
        ({"inertia": 0.0}, r"inertia = 0\.0 must be positive and finite"),
        ({"overlap_ratio": 0.2}, r"overlap_ratio = 0\.2 is outside \[0, 0\.1\]"),
        ({"prestress": -1.0}, r"prestress = -1\.0 is outside \[0, 1\]"),
        ({"viscosity": -0.1}, "viscosity = -0.1 must be finite and not negative"),
        ({"law": "mindlin"}, "law = 'mindlin' is none of"),
        ({"restitution": 1.1, "prestress": 1.0}, r"restitution = 1\.1 is outside"),
        ({"restitution": 0.9}, r"restitution = 0\.9 needs prestress = 1"),
        ({"restitution": 0.9, "prestress": 1.0, "viscosity": 0.1}, "a contact has one dashpot"),
        ({"law": "potential", "overlap_ratio": 0.01}, "law = 'potential' needs overlap_ratio = 0"),
    ],
    ids=str,
)
def test_what_is_no_contact_is_refused_with_its_name_and_value(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Contact(**{"poisson_ratio": NU} | wrong)


def test_the_closed_form_is_given_the_paper_s_contact_alone() -> None:
    assert Contact(NU, overlap_ratio=0.01, inertia=0.5).closed == sh.ratios(NU, 0.5, 0.01)
    for other in (
        *({"law": law} for law in ("incremental", "potential")),
        *({name: False} for name in ("shear", "rotation")),
        {"prestress": 0.1, "overlap_ratio": 0.01},
        {"adhesion_law": "jkr"},
    ):
        contact = Contact(NU, **other)  # type: ignore[arg-type]
        with pytest.raises(ValueError, match=f"closed form does not hold .*{next(iter(other))}"):
            _ = contact.closed


def test_the_potential_law_is_never_taken_for_the_secant_law() -> None:
    tau = np.linspace(0, 30, 16)
    for name in get_args(ModeName):
        waves = [Wave.of_mode(name, 0.9, 0.1, Contact(NU, law=law)) for law in ("potential", "secant")]  # type: ignore[arg-type]
        potential, secant = (second_harmonic(wave, tau)[0] for wave in waves)
        assert np.abs(secant - potential).max() > 1e-2 * np.abs(potential).max()


def test_the_linear_lattice_does_not_depend_on_the_law() -> None:
    laws: tuple[Law, ...] = LAWS
    modes = [Wave.of_mode("TR", 1.1, 0.2, Contact(NU, law=law)).mode for law in laws]
    assert modes[0] == modes[1] == modes[2]


def test_what_is_stepped_or_set_on_rows_is_a_wave_along_y() -> None:
    contact = Contact(NU, overlap_ratio=0.01)
    right = Wave.of_mode("TR", 1.1, 0.2, contact)
    oblique = Wave(bloch.mode("TR", 1.1, 17.0, contact), 0.2, contact)
    with pytest.raises(ValueError, match=r"direction = 17\.0 of the mode is not 90"):
        paper_rows.rows(oblique, [0.0, 1.0], rows=7)
    wrong: list[tuple[list[Wave], str]] = [
        ([oblique], r"direction = 17\.0 of the mode is not 90"),
        ([replace(right, phase=0.3)], r"phase = 0\.3 must be 0"),
        ([Wave.of_mode("TR", 1.1, 0.2, Contact(NU))], r"overlap_ratio = 0\.0 must be above 0"),
    ]
    for waves, message in wrong:
        with pytest.raises(ValueError, match=message):
            stepped(waves, 2, records=2)


def test_waves_in_contacts_of_two_kinds_are_stepped_in_one_call() -> None:
    waves = [Wave.of_mode("TR", xi, 0.2, Contact(nu, overlap_ratio=1e-3 * xi)) for xi, nu in ((0.8, NU), (2.1, -0.5))]
    together, apart = stepped(waves, 4, records=40), [stepped([wave], 4, records=40)[0] for wave in waves]
    np.testing.assert_array_equal(together, apart)
    assert np.max(np.abs(together[0] - together[1])) > 0.1


@pytest.mark.parametrize(
    "effects",
    [{"shear": False}, {"rotation": False}, {"viscosity": 0.01}, {"restitution": 0.9, "prestress": 1.0}],
    ids=str,
)
def test_waves_of_any_contact_are_stepped_to_their_limit(effects: dict[str, Any]) -> None:
    wave = Wave.of_mode("L", 0.8, 0.2, Contact(NU, overlap_ratio=1e-3, **effects))
    (coarse,), (fine,) = (stepped([wave], count, records=40) for count in (8, 16))
    (exact,) = limit([wave], 0.5 * np.arange(41))
    errors = [np.max(np.abs(run - exact)[:, 0]) for run in (coarse, fine)]
    # The steps are of second order; dashpots, whose force takes the velocity of mid-step, of first
    assert errors[0] / errors[1] == pytest.approx(2 if effects.keys() & {"viscosity", "restitution"} else 4, rel=0.1)


def test_the_limits_of_waves_side_by_side_are_those_of_each_alone() -> None:
    tau = np.linspace(0, 20, 41)
    # The smallest of them is off by no more of its own size
    kinds = (("RT", 0.8, 0.2, NU), ("TR", 2.1, 0.01, -0.5), ("L", 0.3, 0.1, 0.4))
    waves = [Wave.of_mode(name, xi, a, Contact(nu, overlap_ratio=1e-3)) for name, xi, a, nu in kinds]
    together, apart = limit(waves, tau), [np.stack(lattice.torus(wave, tau), axis=-1) for wave in waves]
    # 50 rtol, as it says, at τ = 120
    np.testing.assert_allclose(together, apart, rtol=0, atol=50 * 1e-10)
    assert np.max(np.abs(together[0] - together[1])) > 0.1


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
        "steel_compressed": "does not hold prestress = 1",
        "tr_square": "does not hold packing.lattice = 'square' in 2D",
        "fcc_transverse": "does not hold packing.lattice = 'fcc' in 3D",
    }.items():
        with pytest.raises(TheoryError, match=message):
            ratios_of(Scene.load(name))
    with pytest.raises(TheoryError, match="does not hold rotation = False"):
        ratios_of(scene.with_values({"effects.rotation": False}))
