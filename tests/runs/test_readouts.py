"""Read-outs of monitors: harmonics of the drive and the static field, with their errors, and as columns of a sweep."""

import csv
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cases.driven.waves import driven_amplitudes
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import Wave
from granular_lmp import Record, Scene, run
from granular_lmp.errors import ReadoutError, ViewError
from granular_lmp.plot.view import sweep_figure
from granular_lmp.runs.readouts import readout, readout_columns, steady_part
from granular_lmp.studies.sweep import Sweep, sweep
from tests.manual import Measure, Mutant, verifies

DRIVEN = Scene.load("tr_driven").with_values(
    {"wave.wavenumber": 1.2, "wave.amplitude": 0.05, "envelope.ramp": 30.0, "output.particles": 0.0}
    | {"packing.rows": 75}
    | {"time.duration": 180.0, "time.timestep": 0.1, "time.sample": 0.5}
    | {"monitor": [{"name": "near", "rows": [3, 3]}, {"name": "far", "rows": [8, 8]}]}
)
TONE = DRIVEN.with_values(
    {
        "wave.form": "none",
        "envelope.ramp": 20.0,
        "packing.rows": 21,
        "packing.columns": 3,
        "absorb.rows": 0,
        "time.allow_echo": True,
    }
    | {"source": [{"rows": [10, 10], "motion": "x", "frequency": 0.6, "ramp": 10.0}]}
    | {"monitor": [{"name": "line", "rows": [12, 12]}], "time.duration": 120.0}
)


def read(signal: np.ndarray, tau: np.ndarray, frequency: float) -> dict[str, Any]:
    """Return what is read off a monitor of two spheres that move against one another, by the time that is recorded."""
    moved = np.stack([signal, -signal], axis=1)
    still = np.zeros_like(moved)
    scene = TONE.with_values({"source.1.frequency": frequency, "time.sample": float(tau[1] - tau[0])})
    made = {"displacement": np.stack([moved, still], axis=-1), "rotation": np.full_like(moved, np.nan)}
    record: Any = SimpleNamespace(scene=scene, monitor=scene.monitor[0], tau=tau, **made)
    return readout(record)


@verifies(
    "Harmonics read off a monitor, 1, 2 and 3 beside a drift",
    reference="analytic: the amplitudes put in",
    tolerance=1e-12,
    reason="rounding of sums of a hundred numbers of order 1",
    mutant=Mutant(
        "granular_lmp/runs/readouts.py",
        "[np.ones_like(tau), tau - tau.mean(), *turning]",
        "[np.ones_like(tau), *turning, tau - tau.mean()]",
    ),
)
def test_harmonics_are_found_whatever_their_phases(measured: Measure) -> None:
    tau, frequency = np.arange(0.0, 120.01, 0.5), 0.6
    made = (
        0.9 * np.cos(frequency * tau - 0.3)
        + 0.02 * np.sin(2 * frequency * tau)
        + 1e-4 * np.cos(3 * frequency * tau + 1)
    )
    found = read(made + 1e-3 * tau, tau, frequency)
    for order, amplitude in (("1", 0.9), ("2", 0.02), ("3", 1e-4)):
        value, error = found["u"][order]
        measured(value - amplitude)
        assert error < 1e-12
    assert "phi" not in found  # which was not tracked
    assert found["v"]["1"] == [0.0, 0.0]


def test_a_decaying_transient_is_within_the_error() -> None:
    tau, frequency = np.arange(0.0, 120.01, 0.5), 0.6
    transient = 0.3 * np.exp(-tau / 40)
    value, error = read((1 + transient) * np.cos(frequency * tau), tau, frequency)["u"]["1"]
    late = tau > 67  # after the ramp of 10 and the way of 2 rows at half a row per t0, the second half up to 120
    # The mean is off by the mean of the transient. The difference of the halves, each of which it decays in by half,
    # is a measure of it within a factor of about 2
    assert 0.4 * error < abs(value - 1) < 4 * error
    assert value - 1 == pytest.approx(transient[late].mean(), rel=0.1)


def test_the_static_field_has_its_sign() -> None:
    tau = np.arange(0.0, 120.01, 0.5)
    scene = TONE
    moved = np.full((len(tau), 1), -0.25) + 0.1 * np.cos(0.6 * tau)[:, None]
    record: Any = SimpleNamespace(
        scene=scene, monitor=scene.monitor[0], tau=tau, displacement=np.stack([moved, moved], -1), rotation=moved
    )
    found = readout(record)
    assert found["phi"]["static"][0] == pytest.approx(-0.25, abs=1e-12)  # rounding
    assert readout_columns({"monitors": {"a": found}})["a.v_static"] == found["v"]["static"][0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wave.form": "running", "source": []}, 'wave.form = "running": nothing drives the crystal at one frequency'),
        ({"source.1.signal": "burst", "source.1.ramp": 20.0}, r'source 1: signal = "burst": must be "tone"'),
        (
            {"source": [*({"rows": [r, r], "force": "x", "frequency": 0.5 + r / 100} for r in (9, 11))]},
            r"source 2: frequency = 0\.61: differs from 0\.59 of source 1",
        ),
        ({"time.duration": 60.0}, r"leaves 2\.2 steady periods up to tau = 60; must be 4, up to 97\.78: a longer"),
        ({"time.sample": 2.0}, r"time\.sample = 2\.0: must be below 1\.745, half a period of harmonic 3"),
    ],
)
def test_why_nothing_can_be_read_off(changes: dict[str, Any], message: str) -> None:
    scene = TONE.with_values(changes)
    with pytest.raises(ReadoutError, match=message):
        steady_part(scene, scene.monitor[0])


def test_the_steady_part_ends_with_the_echo_unless_the_scene_allows_it() -> None:
    assert steady_part(DRIVEN, DRIVEN.monitor[0])[2] == 180.0
    later = DRIVEN.with_values({"monitor.1.rows": [70, 70]})
    with pytest.raises(ReadoutError, match=r"up to tau = 126\.1.*allow_echo = true or quiet ends"):
        steady_part(later, later.monitor[0])
    allowed = later.with_values({"time.allow_echo": True, "time.duration": 320.0})
    assert steady_part(allowed, allowed.monitor[0])[2] == 320.0


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Record:
    return run(DRIVEN, tmp_path_factory.mktemp("readouts") / "run")


def test_the_harmonics_of_a_driven_row_are_those_of_theory(driven: Record) -> None:
    sphere, wave = driven.scene.sphere, driven.scene.wave
    contact = Contact(sphere.poisson_ratio, overlap_ratio=sphere.overlap_ratio)
    (_, q, phi), p = driven_amplitudes(Wave.of_mode("TR", wave.wavenumber, wave.amplitude, contact), [3, 8])
    for number, name in enumerate(("near", "far")):
        found = driven.info["monitors"][name]
        # Velocity Verlet at 0.1 errs by (Ω h)²/24 = 1e-4 of a frequency, and the next order is a² = 2.5e-3 times 0.1
        assert found["u"]["1"][0] == pytest.approx(abs(q[number]), rel=1e-3)
        assert found["phi"]["1"][0] == pytest.approx(abs(phi[number]), rel=1e-3)
        value, error = found["v"]["2"]
        assert value == pytest.approx(abs(p[number]), rel=5e-3, abs=3 * error)  # the next order, a² times 2
        # What symmetry forbids: what the ramp leaves of p at Ω, and of q at 2Ω
        assert found["v"]["1"][0] < 1e-3 * found["u"]["1"][0]
        assert found["u"]["2"][0] < 1e-4 * found["u"]["1"][0]


def test_a_sweep_over_frequency_is_a_response_curve(tmp_path: Path) -> None:
    over = {"source.1.frequency": [0.55, 0.75], "time.duration": [120.0, 10.0]}  # the second is too short to be steady
    done = sweep(TONE, over, tmp_path / "sweep")
    with (tmp_path / "sweep" / "sweep.csv").open(encoding="utf-8", newline="") as stream:
        table = list(csv.DictReader(stream))
    assert list(table[0]) == done.columns
    for row in table[::2]:
        info = done.record(dict(row)).info["monitors"]["line"]
        assert info["frequency"] == float(row["source.1.frequency"])
        for name, order in (("u1", "1"), ("u_static", "static"), ("u3", "3")):
            assert [float(row[f"line.{name}"]), float(row[f"line.{name}_error"])] == info["u"][order]
    assert [row["line.phi3_error"] == "" for row in table] == [False, True, False, True]
    again = Sweep.load(tmp_path / "sweep")
    np.testing.assert_array_equal(again.column("line.v2"), done.column("line.v2"))
    assert np.isnan(again.column("line.u1")[1])
    (axes,) = sweep_figure(again, "line.u1").axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == (
        "frequency of source 1 (rad/$t_0$)",
        r"$u$ at $\Omega$, monitor line ($D_0$)",
    )
    assert len(axes.containers) == 2  # error bars of each curve
    short = sweep(TONE, {"time.duration": [10.0]}, tmp_path / "short")
    with pytest.raises(ViewError, match=r"column = 'line\.u1': time\.duration = 10\.0: leaves .* steady periods"):
        sweep_figure(short, "line.u1")
