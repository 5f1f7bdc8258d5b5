"""A notebook shows short lines, small pictures, and errors that speak Python; the command line speaks options."""

import subprocess
import sys
from base64 import b64decode
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import granular_lmp
from granular_analysis.measure.runs import load
from granular_lmp import Record, Scene, build, run
from granular_lmp.cli import main
from granular_lmp.errors import RunFolderError
from granular_lmp.plot.signals import dispersion_figure
from granular_lmp.problem import prepare
from granular_lmp.rest.linear import mode_of
from granular_lmp.studies.sweep import Sweep, sweep

PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """A scene, its deck, a record and a sweep."""
    folder = tmp_path_factory.mktemp("notebook")
    scene = Scene.load("tr_periodic").with_values({"time.duration": 2.0})
    done = sweep(scene, {"wave.amplitude": [0.01 * k for k in range(1, 9)]}, folder / "sweep")
    return {"scene": scene, "deck": build(scene), "record": run(scene, folder / "run"), "sweep": done}


@pytest.mark.parametrize("name", ["scene", "deck", "record", "sweep"])
def test_a_repr_is_one_short_line(name: str, shown: dict[str, Any]) -> None:
    text = repr(shown[name])
    assert "\n" not in text
    assert len(text) < 200 + len(str(getattr(shown[name], "folder", "")))


@pytest.mark.parametrize("name", ["scene", "deck", "record", "sweep"])
def test_a_notebook_shows_a_small_picture(name: str, shown: dict[str, Any]) -> None:
    page = shown[name]._repr_html_()
    picture = b64decode(page.partition("base64,")[2].partition('"')[0])
    assert picture.startswith(PNG)
    assert len(picture) < 50_000
    assert repr(shown[name]).split()[1].rstrip(":") in page


@pytest.mark.parametrize("name", ["tr_periodic", "tr_square", "l_chain"])
def test_the_wave_lies_on_the_branch_of_its_own_lattice(name: str) -> None:
    """The branch of the hexagonal lattice is 0.14 to 0.26 from the waves of the other two."""
    scene = Scene.load(name)
    (axes,) = dispersion_figure(scene).axes
    (branch,) = (line for line in axes.lines if line.get_label() == scene.wave.mode)
    there = np.interp(scene.wavenumber, branch.get_xdata(), branch.get_ydata())
    # The branch is drawn at 200 wave numbers: between two of them a chord is at most h²/8 = 3e-5 off
    assert there == pytest.approx(mode_of(scene).frequency, abs=1e-4)


@pytest.mark.usefixtures("drawn_once")
def test_a_deck_shows_its_text_escaped_and_its_places(shown: dict[str, Any]) -> None:
    page = shown["deck"].edited(after={"run": 'print "<b>mine</b>"'})._repr_html_()
    assert "print &quot;&lt;b&gt;mine&lt;/b&gt;&quot;" in page
    assert "<td>+ print &quot;&lt;b&gt;mine&lt;/b&gt;&quot;</td>" in page
    assert "contacts, preload, wave" in page


def test_a_sweep_of_which_nothing_is_finished_has_no_picture(shown: dict[str, Any], tmp_path: Path) -> None:
    done = shown["sweep"]
    rows = [row | {"status": "unfinished"} for row in done.rows]
    page = Sweep(tmp_path, done.scene, done.over, rows)._repr_html_()
    assert "<img" not in page
    assert page.count("<tr>") == 1 + 6  # the head, and the first six of eight
    assert "and 2 more" in page


@pytest.mark.parametrize("lattice", ["chain", "hexagonal"])
def test_an_empty_record_without_a_wave_has_no_picture(lattice: str, tmp_path: Path) -> None:
    scene = Scene.load("solitary_chain").with_values({"packing.lattice": lattice, "packing.rows": 6})
    page = Record.empty(prepare(scene), tmp_path)._repr_html_()
    assert "<img" not in page
    assert "solitary_chain" in page


@pytest.mark.parametrize("lattice", ["chain", "hexagonal"])
def test_a_deck_of_loose_spheres_shows_its_text_without_a_picture(lattice: str) -> None:
    page = build(
        Scene.load("solitary_chain").with_values({"packing.lattice": lattice, "packing.rows": 6})
    )._repr_html_()
    assert "<img" not in page
    assert "pair_style" in page


@pytest.mark.usefixtures("drawn_once")
def test_a_deck_of_spheres_that_adhere_shows_its_branches_without_a_wave_too() -> None:
    scene = Scene.load("solitary_chain").with_values({"sphere.work_of_adhesion": 0.1, "packing.rows": 6})
    assert "<img" in build(scene)._repr_html_()


def test_a_prompt_completes_the_names_of_the_package_before_one_was_used() -> None:
    fresh = "import granular_lmp as g; print(sorted(n for n in dir(g) if n[0] != '_') == sorted(g.__all__))"
    assert subprocess.run([sys.executable, "-c", fresh], capture_output=True, text=True).stdout == "True\n"


def test_what_has_no_picture_is_refused() -> None:
    with pytest.raises(TypeError, match="int: there is no notebook card for this type"):
        granular_lmp.html(3)


def test_an_error_says_force_in_python_and_as_an_option(
    shown: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(RunFolderError, match=r"exists already; choose another folder or say force=True$"):
        run(shown["scene"], tmp_path)
    assert main(["run", "tr_periodic", "-o", str(tmp_path)]) == 2
    assert capsys.readouterr().err.endswith("choose another folder or say --force\n")


def test_a_script_of_analysis_speaks_of_options_too(shown: dict[str, Any], tmp_path: Path) -> None:
    record = run(shown["scene"], tmp_path / "run")
    assert record.folder is not None
    (record.folder / "scene.toml").write_text(shown["scene"].to_toml().replace("amplitude = 0.2", "amplitude = 0.1"))
    with pytest.raises(SystemExit, match="put it back, or run with --force"):
        load(record.folder)
