"""The work-precision study: errors react, budgets drop, nothing is run twice, and Ctrl-C loses nothing."""

import csv
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.solitary.chain import uniform
from cases.solitary.chain_motion import integrate
from granular_analysis.measure.norms import relative_error
from granular_analysis.theory.choice import trajectory, wave_of
from granular_lmp import ImpactRecord, ImpactScene, Record, Scene, load, run
from granular_lmp.errors import (
    GranularError,
    LammpsError,
    LaunchError,
    RunFolderError,
    RunInterrupted,
    SceneError,
    ToleranceError,
)
from granular_lmp.rest.scene import assignment
from granular_lmp.runs.record import read_status, write_status
from granular_lmp.studies import cost as module
from granular_lmp.studies import cost_settings
from granular_lmp.studies.cost import measure, plan
from granular_lmp.studies.cost_settings import base, settings
from granular_lmp.studies.cost_table import NOT_RUN, errors, failed, largest, recommended, text, to_csv
from granular_lmp.studies.sweep_points import scene_hash
from tests.cli.test_cli import cli
from tests.conftest import PAPER

ROOT = Path(__file__).parents[2]
FEW = ("time step", "Richardson pair")
GROUPS = {*FEW, "tolerance, strip", "columns", "ends"}


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """A study of two groups: runs with three steps, and the reference, on a machine of a known speed."""
    monkeypatch.setattr(module, "speed", lambda scene, kernel: (1e6, 0.0))
    monkeypatch.setattr(cost_settings, "HALVINGS", 2)
    every = cost_settings.groups
    monkeypatch.setattr(cost_settings, "groups", lambda scene: {name: every(scene)[name] for name in FEW})


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """All settings of a tiny scene, one round."""
    scene = PAPER.with_values(
        {"packing.rows": 8, "packing.ends": "periodic", "wave.wavenumber": np.pi / 4, "time.duration": 2.0}
    )
    folder = tmp_path_factory.mktemp("cost") / "study"
    return folder, measure(plan(scene, folder, repeats=1))


def slopes(found: dict[str, dict[str, Any]]) -> list[float]:
    """Return d log error/d log work from each setting to the next."""
    work, error = np.transpose([(row["particle_steps"], (largest(row) or (0.0,))[0]) for row in found.values()])
    return list(np.diff(np.log(error)) / np.diff(np.log(work)))


def rows(result: dict[str, Any], knob: str) -> dict[str, dict[str, Any]]:
    return {row["setting"]: row for row in result["points"] if row["knob"] == knob}


# --- what comes out ---


def test_every_setting_of_every_group_is_measured(study: tuple[Path, dict[str, Any]]) -> None:
    _, result = study
    assert {row["knob"] for row in result["points"]} == GROUPS
    assert [row["message"] for row in result["points"] if not row["repeats"]] == []
    for row in result["points"]:
        assert 0 < row["seconds_min"] <= row["seconds"] <= row["seconds_max"]
        assert row["particle_steps_per_second"] == pytest.approx(row["particle_steps"] / row["loop_seconds"])


def test_errors_fall_as_the_orders_say(study: tuple[Path, dict[str, Any]]) -> None:
    _, result = study
    # Velocity Verlet is of second order; the next order shows at the longest step, 0.5: (Ωh)² is then 2 %
    assert slopes(rows(result, "time step")) == pytest.approx([-2] * 5, abs=0.05)
    # Fourth order until the first-order error of LAMMPS shows
    assert slopes(rows(result, "Richardson pair"))[0] == pytest.approx(-4, abs=0.2)
    # All columns move alike
    assert slopes(rows(result, "columns")) == pytest.approx([0] * 3, abs=1e-3)


def test_the_error_of_a_pair_is_that_of_the_extrapolation(study: tuple[Path, dict[str, Any]]) -> None:
    _, result = study
    single, pair = rows(result, "time step"), rows(result, "Richardson pair")["0.25 + 0.125"]
    assert pair["error_q"] < single["0.125"]["error_q"] / 100
    assert pair["particle_steps"] == single["0.25"]["particle_steps"] + single["0.125"]["particle_steps"]


@pytest.mark.usefixtures("few")
def test_a_pair_of_runs_whose_contacts_may_open_is_its_finer_run(tmp_path: Path) -> None:
    cell = {"packing.rows": 8, "packing.ends": "periodic", "wave.wavenumber": np.pi / 4, "time.duration": 1.0}
    scene = PAPER.with_values({**cell, "effects.contact_opening": True})
    result = measure(plan(scene, tmp_path / "study", repeats=1))
    single, pair = rows(result, "time step"), rows(result, "Richardson pair")["0.25 + 0.125"]
    assert pair["error_q"] == single["0.125"]["error_q"] > 0
    # The reference is its finest run, and its error the distance to the one before
    assert 0 < result["reference"]["error_q"] < single["0.125"]["error_q"]


def test_one_percent_is_seen_in_the_component_that_has_it(study: tuple[Path, dict[str, Any]]) -> None:
    best = Record.load(study[0] / "reference")
    for name in ("p", "q", "phi"):
        found = errors(best.with_signals(**{name: 1.01 * getattr(best, name)}), best)
        assert found.pop(f"error_{name}") == pytest.approx(0.01, rel=1e-9)
        assert list(found.values()) == [0, 0]


def test_what_symmetry_makes_zero_has_no_error(small: Scene) -> None:
    wave = small.with_values({"wave.mode": "L"})
    tau = np.arange(3.0)
    best = Record.of_centre(tau, 1 + tau, 1e-9 * tau, 0 * tau, wave)
    assert errors(best.with_signals(q=-best.q), best) == {"error_p": 0.0, "error_q": None, "error_phi": None}


def test_the_reference_knows_its_own_error(study: tuple[Path, dict[str, Any]]) -> None:
    folder, result = study
    best = Record.load(folder / "reference")
    exact = trajectory("exact-lattice", wave_of(best), best.tau)
    # The exact lattice is integrated to 1e-9 or so; rounding of the run is of the size of the error of q here
    truth = relative_error(best.p, exact[0])
    assert truth < 1e-6
    # The distance of two extrapolations is 1 time the error where that is of first order and 15 times where of fourth
    assert truth / 1.5 < result["reference"]["error_p"] < 15 * 1.5 * truth


def test_the_tables_say_the_same(study: tuple[Path, dict[str, Any]]) -> None:
    folder, result = study
    assert json.loads((folder / "cost.json").read_text()) == result
    assert (folder / "cost.csv").read_text() == to_csv(result["points"])


def test_the_fastest_setting_of_an_accuracy_is_recommended(study: tuple[Path, dict[str, Any]]) -> None:
    result = study[1]
    single = [row for row in result["points"] if row["options"] is not None]
    known = {
        row["options"]: max(value for key, value in row.items() if key.startswith("error_") and value is not None)
        for row in single
        if row["repeats"]
    }
    middle = sorted(known.values())[len(known) // 2]
    words, options = recommended(result, middle).splitlines()
    assert words.startswith(f"for an error of at most {middle:g} the fastest is ")
    assert known[options] <= middle
    chosen = min(row["seconds"] for row in single if row["options"] == options)
    met = [row for row in single if known.get(row["options"], np.inf) <= middle]
    assert chosen == min(row["seconds"] for row in met)
    assert recommended(result, 1e-15).startswith("no measured setting has an error of at most 1e-15; the best is ")
    assert not any(row["options"] for row in rows(result, "Richardson pair").values())


def test_the_options_of_a_setting_give_its_run(small: Scene) -> None:
    there = base(small.with_values({"time.tolerance": 1e-2}))
    made = settings(there)[0]
    for setting in made:
        if setting.options is not None:
            changes = dict(map(assignment, setting.options.removeprefix("--set ").split(" --set ")))
            declared = small.with_values({"time.tolerance": 1e-2}).with_values(changes)
            assert scene_hash(base(declared)) == scene_hash(base(setting.runs[0]))
            assert scene_hash(there.with_values(changes)) == scene_hash(setting.runs[0])
    assert {setting.knob for setting in made if setting.options is None} == {"reference", "Richardson pair"}


# --- settings ---


def test_what_a_scene_cannot_have_is_left_out_with_the_reason(small: Scene) -> None:
    long = {"packing.rows": 4_000, "packing.columns": 3, "wave.amplitude": 1e-5, "wave.mode": "L"}
    made, refused = settings(small.with_values(long))
    assert "must be at least" in refused["tolerance, strip: 1e-06"]  # rounding
    assert "1e-06" not in {setting.name for setting in made}


def test_the_reference_is_finer_than_every_step_of_the_settings(small: Scene) -> None:
    best, *others = settings(small)[0]
    steps = [run.time.step for run in best.runs]
    finest = min(each.runs[0].time.step for each in others if each.knob == "time step")
    assert steps == [finest / 2**k for k in (1, 2, 3)]


# --- running ---


def counted(monkeypatch: pytest.MonkeyPatch, stop_after: int = 10**9) -> list[str]:
    """Names of the runs that are really done; Ctrl-C comes in the one after `stop_after`."""
    done: list[str] = []
    real = module.run_scene

    def run_one(scene: Scene, folder: Path, **options: Any) -> Record:
        if len(done) == stop_after:
            raise KeyboardInterrupt
        done.append(folder.parent.name)
        return real(scene, folder, **options)

    monkeypatch.setattr(module, "run_scene", run_one)
    return done


def test_rounds_take_turns_and_asked_again_nothing_is_done_twice(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = counted(monkeypatch)
    first = measure(plan(small, tmp_path / "study", repeats=2))
    assert len(done) == 2 * 3 + 3  # three steps, of which the pairs are made; the reference once
    again = plan(small, tmp_path / "study", repeats=2)
    assert (again.todo(), again.seconds) == ({}, 0)
    assert measure(again) == first
    assert len(done) == 9
    assert done[3:6] == done[6:]  # rounds take turns
    assert len(set(done[3:6])) == 3
    measure(plan(small, tmp_path / "study", repeats=3))
    assert len(done) == 9 + 3


def test_ctrl_c_keeps_what_was_run_and_the_rest_is_done_next_time(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        done = counted(patch, stop_after=5)
        with pytest.raises(RunInterrupted, match="5 of 9 runs were done and are kept, the same command again"):
            measure(plan(small, tmp_path / "study", repeats=2))
    half = json.loads((tmp_path / "study" / "cost.json").read_text())
    assert sum(row["repeats"] for row in half["points"]) == 2 + 1  # two steps, hence one pair
    after = counted(monkeypatch)
    result = measure(plan(small, tmp_path / "study", repeats=2))
    assert len(after) == 9 - len(done)
    assert {row["repeats"] for row in result["points"]} == {2}


def test_a_run_that_was_cut_off_is_done_from_its_start(few: None, small: Scene, tmp_path: Path) -> None:
    planned = plan(small, tmp_path / "study", repeats=1)
    folder, one = list(planned.todo().items())[-1]
    record = run(one, folder)
    write_status(folder, record.info | {"status": "interrupted", "wall_seconds": {"total": 99.0, "loop": 99.0}})
    measure(planned)
    assert read_status(folder)["status"] == "finished"
    assert read_status(folder)["wall_seconds"]["total"] < 99  # nothing of the time before is counted


FailWith = Callable[[GranularError | None], None]


@pytest.fixture
def fail_with(monkeypatch: pytest.MonkeyPatch) -> FailWith:
    """Let the runs with the step 0.25 raise an error; with None they are run again."""
    real = module.run_scene

    def patch(error: GranularError | None) -> None:
        def run_one(scene: Scene, folder: Path, **options: Any) -> Record:
            if error is not None and scene.time.step == 0.25:
                raise error
            return real(scene, folder, **options)

        monkeypatch.setattr(module, "run_scene", run_one)

    return patch


def test_a_run_that_fails_is_said_and_the_others_go_on(
    few: None,
    small: Scene,
    small_toml: Path,
    tmp_path: Path,
    fail_with: FailWith,
    capsys: pytest.CaptureFixture[str],
) -> None:
    fail_with(LammpsError("for the test", "run 1", ""))
    result = measure(plan(small, tmp_path / "study", repeats=1))
    failed = {f"{row['knob']} {row['setting']}": row["message"] for row in result["points"] if not row["repeats"]}
    assert failed.keys() == {
        "time step 0.25",
        "Richardson pair 0.5 + 0.25",
        "Richardson pair 0.25 + 0.125",
    }
    assert set(failed.values()) == {"LAMMPS failed at 'run 1': for the test"}
    status, out, _ = cli(capsys, "cost", str(small_toml), "-o", str(tmp_path / "study"), "--repeats", "1")
    assert (status, out.count("LAMMPS failed at 'run 1'")) == (1, 3)
    fail_with(None)
    again = measure(plan(small, tmp_path / "study", repeats=1))
    assert [row["message"] for row in again["points"] if row["message"]] == []


def test_a_tolerance_that_is_not_met_is_an_answer_and_no_failure(
    few: None, small_toml: Path, tmp_path: Path, fail_with: FailWith, capsys: pytest.CaptureFixture[str]
) -> None:
    fail_with(ToleranceError("time.tolerance = 1e-09: not met"))
    status, out, _ = cli(capsys, "cost", str(small_toml), "-o", str(tmp_path / "study"), "--repeats", "1")
    assert (status, out.count("no step meets it: time.tolerance = 1e-09: not met")) == (0, 3)
    assert failed({"message": "LAMMPS failed"})
    assert not failed({"message": ""})
    assert not failed({"message": NOT_RUN})


def test_a_reference_that_fails_is_raised(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise LammpsError("for the test", "run 1", "")

    monkeypatch.setattr(module, "run_scene", fail)
    with pytest.raises(LammpsError, match="for the test"):
        measure(plan(small, tmp_path / "study", repeats=1))
    assert json.loads((tmp_path / "study" / "cost.json").read_text())["reference"] is None


# --- budget ---


def priced(small: Scene, folder: Path, monkeypatch: pytest.MonkeyPatch, **options: Any) -> module.Plan:
    """A plan for a machine that does 1e5 particle-steps a second, and takes no time beside: its clock stands still."""
    monkeypatch.setattr(module, "speed", lambda scene, kernel: (1e5, 0.0))
    monkeypatch.setattr(module, "monotonic", lambda: 0.0)
    return plan(small, folder, repeats=1, **options)


def test_the_estimate_is_of_all_runs(few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # 24 spheres, 4 samples: 1 + 2 + 4 steps to a sample, and 8 + 16 + 32 of the reference
    assert priced(small, tmp_path / "study", monkeypatch).seconds == pytest.approx(24 * 4 * 63 / 1e5)
    assert not (tmp_path / "study").exists()


def test_a_budget_below_the_reference_is_refused(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(LaunchError, match=r"budget = 1e-06: must be at least 1 s, which the reference takes"):
        priced(small, tmp_path / "study", monkeypatch, budget=1e-6)


def test_a_budget_leaves_the_longest_runs_for_another_call(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned = priced(small, tmp_path / "study", monkeypatch)
    clock = [0.0]
    real = module.run_scene

    def run_one(scene: Scene, folder: Path, **options: Any) -> Record:
        clock[0] += 1e3 * scene.time.steps  # 1e3 s a step, for the 2.4e-4 s of the estimate
        return real(scene, folder, **options)

    monkeypatch.setattr(module, "monotonic", lambda: clock[0])
    monkeypatch.setattr(module, "run_scene", run_one)
    # 224 steps of the reference, then 4 and 8; the run of 16 steps would end at 252e3 s
    result = measure(replace(planned, budget=251e3))
    assert clock[0] == 236e3
    unfinished = [f"{row['knob']}: {row['setting']}" for row in result["points"] if row["message"] == NOT_RUN]
    assert unfinished == ["time step: 0.125", "Richardson pair: 0.25 + 0.125"]
    assert text(result).count(NOT_RUN) == 2
    result = measure(replace(planned, budget=251e3))  # which has a budget of its own
    assert [row["repeats"] for row in result["points"]] == [1] * 5


# --- folder and command line ---


def test_a_folder_of_something_else_is_refused(small: Scene, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    with pytest.raises(RunFolderError, match="is there already; choose another folder"):
        plan(small, tmp_path)
    planned = plan(small, tmp_path / "study", repeats=1)
    measure(replace(planned, settings=planned.settings[:1]))
    with pytest.raises(RunFolderError, match="holds a study of another scene, small"):
        plan(small.with_values({"wave.amplitude": 0.1}), tmp_path / "study")


@pytest.mark.parametrize("text", ["{", "{}", "[]", '{"scene": 1}'])
def test_a_damaged_table_is_refused_by_its_name(text: str, small: Scene, tmp_path: Path) -> None:
    (tmp_path / "cost.json").write_text(text)
    with pytest.raises(RunFolderError, match=r"cost\.json: cannot be read"):
        plan(small, tmp_path)


def test_the_command_says_how_long_and_what_is_left_out(
    few: None, small_toml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("cost", str(small_toml), "-o", str(tmp_path / "study"), "--repeats", "1")
    status, out, _ = cli(capsys, *words)
    assert status == 0
    assert out.startswith("small: 6 settings, 6 runs, about ")
    assert "Richardson pair   0.5 + 0.25" in out
    header, *lines = out.splitlines()[1:-1]
    column = header.index("rounds") + len("rounds")
    assert {line[:column].split()[-1] for line in lines} == {"1"}
    status, out, err = cli(capsys, "cost", str(small_toml), "-o", str(tmp_path / "other"), "--budget", "1e-9")
    assert (status, out) == (2, "")
    assert "budget = 1e-09: must be at least" in err


@pytest.mark.more
def test_a_study_that_is_stopped_from_outside_goes_on(small_toml: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "granular_lmp", "cost", str(small_toml), "-o", str(tmp_path / "study")]
    with subprocess.Popen([*command, "--repeats", "40"], cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
        started = time.monotonic()
        while len(list((tmp_path / "study").glob("runs/*/1/trajectory.csv"))) < 4 and time.monotonic() < started + 30:
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "interrupted" in err
    assert "the same command again does the rest" in err
    assert json.loads((tmp_path / "study" / "cost.json").read_text())["points"]


def test_a_crystal_keeps_its_size_in_every_setting() -> None:
    changes = {"packing.rows": 8, "packing.columns": 6, "packing.ends": "periodic", "disorder.radius": 5e-5}
    scene = base(PAPER.with_values(changes | {"wave.wavenumber": np.pi / 4, "time.duration": 2.0}))
    made, refused = settings(scene)
    assert refused == {}
    assert {setting.knob for setting in made} == {"reference", *FEW, "tolerance, strip"}
    assert {run.shape for setting in made for run in setting.runs} == {scene.shape}
    with pytest.raises(SceneError, match="must be a running plane wave along y"):
        base(scene.with_values({"wave.form": "standing"}))


# --- a scene without a wave ---

CHAIN = ImpactScene.load("solitary_chain").with_values(
    {"packing.rows": 12, "packing.last": "free", "time.duration": 20.0, "time.sample": 1.0}
)


@pytest.fixture(scope="module")
def struck(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """All settings of a struck chain, one round."""
    folder = tmp_path_factory.mktemp("cost") / "struck"
    return folder, measure(plan(CHAIN, folder, repeats=1))


def test_the_errors_are_those_against_theory(struck: tuple[Path, dict[str, Any]]) -> None:
    folder, result = struck
    start = np.eye(12)[0]
    _, exact = integrate(uniform(12), 0 * start, start, np.arange(1.0, 21.0), 1e-11)
    left = result["reference"]["error_velocity"]
    assert left < 1e-8
    found, records = rows(result, "time step"), [*map(load, folder.glob("runs/*/1"))]
    stepped = {f"{each.scene.time.step:.4g}": each for each in records if each.scene.time.tolerance is None}
    for step, row in found.items():
        record = stepped[step]
        assert isinstance(record, ImpactRecord)
        true = np.max(np.abs(record.velocity[1:, :, 1] - exact))
        assert row["error_velocity"] == pytest.approx(true, abs=2 * left)
    assert slopes(found) == pytest.approx([-2] * 5, abs=0.1)
    assert all(row["error_spin"] is None for row in found.values())  # nothing turns a sphere of a chain


def test_a_tolerance_is_met_and_pairs_are_better(struck: tuple[Path, dict[str, Any]]) -> None:
    _, result = struck
    for tolerance, row in rows(result, "tolerance, strip").items():
        assert row["error_velocity"] < float(tolerance)
    single = [row["error_velocity"] for row in rows(result, "time step").values()][1:]
    paired = [row["error_velocity"] for row in rows(result, "Richardson pair").values()]
    assert all(pair < one / 5 for pair, one in zip(paired, single, strict=True))


def test_the_size_of_a_scene_without_a_wave_is_no_setting(struck: tuple[Path, dict[str, Any]]) -> None:
    folder, result = struck
    assert {row["knob"] for row in result["points"]} == {*FEW, "tolerance, strip"}
    with (folder / "cost.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert [float(line["error_velocity"]) for line in table] == [row["error_velocity"] for row in result["points"]]
    assert "velocity" in text(result).splitlines()[0]
    assert plan(CHAIN, folder, repeats=1).todo() == {}  # the same study is done
