"""Sweeps say what ran: where a cell or a sample rounds values, its wave stands under their name, beside what was asked.

Six wave numbers from 1.0 to 1.1 in a periodic cell of 48 rows are one wave, 2π·8/48 = 1.0472.
"""

import csv
import shutil
from math import pi
from pathlib import Path
from typing import Any

import pytest

from cases.runner import swept as runs_of
from cases.spectrum.case import measure as spectrum
from granular_analysis.tools.compare import main as compare_main
from granular_lmp import Scene
from granular_lmp.plot import view
from granular_lmp.rest.linear import mode_of
from granular_lmp.studies.rounding_warnings import remarks
from granular_lmp.studies.sweep import Sweep, sweep
from granular_lmp.studies.sweep_points import points, scene_hash
from tests.cli.test_cli import cli
from tests.conftest import members

PERIODIC = Scene.load("tr_periodic").with_values({"packing.rows": 48, "packing.columns": 3, "time.duration": 8.0})
ASKED = [1.0, 1.02, 1.04, 1.06, 1.08, 1.1]
RAN = 2 * pi * 8 / 48
KEY = "wave.wavenumber"


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    return sweep(PERIODIC, {KEY: [*ASKED, 1.2]}, tmp_path_factory.mktemp("asked") / "sweep")


def test_the_coordinate_is_the_wave_that_ran_and_what_was_asked_for_stands_beside_it(swept: Sweep) -> None:
    assert swept.columns[:3] == [KEY, f"{KEY}_asked", "run"]
    assert list(swept.column(KEY)) == [RAN] * 6 + [2 * pi * 9 / 48]
    assert list(swept.column(f"{KEY}_asked")) == [*ASKED, 1.2]
    assert [swept.record(row).scene.wavenumber for row in swept.rows] == list(swept.column(KEY))
    with (swept.folder / "sweep.csv").open(newline="") as stream:
        assert [float(line[KEY]) for line in csv.DictReader(stream)] == list(swept.column(KEY))
    assert Sweep.load(swept.folder) == swept


def test_values_that_coincide_are_one_run_named_as_ever_by_the_first_of_them(swept: Sweep) -> None:
    assert len(list((swept.folder / "runs").iterdir())) == 2
    # the hash of the scene as it was asked for: runs of earlier versions are found again
    assert {row["run"] for row in swept.rows[:6]} == {f"runs/{scene_hash(PERIODIC.with_values({KEY: 1.0}))}"}


def test_a_run_of_a_value_that_coincides_is_used_whatever_value_comes_first(swept: Sweep, tmp_path: Path) -> None:
    shutil.copytree(swept.folder, tmp_path / "sweep")
    more = sweep(PERIODIC, {KEY: [0.99, *ASKED]}, tmp_path / "sweep", force=True)
    assert {row["run"] for row in more.rows} == {swept.rows[0]["run"]}
    assert len(list((tmp_path / "sweep" / "runs").iterdir())) == 2


def test_pandas_has_a_line_a_value_and_xarray_a_place_a_wave(swept: Sweep) -> None:
    pytest.importorskip("xarray")
    assert list(swept.to_pandas()[KEY]) == list(swept.column(KEY))
    data = swept.to_xarray()
    assert dict(data.sizes) == {"wave_wavenumber": 2}
    assert list(data.wave_wavenumber.values) == [RAN, 2 * pi * 9 / 48]


def test_a_picture_has_a_mark_a_wave_where_it_ran(drawn_once: None, swept: Sweep, tmp_path: Path) -> None:
    (axes,) = view.sweep_figure(swept).axes
    assert list(axes.get_lines()[0].get_xdata()) == [RAN, 2 * pi * 9 / 48]
    assert view.view(swept.folder, tmp_path / "curve.png") == swept.notes


def as_of_an_earlier_version(swept: Sweep, folder: Path) -> Path:
    """The same sweep as earlier versions left it: only what was asked for in the table."""
    for name in ("sweep.json", "runs"):
        (folder / name).symlink_to(swept.folder / name)
    lines = [f"{KEY},run,status", *(f"{row[f'{KEY}_asked']!r},{row['run']},finished" for row in swept.rows)]
    (folder / "sweep.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.mark.parametrize("old", members([False, True], False))
@pytest.mark.usefixtures("unrendered")
def test_compare_has_a_line_a_wave_that_names_it(
    old: bool, swept: Sweep, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = as_of_an_earlier_version(swept, tmp_path) if old else swept.folder
    assert compare_main([str(folder)]) == 0
    head, *lines = (line.split() for line in capsys.readouterr().out.splitlines())
    assert head[:2] == [KEY, f"{KEY}_asked"]
    assert [line[:2] for line in lines[:2]] == [[repr(RAN), "1.0"], [repr(2 * pi * 9 / 48), "1.2"]]
    assert " ".join(lines[2]) == "7 points of the sweep share 2 runs, because values are equal"


def test_the_spectrum_has_a_point_a_wave(swept: Sweep) -> None:
    points, _ = spectrum(runs_of([str(swept.folder)]))
    assert [each.wavenumber for each in points] == pytest.approx([RAN, 2 * pi * 9 / 48])


def test_the_command_says_before_it_runs_what_tells_the_values_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--set", "packing.rows=48", "--set", "time.duration=1", "--over", f"{KEY}=1.0:1.1:6"]
    status, out, err = cli(capsys, "sweep", "tr_periodic", *words, "-o", str(tmp_path / "sweep"))
    assert status == 0
    assert "6 of 6 runs finished" in out
    assert [line for line in err.splitlines() if "values" in line] == [
        "note: 6 values, 1 wave in a periodic cell of 48 rows; a cell of 272 rows separates them (packing.rows = 272)"
    ]


def distinct(scene: Scene, over: dict[str, list[Any]]) -> int:
    return len({point.run for point in points(scene, over)})


@pytest.mark.usefixtures("unrendered")
def test_compare_takes_the_values_of_runs_from_their_scenes_and_not_from_the_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = PERIODIC.with_values({"packing.rows": 24, "time.duration": 2.0, KEY: 2 * pi * 4 / 24})
    struck = [{"spheres": [[3, 1]], "velocity": 0.001}]
    over = {"wave.amplitude": [0.01, 0.02], "striker.1.velocity": [0.001, 0.002]}
    sweep(scene.with_values({"striker": struck, "output.particles": 1.0}), over, tmp_path / "sweep")
    path = tmp_path / "sweep" / "sweep.csv"
    path.write_text(path.read_text().replace("\n0.02,", "\n0.03,").replace(",0.001,", ",0.005,"))
    compare_main([str(tmp_path / "sweep")])
    head, *lines = (line.split() for line in capsys.readouterr().out.splitlines())
    assert head[:3] == ["wave.amplitude", "wave.amplitude_asked", "striker.1.velocity"]
    assert [(line[0], line[2]) for line in lines[:4]] == [(a, b) for a in ("0.01", "0.02") for b in ("0.001", "0.002")]


def test_the_cell_that_is_named_tells_the_waves_apart_where_they_were_asked_for() -> None:
    larger = PERIODIC.with_values({"packing.rows": 272})
    assert distinct(larger, {KEY: ASKED}) == 6
    assert all(abs(point.ran[KEY] - point.asked[KEY]) < 0.01 for point in points(larger, {KEY: ASKED}))


# ---------------------------------------------------------------- other values that are rounded


def test_a_direction_that_no_cell_holds_is_the_one_that_ran() -> None:
    scene = PERIODIC.with_values({"packing.rows": 12, "packing.columns": 12})
    over = {"wave.direction": [28.0, 30.0, 33.0], KEY: [1.0, 1.5]}
    for point in points(scene, over):
        used = point.scene.vector
        assert point.ran == {"wave.direction": used.direction, KEY: used.wavenumber}
        assert point.asked == {"wave.direction": point.scene.wave.direction, KEY: point.scene.wave.wavenumber}
    (note,) = remarks(point.scene for point in points(scene, over))
    assert note.startswith("6 values, ")
    rows, columns = (
        int(note.partition(f"packing.{key} = ")[2].split(",")[0].strip(")")) for key in ("rows", "columns")
    )
    assert distinct(scene.with_values({"packing.rows": rows, "packing.columns": columns}), over) == 6
    assert distinct(scene, over) < 6


def test_where_two_keys_are_rounded_together_the_dimensions_are_what_was_asked_for(tmp_path: Path) -> None:
    pytest.importorskip("xarray")
    scene = PERIODIC.with_values({"packing.rows": 12, "packing.columns": 12, "time.duration": 1.0})
    done = sweep(scene, {"wave.direction": [30.0, 50.0], KEY: [1.0, 1.6]}, tmp_path / "sweep")
    assert done.axes == ["wave.direction_asked", f"{KEY}_asked"]
    data = done.to_xarray()
    assert dict(data.sizes) == {"wave_direction_asked": 2, "wave_wavenumber_asked": 2}
    assert data.wave_direction_asked.attrs["units"] == "degrees"
    assert data.wave_wavenumber.values.ravel().tolist() == list(done.column(KEY))
    curves = view.sweep_figure(done).axes[0].get_lines()
    assert [line.get_label() for line in curves] == ["wave number asked = 1.0", "wave number asked = 1.6"]


def test_a_frequency_is_that_of_the_wave_that_ran() -> None:
    scene = PERIODIC.with_values({"packing.rows": 24})
    asked = scene.with_values({KEY: 1.0})  # runs at 2 pi 4/24 = 1.0472
    hertz = mode_of(asked).frequency / asked.sphere.time_scale / (2 * pi)
    near = [hertz * 0.95, hertz * 0.96]
    first, second = points(scene, {"wave.frequency": near})
    assert first.run == second.run
    assert first.ran["wave.frequency"] == pytest.approx(hertz, rel=1e-12)
    assert first.asked["wave.frequency"] == near[0]


def test_a_time_step_is_the_one_that_ran() -> None:
    found = points(PERIODIC, {"time.timestep": [0.05, 0.048, 0.047]})
    assert [point.ran["time.timestep"] for point in found] == [0.05, 0.5 / 11, 0.5 / 11]
    assert found[1].run == found[2].run
    (note,) = remarks(point.scene for point in found)
    assert note == "3 time steps, 2 in a whole number to a sample of 0.5; time.sample = 1.0 separates them"
    assert distinct(PERIODIC.with_values({"time.sample": 1.0}), {"time.timestep": [0.05, 0.048, 0.047]}) == 3


def test_an_auto_is_what_was_decided() -> None:
    scene = Scene.load("tr_nonresonant").with_values({"packing.rows": "auto", "packing.columns": 3})
    first, second = points(scene, {"packing.rows": ["auto", scene.shape.rows]})
    assert first.run == second.run
    assert first.ran == second.ran == {"packing.rows": scene.shape.rows}


@pytest.mark.parametrize(
    "changes",
    [
        {"packing.ends": "fixed", "packing.rows": 201},
        {KEY: 2 * pi / 48},
    ],
    ids=str,
)
def test_what_runs_as_it_was_asked_for_has_no_second_column(changes: dict[str, Any]) -> None:
    scene = PERIODIC.with_values(changes)
    values = [2 * pi * k / 48 for k in (7, 8, 9)]
    assert [point.ran for point in points(scene, {KEY: values})] == [{KEY: value} for value in values]
    assert not remarks(point.scene for point in points(scene, {KEY: values}))


def test_waves_too_close_for_any_cell_are_sent_to_fixed_ends() -> None:
    close = [1.0, 1.0 + 1e-6]
    (note,) = remarks(point.scene for point in points(PERIODIC, {KEY: close}))
    assert note.endswith('no cell of up to 100000 rows separates them, but packing.ends = "fixed" does')
    fixed = PERIODIC.with_values({"packing.ends": "fixed", "packing.rows": 49})
    assert distinct(fixed, {KEY: close}) == 2
