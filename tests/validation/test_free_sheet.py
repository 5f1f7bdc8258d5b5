"""A free sheet on a substrate without a wave, unequal spheres shaken at a corner: each command takes it."""

import json
from base64 import b64decode
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure import reference
from granular_analysis.measure.outside import sites
from granular_analysis.tools.compare import compare
from granular_lmp import Record, Scene, run
from granular_lmp.cli import main
from granular_lmp.errors import SceneError, ViewError
from granular_lmp.plot.at_rest import at_rest_figure
from granular_lmp.plot.crystal import run_figure
from granular_lmp.plot.monitors import monitor_figure
from granular_lmp.plot.view import view

SILICA = {"youngs_modulus": 7.3e10, "poisson_ratio": 0.17, "work_of_adhesion": 0.063}
TABLES: dict[str, Any] = {
    "sphere": SILICA | {"radius": 5e-7, "density": 2200.0},
    "packing": {"rows": 7, "columns": 6, "lattice": "hexagonal"},
    "substrate": SILICA,
    "disorder": {"radius": 2e-5, "vacancies": 0.05},
    "source": [{"spheres": [[0, 0]], "force": "z", "amplitude": 0.05, "signal": "burst", "frequency": 0.4582}],
    "monitor": [{"name": "corner", "spheres": [[6, 5]]}],
    "time": {"duration": 8.0},
}


@pytest.fixture(scope="module")
def shaken(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return run(Scene.from_dict(TABLES), tmp_path_factory.mktemp("free") / "sheet")


def test_every_sphere_moves_as_in_the_network(shaken: Record) -> None:
    found = compare(shaken)
    assert found.theory == "network"
    # The step of the run leaves 7e-5; a source on another sphere would make it 1
    assert all(error is not None and error < 2e-4 for error in found.error.values())


def test_places_are_told_where_spheres_are_missing(shaken: Record) -> None:
    atoms = shaken.problem.rest.atoms
    assert len(atoms) == 40  # of 42
    row, column = sites(shaken.scene, atoms.positions)
    assert np.array_equal(row, atoms.arrays["row"])
    assert np.array_equal(column, atoms.arrays["column"])


def test_an_error_of_our_own_is_no_reason_to_compare_with_nothing(
    shaken: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(record: Record) -> None:
        _one, _two = record.tau[:3]

    monkeypatch.setattr(reference, "first_snapshot", broken)
    with pytest.raises(ValueError, match="too many values to unpack"):
        compare(shaken)


@pytest.mark.usefixtures("drawn_once")
def test_it_is_drawn_with_its_source_and_its_monitor_marked_and_a_bar_of_length(shaken: Record, tmp_path: Path) -> None:
    assert shaken.folder is not None
    assert view(shaken.folder, tmp_path / "sheet.png") == []
    assert (tmp_path / "sheet.png").stat().st_size > 1000
    figure = run_figure(shaken, shaken.snapshots(), colour="z", magnify=1e4)
    axes = figure.axes[0]
    source, monitor = (line.get_xydata()[0] for line in axes.lines)
    moved = shaken.displacement[-1] * shaken.scale.length / shaken.scene.sphere.radius * 1e4
    places = shaken.rest[:, :2] + moved[:, :2]
    np.testing.assert_allclose([source, monitor], [places[0], places[-1]], atol=1e-12)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["source", "monitor"]
    assert legend.get_texts()[0].get_fontsize() >= 8
    (bar,) = (each for each in axes.artists if hasattr(each, "txt_label"))
    assert bar.txt_label.get_text() == "1 µm"  # at most a quarter of 7.7 µm, which are 15.4 radii
    assert bar.size_bar.get_children()[0].get_width() == pytest.approx(2.0)  # radii of half a micrometre
    np.testing.assert_array_equal(axes.collections[0].get_array(), shaken.displacement[-1, :, 2])


def test_its_contacts_at_rest_and_its_monitor_are_drawn_in_its_units(shaken: Record) -> None:
    axes = at_rest_figure(shaken.scene).axes[0]
    contacts = shaken.problem.rest.contacts
    assert len(axes.collections[1].get_paths()) == len(contacts) - 40  # each sphere touches the substrate
    mean = (2 * (len(contacts) - 40) + 40) / 40
    assert axes.get_title().endswith(f"40 spheres, {mean:.3f} contacts per sphere")
    assert monitor_figure(shaken.monitor("corner")).axes[0].get_ylabel().endswith(r"($\Delta_0$)")


def test_its_page_holds_every_motion_and_is_what_a_notebook_shows_of_snapshots(shaken: Record, tmp_path: Path) -> None:
    assert shaken.folder is not None
    path = tmp_path / "sheet.html"
    assert view(shaken.folder, path) == []
    text = path.read_text("utf-8")
    assert "http" not in text  # nothing is loaded from elsewhere
    (line,) = (line for line in text.splitlines() if line.startswith("const data = "))
    data = json.loads(line.removeprefix("const data = ").removesuffix(";"))
    whole = np.frombuffer(b64decode(data["displacement"]["values"]), "<i2").reshape(shaken.displacement.shape)
    moved = whole * data["displacement"]["largest"] / (2**15 - 1)
    # Half of a step of 16 bits
    np.testing.assert_allclose(moved, shaken.displacement, rtol=0, atol=1.6e-5 * np.abs(shaken.displacement).max())
    assert [(each["kind"], each["spheres"]) for each in data["marks"]] == [("source", [0]), ("monitor", [39])]
    shown = shaken.snapshots()._repr_html_()
    assert unescape(shown.partition('srcdoc="')[2].partition('"></iframe>')[0]) == text
    with pytest.raises(ViewError, match="--tau: cannot be used for a page, in which the reader chooses it"):
        view(shaken.folder, path, tau=1.0)


def test_inclusions_and_interfaces_are_marked_in_a_picture(tmp_path: Path) -> None:
    bodies = [{"rows": [4, 6], "density": 4400.0}, {"spheres": [[1, 2]], "density": 8800.0}]
    still = {"packing": {"rows": 7, "columns": 6, "lattice": "hexagonal"}, "time": {"duration": 0.5}}
    scene = Scene.from_dict(
        {key: TABLES[key] for key in ("sphere", "substrate", "source")} | still | {"inclusion": bodies}
    )
    record = run(scene, tmp_path / "run")
    interface, dot = None, None
    for line in run_figure(record, record.snapshots()).axes[0].lines:
        interface = line.get_xydata() if line.get_linestyle() == "--" else interface
        dot = line.get_xydata() if line.get_marker() == "o" else dot
    row = record.row
    assert interface[:, 1] == pytest.approx(record.rest[(row == 3) | (row == 4), 1].mean())
    np.testing.assert_allclose(dot, record.rest[(row == 1) & (record.column == 2), :2], atol=1e-12)


@pytest.mark.usefixtures("unrendered")
def test_its_modes_are_those_at_the_middle_of_the_zone(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    scene = tmp_path / "sheet.toml"
    scene.write_text(Scene.from_dict(TABLES).to_toml(), "utf-8")
    assert main(["modes", str(scene), "--plot", str(tmp_path / "modes.png")]) == 0
    said = capsys.readouterr().out
    assert "xi = 0, as there is no [wave]" in said
    frequencies = [float(line.split()[2]) for line in said.splitlines() if line[:1].isdigit()]
    # The layer moves as one on its substrate: twice along the plane, once along z; twice rocking, once about z
    assert np.round(frequencies, 4).tolist() == [0.3782, 0.3782, 0.4507, 1.4976, 1.4976, 1.8659]
    assert main(["modes", str(scene), "--path", "G-M"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()[:2]] == ["G", "M"]
    assert main(["modes", "point_impact", "--path"]) == 2
    assert "point_impact must have spheres that adhere" in capsys.readouterr().err


def test_check_names_the_substrate_and_the_spread(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    scene = tmp_path / "sheet.toml"
    scene.write_text(Scene.from_dict(TABLES).to_toml(), "utf-8")
    assert main(["check", str(scene)]) == 0
    assert "crystal   on a substrate; radius 2e-05, vacancies 0.05, seed 1\n" in capsys.readouterr().out


def test_a_lattice_that_was_not_said_is_named_as_the_default() -> None:
    size = {"rows": 7, "columns": 6}
    says = r'the default\b.* without \[wave\]; for a sheet set packing\.lattice = "hexagonal"'
    with pytest.raises(SceneError, match=says):
        Scene.from_dict(TABLES | {"packing": size})
    assert Scene.from_dict(TABLES | {"packing": size | {"lattice": "hexagonal"}}).shape.columns == 6
    strike = {"sphere": TABLES["sphere"] | {"work_of_adhesion": 0.0}, "striker": [{"rows": [0, 0], "velocity": 0.1}]}
    with pytest.raises(SceneError, match=says):
        Scene.from_dict(strike | {"time": TABLES["time"], "packing": size})
