"""Second order of crystals in space beside LAMMPS, by commands of their own: fcc, hcp, a layer on a substrate."""

from dataclasses import dataclass
from functools import cache, cached_property
from itertools import product

import numpy as np
import pytest
from scipy.optimize import curve_fit

from granular_analysis.theory.creep import creep
from granular_analysis.theory.crystal import Crystal, Wall
from granular_analysis.theory.lattices import LATTICES, Lattice
from granular_analysis.theory.network import Material, Network, mixed
from granular_analysis.theory.phase_matching import Match, matches
from granular_analysis.theory.second_order import Mixed, Wave, second_order, wave
from granular_analysis.theory.surface_wave import Coupled, HalfSpace
from tests.by_commands import moved
from tests.conftest import members

SILICA = Material(73e3, 0.17, 63.0)  # MPa, mJ/m²: lengths in nm, masses in ag, times in ns
RADIUS, DENSITY = 500.0, 2.2e-3
ROOT2, ROOT3, ROOT6 = np.sqrt(2), np.sqrt(3), np.sqrt(6)
ENDLESS = np.inf  # length of a box without a period


def overlap(radius: float) -> float:
    """Return the overlap at rest of a sphere with another, or with a wall of radius inf."""
    none = np.array([0])
    A, _, F, _ = mixed([SILICA], (none, none), (np.array([RADIUS]), np.array([radius])))
    return float((F / A)[0] ** (2 / 3))


DEPTH, SUNK = overlap(RADIUS), overlap(ENDLESS)
APART = 2 * RADIUS - DEPTH
FLOOR = Wall((0.0, 0.0, SUNK - RADIUS), (0.0, 0.0, -1.0), SILICA)


def filled(lattice: Lattice, box: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the places (N, 3) of a lattice in a small box, and their numbers (N,) in the primitive cell."""
    reach = np.ceil(np.linalg.norm(box) * np.linalg.norm(np.linalg.pinv(lattice.vectors), axis=0)).astype(int)
    steps = np.array(list(product(*(range(-each, each + 1) for each in reach))))
    place = (steps @ lattice.vectors)[:, None] + lattice.basis
    inside = np.all((place > -1e-9) & (place < box - 1e-9), axis=-1)
    return place[inside], np.nonzero(inside)[1]


# Cells with right angles, in distances of spheres; a layer on a substrate has no height
CELLS = {
    ("square", ""): (1.0, 1.0, ENDLESS),
    ("hexagonal", ""): (1.0, ROOT3, ENDLESS),
    ("cubic", "[001]"): (1.0, 1.0, 1.0),
    ("fcc", "[001]"): (1.0, ROOT2, 1.0),
    ("fcc", "[111]"): (1.0, ROOT6, ROOT3),
    ("hcp", "c"): (1.0, 2 * ROOT6 / 3, ROOT3),
}


@dataclass(frozen=True, eq=False)
class Run:
    """A wave along y in some cells of a crystal, periodic except for layers, which lie on a wall."""

    name: tuple[str, str]
    repeats: tuple[int, int, int]
    branch: int
    cycles: int = 1

    @property
    def lattice(self) -> Lattice:
        return LATTICES[self.name]

    @property
    def box(self) -> np.ndarray:
        return APART * np.array(self.repeats) * CELLS[self.name]

    @cached_property
    def floor(self) -> bool:
        return not np.isfinite(self.box[2])

    @cached_property
    def crystal(self) -> Crystal:
        vectors, place = APART * self.lattice.vectors, APART * self.lattice.basis
        return Crystal.of(vectors, place, RADIUS, DENSITY, [SILICA], walls=[FLOOR] if self.floor else [])

    @cached_property
    def wave(self) -> Wave:
        return wave(self.crystal, [0.0, 2 * np.pi * self.cycles / self.box[1], 0.0], self.branch)

    @cached_property
    def places(self) -> tuple[np.ndarray, np.ndarray]:
        cell = np.where(np.isfinite(CELLS[self.name]), CELLS[self.name], 0.1)
        place, kind = filled(self.lattice, cell)
        shifts = cell * np.array(list(product(*map(range, self.repeats))))
        return APART * (shifts[:, None] + place).reshape(-1, 3), np.tile(kind, len(shifts))

    @property
    def period(self) -> float:
        return float(2 * np.pi / self.wave.frequency)

    def theory(self, size: complex, times: np.ndarray) -> np.ndarray:
        """Return the second order (T, N, 3) of u."""
        place, kind = self.places
        field = np.empty((len(times), len(place), 3))
        corners = place - self.crystal.position[kind]
        # Cells of one y move alike
        for y in np.unique(np.round(corners[:, 1], 6)):
            here = np.flatnonzero(np.abs(corners[:, 1] - y) < 1e-5)
            _, second = second_order(self.crystal, [self.wave.times(size)], times, corners[here[0]])
            field[:, here] = second[:, kind[here], :3]
        return field

    def even(self, size: complex, times: np.ndarray, substeps: int) -> np.ndarray:
        """Return the displacements (T, N, 3) in LAMMPS that are even in the amplitude."""
        return (self.lammps(size, times, substeps) + self.lammps(-size, times, substeps)) / 2

    def lammps(self, size: complex, times: np.ndarray, substeps: int, drag: float = 0.0) -> np.ndarray:
        """Return the displacements (T, N, 3) in LAMMPS, with some steps between two times; drag in ag/ns."""
        place, kind = self.places
        field = size * self.wave.shape[kind] * np.exp(1j * (place @ self.wave.wavevector))[:, None]
        start, rate = ((part[:, :3], part[:, 3:] / RADIUS) for part in (field.real, self.wave.frequency * field.imag))
        one, walls = np.ones(len(place)), (FLOOR,) if self.floor else ()
        spheres = Network(place, RADIUS * one, DENSITY * one, (SILICA,), cell=tuple(self.box), walls=walls)
        # Friction is a few times what a wave needs, as more would freeze slips
        law = (
            f"* * dmt 73e3 0.0 0.17 31.5 tangential mindlin NULL 0.0 {float(5 * abs(size) / DEPTH)!r} damping velocity"
        )
        more = f"fix drag all viscous {drag!r}" if drag else ""
        return moved(spheres, law, start, rate, float(times[1] / substeps), substeps, len(times) - 1, more)[..., :3]


def left(run: Run, amplitude: float, periods: int = 2, turned: float = 0.25) -> float:
    """Return the share of the second order that theory and LAMMPS do not have in common.

    The fastest mode turns by `turned` rad in the longest of three steps.
    """
    size, times = amplitude * DEPTH * np.exp(0.3j), np.linspace(0.0, periods * run.period, 7 * periods)
    highest = run.crystal.modes(run.wave.wavevector).frequencies[-1]
    fewest = int(np.ceil(times[1] * highest / turned))
    # These weights remove errors of first and second order in the step; LAMMPS turns a slip by the end of a step
    parts = [weight * run.even(size, times, n * fewest) for n, weight in ((1, 1 / 3), (2, -2.0), (4, 8 / 3))]
    theory = run.theory(size, times)
    return float(np.linalg.norm(sum(parts) - theory) / np.linalg.norm(theory))


CASES = {
    "fcc along [001], T": Run(("fcc", "[001]"), (3, 4, 3), 0, 2),
    "fcc along [111], T": Run(("fcc", "[111]"), (3, 2, 2), 0),
    "hcp along c, T": Run(("hcp", "c"), (3, 3, 2), 0),
    "cubic along [001], L": Run(("cubic", "[001]"), (3, 8, 3), 2),
    "square layer on a substrate": Run(("square", ""), (3, 6, 1), 0),
} | {f"layer on a substrate, branch {branch + 1}": Run(("hexagonal", ""), (3, 3, 1), branch) for branch in range(6)}


MIDDLE = [f"layer on a substrate, branch {branch}" for branch in (2, 3, 4, 5)]


@pytest.mark.parametrize("name", members(CASES, "fcc along [111], T", *MIDDLE))
def test_lammps_has_the_second_order_in_space(name: str) -> None:
    # Fourth order is some a² = 4e-4 of the second where no resonance is near
    assert left(CASES[name], 0.02) < 5e-4


ORDERS = "fcc along [001], T", "layer on a substrate, branch 1"


@pytest.mark.parametrize("name", members(ORDERS, "fcc along [001], T"))
def test_what_is_left_in_space_falls_as_the_square_of_the_amplitude(name: str) -> None:
    strong, weak = (left(CASES[name], amplitude) for amplitude in (0.16, 0.08))
    assert np.log2(strong / weak) == pytest.approx(2, abs=0.1)


# --- resonances -------------------------------------------------------------------------------------------------------

# Waves next to resonances that grow: rows of ξ = 2π cycles/rows, the branch that grows, from 0, and ξ of the resonance
RESONANCES = {
    "fcc along [001], T to L": (Run(("fcc", "[001]"), (3, 53, 3), 0, 26), 4, 1.541596),
    "fcc along [111], T to L": (Run(("fcc", "[111]"), (3, 27, 2), 0, 19), 2, 1.471436),
    "fcc along [111], T to T": (Run(("fcc", "[111]"), (3, 31, 2), 0, 24), 3, 1.621280),
    "hcp along c, T to L": (Run(("hcp", "c"), (3, 32, 2), 0, 15), 5, 1.471436),
    "layer, sagittal": (Run(("hexagonal", ""), (3, 35, 1), 0, 9), 2, 0.807163),
    "layer, third to fourth": (Run(("hexagonal", ""), (3, 13, 1), 2, 4), 3, 0.964429),
    "square layer, third to fourth": (Run(("square", ""), (3, 20, 1), 2, 3), 3, 0.940261),
}


@cache
def growing(name: tuple[str, str]) -> list[Match]:
    """Return the second harmonics along y that grow, of a crystal or a layer on a substrate."""
    crystal = next(run.crystal for run, _, _ in RESONANCES.values() if run.name == name)
    return [each for each in matches(crystal, (0, 1, 0)) if each.rate > 0]


# The second order of fcc and of hcp is claimed above, next to no resonance
MORE = "fcc along [001], T to L", "fcc along [111], T to L", "fcc along [111], T to T", "hcp along c, T to L"
MORE += "layer, sagittal", "layer, third to fourth"


@pytest.mark.parametrize("name", members(RESONANCES, *MORE))
def test_lammps_has_the_resonances_of_crystals_in_space(name: str) -> None:
    run, target, number = RESONANCES[name]
    row = APART * run.lattice.row
    found = [each for each in growing(run.name) if each.branch == run.branch]
    (near,) = (each for each in found if each.wavenumber * row == pytest.approx(number, abs=1e-6))
    assert near.target == target
    xi = float(run.wave.wavevector[1]) * row
    assert xi == pytest.approx(number, abs=0.005)
    # The harmonic that grows holds nearly all of the second order, and depletes the wave by some a²
    periods = 2
    pair = Mixed(run.crystal, run.wave, run.wave)
    size = abs(np.sum(pair.targets.duals[target] * 0.5 * pair.signal(periods * run.period)))
    assert size == pytest.approx(near.rate * periods * run.period, rel=0.2)
    assert left(run, 0.005, periods, turned=0.35) < 1e-3


# --- slip that winds up -----------------------------------------------------------------------------------------------


def drifted(run: Run, amplitude: float, *periods: int) -> list[float]:
    """Return the velocity of the mean of all spheres along y over some periods in LAMMPS, by that of theory."""
    times = np.linspace(0.0, max(periods) * run.period, 8 * max(periods) + 1)
    size = amplitude * DEPTH * np.exp(0.3j)
    highest = run.crystal.modes(run.wave.wavevector).frequencies[-1]
    moved = run.even(size, times, int(np.ceil(times[1] * highest / 0.25))).mean(axis=1)[:, 1]
    velocity = creep(run.crystal, run.wave.times(size)).velocity[0, 1]
    return [slope(times[: 8 * each + 1], moved[: 8 * each + 1]) / velocity for each in periods]


def slope(times: np.ndarray, moved: np.ndarray) -> float:
    """Return the slope of a line fitted to values with a window that removes oscillations."""
    return float(np.polyfit(times, moved, 1, w=np.hanning(len(times) + 2)[1:-1])[0])


@pytest.mark.parametrize("branch", members([0, 1], 1))
def test_a_layer_creeps_in_lammps_as_its_slip_winds_up(branch: int) -> None:
    assert drifted(Run(("hexagonal", ""), (3, 3, 1), branch), 0.04, 40) == pytest.approx([1], abs=1e-3)


def test_a_harmonic_near_a_resonance_takes_from_the_creep() -> None:
    # At ξ = π/4 the lowest branch has twice its frequency within 1.2 % of a branch there: both beat for 41 periods
    run = Run(("hexagonal", ""), (3, 4, 1), 0)
    far = creep(run.crystal, run.wave.times(0.2 * DEPTH))
    assert far.beat / run.period == pytest.approx(40.8, abs=0.1)
    assert far.departure == pytest.approx(-0.12, abs=0.005)
    # To leading order in the amplitude, of which 0.2 leaves a tenth
    whole, beat = drifted(run, 0.2, 164, 41)
    assert whole - 1 == pytest.approx(far.departure, rel=0.15)
    assert beat > 2  # over one beat the wave itself comes and goes


def test_a_drag_on_each_sphere_is_the_leak_into_an_elastic_substrate() -> None:
    run = Run(("hexagonal", ""), (3, 2, 1), 2, 0)  # at k = 0 the third branch is the vertical resonance
    lattice, glass = run.lattice, HalfSpace.of(SILICA.youngs_modulus, SILICA.poisson_ratio, DENSITY)
    plain = {"walls": [FLOOR], "true_geometry": False}
    film = Coupled(Crystal.of(APART * lattice.vectors, lattice.basis, RADIUS, DENSITY, [SILICA], **plain), glass)
    leak = film.leaking([0.0, 1e-9 / APART], float(run.wave.frequency))
    # A sphere that pulls at its area of the half-space, impedance ρc_l, loses as by a drag of mK_N/(ρc_l area)
    mass, stiffness = run.crystal.mass[0, 0], run.crystal.bonds.law.stiffness[-1]
    drag = float(mass * stiffness / (glass.density * glass.longitudinal * film.area))
    times = np.linspace(0, 4 * run.period, 65)
    moved = run.lammps(1e-3 * DEPTH, times, 60, drag)[:, :, 2].mean(axis=1) / (1e-3 * DEPTH)
    fitted, _ = curve_fit(lambda t, rate, omega: np.exp(-rate * t) * np.cos(omega * t), times, moved, [0.04, 0.9])
    assert fitted[0] == pytest.approx(-leak.imag, rel=0.02)
