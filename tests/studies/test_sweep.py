"""Sweeps: what is asked for is checked first, each run is made once, what goes wrong is said and stays alone."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import nullcontext
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.stepping import NetworkEngine
from granular_lmp import Record, Scene, run
from granular_lmp.errors import GranularError, LammpsError, RunFolderError, RunInterrupted, SceneError
from granular_lmp.lammps.deck import deck_of
from granular_lmp.lammps.outputs import CHECKPOINTS
from granular_lmp.problem import Problem
from granular_lmp.runs import launch, routes
from granular_lmp.runs.folder import locked
from granular_lmp.runs.options import Options
from granular_lmp.runs.record import read_status, write_status
from granular_lmp.runs.simulation import Simulation
from granular_lmp.studies.executors import Workers
from granular_lmp.studies.sweep import Sweep, run_point, sweep
from granular_lmp.studies.sweep_points import axes, axis, scene_hash
from granular_lmp.studies.sweep_rows import units_of
from tests.cli.test_cli import cli
from tests.conftest import members

module = sys.modules["granular_lmp.studies.sweep"]
ROOT = Path(__file__).parents[2]
TWO = {"wave.amplitude": [0.1, 0.2]}
HERE = NetworkEngine.on("cpu")
ENGINES = {"LAMMPS": None, "network": HERE}


# ---------------------------------------------------------------- what is asked for


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("wave.wavenumber=0.05:3.1:62", [round(0.05 * k, 2) for k in range(1, 63)]),  # the doubles next to the decimals
        ("wave.wavenumber=3:1:3", [3, 2, 1]),
        ("packing.rows=8:16:5", [8, 10, 12, 14, 16]),
        ("wave.phase=0:1:3", [0.0, 0.5, 1.0]),
        ("wave.amplitude=0.02,2e-1, 1", [0.02, 0.2, 1]),
        ("wave.wavenumber=0.1:0.2:2,3.0", [0.1, 0.2, 3.0]),
        ("wave.mode=TR,RT,L", ["TR", "RT", "L"]),
        ('wave.mode="TR"', ["TR"]),
        ("time.allow_echo=true,false", [True, False]),
        ("wave.wavevector=[0.5, 1.0],[1, 0.5]", [[0.5, 1.0], [1, 0.5]]),
    ],
)
def test_values_are_read_as_they_are_written(text: str, values: list[Any]) -> None:
    key, found = axis(text)
    assert key == text.partition("=")[0]
    assert found == values
    assert list(map(type, found)) == list(map(type, values))


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["wave.wavenumber"], "'wave.wavenumber': must be KEY=VALUES, for instance"),
        (["=1,2"], "'=1,2': must be KEY=VALUES"),
        (["wave.wavenumber=1,,2"], "must be KEY=VALUES"),
        (["wave.wavenumber=1:2"], "'1:2' must be FIRST:LAST:COUNT, three numbers"),
        (["wave.wavenumber=1:x:3"], "'1:x:3' must be FIRST:LAST:COUNT"),
        (["wave.wavenumber=1:1e999:3"], "'1:1e999:3' must be FIRST:LAST:COUNT"),
        (["wave.wavenumber=1:2:1"], "must have a COUNT from 2 to"),
        (["wave.phase=1,2", "wave.phase=3"], "wave.phase: is swept over twice"),
    ],
)
def test_a_text_that_is_no_list_of_values_is_refused(texts: list[str], message: str) -> None:
    with pytest.raises(SceneError) as caught:
        axes(texts)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ({"wave.wavenumer": [1.0]}, "wave.wavenumer: unknown key; did you mean 'wavenumber'?"),
        ({"wave.amplitude": [0.1, -1.0]}, "wave.amplitude = -1.0: must be"),
        ({"wave.amplitude": [0.1], "wave.mode": ["TR", "S"]}, "wave.mode = 'S': must be"),
        ({"wave.amplitude": [float("nan")]}, "wave.amplitude = nan: must be"),
        ({"wave.amplitude": [[0.1]]}, "wave.amplitude = [0.1]: must be"),
        ({"packing.rows": [8, 9]}, "(in the sweep at packing.rows = 9)"),  # a check of the scene as a whole
        ({"wave.amplitude": []}, "wave.amplitude: there is no value to sweep over"),
        ({}, "there is no value to sweep over"),
        ({"name": ["a", "b"]}, "name = 'a': cannot be swept over"),
        ({"wave.phase": range(1000), "wave.amplitude": range(1000)}, "1000000 runs; at most 100000"),
    ],
)
def test_what_does_not_fit_is_one_error_before_anything_is_written(
    over: dict[str, Any], message: str, small: Scene, tmp_path: Path
) -> None:
    with pytest.raises(SceneError) as caught:
        sweep(small, over, tmp_path / "sweep")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "sweep").exists()


def test_the_name_of_a_run_is_made_of_all_that_the_scene_says_but_its_name(small: Scene) -> None:
    assert scene_hash(small) == scene_hash(Scene.loads(small.to_toml())) == scene_hash(small.with_values({"name": "b"}))
    assert scene_hash(small) == scene_hash(small.with_values({"time.duration": 2}))  # TOML writes 2 for 2.0
    changes = {
        "wave.phase": 1e-15,
        "wave.mode": "L",
        "packing.rows": 10,
        "time.allow_echo": True,
        "sphere.density": 1.0,
    }
    hashes = {scene_hash(small.with_values({key: value})) for key, value in changes.items()}
    assert len(hashes | {scene_hash(small)}) == len(changes) + 1


# ---------------------------------------------------------------- runs


STRUCK = Scene.load("solitary_chain").with_values({"packing.rows": 8, "time.duration": 8.0, "time.sample": 0.25})


@pytest.fixture(params=ENGINES)
def engine(request: pytest.FixtureRequest) -> NetworkEngine | None:
    """What takes the steps in place of LAMMPS."""
    return ENGINES[request.param]


@pytest.fixture(params=["wave", "strike"])
def swept(
    request: pytest.FixtureRequest, engine: NetworkEngine | None, small: Scene, tmp_path: Path
) -> tuple[Scene, str, Sweep]:
    """A scene of each kind, the key that is swept over, and its sweep over two values of it and of the sample."""
    scene, key = {"wave": (small, "wave.amplitude"), "strike": (STRUCK, "striker.1.velocity")}[request.param]
    over = {key: np.array([0.1, 0.2]), "time.sample": [scene.time.sample, 2 * scene.time.sample]}
    return scene, key, sweep(scene, over, tmp_path / "sweep", engine=engine)


def test_a_run_of_a_sweep_is_the_run_of_its_scene(
    swept: tuple[Scene, str, Sweep], engine: NetworkEngine | None, tmp_path: Path
) -> None:
    scene, key, done = swept
    one, two = scene.time.sample, 2 * scene.time.sample
    points = [(row[key], row["time.sample"]) for row in done.rows]
    assert points == [(0.1, one), (0.1, two), (0.2, one), (0.2, two)]  # the last key runs fastest
    alone = run(scene.with_values({key: 0.2, "time.sample": two}), tmp_path / "alone", engine=engine)
    row = done.rows[3]
    assert row["run"] == f"runs/{scene_hash(alone.scene)}"
    for dump in (tmp_path / "alone").glob("dump.*"):
        assert dump.read_bytes() == (tmp_path / "sweep" / row["run"] / dump.name).read_bytes()
    assert done.record(row).scene == alone.scene
    assert (row["status"], row["guards"]) == ("finished", "")
    assert (row["steps"], row["particles"]) == (alone.info["steps"], alone.info["particles"])
    if scene.wave is None:
        assert (row["t0_s"], row["velocity_m_s"]) == (alone.scale.time, 0.2)
    else:
        assert row["largest_p"] == np.abs(alone.p).max()
        assert row["frequency"] == alone.info["frequency"]


def test_the_folder_and_its_table_say_what_was_returned(
    swept: tuple[Scene, str, Sweep], engine: NetworkEngine | None, tmp_path: Path
) -> None:
    scene, key, done = swept
    names = {"sweep.json", "sweep.csv", "runs"}
    assert {path.name for path in (tmp_path / "sweep").iterdir()} == names
    again = Sweep.load(tmp_path / "sweep")
    assert again == done
    with (tmp_path / "sweep" / "sweep.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert list(table[0]) == [*done.over, *units_of(scene)]
    for name in done.main_columns:
        numbers = [float(line[name]) if line[name] else None for line in table]
        assert numbers == [row[name] for row in done.rows]
    asked = json.loads((tmp_path / "sweep" / "sweep.json").read_text())
    over = {key: [0.1, 0.2], "time.sample": [scene.time.sample, 2 * scene.time.sample]}
    by = {} if engine is None else {"device": engine.device}
    assert asked == {"over": over, "scene": json.loads(json.dumps(scene.given()))} | by


def test_a_sweep_is_shown_in_one_short_line(small: Scene, tmp_path: Path) -> None:
    done = sweep(small, {"wave.phase": np.linspace(0, 1, 3)}, tmp_path / "sweep")
    assert repr(done) == f"<Sweep {tmp_path / 'sweep'}: wave.phase (3); 3 finished, 0 failed, 0 unfinished>"


def test_no_run_is_made_twice(small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Scene] = []

    def counted(scene: Scene, *arguments: Any, **options: Any) -> Record:
        made.append(scene)
        return run(scene, *arguments, **options)

    monkeypatch.setattr(module, "run", counted)
    sweep(small, {"wave.amplitude": [0.1, 0.2, 0.1]}, tmp_path / "sweep")
    assert len(made) == 2
    sweep(small, {"wave.amplitude": [0.1, 0.2, 0.1]}, tmp_path / "sweep")
    assert len(made) == 2
    shutil.rmtree(tmp_path / "sweep" / "runs" / scene_hash(made[0]))
    sweep(small, {"wave.amplitude": [0.1, 0.2, 0.1]}, tmp_path / "sweep")
    assert made[2:] == made[:1]


def failing(monkeypatch: pytest.MonkeyPatch, error: Exception, amplitude: float = 0.1) -> None:
    """Let the deck of one amplitude raise `error`."""

    def broken(problem: Problem) -> Any:
        if problem.scene.wave.amplitude == amplitude:
            raise error
        return deck_of(problem)

    monkeypatch.setattr(launch, "deck_of", broken)


BROKE = (LammpsError("it broke", "run 40", ""), "LAMMPS failed at 'run 40': it broke")
NO_ROOM = (MemoryError("no room"), "MemoryError: no room")


@pytest.mark.parametrize(
    ("executor", "error", "message"),
    [
        (nullcontext, *BROKE),
        (ThreadPoolExecutor, *NO_ROOM),
        pytest.param(nullcontext, *NO_ROOM, marks=pytest.mark.more),
        pytest.param(ThreadPoolExecutor, *BROKE, marks=pytest.mark.more),
    ],
)
def test_a_failing_run_is_recorded_and_the_others_go_on(
    executor: Any, error: Exception, message: str, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        failing(patch, error)
        with executor() as runs:
            done = sweep(small, TWO, tmp_path / "sweep", executor=runs)
    assert list(done.column("status")) == ["failed", "finished"]
    assert done.rows[0]["message"] == message
    assert np.isnan(done.column("largest_q")).tolist() == [True, False]
    assert message in (tmp_path / "sweep" / "sweep.csv").read_text()
    assert "1 finished, 1 failed" in repr(done)
    again = sweep(small, TWO, tmp_path / "sweep")  # it is tried again
    assert list(again.column("status")) == ["finished", "finished"]


def test_a_run_that_lammps_fails_says_so_in_its_folder_too(
    small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ill(*arguments: Any, **named: Any) -> LammpsError:
        return LammpsError("it is ill", "run 40", "")

    monkeypatch.setattr(Simulation, "defect", ill)
    done = sweep(small, TWO, tmp_path / "sweep")
    assert {row["message"] for row in done.having("failed")} == {"LAMMPS failed at 'run 40': it is ill"}
    assert Sweep.load(tmp_path / "sweep") == done


def test_a_finished_run_whose_record_is_damaged_is_made_again(small: Scene, tmp_path: Path) -> None:
    done = sweep(small, TWO, tmp_path / "sweep")
    (tmp_path / "sweep" / done.rows[0]["run"] / "trajectory.csv").write_text("tau")
    damaged = Sweep.load(tmp_path / "sweep")
    assert list(damaged.column("status")) == ["failed", "finished"]
    assert "trajectory.csv: was changed since the run wrote it" in damaged.rows[0]["message"]
    again = sweep(small, TWO, tmp_path / "sweep")
    assert list(again.column("largest_q")) == list(done.column("largest_q"))


def test_a_run_that_was_cut_off_is_continued_to_the_same_bytes(
    engine: NetworkEngine | None, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(routes, "_POLL", 1e-3)
    scene = small.with_values({"time.duration": 20.0 if engine else 300.0})  # 6000 steps, a tenth of a second
    dumps = []
    for folder, cut in ((tmp_path / "cut", True), (tmp_path / "whole", False)):
        part = folder / "runs" / scene_hash(scene)
        if cut:
            with pytest.raises(RunInterrupted):
                run(scene, part, progress=interrupt, engine=engine)
            assert read_status(part)["status"] == "interrupted"
        continued: list[Path] = []
        monkeypatch.setattr(module, "resume", lambda *a, log=continued, **o: log.append(a[0]) or launch.resume(*a, **o))
        done = sweep(scene, {"wave.amplitude": [0.2]}, folder, force=cut, engine=engine)
        assert continued == ([part] if cut else [])
        assert len(done.having("finished")) == 1
        dumps.append((part / "dump.centre").read_bytes())
    assert dumps[0] == dumps[1]


def preempt(step: int, steps: int) -> None:
    """End the process as a batch system's library does, with a run on its way."""
    if 0 < step < steps:
        sys.exit(1)


def test_a_run_of_a_process_that_was_told_to_exit_is_interrupted_and_continued(
    small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(routes, "_POLL", 1e-3)
    scene = small.with_values({"time.duration": 300.0})
    part = tmp_path / "sweep" / "runs" / scene_hash(scene)
    with pytest.raises(SystemExit):
        run(scene, part, progress=preempt)
    assert read_status(part)["status"] == "interrupted"
    continued: list[Path] = []
    monkeypatch.setattr(module, "resume", lambda *a, **o: continued.append(a[0]) or launch.resume(*a, **o))
    assert len(sweep(scene, {"wave.amplitude": [0.2]}, tmp_path / "sweep", force=True).having("finished")) == 1
    assert continued == [part]


@pytest.mark.parametrize("checkpoint", [True, False])
def test_a_run_that_the_machine_failed_is_continued_where_it_has_a_checkpoint(
    checkpoint: bool, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(routes, "_POLL", 1e-3)
    scene = small.with_values({"time.duration": 300.0})
    part = tmp_path / "sweep" / "runs" / scene_hash(scene)
    with pytest.raises(RunInterrupted):
        run(scene, part, progress=interrupt)
    write_status(part, read_status(part) | {"status": "failed", "message": "the process of the run ended by signal 9"})
    for name in () if checkpoint else CHECKPOINTS:
        (part / name).unlink(missing_ok=True)
    began: list[Path] = []
    monkeypatch.setattr(module, "run", lambda *a, **o: began.append(a[1]) or run(*a, **o))
    assert len(sweep(scene, {"wave.amplitude": [0.2]}, tmp_path / "sweep", force=True).having("finished")) == 1
    assert began == ([] if checkpoint else [part])


def test_a_run_that_fails_from_its_checkpoint_again_is_begun_anew(
    small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    part = tmp_path / "run"
    part.mkdir()
    monkeypatch.setattr(module, "info_of", lambda folder: {"status": "failed"})
    monkeypatch.setattr(module, "resume", lambda *a, **o: (_ for _ in ()).throw(LammpsError("no", "run", "")))
    assert run_point(small, part, Options())["status"] == "finished"


def test_a_run_that_the_executor_refuses_fails_and_the_others_go_on(small: Scene, tmp_path: Path) -> None:
    class Full(ThreadPoolExecutor):
        taken = 0

        def submit(self, *arguments: Any, **named: Any) -> "Future[Any]":
            self.taken += 1
            if self.taken == 1:
                raise OSError("sbatch: error: Batch job submission failed: Job violates accounting/QOS policy")
            return super().submit(*arguments, **named)

    with Full(1) as executor:
        done = sweep(small, TWO, tmp_path / "sweep", executor=executor)
    assert sorted(done.column("status")) == ["failed", "finished"]
    assert "Batch job submission failed" in done.having("failed")[0]["message"]


def interrupt(step: int, steps: int) -> None:
    if steps / 10 < step < steps:  # later than the one step that loads the shear springs, which leaves no checkpoint
        raise KeyboardInterrupt


def test_a_stop_that_comes_after_the_last_step_lets_the_run_be_finished(
    small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def finished(scene: Scene, *arguments: Any, progress: Callable[[int, int], None], **options: Any) -> Record:
        record = run(scene, *arguments, **options)
        monkeypatch.setattr(module, "stop_requested", lambda: True)
        progress(40, 40)
        with pytest.raises(KeyboardInterrupt):
            progress(39, 40)
        return record

    monkeypatch.setattr(module, "run", finished)
    assert run_point(small, tmp_path / "run", Options())["status"] == "finished"


def test_progress_ends_with_all_runs_and_no_time_left(small: Scene, tmp_path: Path) -> None:
    said: list[tuple[int, int, float]] = []
    over = {"wave.phase": [0.1, 0.2, 0.3]}
    sweep(small, over, tmp_path / "sweep", progress=lambda *news: said.append(news))
    assert [news[:2] for news in said] == [(1, 3), (2, 3), (3, 3)]
    assert said[0][2] > 0
    assert said[2][2] == 0
    sweep(small, over, tmp_path / "sweep", progress=lambda *news: said.append(news))
    assert len(said) == 3  # there was nothing to do


# ---------------------------------------------------------------- engines


def test_a_sweep_is_continued_by_its_engine_alone(small: Scene, tmp_path: Path) -> None:
    folder = tmp_path / "sweep"
    ours = sweep(small, TWO, folder, engine=HERE)
    others = {"not LAMMPS": None, r"not the network \(cpu, NumPy\)": NetworkEngine.on("numpy")}
    others = {named: each for named, each in others.items() if each != HERE}  # without a compiler they are one
    for named, engine in others.items():
        with pytest.raises(RunFolderError, match=rf"holds a sweep by the network \(cpu, \w+\), .*{named}; choose"):
            sweep(small, TWO, folder, engine=engine)
    assert Sweep.load(folder) == ours
    theirs = sweep(small, TWO, folder, force=True)  # the runs of another engine are made again
    assert [theirs.record(row).info.get("device") for row in theirs.rows] == [None, None]
    # The places that LAMMPS rounds, in D0 (tests/measure/test_stepping.py)
    np.testing.assert_allclose(ours.column("largest_p"), theirs.column("largest_p"), rtol=0, atol=1e-9)
    with pytest.raises(RunFolderError, match="holds a sweep by LAMMPS"):
        sweep(small, TWO, folder, engine=HERE)


@pytest.mark.parametrize("clock", [{"time.timestep": 0.05}, {"time.tolerance": 1e-2}])
def test_a_point_that_the_engine_does_not_hold_is_refused_before_anything_is_written(
    clock: dict[str, float], small: Scene, tmp_path: Path
) -> None:
    scene = small.with_values({**clock, "effects.rolling_stiffness": 10.0, "effects.rolling_friction": 1.0})
    with pytest.raises(SceneError, match=r"effects\.rolling \(in the sweep at effects\.rolling = True\)"):
        sweep(scene, {"effects.rolling": [False, True]}, tmp_path / "sweep", engine=HERE)
    with pytest.raises(SceneError, match=r"effects\.rolling"):
        run(scene.with_values({"effects.rolling": True}), tmp_path / "run", engine=HERE)
    assert not list(tmp_path.iterdir())


def test_other_processes_have_the_device_of_the_engine(small: Scene, tmp_path: Path) -> None:
    pytest.importorskip("jax")
    engine = NetworkEngine.on("jax")
    with Workers(1) as executor:
        there = sweep(small, TWO, tmp_path / "there", executor=executor, engine=engine)
        another = sweep(small, TWO, tmp_path / "x", executor=executor, engine=HERE)
    here = sweep(small, TWO, tmp_path / "here", engine=engine)
    assert without_seconds(there) == without_seconds(here)
    assert len(another.having("finished")) == 2


# ---------------------------------------------------------------- folders


def test_another_sweep_is_not_overwritten_unless_forced(small: Scene, tmp_path: Path) -> None:
    first = sweep(small, TWO, tmp_path / "sweep")
    for scene, over in ((small, {"wave.amplitude": [0.2, 0.3]}), (small.with_values({"wave.phase": 1.0}), TWO)):
        with pytest.raises(
            RunFolderError, match=r"holds another sweep, over wave.amplitude \(2\); choose another folder"
        ):
            sweep(scene, over, tmp_path / "sweep")
    assert Sweep.load(tmp_path / "sweep") == first
    second = sweep(small, {"wave.amplitude": [0.2, 0.3]}, tmp_path / "sweep", force=True)
    assert second.rows[0] == first.rows[1]  # kept and used, not made again
    assert Sweep.load(tmp_path / "sweep") == second


def test_a_folder_that_is_there_is_left_alone_unless_forced(small: Scene, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("keep")
    with pytest.raises(RunFolderError, match="exists already; choose another folder or say force=True"):
        sweep(small, TWO, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    sweep(small, TWO, tmp_path, force=True)
    assert (tmp_path / "mine.txt").read_text() == "keep"


def test_the_table_of_another_sweep_is_gone_before_the_first_run(small: Scene, tmp_path: Path) -> None:
    sweep(small, {"wave.amplitude": [0.1]}, tmp_path / "sweep")
    there: list[bool] = []

    def look(*_: object) -> None:
        there.append((tmp_path / "sweep" / "sweep.csv").exists())

    sweep(small, {"wave.amplitude": [0.2]}, tmp_path / "sweep", force=True, progress=look)
    assert there == [False]


def test_two_sweeps_do_not_share_a_folder(small: Scene, tmp_path: Path) -> None:
    with locked(tmp_path / "sweep", make=True), pytest.raises(RunFolderError, match="another run is in progress there"):
        sweep(small, TWO, tmp_path / "sweep")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "not a sweep folder"),
        ("{", "cannot be read"),
        ('{"over": 1, "scene": {}}', "must be JSON objects"),
        ('{"over": {"wave.mode": 1}, "scene": {}}', "the values of over must be lists"),
    ],
)
def test_what_is_no_sweep_folder_is_refused(text: str | None, message: str, tmp_path: Path) -> None:
    if text is not None:
        (tmp_path / "sweep.json").write_text(text)
    with pytest.raises(RunFolderError, match=message):
        Sweep.load(tmp_path)


# ---------------------------------------------------------------- executors


class Bare:
    """Not of `concurrent.futures` at all: what it returns has done, result and cancel, as submitit's jobs."""

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Any:
        class Job:
            done = staticmethod(lambda: True)
            result = staticmethod(lambda: function(*arguments))
            cancel = staticmethod(lambda: None)

        return Job()


EXECUTORS: dict[str, Callable[[], Any]] = {
    "workers": lambda: Workers(2),
    "threads": lambda: ThreadPoolExecutor(2),
    "spawned processes": lambda: ProcessPoolExecutor(1, mp_context=get_context("spawn")),
}


# The command below has workers
@pytest.mark.parametrize("kind", members(EXECUTORS, "workers", "spawned processes"))
def test_every_executor_gives_the_same_table(kind: str, small: Scene, tmp_path: Path) -> None:
    alone = sweep(small, TWO, tmp_path / "alone")
    with EXECUTORS[kind]() as executor:
        done = sweep(small, TWO, tmp_path / "other", executor=executor)
    assert without_seconds(done) == without_seconds(alone)


def test_what_is_not_of_the_standard_library_needs_three_methods(small: Scene, tmp_path: Path) -> None:
    done = sweep(small, TWO, tmp_path / "sweep", executor=Bare())
    assert list(done.column("status")) == ["finished", "finished"]


def test_dask_runs_a_sweep(small: Scene, tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.Client(n_workers=1, threads_per_worker=1, dashboard_address=None) as client:
        done = sweep(small, TWO, tmp_path / "sweep", executor=client.get_executor())
    assert list(done.column("status")) == ["finished", "finished"]


def test_the_ranks_of_mpi4py_run_a_sweep(small_toml: Path, tmp_path: Path) -> None:
    pytest.importorskip("mpi4py")
    mpiexec = shutil.which("mpiexec", path=str(Path(sys.executable).parent)) or "mpiexec"
    words = [
        "sweep",
        str(small_toml),
        "--over",
        "wave.amplitude=0.1,0.2",
        "-o",
        str(tmp_path / "s"),
        "--workers",
        "mpi",
    ]
    command = [mpiexec, "-n", "2", sys.executable, "-m", "mpi4py.futures", "-m", "granular_lmp", *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert "2 of 2 runs finished" in done.stdout


def without_seconds(done: Sweep) -> list[dict[str, Any]]:
    return [row | {"seconds": None} for row in done.rows]


# ---------------------------------------------------------------- the command


def test_the_command_sweeps_and_goes_on(small_toml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(tmp_path / "sweep")
    words = ["sweep", str(small_toml), "--over", "wave.amplitude=0.1:0.2:2", "--over", "wave.mode=TR,L", "-o", folder]
    status, out, err = cli(capsys, *words, "--workers", "2")
    assert (status, err) == (0, "")
    assert out == f"{folder}: 4 of 4 runs finished; {folder}/sweep.csv\n"
    broken = tmp_path / "sweep" / Sweep.load(folder).rows[1]["run"]
    shutil.rmtree(broken)
    broken.write_text("in the way")
    status, out, err = cli(capsys, *words)
    assert status == 1
    assert err.startswith("failed: wave.amplitude = 0.1, wave.mode = 'L': ")
    assert len(err.splitlines()) == 1
    assert "3 of 4 runs finished" in out
    broken.unlink()
    assert cli(capsys, *words)[0] == 0


@pytest.mark.parametrize(
    ("own", "key"),
    [
        ({"wave.amplitude": None}, "wave.amplitude=0.1,0.2"),
        pytest.param({"wave.amplitude": -1}, "wave.amplitude=0.1,0.2", marks=pytest.mark.more),
        ({"time.timestep": 2.0, "time.sample": 2.0}, "time.timestep=0.5,0.25"),  # 2 is a scene whose run is refused
    ],
)
def test_a_scene_is_not_refused_for_the_key_that_is_swept(
    own: dict[str, float | None], key: str, small: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, file = small.with_values({"wave.phase": 0.5}).to_toml(), tmp_path / "small.toml"
    for name, value in own.items():
        table, _, last = name.partition(".")
        text = re.sub(rf"^{last} = .*\n", "", text, flags=re.MULTILINE)
        text = text if value is None else text.replace(f"[{table}]", f"[{table}]\n{last} = {value}")
    file.write_text(text)
    assert cli(capsys, "check", str(file))[0] == 2
    words = ["sweep", str(file), "-o", str(tmp_path / "sweep"), "--over"]
    for _ in range(2):
        status, out, err = cli(capsys, *words, key)
        assert (status, err) == (0, "")
        assert "2 of 2 runs finished" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--over", "wave.wavenumer=1,2"], "wave.wavenumer: unknown key"),
        (["--over", "wave.wavenumber=1,9"], "wave.wavenumber = 9.0: must be"),
        (["--over", "wave.wavenumber"], "must be KEY=VALUES"),
        (["--over", "wave.phase=1", "--workers", "0"], "'0' must be a whole number"),
        ([], "the following arguments are required: --over"),
    ],
)
def test_bad_input_is_one_line_and_status_2(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, err = cli(capsys, "sweep", "tr_periodic", "-o", str(tmp_path / "sweep"), *words)
    assert status == 2
    assert message in err
    assert len(err.splitlines()) == 1 or err.startswith("usage: ")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("number", "times"), [(signal.SIGINT, 2), pytest.param(signal.SIGTERM, 1, marks=pytest.mark.more)]
)
def test_ctrl_c_stops_at_once_and_the_same_command_goes_on(
    number: int, times: int, small_toml: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "sweep"
    words = ["--over", "time.duration=2.0,1e6", "--workers", "2", "-o", str(folder)]  # the second would take an hour
    command = [sys.executable, "-m", "granular_lmp", "sweep", str(small_toml), *words]
    for _ in range(times):
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=ROOT, start_new_session=True) as process:
            wait_for(lambda: states(folder) == ["finished", "running"])
            os.killpg(process.pid, number)  # as a terminal does: the whole group hears it
            _, err = process.communicate(timeout=200)
        assert process.returncode == 130
        assert err.splitlines() == [
            f"granular-lmp: error: {folder}: interrupted; 1 of 2 runs are finished and kept; "
            "the same command does the rest"
        ]
        assert states(folder) == ["finished", "interrupted"]
    assert list(Sweep.load(folder).column("status")) == ["finished", "unfinished"]


def states(folder: Path) -> list[str]:
    """How the runs of a sweep stand, in the order of the alphabet."""
    found = []
    for path in folder.glob("runs/*"):
        try:
            found.append(read_status(path)["status"])
        except GranularError:
            continue
    return sorted(found)


def wait_for(happened: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 200
    while not happened():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_run_whose_process_is_killed_fails_and_the_others_go_on(small_toml: Path, tmp_path: Path) -> None:
    folder = tmp_path / "sweep"
    words = ["--over", "time.duration=1e6,2.0", "-o", str(folder)]  # the first would take an hour
    command = [sys.executable, "-m", "granular_lmp", "sweep", str(small_toml), *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=ROOT) as process:
        wait_for(lambda: states(folder) == ["running"])
        worker = [pid for pid in Path("/proc").glob("[0-9]*") if parent(pid) == process.pid]
        assert len(worker) == 1
        os.kill(int(worker[0].name), signal.SIGKILL)
        _, err = process.communicate(timeout=200)
    assert process.returncode == 1
    assert err.startswith("failed: time.duration = 1000000.0: the process of the run ended by signal 9 (")
    assert len(err.splitlines()) == 1
    assert list(Sweep.load(folder).column("status")) == ["failed", "finished"]


def parent(process: Path) -> int | None:
    try:
        return int((process / "stat").read_text().rsplit(")", 1)[1].split()[1])
    except (FileNotFoundError, ProcessLookupError):
        return None


# ---------------------------------------------------------------- run folders that stand for other points


def test_the_runs_of_a_sweep_with_a_tolerance_stand_for_their_points(small: Scene, tmp_path: Path) -> None:
    scene = small.with_values({"time.tolerance": 1e-2})
    sweep(scene, TWO, tmp_path / "sweep")
    assert [row["status"] for row in Sweep.load(tmp_path / "sweep").rows] == ["finished", "finished"]
