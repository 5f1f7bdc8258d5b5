"""Guards look as rarely as a bound on the motion allows, and the bound holds in the linear lattice."""

import re
from itertools import product
from math import pi
from pathlib import Path

import numpy as np
import pytest

from granular_lmp import Scene, build, run
from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.lammps.cone import MARGIN
from granular_lmp.lammps.deck import deck_of
from granular_lmp.lammps.guards import NEXT, look_interval
from granular_lmp.lammps.outputs import LOG, read_log
from granular_lmp.lammps.pace import GROWTH
from granular_lmp.problem import prepare

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


ROWS = {"chain": 1.0, "square": 1.0, "hexagonal": HALF, "fcc": LEG}  # between two rows, in diameters


def spread(lattice: str, ratio: float, time: float, beyond: float = -1.0) -> float:
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
    root = np.sqrt([1, 1, 1, *[INERTIA_RATIO] * 3])
    squared, shapes = np.linalg.eigh(matrix / np.outer(root, root))
    rate = np.sqrt(np.maximum(squared, 1e-12))
    worst = []
    for response, alone in ((np.sin(rate * time) / rate, time), ((1 - np.cos(rate * time)) / rate**2, time**2 / 2)):
        waves = (shapes * response[:, None, :]) @ np.conj(shapes.transpose(0, 2, 1)) * root / root[:, None]
        parts = np.fft.ifftn(waves.reshape(*cells, 6, 6), axes=(0, 1, 2)).real.reshape(-1, 2, 3, 2, 3)
        size = np.linalg.norm(parts.transpose(0, 1, 3, 2, 4), 2, axis=(3, 4))[far].sum(axis=0)
        worst.append(size.sum(axis=0).max() / alone)
    return float(max(worst))


@pytest.mark.parametrize("ratio", [0.67, 0.91, 1.0])
@pytest.mark.parametrize("lattice", LATTICES)
def test_no_sphere_moves_farther_than_the_bound_in_a_quarter_of_a_period(lattice: str, ratio: float) -> None:
    spreads = [spread(lattice, ratio, time) for time in (0.2, 0.8, pi / 2)]
    assert spreads == sorted(spreads)
    assert spreads[0] == pytest.approx(1, abs=0.06)
    assert spreads[-1] < GROWTH


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
            {"packing.rows": 17, "time.allow_echo": True, "disorder.radius": 0.004}
        )
    )
    contacts, number = problem.contacts, problem.units.number
    (line,) = (each for each in deck_of(problem).input_text.splitlines() if each.startswith("variable     gain equal"))
    found = float(re.findall(r"\+([\d.e+-]+)\*sqrt", line)[0])
    largest = 1 / (INERTIA_RATIO * contacts.mass * contacts.radius)
    assert contacts.radius.min() < 0.995 * contacts.radius.max()
    np.testing.assert_allclose(found, number(float(largest.max()), mass=-1, length=-1), rtol=1e-12)  # ten roundings
