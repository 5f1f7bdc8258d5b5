"""The second harmonic as it is measured in a record alone, and where a run has none to be measured."""

from dataclasses import replace
from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure.swept import Swept
from granular_analysis.tools.compare import main as compare_main
from granular_lmp import Record, Scene
from granular_lmp.accuracy.oscillator import oscillator_of
from granular_lmp.accuracy.second_harmonic import second_harmonic
from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.modes import bloch_mode
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.rest.linear import mode_of
from granular_lmp.studies.sweep import Sweep, sweep

PERIODIC = Scene.load("tr_periodic").with_values({"wave.amplitude": 0.05, "time.duration": 60.0})


def made(amplitude: float, noise: float, **changes: Any) -> Record:
    """Return a record whose second harmonic is known: as the module's equation says, by its sum of cosines."""
    short = {"time.timestep": 1e-4}  # what is made here has no error of the step
    scene = PERIODIC.with_values({f"wave.{key}": value for key, value in changes.items()} | short)
    tau = np.arange(scene.time.samples + 1) * scene.time.sample
    own = mode_of(scene).frequency
    free = bloch_mode(unit_lattice(scene.sphere), scene.sphere, WaveVector.of(2 * scene.wavenumber), "L").frequency
    drive = 2 * (own * tau - scene.wave.phase)
    p = amplitude * np.sin(drive) + 0.3 * amplitude * np.cos(free * tau) - 2 * amplitude * np.sin(free * tau)
    p += noise * np.random.default_rng(1).standard_normal(len(tau))
    if scene.wave.mode == "L":
        p += np.cos(own * tau) * (1 + 1e-3 * tau)
    return Record.of_centre(tau, p, np.cos(own * tau), np.sin(own * tau), scene)


@pytest.mark.parametrize("changes", [{}, {"phase": 0.7}, {"mode": "L"}, {"mode": "RT", "wavenumber": 1.9635}], ids=str)
def test_a_known_second_harmonic_is_found_with_its_error(changes: dict[str, Any]) -> None:
    amplitude, noise = 1e-3, 1e-6
    found = second_harmonic(made(amplitude, noise, **changes))
    assert found is not None
    # Five standard errors of 121 records of white noise: 1e-6 of all ways to draw it. L has two more pairs of columns
    assert abs(found.amplitude - amplitude) < 5 * found.error
    assert found.error < noise
    assert found.frequency == 2 * mode_of(made(amplitude, noise, **changes).scene).frequency


def test_a_wrong_amplitude_is_found() -> None:
    found = second_harmonic(made(1.1e-3, 1e-6))
    assert found is not None
    assert abs(found.amplitude - 1e-3) > 5 * found.error


@pytest.mark.parametrize(
    "changes",
    [
        {"wave.form": "standing"},
        {"wave.direction": "x", "packing.columns": 16},
        {"effects.damping": True, "effects.viscosity": 1e-8},
        {"effects.contact_opening": True},
    ],
    ids=str,
)
def test_a_run_with_another_form_of_p_has_none(changes: dict[str, Any]) -> None:
    record = made(1e-3, 0.0)
    assert second_harmonic(record) is not None
    assert second_harmonic(replace(record, scene=record.scene.with_values(changes))) is None


# The free wave is the faster of the two, and the one that runs with the fundamental
@pytest.mark.parametrize("changes", [{}, {"mode": "RT", "wavenumber": 1.9635}], ids=str)
def test_two_samples_a_period_of_either_wave_are_the_fewest(changes: dict[str, Any]) -> None:
    record = made(1e-3, 0.0, **changes)
    oscillator = oscillator_of(record.scene)
    longest = pi / max(oscillator.free, 2 * oscillator.wave)
    for sample, there in ((0.99 * longest, True), (1.01 * longest, False)):
        scene = record.scene.with_values({"time.sample": sample, "time.duration": 40 * sample})
        assert (second_harmonic(replace(record, scene=scene)) is not None) == there


def test_a_record_of_few_samples_has_none() -> None:
    record = made(1e-3, 0.0)
    assert (
        second_harmonic(
            replace(record, tau=record.tau[:8], signals={name: values[:8] for name, values in record.signals.items()})
        )
        is None
    )


# --- in a sweep ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Sweep:
    over = {"wave.mode": ["TR", "L"], "wave.wavenumber": [1.1780972450961724, 0.7853981633974483]}
    return sweep(PERIODIC, over, tmp_path_factory.mktemp("harmonic") / "sweep")


def test_the_table_of_a_sweep_holds_it_in_d0_and_metres_and_the_frequency_in_hertz(swept: Sweep) -> None:
    for row in swept.rows:
        record = swept.record(row)
        found, sphere = second_harmonic(record), record.scene.sphere
        assert found is not None
        assert (row["second_harmonic"], row["second_harmonic_error"]) == (found.amplitude, found.error)
        unit = record.scene.wave.amplitude * sphere.static_overlap
        assert row["second_harmonic_m"] == pytest.approx(found.amplitude * unit, rel=1e-14)
        assert row["frequency_Hz"] == pytest.approx(row["frequency"] / sphere.time_scale / (2 * pi), rel=1e-14)
    assert Sweep.load(swept.folder).rows == swept.rows


def test_an_unfinished_run_has_none_of_it(tmp_path: Path) -> None:
    folder = tmp_path / "sweep"
    sweep(PERIODIC, {"time.duration": [2.0]}, folder)
    (folder / "runs" / Sweep.load(folder).rows[0]["run"].partition("/")[2] / "run.json").unlink()
    row = Sweep.load(folder).rows[0]
    assert (row["status"], row["second_harmonic"], row["frequency_Hz"], row["largest_p"]) == ("unfinished", *[None] * 3)


@pytest.mark.usefixtures("unrendered")
def test_compare_prints_a_line_a_run_of_a_sweep_what_was_varied_in_front(
    swept: Sweep, capsys: pytest.CaptureFixture[str]
) -> None:
    assert compare_main([str(swept.folder)]) == 0
    head, *lines = (line.split() for line in capsys.readouterr().out.splitlines())
    assert head[:3] == ["wave.mode", "wave.wavenumber", "against"]
    assert [line[:2] for line in lines] == [[row["wave.mode"], repr(row["wave.wavenumber"])] for row in swept.rows]
    for line, row in zip(lines, swept.rows, strict=True):
        measured, error, predicted, deviation = map(float, line[-4:])
        assert deviation == pytest.approx(measured / predicted - 1, abs=1e-4 + 0.05 * abs(deviation))
        assert abs(deviation) < 0.02  # an L wave of a = 0.05 steepens by as much on its way
        # The two fits have different columns; they agree to what higher orders leave, 2 % of L and 1e-3 of TR
        assert measured == pytest.approx(row["second_harmonic"], rel=0.02 if row["wave.mode"] == "L" else 1e-3)
    assert list(swept.folder.rglob("compare.png")) == [swept.folder / "compare.png"]  # and none of a run


def test_compare_says_how_many_runs_are_missing(swept: Sweep, tmp_path: Path) -> None:
    table = (swept.folder / "sweep.csv").read_text(encoding="utf-8").replace(",finished,", ",failed,", 1)
    for name, text in {"sweep.csv": table, "sweep.json": (swept.folder / "sweep.json").read_text()}.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    found = Swept.load(tmp_path)
    assert found is not None
    assert (len(found.folders), found.missing) == (3, 1)
    (tmp_path / "sweep.csv").write_text(table.replace(",finished,", ",failed,"), encoding="utf-8")
    with pytest.raises(SystemExit, match="none of its 4 runs is finished"):
        Swept.load(tmp_path)
