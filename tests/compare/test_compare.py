"""Comparison of runs with theory: it sees what is wrong, picks its theory, and refuses what is no finished run."""

import errno
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cases.figure2 import case as figure2
from cases.figure3 import case as figure3
from granular_analysis.measure import signals
from granular_analysis.measure.swept import Swept
from granular_analysis.second_harmonic import generated_amplitude, mode, nonlinearity, ratios, second_harmonic
from granular_analysis.theory import bloch
from granular_analysis.theory.choice import THEORIES, best, drive_cancels, trajectory, wave_of
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import Wave
from granular_analysis.tools import compare, curves
from granular_lmp import Record, Scene, run
from granular_lmp.errors import RunFolderError
from granular_lmp.runs.record import read_status, write_status
from granular_lmp.studies.sweep import sweep
from tests.conftest import PAPER, members
from tests.pause import as_if_killed


def from_theory(scene: Scene, theory: str, tau: np.ndarray) -> Record:
    """A record that is a theory, to the last digit."""
    empty = Record.of_centre(tau, tau, tau, tau, scene)
    p, q, phi = trajectory(theory, wave_of(empty), tau)
    return empty.with_signals(p=p, q=q, phi=phi)


TAU = np.arange(0.0, 60.0, 0.5)


@pytest.mark.parametrize("theory", THEORIES)
def test_a_record_made_by_a_theory_has_no_error_against_it(theory: str) -> None:
    result = compare.compare(from_theory(PAPER, theory, TAU), theory)
    assert result.theory == theory
    assert all(error is not None and error < 1e-12 for error in result.error.values())


@pytest.mark.parametrize("component", signals.COMPONENTS)
def test_one_percent_in_one_component_is_seen_there_and_only_there(component: str) -> None:
    record = from_theory(PAPER, "second-order", TAU)
    wrong = record.with_signals(**{component: getattr(record, component) * 1.01})
    error = compare.compare(wrong, "second-order").error
    assert error.pop(component) == pytest.approx(0.01, rel=1e-9)
    assert all(value is not None and value < 1e-12 for value in error.values())


def test_silent_components_are_compared_with_nothing() -> None:
    record = from_theory(PAPER.with_values({"wave.mode": "L"}), "second-order", TAU)
    assert compare.compare(record, "second-order").error["q"] is None


@pytest.mark.parametrize("mode", ["TR", "RT", "L"])
def test_the_measured_amplitude_is_the_one_put_in(mode: str) -> None:
    record = from_theory(PAPER.with_values({"wave.mode": mode, "wave.phase": 0.4}), "second-order", TAU)
    wave = wave_of(record)
    shape = second_harmonic(wave.mode, wave.contact.closed, wave.amplitude, TAU, phase=0.4)
    result = compare.compare(record, "second-order")
    assert result.measured == pytest.approx(result.predicted, rel=1e-9)
    louder = compare.compare(record.with_signals(p=record.p + 0.1 * shape), "second-order")
    assert louder.measured == pytest.approx(1.1 * result.predicted, rel=1e-9)


def test_the_standard_error_is_the_spread_of_noisy_measurements() -> None:
    record, random = from_theory(PAPER, "second-order", TAU), np.random.default_rng(5)
    shapes = signals.shapes_of(record, wave_of(record))
    truth, _ = signals.amplitude_by(shapes, record)
    off = []
    for _ in range(2000):
        noisy = record.with_signals(p=record.p + random.normal(0, 1e-4, len(TAU)))
        measured, fit_error = signals.amplitude_by(shapes, noisy)
        off.append((measured - truth) / fit_error)
    # 2000 draws of a unit normal: mean 0 ± 0.022, spread 1 ± 0.016; three of those, and 0.01 for Student's t
    assert abs(np.mean(off)) < 0.07
    assert np.std(off) == pytest.approx(1, abs=0.06)


@pytest.mark.parametrize(("mode", "columns"), [("TR", 1), ("L", 3)])
def test_of_a_few_records_no_amplitude_is_measured(mode: str, columns: int) -> None:
    scene = PAPER.with_values({"wave.mode": mode})
    few, enough = (from_theory(scene, "second-order", TAU[:count]) for count in (3 * columns - 1, 3 * columns))
    found = compare.compare(few)
    assert (found.measured, found.fit_error) == (None, None)
    said = f"no second harmonic is measured: a fit needs {3 * columns} records, and there are {3 * columns - 1}"
    assert said in found.notes
    assert compare.compare(enough).measured is not None


# Mode, ξ, a, duration, and what holds best there
WAVES = [
    ("TR", 0.802, 0.2, 120, "hierarchy"),
    ("TR", 1.475, 0.2, 120, "hierarchy"),
    pytest.param("TR", 1.475, 0.2, 390, "three-mode", marks=pytest.mark.more),
    ("TR", 1.475, 0.2, 700, "three-mode"),
    pytest.param("TR", 2.127, 0.2, 120, "hierarchy", marks=pytest.mark.more),
    ("RT", 1.5, 0.2, 120, "hierarchy"),
    pytest.param("L", 0.802, 0.2, 60, "hierarchy", marks=pytest.mark.rounding),  # q and φ are 0
]


@cache
def exact_record(name: str, xi: float, amplitude: float) -> Record:
    """The exact lattice as a record, as long as the longest of `WAVES` of this wave."""
    until = {("TR", 1.475): 700.0}.get((name, xi), 120.0)
    changes = {"wave.mode": name, "wave.wavenumber": xi, "wave.amplitude": amplitude}
    return from_theory(PAPER.with_values(changes), "exact-lattice", np.arange(0.0, until, 1.0))


@pytest.mark.parametrize(("name", "xi", "amplitude", "until", "expected"), WAVES)
def test_the_best_theory_is_at_most_twice_as_far_off_as_any_other(
    name: str, xi: float, amplitude: float, until: float, expected: str
) -> None:
    whole = exact_record(name, xi, amplitude)
    tau = np.arange(0.0, until, 1.0)
    record = replace(whole, tau=tau, signals={each: values[: len(tau)] for each, values in whole.signals.items()})
    wave = wave_of(record)
    assert best(wave, tau) == expected
    formulas = ["second-order", "frequency-shift", "three-mode"] + ["hierarchy"] * (until <= 120)
    off = {
        theory: [error or 0.0 for error in signals.errors(record, THEORIES[theory](wave, tau)).values()]
        for theory in formulas
    }
    least = np.min(list(off.values()), axis=0)
    assert (np.array(off[expected]) <= 2 * least + 1e-6).all(), off


STEEL = Contact(0.3, overlap_ratio=2.5e-4)


@pytest.mark.parametrize(
    ("xi", "amplitude", "hidden"),
    [
        (1.44, 0.95, False),  # the resonance is at 1.5035
        (1.5035, 0.95, False),
        (2.2, 0.5, False),
        (2.3, 0.3, False),  # the antiresonance is at 2.325
        (2.3, 0.5, True),
        (2.325, 0.1, True),
    ],
)
def test_the_second_harmonic_is_hidden_where_the_fourth_order_is_larger_than_it(
    xi: float, amplitude: float, hidden: bool
) -> None:
    wave = Wave.of_mode("TR", xi, amplitude, STEEL)
    assert drive_cancels(wave) == hidden
    early = np.linspace(0, 40, 41)
    # By the exact lattice: what second order leaves out of p, beside second order
    exact, second = (THEORIES[name](wave, early)[0] for name in ("exact-lattice", "second-order"))
    assert (np.linalg.norm(exact - second) > np.linalg.norm(second)) == hidden


Shown = Callable[[float], tuple[Record, compare.Comparison, compare.Comparison]]


@pytest.fixture(scope="module")
def shown(paper_run: Callable[..., Record]) -> Shown:
    """A run of the paper by its wave number, compared with the best theory and with the paper's order."""

    @cache
    def make(xi: float) -> tuple[Record, compare.Comparison, compare.Comparison]:
        record = paper_run({"wave.wavenumber": xi, "time.timestep": 0.0125, "time.duration": 165.0})
        return record, compare.compare(record), compare.compare(record, "second-order")

    return make


@pytest.mark.parametrize("xi", members([0.802, 1.475, 2.127], 0.802, 2.127))
def test_the_best_theory_is_closer_to_lammps_than_the_paper_s_order(xi: float, shown: Shown) -> None:
    _, ours, paper = shown(xi)
    for name in signals.COMPONENTS:
        assert ours.error[name] is not None
        assert ours.error[name] < 0.7 * (paper.error[name] or 0)  # the time step leaves 1e-5 or more in both


@pytest.mark.parametrize(("name", "direction"), [("TR", 37.0), ("L", 0.0)])
def test_an_oblique_run_of_lammps_is_the_exact_lattice_of_its_direction(
    name: str, direction: float, paper_run: Callable[..., Record]
) -> None:
    sheet = {"packing.ends": "periodic", "packing.rows": 12, "packing.columns": 12}
    along = {"wave.mode": name, "wave.direction": direction, "time.duration": 20.0, "time.timestep": 0.0125}
    record = paper_run(sheet | along)
    result = compare.compare(record)
    assert (result.theory, result.direction) == ("hierarchy", record.scene.direction)
    assert (result.predicted, result.measured) == (None, None)
    for error in result.lattice_error.values():
        # The time step leaves (ΩΔτ)²Ωτ/24√3 = 2.4e-5 in p of TR, which turns with Ω = 0.68, and less in the others.
        assert error is None or error < 5e-5
    wave = wave_of(record)
    mode = bloch.mode(name, wave.mode.wavenumber, record.scene.direction + 5, wave.contact)
    turned = replace(wave, mode=mode)
    off = signals.errors(record, THEORIES["exact-lattice"](turned, record.tau))
    assert max(error or 0.0 for error in off.values()) > 2e-3  # five degrees are seen


@pytest.mark.parametrize("changes", [{"wave.wavenumber": 2.127}, {"wave.wavenumber": np.pi}, {"wave.wavenumber": 1e-9}])
def test_no_amplitude_is_measured_where_there_is_no_second_harmonic(changes: dict[str, float]) -> None:
    result = compare.compare(from_theory(PAPER.with_values(changes), "second-order", TAU), "second-order")
    assert result.measured is None
    assert result.fit_error is None
    assert f"{'-':>12}" in compare.table([result])


def test_notes_say_why_a_comparison_does_not_mean_what_it_seems(small: Scene, tmp_path: Path) -> None:
    opened = compare.compare(run(small.with_values({"wave.amplitude": 8.0}), tmp_path / "open"))
    assert any("no theory of a plane wave holds effects.contact_opening" in note for note in opened.notes)
    assert any("run its scene with output.particles" in note for note in opened.notes)
    still = compare.compare(run(small.with_values({"effects.rotation": False}), tmp_path / "still"))
    assert any("largest_torque" in note for note in still.notes)
    echo = PAPER.with_values({"packing.rows": 21, "time.duration": 60.0, "time.allow_echo": True})
    heard = compare.compare(run(echo, tmp_path / "echo"), "second-order")
    assert any("echoes of the walls arrive from tau = 4.9" in note for note in heard.notes)
    assert heard.notes[0] in compare.table([heard])
    assert compare.compare(run(small, tmp_path / "plain"), "second-order").notes == []


def test_an_unknown_theory_is_refused() -> None:
    with pytest.raises(ValueError, match="theory = 'none' is not one of second-order"):
        compare.compare(from_theory(PAPER, "second-order", TAU), "none")


@pytest.mark.parametrize("status", ["failed", "interrupted", "running"])
def test_a_run_that_did_not_finish_has_a_note_whatever_ended_it(status: str) -> None:
    record = from_theory(PAPER, "second-order", TAU)
    unfinished = replace(record, info={"status": status, "message": "for the test"})
    assert compare.compare(unfinished, "second-order").notes == [f"status '{status}': for the test"]
    finished = replace(record, info={"status": "finished", "message": ""})
    assert compare.compare(finished, "second-order").notes == []


def test_the_table_names_each_run_by_its_folder_and_a_record_without_one_by_its_scene() -> None:
    record = from_theory(PAPER, "second-order", TAU)
    runs = [replace(record, folder=Path(name)) for name in ("sweep/runs/0123456789abcdef", "b")]
    compared = [compare.compare(each, "second-order") for each in (*runs, record)]
    lines = compare.table(compared).split("\n\n")[0].splitlines()  # the error budgets follow
    assert [line.split()[0] for line in lines[1::2]] == ["sweep/runs/0123456789abcdef", "b", "tr_nonresonant"]
    assert len({line.index("second-order") for line in lines[1::2]}) == 1


def test_a_file_in_place_of_a_run_folder_is_called_a_file(tmp_path: Path) -> None:
    (tmp_path / "run.json").write_text("{}")
    with pytest.raises(SystemExit, match="run.json: is a file; give the run folder that holds run.json"):
        compare.main([str(tmp_path / "run.json")])


def test_what_differs_between_runs_is_named_by_key_and_value() -> None:
    record = from_theory(PAPER, "second-order", TAU)
    changes = [{}, {"wave.amplitude": 0.1}, {"time.tolerance": 1e-3, "name": "other"}]
    runs = [replace(record, scene=PAPER.with_values(each), folder=Path(f"runs/{i}")) for i, each in enumerate(changes)]
    found = compare.differences(runs)
    assert found == {"wave.amplitude": [0.2, 0.1, 0.2], "time.tolerance": [None, None, 1e-3]}
    compared = [compare.compare(each, "second-order") for each in runs]
    lines = compare.difference_lines(runs, compared)
    assert lines[-2] == "  runs/1: wave.amplitude = 0.1"
    assert compare.difference_lines(runs[:1], compared[:1]) == []
    assert compare.difference_lines([runs[0], runs[0]], compared[:2]) == []
    sheet = {"packing.columns": 4, "inclusion": [{"spheres": [[5, 1]], "density": 20000.0}], "disorder.density": 0.1}
    found = compare.differences([record, replace(record, scene=record.scene.with_values(sheet))])
    assert (found["inclusion.1.density"], found["disorder.density"]) == ([None, 20000.0], [0.0, 0.1])


# --- the scripts ---


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """No figures, most of the time of a short comparison: another test looks at them."""
    monkeypatch.setattr(compare, "save", lambda figure, path: None)


@pytest.mark.usefixtures("undrawn")
def test_compare_says_which_folder_is_which_and_what_differs(
    small: Scene, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folders = [tmp_path / name for name in ("one", "two")]
    for folder, amplitude in zip(folders, (0.1, 0.2), strict=True):
        run(small.with_values({"wave.amplitude": amplitude}), folder)
    assert compare.main([*map(str, folders), "--theory", "second-order", "--json", str(tmp_path / "out.json")]) == 0
    out = capsys.readouterr().out
    assert f"{folders[0]}: wave.amplitude = 0.1\n  {folders[1]}: wave.amplitude = 0.2\n" in out
    assert [entry["folder"] for entry in json.loads((tmp_path / "out.json").read_text())] == list(map(str, folders))


@pytest.fixture
def folder(small: Scene, tmp_path: Path) -> Path:
    run(small, tmp_path / "run")
    return tmp_path / "run"


@pytest.mark.usefixtures("drawn_once")
def test_compare_prints_a_table_and_writes_json_and_a_figure(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert compare.main([str(folder), "--json", str(tmp_path / "out.json"), "--theory", "second-order"]) == 0
    out = capsys.readouterr().out
    assert "second-order" in out
    assert "exact lattice" in out
    (entry,) = json.loads((tmp_path / "out.json").read_text())
    assert entry["name"] == "small"
    assert set(entry["error"]) == {"p", "q", "phi"}
    assert (folder / "compare.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("trouble", [errno.EROFS, errno.ENOSPC])
def test_compare_prints_its_numbers_where_the_figure_cannot_be_written(
    trouble: int, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails(figure: Any, path: Path, **options: Any) -> None:
        path.write_bytes(b"part")
        raise OSError(trouble, os.strerror(trouble))

    (folder / "compare.png").write_bytes(b"before")
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", fails)
    with pytest.raises(SystemExit, match=rf"compare\.png: cannot be written: {os.strerror(trouble)}"):
        compare.main([str(folder), "--theory", "second-order"])
    assert "exact lattice" in capsys.readouterr().out
    assert (folder / "compare.png").read_bytes() == b"before"
    assert not list(folder.glob("*part*"))


@pytest.mark.usefixtures("undrawn")
def test_compare_refuses_a_run_that_did_not_finish_unless_forced(folder: Path) -> None:
    write_status(folder, read_status(folder) | {"status": "failed", "message": "for the test"})
    with pytest.raises(RunFolderError, match="not a finished run"):
        Record.load(folder)
    with pytest.raises(SystemExit, match="not a finished run"):
        compare.main([str(folder)])
    assert compare.main([str(folder), "--force"]) == 0


def test_a_run_that_was_stopped_before_its_second_record_is_refused_in_one_line(folder: Path) -> None:
    whole = (folder / "trajectory.csv").read_text().splitlines(keepends=True)
    for records in (0, 1):
        write_status(folder, read_status(folder) | {"samples": records})
        as_if_killed(folder)
        (folder / "trajectory.csv").write_text("".join(whole[: records + 1]))
        with pytest.raises(SystemExit, match=f"{records} records; there is nothing to compare"):
            compare.main([str(folder), "--force"])


@pytest.mark.usefixtures("drawn_once")
def test_a_figure_is_written_where_it_is_asked_for(folder: Path, tmp_path: Path) -> None:
    assert figure3.main([str(folder), "-o", str(tmp_path / "new" / "three.png")]) == 0
    with pytest.raises(ValueError, match="7 runs: at most 6 fit into one figure"):
        figure3.measure([Record.load(folder)] * 7)
    assert (tmp_path / "new" / "three.png").stat().st_size > 1000
    with pytest.raises(SystemExit, match="must end in one of"):
        figure2.main(["-o", str(tmp_path / "a.xyz")])
    with pytest.raises(SystemExit, match="cannot be written"):
        figure2.main(["-o", str(folder / "scene.toml" / "a.png")])


# --- the page of the paper's three cases ---

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "analysis" / "cases" / "figure3" / "README.md").read_text(encoding="utf-8")


def shown_row(label: str) -> list[list[float]]:
    """Return the numbers of the row of the page's table that starts with a label, by case."""
    (line,) = [line for line in PAGE.splitlines() if line.startswith(f"| {label}")]
    return [[float(word) for word in re.findall(r"[\d.]+(?:e[-+]\d+)?", cell)] for cell in line.split("|")[2:-1]]


@pytest.mark.parametrize(
    ("case", "xi"),
    [
        pytest.param(0, 0.802, marks=pytest.mark.more),
        (1, 1.475),
        pytest.param(2, 2.127, marks=pytest.mark.more),
    ],
)
def test_the_table_of_the_results_page_is_measured(case: int, xi: float, shown: Shown) -> None:
    _, ours, paper = shown(xi)
    # Two digits are printed: half a unit of the second is at most 5 %
    for label, errors in (
        ("paper's order", paper.error),
        ("best theory", ours.error),
        ("exact lattice", ours.lattice_error),
    ):
        assert shown_row(label)[case] == pytest.approx(list(errors.values()), rel=0.05), label
    plain = ratios(0.17)
    wave = mode("TR", xi, plain)
    corrected = abs(nonlinearity(plain, 0.2) * generated_amplitude(wave, plain)) / 2
    assert shown_row("closed form, misprints")[case] == pytest.approx([corrected], rel=5e-4)
    assert shown_row("closed form in LAMMPS")[case] == pytest.approx([ours.predicted], rel=5e-4)
    # Printed: complex fields with 4/3 for 1/2, and 3/2 for √3 in ε
    printed = corrected * (4 / 3) / (1 / 2) * (3 / 2) / np.sqrt(3)
    assert shown_row("second harmonic, as the paper")[case] == pytest.approx([printed], rel=5e-3)
    if ours.measured is not None:
        assert shown_row("LAMMPS, by least squares")[case] == pytest.approx([ours.measured], rel=5e-4)


def test_what_the_caption_of_figure_3_says_of_the_resonance(shown: Shown) -> None:
    record, _, _ = shown(1.475)
    wave = wave_of(record)
    _, q, _ = trajectory("second-order", wave, record.tau)
    assert np.max(np.abs(record.q - q)) == pytest.approx(0.06, abs=0.005)
    late = record.tau > 165 - 4 * np.pi / wave.mode.frequency  # two periods
    angles = wave.mode.frequency * record.tau[late]
    columns = np.column_stack([function(k * angles) for k in (1, 3) for function in (np.cos, np.sin)])
    first, third = np.linalg.norm(np.linalg.lstsq(columns, record.phi[late])[0].reshape(2, 2), axis=1)
    assert third / first == pytest.approx(0.06, abs=0.005)
    assert record.scene.echo_time > 165


def test_compare_is_imported_without_scipy() -> None:
    said = "import sys, granular_analysis.tools.compare; sys.exit('scipy was loaded' if 'scipy' in sys.modules else 0)"
    assert subprocess.run([sys.executable, "-c", said], capture_output=True, text=True).stderr == ""


@pytest.mark.usefixtures("drawn_once")
def test_a_sweep_is_drawn_with_theory_beside_its_runs(tmp_path: Path) -> None:
    scene = Scene.load("tr_periodic").with_values({"packing.rows": 8, "time.duration": 2.0})
    over = {"wave.wavenumber": [np.pi / 2, np.pi / 4], "wave.amplitude": [0.05, 0.1]}
    assert compare.main([str(sweep(scene, over, tmp_path / "sweep").folder)]) == 0
    assert (tmp_path / "sweep" / "compare.png").is_file()
    swept = Swept.load(tmp_path / "sweep")
    assert swept is not None
    records = [Record.load(folder) for folder in swept.folders]
    signals = [compare.compare(record).signals for record in records]
    figure = curves.figure(swept, records, signals, compare.LABELS)
    assert figure is not None
    assert len(figure.axes) == 3
    for line, dots in zip(*(figure.axes[0].lines[start::2] for start in (0, 1)), strict=True):
        np.testing.assert_allclose(line.get_xdata(), [np.pi / 4, np.pi / 2], rtol=1e-12)
        np.testing.assert_allclose(line.get_ydata(), dots.get_ydata(), rtol=0.02)
        assert line.get_label().startswith("theory, amplitude 0.")
    largest = {(record.scene.wavenumber, record.scene.wave.amplitude): np.abs(record.p).max() for record in records}
    assert figure.axes[0].lines[3].get_ydata().tolist() == [largest[xi, 0.1] for xi in sorted(over["wave.wavenumber"])]
    assert figure.axes[-1].get_xlabel() == "wave number (rad per row)"


@pytest.mark.parametrize(("mode", "shown"), [("TR", ("p", "q", "phi")), ("L", ("p",))])
def test_a_signal_that_is_zero_by_symmetry_has_no_panel(
    mode: str, shown: tuple[str, ...], small: Scene, tmp_path: Path
) -> None:
    record = run(small.with_values({"wave.mode": mode}), tmp_path / "run")
    drawn = compare.figure(record, compare.compare(record, "second-order"))
    labels = [axes.get_ylabel() for axes in drawn.axes]
    assert sorted(labels) == sorted([*(compare.LABELS[name] for name in shown), *["difference"] * len(shown)])
