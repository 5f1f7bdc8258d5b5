"""Nothing lies: what went wrong is in the exit status, in ``run.json``, and refused by `compare` unless forced."""

import errno
import io
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from analysis import compare, figure3
from granular_lmp import Record, Scene, build, launch, run
from granular_lmp.cli import main
from granular_lmp.errors import EffectError, RunFolderError
from granular_lmp.record import TRAJECTORY, read_status

Edit = tuple[str, str]
END = "run ${steps}"
NAN = ("variable     vx atom v_D0*d_vx/v_t0", "variable     vx atom 1e300*v_D0*d_vx/v_t0")
LOST = (END, "run 10\ndelete_atoms group centre\nrun 30")
SLID = ("$(5.0*v_amplitude:%.17g)", "$(0.01*v_amplitude:%.17g)")
EARLY = (END, "run $(v_steps/2)")
DEAF = ("v_slip v_open", "v_open")
STOPPED = (END, 'run 20\nprint "ERROR: none"\nlog none\nrun 20')


def broken(monkeypatch: pytest.MonkeyPatch, scene: Scene, *edits: Edit) -> None:
    """Let runs build a deck with pieces of its text replaced."""

    def edited(scene: Scene) -> Any:
        deck = build(scene)
        text = deck.input_text
        for old, new in edits:
            assert old in text
            text = text.replace(old, new)
        return replace(deck, input_text=text)

    monkeypatch.setattr(launch, "build", edited)


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
        (SLID, "sliding woke at tau = "),
        (EARLY, "3 records instead of 5"),
        (DEAF, "the log lacks the guard largest_slip"),
        (STOPPED, "the log lacks step 40"),
    ],
    ids=["nan", "lost sphere", "woken guard", "early end", "deaf guard", "log cut off"],
)
def test_what_went_wrong_is_in_the_exit_status_in_run_json_and_refused(
    edit: Edit,
    said: str,
    small: Scene,
    small_toml: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    broken(monkeypatch, small, edit)
    folder = tmp_path / "run"
    assert main(["run", str(small_toml), "-o", str(folder)]) == 1
    line = one_line(capsys)
    status = read_status(folder)
    assert status["status"] == "failed"
    assert status["message"] in line
    assert any(word in line for word in said.split("|")), line
    refused(folder)


def test_a_failed_run_can_be_forced_through_compare_and_shows_that_it_is_no_number(
    small: Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    broken(monkeypatch, small, SLID)
    with pytest.raises(EffectError):
        run(small, tmp_path / "run")
    assert compare.main([str(tmp_path / "run"), "--force"]) == 0
    out = capsys.readouterr().out
    assert "note on small: status 'failed': " in out
    assert "note on small: largest_slip = " in out


def test_a_nan_in_a_forced_run_is_refused_in_one_line(small: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "run")
    lines = (tmp_path / "run" / TRAJECTORY).read_text().splitlines()
    lines[3] = "1.0,nan,nan,nan"
    (tmp_path / "run" / TRAJECTORY).write_text("\n".join([*lines, ""]))
    for words in ([], ["--force"]):
        with pytest.raises(SystemExit, match=r"^[^\n]*not finite[^\n]*$"):
            compare.main([str(tmp_path / "run"), *words])


def test_a_trajectory_that_was_cut_off_is_not_taken_for_whole(small: Scene, tmp_path: Path) -> None:
    run(small, tmp_path / "run")
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
    monkeypatch.setattr(launch, "description", lambda *arguments: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run(small.with_values({"wave.amplitude": 0.1}), tmp_path / "run", force=True)
    refused(tmp_path / "run")


# --- disks ---

FULL = """
import resource, signal, sys
from granular_lmp.cli import main
from granular_lmp.locate import lammps_module
lammps_module().lammps(cmdargs=["-log", "none", "-screen", "none"]).close()  # MPI has files in memory
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # a write beyond the limit fails then, as on a full disk
resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))
sys.exit(main({words!r}))
"""


def on_a_full_disk(size: int, *words: str) -> "subprocess.CompletedProcess[str]":
    """A command in a process whose files cannot grow beyond `size` bytes."""
    return subprocess.run(
        [sys.executable, "-c", FULL.format(size=size, words=list(words))],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


@pytest.mark.parametrize("route", [[], ["--lmp"]], ids=["module", "program"])
@pytest.mark.parametrize("size", [0, 300, 1500, 4200, 6000, 9000])
def test_on_a_full_disk_a_run_fails_in_one_line_and_nothing_is_taken_for_whole(
    size: int, route: list[str], small: Scene, tmp_path: Path
) -> None:
    # The files of this run, in bytes: scene 1400, data 4200, in 4600, log 9600, dump 41 000 (81 records)
    scene = small.with_values({"time.sample": 0.05, "time.duration": 4.0})
    (tmp_path / "scene.toml").write_text(scene.to_toml())
    done = on_a_full_disk(size, "run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "run"), *route)
    assert done.returncode in (1, 2)
    assert done.stderr.startswith("granular-lmp: error: ")
    assert len(done.stderr.splitlines()) == 1, done.stderr
    refused(tmp_path / "run")


@pytest.mark.parametrize("words", [["collide", "test2"], ["build", "tr_periodic"], ["modes", "l_wave", "--plot"]])
def test_on_a_full_disk_the_other_commands_fail_in_one_line(words: list[str], tmp_path: Path) -> None:
    where = [str(tmp_path / "out.png")] if words[-1] == "--plot" else ["-o", str(tmp_path / "out")]
    done = on_a_full_disk(1000, *words, *where)
    assert done.returncode in (1, 2)
    errors = [line for line in done.stderr.splitlines() if not line.startswith("note: ")]
    assert len(errors) == 1, done.stderr
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
