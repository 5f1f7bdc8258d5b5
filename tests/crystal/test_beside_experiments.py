"""Statements of analysis/cases/layer/README.md on published experiments, with their numbers."""

import numpy as np
import pytest

from granular_lmp import Scene
from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.modes import bloch_modes
from granular_lmp.problem import prepare
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.rest.linear import physics_of, unit_contacts

LAYER = Scene.loads(
    """
name = "layer"
[sphere]
radius = 0.5e-6
youngs_modulus = 73e9
poisson_ratio = 0.17
work_of_adhesion = 0.063
density = 2200.0
[packing]
rows = 16
columns = 4
ends = "periodic"
[substrate]
youngs_modulus = 73e9
poisson_ratio = 0.17
work_of_adhesion = 0.063
[wave]
mode = "1"
wavenumber = 0.7853981633974483
amplitude = 0.02
[time]
duration = 10.0
"""
)
UZ = 2


def at_rest(values: dict[str, object]) -> tuple[Contacts, np.ndarray, np.ndarray]:
    """Return contacts of a cell, frequencies in MHz, and shapes (modes, spheres, 6) at k = 0."""
    scene = prepare(LAYER.with_values(values)).scene
    contacts = unit_contacts(scene)
    frequencies, shapes = bloch_modes(contacts, scene.sphere, np.zeros((1, 2)), physics_of(scene))
    hertz = frequencies[0] / (2 * np.pi * scene.sphere.time_scale)
    return contacts, hertz / 1e6, np.abs(shapes[0]).reshape(len(hertz), -1, 6)


def vertical(values: dict[str, object]) -> np.ndarray:
    """Return the frequencies of the modes in which spheres move along z alone, MHz."""
    _, hertz, shapes = at_rest(values)
    return hertz[np.linalg.norm(shapes[:, :, UZ], axis=1) > 0.999]


def stiffnesses(share: float) -> dict[str, object]:
    contacts, _, _ = at_rest({})
    pair = contacts.j >= 0
    return {
        "contact.normal_stiffness": share * float(contacts.normal_stiffness[pair][0]),
        "contact.shear_stiffness": share * float(contacts.shear_stiffness[pair][0]),
    }


def test_resonances_of_the_layer_are_those_of_the_page() -> None:
    _, hertz, _ = at_rest({})
    # The printed digits; the torque arm moves rocking and torsion by η/2 = 1e-4
    assert hertz == pytest.approx([120.8, 120.8, 144.0, 478.5, 478.5, 596.2], abs=0.1)


def test_the_vertical_resonance_alone_does_not_move_with_the_stiffness_between_spheres() -> None:
    _, stiff, _ = at_rest({})
    _, soft, _ = at_rest(stiffnesses(0.1))
    assert vertical(stiffnesses(0.1)) == pytest.approx(vertical({}), rel=1e-9)
    assert np.count_nonzero(np.isclose(soft, stiff, rtol=1e-3)) == 1


def test_one_material_makes_the_substrate_stiffer_by_two_to_the_two_thirds() -> None:
    contacts, _, _ = at_rest({})
    pair, wall = (contacts.normal_stiffness[each][0] for each in (contacts.j >= 0, contacts.j < 0))
    assert wall / pair == pytest.approx(2 ** (2 / 3), rel=1e-9)


@pytest.mark.parametrize("lattice", ["square", "honeycomb"])
def test_the_vertical_resonance_does_not_ask_for_a_hexagonal_order(lattice: str) -> None:
    assert np.isclose(vertical({"packing.lattice": lattice}), vertical({})[0], rtol=1e-9).any()


@pytest.mark.parametrize("layers", [1, 2, 3, 5])
def test_vertical_modes_of_a_film_are_those_of_coupled_oscillators(layers: int) -> None:
    film = {"packing.lattice": "fcc", "packing.orientation": "[11-2]", "packing.layers": layers}
    contacts, _, _ = at_rest(film)
    pair, wall = contacts.j >= 0, contacts.j < 0
    normal, mass = contacts.normal_stiffness, contacts.mass[0]
    between = 2 * normal[pair][0] + contacts.shear_stiffness[pair][0]
    stiffness = np.zeros((layers, layers))
    stiffness[0, 0] = normal[wall][0]
    for lower in range(layers - 1):
        stiffness[lower : lower + 2, lower : lower + 2] += between * np.array([[1, -1], [-1, 1]])
    expected = np.sqrt(np.linalg.eigvalsh(stiffness) / mass) / (2 * np.pi * 1e6)
    assert vertical(film) == pytest.approx(expected, rel=1e-9)


def test_beads_under_load_stiffen_by_hertz_and_lose_contacts_at_low_load() -> None:
    # Avalanches leave as many contacts as Newton steps, to one of 800 here, in two thirds of the time
    base = Scene.load("steel_compressed").with_values(
        {"packing.rows": 20, "packing.columns": 20, "packing.ends": "periodic", "packing.relax_by": "avalanches"}
        | {"wave.wavenumber": 0.6283, "time.allow_echo": True}
    )
    found = []
    for force in (1.0, 1000.0):
        equal = base.with_values({"packing.contact_force": force})
        beads = crystal_of(equal.with_values({"disorder.radius": 3e-4}))
        stiffness = beads.contacts.normal_stiffness.sum() / (3 * len(beads.atoms) * equal.sphere.normal_stiffness)
        found.append((2 * len(beads.contacts) / len(beads.atoms), float(stiffness), equal.sphere.normal_stiffness))
    (few, soft, low), (many, stiff, high) = found
    # As many digits as the page has
    assert (few, many) == pytest.approx((4.1, 6.0), abs=0.05)
    assert (soft, stiff) == pytest.approx((0.65, 1.00), abs=0.005)
    assert high / low == pytest.approx(10.0, rel=1e-9)
