"""Nothing lies: what went wrong is in the exit status, in ``run.json``, and refused by `compare` unless forced."""

import errno
import fcntl
import io
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cases.figure3 import case as figure3
from granular_analysis.tools import compare
from granular_lmp import Record, Scene, build, run
from granular_lmp.accuracy.tolerance import run as run_any
from granular_lmp.cli import main
from granular_lmp.errors import EffectError, LammpsError, RunFolderError
from granular_lmp.lammps.checkpoints import SPEED
from granular_lmp.lammps.deck import deck_of
from granular_lmp.lammps.outputs import CHECKPOINTS, DUMP, STATUS
from granular_lmp.problem import Problem
from granular_lmp.runs import launch, loop, manifest
from granular_lmp.runs.folder import locked
from granular_lmp.runs.launch import resume
from granular_lmp.runs.record import TRAJECTORY, read_status, write_status
from granular_lmp.studies import sweep
from tests.conftest import members
from tests.instance import silent_lammps
from tests.pause import as_if_killed
from tests.stand_in import of_first_format

Edit = tuple[str, str]
END = "run ${steps}"
NAN = ("variable     vx atom v_D0*d_vx/v_t0", "variable     vx atom 1e300*v_D0*d_vx/v_t0")
LOST = (END, "run 10\ndelete_atoms group centre\nrun 30")
SLID = ("$(5.0*v_amplitude:%.17g)", "$(0.01*v_amplitude:%.17g)")
EARLY = (END, "run $(v_steps/2)")
DEAF = ("colname f_looks[1] v_slip", "colname f_looks[1] v_x")
STOPPED = (END, 'run 20\nprint "ERROR: none"\nlog none\nrun 20')


def broken(monkeypatch: pytest.MonkeyPatch, *edits: Edit) -> None:
    """Let runs build a deck with pieces of its text replaced."""

    def edited(problem: Problem) -> Any:
        deck = deck_of(problem)
        text = deck.input_text
        for old, new in edits:
            assert old in text
            text = text.replace(old, new)
        return replace(deck, input_text=text)

    monkeypatch.setattr(launch, "deck_of", edited)


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """The one line of standard error that is an error; there is no traceback."""
    lines = [line for line in capsys.readouterr().err.splitlines() if not line.startswith(("note: ", "warning: "))]
    assert len(lines) == 1, lines
    assert lines[0].startswith("granular-lmp: error: ")
    return lines[0]


def refused(folder: Path) -> None:
    """No reader takes the folder for a finished run."""
    with pytest.raises(RunFolderError, match="not a finished run|not a run folder"):
        Record.load(folder)
    for script in (compare, figure3):
        with pytest.raises(SystemExit, match=r"^[^\n]*not a (finished run|run folder)[^\n]*$"):
            script.main([str(folder)])


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (NAN, "Non-numeric|not finite|Lost atoms"),
        (LOST, "records instead of 5"),
        (SLID, "sliding triggered its guard at tau = "),
        (EARLY, "3 records instead of 5"),
        (DEAF, "the log lacks the guard largest_slip"),
        (STOPPED, "the log lacks step 30"),
    ],
    ids=["nan", "lost sphere", "woken guard", "early end", "deaf guard", "log cut off"],
)
def test_what_went_wrong_is_in_the_exit_status_in_run_json_and_refused(
    edit: Edit,
    said: str,
    small_toml: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    broken(monkeypatch, edit)
    folder = tmp_path / "run"
    assert main(["run", str(small_toml), "-o", str(folder)]) == 1
    line = one_line(capsys)
    status = read_status(folder)
    assert status["status"] == "failed"
    assert status["message"] in line
    assert any(word in line for word in said.split("|")), line
    refused(folder)


@pytest.mark.usefixtures("unrendered")
def test_a_failed_run_can_be_forced_through_compare_and_shows_that_it_is_no_number(
    small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken(monkeypatch, SLID)
    with pytest.raises(EffectError):
        run(small, tmp_path / "run")
    assert compare.main([str(tmp_path / "run"), "--force"]) == 0
    out = capsys.readouterr().out
    assert f"note on {tmp_path / 'run'}: status 'failed': " in out
    assert f"note on {tmp_path / 'run'}: largest_slip = " in out


def test_a_nan_in_a_forced_run_is_refused_in_one_line(small: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "run")
    of_first_format(tmp_path / "run")
    lines = (tmp_path / "run" / TRAJECTORY).read_text().splitlines()
    lines[3] = "1.0,nan,nan,nan"
    (tmp_path / "run" / TRAJECTORY).write_text("\n".join([*lines, ""]))
    for words in ([], ["--force"]):
        with pytest.raises(SystemExit, match=r"^[^\n]*not finite[^\n]*$"):
            compare.main([str(tmp_path / "run"), *words])


def test_a_trajectory_that_was_cut_off_is_not_taken_for_whole(small: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "run")
    of_first_format(tmp_path / "run")
    path = tmp_path / "run" / TRAJECTORY
    whole = path.read_text()
    for cut in (len(whole) - 3, whole.rindex("\n", 0, -1) + 1, whole.index("\n") + 1, 3, 0):
        path.write_text(whole[:cut])
        with pytest.raises(RunFolderError, match="cannot be read"):
            Record.load(tmp_path / "run")


def test_a_deck_built_into_a_run_folder_is_not_taken_for_its_run(small: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "run")
    build(small.with_values({"wave.amplitude": 0.1})).write(tmp_path / "run", force=True)
    refused(tmp_path / "run")


def test_a_run_that_could_not_begin_again_does_not_pass_for_the_earlier_one(
    small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(small, tmp_path / "run")
    before = {path: path.read_bytes() for path in (tmp_path / "run").iterdir()}
    other = small.with_values({"wave.amplitude": 0.1})

    def fails_at(step: str) -> None:
        with monkeypatch.context() as patched:
            patched.setattr(manifest if step == "description" else loop, step, lambda *arguments: 1 / 0)
            with pytest.raises(ZeroDivisionError):
                run(other, tmp_path / "run", force=True)

    fails_at("description")  # before the folder is touched
    assert {path: path.read_bytes() for path in (tmp_path / "run").iterdir()} == before
    for step in ("write_files", "execute"):  # while the deck is written, and when the run begins
        fails_at(step)
        refused(tmp_path / "run")


# --- disks ---

OnAFullDisk = Callable[..., tuple[int, list[str]]]


@pytest.fixture
def on_a_full_disk(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> OnAFullDisk:
    """Status and lines of standard error of a command while files of its process cannot grow beyond `size` bytes.

    Python ignores the signal of a write beyond the limit, which fails then, as on a full disk. No bytecode is written:
    it would be cut off, and Python would take it for that of the package from then on.
    """
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def command(size: int, *words: str) -> tuple[int, list[str]]:
        with silent_lammps():  # MPI has files in memory
            pass
        whole, most = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))
        try:
            status = main(list(words))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (whole, most))
        return status, capsys.readouterr().err.splitlines()

    return command


@pytest.mark.parametrize(
    ("size", "route"),
    [
        (0, []),
        pytest.param(1500, [], marks=pytest.mark.more),
        (4700, []),
        (6000, []),
        (9000, []),
        (6000, ["--lmp"]),
        pytest.param(9000, ["--lmp"], marks=pytest.mark.more),
    ],
)
def test_on_a_full_disk_a_run_fails_in_one_line_and_nothing_is_taken_for_whole(
    size: int, route: list[str], small: Scene, on_a_full_disk: OnAFullDisk, tmp_path: Path
) -> None:
    # The files of this run, in bytes: scene 1700, data 3400, in 4600, run.json 4900, log 8900, dump 31 000
    scene = small.with_values({"time.sample": 0.05, "time.duration": 4.0})
    (tmp_path / "scene.toml").write_text(scene.to_toml())
    status, said = on_a_full_disk(size, "run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "run"), *route)
    assert status in (1, 2)
    assert len(said) == 1, said
    assert said[0].startswith("granular-lmp: error: ")
    refused(tmp_path / "run")


@pytest.mark.parametrize(
    ("size", "words"),
    [
        (1000, ["collide", "test2", "-o"]),
        pytest.param(50_000, ["collide", "test2", "-o"], marks=pytest.mark.more),
        (1000, ["build", "tr_periodic", "-o"]),
        pytest.param(1000, ["modes", "l_wave", "--plot"], marks=pytest.mark.more),
        pytest.param(100, ["run", "{tolerant}", "-o"], marks=pytest.mark.more),
        (5000, ["run", "{tolerant}", "-o"]),
    ],
)
def test_on_a_full_disk_the_other_commands_fail_in_one_line(
    size: int, words: list[str], small: Scene, on_a_full_disk: OnAFullDisk, tmp_path: Path
) -> None:
    tolerant = tmp_path / "scene.toml"
    tolerant.write_text(small.with_values({"time.tolerance": 1e-3}).to_toml())
    status, said = on_a_full_disk(
        size, *(word.replace("{tolerant}", str(tolerant)) for word in words), str(tmp_path / "out.png")
    )
    assert not list(tmp_path.rglob("collision.json"))
    assert status in (1, 2)
    errors = [line for line in said if not line.startswith("note: ")]
    assert len(errors) == 1, said
    assert errors[0].startswith("granular-lmp: error: ")


@pytest.fixture(params=["mkdir", "open"])
def read_only(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which nothing can be made. Permissions do not bind root, who may run this: the calls refuse."""
    folder = tmp_path / "read only"
    module = {"mkdir": os, "open": io}[request.param]
    original = getattr(module, request.param)

    def refusing(path: Any, *arguments: Any, **options: Any) -> Any:
        writes = request.param == "mkdir" or str(arguments[0] if arguments else options.get("mode", "r"))[0] != "r"
        if writes and isinstance(path, str | os.PathLike) and Path(path).is_relative_to(folder):
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
        return original(path, *arguments, **options)

    if request.param == "open":
        folder.mkdir()
    monkeypatch.setattr(module, request.param, refusing)
    return folder


@pytest.mark.parametrize("command", ["run", "build", "sweep", "collide"])
def test_a_read_only_folder_is_one_line(
    command: str, small_toml: Path, read_only: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["test2"] if command == "collide" else [str(small_toml)]
    words += ["--over", "wave.amplitude=0.1,0.2"] if command == "sweep" else []
    assert main([command, *words, "-o", str(read_only), "--force"]) == 2
    assert "cannot be written: Read-only file system" in one_line(capsys)


# --- runs made of runs, and collisions ---


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("collision.tangential_velocity=3e3", "collision.steps = "),  # parted within a few steps
        ("collision.normal_velocity=1e-9 collision.tangential_velocity=1e4", "radii in collision.duration"),  # 8e6 bins
    ],
)
def test_a_collision_that_is_none_is_one_line(
    change: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [word for one in change.split() for word in ("--set", one)]
    assert main(["collide", "test1_glass", "--set", "collision.steps=1000", *words, "-o", str(tmp_path / "run")]) == 2
    assert said in one_line(capsys)
    assert not (tmp_path / "run" / "collision.json").exists()


def test_a_scene_with_a_tolerance_fails_as_its_runs_do(
    small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken(monkeypatch, SLID)
    (tmp_path / "scene.toml").write_text(small.with_values({"time.tolerance": 1e-3}).to_toml())
    assert main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "run")]) == 1
    assert "sliding triggered its guard" in one_line(capsys)
    status = read_status(tmp_path / "run")
    assert status["status"] == "failed"
    assert "sliding triggered its guard" in status["message"]
    refused(tmp_path / "run")


def test_two_scenes_with_a_tolerance_do_not_share_a_folder(small: Scene, tmp_path: Path) -> None:
    scene = small.with_values({"time.tolerance": 1e-3})
    with locked(tmp_path / "run", make=True):
        for each in (scene, small):
            with pytest.raises(RunFolderError, match="another run is in progress there"):
                run_any(each, tmp_path / "run", force=True)
    assert list((tmp_path / "run").iterdir()) == []


def test_a_sweep_says_which_runs_failed_in_its_table_and_its_exit_status(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # The linear wave leaves 4 % of the overlap at a = 1.45, the steepening one nothing: the guard wakes
    words = ["sweep", "tr_periodic", "--set", "wave.mode=L", "--set", "time.duration=20"]
    words += ["--over", "wave.amplitude=0.2,1.45", "-o", str(tmp_path / "sweep")]
    assert main(words) == 1
    assert "contact_opening triggered its guard" in capsys.readouterr().err
    table = (tmp_path / "sweep" / "sweep.csv").read_text().splitlines()
    assert [",failed," in line for line in table] == [False, False, True]
    assert "contact_opening triggered its guard" in table[2]
    done = sweep.Sweep.load(tmp_path / "sweep")
    assert Record.load(tmp_path / "sweep" / done.rows[0]["run"]).info["status"] == "finished"
    refused(tmp_path / "sweep" / done.rows[1]["run"])


# --- a run killed ---

Reached = Callable[[Path], bool]
COMMAND = "import sys\nfrom granular_lmp.cli import main\nsys.exit(main({words!r}))"
# 20 000 steps of 24 spheres: half a second or more, so that a kill does not come too late
WHOLE: dict[str, Any] = {"time.duration": 1000.0, "time.sample": 0.5, "output.checkpoint": 24 * 997 / SPEED / 60}


def run_and_kill(scene: Path, folder: Path, reached: Reached, *route: str) -> None:
    """A run killed, with the LAMMPS that it started, as soon as something is so of its folder."""
    command = [sys.executable, "-c", COMMAND.format(words=["run", str(scene), "-o", str(folder), *route])]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        while not reached(folder) and process.poll() is None:
            time.sleep(0.001)
        listed = subprocess.run(["ps", "-A", "-o", "ppid=,pid="], capture_output=True, text=True, check=True).stdout
        process.kill()  # first, so that it cannot say how its LAMMPS ended
        for parent, child in map(str.split, listed.splitlines()):
            if int(parent) == process.pid:
                os.killpg(int(child), signal.SIGKILL)  # it has a session of its own
        _, error = process.communicate()
    assert process.returncode == -signal.SIGKILL, error
    lock = os.open(folder, os.O_RDONLY)
    fcntl.flock(lock, fcntl.LOCK_EX)  # what was killed ends a little later
    os.close(lock)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Record]:
    """The scene of the runs that are killed, and its record without that."""
    folder = tmp_path_factory.mktemp("whole")
    changes = {"packing.rows": 8, "packing.ends": "periodic", "wave.wavenumber": 0.7853981633974483} | WHOLE
    scene = Scene.load("tr_nonresonant").with_values(changes)
    (folder / "scene.toml").write_text(scene.to_toml())
    return folder / "scene.toml", run(scene, folder / "run")


def resumed(folder: Path) -> str:
    """Return the message of a run that cannot be resumed; an empty one if it can."""
    try:
        resume(folder)
    except RunFolderError as error:
        return str(error)
    return ""


def records(folder: Path) -> int:
    """How many records are on disk."""
    path = folder / DUMP
    return path.read_bytes().count(b"ITEM: TIMESTEP") if path.exists() else 0


BEFORE: dict[str, Reached] = {
    "folder": Path.exists,
    "run.json": lambda folder: (folder / STATUS).exists(),
    "first checkpoint begun": lambda folder: (folder / CHECKPOINTS[0]).exists(),
}
AFTER: dict[str, Reached] = {  # a checkpoint is whole when the next is begun
    "second checkpoint begun": lambda folder: (folder / CHECKPOINTS[1]).exists(),
    "1000 records": lambda folder: records(folder) >= 1000,  # every 10 steps: 10 checkpoints
}


def same(folder: Path, expected: Record) -> None:
    """The run ended as one that nobody killed."""
    assert expected.folder is not None
    for name in (DUMP, TRAJECTORY):
        assert (folder / name).read_bytes() == (expected.folder / name).read_bytes()
    assert Record.load(folder).info["guards"].keys() == expected.info["guards"].keys()
    assert [path.name for path in folder.glob("*.part")] == []


@pytest.mark.parametrize(
    "reached", members(BEFORE.values(), BEFORE["run.json"], BEFORE["first checkpoint begun"]), ids=BEFORE.keys()
)
def test_a_run_killed_early_is_not_finished_and_resumes_or_starts_anew_to_the_same_bytes(
    reached: Reached, whole: tuple[Path, Record], tmp_path: Path
) -> None:
    scene, expected = whole
    folder = tmp_path / "run"
    run_and_kill(scene, folder, reached)
    refused(folder)
    said = resumed(folder)
    if said:
        assert "not a run folder" in said or "run it again with force=True" in said
        run(expected.scene, folder, force=True)
    same(folder, expected)


@pytest.mark.parametrize(
    ("route", "reached"),
    [
        pytest.param([], AFTER["second checkpoint begun"], id="module-second checkpoint begun", marks=pytest.mark.more),
        # The test below leaves a run of the module as a kill after ten checkpoints does
        pytest.param([], AFTER["1000 records"], id="module-1000 records", marks=pytest.mark.more),
        pytest.param(["--lmp"], AFTER["second checkpoint begun"], id="lmp-second checkpoint begun"),
        pytest.param(["--lmp"], AFTER["1000 records"], id="lmp-1000 records", marks=pytest.mark.more),
    ],
)
def test_a_run_killed_after_a_checkpoint_is_not_finished_and_resumes_to_the_same_bytes(
    reached: Reached, route: list[str], whole: tuple[Path, Record], tmp_path: Path
) -> None:
    scene, expected = whole
    folder = tmp_path / "run"
    run_and_kill(scene, folder, reached, *route)
    refused(folder)
    assert resumed(folder) == ""
    same(folder, expected)


def stopped(folder: Path, scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that was killed after ten checkpoints: LAMMPS ends early, and nobody is left to say so."""
    broken(monkeypatch, (END, "run 10000"))
    with pytest.raises(LammpsError, match="1001 records instead of 2001"):
        run(scene, folder)
    monkeypatch.undo()
    write_status(folder, {key: value for key, value in read_status(folder).items() if key != "edited"})
    as_if_killed(folder)


def test_a_checkpoint_that_was_cut_off_gives_way_to_the_one_before(
    whole: tuple[Path, Record], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, expected = whole
    assert expected.folder is not None
    folder = tmp_path / "run"
    stopped(folder, expected.scene, monkeypatch)
    last = max((folder / name for name in CHECKPOINTS), key=lambda path: path.stat().st_mtime_ns)
    last.write_bytes(last.read_bytes()[:-7])
    resume(folder)
    assert (folder / DUMP).read_bytes() == (expected.folder / DUMP).read_bytes()


def test_two_checkpoints_that_were_cut_off_are_said(
    whole: tuple[Path, Record], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped(tmp_path / "run", whole[1].scene, monkeypatch)
    for name in CHECKPOINTS:
        os.truncate(tmp_path / "run" / name, 100)
    with pytest.raises(RunFolderError, match="run it again with force=True"):
        resume(tmp_path / "run")
    refused(tmp_path / "run")


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "{}", '{"status": "running"}', '{"tolerance": 1e-3}', '{"status": 3, "ranks": "x"}', "\xff"]
    + ["[" * 100_000, '{"status": "finished", "effects": 3}'],
    ids=lambda text: text[:30],
)
def test_a_damaged_run_json_is_one_line(
    text: str, small: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(small, tmp_path / "run")
    (tmp_path / "run" / STATUS).write_bytes(text.encode("latin-1"))
    assert main(["resume", str(tmp_path / "run")]) == 2
    one_line(capsys)
    with pytest.raises(SystemExit, match=r"^[^\n]+$"):
        compare.main([str(tmp_path / "run")])


# --- a folder that others write into ---


@pytest.mark.parametrize("command", ["build tr_periodic", "collide test2", "kick tr_periodic", "run tr_periodic"])
def test_no_command_writes_into_the_folder_of_a_run_at_work(
    command: str, small: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    run(small, folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with locked(folder):
        assert main([*command.split(), "-o", str(folder), "--force"]) == 2
    assert "another run is in progress there" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("tau", ["nan", "0.0", "9" * 200_000])
def test_a_trajectory_whose_times_do_not_ascend_is_refused(tau: str, small: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "run")
    of_first_format(tmp_path / "run")
    path = tmp_path / "run" / TRAJECTORY
    lines = path.read_text().split("\n")
    lines[2] = ",".join([tau, *lines[2].split(",")[1:]])
    path.write_text("\n".join(lines))
    with pytest.raises(RunFolderError, match="cannot be read"):
        Record.load(tmp_path / "run")
