"""Impacts on chains whose collisions lose energy: LAMMPS's ``coeff_restitution`` beside the same dashpots without it.

analysis/cases/solitary/README.md shows the numbers.
"""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import beta

from cases.solitary.chain_motion import peak
from cases.solitary.damping import decay
from granular_analysis.tools.compare import compare
from granular_lmp import ImpactRecord, ImpactScene, run_impact
from granular_lmp.errors import SceneError
from granular_lmp.problem import prepare
from granular_lmp.scene.collision import Collision
from granular_lmp.studies.collide import run as collide
from tests.conftest import members
from tests.validation.test_pull_off import with_deck

CHAIN = ImpactScene.load("solitary_chain").with_values({"packing.last": "free"})
PAGE = Path(__file__).parents[2] / "analysis" / "cases" / "solitary" / "README.md"
RESTITUTIONS = (0.9, 0.7, 0.5)
Runs = Callable[[dict[str, Any]], ImpactRecord]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Runs:
    """Records of a chain of 20 with values changed, each run once."""

    @cache
    def make(changes: tuple[tuple[str, Any], ...]) -> ImpactRecord:
        return run_impact(CHAIN.with_values(dict(changes)), tmp_path_factory.mktemp("impact") / "run")

    return lambda changes: make(tuple(({"packing.rows": 20, "time.sample": 0.5} | changes).items()))


def test_two_spheres_are_newtons_cradle(run: Runs) -> None:
    for restitution in RESTITUTIONS:
        changes = {"packing.rows": 2, "time.duration": 8.0, "time.sample": 8.0, "effects.restitution": restitution}
        found = run(changes | {"time.timestep": 0.005}).velocity[-1, :, 1]
        # Of first order in the step, 0.005/2.4 of a collision, in what is lost
        assert found == pytest.approx([(1 - restitution) / 2, (1 + restitution) / 2], abs=2e-3 * (1 - restitution**2))


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
    with pytest.raises(SceneError, match="are two models of damping; give one of them"):
        CHAIN.with_values({"effects.viscosity": 1.0, "effects.restitution": 0.9})
