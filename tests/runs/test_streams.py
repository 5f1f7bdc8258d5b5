"""The command line where streams are closed or full, folders are deleted, and files run out: one line, right status."""

import io
import json
import resource
import signal
import subprocess
import sys
import time
import tomllib
from contextlib import chdir
from pathlib import Path

import pytest

from granular_analysis.cli import program, scripts
from granular_lmp import Scene
from granular_lmp.cli import entry, main
from granular_lmp.runs.routes import FEWEST_FILES
from granular_lmp.studies.sweep import sweep
from tests.cli.test_cli import cli
from tests.conftest import members

SCRIPTS = sorted(scripts().keys() - {"fit", "image"})  # which take two files
GRANULAR = f"{sys.executable} -m granular_lmp"


def shell(line: str, folder: Path) -> tuple[int, str, str]:
    """Exit status, standard output and standard error of a command line."""
    done = subprocess.run(["bash", "-c", line], cwd=folder, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(
    ("unbuffered", "command"),
    [
        ("", "effects tr_periodic"),
        pytest.param("", "modes tr_periodic", marks=pytest.mark.more),
        pytest.param("", "doctor", marks=pytest.mark.more),
        pytest.param("", "run small.toml -o run", marks=pytest.mark.more),
        ("1", "effects tr_periodic"),
        pytest.param("1", "run small.toml -o run", marks=pytest.mark.more),
    ],
)
def test_a_full_standard_output_is_one_line_and_status_1(
    command: str, unbuffered: str, small_toml: Path, tmp_path: Path
) -> None:
    status, _, err = shell(f"PYTHONUNBUFFERED={unbuffered} {GRANULAR} {command} > /dev/full", tmp_path)
    assert (status, err) == (
        1,
        "granular-lmp: error: standard output: cannot be written: No space left on device\n",
    )


def test_a_full_standard_error_does_not_stop_a_run(
    small_toml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = "small.toml --set time.timestep=0.3"
    with chdir(tmp_path):
        assert main(["effects", *words.split()]) == 0
    assert "note: time.timestep" in capsys.readouterr().err  # there is something to be written
    status, out, _ = shell(f"{GRANULAR} run {words} -o run 2> /dev/full", tmp_path)
    assert status == 0
    assert "24 spheres" in out


PROGRAM = "'from granular_analysis.cli import program; exit(program())'"


def test_a_script_ends_as_a_command_does(small: Scene, tmp_path: Path) -> None:
    # Of a sweep over words it prints a line and draws no figure
    sweep(small, {"wave.mode": ["TR"]}, tmp_path / "sweep")
    compare = f"PYTHONPATH={Path(__file__).parents[2]} {sys.executable} -c {PROGRAM} compare"
    full = "granular-analysis: error: this machine: No space left on device\n"
    assert shell(f"{compare} sweep > /dev/full", tmp_path)[::2] == (1, full)
    assert shell(f"set -o pipefail; {compare} sweep | true", tmp_path)[::2] == (0, "")
    assert shell(f"{compare} sweep <&- >&- 2>&-", tmp_path)[0] == 0
    assert not (tmp_path / "sweep/compare.png").exists()


def test_the_installed_command_is_the_one_whose_errors_are_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["scripts"]["granular-analysis"] == "granular_analysis.cli:program"
    monkeypatch.setattr(sys, "argv", ["granular-analysis", "compare", "nowhere"])
    assert program() == 2
    said = "granular-analysis: error: nowhere: not a run folder (there is no run.json)\n"
    assert capsys.readouterr() == ("", said)


PROGRAMS = {"granular-lmp": entry.program, "granular-analysis": program}


@pytest.mark.parametrize("name", PROGRAMS)
@pytest.mark.parametrize("encoding", ["ascii", "iso-8859-1", "cp1252"])
def test_a_terminal_without_our_letters_gets_them_as_escapes(
    encoding: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(io.BytesIO(), encoding))
    assert entry.as_program(name, lambda: print("φ in °")) == 0
    degrees = "\\xb0" if encoding == "ascii" else "°"
    assert sys.stdout.buffer.getvalue().decode(encoding) == f"\\u03c6 in {degrees}\n"
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit) as ended:
        PROGRAMS[name]()
    assert not ended.value.code


@pytest.mark.parametrize(
    ("name", "imports"),
    [
        ("granular-lmp", "granular_lmp.cli.parser.parsers"),
        ("granular-analysis", "granular_analysis.cli.import_module"),
    ],
)
def test_a_command_that_is_interrupted_as_it_begins_is_one_line_and_status_130(
    name: str, imports: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(imports, interrupted)
    monkeypatch.setattr(sys, "argv", [name, "fit"])
    assert PROGRAMS[name]() == 130
    assert capsys.readouterr() == ("", f"{name}: interrupted\n")


@pytest.mark.parametrize("name", SCRIPTS)
def test_bad_input_of_a_script_is_one_line_and_status_2(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["granular-analysis", name, str(tmp_path / "nowhere")])
    try:
        status = program()
    except SystemExit as refused:  # of argparse
        status = refused.code
    assert status == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert "nowhere" in said.err.splitlines()[-1]
    assert len(said.err.splitlines()) == 1 or said.err.startswith("usage: ")


@pytest.mark.parametrize("closed", members(["2>&-", ">&-", "<&-", "<&- >&- 2>&-"], "2>&-", ">&-", "<&-"))
def test_a_closed_stream_does_not_stop_a_run(closed: str, small_toml: Path, tmp_path: Path) -> None:
    assert shell(f"{GRANULAR} run small.toml -o run {closed}", tmp_path)[0] == 0
    assert json.loads((tmp_path / "run/run.json").read_text())["status"] == "finished"


@pytest.mark.parametrize("closed", members(["2>&-", "<&- >&- 2>&-"], "<&- >&- 2>&-"))
def test_a_closed_stream_does_not_change_the_status_of_bad_input(closed: str, tmp_path: Path) -> None:
    assert shell(f"{GRANULAR} run nowhere {closed}", tmp_path)[0] == 2


# Programs that a sweep starts may be given the numbers of closed streams
@pytest.mark.parametrize("closed", members(["<&-", "<&- >&- 2>&-"], "<&-"))
def test_a_closed_stream_does_not_stop_a_sweep(closed: str, small_toml: Path, tmp_path: Path) -> None:
    sweep = f"{GRANULAR} sweep small.toml --over wave.phase=0,1 --workers 2 -o sweep {closed}"
    assert shell(sweep, tmp_path)[0] == 0


def test_a_reader_that_has_gone_is_no_error(tmp_path: Path) -> None:
    status, _, err = shell(f"set -o pipefail; {GRANULAR} effects tr_periodic | true", tmp_path)
    assert (status, err) == (0, "")


def test_a_deleted_working_directory_is_one_line_and_status_2(tmp_path: Path) -> None:
    (tmp_path / "gone").mkdir()
    for command in ("run tr_periodic", "effects tr_periodic", "doctor", "view run -o x.png"):
        status, _, err = shell(f"mkdir -p gone; cd gone; rmdir ../gone; {GRANULAR} {command}", tmp_path)
        assert status == 2
        assert err == "granular-lmp: error: the working directory was deleted; change to one that exists\n"


@pytest.mark.parametrize(
    "command",
    members(
        ["run small.toml", "run small.toml --lmp", "kick small.toml --set time.duration=4", "collide test2"],
        "run small.toml --lmp",
        "kick small.toml --set time.duration=4",
        "collide test2",
    ),
)
def test_too_few_open_files_are_refused_before_a_file_is_written(
    command: str, small_toml: Path, tmp_path: Path
) -> None:
    before = sorted(tmp_path.rglob("*"))
    status, _, err = shell(f"ulimit -n 16; {GRANULAR} {command} -o run", tmp_path)
    assert status == 2
    assert err.splitlines()[-1] == (
        f"granular-lmp: error: ulimit -n = 16: must be at least {FEWEST_FILES} open files for LAMMPS and its MPI"
    )
    assert sorted(tmp_path.rglob("*")) == before


def test_as_many_open_files_as_are_asked_for_are_enough(small_toml: Path, tmp_path: Path) -> None:
    assert resource.getrlimit(resource.RLIMIT_NOFILE)[0] >= FEWEST_FILES
    assert shell(f"ulimit -n {FEWEST_FILES}; {GRANULAR} run small.toml -o run", tmp_path)[0] == 0


@pytest.mark.parametrize("seed", ["-1", "1.5", "x"])
def test_a_seed_that_is_none_is_refused(
    seed: str, small_toml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, _, err = cli(capsys, "kick", str(small_toml), "--seed", seed, "-o", str(tmp_path / "run"))
    assert status == 2
    assert err.endswith(f"error: argument --seed: '{seed}' must be a whole number of at least 0\n")
    assert not (tmp_path / "run").exists()


def test_a_kick_that_is_stopped_says_how_to_go_on(small_toml: Path, tmp_path: Path) -> None:
    words = [*GRANULAR.split(), "kick", "small.toml", "--set", "time.duration=1e6", "-o", "run"]
    process = subprocess.Popen(words, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    # Two records: before its first step a run leaves no checkpoint
    while sum(each.read_text().count("TIMESTEP") for each in (tmp_path / "run").glob("dump.particles*")) < 2:
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)  # as a batch system does
    _, err = process.communicate(timeout=200)
    assert process.returncode == 130
    how = f"continue with: granular-lmp resume {tmp_path / 'run'}"
    assert err.endswith(f"granular-lmp: error: {tmp_path / 'run'}: interrupted; what was recorded is kept; {how}\n")
    assert list((tmp_path / "run").glob("checkpoint*"))
