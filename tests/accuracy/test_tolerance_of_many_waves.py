"""A tolerance is met by sixty waves on a grid and twelve at random, and the estimate of their error is honest.

They run on `tests.stepped.stepped`, which is LAMMPS without LAMMPS, as a test of `test_tolerance`
checks.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_lmp import Record
from granular_lmp.accuracy.ladder import RUNGS, plan
from granular_lmp.accuracy.refinement import refine
from granular_lmp.problem import Problem, prepare
from tests.stand_in import status_of
from tests.stepped_waves import Stepped, Wave, scene_of

TOLERANCES = (1e-2, 1e-3, 1e-4)
WAVENUMBERS = (0.3, 0.802, 1.475, 2.127, 2.8)
AMPLITUDES = (0.2, 0.02, 0.3, 0.1)
# Modes × ξ × ν, the amplitudes in turn. ξ = 2.127 at ν = 0.17 is the antiresonance
GRID: list[Wave] = [
    (name, xi, AMPLITUDES[(i + j + k) // 2 % 4], nu)
    for i, name in enumerate(("TR", "RT", "L"))
    for j, xi in enumerate(WAVENUMBERS)
    for k, nu in enumerate((-0.5, 0.0, 0.17, 0.45))
]
# Waves on which nothing was tried out
_random = np.random.default_rng(2026)
RANDOM: list[Wave] = [
    (
        ("TR", "RT", "L")[i % 3],
        float(_random.uniform(0.1, 3.1)),
        float(10 ** _random.uniform(-2, -0.5)),
        float(_random.uniform(-0.5, 0.49)),
    )
    for i in range(12)
]
# Every seventh wave of the grid, which holds each mode, ξ and ν, and a random one
SETS = {"sample": GRID[::7] + RANDOM[:1], "grid": [wave for i, wave in enumerate(GRID) if i % 7] + RANDOM[1:]}
# Samples of 0.5 τ. RT takes the smallest steps, and most of the time as it is
LENGTHS = {wave: 120 if wave[0] != "RT" and index % 4 == 0 else 60 for index, wave in enumerate(GRID + RANDOM)}


@dataclass(frozen=True)
class Outcome:
    """Result of one case."""

    wave: Wave
    tolerance: float
    errors: dict[str, float]
    estimates: dict[str, float]
    runs: int


@pytest.fixture(
    scope="module", params=["sample", pytest.param("grid", marks=pytest.mark.more)], ids=lambda name: f"{name}:"
)
def outcomes(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> list[Outcome]:
    """Every wave of a set at every tolerance, through `refine`."""
    runs, found = Stepped(LENGTHS), []
    # At the antiresonance an error of first order takes steps of 1e-3 τ for 1e-4
    cases = [
        (wave, tolerance) for wave in SETS[request.param] for tolerance in TOLERANCES
        if not (wave[0] == "TR" and wave[1] == 2.127 and wave[3] == 0.17 and tolerance < 1e-3)
    ]  # fmt: skip
    scenes = {case: scene_of(*case, LENGTHS[case[0]]) for case in cases}
    chosen = {case: plan(prepare(scene))[0] for case, scene in scenes.items()}
    runs.prepare((wave, count << rung) for (wave, _), count in chosen.items() for rung in range(RUNGS))
    runs.prepare_limits(SETS[request.param])
    for wave, tolerance in cases:
        folder = tmp_path_factory.mktemp("case")
        scene = scenes[wave, tolerance]
        (folder / "scene.toml").write_text(scene.to_toml())
        taken: list[Path] = []

        def one(stepping: Problem, place: Path, *_: Any, wave: Wave = wave, taken: list[Path] = taken) -> Record:
            taken.append(place)
            return runs.record(stepping.scene, wave)

        record = refine(prepare(scene), folder, one, None, status_of(scene))
        errors = runs.errors(wave, np.column_stack([record.p, record.q, record.phi]))
        estimates = {name: value for name, value in record.info["error_estimate"].items() if value is not None}
        found.append(Outcome(wave, tolerance, errors, estimates, len(taken)))
    return found


def test_the_sets_hold_sixty_waves_and_every_value_of_each_axis() -> None:
    assert len(set(GRID)) == 60
    assert set(SETS["sample"]) | set(SETS["grid"]) == set(GRID + RANDOM)
    for axis, size in ((0, 3), (1, 5), (3, 4)):
        assert len({wave[axis] for wave in GRID[::7]}) == size


def test_every_wave_meets_its_tolerance(outcomes: list[Outcome]) -> None:
    assert not [o for o in outcomes if not max(o.errors.values()) <= o.tolerance]


def test_the_estimate_is_at_least_half_the_error(outcomes: list[Outcome]) -> None:
    # 0.52 was the lowest ratio in 885 cases; an error below 3e-6 is that of the reference, good to 4e-7, in part
    judged = [
        (o.estimates[name] / error, o.wave, o.tolerance, name)
        for o in outcomes
        for name, error in o.errors.items()
        if error > 3e-6
    ]
    assert len(judged) >= 20
    assert min(judged)[0] >= 0.5


def test_three_in_four_take_a_run_more_than_planned_at_most(outcomes: list[Outcome]) -> None:
    assert np.mean([o.runs <= RUNGS + 1 for o in outcomes]) >= 0.75
    assert min(o.runs for o in outcomes) < RUNGS  # and some fewer
