"""First and second order of theory are those of the exact lattice, for each contact, mode and direction."""

from itertools import product
from typing import Any

import numpy as np
import pytest

from granular_analysis.second_harmonic import ModeName
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.hierarchy import hierarchy_orders
from granular_analysis.theory.lattice import torus_phases
from granular_analysis.theory.wave import Wave, second_harmonic
from tests.conftest import latin
from tests.polarisations import forgetful, spoilt

TAU = np.linspace(0.0, 30.0, 31)
# The integration leaves 160 rtol of 1e-11, and thrice as much at τ = 30. A part of a law that is wrong by a thousandth
# makes 1e-4 and more
LINEAR, EXACT = 5e-9, 1e-8

# What a scene can call for, in the words of `granular_analysis.theory.contact.Contact`
CONTACTS: dict[str, dict[str, Any]] = {
    "paper": {},
    "auxetic": {"poisson_ratio": -0.6},
    "shell": {"inertia": 2 / 3},
    "geometry": {"overlap_ratio": 0.01},
    "compression": {"overlap_ratio": 0.05, "prestress": 1.0},
    "half": {"overlap_ratio": 0.1, "prestress": 0.5},
    "incremental": {"law": "incremental"},
    "incremental, geometry": {"law": "incremental", "overlap_ratio": 0.05, "prestress": 1.0},
    "potential": {"law": "potential", "prestress": 0.3},
    "no rotation": {"rotation": False},
    "no rotation, compression": {"rotation": False, "overlap_ratio": 0.02, "prestress": 0.5},
    "no rotation, potential": {"rotation": False, "law": "potential"},
    "no shear": {"shear": False},
    "no shear, compression": {"shear": False, "overlap_ratio": 0.02, "prestress": 1.0},
    "JKR": {"adhesion_law": "jkr"},
    "JKR, compression": {"adhesion_law": "jkr", "overlap_ratio": 2e-3, "prestress": 0.5},
    "JKR, incremental": {"adhesion_law": "jkr", "overlap_ratio": 2e-3, "law": "incremental"},
}
PLACES = [(0.802, 90.0), (1.1, 17.0), (2.127, 90.0), (0.9, 0.0), (1.1, -41.0), (3.0, 90.0)]  # ξ, degrees
WAVES = [
    (contact, name)
    for contact, name in product(CONTACTS, ("L", "TR", "RT"))
    if name != "RT" or not contact.startswith("no ")
]


def contact_of(name: str) -> Contact:
    return Contact(**{"poisson_ratio": 0.17} | CONTACTS[name])


def second(wave: Wave, phases: np.ndarray) -> np.ndarray:
    """Return p, q, φ (T, 3, K) of second order at phases, for a = 1."""
    fields = [second_harmonic(Wave(wave.mode, 1.0, wave.contact, phase), TAU) for phase in phases]
    return np.moveaxis(np.array(fields), 0, 2).swapaxes(0, 1)


@pytest.mark.parametrize(("contact", "name", "place"), latin(WAVES, [(each,) for each in PLACES]))
def test_the_lattice_has_the_mode_and_the_second_order_of_theory(
    contact: str, name: ModeName, place: tuple[float, float]
) -> None:
    wave = Wave.of_mode(name, place[0], 1.0, contact_of(contact), direction=place[1])
    mode = wave.mode
    orders = hierarchy_orders(mode, wave.contact, TAU, order=2, rtol=1e-11)
    phases = torus_phases(orders.shape[-1])
    theta = phases - mode.frequency * TAU[:, None]
    linear = np.stack([mode.p * np.cos(theta), mode.q * np.cos(theta), -mode.f * np.sin(theta)], axis=1)
    assert np.abs(orders[0] - linear).max() < LINEAR
    found = second(wave, phases)
    assert np.abs(orders[1] - found).max() < EXACT * max(1.0, np.abs(found).max())


@pytest.mark.parametrize(
    ("name", "part"),
    [*(("TR", part) for part in ("push", "curvature", "shear_growth", "start")), ("L", "push"), ("L", "curvature")],
)
def test_a_part_of_the_law_that_is_wrong_by_a_thousandth_is_seen(name: ModeName, part: str) -> None:
    wave = Wave.of_mode(name, 0.802, 1.0, contact_of("incremental, geometry"), 0.6)
    right = spoilt(wave, TAU)
    assert np.abs(right - second_harmonic(wave, TAU)[0]).max() < EXACT
    wrong = forgetful(wave, TAU) if part == "start" else spoilt(wave, TAU, **{part: 1.001})
    assert np.abs(wrong - right).max() > 100 * EXACT


def test_another_contact_is_another_second_order() -> None:
    """Each contact of the table differs from all others by more than the test of it allows."""
    fields = {
        name: second(Wave.of_mode("TR", 1.1, 1.0, contact_of(name), direction=17.0), torus_phases(5))
        for name in CONTACTS
    }
    for one, other in product(fields, fields):
        if one < other:
            assert np.abs(fields[one] - fields[other]).max() > 1e4 * EXACT, (one, other)
