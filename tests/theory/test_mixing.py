"""The wave that two waves make, against the exact lattice on a periodic sheet, closed forms and symmetry."""

from functools import cache
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from cases.fields import component
from granular_analysis.theory import lattice
from granular_analysis.theory.bloch import branch_index, frame, in_plane, pair_of, wavevector_of
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.neighbours import Neighbours, shifted
from granular_analysis.theory.second_order import Mixed
from granular_analysis.theory.selection import forbidden
from granular_analysis.theory.wave import generated
from tests.conftest import members
from tests.manual import Measure, Mutant, verifies
from tests.polarisations import modes
from tests.sheet import Sheet

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

SILICA = 0.17  # Poisson's ratio of the paper's spheres
SHEET = Sheet(12, 6, SILICA)
TAU = np.linspace(0.0, 20.0, 21)

# Two waves as (periods across the sheet, periods along it, branch); each pair has a sum and a difference. All of their
# wave vectors differ from their negatives, so that a projection tells them apart.
PAIRS = {
    "along y, TR and TR": ((0, 1, 0), (0, 2, 0)),
    "along y, L and TR": ((0, 1, 1), (0, 2, 0)),
    "along y, RT and TR": ((0, 1, 2), (0, 3, 0)),
    "along x, lower and middle": ((1, 0, 0), (2, 0, 1)),
    "along x, lower and upper": ((1, 0, 0), (2, 0, 2)),
    "mirrored": ((1, 2, 0), (-1, 2, 0)),
    "oblique, lower and middle": ((1, 1, 0), (0, 3, 1)),
    "oblique, upper and upper": ((1, 2, 2), (1, -1, 2)),
    "difference phase-matched to 0.005": ((0, 4, 0), (1, -2, 2)),
    "difference phase-matched to 0.002": ((1, 1, 1), (2, 1, 1)),
}
CONTACTS = {
    "incremental": Contact(SILICA, law="incremental"),
    "true normals, compressed": Contact(SILICA, overlap_ratio=0.02, prestress=0.5),
    "true normals, incremental": Contact(SILICA, overlap_ratio=0.02, law="incremental"),
    "without rotation": Contact(SILICA, rotation=False),
    "without shear": Contact(SILICA, shear=False),
}
PAPER = Contact(SILICA)


def on_the_sheet(name: str, sign: int, contact: Contact = PAPER) -> Mixed:
    first, second = ((on_sheet(x, y), branch) for x, y, branch in PAIRS[name])
    return pair_of(first, second, sign, contact)


def on_sheet(x: int, y: int) -> Floats:
    """Return the wave vector with x periods across the sheet and y along it, in 1/lattice constant."""
    return 2 * np.pi * np.array([x / SHEET.columns, y / (SHEET.rows * np.sqrt(0.75))])


# ---- the witness: the exact lattice of a sheet, with none of the springs of the theory


def copies_of_sheet(copies: int) -> Neighbours:
    """Neighbours on independent copies of the sheet, side by side; (p, q) are (u, v)."""
    ends = np.concatenate([SHEET.neighbours + copy * len(SHEET.rest) for copy in range(copies)], axis=1)
    return shifted(
        0.0,
        lambda values: values[..., ends[:3]],
        lambda values: np.sum([values[..., bond, end] for bond, end in enumerate(ends[3:])], axis=0),
    )


SIGNS = np.array([(1, 1), (1, -1), (-1, 1), (-1, -1)])
AMPLITUDES = np.array([0.02, 0.01])


@cache
def crossed_field(name: str, contact: Contact) -> Floats:
    """Return what is of the first order in both waves, (T, N, 3) in Δ0 per product of their amplitudes.

    The four signs of the two waves single out the terms that are odd in both, a² and a⁴ …, and Richardson's
    extrapolation from two amplitudes takes a⁴ off.
    """
    waves = []
    for x, y, branch in PAIRS[name]:
        k = on_sheet(x, y)
        frequencies, shapes = modes(k, contact)
        field = np.exp(1j * SHEET.rest @ k)[:, None] * shapes[branch]
        waves.append(np.concatenate([field.real, (-1j * frequencies[branch] * field).real], axis=1).T)
    start = [a * (one * waves[0] + other * waves[1]) for a in AMPLITUDES for one, other in SIGNS]
    neighbours = copies_of_sheet(len(start))
    state = lattice.with_shear(np.concatenate(start, axis=1), contact, neighbours)
    states = lattice.motion(state, contact, neighbours, TAU, 1e-11, AMPLITUDES[-1])[:, :3]
    runs = states.reshape(len(TAU), 3, len(AMPLITUDES), len(SIGNS), -1)
    crossed = np.einsum("tcasn,s->atnc", runs, SIGNS.prod(axis=1) / 4)
    coarse, fine = (field / a**2 for field, a in zip(crossed, AMPLITUDES, strict=True))
    return np.asarray((4 * fine - coarse) / 3)


def relative(measured: Complexes, expected: Complexes) -> float:
    """Return the L2 distance of two complex fields over the norm of the second."""
    return float(np.linalg.norm(measured - expected) / np.linalg.norm(expected))


# Extrapolation leaves a⁶, some 1e-7, and the integration 1e-11 of a over a² = 1e-4, which twenty τ may magnify tenfold;
# 2e-7 is the largest seen. A coefficient that is wrong by one part in a thousand makes 1e-3.
EXACT = 1e-5


MORE = ["along y, L and TR", "along x, lower and middle", "oblique, lower and middle", "oblique, upper and upper"]
MORE += ["along y, RT and TR", "difference phase-matched to 0.005"]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("name", members(PAIRS, *MORE))
@verifies(
    "Sum and difference of two waves, ten pairs in any direction",
    reference="other integrator: a sheet in which every sphere is integrated, extrapolated to a = 0",
    tolerance=1e-05,
    reason="extrapolation leaves a⁶, some 1e-7, the integration 1e-11 of a over a² = 1e-4, times ten",
    mutant=Mutant(
        "analysis/granular_analysis/theory/bonds.py",
        "return together, 0.5 * self.law.shear_growth",
        "return together, 0.501 * self.law.shear_growth",
    ),
)
def test_ten_pairs_make_what_the_exact_lattice_makes(name: str, sign: int, measured: Measure) -> None:
    pair = on_the_sheet(name, sign)
    seen = component(crossed_field(name, PAPER), SHEET.rest, pair.wavevector[:2])
    measured(relative(seen, in_plane(pair.signal(TAU))))


# One pair of each contact is left to `make test`
OTHERS = ["along y, TR and TR", "oblique, lower and middle", "mirrored"]
LEFT = zip(CONTACTS, [OTHERS[2], OTHERS[2], OTHERS[1], OTHERS[0], OTHERS[1]], strict=True)
REST = set(product(CONTACTS, OTHERS)) - set(LEFT)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(("contacts", "name"), members(product(CONTACTS, OTHERS), *REST))
def test_so_they_do_with_other_contacts(contacts: str, name: str, sign: int) -> None:
    pair = on_the_sheet(name, sign, CONTACTS[contacts])
    seen = component(crossed_field(name, CONTACTS[contacts]), SHEET.rest, pair.wavevector[:2])
    assert relative(seen, in_plane(pair.signal(TAU))) < EXACT


@pytest.mark.parametrize("left_out", ["law", "overlap_ratio"])
def test_contacts_left_out_of_the_theory_are_seen(left_out: str) -> None:
    contact = CONTACTS["true normals, incremental"]
    wrong = Contact(SILICA, law="incremental") if left_out == "overlap_ratio" else Contact(SILICA, overlap_ratio=0.02)
    name = "oblique, lower and middle"
    seen = component(crossed_field(name, contact), SHEET.rest, on_the_sheet(name, 1).wavevector[:2])
    assert relative(seen, in_plane(on_the_sheet(name, 1, wrong).signal(TAU))) > 1e-2


def test_two_of_the_pairs_are_as_near_to_a_resonance_as_their_names_say() -> None:
    near = [float(np.abs(on_the_sheet(name, -1).detunings).min()) for name in PAIRS if "phase-matched" in name]
    assert near == pytest.approx([0.00537, 0.00178], abs=1e-5)


def test_the_distance_sees_one_percent_and_a_wrong_sign() -> None:
    field = np.array([[1.0 + 2.0j, 0.5j], [3.0, 0.1]])
    assert relative(1.01 * field, field) == pytest.approx(0.01)
    assert relative(-field, field) == pytest.approx(2.0)
    assert relative(field.conj(), field) > 0.5


# ---- symmetry


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("name", members([name for name in PAIRS if name.startswith(("along", "mirrored"))], *MORE))
def test_what_symmetry_forbids_is_not_in_the_exact_lattice(name: str, sign: int) -> None:
    pair = on_the_sheet(name, sign)
    banned = forbidden(pair)
    assert 0 < banned.sum() < 3
    field = component(crossed_field(name, PAPER), SHEET.rest, pair.wavevector[:2])
    shapes = modes(pair.wavevector, PAPER)[1] * PAPER.masses
    shares = np.abs(field @ shapes.conj().T).max(axis=0)
    # Rounding, 1e-16 of a displacement a = 0.01, over a² = 1e-4, grown over 20 τ; and for the difference of mirrored
    # waves, which is forbidden to second order only, a⁶ and what extrapolation leaves of a⁴
    assert shares[banned].max() < 1e-6 * shares.max()
    assert shares[~banned].max() == shares.max()


def turned(length: float, angle: float) -> Floats:
    return length * frame(angle)[0]


M = np.array([0.0, 2 * np.pi / np.sqrt(3)])  # the middle of a side of the zone, on the mirror line across y
WAVEVECTORS = {
    "along y": (turned(0.7, 90.0), turned(1.3, 90.0)),
    "along x, against each other": (turned(0.7, 0.0), turned(1.9, 180.0)),
    "along 30 degrees": (turned(0.8, 30.0), turned(1.1, 30.0)),
    "on the side of the zone": (M + [0.3, 0.0], M + [0.9, 0.0]),
    "on the side and parallel to it": (M + [0.3, 0.0], np.array([0.9, 0.0])),
    "mirrored at y": (turned(1.1, 73.0), turned(1.1, 107.0)),
    "mirrored at 30 degrees": (turned(1.1, 17.0), turned(1.1, 43.0)),
    "across each other, on two mirrors": (turned(0.5, 90.0), turned(0.8, 0.0)),
    "turned by 60 degrees": (turned(1.2, 11.0), turned(1.2, 71.0)),
    "oblique, one length": (turned(1.2, 11.0), turned(1.2, 50.0)),
    "at two angles that a mirror exchanges": (turned(1.1, 73.0), turned(0.9, 107.0)),
}


@pytest.mark.rounding
@pytest.mark.parametrize("where", WAVEVECTORS)
def test_symmetry_forbids_every_drive_that_vanishes_and_no_other(where: str) -> None:
    one, other = WAVEVECTORS[where]
    for contact, first, second, sign in product((PAPER, CONTACTS["incremental"]), range(3), range(3), (1, -1)):
        pair = pair_of((one, first), (other, second), sign, contact)
        if pair.winds:
            assert contact is not PAPER
            assert sign == -1
            continue
        drives = np.abs(pair.steady)
        # Rounding is 1e-16 of sums of nine numbers of order one; the smallest drive of these that is none is 1e-5
        assert ((drives < 1e-12) == forbidden(pair)).all(), (first, second, sign)


@pytest.mark.parametrize("angle", [90.0, 0.0])
@pytest.mark.parametrize(
    ("names", "made"),
    [(("L", "L"), "L"), (("TR", "TR"), "L"), (("RT", "TR"), "L"), (("L", "TR"), "TR, RT"), (("L", "RT"), "TR, RT")],
)
def test_waves_along_y_and_x_make_what_the_product_of_parities_says(
    angle: float, names: tuple[str, str], made: str
) -> None:
    one, other = turned(0.8, angle), turned(1.1, angle)
    first, second = ((k, branch_index(name, k, PAPER)) for k, name in zip((one, other), names, strict=True))
    pair = pair_of(first, second, 1, PAPER)
    allowed = {name for name in ("L", "TR", "RT") if not forbidden(pair)[branch_index(name, pair.wavevector, PAPER)]}
    assert ", ".join(sorted(allowed, reverse=True)) == made


# ---- closed forms


@pytest.mark.parametrize("name", ["L", "TR", "RT"])
@pytest.mark.parametrize("contacts", ["true normals, compressed", "incremental"])
def test_a_wave_with_itself_makes_twice_its_second_harmonic(name: str, contacts: str) -> None:
    xi, contact = 0.9, CONTACTS[contacts]
    k = wavevector_of(xi, 90.0)
    wave = (k, branch_index(name, k, contact))
    forced = in_plane(pair_of(wave, wave, 1, contact).forced())
    # Of real fields one wave makes half of it. Rounding, of numbers of order one
    expected = 2j * generated(name, xi, contact)
    assert forced == pytest.approx(np.array([0.0, expected, 0.0]), rel=0, abs=1e-12)


def test_the_order_of_the_waves_of_a_sum_does_not_matter_and_that_of_a_difference_conjugates() -> None:
    contact = CONTACTS["true normals, incremental"]
    one, other = ((1.1, 0.4), 1), ((-0.3, 0.8), 2)
    for sign in (1, -1):
        there, back = (in_plane(pair_of(*tones, sign, contact).signal(TAU)) for tones in ((one, other), (other, one)))
        assert there == pytest.approx(back if sign == 1 else back.conj(), rel=0, abs=1e-12)  # rounding of 20 τ


def test_a_wave_vector_of_the_next_zone_names_the_same_wave() -> None:
    reciprocal = 2 * np.pi * np.array([1.0, -1.0 / np.sqrt(3.0)])
    one, other = ((1.1, 0.4), 1), np.array([-0.3, 0.8])
    inside, outside = (in_plane(pair_of(one, (k, 0), 1, PAPER).forced()) for k in (other, other + reciprocal))
    assert np.abs(inside) == pytest.approx(np.abs(outside), rel=0, abs=1e-12)  # a mode's sign is that of its direction


def test_arrays_of_waves_give_what_single_ones_give() -> None:
    one, others = ((1.1, 0.4), 1), np.array([[-0.3, 0.8], [0.2, 0.9], [1.0, 0.1]])
    contact = CONTACTS["true normals, incremental"]
    together = pair_of(one, (others, [0, 1, 2]), -1, contact)
    for index, k in enumerate(others):
        single = pair_of(one, (k, index), -1, contact)
        for of in (Mixed.forced, lambda pair: pair.detunings, Mixed.growth_rates):
            assert of(together)[index] == pytest.approx(of(single), rel=0, abs=1e-12)  # rounding


# ---- resonance


def matched(sign: int, contact: Contact) -> tuple[Mixed, int]:
    """A phase-matched pair off the mirror lines, found by the length of the second wave, and the branch it makes."""
    second, target = (0, 2) if sign == 1 else (1, 0)

    def pair(length: float) -> Mixed:
        return pair_of((turned(1.1, 17.0), 1), (turned(length, 40.0), second), sign, contact)

    lengths = np.linspace(0.3, 3.0, 28)
    gaps = np.array([pair(length).detunings[target] for length in lengths])
    index = int(np.flatnonzero(np.diff(np.signbit(gaps)))[0])
    root = brentq(lambda length: pair(length).detunings[target], lengths[index], lengths[index + 1], xtol=1e-13)
    return pair(float(root)), target


@pytest.mark.parametrize("contacts", ["incremental", "true normals, compressed"])
@pytest.mark.parametrize("sign", [1, -1])
def test_where_a_pair_is_phase_matched_the_wave_grows_at_the_rate(sign: int, contacts: str) -> None:
    pair, target = matched(sign, CONTACTS[contacts])
    shape = modes(pair.wavevector, CONTACTS[contacts])[1][target]
    times = np.array([1000.0, 2000.0])
    weights = shape.conj() * CONTACTS[contacts].masses
    early, late = in_plane(pair.signal(times)) @ weights / (weights @ shape)
    phase = np.exp(1j * float(pair.frequency) * times)
    grown = abs(late * phase[1] - early * phase[0]) / 1000.0
    # The free wave of −Ω and the static part beat with it: numbers of order one, over 1000
    assert grown == pytest.approx(pair.growth_rates()[target], rel=0.05)
    assert grown > 1e-2


@pytest.mark.parametrize("sign", [1, -1])
def test_next_to_a_resonance_the_forced_wave_is_the_rate_over_the_detuning(sign: int) -> None:
    pair, target = matched(sign, PAPER)
    vectors = pair.first.wavevector, 1.0001 * sign * pair.second.wavevector
    near = pair_of(*zip(vectors, (1, 0 if sign == 1 else 1), strict=True), sign, PAPER)
    rate, detuning = near.growth_rates()[target], near.detunings[target]
    # The other branches and −Ω add terms of order one to one of rate/detuning, some hundreds
    assert np.linalg.norm(in_plane(near.forced())) == pytest.approx(rate / abs(detuning), rel=0.02)
    assert abs(detuning) < 1e-3


def test_two_waves_of_the_paper_s_resonance_are_phase_matched() -> None:
    k = np.array([0.0, 2 * 1.476255486117 / np.sqrt(3)])  # ξ_res of silica
    wave = (k, 0)
    assert abs(pair_of(wave, wave, 1, PAPER).detunings[1]) < 1e-11  # 12 decimals


def test_rates_where_nothing_oscillates_are_no_number() -> None:
    wave = ((1.1, 0.4), 1)
    rates = pair_of(wave, wave, -1, PAPER).growth_rates()  # at k = 0 two branches only translate
    assert np.isnan(rates[:2]).all()
    assert np.isfinite(rates[2])


# ---- what is refused


@pytest.mark.parametrize("contacts", ["incremental", "true normals, compressed"])
def test_contacts_wind_up_between_mirrored_waves_and_nothing_is_steady(contacts: str) -> None:
    pair = pair_of(((1.1, 0.4), 1), ((-1.1, 0.4), 1), -1, CONTACTS[contacts])
    assert pair.winds
    early, late = in_plane(pair.signal(np.array([1000.0, 2000.0])))
    assert np.linalg.norm(late) == pytest.approx(2 * np.linalg.norm(early), rel=0.1)  # beside what is bounded
    for steady in (pair.forced, pair.growth_rates):
        with pytest.raises(ValueError, match="slip winds up: two waves of one frequency"):
            steady()
    assert not pair_of(((1.1, 0.4), 1), ((1.1, 0.4), 1), -1, CONTACTS[contacts]).winds
    assert not pair_of(((1.1, 0.4), 1), ((-1.1, 0.4), 1), -1, PAPER).winds
