"""Impacts on chains whose collisions lose energy: LAMMPS's ``coeff_restitution`` beside the same dashpots without it.

analysis/cases/impact/README.md shows the numbers.
"""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import beta

from cases.impact.chain_damping import decay
from cases.solitary.chain import End, energies, spheres, uniform
from cases.solitary.chain_motion import integrate, march, peak
from granular_analysis.theory.integrator import dop853
from granular_analysis.tools.compare import compare
from granular_lmp import ImpactRecord, ImpactScene, run_impact
from granular_lmp.errors import SceneError
from granular_lmp.problem import prepare
from granular_lmp.scene.collision import Collision
from granular_lmp.studies.collide import run as collide
from tests.conftest import members
from tests.validation.test_pull_off import with_deck

CHAIN = ImpactScene.load("solitary_chain").with_values({"packing.last": "free"})
PAGE = Path(__file__).parents[2] / "analysis" / "cases" / "impact" / "README.md"
RESTITUTIONS = (0.9, 0.7, 0.5)
Runs = Callable[[dict[str, Any]], ImpactRecord]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """Records of a chain of 20 with values changed, each run once."""

    @cache
    def make(changes: tuple[tuple[str, Any], ...]) -> ImpactRecord:
        return run_impact(CHAIN.with_values(dict(changes)), tmp_path_factory.mktemp("impact") / "run")

    return lambda changes: make(tuple(({"packing.rows": 20, "time.sample": 0.5} | changes).items()))


def velocities(run: Runs, restitution: float, step: float, duration: float = 24.0) -> np.ndarray:
    changes = {"effects.restitution": restitution, "time.timestep": step, "time.sample": duration}
    return run(changes | {"time.duration": duration}).velocity[-1, :, 1]


# --- the law ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", members(RESTITUTIONS, 0.7))
def test_a_lossy_chain_moves_as_the_same_dashpots_without_lammps(restitution: float, run: Runs) -> None:
    chain, v = replace(uniform(20), restitution=restitution), np.eye(20)[0]
    _, (stepped,) = march(chain, 0 * v, v, 0.05, 480)
    found = velocities(run, restitution, 0.05)
    # Rounding of positions, 20 1e-16 R over ℓ = 2.5e-3 R, in 480 steps at random, tenfold
    assert np.max(np.abs(found - stepped)) < 2e-10
    _, (other,) = march(replace(chain, restitution=restitution - 1e-6), 0 * v, v, 0.05, 480)
    assert np.max(np.abs(found - other)) > 1e-8


@pytest.mark.parametrize("last", ["held", "wall"])
def test_a_lossy_chain_of_unequal_spheres_meets_its_end(last: End, tmp_path: Path) -> None:
    radii = {"inclusion": [{"rows": [2, 3], "radius": 3e-3}, {"rows": [4, 4], "radius": 7e-3, "density": 2700.0}]}
    values = {"packing.rows": 6, "packing.last": last, "effects.restitution": 0.7}
    times = {"time.timestep": 0.01, "time.duration": 12.0, "time.sample": 12.0}
    scene = ImpactScene.from_dict(CHAIN.with_values(values | times).to_dict() | radii)
    sphere, scale = scene.sphere, scene.scale
    radius, density = np.full(6, sphere.radius), np.full(6, sphere.density)
    radius[[2, 3]], radius[4], density[4] = 3e-3, 7e-3, 2700.0
    chain = spheres(radius, density, sphere.youngs_modulus, sphere.poisson_ratio, ends=("free", last))
    v = np.eye(6)[0] * scale.velocity
    _, (stepped,) = march(replace(chain, restitution=0.7), 0 * v, v, 0.01 * scale.time, 1200)
    found = run_impact(scene, tmp_path / "run").velocity[-1, :, 1]
    # As above; the smallest sphere is five times as light
    assert np.max(np.abs(found - stepped / scale.velocity)) < 1e-9


@pytest.mark.parametrize("restitution", members(RESTITUTIONS, 0.7, 0.9))
def test_the_step_is_of_first_order_and_its_extrapolation_of_a_higher(restitution: float, run: Runs) -> None:
    chain, v = replace(uniform(20), restitution=restitution), np.eye(20)[0]
    _, (exact,) = integrate(chain, 0 * v, v, [24.0], 1e-10)
    steps = np.array([0.1, 0.05, 0.025])
    found = [velocities(run, restitution, step) for step in steps]
    errors = [np.sqrt(np.mean((each - exact) ** 2)) for each in found]
    # 1, and 0.2 of the second order at the longest step
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(1.05, abs=0.15)
    better = 2 * found[2] - found[1]
    assert np.sqrt(np.mean((better - exact) ** 2)) < errors[2] / 3


def test_two_spheres_are_newtons_cradle(run: Runs) -> None:
    for restitution in RESTITUTIONS:
        changes = {"packing.rows": 2, "time.duration": 8.0, "time.sample": 8.0, "effects.restitution": restitution}
        found = run(changes | {"time.timestep": 0.005}).velocity[-1, :, 1]
        # Of first order in the step, 0.005/2.4 of a collision, in what is lost
        assert found == pytest.approx([(1 - restitution) / 2, (1 + restitution) / 2], abs=2e-3 * (1 - restitution**2))


def sheet_velocities(places: np.ndarray, struck: int, restitution: float, length: float, end: float) -> np.ndarray:
    """Return the velocities (n, 2) of equal spheres at places in radii, ℓ = length radii, written out and by DOP853."""
    i, j = np.triu_indices(len(places), 1)
    touching = np.linalg.norm(places[j] - places[i], axis=1) < 2 + 1e-9
    i, j = i[touching], j[touching]
    loss = -np.log(restitution)
    eta = np.sqrt(5 / 2) * loss / np.hypot(np.pi, loss)  # A = m = 1, μ = 1/2

    def derivative(y: np.ndarray) -> np.ndarray:
        apart = places[j] - places[i] + length * (y[0][j] - y[0][i])
        distance = np.linalg.norm(apart, axis=1)
        normal = apart / distance[:, None]
        overlap = np.maximum((2 - distance) / length, 0.0)
        closing = -np.sum((y[1][j] - y[1][i]) * normal, axis=1)
        push = (overlap**1.5 + eta * overlap**0.25 * closing)[:, None] * normal
        pull = np.zeros_like(places)
        np.add.at(pull, j, push)
        np.add.at(pull, i, -push)
        return np.stack([y[1], pull])

    start = np.zeros((2, *places.shape))
    start[1, struck, 1] = 1.0
    return dop853(derivative, start, np.array([end]), 1e-7, 1e-7, np.inf)[0, 1]


def test_a_hexagonal_sheet_loses_what_the_same_dashpots_take(tmp_path: Path) -> None:
    still = ImpactScene.load("point_impact").with_values(
        {"packing.rows": 5, "packing.columns": 5, "striker.1.spheres": [[0, 2]], "effects.restitution": 0.7}
        | {"time.duration": 6.0, "time.sample": 6.0}
    )
    coarse, fine = (
        run_impact(still.with_values({"time.timestep": step}), tmp_path / str(step)) for step in (0.02, 0.01)
    )
    length, struck = fine.scale.length / fine.scene.sphere.radius, int(fine.problem.strikers[0][0])
    exact = sheet_velocities(fine.rest, struck, 0.7, length, 6.0)
    found = 2 * fine.velocity[-1] - coarse.velocity[-1]
    # Of first order; extrapolated, contacts that close and open leave a tenth of it
    assert np.max(np.abs(fine.velocity[-1] - exact)) < 2e-3
    assert np.max(np.abs(found - exact)) < 3e-4
    other = sheet_velocities(fine.rest, struck, 0.71, length, 6.0)
    assert np.max(np.abs(found - other)) > 1e-3


# --- energy -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", members(RESTITUTIONS, 0.7, 0.9))
def test_the_energy_of_a_record_falls_as_without_lammps(restitution: float, run: Runs) -> None:
    record = run({"effects.restitution": restitution, "time.timestep": 0.025, "time.duration": 24.0})
    chain, v = replace(uniform(20), restitution=restitution), np.eye(20)[0]
    us, vs = march(chain, 0 * v, v, 0.025, 960, every=20)
    energy = record.energy()
    assert energy[1:] == pytest.approx(energies(chain, us, vs).sum(axis=1), abs=1e-9)  # rounding, as above
    assert np.all(np.diff(energy) < 0)
    assert record.velocity[..., 1].sum(axis=1) == pytest.approx(1, abs=1e-10)  # dashpots keep momentum


# --- the pull ---------------------------------------------------------------------------------------------------------


def test_a_damped_contact_pulls_before_it_ends(tmp_path: Path) -> None:
    """LAMMPS does not cut the pull off unless told to, and without it more than the restitution comes back."""
    lossy = Collision.load("test2").with_values({"contact.restitution": 0.5, "collision.steps": 20_000})
    result = collide(lossy, tmp_path / "run")
    assert result.restitution == pytest.approx(0.5, abs=2e-5)  # its error is of first order in the step
    assert -0.2 < result.normal_force.min() / result.largest_force < -0.05
    limited = with_deck(
        lossy, tmp_path / "limited", ("damping coeff_restitution", "damping coeff_restitution limit_damping")
    )
    assert limited.normal_force.min() == 0
    assert limited.restitution == pytest.approx(0.550, abs=1e-3)  # measured; the digits of the page


# --- the page ---------------------------------------------------------------------------------------------------------


def crests(record: ImpactRecord, rows: tuple[int, ...]) -> list[float]:
    """Return the height of the first crest of the velocity of each row."""
    heights = []
    for row in rows:
        v = record.velocity[:, row, 1]
        top = 1 + int(np.argmax((v[1:-1] > v[:-2]) & (v[1:-1] >= v[2:]) & (v[1:-1] > 1e-3)))
        near = slice(top - 4, top + 5)
        heights.append(peak(record.tau[near], v[near])[0])
    return heights


def line(run: Runs, restitution: float) -> str:
    """A line of the page: e; Γ from sphere 10 to 20 and 30 to 40, first order, two by two; energy left."""
    long = {"packing.rows": 48, "time.duration": 90.0, "time.sample": 0.25}
    found = []
    for step in (0.05, 0.025):
        record = run(long | {"effects.restitution": restitution, "time.timestep": step})
        early, late = -np.diff(np.log(crests(record, (10, 20, 30, 40))))[[0, 2]] / 10
        found.append([early, late, 2 * record.energy()[-1]])
    early, late, left = 2 * np.array(found[1]) - np.array(found[0])
    alone = -np.log((1 + restitution) / 2)
    return f"| {restitution} | {early:.4f} | {late:.4f} | {decay(restitution):.4f} | {alone:.4f} | {left:.3f} |"


SHOWN = [line for line in PAGE.read_text("utf-8").splitlines() if re.match(r"\| 0\.\d+ \| 0\.\d{4} \|", line)]
ROWS = (0.99, 0.95, 0.9, 0.8, 0.7, 0.5)


def test_the_table_of_damping_has_these_lines() -> None:
    assert [float(each.split()[1]) for each in SHOWN] == [*ROWS]


@pytest.mark.parametrize("restitution", members(ROWS, *ROWS[:-1]))
def test_the_table_of_damping_is_measured(restitution: float, run: Runs) -> None:
    assert SHOWN[ROWS.index(restitution)] == line(run, restitution)


# --- linear dashpots --------------------------------------------------------------------------------------------------


def dashpot(scene: ImpactScene, share: float) -> dict[str, float]:
    """Return a dashpot of this many m/t0."""
    return {"effects.viscosity": share * scene.scale.mass / scene.scale.time}


def test_a_weak_dashpot_takes_of_a_hertz_collision_what_its_closed_form_says(run: Runs) -> None:
    # η∫δ'²dt = η v δm ∮√(1 − x^{5/2}) dx of the energy m v²/4, with δm = (5m v²/8A)^{2/5}; 1 − e is half of that share
    whole = 2 * beta(2 / 5, 3 / 2) * 2 / 5
    expected = 2 * (5 / 8) ** (2 / 5) * whole
    pair = {"packing.rows": 2, "time.duration": 8.0, "time.sample": 8.0, "time.timestep": 0.005}
    lost = []
    for share in (0.01, 0.02):
        one, other = run(pair | dashpot(CHAIN, share)).velocity[-1, :, 1]
        lost.append((1 - (other - one)) / share)
    # The next order in η, and a step of 0.005/2.4 of a collision in first order
    assert 2 * lost[0] - lost[1] == pytest.approx(expected, rel=2e-3)
    assert lost[0] > lost[1] > 0.97 * expected


STRUCK: dict[str, dict[str, Any]] = {
    "solitary_chain": {"packing.rows": 8, "packing.last": "wall", "time.duration": 12.0},
    "point_impact": {"packing.rows": 5, "packing.columns": 5, "striker.1.spheres": [[0, 2]], "effects.friction": 0.3},
    "compressed_chain": {"packing.rows": 12},
    "dimer_chain": {"packing.rows": 9, "inclusion.1.rows": [1, 8]},
}


@pytest.mark.parametrize("name", STRUCK)
def test_spheres_with_linear_dashpots_move_as_their_network(name: str, tmp_path: Path) -> None:
    scene = ImpactScene.load(name).with_values({"time.duration": 6.0, "time.sample": 1.0} | STRUCK[name])
    scene, errors = scene.with_values(dashpot(scene, 0.1)), []
    for step in (0.02, 0.01):
        record = run_impact(scene.with_values({"time.timestep": step}), tmp_path / f"{step}")
        found = compare(record, "network")
        errors.append(found.error["velocity"])
    # Of first order: LAMMPS takes the dashpots at the velocities of half a step before
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.15)
    assert errors[1] < 3e-3
    free = run_impact(scene.with_values({"effects.viscosity": 0.0}), tmp_path / "free")
    assert np.abs(free.velocity - record.velocity).max() > 0.02


def test_a_dashpot_is_run_to_a_tolerance(tmp_path: Path) -> None:
    values = {"packing.rows": 4, "time.duration": 8.0, "time.sample": 1.0, "time.tolerance": 1e-3}
    record = run_impact(CHAIN.with_values(values | dashpot(CHAIN, 0.2)), tmp_path / "run")
    error = compare(record, "network").error["velocity"]
    assert error is not None
    assert error < 1e-3


def test_a_dashpot_that_stops_a_sphere_within_a_step_names_the_step_that_runs() -> None:
    strong = CHAIN.with_values({"packing.rows": 4} | dashpot(CHAIN, 20.0))
    with pytest.raises(SceneError, match=r"effects\.viscosity stops a sphere; must be at most (\S+)$") as refused:
        prepare(strong)
    step = float(str(refused.value).rpartition(" ")[2])
    prepare(strong.with_values({"time.timestep": 0.99 * step}))


def test_a_contact_has_one_dashpot() -> None:
    with pytest.raises(SceneError, match="two models of damping; must be one"):
        CHAIN.with_values({"effects.viscosity": 1.0, "effects.restitution": 0.9})
