"""The files that plain lmp left become a run folder, and what its files do not say is asked for."""

import json
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest

from granular_lmp import Record, Scene, build, run
from granular_lmp.cli import main
from granular_lmp.errors import GranularError, LammpsError, RunFolderError
from granular_lmp.lammps.datafile import differences, read
from granular_lmp.lammps.installation import lmp_command
from granular_lmp.lammps.variables import said_variables
from granular_lmp.problem import prepare
from granular_lmp.runs.adopt import adopt
from tests.conftest import members
from tests.instance import run_deck

Left = Callable[..., Path]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Folders in which plain lmp ran the deck of a scene with -var, each made once."""

    @cache
    def folder_of(text: str, variables: tuple[str, ...], ranks: int) -> Path:
        folder = tmp_path_factory.mktemp("lmp") / "left"
        deck = build(Scene.loads(text))
        deck.write(folder)
        if ranks == 1:
            run_deck(folder, deck.input_name, *variables)
        else:
            assert not variables
            subprocess.run([*lmp_command(ranks), "-in", deck.input_name], cwd=folder, check=True, capture_output=True)
        return folder

    return folder_of


@pytest.fixture
def left(small: Scene, made: Callable[..., Path], tmp_path: Path) -> Left:
    """Run the small scene's deck with plain lmp and -var, and return its folder."""

    def make(*variables: str, scene: Scene = small, ranks: int = 1) -> Path:
        return Path(shutil.copytree(made(scene.to_toml(), variables, ranks), tmp_path / "left"))

    return make


def test_an_adopted_run_is_that_of_the_scene_with_the_variables_of_the_log(
    left: Left, small: Scene, tmp_path: Path
) -> None:
    folder = left("amplitude=0.1", "duration=1.5", "timestep=0.025")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    adopted = adopt(folder, tmp_path / "adopted")
    changes = {"wave.amplitude": 0.1, "time.duration": 1.5, "time.timestep": 0.025}
    own = run(small.with_values(changes), tmp_path / "own")
    assert adopted.scene == own.scene
    # LAMMPS read 0.1 where our deck says 0.1, so the bytes are the same
    assert (tmp_path / "adopted/trajectory.csv").read_bytes() == (tmp_path / "own/trajectory.csv").read_bytes()
    # A deck whose step was changed by -var looks at other steps, so its guards see other extremes
    quiet = [{name: guard["quiet"] for name, guard in each.info["guards"].items()} for each in (adopted, own)]
    assert quiet[0] == quiet[1]
    assert (tmp_path / "adopted/in.small").read_text() == (tmp_path / "own/in.small").read_text()
    assert adopted.info["adopted"]["variables"]["amplitude"] == "0.1"
    assert "edited" not in adopted.info
    assert Record.load(tmp_path / "adopted").info["status"] == "finished"
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize(
    ("variables", "changes"),
    [
        ((), {}),
        (("friction=3.5", "dump=mine"), {"effects.friction": 3.5}),
        (("amplitude=1e-5",), {"wave.amplitude": 1e-5}),
    ],
    ids=["none", "friction and dump", "a small wave"],
)
def test_variables_change_the_scene_and_nothing_else_does(
    variables: tuple[str, ...], changes: dict[str, float], left: Left, small: Scene, tmp_path: Path
) -> None:
    adopted = adopt(left(*variables), tmp_path / "adopted")
    assert adopted.scene == prepare(small.with_values(changes)).scene
    assert adopted.info["ranks"] == 1
    assert (tmp_path / "adopted" / "dump.centre").is_file()


def test_a_deck_without_friction_is_adopted_as_it_is(left: Left, small: Scene, tmp_path: Path) -> None:
    changes = {"wave.mode": "L", "effects.shear": False, "effects.rotation": False}
    adopted = adopt(left("amplitude=0.05", scene=small.with_values(changes)), tmp_path / "adopted")
    assert adopted.scene.wave.amplitude == 0.05
    assert "friction" not in adopted.info["adopted"]["variables"]


def test_the_variables_of_a_driven_wave_with_snapshots_are_read(left: Left, tmp_path: Path) -> None:
    driven = Scene.load("tr_driven").with_values({"name": "small", "packing.rows": 21, "time.duration": 8.0})
    adopted = adopt(left("ramp=5", "particles=3", scene=driven), tmp_path / "adopted")
    assert (adopted.scene.envelope.ramp, adopted.scene.output.particles) == (5.0, 3.0)
    assert len(adopted.snapshots()) == 3


def test_the_ranks_are_those_of_the_log(left: Left, tmp_path: Path) -> None:
    assert adopt(left(ranks=2), tmp_path / "adopted").info["ranks"] == 2


def test_a_log_that_does_not_say_the_variables_asks_for_them(left: Left, tmp_path: Path) -> None:
    folder = left("amplitude=0.1")
    log = folder / "log.lammps"
    log.write_text("".join(line for line in log.read_text().splitlines(True) if "variables:" not in line))
    assert said_variables(log.read_text()) is None
    with pytest.raises(RunFolderError, match="does not print its variables, .*wave.amplitude = 0.2"):
        adopt(folder, tmp_path / "adopted")
    with pytest.raises(RunFolderError, match="begins with p, q = .* D0, but the wave of the scene with"):
        adopt(folder, tmp_path / "adopted", changes={"wave.amplitude": 0.2})
    assert not (tmp_path / "adopted").exists()
    assert adopt(folder, tmp_path / "adopted", changes={"wave.amplitude": 0.1}).scene.wave.amplitude == 0.1


def test_a_folder_without_a_scene_asks_for_it(
    left: Left, small: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = left()
    (folder / "scene.toml").unlink()
    assert main(["adopt", str(folder), "-o", str(tmp_path / "adopted")]) == 2
    assert "give the scene of its deck, --scene SCENE" in capsys.readouterr().err
    with pytest.raises(RunFolderError, match="holds no scene.toml; give the scene of its deck, scene=SCENE"):
        adopt(folder, tmp_path / "adopted")
    assert adopt(folder, tmp_path / "adopted", scene=small).scene.name == "small"


@pytest.mark.parametrize("name", ["dump.centre", "log.lammps", "in.small"])
def test_a_file_that_is_missing_is_named(name: str, left: Left, tmp_path: Path) -> None:
    folder = left()
    (folder / name).unlink()
    with pytest.raises(RunFolderError, match=name):
        adopt(folder, tmp_path / "adopted")
    assert not (tmp_path / "adopted").exists()


@pytest.mark.parametrize(
    ("found", "put", "message"),
    [
        ("variables: ", "variables: x ", "says 'x' among its variables: must be NAME=VALUE"),
        (" amplitude=0.2 ", " amplitude ", "says 'amplitude' among its variables: must be NAME=VALUE"),
        (" amplitude=0.2 ", " amplitude= ", "says 'amplitude=' among its variables: must be NAME=VALUE"),
        (" amplitude=0.2 ", " amplitude=much ", "says a variable that must be a number: .*'much'"),
        (" amplitude=0.2 ", " amplitude=nan ", r"wave\.amplitude = nan: must be a number"),
        (" dump=dump.centre", " dump=../left/dump.centre", "must be a file of the same folder"),
        (
            "Loop time of ",
            "Loop time of x",
            "cannot be read as a log of LAMMPS: 'x.*': must be a number of",
        ),
        ("Loop time of ", "Loop time of 1e400\nLoop time of ", "'1e400': must be a number of seconds"),
        ("Pair    | ", "Pair    | nan | x | ", "'x': must be a number of seconds"),
    ],
)
def test_a_malformed_log_is_one_line_that_says_what_is_wrong(
    found: str, put: str, message: str, left: Left, tmp_path: Path
) -> None:
    log = left() / "log.lammps"
    text = log.read_text()
    assert found in text
    log.write_text(text.replace(found, put))
    with pytest.raises(GranularError, match=message) as error:
        adopt(log.parent, tmp_path / "adopted")
    assert len(str(error.value)) < 400


def test_a_word_of_a_log_that_is_garbled_is_one_line_at_most(left: Left, tmp_path: Path) -> None:
    folder, said = left(), []
    log = folder / "log.lammps"
    lines = log.read_text().splitlines(True)
    read = ("granular-lmp variables", "Loop time", "Step", "Pair ", "  1 by")
    places = [(at, word) for at, line in enumerate(lines) if line.startswith(read) for word in range(len(line.split()))]
    instead = cycle(["nan", "-1", "1e400", "x", "a=b", "9" * 5000, "\0", "=", "../x"])
    for (at, word), other in zip(places, instead, strict=False):
        words = lines[at].split()
        words[word] = other
        log.write_text("".join([*lines[:at], " ".join(words) + "\n", *lines[at + 1 :]]))
        try:
            adopt(folder, tmp_path / "adopted", force=True)
        except GranularError as error:
            said.append(str(error))
    assert max(map(len, said)) < 400
    assert len(said) > 10  # the name and the value of each variable that is read, and two seconds


def test_a_run_that_was_cut_off_is_kept_as_failed(left: Left, tmp_path: Path) -> None:
    folder = left()
    dump = folder / "dump.centre"
    dump.write_text("".join(dump.read_text().splitlines(True)[:30]))
    with pytest.raises(LammpsError, match="3 records instead of 5"):
        adopt(folder, tmp_path / "adopted")
    assert json.loads((tmp_path / "adopted/run.json").read_text())["status"] == "failed"


def test_a_deck_with_lines_of_ones_own_says_so(left: Left, small: Scene, tmp_path: Path) -> None:
    folder = left()
    text = build(small).edited(after={"motion": "# mine"}).input_text
    (folder / "in.small").write_text(text)
    assert adopt(folder, tmp_path / "adopted").info["edited"] == ["+ # mine"]
    assert (tmp_path / "adopted/in.small").read_text() == text


@pytest.mark.parametrize("column", ["density", "position", "wave"])
def test_a_data_file_that_is_not_that_of_the_scene_says_so(
    column: str, left: Left, small: Scene, tmp_path: Path
) -> None:
    folder = left()
    data = build(small).data
    values = getattr(data, column).copy()
    values.flat[5] += 1e-11 * abs(values).max()
    changed = replace(data, **{column: values})
    (folder / "data.small").write_text(changed.text("changed"))
    adopted = adopt(folder, tmp_path / "adopted")
    gone, new = adopted.info["edited"]
    assert gone.startswith(f"- data.small: {column} of sphere ")
    assert new.startswith(f"+ data.small: {column} of sphere ")
    assert differences(changed, read(tmp_path / "adopted/data.small")) == []  # the folder holds what was run


def test_spheres_that_the_scene_does_not_have_are_told(left: Left, small: Scene, tmp_path: Path) -> None:
    folder = left()
    data = build(small.with_values({"packing.rows": 16})).data
    (folder / "data.mine").write_text(data.text("longer"))
    log = folder / "log.lammps"
    log.write_text(log.read_text().replace("read_data    data.small", "read_data    data.mine"))  # -var data
    assert [line[:25] for line in adopt(folder, tmp_path / "adopted").info["edited"]] == [
        "- data.small: 24 spheres ",
        "+ data.small: 48 spheres ",
    ]


def test_a_scene_that_another_value_makes_is_not_that_of_the_deck(left: Left, tmp_path: Path) -> None:
    adopted = adopt(left(), tmp_path / "adopted", changes={"sphere.density": 5000.0})
    assert any("density of sphere 1" in line for line in adopted.info["edited"])


def test_the_command_says_what_the_log_said(left: Left, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = left("amplitude=0.1")
    assert main(["adopt", str(folder), "-o", str(tmp_path / "adopted")]) == 0
    said = capsys.readouterr()
    assert "24 spheres, 40 steps, 5 records" in said.out
    assert "note: amplitude = 0.1, from the log" in said.err
    assert main(["adopt", str(folder), "-o", str(tmp_path / "adopted")]) == 2  # it is there already
    assert main(["adopt", str(folder), "-o", str(tmp_path / "adopted"), "--force"]) == 0
    shutil.rmtree(folder)
    assert main(["adopt", str(folder)]) == 2


@pytest.mark.parametrize("name", members(["xi", "mode", "rows", "columns", "amp"], "mode", "rows", "columns"))
def test_a_variable_that_a_deck_does_not_have_is_refused_by_lammps(name: str, small: Scene, tmp_path: Path) -> None:
    build(small).write(tmp_path / "deck")
    command = [*lmp_command(1), "-in", "in.small", "-screen", "none", "-var", name, "1"]
    done = subprocess.run(command, cwd=tmp_path / "deck", check=False)
    assert done.returncode == 1
    assert "this deck has no variable" in (tmp_path / "deck/log.lammps").read_text()
    assert not (tmp_path / "deck/dump.centre").exists()


def test_a_wrong_record_is_not_adopted_as_another(left: Left, small: Scene, tmp_path: Path) -> None:
    other = small.with_values({"wave.mode": "RT"})
    with pytest.raises(RunFolderError, match="begins with p, q"):
        adopt(left(), tmp_path / "adopted", scene=other)
    np.testing.assert_equal((tmp_path / "adopted").exists(), False)


# --- scenes without a wave ---

STRUCK = Scene.load("solitary_chain").with_values({"packing.rows": 10, "time.duration": 6.0})


@pytest.fixture(scope="module")
def struck(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which plain lmp ran the deck of a strike."""
    folder = tmp_path_factory.mktemp("plain") / "deck"
    build(STRUCK).write(folder)
    subprocess.run([*lmp_command(1), "-in", "in.solitary_chain"], cwd=folder, check=True, capture_output=True)
    return folder


def test_a_strike_is_adopted_to_the_record_of_its_run(struck: Path, tmp_path: Path) -> None:
    record = adopt(struck, tmp_path / "run", changes={"time.duration": 6.0})
    whole = run(STRUCK, tmp_path / "whole")
    for name, values in whole.signals.items():
        np.testing.assert_allclose(record.signals[name], values, atol=1e-12)
    assert record.info["status"] == "finished"
    assert Record.load(tmp_path / "run").info["guards"] == whole.info["guards"]


def test_a_strike_of_another_scene_is_not_adopted(struck: Path, tmp_path: Path) -> None:
    with pytest.raises(RunFolderError, match="does not print its variables, .*time.duration = 6.0"):
        adopt(struck, tmp_path / "run")
    with pytest.raises(RunFolderError, match=r"sphere \[0, 0\] begins with \[0.0, 0.92\d+\] units of velocity"):
        adopt(struck, tmp_path / "run", changes={"striker.1.velocity": 1.1})
    with pytest.raises(LammpsError, match="13 records instead of 11"):
        adopt(struck, tmp_path / "run", changes={"time.duration": 5.0})
