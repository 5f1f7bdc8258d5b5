"""Pictures: spheres are where their snapshot says, what is missing is said, a notebook shows its objects."""

import json
import os
import re
import subprocess
import sys
from base64 import b64decode
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import rc_context
from PIL import Image

from granular_analysis import plotting
from granular_lmp import Record, Scene, prepare, run
from granular_lmp.cli import main
from granular_lmp.errors import PackageMissingError, RunFolderError, ViewError
from granular_lmp.plot import crystal, movie, spheres, view
from granular_lmp.plot.at_rest import at_rest_figure
from granular_lmp.plot.colours import COLOURINGS, end_of
from granular_lmp.plot.monitors import monitor_figure
from granular_lmp.plot.page import page as page_of
from granular_lmp.plot.signals import Picture, save, signals_to_draw
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.runs.record import write_status
from granular_lmp.runs.snapshots import Snapshots
from granular_lmp.scene.document import note
from granular_lmp.studies.sweep import Sweep, sweep
from tests.pause import as_if_killed


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with 5 snapshots of 24 spheres."""
    changes = {"packing.rows": 8, "packing.ends": "periodic", "wave.wavenumber": np.pi / 4, "time.duration": 4.0}
    folder = tmp_path_factory.mktemp("view") / "run"
    run(Scene.load("tr_nonresonant").with_values(changes | {"output.particles": 1.0}), folder)
    return folder


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    scene = Scene.load("tr_periodic").with_values({"packing.rows": 16, "time.duration": 2.0})
    over = {"wave.wavenumber": [np.pi / 8, np.pi / 4, np.pi / 2], "wave.amplitude": [0.1, 0.2]}
    return sweep(scene, over, tmp_path_factory.mktemp("view") / "sweep")


def test_a_picture_needs_no_backend_and_no_settings_of_matplotlib(seen: Path, tmp_path: Path) -> None:
    own = tmp_path / "matplotlibrc"
    own.write_text("text.usetex: True")
    command = [sys.executable, "-m", "granular_lmp", "view", str(seen), "-o", str(tmp_path / "seen.png"), "--tau", "1"]
    settings = {"MPLBACKEND": "nonsense", "MATPLOTLIBRC": str(own), "PATH": ""}  # there is no LaTeX
    done = subprocess.run(command, env=os.environ | settings, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, f"{tmp_path}/seen.png\n", "")


@pytest.mark.parametrize("write", [save, plotting.save])
def test_a_figure_that_needs_latex_is_one_line_where_there_is_none(
    write: Callable[[Picture, Path], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "")
    with rc_context({"text.usetex": True}):
        figure = Picture()
        figure.suptitle("a title that no cache of LaTeX holds")
        with pytest.raises((ViewError, SystemExit)) as refused:
            write(figure, tmp_path / "x.png")
    assert str(refused.value).startswith(f"{tmp_path}/x.png: cannot be drawn: ")
    assert "\n" not in str(refused.value)


def drawn(folder: Path, **options: Any) -> tuple[Any, Any]:
    """The axes of the crystal, and the discs in it."""
    figure = crystal.run_figure(Record.load(folder), Snapshots.load(folder), **options)
    axes = next(axes for axes in figure.axes if axes.get_ylabel() == "row")
    return axes, axes.collections[0]


def test_spheres_stand_where_their_snapshot_says_magnified_by_the_factor_that_is_printed(seen: Path) -> None:
    axes, discs = drawn(seen, tau=3.0)
    scene, moment = Snapshots.load(seen).scene, Snapshots.load(seen)[3]
    factor = float(axes.get_xlabel().split("×")[1].split()[0])
    rest = Snapshots.load(seen).rest
    shifts = np.asarray(discs.get_offsets())[:24] - rest  # radii
    amplitude = scene.wave.amplitude * scene.sphere.overlap_ratio * 2  # D0/R
    np.testing.assert_allclose(shifts, moment.displacement * amplitude * factor, atol=1e-12)
    assert 0.1 < np.abs(shifts).max() <= spheres.LARGEST_SHIFT
    hands = np.array(axes.collections[1].get_segments())[:24]
    along = hands[:, 1] - hands[:, 0]
    np.testing.assert_allclose(np.arctan2(along[:, 1], along[:, 0]), moment.rotation * amplitude * factor, atol=1e-12)
    assert axes.get_title(loc="left") == rf"$\tau$ = 3 ({3e9 * scene.scale.time:.3g} ns)"


def test_copies_of_the_cell_stand_beside_it_and_are_counted(seen: Path) -> None:
    axes, discs = drawn(seen)
    offsets = np.asarray(discs.get_offsets())
    assert len(offsets) == 3 * 24
    assert "3 columns, drawn 3 times" in axes.get_xlabel()
    cell = 3 * (2 - 2 * Snapshots.load(seen).scene.sphere.overlap_ratio)
    np.testing.assert_allclose(offsets[24:48] - offsets[:24], [[cell, 0]] * 24, atol=1e-12)


def test_rotation_is_coloured_with_zero_in_the_middle_and_energy_from_zero(seen: Path) -> None:
    moment = Snapshots.load(seen)[-1]
    _, discs = drawn(seen)
    low, high = discs.get_clim()
    assert low == -high == -np.abs(moment.rotation).max()
    _, moved = drawn(seen, colour="displacement")
    np.testing.assert_array_equal(np.asarray(moved.get_array())[:24], np.linalg.norm(moment.displacement, axis=1))
    np.testing.assert_array_equal(np.asarray(discs.get_array())[:24], moment.rotation)
    _, discs = drawn(seen, colour="energy")
    assert discs.get_clim() == (0, moment.energy.max())
    np.testing.assert_array_equal(np.asarray(discs.get_array())[:24], moment.energy)


def test_one_pushed_sphere_does_not_pale_the_others() -> None:
    one_pushed = np.append(np.full(200, 0.1), 5.0)
    assert end_of(one_pushed, COLOURINGS["q"].scale) == end_of(one_pushed, COLOURINGS["energy"].scale) == 0.1
    assert end_of(one_pushed, COLOURINGS["speed"].scale) == 5.0  # decades show both
    assert end_of(one_pushed[-100:], COLOURINGS["q"].scale) == 5.0


def test_the_colour_bar_points_where_spheres_are_beyond_its_ends(seen: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def bar(colour: str) -> str:
        return str(drawn(seen, colour=colour)[1].colorbar.extend)

    assert bar("q") == bar("energy") == "neither"
    monkeypatch.setattr(spheres, "end_of", lambda sizes, _: float(sizes.max()) / 2)
    assert (bar("q"), bar("energy")) == ("both", "max")


def test_as_many_rows_are_drawn_as_asked_for_around_the_centre(seen: Path) -> None:
    _, discs = drawn(seen, rows=3, magnify=1.0)
    heights = np.unique(np.asarray(discs.get_offsets())[:, 1].round(3))
    assert len(heights) == 3
    assert heights[1] == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize(("amplitude", "factor"), [(1e-4, 5000), (0.5, 1), (0.1, 5), (0.3, 1), (2.4e-4, 2000)])
def test_the_factor_is_a_round_number_by_which_an_amplitude_becomes_at_most_half_a_radius(
    amplitude: float, factor: float
) -> None:
    assert spheres.round_below(spheres.LARGEST_SHIFT / amplitude) == pytest.approx(factor, rel=1e-12)


@pytest.fixture(scope="module")
def layer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A rocking wave of a layer on a substrate."""
    folder = tmp_path_factory.mktemp("view") / "layer"
    scene = Scene.load("monolayer_rocking").with_values({"time.duration": 2.0, "wave.wavenumber": 0.785398})
    run(scene, folder)
    return folder


def test_a_layer_is_seen_from_the_end_of_an_axis_on_its_substrate(layer: Path) -> None:
    record, snapshots = Record.load(layer), Snapshots.load(layer)
    last, amplitude = snapshots[len(snapshots) - 1], record.scene.displacement_amplitude / record.scene.sphere.radius
    for side, page, turned in ((None, [1, 2], last.rotation[:, 0]), ("y", [0, 2], -last.rotation[:, 1])):
        figure = crystal.run_figure(record, snapshots, side=side, magnify=10.0, rows=32)
        axes = figure.axes[0]
        (discs,) = (each for each in axes.collections if each.get_array() is not None)
        places = np.asarray(discs.get_offsets())[: len(last.displacement)]
        # Of 32 rows all are drawn, with their first copy before the others
        moved = snapshots.rest + 10.0 * amplitude * last.displacement
        np.testing.assert_allclose(places, moved[:, page], atol=1e-12)
        np.testing.assert_allclose(np.asarray(discs.get_array())[: len(turned)], turned, atol=1e-12)
        assert len(axes.patches) == 1  # the substrate
    assert [each.get_ylabel() for each in figure.axes[1:4]] == [r"$u_y$ ($D_0$)", r"$u_z$ ($D_0$)", r"$\varphi_x$"]


def test_a_layer_is_seen_from_the_top_without_its_substrate(layer: Path) -> None:
    (axes,) = (
        each
        for each in crystal.run_figure(Record.load(layer), Snapshots.load(layer), side="top").axes
        if each.get_ylabel() == "row"
    )
    assert not axes.patches


def test_a_crystal_in_its_plane_is_seen_from_the_top(seen: Path, layer: Path, tmp_path: Path) -> None:
    with pytest.raises(ViewError, match="spheres that stay in their plane are seen from the top"):
        view.view(seen, tmp_path / "side.png", side="x")
    with pytest.raises(ViewError, match="side = 'z': must be one of top, x, y"):
        view.view(layer, tmp_path / "side.png", side="z")


def test_a_page_takes_no_size(seen: Path, tmp_path: Path) -> None:
    with pytest.raises(ViewError, match="--size: cannot be used for a page"):
        view.view(seen, tmp_path / "x.html", size=(640, 480))


def test_a_movie_has_a_frame_for_each_snapshot(seen: Path, tmp_path: Path) -> None:
    assert view.view(seen, tmp_path / "movie.gif", rows=4, size=(320, 200)) == []
    with Image.open(tmp_path / "movie.gif") as movie:
        assert getattr(movie, "n_frames", 1) == 5
        first = np.asarray(movie.convert("RGB"))
        movie.seek(4)
        assert np.any(np.asarray(movie.convert("RGB")) != first)
        assert first[0, 0].tolist() == [255, 255, 255]  # paper stays white in the one palette


@pytest.mark.usefixtures("drawn_once")
def test_a_movie_has_the_size_and_the_pace_that_are_asked_for(
    seen: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["view", str(seen), "-o", str(tmp_path / "movie.gif"), "--rows", "4"]
    assert main([*arguments, "--size", "320x180", "--fps", "4"]) == 0
    with Image.open(tmp_path / "movie.gif") as film:
        assert film.size == (320, 180)
        assert film.info["duration"] == 250  # ms
    for option, said in (("--size 20x20", "must be from 100 to 4000 pixels"), ("--fps 99", "and at most 50")):
        assert main([*arguments, *option.split()]) == 2
        assert said in capsys.readouterr().err
    with pytest.raises(ViewError, match="--fps: cannot be used for a picture of a run"):
        view.view(seen, tmp_path / "picture.png", fps=4.0)


def test_an_mp4_without_ffmpeg_is_refused_in_one_line(
    seen: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(movie.FFMpegWriter, "isAvailable", classmethod(lambda cls: False))
    with pytest.raises(ViewError, match="needs the program ffmpeg, which was not found; a .gif works without it"):
        view.view(seen, tmp_path / "movie.mp4")
    assert not (tmp_path / "movie.mp4").exists()


@pytest.mark.usefixtures("drawn_once")
def test_a_run_without_snapshots_is_drawn_as_its_trajectory_and_says_what_is_missing(
    small: Scene, tmp_path: Path
) -> None:
    run(small, tmp_path / "run")
    (said,) = view.view(tmp_path / "run", tmp_path / "picture.png")
    assert "run its scene with output.particles" in said
    assert (tmp_path / "picture.png").stat().st_size > 1000
    for name, options in (("movie.gif", {}), ("page.html", {}), ("picture.png", {"tau": 1.0})):
        with pytest.raises(ViewError, match=r"run its scene with output\.particles"):
            view.view(tmp_path / "run", tmp_path / name, **options)


def test_an_l_wave_has_no_rotation_to_be_coloured_by(small: Scene, tmp_path: Path) -> None:
    run(small.with_values({"wave.mode": "L", "output.particles": 2.0}), tmp_path / "run")
    axes, discs = drawn(tmp_path / "run")
    assert discs.get_clim()[0] == 0  # energy
    assert "angles" not in axes.get_xlabel()
    with pytest.raises(ViewError, match=r"colour = 'rotation': the run has no angles"):
        drawn(tmp_path / "run", colour="rotation")
    assert signals_to_draw(Record.load(tmp_path / "run").signals) == ["p"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tau": 9.0}, r"tau = 9\.0: must be from 0 to 4"),
        ({"colour": "mass"}, "colour = 'mass': must be one of rotation, energy"),
        ({"magnify": 0.0}, r"magnify = 0\.0: must be a number above 0"),
        ({"column": "steps"}, "--column: cannot be used for a picture of a run"),
    ],
)
def test_what_a_run_cannot_show_is_refused(options: dict[str, Any], message: str, seen: Path, tmp_path: Path) -> None:
    with pytest.raises(ViewError, match=message):
        view.view(seen, tmp_path / "picture.png", **options)
    with pytest.raises(RunFolderError, match="must end in one of"):
        view.view(seen, tmp_path / "picture.doc")


@pytest.mark.usefixtures("drawn_once")
def test_a_sweep_is_a_curve_for_each_value_of_the_shorter_key(swept: Sweep, tmp_path: Path) -> None:
    (axes,) = view.sweep_figure(swept, "largest_q").axes
    assert axes.get_xlabel() == "wave number (rad per row, ξ)"
    for place, line in enumerate(axes.get_lines()):
        np.testing.assert_array_equal(line.get_xdata(), swept.over["wave.wavenumber"])
        np.testing.assert_array_equal(line.get_ydata(), swept.column("largest_q")[place::2])
        assert line.get_label() == f"amplitude = {swept.over['wave.amplitude'][place]}"
    assert view.view(swept.folder, tmp_path / "curve.png") == []
    assert (tmp_path / "curve.png").stat().st_size > 1000


def test_runs_that_are_not_finished_leave_a_gap_and_are_counted(swept: Sweep) -> None:
    rows = [row | ({"status": "failed"} if place == 2 else {}) for place, row in enumerate(swept.rows)]
    (axes,) = view.sweep_figure(Sweep(swept.folder, swept.scene, swept.over, rows)).axes
    assert np.isnan(axes.get_lines()[0].get_ydata()).tolist() == [False, True, False]
    assert "(5 of 6 runs)" in axes.get_title()


def test_what_a_sweep_cannot_show_is_refused(swept: Sweep, tmp_path: Path) -> None:
    with pytest.raises(ViewError, match="column = 'message': must be one of seconds, steps"):
        view.sweep_figure(swept, "message")
    with pytest.raises(ViewError, match="--tau: cannot be used for the picture of a sweep"):
        view.view(swept.folder, tmp_path / "curve.png", tau=1.0)
    with pytest.raises(ViewError, match="a sweep is drawn as a curve"):
        view.view(swept.folder, tmp_path / "curve.gif")
    pairs = {"wave.wavevector": [[0.5, 1.0], [1.0, 0.5], [1.0, 1.0]]}
    with pytest.raises(ViewError, match=r"the values of wave\.wavevector are pairs, which cannot form an axis"):
        view.sweep_figure(Sweep(swept.folder, swept.scene, pairs, swept.rows))
    with pytest.raises(ViewError, match="none of the 6 runs is finished"):
        view.sweep_figure(Sweep(swept.folder, swept.scene, swept.over, [r | {"status": "failed"} for r in swept.rows]))


@pytest.mark.usefixtures("drawn_once")
def test_the_command_draws_and_says_where(seen: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "new" / "picture.png"
    assert main(["view", str(seen), "-o", str(picture), "--tau", "2", "--colour", "energy", "--rows", "5"]) == 0
    assert capsys.readouterr().out == f"{picture}\n"
    assert picture.is_file()
    assert main(["view", str(tmp_path), "-o", str(picture)]) == 2
    assert "not a run folder" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["DATA_of_TITLE", "plain"])
def test_a_page_holds_the_run_whatever_its_name(name: str, seen: Path) -> None:
    snapshots = Snapshots.load(seen)
    text = page_of(replace(snapshots, scene=snapshots.scene.with_values({"name": name})))
    head, data = text.split("const data = ")
    assert f"<title>{name.replace('_', ' ')}: " in head
    said = json.loads(data.partition(";\n")[0])
    moved = np.frombuffer(b64decode(said["displacement"]["values"]), "<i2").reshape(5, 24, 2)
    step = said["displacement"]["largest"] / (2**15 - 1)
    np.testing.assert_allclose(moved[3] * step, snapshots[3].displacement, atol=step / 2 * (1 + 1e-9))


def test_a_page_of_a_run_without_a_wave_is_made_for_a_chain_too(tmp_path: Path) -> None:
    chain = Scene.load("solitary_chain").with_values({"packing.rows": 6, "time.duration": 3.0})
    run(chain, tmp_path / "run")
    assert view.view(tmp_path / "run", tmp_path / "run.html") == []
    said = json.loads((tmp_path / "run.html").read_text().split("const data = ")[1].partition(";\n")[0])
    assert (said["row"], said["colour"]) == ([0, 1, 2, 3, 4, 5], "speed")


# --- the gallery -----------------------------------------------------------------------------------------------------

ROOT = Path(__file__).parents[2]
GALLERY = (ROOT / "docs" / "gallery.md").read_text("utf-8")


def test_every_picture_of_the_gallery_is_below_the_command_that_makes_it_and_small() -> None:
    sections = [section for section in GALLERY.split("\n## ")[1:] if "![" in section]
    assert len(sections) >= 4
    whole = 0
    for section in sections:
        (picture,) = re.findall(r"!\[[^\]]+\]\(\.\./([^)]+)\)", section)
        assert f" -o {picture}" in section.partition("![")[0]
        size = (ROOT / picture).stat().st_size
        assert size < 400e3
        whole += size
    assert whole < 3e6  # bytes: the page


# --- in a notebook ---------------------------------------------------------------------------------------------------


def test_scene_record_and_sweep_are_one_short_line(seen: Path, swept: Sweep) -> None:
    record = Record.load(seen)
    assert repr(record.scene) == (
        "<Scene tr_nonresonant: TR xi=0.785398 a=0.2, 8 x 3 spheres, periodic ends, tau 0..4>"
    )
    for shown in (record, record.scene, swept, Snapshots.load(seen)):
        assert "\n" not in repr(shown)
        assert len(repr(shown).replace(str(seen), "").replace(str(swept.folder), "")) < 120


@pytest.mark.usefixtures("drawn_once")
def test_the_plot_of_a_record_is_a_picture_that_a_notebook_shows(seen: Path) -> None:
    record = Record.load(seen)
    figure = record.plot()
    assert figure._repr_png_().startswith(b"\x89PNG")
    for axes, name in zip(figure.axes, ("p", "q", "phi"), strict=True):
        np.testing.assert_array_equal(axes.get_lines()[0].get_ydata(), getattr(record, name))


def test_the_unit_of_a_swept_key_is_that_of_the_scene_file() -> None:
    assert note("sphere.radius", Scene) == "m"
    assert note("time.sample", Scene) == "tau, between records"


def test_without_pandas_the_table_is_refused_in_one_line(
    seen: Path, swept: Sweep, monkeypatch: pytest.MonkeyPatch
) -> None:
    for package in ("pandas", "xarray"):
        monkeypatch.setitem(sys.modules, package, None)
    for table in (Record.load(seen).to_pandas, swept.to_pandas):
        with pytest.raises(PackageMissingError, match="pandas is not installed; pip install pandas"):
            table()
    for table in (Record.load(seen).to_xarray, swept.to_xarray):
        with pytest.raises(PackageMissingError, match="xarray is not installed; pip install xarray"):
            table()


def test_with_pandas_the_tables_hold_the_same_numbers(seen: Path, swept: Sweep) -> None:
    pytest.importorskip("pandas")
    record = Record.load(seen)
    np.testing.assert_array_equal(record.to_pandas().loc[2.0].to_numpy(), [record.p[4], record.q[4], record.phi[4]])
    np.testing.assert_array_equal(swept.to_pandas()["largest_p"].to_numpy(), swept.column("largest_p"))


def test_with_xarray_the_tables_hold_the_same_numbers(seen: Path, swept: Sweep) -> None:
    pytest.importorskip("xarray")
    record = Record.load(seen)
    assert record.to_xarray().p.sel(tau=2.0).item() == record.p[4]
    assert Scene.loads(record.to_xarray().attrs["scene"]) == record.scene
    assert swept.to_xarray()["largest_p"].shape == (3, 2)
    data = swept.to_xarray()
    np.testing.assert_array_equal(data["largest_p"].to_numpy().ravel(), swept.column("largest_p"))
    assert data["largest_p"].attrs == {"long_name": "largest_p", "units": "D0"}
    for key in swept.over:
        assert data[key.replace(".", "_")].attrs["long_name"] == key
    for name in data.variables:  # attributes of Python, and units of which none is empty
        assert name.isidentifier()
        assert data[name].attrs.get("units") != ""


@pytest.mark.usefixtures("drawn_once")
def test_a_run_that_is_not_finished_is_drawn_with_a_note_and_an_empty_one_refused(small: Scene, tmp_path: Path) -> None:
    record = run(small, tmp_path / "run")
    write_status(tmp_path / "run", record.info | {"status": "interrupted", "message": "stopped"})
    notes = view.view(tmp_path / "run", tmp_path / "v.png")
    assert notes[0] == f"{tmp_path / 'run'}: not a finished run (status 'interrupted': stopped)"
    as_if_killed(tmp_path / "run")
    (tmp_path / "run" / "trajectory.csv").write_text("tau,p,q,phi\n")
    with pytest.raises(ViewError, match="has no record yet; there is nothing to draw"):
        view.view(tmp_path / "run", tmp_path / "v.png")


# --- the crystal at rest ---------------------------------------------------------------------------------------------

SPREAD = {
    "packing.rows": 12,
    "packing.columns": 10,
    "packing.ends": "periodic",
    "wave.wavenumber": np.pi / 3,
    "disorder.radius": 3e-4,
    "disorder.vacancies": 0.02,
}


def test_a_crystal_at_rest_is_drawn_with_its_contacts_gaps_and_empty_places() -> None:
    scene = Scene.load("tr_periodic").with_values(SPREAD)
    rest = crystal_of(scene)
    axes = at_rest_figure(scene).axes[0]
    discs, contacts, gaps = axes.collections
    assert len(discs.get_offsets()) == len(rest.atoms) == 118
    assert len(contacts.get_segments()) == len(rest.contacts)
    # Of the 360 contacts of the lattice those of the two empty places are gone, six each
    assert len(gaps.get_segments()) == 348 - len(rest.contacts) > 0
    assert axes.lines[0].get_xydata().shape == (2, 2)
    empty = axes.lines[0].get_xydata()
    assert np.linalg.norm(empty[:, None] - rest.atoms.positions[None, :, :2], axis=-1).min() > 1.9  # radii


def test_densities_are_drawn_where_all_radii_are_equal() -> None:
    scene = Scene.load("tr_impurity")
    assert max(at_rest_figure(scene).axes[0].collections[0].get_array()) == pytest.approx(9)  # ten times as heavy


def test_a_struck_sheet_is_drawn_at_rest_with_its_gaps_and_a_pressed_chain_with_its_forces() -> None:
    sheet = Scene.load("point_impact").with_values(
        {"packing.rows": 8, "packing.columns": 9, "striker.1.spheres": [[0, 4]], "disorder.radius": 0.002}
    )
    axes = at_rest_figure(sheet).axes[0]
    _, contacts, gaps = axes.collections
    assert len(contacts.get_paths()) + len(gaps.get_paths()) == len(prepare(sheet).rest.contacts)
    assert len(gaps.get_paths()) > len(contacts.get_paths())  # no sphere is larger than the lattice has room for
    chain = Scene.load("breather")
    _, pressed, _ = at_rest_figure(chain).axes[0].collections
    scale = chain.scale
    force = chain.packing.contact_force * scale.time**2 / (scale.mass * scale.length)
    assert np.asarray(pressed.get_array()) == pytest.approx(np.full(42, force), rel=1e-9)


@pytest.mark.usefixtures("drawn_once")
def test_a_crystal_at_rest_needs_imperfections_and_a_picture(tmp_path: Path) -> None:
    with pytest.raises(ViewError, match="all spheres and contacts are equal"):
        view.view("tr_periodic", tmp_path / "rest.png", at_rest=True)
    with pytest.raises(ViewError, match="not as a movie"):
        view.view("tr_impurity", tmp_path / "rest.gif", at_rest=True)
    with pytest.raises(ViewError, match="--tau: cannot be used for a crystal at rest"):
        view.view("tr_impurity", tmp_path / "rest.png", at_rest=True, tau=1.0)
    assert main(["view", "tr_impurity", "--at-rest", "-o", str(tmp_path / "rest.png")]) == 0
    assert (tmp_path / "rest.png").is_file()


# ---------------------------------------------------------------- monitors


@pytest.fixture(scope="module")
def shaken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A strip whose row is shaken, with a monitor of each kind and one of many spheres."""
    names = {"name": "behind", "rows": [12, 12]}, {"name": "near", "rows": [10, 12], "what": "flux"}
    others = {"name": "touch", "spheres": [[11, 1]], "what": "contacts"}, {"name": "many", "rows": [8, 12]}
    tables = {
        "sphere": Scene.load("tr_periodic").to_dict()["sphere"],
        "packing": {"rows": 29, "columns": 3, "ends": "fixed"},
        "output": {"particles": 6.0},
        "wave": {"mode": "TR", "wavenumber": 1.475, "amplitude": 0.05, "form": "none"},
        "time": {"duration": 6.0, "timestep": 0.1, "allow_echo": True},
        "source": [{"rows": [9, 9], "force": "x", "ramp": 2.0}],
        "monitor": [*names, *others],
    }
    folder = tmp_path_factory.mktemp("monitors") / "run"
    run(Scene.from_dict(tables), folder)
    return folder


def test_a_push_is_drawn_with_all_rows_and_their_numbers_in_the_scene(shaken: Path) -> None:
    axes, discs = drawn(shaken)
    rest = Snapshots.load(shaken).rest
    assert len(rest) == 29 * 3
    assert {*np.round(np.asarray(discs.get_offsets())[:, 1])} == {*np.round(rest[:, 1])}
    ticks = dict(zip((text.get_text() for text in axes.get_yticklabels()), axes.get_yticks(), strict=True))
    row = Snapshots.load(shaken).crystal.arrays["row"]
    assert [ticks[str(n)] for n in (0, 25)] == pytest.approx([rest[row == n, 1].mean() for n in (0, 25)])


@pytest.mark.parametrize(
    ("name", "panels", "lines"),
    [("behind", {"u": "displacement", "v": None, "angle": "rotation"}, 3), ("near", {"flux": "flux"}, 3)],
)
def test_lines_are_what_a_monitor_recorded(name: str, panels: dict[str, str | None], lines: int, shaken: Path) -> None:
    monitor = Record.load(shaken).monitor(name)
    axes = monitor_figure(monitor).axes
    assert [len(each.lines) for each in axes] == [lines] * len(panels)
    for each, attribute in zip(axes, panels.values(), strict=True):
        if attribute is not None:
            values = getattr(monitor, attribute)
            expected = values[..., 0] if values.ndim == 3 else values
            assert np.array_equal(np.column_stack([line.get_ydata() for line in each.lines]), expected)
            assert np.array_equal(each.lines[0].get_xdata(), monitor.tau)


def test_many_spheres_are_a_mean_between_extremes_and_contacts_are_named(shaken: Path) -> None:
    record = Record.load(shaken)
    many = record.monitor("many")
    axes = monitor_figure(many).axes[0]
    (line,), (band,) = axes.lines, axes.collections
    assert np.allclose(line.get_ydata(), many.displacement[..., 0].mean(axis=1))
    assert band.get_paths()[0].vertices[:, 1].min() == many.displacement[..., 0].min()
    legend = monitor_figure(record.monitor("touch")).axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()][0] == "[10, 1] – [11, 1]"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["-o", "x.gif", "--monitor", "near"], "a monitor is drawn over time in a picture, not as a movie"),
        (["-o", "x.png", "--monitor", "nere"], "monitor 'nere': no such monitor; did you mean 'near'?"),
        (["-o", "x.png", "--monitor", "near", "--tau", "1"], "--tau: cannot be used for the picture of a monitor"),
    ],
)
def test_what_a_monitor_cannot_show_is_said(
    words: list[str], said: str, shaken: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["view", str(shaken), *words]) == 2
    assert said in capsys.readouterr().err
