"""The third harmonic of one wave, against the hierarchy of the exact lattice."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from granular_analysis.second_harmonic import ModeName
from granular_analysis.theory import bloch, lattice
from granular_analysis.theory.bloch import frame, hexagonal, in_plane, real_modes, wavevector_of
from granular_analysis.theory.bonds import ShearLaw
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.crystal import Crystal
from granular_analysis.theory.hierarchy import hierarchy_orders
from granular_analysis.theory.network import Material
from granular_analysis.theory.second_order import Answer, wave
from granular_analysis.theory.third_order import shift, third_harmonic
from tests.conftest import members
from tests.manual import Measure, Mutant, verifies

Complexes = NDArray[np.complex128]

SILICA = Contact(0.17)  # Poisson's ratio of the paper's spheres
TAU = np.linspace(0.0, 60.0, 241)
WAVES: list[tuple[ModeName, float, float]] = [
    ("TR", 0.802, 90.0),
    ("TR", 2.127, 90.0),
    ("TR", 1.1, 17.0),
    ("L", 0.9, 0.0),
    ("L", 1.1, 17.0),
    ("RT", 0.802, 90.0),
    ("RT", 1.1, 17.0),
]


def answer(k: ArrayLike, branch: ArrayLike, contact: Contact) -> Answer:
    """Return the answer of the crystal to the forces on the third harmonic of waves of amplitude 1."""
    crystal = hexagonal(contact)
    one = wave(crystal, k, branch)
    return Answer(crystal, crystal.modes(3 * one.wavevector), 3 * one.frequency, third_harmonic(crystal, one))


def third_harmonic_amplitude(k: ArrayLike, branch: ArrayLike, contact: Contact) -> Complexes:
    return in_plane(answer(k, branch, contact).forced())


def third_harmonic_growth(k: ArrayLike, branch: ArrayLike, contact: Contact) -> tuple[NDArray[np.float64], ...]:
    """Return the detunings of the branches at 3k, and their rates."""
    made = answer(k, branch, contact)
    return made.frequency[..., None] - made.targets.frequencies, made.growth_rates()


@cache
def in_the_hierarchy(name: ModeName, wavenumber: float, direction: float, contact: Contact) -> Complexes:
    """Return the (p, q, φ) that run with the wave at 3ϑ in the third order of the exact lattice, in Δ0 per a³.

    Beside it the start launches free waves at 3k and, by the free waves at 2k with the wave, others at 3k: each has its
    frequency of the linear lattice, and a column of the least squares.
    """
    k = wavevector_of(wavenumber, direction)
    mode = bloch.mode(name, wavenumber, direction, contact)
    third = hierarchy_orders(mode, contact, TAU, order=3, rtol=1e-11)[2]
    at_three = 2 * np.mean(third * np.exp(-3j * lattice.torus_phases(third.shape[-1])), axis=-1)
    doubled, tripled = (real_modes(n * k, contact)[0] for n in (2, 3))
    turns = [3 * mode.frequency, *tripled, *-tripled, *(mode.frequency + doubled), *(mode.frequency - doubled)]
    if contact.has_history:  # what the start leaves in contacts at 3k, and at 2k, where the wave meets it
        turns += [0.0, mode.frequency]
    return np.linalg.lstsq(np.exp(-1j * np.outer(TAU, turns)), at_three)[0][0]


def predicted(name: ModeName, wavenumber: float, direction: float, contact: Contact) -> Complexes:
    k = wavevector_of(wavenumber, direction)
    u, v, phi = third_harmonic_amplitude(k, bloch.branch_index(name, k, contact), contact)
    return np.array([*(frame(direction) @ [u, v]), phi])


def relative(measured: Complexes, expected: Complexes) -> float:
    return float(np.linalg.norm(measured - expected) / np.linalg.norm(expected))


# The third order has up to 1600 times the 1e-11 of the integration, over amplitudes of 1e-2 to 1e-5, and the fit, whose
# columns may be of one frequency within a turn of the run, magnifies that; 2e-6 is the largest seen. A coefficient that
# is wrong by one part in a thousand makes 1e-4 and more.
FITTED = 5e-5


@pytest.mark.parametrize(("name", "wavenumber", "direction"), WAVES)
@verifies(
    "Third order: the third harmonic of L, TR and RT in any direction",
    reference="other integrator: the third order of the exact lattice, fitted",
    tolerance=5e-05,
    reason="1600 times the 1e-11 of the integration, over amplitudes down to 1e-5, which the fit magnifies",
    mutant=Mutant(
        "analysis/granular_analysis/theory/third_order.py",
        "twice.frequency, 0.5 * twice.forced()",
        "twice.frequency, 0.499 * twice.forced()",
    ),
)
def test_the_third_harmonic_is_that_of_the_exact_lattice(
    name: ModeName, wavenumber: float, direction: float, measured: Measure
) -> None:
    wave = name, wavenumber, direction, SILICA
    measured(relative(in_the_hierarchy(*wave), predicted(*wave)))


def test_one_percent_of_inertia_or_another_poisson_s_ratio_is_seen() -> None:
    seen = in_the_hierarchy("TR", 1.1, 17.0, SILICA)
    for wrong in (Contact(0.17, inertia=0.404), Contact(0.18), Contact(0.17, rotation=False)):
        assert relative(seen, predicted("TR", 1.1, 17.0, wrong)) > 20 * FITTED


def test_along_y_a_shear_wave_has_no_third_harmonic_in_p_and_l_none_in_q_and_phi() -> None:
    p, q, phi = np.abs(predicted("TR", 0.802, 90.0, SILICA))
    assert p < 1e-14 < 1e-3 < min(q, phi)  # rounding
    p, q, phi = np.abs(predicted("L", 0.802, 90.0, SILICA))
    assert max(q, phi) < 1e-14 < 1e-3 < p


@pytest.mark.parametrize(
    ("name", "wavenumber", "sizes", "partner", "detuning"),
    [
        ("TR", 0.802, (6.82e-3, 6.57e-3), "RT", -0.464),
        ("TR", 1.475, (17.0, 70.4), "RT", 0.0010),
        ("TR", 2.127, (1.83e-4, 1.38e-2), "RT", 0.232),
        ("L", 0.802, (8.27e-2,), "L", 0.238),
    ],
)
def test_silica_has_the_third_harmonics_of_the_page(
    name: ModeName, wavenumber: float, sizes: tuple[float, ...], partner: str, detuning: float
) -> None:
    p, q, phi = np.abs(predicted(name, wavenumber, 90.0, SILICA))
    shown = (q, phi) if name == "TR" else (p,)
    assert shown == pytest.approx(sizes, rel=5e-3)  # three digits
    k = wavevector_of(wavenumber, 90.0)
    gaps, _ = third_harmonic_growth(k, bloch.branch_index(name, k, SILICA), SILICA)
    assert gaps[bloch.branch_index(partner, 3 * k, SILICA)] == pytest.approx(detuning, abs=5.1e-4)


def test_at_the_paper_s_resonance_the_third_harmonic_is_nearly_that_of_rt() -> None:
    k = wavevector_of(1.475, 90.0)
    detunings, rates = third_harmonic_growth(k, bloch.branch_index("TR", k, SILICA), SILICA)
    upper = bloch.branch_index("RT", 3 * k, SILICA)
    # TR(ξ) + L(2ξ) → RT(3ξ) is 0.0017 off, and L(2ξ) 0.0007 from 2Ω
    assert detunings[upper] == pytest.approx(0.00105, abs=1e-5)
    # 3ξ is 4.425, beyond the zone: TR there is the lower one of the branches, and L is not driven
    assert rates[bloch.branch_index("L", 3 * k, SILICA)] < 1e-14
    # The other branches and −3Ω add terms of order one to one of rate/detuning, some tens
    amplitude = np.linalg.norm(third_harmonic_amplitude(k, bloch.branch_index("TR", k, SILICA), SILICA))
    assert amplitude == pytest.approx(rates[upper] / abs(detunings[upper]), rel=0.05)


def test_arrays_of_waves_give_what_single_ones_give() -> None:
    k = np.array([[1.1, 0.4], [0.2, 0.9]])
    together = third_harmonic_amplitude(k, [0, 2], SILICA)
    for row, each, branch in zip(together, k, (0, 2), strict=True):
        assert row == pytest.approx(third_harmonic_amplitude(each, branch, SILICA), rel=0, abs=1e-14)  # rounding


CONTACTS = {
    "LAMMPS's geometry": Contact(0.17, overlap_ratio=0.02),
    "compressed": Contact(0.17, overlap_ratio=0.02, prestress=0.5),
    "incremental": Contact(0.17, law="incremental"),
    "incremental, LAMMPS's geometry": Contact(0.17, law="incremental", overlap_ratio=0.02),
    "JKR": Contact(0.17, overlap_ratio=0.02, adhesion_law="jkr"),
    "without rotation": Contact(0.17, overlap_ratio=0.02, rotation=False),
}
OTHERS = {
    "without turns": Contact(0.17, rotation=False),
    "auxetic": Contact(-0.3),
    "heavy rim": Contact(0.4, inertia=0.5),
}


CUBIC: list[tuple[ModeName, float, float]] = [("TR", 0.802, 90.0), ("TR", 1.1, 17.0), ("L", 0.9, 0.0)]
EVERY = [(*wave, contact) for wave in CUBIC for contact in CONTACTS]
# Waves oblique, along x and along y in turn: one of each contact is left to `make test`, but for JKR, whose cubic term
# the shift of the frequency has
LEFT = [(*CUBIC[number], contact) for number, contact in zip((1, 2, 1, 0, 2, 1), CONTACTS, strict=True)]
LEFT = [each for each in LEFT if each[-1] != "JKR"]
LEFT += [(*CUBIC[1], contact) for contact in OTHERS]
EVERY += LEFT[-len(OTHERS) :]


@pytest.mark.parametrize(
    ("name", "wavenumber", "direction", "contact"), members(EVERY, *(each for each in EVERY if each not in LEFT))
)
def test_geometry_memory_and_other_spheres_have_their_own_cubic_terms(
    name: ModeName, wavenumber: float, direction: float, contact: str
) -> None:
    wave = name, wavenumber, direction, (CONTACTS | OTHERS)[contact]
    assert relative(in_the_hierarchy(*wave), predicted(*wave)) < FITTED


@pytest.mark.parametrize("contact", ["LAMMPS's geometry", "incremental"])
def test_without_them_the_third_harmonic_is_seen_to_be_wrong(contact: str) -> None:
    wave: tuple[ModeName, float, float, Contact] = ("TR", 0.802, 90.0, CONTACTS[contact])
    assert relative(in_the_hierarchy(*wave), predicted("TR", 0.802, 90.0, SILICA)) > 100 * FITTED


@pytest.mark.parametrize("law", ["secant", "incremental"])
def test_a_sheet_that_lies_askew_in_space_has_the_third_order_of_the_plane(law: ShearLaw) -> None:
    apart = 2 * 50.0 - 0.1159709  # at rest by the DMT law
    flat, silica = apart * np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)]]), [Material(73e3, 0.17, 63.0)]
    turn = np.array([[2.0, -1.0, 2.0], [2.0, 2.0, -1.0], [-1.0, 2.0, 2.0]]) / 3
    plane = Crystal.of(flat, [[0.0, 0.0]], 50.0, 2.2e-3, silica, shear_law=law)
    space = Crystal.of(np.pad(flat, ((0, 0), (0, 1))) @ turn.T, np.zeros((1, 3)), 50.0, 2.2e-3, silica, shear_law=law)
    k = np.array([0.7, 0.9, 0.0]) / apart
    for branch in range(3):
        one = wave(plane, k[:2], branch)
        same = np.argmin(np.abs(space.modes(turn @ k).frequencies - one.frequency))
        other = wave(space, turn @ k, same)
        assert shift(space, other).total == pytest.approx(float(shift(plane, one).total), rel=1e-10)
        sizes = [np.linalg.norm(third_harmonic(*each)) for each in ((plane, one), (space, other))]
        assert sizes[1] == pytest.approx(sizes[0], rel=1e-10)
