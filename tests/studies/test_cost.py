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
from granular_lmp.accuracy.estimates import richardson
from granular_lmp.errors import (
    GranularError,
    LammpsError,
    RunFolderError,
    RunInterrupted,
)
from granular_lmp.problem import prepare
from granular_lmp.rest.scene import assignment
from granular_lmp.runs.record import read_status, write_status
from granular_lmp.studies import cost as module
from granular_lmp.studies import cost_settings
from granular_lmp.studies.cost import measure, plan
from granular_lmp.studies.cost_settings import base, references, settings
from granular_lmp.studies.cost_table import NOT_RUN, errors, failed, largest, recommended, text
from granular_lmp.studies.sweep_points import scene_hash
from tests.cli.test_cli import cli
from tests.conftest import PAPER

ROOT = Path(__file__).parents[2]
GROUPS = {"time step", "tolerance"}


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """A study of one group: runs with three steps, and the reference."""
    monkeypatch.setattr(cost_settings, "HALVINGS", 2)
    monkeypatch.setattr(cost_settings, "TOLERANCES", ())


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
    work, error = np.transpose([(row["particles"] * row["steps"], largest(row)[0]) for row in found.values()])
    return list(np.diff(np.log(error)) / np.diff(np.log(work)))


def reference_of(folder: Path, result: dict[str, Any]) -> Record:
    coarse, fine = (Record.load(folder / each) for each in result["reference"]["runs"])
    return richardson(coarse, fine)


def rows(result: dict[str, Any], varied: str) -> dict[str, dict[str, Any]]:
    return {row["setting"]: row for row in result["points"] if row["varied"] == varied}


# --- what comes out ---


def test_every_setting_of_every_group_is_measured(study: tuple[Path, dict[str, Any]]) -> None:
    _, result = study
    assert {row["varied"] for row in result["points"]} == GROUPS
    assert [row["message"] for row in result["points"] if not row["repeats"]] == []
    for row in result["points"]:
        assert 0 < row["loop_seconds"] < row["seconds_min"] <= row["seconds"] <= row["seconds_max"]


def test_errors_fall_as_the_orders_say(study: tuple[Path, dict[str, Any]]) -> None:
    _, result = study
    # Velocity Verlet is of second order; the next order shows at the longest step, 0.5: (Ωh)² is then 2 %
    assert slopes(rows(result, "time step")) == pytest.approx([-2] * 5, abs=0.05)


@pytest.mark.usefixtures("few")
def test_the_reference_of_runs_whose_contacts_may_open_is_the_finest_run(tmp_path: Path) -> None:
    cell = {"packing.rows": 8, "packing.ends": "periodic", "wave.wavenumber": np.pi / 4, "time.duration": 1.0}
    planned = plan(PAPER.with_values({**cell, "effects.contact_opening": True}), tmp_path / "study", repeats=1)
    result = measure(planned)
    _, middle, fine = (Record.load(planned.place(each)) for each in planned.references)
    # Its error is the distance to the run before
    assert result["reference"]["error_q"] == pytest.approx(relative_error(middle.q, fine.q), rel=1e-9)
    assert 0 < result["reference"]["error_q"] < rows(result, "time step")["0.125"]["error_q"]


def test_one_percent_is_seen_in_the_component_that_has_it(study: tuple[Path, dict[str, Any]]) -> None:
    best = reference_of(*study)
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
    _, result = study
    best = reference_of(*study)
    exact = trajectory("exact-lattice", wave_of(best), best.tau)
    # The exact lattice is integrated to 1e-9 or so; rounding of the run is of the size of the error of q here
    truth = relative_error(best.p, exact[0])
    assert truth < 1e-6
    # The distance of two extrapolations is 1 time the error where that is of first order and 15 times where of fourth
    assert truth / 1.5 < result["reference"]["error_p"] < 15 * 1.5 * truth


def test_the_tables_say_the_same(study: tuple[Path, dict[str, Any]]) -> None:
    folder, result = study
    assert json.loads((folder / "cost.json").read_text()) == result
    with (folder / "cost.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    points = [{key: "" if value is None else str(value) for key, value in row.items()} for row in result["points"]]
    assert table == points


def test_the_fastest_setting_of_an_accuracy_is_recommended(study: tuple[Path, dict[str, Any]]) -> None:
    result = study[1]
    known = {row["options"]: largest(row)[0] for row in result["points"]}
    middle = sorted(known.values())[len(known) // 2]
    words, options = recommended(result, middle).splitlines()
    assert words.startswith(f"for an error of at most {middle:g} the fastest is ")
    assert known[options] <= middle
    fastest = min((row for row in result["points"] if known[row["options"]] <= middle), key=lambda row: row["seconds"])
    assert options == fastest["options"]
    assert recommended(result, 1e-15) == "no measured setting has an error of at most 1e-15"
    assert recommended({"reference": None, "points": []}, 1.0) == "no measured setting has an error of at most 1"


def test_the_options_of_a_setting_give_its_run(small: Scene) -> None:
    there = base(small.with_values({"time.tolerance": 1e-2}))
    made = settings(prepare(there))[0]
    for setting in made:
        changes = dict(map(assignment, setting.options.removeprefix("--set ").split(" --set ")))
        declared = small.with_values({"time.tolerance": 1e-2}).with_values(changes)
        assert scene_hash(base(declared)) == scene_hash(base(setting.run))
        assert scene_hash(there.with_values(changes)) == scene_hash(setting.run)


# --- settings ---


def test_what_a_scene_cannot_have_is_left_out_with_the_reason(small: Scene) -> None:
    long = {"packing.rows": 4_000, "packing.columns": 3, "wave.amplitude": 1e-5, "wave.mode": "L"}
    made, refused = settings(prepare(small.with_values(long)))
    assert "must be at least" in refused["tolerance: 1e-06"]  # rounding
    assert "1e-06" not in {setting.name for setting in made}


def test_the_reference_is_finer_than_every_step_of_the_settings(small: Scene) -> None:
    problem = prepare(small)
    finest = min(each.run.time.step for each in settings(problem)[0] if each.varied == "time step")
    assert [each.run.time.step for each in references(problem)] == [finest / 2**k for k in (1, 2, 3)]


# --- running ---


def counted(monkeypatch: pytest.MonkeyPatch, stop_after: int = 10**9) -> list[str]:
    """Names of the runs that are really done; Ctrl-C comes in the one after `stop_after`."""
    done: list[str] = []
    real = module.run

    def run_one(scene: Scene, folder: Path, **options: Any) -> Record:
        if len(done) == stop_after:
            raise KeyboardInterrupt
        done.append(folder.parent.name)
        return real(scene, folder, **options)

    monkeypatch.setattr(module, "run", run_one)
    return done


def test_rounds_take_turns_and_asked_again_nothing_is_done_twice(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = counted(monkeypatch)
    first = measure(plan(small, tmp_path / "study", repeats=2))
    assert len(done) == 2 * 3 + 3  # three steps; the reference once
    again = plan(small, tmp_path / "study", repeats=2)
    assert again.todo() == {}
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
        with pytest.raises(RunInterrupted, match="5 of 9 runs are finished and kept; the same command"):
            measure(plan(small, tmp_path / "study", repeats=2))
    half = json.loads((tmp_path / "study" / "cost.json").read_text())
    assert sum(row["repeats"] for row in half["points"]) == 2
    after = counted(monkeypatch)
    result = measure(plan(small, tmp_path / "study", repeats=2))
    assert len(after) == 9 - len(done)
    assert {row["repeats"] for row in result["points"]} == {2}


def test_a_run_that_was_cut_off_is_done_from_its_start(few: None, small: Scene, tmp_path: Path) -> None:
    planned = plan(small, tmp_path / "study", repeats=1)
    folder, one = list(planned.todo().items())[-1]
    record = run(one.run, folder)
    write_status(folder, record.info | {"status": "interrupted", "wall_seconds": {"total": 99.0, "loop": 99.0}})
    measure(planned)
    assert read_status(folder)["status"] == "finished"
    assert read_status(folder)["wall_seconds"]["total"] < 99  # nothing of the time before is counted


FailWith = Callable[[GranularError | None], None]


@pytest.fixture
def fail_with(monkeypatch: pytest.MonkeyPatch) -> FailWith:
    """Let the runs with the step 0.25 raise an error; with None they are run again."""
    real = module.run

    def patch(error: GranularError | None) -> None:
        def run_one(scene: Scene, folder: Path, **options: Any) -> Record:
            if error is not None and scene.time.step == 0.25:
                raise error
            return real(scene, folder, **options)

        monkeypatch.setattr(module, "run", run_one)

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
    failed = {f"{row['varied']} {row['setting']}": row["message"] for row in result["points"] if not row["repeats"]}
    assert failed == {"time step 0.25": "LAMMPS failed at 'run 1': for the test"}
    status, out, _ = cli(capsys, "cost", str(small_toml), "-o", str(tmp_path / "study"), "--repeats", "1")
    assert (status, out.count("LAMMPS failed at 'run 1'")) == (1, 1)
    fail_with(None)
    again = measure(plan(small, tmp_path / "study", repeats=1))
    assert [row["message"] for row in again["points"] if row["message"]] == []


def test_a_tolerance_that_is_not_met_is_an_answer_and_no_failure() -> None:
    assert not failed({"varied": "tolerance", "message": "time.tolerance = 1e-09: not met"})
    assert failed({"varied": "time step", "message": "LAMMPS failed"})
    assert not any(failed({"varied": "time step", "message": message}) for message in ("", NOT_RUN))


def test_a_reference_that_fails_is_raised(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise LammpsError("for the test", "run 1", "")

    monkeypatch.setattr(module, "run", fail)
    with pytest.raises(LammpsError, match="for the test"):
        measure(plan(small, tmp_path / "study", repeats=1))
    assert json.loads((tmp_path / "study" / "cost.json").read_text())["reference"] is None


# --- budget ---


def test_a_budget_leaves_the_longest_runs_for_another_call(
    few: None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planned = plan(small, tmp_path / "study", repeats=1)
    clock = [0.0]
    real = module.run

    def run_one(scene: Scene, folder: Path, **options: Any) -> Record:
        clock[0] += scene.time.steps
        return real(scene, folder, **options)

    monkeypatch.setattr(module, "monotonic", lambda: clock[0])
    monkeypatch.setattr(module, "run", run_one)
    # 224 steps of the reference, then 4 and 8; the run of 16 steps would begin at 236 s
    result = measure(planned, budget=235)
    assert clock[0] == 236
    assert [row["setting"] for row in result["points"] if row["message"] == NOT_RUN] == ["0.125"]
    assert text(result).count(NOT_RUN) == 1
    result = measure(planned, budget=235)  # which has a budget of its own
    assert [row["repeats"] for row in result["points"]] == [1] * 3


# --- folder and command line ---


def test_a_folder_of_something_else_is_refused(small: Scene, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    with pytest.raises(RunFolderError, match="exists already; choose another folder"):
        plan(small, tmp_path)
    planned = plan(small, tmp_path / "study", repeats=1)
    measure(replace(planned, settings=[]))
    with pytest.raises(RunFolderError, match="holds a study of another scene, small"):
        plan(small.with_values({"wave.amplitude": 0.1}), tmp_path / "study")


@pytest.mark.parametrize("text", ["{", "{}", "[]", '{"scene": 1}'])
def test_a_damaged_table_is_refused_by_its_name(text: str, small: Scene, tmp_path: Path) -> None:
    (tmp_path / "cost.json").write_text(text)
    with pytest.raises(RunFolderError, match=r"cost\.json: cannot be read"):
        plan(small, tmp_path)


def test_the_command_says_how_many_runs_and_what_they_took(
    few: None, small_toml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("cost", str(small_toml), "-o", str(tmp_path / "study"), "--repeats", "1")
    status, out, _ = cli(capsys, *words)
    assert status == 0
    assert out.startswith("small: 3 settings, 6 runs\n")
    header, *lines = out.splitlines()[1:-1]
    column = header.index("rounds") + len("rounds")
    assert {line[:column].split()[-1] for line in lines} == {"1"}


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
    assert "the same command does the rest" in err
    assert json.loads((tmp_path / "study" / "cost.json").read_text())["points"]


def test_a_crystal_keeps_its_size_in_every_setting() -> None:
    changes = {"packing.rows": 8, "packing.columns": 6, "packing.ends": "periodic", "disorder.radius": 5e-5}
    scene = base(PAPER.with_values(changes | {"wave.wavenumber": np.pi / 4, "time.duration": 2.0}))
    made, refused = settings(prepare(scene))
    assert refused == {}
    assert {setting.varied for setting in made} == GROUPS
    assert {setting.run.shape for setting in made} == {scene.shape}


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("wave", [{"wave.form": "standing"}, {"wave.direction": 0.0, "packing.columns": 8}])
def test_other_waves_have_a_study_too(wave: dict[str, Any], tmp_path: Path) -> None:
    cell = {"packing.rows": 8, "packing.ends": "periodic", "wave.wavenumber": np.pi / 4, "time.duration": 1.0}
    result = measure(plan(PAPER.with_values(cell | wave), tmp_path / "study", repeats=1))
    assert slopes(rows(result, "time step")) == pytest.approx([-2] * 2, abs=0.1)


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
    assert not any("error_spin" in row for row in found.values())  # nothing turns a sphere of a chain


def test_a_tolerance_is_met(struck: tuple[Path, dict[str, Any]]) -> None:
    _, result = struck
    for tolerance, row in rows(result, "tolerance").items():
        assert row["error_velocity"] < float(tolerance)


def test_the_size_of_a_scene_without_a_wave_is_no_setting(struck: tuple[Path, dict[str, Any]]) -> None:
    folder, result = struck
    assert {row["varied"] for row in result["points"]} == GROUPS
    with (folder / "cost.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert [float(line["error_velocity"]) for line in table] == [row["error_velocity"] for row in result["points"]]
    assert "velocity" in text(result).splitlines()[0]
    assert plan(CHAIN, folder, repeats=1).todo() == {}  # the same study is done
