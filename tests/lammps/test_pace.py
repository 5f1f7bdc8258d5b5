"""Guards look as rarely as a bound on the motion allows, and the bound holds in the linear lattice."""

import re
from itertools import product
from math import pi
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from granular_lmp import Scene, build, run
from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.lammps.cone import MARGIN
from granular_lmp.lammps.deck import deck_of
from granular_lmp.lammps.guards import NEXT, look_interval
from granular_lmp.lammps.outputs import LOG, read_log
from granular_lmp.lammps.pace import GROWTH
from granular_lmp.problem import Problem, prepare
from granular_lmp.scene.at_rest import swiftness
from tests.conftest import members

Floats = NDArray[np.float64]

HALF, LEG = 3**0.5 / 2, 0.5**0.5
LATTICES = {  # (cell, bond) of each contact, and how many cells stand for an endless crystal
    "chain": ([((1, 0, 0), (0.0, 1.0, 0.0))], (32, 1, 1)),
    "square": ([((1, 0, 0), (1.0, 0.0, 0.0)), ((0, 1, 0), (0.0, 1.0, 0.0))], (16, 16, 1)),
    "hexagonal": (
        [((1, 0, 0), (1.0, 0.0, 0.0)), ((0, 1, 0), (0.5, HALF, 0.0)), ((-1, 1, 0), (-0.5, HALF, 0.0))],
        (16, 16, 1),
    ),
    "fcc": (
        [
            ((1, 0, 0), (0.0, LEG, LEG)),
            ((0, 1, 0), (LEG, 0.0, LEG)),
            ((0, 0, 1), (LEG, LEG, 0.0)),
            ((1, -1, 0), (-LEG, LEG, 0.0)),
            ((1, 0, -1), (-LEG, 0.0, LEG)),
            ((0, 1, -1), (0.0, -LEG, LEG)),
        ],
        (10, 10, 10),
    ),
}


FLAT = ("chain", "square", "hexagonal")  # lattices that lie in a plane
IMPERFECT = {  # shipped scene, and the size of its crystal
    "chain": ("l_chain", {"packing.rows": 31}),
    "square": ("tr_square", {"packing.rows": 12, "packing.columns": 12}),
    "hexagonal": ("tr_periodic", {"packing.rows": 12, "packing.columns": 12}),
    "fcc": ("fcc_transverse", {"packing.rows": 8, "packing.columns": 3, "packing.layers": 3}),
    "hcp": ("hcp_c_axis", {"packing.rows": 6, "packing.columns": 4, "packing.layers": 4}),
    "layer": ("monolayer_vertical", {"packing.rows": 8, "packing.columns": 8, "wave.wavenumber": pi / 4}),
    "film": ("multilayer", {"packing.rows": 6, "packing.columns": 4, "wave.wavenumber": pi / 3}),
}
UNEQUAL = ("hexagonal", "fcc", "layer")  # kinds that may hold spheres of several radii and materials
ROWS = {"chain": 1.0, "square": 1.0, "hexagonal": HALF, "fcc": LEG}  # between two rows, in diameters


PLANE = (0, 1, 5)  # the freedoms of a sphere that stays in the plane


def spread(lattice: str, ratio: float, time: float, beyond: float = -1.0, space: int = 3) -> float:
    """Return by how much displacements and turns of all spheres exceed v t and a t²/2, over these, at most.

    With `beyond` only the spheres count that are farther, in diameters, from the one that is pushed.
    """
    bonds, cells = LATTICES[lattice]
    edges = np.array([dict(bonds).get(edge, (0, 0, 0)) for edge in ((1, 0, 0), (0, 1, 0), (0, 0, 1))])
    places = np.array(list(product(*(np.fft.fftfreq(many, 1 / many) for many in cells)))) @ edges
    far = np.linalg.norm(places, axis=1) > beyond
    phases = 2 * pi * np.array(list(product(*map(range, cells)))) / cells
    normal = 1 / (2 * (ratio + 3))  # t0² = m/(2(g1 + 3 k1))
    matrix = np.zeros((len(phases), 6, 6), dtype=complex)
    for cell, bond in bonds:
        turn = np.exp(1j * phases @ np.array(cell))[:, None, None]
        along = np.outer(bond, bond)
        arm = -np.cross(np.eye(3), bond).T  # φ × n
        stretch = np.concatenate([(turn - 1) * along, 0 * turn * along], axis=2)
        slip = np.concatenate([(turn - 1) * (np.eye(3) - along), (turn + 1) * arm], axis=2)
        for stiffness, rows in ((normal, stretch), (ratio * normal, slip)):
            matrix += stiffness * np.conj(rows.transpose(0, 2, 1)) @ rows
    if space == 2:
        held = np.setdiff1d(range(6), PLANE)
        matrix[:, held, :] = matrix[:, :, held] = 0
    root = np.sqrt([1, 1, 1, *[INERTIA_RATIO] * 3])
    squared, shapes = np.linalg.eigh(matrix / np.outer(root, root))
    rate = np.sqrt(np.maximum(squared, 1e-12))
    worst = []
    for response, alone in ((np.sin(rate * time) / rate, time), ((1 - np.cos(rate * time)) / rate**2, time**2 / 2)):
        waves = (shapes * response[:, None, :]) @ np.conj(shapes.transpose(0, 2, 1)) * root / root[:, None]
        if space == 2:
            waves[:, held, :] = waves[:, :, held] = 0
        parts = np.fft.ifftn(waves.reshape(*cells, 6, 6), axes=(0, 1, 2)).real.reshape(-1, 2, 3, 2, 3)
        size = np.linalg.norm(parts.transpose(0, 1, 3, 2, 4), 2, axis=(3, 4))[far].sum(axis=0)
        worst.append(size.sum(axis=0).max() / alone)
    return float(max(worst))


@pytest.mark.parametrize("ratio", [0.67, 0.91, 1.0])
@pytest.mark.parametrize(("lattice", "space"), [*((each, 3) for each in LATTICES), *((each, 2) for each in FLAT)])
def test_no_sphere_moves_farther_than_the_bound_in_a_quarter_of_a_period(
    lattice: str, space: int, ratio: float
) -> None:
    spreads = [spread(lattice, ratio, time, space=space) for time in (0.2, 0.8, pi / 2)]
    assert spreads == sorted(spreads)
    assert spreads[0] == pytest.approx(1, abs=0.06)
    assert spreads[-1] < GROWTH[space]


def stiffness_matrix(problem: Problem) -> Floats:
    """Return the matrix (N, 6, N, 6) of the forces and torques over R of the contacts of a crystal at rest, N/m."""
    contacts = problem.contacts
    matrix = np.zeros((len(contacts.mass), 6) * 2)
    for i, j, normal, *stiffnesses in zip(
        contacts.i, contacts.j, contacts.normals, contacts.normal_stiffness, contacts.shear_stiffness, strict=True
    ):
        along, none = np.outer(normal, normal), np.zeros((3, 3))
        arm = -np.cross(np.eye(3), normal).T  # φ × n, of either sphere
        both = ((along, none), (np.eye(3) - along, arm))
        for stiffness, (shift, turn) in zip(stiffnesses, both, strict=True):
            rows = {i: np.hstack([-shift, turn]), **({j: np.hstack([shift, turn])} if j >= 0 else {})}
            for one, other in product(rows, rows):
                matrix[one, :, other, :] += stiffness * rows[one].T @ rows[other]
    return matrix


def growth(scene: Scene, time: float) -> float:
    """Return the same as `spread` of a crystal as it is, at `time` over the `swiftness` of the scene, in t0."""
    problem = prepare(scene)
    freedoms = np.array(PLANE if scene.space == 2 else range(6))
    inertia = np.where(freedoms < 3, 1.0, INERTIA_RATIO)
    root = np.sqrt(problem.contacts.mass[:, None] * inertia).ravel()
    matrix = stiffness_matrix(problem)[:, freedoms][:, :, :, freedoms].reshape(len(root), len(root))
    squared, shapes = np.linalg.eigh(matrix / np.outer(root, root))
    angle = np.sqrt(np.maximum(squared, 1e-12)) * scene.sphere.time_scale * time / swiftness(scene)
    shares, worst = np.split(np.arange(len(freedoms)), [scene.space]), 0.0
    angle = np.maximum(angle, 1e-6)
    for response in (np.sin(angle) / angle, 2 * (1 - np.cos(angle)) / angle**2):
        moved = (shapes * response) @ shapes.T * root / root[:, None]
        parts = moved.reshape((len(problem.contacts.mass), len(freedoms)) * 2).transpose(0, 2, 1, 3)
        for pushed in shares:
            sizes = (np.linalg.norm(parts[:, :, kind][..., pushed], 2, axis=(2, 3)).sum(axis=1) for kind in shares)
            worst = max(worst, float(sum(sizes).max()))
    return worst


def imperfect(kind: str, seed: int) -> Scene:
    """Return a crystal of random masses, radii, moduli, materials and vacancies."""
    rng = np.random.default_rng([29, list(IMPERFECT).index(kind), seed])
    values = {
        "packing.ends": "periodic",
        "time.allow_echo": True,
        "disorder.density": float(rng.uniform(0.001, 0.25)),
        "disorder.seed": int(rng.integers(1, 10**6)),
        "sphere.poisson_ratio": float(rng.uniform(0, 0.45)),
    }
    if kind in UNEQUAL:
        values["disorder.radius"] = float(rng.uniform(0, 1e-4))
        if rng.uniform() < 0.4:
            steel = {"youngs_modulus": 210e9, "poisson_ratio": 0.3, "density": 7850.0}
            values["inclusion"] = [{"share": float(rng.uniform(0.03, 0.3))} | steel]
    if kind == "hexagonal":
        values["disorder.vacancies"] = float(rng.uniform(0.01, 0.1))
    name, own = IMPERFECT[kind]
    return Scene.load(name).with_values(values | own)


@pytest.mark.parametrize("kind", members(IMPERFECT, "square", "hcp", "layer"))
def test_nor_in_a_crystal_that_is_not_perfect(kind: str) -> None:
    scene = imperfect(kind, 0)
    assert 1 < growth(scene, pi / 2) < GROWTH[scene.space]


@pytest.mark.more
@pytest.mark.parametrize("kind", IMPERFECT)
def test_nor_in_many_crystals_that_are_not_perfect(kind: str) -> None:
    scenes = [imperfect(kind, seed) for seed in range(1, 31 if kind in FLAT else 11)]
    assert max(growth(scene, pi / 2) for scene in scenes) < GROWTH[scenes[0].space]


@pytest.mark.parametrize("lattice", LATTICES)
def test_spheres_beyond_the_margin_of_the_cone_move_none_in_it_before_the_next_look(lattice: str) -> None:
    beyond = (MARGIN - 1e-9) * ROWS[lattice]
    assert spread(lattice, 0.91, pi / 2, beyond) < 0.01
    assert spread(lattice, 0.91, pi / 2, beyond - 2 * ROWS[lattice]) > spread(lattice, 0.91, pi / 2, beyond)


def test_walls_that_no_record_feels_make_looks_no_more_frequent(tmp_path: Path) -> None:
    def looks(name: str, changes: dict[str, object]) -> int:
        values = {"wave.amplitude": 0.2, "time.duration": 60.0, "time.timestep": 0.05} | changes
        run(Scene.load("tr_periodic").with_values(values), tmp_path / name)
        return len(np.unique(read_log(tmp_path / name / LOG).table["Step"]))

    walled = looks("walled", {"packing.ends": "fixed", "packing.rows": "auto"})
    assert walled < 1.2 * looks("periodic", {})


@pytest.mark.parametrize(
    "changes",
    [{"wave.amplitude": 0.2}, {"wave.amplitude": 0.2, "wave.mode": "L"}, {"wave.amplitude": 0.05, "wave.mode": "RT"}],
)
def test_looks_are_rare_where_contacts_are_far_from_opening(changes: dict[str, object], tmp_path: Path) -> None:
    scene = Scene.load("tr_periodic").with_values({"time.duration": 30.0, "time.timestep": 0.05} | changes)
    shortest = look_interval(build(scene).problem)
    run(scene, tmp_path / "run")
    table = read_log(tmp_path / "run" / LOG).table
    steps = np.unique(table["Step"])
    assert np.diff(steps).mean() > 3 * shortest
    assert (np.diff(steps) % shortest == 0).all()
    # Each look is at the step that the one before has named, or a line of the table is before it
    due = {int(step): int(following) for step, following in zip(table["Step"], table[NEXT], strict=True)}
    assert all(later <= due[int(step)] for step, later in zip(steps[:-1], steps[1:], strict=True))


def test_a_torque_turns_the_smallest_sphere_fastest() -> None:
    problem = prepare(
        Scene.load("tr_nonresonant").with_values(
            {"packing.rows": 9, "time.allow_echo": True, "disorder.radius": 0.0015}
        )
    )
    contacts, number = problem.contacts, problem.units.number
    (line,) = (each for each in deck_of(problem).input_text.splitlines() if each.startswith("variable     gain equal"))
    found = float(re.findall(r"\+([\d.e+-]+)\*sqrt", line)[0])
    largest = 1 / (INERTIA_RATIO * contacts.mass * contacts.radius)
    assert contacts.radius.min() < 0.995 * contacts.radius.max()
    np.testing.assert_allclose(found, number(float(largest.max()), mass=-1, length=-1), rtol=1e-12)  # ten roundings
