"""Checkpoints: how often a deck writes them, what they cost by default, and that more ranks write them as often."""

from pathlib import Path

import pytest

from granular_lmp import Scene, build, run
from granular_lmp.lammps.checkpoints import (
    MOST,
    SHARE,
    SPEED,
    WRITING,
    checkpoint_steps,
    minutes_between,
    steps_between,
)
from granular_lmp.lammps.guards import line_interval
from granular_lmp.problem import prepare
from granular_lmp.studies.forecast import SERIAL, Forecast

PERIODIC = Scene.load("tr_periodic")


def sheet(side: int, **output: float) -> Scene:
    changes = {"packing.rows": side, "packing.columns": side} | {f"output.{key}": x for key, x in output.items()}
    return PERIODIC.with_values(changes)


@pytest.mark.parametrize("ranks", [1, 4])
@pytest.mark.parametrize("minutes", [0.01, 7.0])
def test_steps_are_the_minutes_that_were_declared(minutes: float, ranks: int) -> None:
    scene = sheet(100, checkpoint=minutes)
    problem = prepare(scene)
    steps = checkpoint_steps(problem, ranks)
    took = steps * scene.shape.spheres / (SPEED * ranks * 60)
    assert steps % line_interval(problem) == 0
    assert minutes <= took < minutes + line_interval(problem) * scene.shape.spheres / (SPEED * ranks * 60) * (1 + 1e-9)


@pytest.mark.parametrize("side", [20, 200, 1000, 3000])
def test_by_default_checkpoints_take_a_hundredth_of_the_run_at_most(side: int) -> None:
    spheres, declared = side * side, sheet(side).output.checkpoint
    assert spheres * WRITING / (60 * minutes_between(declared, spheres)) <= SHARE * (1 + 1e-12)
    assert minutes_between(declared, spheres) >= 0.5


@pytest.mark.parametrize("lines", [1, 7, 400])
def test_the_longest_interval_fits_the_integers_of_lammps(lines: int) -> None:
    steps = steps_between(1e5, 4, lines, ranks=64)
    assert MOST - lines < steps <= MOST
    assert steps % lines == 0


def test_checkpoints_that_are_very_rare_run(tmp_path: Path) -> None:
    run(sheet(20, checkpoint=1e5).with_values({"time.duration": 1.0}), tmp_path / "run")


def test_the_deck_is_for_one_rank_and_a_run_on_more_says_so_in_its_log(tmp_path: Path) -> None:
    scene = PERIODIC.with_values({"packing.rows": 20, "time.duration": 2.0})
    run(scene, tmp_path / "run", ranks=2)
    problem = prepare(scene)
    one, two = checkpoint_steps(problem), checkpoint_steps(problem, 2)
    assert two > one
    assert f"variable checkpoint index {one}  #" in build(scene).input_text
    assert f"restart      {two} checkpoint.a checkpoint.b" in (tmp_path / "run" / "log.lammps").read_text()


def forecast(start: float | None, seconds: float | None) -> Forecast:
    return Forecast(10_000, 10, 1, 1, 0, start, seconds, "", 0.0, 0.5)


def test_ranks_shorten_the_loop_and_not_the_start() -> None:
    assert forecast(2.0, 12.0).on(1) == (12.0, 12.0)
    low, high = forecast(2.0, 12.0).on(4) or (0, 0)
    assert low == pytest.approx(2 + 10 / 4)
    assert high == pytest.approx(2 + 10 * (0.25 + SERIAL * 0.75))
    assert forecast(None, None).on(4) is None


@pytest.mark.parametrize(("ranks", "measured"), [(2, 0.52), (2, 0.55), (4, 0.30)])
def test_what_was_measured_on_more_ranks_lies_within_the_bounds(ranks: int, measured: float) -> None:
    low, high = forecast(0.0, 1.0).on(ranks) or (0, 0)
    assert low <= measured <= high


def test_short_runs_are_said_to_be_slower_on_more_ranks() -> None:
    assert forecast(0.0, 1.0).lost_on(2) == "2 are slower: they start 0.7 s later and save at most 0.5 s"
    assert forecast(0.0, 10.0).lost_on(2) == ""


def minutes(cell: str) -> list[float]:
    return [float(word) for word in cell.split(" to ")]


def test_the_minutes_of_the_page_are_those_of_the_bounds() -> None:
    lines = (Path(__file__).parents[2] / "docs/how-long.md").read_text("utf-8").splitlines()
    rows = [line.strip("| ").split(" | ") for line in lines if line.startswith("| 1e")]
    assert len(rows) == 2
    for spheres, steps, both, *times in rows:
        assert float(spheres) * float(steps) == float(both)
        loop = forecast(0.0, float(both) / SPEED / 60)
        for ranks, cell in zip((1, 4, 64), times, strict=True):
            expected = dict.fromkeys(loop.on(ranks) or ())  # on one rank both bounds are one
            # Two digits are printed
            assert minutes(cell) == pytest.approx(list(expected), rel=0.05)
