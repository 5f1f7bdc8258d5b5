"""Impacts to a tolerance: the order is measured; the estimate is above the error against theory, on other scenes."""

import json
from itertools import pairwise
from math import inf, nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.snapshot import first_snapshot
from granular_lmp import ImpactRecord, ImpactScene, resume, run_impact
from granular_lmp.accuracy import refinement
from granular_lmp.accuracy.collisions import judge
from granular_lmp.accuracy.estimates import combined_record
from granular_lmp.accuracy.extrapolation import Judgement
from granular_lmp.accuracy.ladder import RUNGS, plan, planned
from granular_lmp.cli import main
from granular_lmp.effects.selection import order
from granular_lmp.errors import LaunchError, RunFolderError, SceneError, ToleranceError
from granular_lmp.problem import prepare
from granular_lmp.runs.record import read_status, write_status
from granular_lmp.studies.sweep import sweep
from tests.beside_network import network_fields
from tests.pause import as_if_killed

CHAIN = ImpactScene.load("solitary_chain").with_values(
    {"packing.rows": 15, "packing.last": "free", "time.duration": 25.0, "time.sample": 1.0, "time.tolerance": 1e-3}
)
SHEET = ImpactScene.load("point_impact").with_values(
    {
        "packing.rows": 7,
        "packing.columns": 7,
        "striker.1.spheres": [[0, 3]],
        "time.duration": 5.0,
        "time.sample": 1.0,
        "time.tolerance": 1e-3,
    }
)


RANDOM = {"disorder.density": 0.2, "disorder.radius": 0.03, "disorder.seed": 11}
RUBS = {"effects.friction": 0.25, "effects.shear_law": "incremental", "disorder.density": 0.15, "time.duration": 3.0}


@pytest.mark.parametrize(
    ("scene", "changes", "tolerance"),
    [
        (CHAIN, RANDOM | {"packing.last": "wall"}, 1e-3),
        (CHAIN, RANDOM | {"packing.last": "held", "disorder.seed": 12}, 1e-4),
        (CHAIN, {"packing.first": "held", "packing.last": "held", "striker.1.rows": [4, 4], "packing.rows": 9}, 1e-3),
        (CHAIN, {"packing.rows": 8, "packing.last": "wall", "time.duration": 40.0}, 1e-5),
        (SHEET, {"disorder.density": 0.2, "disorder.seed": 7}, 1e-3),
        pytest.param(SHEET, {"effects.friction": 0.25, "effects.shear_law": "secant"}, 1e-3, marks=pytest.mark.more),
        (SHEET, RUBS, 1e-3),
    ],
    ids=["wall", "held", "between", "fine", "sheet", "secant", "incremental"],
)
def test_the_estimate_is_above_the_error(
    scene: ImpactScene, changes: dict[str, Any], tolerance: float, tmp_path: Path
) -> None:
    record = run_impact(scene.with_values(changes | {"time.tolerance": tolerance}), tmp_path / "run")
    # Sliding is resolved to second order in the step: 1e-6 with 400 of them in t0, 5e-5 with 50
    rubs = record.scene.effects.friction > 0
    exact = network_fields(first_snapshot(record), record.tau, 1 / (50 if rubs else 5), rtol=1e-11)[..., 2:4]
    error, said = np.max(np.abs(record.velocity - exact)), record.info["error_estimate"]
    assert error < said["velocity"] <= tolerance
    assert np.max(np.abs(1.01 * record.velocity - exact)) > said["velocity"]  # what an error would do
    assert ("spin" in said) == rubs
    assert record.info["order"] == (1 if rubs and record.scene.effects.shear_law == "incremental" else 2)


def estimate(runs: list[ImpactRecord]) -> Judgement:
    counts = [run.scene.time.steps_per_sample for run in runs]
    return judge([run.signals for run in runs], counts, order(runs[-1].scene))


def answer(runs: list[ImpactRecord]) -> ImpactRecord:
    return combined_record(runs, estimate(runs))


def shown_order(runs: list[ImpactRecord]) -> int | None:
    """The order of the error in the step that three runs show, each of half the step; None if they do not converge."""
    first, second = (
        np.sqrt(sum(np.sum((b.signals[name] - a.signals[name]) ** 2) for name in a.signals if name != "displacement"))
        for a, b in pairwise(runs)
    )
    if second == 0 or first >= 2**1.5 * second:
        return 2
    return 1 if first >= 2**0.5 * second else None


def stepped(scene: ImpactScene, steps: list[float], folder: Path) -> list[ImpactRecord]:
    return [run_impact(scene.with_values({"time.timestep": each}), folder / f"{each}") for each in steps]


@pytest.mark.parametrize(
    ("scene", "expected"),
    [
        (CHAIN, 2),
        (CHAIN.with_values({"effects.restitution": 0.7, "packing.last": "wall"}), 1),
        (SHEET.with_values({"effects.friction": 0.3, "effects.shear_law": "incremental"}), 1),
    ],
    ids=["smooth", "damping", "friction"],
)
def test_the_order_is_that_of_the_effects(scene: ImpactScene, expected: int, tmp_path: Path) -> None:
    # Ratios of differences there: 4.0, 2.1 and 2.1; the limits are 2.8 and 1.4
    runs = stepped(scene, [0.05, 0.025, 0.0125], tmp_path)
    assert shown_order(runs) == order(scene) == expected
    assert answer(runs).tau.tolist() == runs[-1].tau.tolist()


def test_what_does_not_converge_has_a_large_estimate(tmp_path: Path) -> None:
    runs = stepped(CHAIN, [0.1, 0.05, 0.025], tmp_path)
    wrong = [
        each.with_signals(velocity=each.velocity * factor) for each, factor in zip(runs, (1, 1.01, 0.99), strict=True)
    ]
    assert shown_order(wrong) is None
    lost = [*runs[:2], runs[2].with_signals(velocity=runs[2].velocity * nan)]
    assert shown_order(lost) is None
    assert not estimate(lost).errors["velocity"] < inf
    assert estimate(wrong).errors["velocity"] > 5e-3 > 10 * estimate(runs).errors["velocity"]
    # What nothing disturbs is exact
    still = [each.with_signals(**runs[2].signals) for each in runs]
    assert max(estimate(still).errors.values()) < 1e-14


def test_a_tolerance_that_is_not_met_is_refused_with_its_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(refinement, "MOST_RUNGS", 3)
    scene = CHAIN.with_values({"time.tolerance": 1e-5, "packing.first": "held", "striker.1.rows": [2, 2]})
    scene = scene.with_values({"packing.rows": 5, "packing.last": "held", "time.duration": 60.0})
    with pytest.raises(
        ToleranceError, match=r"time.tolerance = 1e-05: not met with steps down to .* the runs are kept"
    ):
        run_impact(scene, tmp_path / "run")
    info = json.loads((tmp_path / "run" / "run.json").read_text())
    assert info["status"] == "failed"
    assert len([*(tmp_path / "run").glob("*_per_sample")]) == 3
    with pytest.raises(RunFolderError, match="not a finished run"):
        ImpactRecord.load(tmp_path / "run")


@pytest.mark.usefixtures("unrendered")
def test_the_folder_holds_the_answer_and_its_runs(tmp_path: Path) -> None:
    scene = SHEET.with_values({"effects.friction": 0.2, "time.duration": 2.0})
    record = run_impact(scene, tmp_path / "run")
    again = ImpactRecord.load(tmp_path / "run")
    # The text has all digits; the sums of positions and displacements are rounded otherwise
    for name in ("tau", "velocity", "displacement", "spin"):
        assert getattr(again, name) == pytest.approx(getattr(record, name), abs=1e-10)
    assert again.scene == record.scene == scene
    per_sample = plan(prepare(scene))[0]
    runs = [ImpactRecord.load(folder) for folder in (tmp_path / "run").glob("*_per_sample")]
    runs.sort(key=lambda each: each.scene.time.steps_per_sample)
    assert [run.scene.time.steps_per_sample for run in runs][:2] == [per_sample, 2 * per_sample]
    assert record.info["steps"] >= sum(each.info["steps"] for each in runs)
    if record.info["timestep_used"] == runs[-1].scene.time.step:
        assert answer(runs).velocity == pytest.approx(record.velocity, abs=1e-12)
    assert main(["export", str(tmp_path / "run"), "-o", str(tmp_path / "run.csv")]) == 0
    assert main(["view", str(tmp_path / "run"), "-o", str(tmp_path / "run.png")]) == 0
    with pytest.raises(RunFolderError, match="exists already"):
        run_impact(scene, tmp_path / "run")
    assert planned(prepare(scene)).scene.time.steps_per_sample == per_sample << RUNGS - 1


def test_a_run_that_was_stopped_in_its_first_checkpoint_begins_anew(tmp_path: Path) -> None:
    scene = CHAIN.with_values({"packing.rows": 6, "time.duration": 4.0})
    whole = run_impact(scene, tmp_path / "run")
    last = max((tmp_path / "run").glob("*_per_sample"), key=lambda path: int(path.name.split("_")[0]))
    (last / "checkpoint.a").write_bytes(b"cut off")
    for folder in (tmp_path / "run", last):
        as_if_killed(folder)
    again = resume(tmp_path / "run")
    assert np.array_equal(again.velocity, whole.velocity)
    _edit(tmp_path / "run", {"status": "interrupted", "launcher": None})
    with pytest.raises(LaunchError, match=r"run\.json: launcher = None: must be one of module, lmp"):
        resume(tmp_path / "run")


def _edit(folder: Path, changes: dict[str, Any]) -> None:
    write_status(folder, read_status(folder) | changes)


def test_a_state_that_presses_spheres_deep_shortens_the_first_step(tmp_path: Path) -> None:
    # Two spheres are let go that overlap by far more than the unit of the impact, that of the slow one
    slow = {"striker": [], "start": {"state": [[4, 0, 0, 1e-5, 0, 0, 0], [0, 0, 0, 0, 0, 1e-3, 0]]}}
    scene = ImpactScene.from_dict(CHAIN.with_values({"packing.rows": 6, "time.duration": 1.0}).to_dict() | slow)
    with pytest.raises(SceneError, match=r"above 0\.5/omega of the stiffest contact at the beginning") as no:
        prepare(scene.with_values({"time.timestep": 0.2}))
    most = float(str(no.value).rpartition(" ")[2])
    prepare(scene.with_values({"time.timestep": 0.99 * most}))
    loose = scene.with_values({"time.tolerance": 1e-2})
    assert loose.time.sample / plan(prepare(loose))[0] <= most
    assert run_impact(loose, tmp_path / "run").info["guards"]["step_in_contact"]["quiet"]


def test_a_step_beside_a_tolerance_is_refused_and_one_replaces_the_other() -> None:
    tables = CHAIN.to_dict()
    assert "timestep" not in tables["time"]
    with pytest.raises(SceneError, match=r"time.tolerance = 0.001: excludes time.timestep = 0.03; give one of the two"):
        ImpactScene.from_dict(tables | {"time": tables["time"] | {"timestep": 0.03}})
    assert ImpactScene.loads(CHAIN.to_toml()) == CHAIN
    assert CHAIN.with_values({"time.timestep": 0.03}).time.tolerance is None
    with pytest.raises(SceneError, match="has no time step until one is chosen"):
        _ = CHAIN.time.step
    with pytest.raises(SceneError, match="would take more than 1000000000 steps"):
        plan(prepare(CHAIN.with_values({"time.tolerance": 1e-9, "time.duration": 1e6})))


@pytest.mark.usefixtures("tried")
def test_a_sweep_and_the_commands_take_a_tolerance(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = CHAIN.with_values({"packing.rows": 6, "time.duration": 10.0})
    done = sweep(scene, {"time.tolerance": [1e-2, 1e-3]}, tmp_path / "sweep")
    assert [row["status"] for row in done.rows] == ["finished"] * 2
    assert all(row["velocity_error"] <= row["time.tolerance"] for row in done.rows)
    (tmp_path / "mine.toml").write_text(scene.to_toml())
    file = str(tmp_path / "mine.toml")
    steps = planned(prepare(scene)).scene.time.steps * 7 // 4  # 1 + 2 + 4 of the first run, which has a quarter
    assert main(["check", file]) == 0
    assert (
        f"steps     {steps} in 3 runs, or more if their errors require it;  11 records of 6 spheres"
        in capsys.readouterr().out
    )
    assert main(["effects", file]) == 0
    assert "chooses the step" in capsys.readouterr().out
    assert main(["build", file, "-o", str(tmp_path / "deck")]) == 0
    assert (
        f"variable timestep index {planned(prepare(scene)).scene.time.timestep!r}"
        in (tmp_path / "deck" / "in.solitary_chain").read_text()
    )
    capsys.readouterr()
    assert main(["run", file, "-o", str(tmp_path / "run")]) == 0
    assert "error over the velocity of the fastest striker, estimated: velocity " in capsys.readouterr().out
