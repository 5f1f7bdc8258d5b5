"""Run folders: what they may be called, who holds them, and that nothing of an earlier run is left behind."""

import errno
import fcntl
import os
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest

from granular_lmp import Scene, build
from granular_lmp.accuracy.tolerance import resume, run
from granular_lmp.cli import main
from granular_lmp.errors import RunFolderError, RunInterrupted, SceneError
from granular_lmp.lammps.outputs import COST, SWEEP
from granular_lmp.runs import folder as folder_module
from granular_lmp.runs.folder import clear, is_held, locked
from granular_lmp.runs.record import Record, read_status, write_status
from granular_lmp.scene.collision import Collision
from granular_lmp.scene.schema import LONGEST_NAME
from granular_lmp.studies.collide import run as collide
from granular_lmp.studies.kick import kicked
from granular_lmp.studies.sweep import sweep

Action = Callable[[Scene, Path], object]


def to_tolerance(scene: Scene, folder: Path) -> None:
    changes = {"time.tolerance": 1e-2, "output.particles": 1.0, "name": "close"}
    run(scene.with_values(changes), folder, force=True)


def kick(scene: Scene, folder: Path) -> None:
    run(kicked(scene.with_values({"name": "kicked", "time.duration": 4.0})), folder, force=True)


def once(scene: Scene, folder: Path) -> None:
    run(scene, folder, force=True)


def interrupt(step: int, steps: int) -> None:
    """Stop a run after its first step: before it, as a busy machine may report, there is nothing to be continued."""
    if step > 0:
        raise KeyboardInterrupt


def stop(scene: Scene, folder: Path) -> None:
    """Interrupt a run, which leaves a checkpoint; the run that continues it, interrupted too, its own input."""
    long = scene.with_values({"time.duration": 1e5})
    with pytest.raises(RunInterrupted):
        run(long, folder, force=True, progress=interrupt)
    with pytest.raises(RunInterrupted):
        resume(folder, progress=interrupt)
    assert (folder / f"in.{scene.name}.resume").exists()


def impact(scene: Scene, folder: Path) -> None:
    collide(Collision.load("test2"), folder, force=True)


def names(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


KINDS = [once, to_tolerance, kick, impact]
# Each kind of run that was there, and each that comes
PAIRS = [(once, to_tolerance), (to_tolerance, impact), (impact, kick), (kick, once), (stop, once)]


@pytest.mark.parametrize(
    ("first", "second"),
    [
        pytest.param(first, second, marks=() if (first, second) in PAIRS else pytest.mark.more)
        for first in (*KINDS, stop)
        for second in KINDS
    ],
)
def test_nothing_of_the_old_run_and_all_of_the_user_is_left(
    first: Action, second: Action, small: Scene, tmp_path: Path
) -> None:
    second(small, tmp_path / "alone")
    first(small.with_values({"name": "earlier"}), tmp_path / "run")
    (tmp_path / "run" / "compare.png").touch()  # as `granular_analysis.tools.compare` leaves it
    notes = {"notes.txt", "in.mine", "data.mine", "1_per_sample", "1_per_sample/notes.txt", "my_per_sample"}
    for folder in ("1_per_sample", "my_per_sample"):
        (tmp_path / "run" / folder).mkdir(exist_ok=True)
    for name in notes - {"1_per_sample", "my_per_sample"}:
        (tmp_path / "run" / name).touch()
    second(small, tmp_path / "run")
    assert names(tmp_path / "run") == names(tmp_path / "alone") | notes


@pytest.mark.parametrize("study", [SWEEP, COST])
def test_a_study_is_never_the_old_run(study: str, small: Scene, tmp_path: Path) -> None:
    (tmp_path / study).touch()
    before = names(tmp_path)
    for action in KINDS:
        with pytest.raises(RunFolderError, match=rf"holds a \w+( study)? \({study}\); choose another folder"):
            action(small, tmp_path)
    assert names(tmp_path) == before


def test_a_sweep_takes_the_folder_of_a_run_over(small: Scene, tmp_path: Path) -> None:
    once(small, tmp_path)
    sweep(small, {"wave.phase": [0.0]}, tmp_path, force=True)
    assert {path.name for path in tmp_path.iterdir()} == {"sweep.json", "sweep.csv", "runs"}


def test_a_scene_that_names_files_elsewhere_deletes_none_of_them(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "x").touch()
    (tmp_path / "run" / "in.").mkdir()
    (tmp_path / "run" / "scene.toml").write_text('name = "/../../x"\n')
    clear(tmp_path / "run")
    assert (tmp_path / "x").exists()


@pytest.mark.parametrize("name", ["n" * 256, "/".join(["n" * 200] * 20), "ü" * 128])
def test_a_folder_with_a_name_that_is_too_long_is_refused_before_it_is_made(
    name: str, small: Scene, tmp_path: Path
) -> None:
    for action in KINDS:
        with pytest.raises(RunFolderError, match=r"folder \(-o\) = '.{,57}\.\.\.: must be at most \d+ bytes long"):
            action(small, tmp_path / "new" / name)
    assert names(tmp_path) == set()


def test_the_longest_names_allowed_can_be_run(small: Scene, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"name = 'n+\.\.\.: must be a string of at most 200 ASCII letters"):
        small.with_values({"name": "n" * (LONGEST_NAME + 1)})
    longest = small.with_values({"name": "n" * LONGEST_NAME})
    folder = tmp_path
    while len(str(folder)) < 3300:
        folder = folder / ("d" * 200)
    stop(longest, folder)
    to_tolerance(longest, folder)
    assert sweep(longest, {"wave.phase": [0.0]}, folder / "sweep").rows[0]["status"] == "finished"


def test_a_disk_that_fills_up_fails_the_run_and_leaves_no_part_of_a_file(
    small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    replace, done = os.replace, []

    def full(*paths: Path) -> None:
        if done:  # after the first run.json
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        done.append(replace(*paths))

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(RunFolderError, match="cannot be written: No space left on device"):
        run(small, tmp_path / "run")
    assert read_status(tmp_path / "run")["status"] == "interrupted"  # as a run that was killed
    assert not list((tmp_path / "run").glob("*.part"))


def test_a_run_that_was_killed_is_told_from_one_that_is_at_work(small: Scene, tmp_path: Path) -> None:
    once(small, tmp_path / "run")
    write_status(tmp_path / "run", Record.load(tmp_path / "run").info | {"status": "running", "message": "started"})
    with locked(tmp_path / "run"):
        assert is_held(tmp_path / "run")
        assert read_status(tmp_path / "run")["status"] == "running"
    assert not is_held(tmp_path / "run")
    assert read_status(tmp_path / "run")["status"] == "interrupted"
    with pytest.raises(RunFolderError, match="status 'interrupted': killed: run.json says that it runs"):
        Record.load(tmp_path / "run")


@pytest.mark.parametrize("missing", [errno.ENOLCK, errno.EOPNOTSUPP])
def test_a_file_system_without_locks_keeps_runs_of_this_machine_apart(
    missing: int, small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    real, folder = fcntl.flock, tmp_path / "run"

    def without_folders(descriptor: int, operation: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(missing, os.strerror(missing))
        real(descriptor, operation)

    monkeypatch.setattr(fcntl, "flock", without_folders)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(folder_module, "_without_locks", set())
    run(small, folder)
    risk = "two machines that run in one folder at the same time would mix their files"
    assert [record.message for record in caplog.records] == [f"{folder}: has no locks ({os.strerror(missing)}): {risk}"]
    with locked(folder) as descriptor:
        assert not os.get_inheritable(descriptor)
        with pytest.raises(RunFolderError, match="another run is in progress there"), locked(folder):
            pass
    assert not is_held(folder)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    with pytest.raises(
        RunFolderError, match=f"^{folder}: cannot be locked: .*; name a folder of a local disk in TMPDIR$"
    ):
        run(small, folder, force=True)


def test_an_interrupted_run_names_the_command_that_continues_it(small: Scene, tmp_path: Path) -> None:
    folder = tmp_path / "my run"
    for changes in ({"time.duration": 1e5}, {"time.duration": 1e5, "time.tolerance": 1e-2}):
        with pytest.raises(RunInterrupted) as stopped:
            run(small.with_values(changes), folder, force=True, progress=interrupt)
        assert str(stopped.value).endswith(f"continue with: granular-lmp resume '{folder}'")
        assert read_status(folder)["message"] == str(stopped.value)


def test_build_leaves_nothing_of_a_run(small: Scene, tmp_path: Path, small_toml: Path) -> None:
    to_tolerance(small, tmp_path / "run")
    assert main(["build", str(small_toml), "-o", str(tmp_path / "run"), "--force"]) == 0
    assert names(tmp_path / "run") == set(build(small).files())


def test_a_sweep_is_resumed_by_its_own_command(small: Scene, tmp_path: Path) -> None:
    sweep(small, {"wave.phase": [0.0]}, tmp_path / "sweep")
    with pytest.raises(RunFolderError, match="holds a sweep; repeat its sweep command to run what is missing"):
        resume(tmp_path / "sweep")
