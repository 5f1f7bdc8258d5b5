"""The network in space: beside the plane, turned packings, conservation, closed forms of a sphere on a wall, modes."""

from dataclasses import replace
from itertools import product
from math import cos, pi, sin, sqrt

import numpy as np
import pytest

from granular_analysis.measure.norms import slope
from granular_analysis.theory.crystal import Crystal
from granular_analysis.theory.crystal import Wall as Plane
from granular_analysis.theory.network import Material, Network, Wall
from granular_analysis.theory.network_ledger import energy
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_outside import Drive
from granular_analysis.theory.network_state import forces, present, searched_again, start
from granular_analysis.theory.network_tangents import combined, dot, frames, tangents, turned
from tests.conftest import members
from tests.theory.test_network import momentum

SILICA, STEEL = Material(73e3, 0.17, 63.0), Material(200e3, 0.3, 100.0)  # MPa, mJ/m²: nm, ag, ns
RADIUS, DENSITY = 500.0, 0.0022
OVERLAP, TIME = 0.2498514361612, 0.4981191748424  # Δ0 and t0 of the paper's spheres
SPACING = 2 * RADIUS - OVERLAP
SUNK = 2 ** (1 / 3) * OVERLAP  # at rest on a half-space of the same material
FLOOR = Wall((0.0, 0.0, SUNK - RADIUS), (0.0, 0.0, -1.0), SILICA)


def packing(position, **changes) -> Network:
    """Return the paper's spheres at places."""
    alike = np.ones(len(position))
    return replace(Network(np.asarray(position), RADIUS * alike, DENSITY * alike, (SILICA,)), **changes)


def disturbed(network: Network, size: float, seed: int = 5) -> tuple[np.ndarray, ...]:
    """Return random displacements, velocities, turns and spins, (N, d) and (N, 1 or 3) each."""
    rng, (count, ways) = np.random.default_rng(seed), network.position.shape
    turns = (count, 3) if ways == 3 else (count,)
    moving = [rng.uniform(-size, size, shape) for shape in ((count, ways), (count, ways), turns, turns)]
    return moving[0], moving[1] / TIME, moving[2] / RADIUS, moving[3] / RADIUS / TIME


def cluster(**changes) -> Network:
    """Return thirteen unequal spheres of two materials, a ball of fcc, pressed together, on a wall."""
    ways = [(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1) if abs(i) + abs(j) + abs(k) == 2]
    rng = np.random.default_rng(3)
    places = np.array([(0, 0, 0), *ways]) / sqrt(2) * (2 * RADIUS - 1.0)
    network = packing(places, kind=rng.integers(0, 2, 13), materials=(SILICA, STEEL))
    lowest = places[:, 2].min() - RADIUS
    floor = Wall((0.0, 0.0, float(lowest) + 0.4), (0.0, 0.0, -1.0), STEEL, (1.5, 0.7))
    network = replace(network, radius=RADIUS * (1 + 3e-4 * rng.uniform(-1, 1, 13)), walls=(floor,))
    return replace(network, **changes)


def any_turn(seed: int = 1) -> np.ndarray:
    """Return a rotation matrix."""
    matrix, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return matrix * np.linalg.det(matrix)


# --- the plane ---


@pytest.mark.parametrize(
    "changes", members([{}, {"law": "incremental"}, {"friction": 0.1}, {"viscosity": 1e5}, {"adhesion": "jkr"}], {})
)
def test_a_packing_in_the_plane_moves_in_space_as_there(changes) -> None:
    row, column = np.divmod(np.arange(24), 4)
    places = SPACING * np.stack([column + 0.25 + row % 2 / 2, (row + 0.25) * sqrt(3) / 2], axis=1)
    box = (4 * SPACING, 6 * SPACING * sqrt(3) / 2)
    plane = packing(places, cell=box, **changes)
    space = packing(np.pad(places, ((0, 0), (0, 1))), cell=(*box, np.inf), **changes)
    way, velocity, rotation, spin = disturbed(plane, 0.1 * OVERLAP)
    moving = (np.pad(way, ((0, 0), (0, 1))), np.pad(velocity, ((0, 0), (0, 1))))
    turning = (np.pad(each[:, None], ((0, 0), (2, 0))) for each in (rotation, spin))
    # Steps, not rtol, set these errors; halves of them change only those of sliding
    options = {"rtol": 1e-8, "longest_step": TIME / (40 if "friction" in changes else 20)}
    flat = integrate(plane, start(plane, way, velocity, rotation, spin), [TIME], **options).motion[0]
    deep = integrate(space, start(space, *moving, *turning), [TIME], **options).motion[0]
    size = np.abs(flat).max(axis=1, keepdims=True)
    # Errors of steps that differ, as more numbers are in their mean; those of sliding are of second order
    np.testing.assert_allclose(
        deep[[0, 1, 5, 6, 7, 11]] / size, flat / size, rtol=0, atol=1e-4 if "friction" in changes else 1e-8
    )
    assert not deep[[2, 3, 4, 8, 9, 10]].any()


# --- turned as a whole ---


def turned_as_a_whole(network: Network, turn: np.ndarray) -> Network:
    """Return a packing with its walls, turned by a matrix."""
    walls = tuple(
        each._replace(point=tuple(turn @ each.point), normal=tuple(turn @ each.normal)) for each in network.walls
    )
    return replace(network, position=network.position @ turn.T, walls=walls)


@pytest.mark.parametrize("law", ["secant", "incremental"])
def test_a_crystal_turned_as_a_whole_has_the_turned_motion(law) -> None:
    places, _ = sheet(3, 4)
    network, turn = packing(places, walls=(FLOOR,), law=law), any_turn()
    pushed = np.array([0.0, 40.0, 0.0])
    moving, ends = disturbed(network, 0.1 * OVERLAP), []
    for way in (np.eye(3), turn):
        pushes = tuple(
            Drive(np.array([3]), 3 + axis, lambda t, size=size: np.full_like(t, size), size=abs(size))
            for axis, size in enumerate(way @ pushed)
        )
        spheres = replace(turned_as_a_whole(network, way), drives=pushes)
        run = integrate(spheres, start(spheres, *(each @ way.T for each in moving)), [3 * TIME], rtol=1e-9)
        ends.append((run.motion[0].reshape(4, 3, -1).transpose(0, 2, 1) @ way).reshape(4, -1))
    size = np.abs(ends[0]).max(axis=1, keepdims=True)
    # The steps differ, and with them their errors; angles are small of first order in 1e-4
    np.testing.assert_allclose(ends[1] / size, ends[0] / size, rtol=0, atol=1e-6)


def test_forces_turn_with_a_packing_to_rounding() -> None:
    network, turn = cluster(friction=0.2), any_turn(2)
    other, moving = turned_as_a_whole(network, turn), disturbed(network, 0.4)
    plain = forces(network, start(network, *moving)).reshape(2, 3, -1)
    rotated = forces(other, start(other, *(each @ turn.T for each in moving))).reshape(2, 3, -1)
    # Overlaps are rounded to 1e-16 of 1e3, of an overlap of 1
    np.testing.assert_allclose(rotated, turn @ plain, rtol=0, atol=1e-11 * np.abs(plain[1]).max())


# --- the transport of a slip ---


def test_a_slip_carried_around_a_cone_turns_by_its_solid_angle() -> None:
    lean = np.array([0.05, 0.8])  # two contacts
    frame = frames(np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 1.0]]))
    steps = 250
    shear = np.array([[1.0, 1.0], [0.0, 0.0]])

    def normal(angle: float) -> np.ndarray:
        return np.array([np.sin(lean) * cos(angle), np.sin(lean) * sin(angle), np.cos(lean)])

    for angle in np.linspace(0, 2 * pi, 13):
        first, second = np.array(tangents(frame, normal(angle)).along)
        np.testing.assert_allclose(np.cross(first, second, axis=0), normal(angle), atol=1e-15)

    def rate(angle: float, shear: np.ndarray) -> np.ndarray:
        onward = np.sin(lean) * np.array([[-sin(angle)], [cos(angle)], [0.0]])
        here = tangents(frame, normal(angle))
        return np.array(turned(shear, [dot(each, onward) for each in here.along], here.lean))

    h = 2 * pi / steps
    for n in range(steps):  # the classical method of Runge and Kutta, of fourth order
        one = rate(n * h, shear)
        two = rate((n + 0.5) * h, shear + h / 2 * one)
        three = rate((n + 0.5) * h, shear + h / 2 * two)
        four = rate((n + 1) * h, shear + h * three)
        shear = shear + h / 6 * (one + 2 * two + 2 * three + four)
    solid = 2 * pi * (1 - np.cos(lean))
    np.testing.assert_allclose(shear, [np.cos(solid), np.sin(solid)], atol=1e-9)


def test_spheres_that_turn_about_their_line_leave_the_slip_where_it_was() -> None:
    network = packing([[0.0, 0, 0], [0, 0, SPACING]], held=np.ones(2, bool))
    line = np.array([0.1, 0, SPACING])
    state = start(network, [[0, 0, 0], [0.1, 0, 0]], 0.0, 0.0, 1e-2 * line / np.linalg.norm(line))
    spun = integrate(network, state, [100.0]).final
    now = present(network, spun)
    vector = np.array(combined(now.shear, now.tangents.along))[:, 0]
    assert vector[0] > 0
    assert abs(vector[1]) < 1e-9 * vector[0]


def test_contacts_keep_their_shear_in_space_when_pairs_are_searched_again() -> None:
    network = cluster()
    state = start(network, *disturbed(network, 0.4))
    leaning = state.pairs.frame[2].copy()
    # Numbers by first and second sphere, whichever order the search gives the pairs
    leaning[:, np.lexsort((state.pairs.second, state.pairs.first))] += np.random.default_rng(2).uniform(
        -0.2, 0.2, leaning.shape
    )
    leaning = frames(leaning / np.sqrt(dot(leaning, leaning)))
    other = replace(state, pairs=replace(state.pairs, frame=leaning))
    before, after = (present(network, each) for each in (other, searched_again(network, other)))
    vectors = [np.array(combined(each.spring, each.tangents.along)) for each in (before, after)]
    assert np.abs(np.subtract(before.spring, after.spring)).max() > 0.1 * np.abs(before.spring).max()
    np.testing.assert_allclose(vectors[1], vectors[0], rtol=0, atol=1e-12 * np.abs(vectors[0]).max())


# --- conservation ---


@pytest.mark.parametrize("law", members(["secant", "incremental"], "secant"))
def test_momentum_and_angular_momentum_are_conserved(law) -> None:
    network = cluster(law=law, walls=())
    state = start(network, *disturbed(network, 0.5))
    run = integrate(network, state, [1.5 * TIME], rtol=1e-8)  # a fifth of the contacts have opened then
    before, after = momentum(network, state), momentum(network, run.final)
    size = np.sum(network.mass * np.abs(state.motion[6]))
    np.testing.assert_allclose(after[:3], before[:3], rtol=0, atol=1e-12 * size)  # sums of pairs that cancel
    np.testing.assert_allclose(after[3:], before[3:], rtol=0, atol=1e-7 * size * RADIUS)


@pytest.mark.parametrize(
    ("law", "adhesion"), members([("secant", "dmt"), ("incremental", "dmt"), ("secant", "jkr")], ("secant", "dmt"))
)
def test_the_ledger_closes_with_the_work_of_the_shear_law_alone(law, adhesion) -> None:
    places, cell = sheet(4, 6)
    network = packing(places, cell=cell, walls=(FLOOR,), law=law, adhesion=adhesion)
    state = start(network, *disturbed(network, 0.05 * OVERLAP))
    run = integrate(network, state, np.linspace(0, 8, 9) * TIME, rtol=1e-10)
    moving = energy(network, run.final).kinetic
    assert np.max(np.abs(run.heat)) < 1e-7 * moving
    assert np.max(np.abs(run.energy - run.energy[0])) > 1e-4 * moving


# --- a sphere on a wall ---


def test_a_sphere_rocks_on_a_wall_as_the_closed_form_says_at_any_amplitude() -> None:
    # Rocking leaves the overlap as it is: slip is that of an oscillator, s'' = -(7/2)(K_S/m) s along both tangents
    network = packing([[0.0, 0.0, 0.0]], walls=(FLOOR,))
    _, B, _ = network.on_wall(FLOOR, np.array([0]))
    mass = float(network.mass[0])
    rate = sqrt(3.5 * B[0] * sqrt(SUNK) / mass)
    size = 3 * OVERLAP
    times = np.linspace(0, 10, 21)
    run = integrate(network, start(network, [[size, 0, 0]], [[0, size, 0]]), times, rtol=1e-11)
    # Of the slip 2/7 is the way of the centre, as the force 5/2 as much moves it by turning
    steady = np.stack([5 / 7 * size + 0 * times, 5 / 7 * size * times])
    swing = 2 / 7 * size * np.stack([np.cos(rate * times), np.sin(rate * times) / rate])
    np.testing.assert_allclose(run.motion[:, :2, 0].T, steady + swing, rtol=0, atol=1e-8 * size)
    assert np.abs(run.motion[:, 2, 0]).max() < 1e-8 * size


def test_a_sphere_on_a_wall_swings_up_and_down_at_the_root_of_its_stiffness() -> None:
    network = packing([[0.0, 0.0, 0.0]], walls=(FLOOR._replace(factors=(2.0, 1.0)),))
    A, _, _ = network.on_wall(network.walls[0], np.array([0]))
    rate = sqrt(1.5 * A[0] * sqrt(SUNK) / network.mass[0])
    errors, sizes = [], OVERLAP * np.array([0.04, 0.02, 0.01])
    for size in sizes:
        run = integrate(network, start(network, [[0, 0, size]], 0.0), [2 * pi / rate], rtol=1e-12)
        errors.append(abs(float(run.motion[0, 2, 0]) - size))
    # After one period of the linear motion the second order is back at 0; the third has changed the frequency by a²,
    # and a crest of a leaves the square of that
    assert slope(sizes, np.array(errors)) == pytest.approx(5, abs=0.1)
    assert abs(forces(network, start(network, 0.0, 0.0))).max() < 1e-9 * A[0] * SUNK**1.5


# --- modes ---


def fcc(cells: tuple[int, int, int]) -> tuple[np.ndarray, tuple[float, ...]]:
    """Return places and periods of cubes of fcc with nearest neighbours at the distance at rest."""
    edge = SPACING * sqrt(2)
    basis = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]]) + 0.1
    shifts = np.stack(np.meshgrid(*(np.arange(n) for n in cells), indexing="ij"), axis=-1).reshape(-1, 1, 3)
    return edge * (shifts + basis).reshape(-1, 3), tuple(edge * n for n in cells)


def sheet(columns: int, rows: int) -> tuple[np.ndarray, tuple[float, ...]]:
    """Return places and periods of a hexagonal layer, z = 0."""
    row, column = np.divmod(np.arange(rows * columns), columns)
    x, y = column + 0.25 + row % 2 / 2, (row + 0.25) * sqrt(3) / 2
    return SPACING * np.stack([x, y, 0 * x], axis=1), (columns * SPACING, rows * SPACING * sqrt(3) / 2, np.inf)


def of_case(case: str) -> tuple[Network, Crystal, np.ndarray]:
    """Return a network, its crystal, and a wave vector of its cell."""
    if case == "fcc":
        places, cell = fcc((2, 4, 2))
        ways = SPACING / sqrt(2) * np.array([[0, 1, 1], [1, 0, 1], [1, 1, 0]])
        crystal = Crystal.of(ways, [[0, 0, 0]], RADIUS, DENSITY, [SILICA])
        return packing(places, cell=cell), crystal, 2 * pi * np.array([1 / cell[0], 1 / cell[1], 0])
    places, cell = sheet(4, 8)
    ways = SPACING * np.array([[1, 0, 0], [0.5, sqrt(3) / 2, 0]])
    plane = Plane((0.0, 0.0, SUNK - RADIUS), (0.0, 0.0, -1.0), SILICA)
    crystal = Crystal.of(ways, [[0, 0, 0]], RADIUS, DENSITY, [SILICA], walls=[plane])
    k = 2 * pi * np.array([1 / cell[0], 1 / cell[1] if case == "oblique" else 0, 0])
    return packing(places, cell=cell, walls=(FLOOR,)), crystal, k


LEFT = [("fcc", 0), ("fcc", 5), ("layer", 1), ("layer", 4), ("oblique", 2)]
MORE = [each for each in product(["fcc", "layer", "oblique"], range(6)) if each not in LEFT]


@pytest.mark.parametrize(("case", "branch"), members(product(["fcc", "layer", "oblique"], range(6)), *MORE))
def test_a_small_wave_is_a_mode_of_the_crystal(case, branch) -> None:
    network, crystal, k = of_case(case)
    modes = crystal.modes(k)
    shape, frequency = modes.shapes[branch, 0], modes.frequencies[branch]
    wave = shape * np.exp(1j * network.position @ k)[:, None]
    times, sizes, errors = np.linspace(0, 6, 7) * TIME, np.array([0.02, 0.01]), []
    for size in sizes:
        field, rate = size * OVERLAP * wave.real, size * OVERLAP * (-1j * frequency * wave).real
        begun = start(network, field[:, :3], rate[:, :3], field[:, 3:] / RADIUS, rate[:, 3:] / RADIUS)
        run = integrate(network, begun, times, rtol=1e-8)
        moved = run.motion[:, :6] * np.repeat([1.0, RADIUS], 3)[:, None]
        linear = np.real(wave.T * np.exp(-1j * frequency * times)[:, None, None]) * size * OVERLAP
        errors.append(np.linalg.norm(moved - linear))
    assert errors[0] < 0.03 * np.linalg.norm(sizes[0] * OVERLAP * wave) * sqrt(len(times))
    assert slope(sizes, np.array(errors)) == pytest.approx(2, abs=0.1)
