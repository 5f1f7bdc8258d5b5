"""Signals from samples: what is read and refused, and what they do in LAMMPS beside the signal that was sampled."""

import logging
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.theory import signals
from granular_analysis.theory.catalogue import NETWORK
from granular_analysis.tools import compare
from granular_lmp import Scene, build, run
from granular_lmp.errors import SceneError
from granular_lmp.lammps.installation import lmp_command
from granular_lmp.lammps.outputs import read_snapshots
from granular_lmp.problem import prepare
from granular_lmp.runs.adopt import adopt
from granular_lmp.scene import samples
from granular_lmp.studies.sweep_points import scene_hash
from tests.scene.test_sources import QUIET, SHEET

FREQUENCY, CYCLES, DELAY = 1.2, 2.0, 0.3
LENGTH = 2 * np.pi * CYCLES / FREQUENCY
BURST: dict[str, Any] = {"signal": "burst", "frequency": FREQUENCY, "cycles": CYCLES, "delay": DELAY}
SMALL = SHEET.with_values(
    {
        "source": [{"spheres": [[3, 3]], "force": "x"}],
        "packing.rows": 6,
        "packing.columns": 6,
        "time.duration": 14.0,
        "output.particles": 0.5,
    }
)


def burst_samples(count: int = 81) -> list[list[float]]:
    tau = np.linspace(0, LENGTH, count)
    value = signals.burst(FREQUENCY, CYCLES)(tau)
    return np.column_stack([tau, np.where(np.arange(count) % (count - 1), value, 0.0)]).tolist()


def written(path: Path, pairs: list[list[float]], head: str = "tau,value") -> Path:
    path.write_text(f"{head}\n" + "".join(f"{tau:.9g},{value:.9g}\n" for tau, value in pairs), encoding="utf-8")
    return path


def sources(**keys: Any) -> list[dict[str, Any]]:
    return [{"spheres": [[3, 3]], **keys}]


# --- in LAMMPS -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["force", "motion"])
def test_samples_of_a_burst_do_what_the_burst_does(kind: str, tmp_path: Path) -> None:
    path = str(written(tmp_path / "burst.csv", burst_samples()))
    if kind == "motion":  # as a measured one
        si = [[tau * SMALL.scale.time, value * SMALL.displacement_amplitude] for tau, value in burst_samples()]
        written(tmp_path / "burst.csv", si, "time_s,motion_m")
    signals = {"burst": BURST, "samples": {"signal": path, "delay": DELAY}, "more": {"signal": path, "delay": 0.31}}
    moved = {
        name: run(SMALL.with_values({"source": sources(**{kind: "y"}, **keys)}), tmp_path / name)
        .snapshots()
        .stack("displacement")
        for name, keys in signals.items()
    }
    # The spline of 40 samples a period errs by (2π/40)⁴/384 = 2e-6; the burst's curvature begins with a jump at its
    # ends, where the spline errs by that jump, Ω²/8, times h²/12: 2e-4, over an interval or two
    assert np.abs(moved["samples"] - moved["burst"]).max() < 2e-4
    assert np.abs(moved["more"] - moved["burst"]).max() > 5e-4  # later by 0.01 τ
    assert np.abs(moved["burst"]).max() > 0.1


def test_before_and_after_the_samples_the_signal_is_constant(tmp_path: Path) -> None:
    rise = np.linspace(0, 6, 31)
    pairs = np.column_stack([rise, signals.step(6.0)(rise)]).tolist()
    scene = SMALL.with_values({"source": sources(motion="x", signal=pairs, delay=2.0), "time.duration": 8.0})
    build(scene).write(tmp_path / "deck")
    command = [*lmp_command(1), "-in", "in.sheet", "-screen", "none", "-var", "duration", "14"]  # beyond the last
    subprocess.run(command, cwd=tmp_path / "deck", check=True)
    sphere = {
        step * 0.05: table[21, names.index("Displacement.X")] / (1e-3 * SMALL.sphere.static_overlap * 1e9)
        for step, names, table in read_snapshots(tmp_path / "deck" / "dump.particles")
    }
    assert len(sphere) == 29
    # Rounding of positions 4 µm from the origin, 1e-12 nm of D0 = 2.5e-4 nm
    for tau, moved in sphere.items():
        assert tau > 2 or not moved
        assert tau < 8 or moved == pytest.approx(1, abs=1e-8)
    with pytest.raises(SceneError, match="ends at tau = 8 with 1: must return to 0, or last to time.duration = 14"):
        adopt(tmp_path / "deck", tmp_path / "run")


# --- measured drives -------------------------------------------------------------------------------------------------

# The units of a drive in those of the scene: k1 D0, D0, k1 D0 R, and D0 over R of an angle
RADIUS, D0, K1 = SMALL.sphere.radius, SMALL.displacement_amplitude, SMALL.sphere.normal_stiffness
DRIVES = {
    "force": ({"force": "y"}, "t (µs);Force (nN)", 1e-6, K1 * D0 / 1e-9),
    "motion": ({"motion": "y"}, "Time [ns];Displacement [nm]", 1e-9, D0 / 1e-9),
    "torque": ({"force": "torque"}, "time_ms;torque_nNm", 1e-3, K1 * D0 * RADIUS / 1e-9),
    "rotation": ({"motion": "rotation"}, "time_s;angle_urad", 1.0, D0 / RADIUS / 1e-6),
}


@pytest.mark.parametrize("kind", DRIVES)
def test_a_measured_drive_is_that_of_its_units(kind: str, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    keys, head, second, unit = DRIVES[kind]
    rows = [f"{tau * SMALL.sphere.time_scale / second:.12g};{value * unit:.12g}" for tau, value in burst_samples()]
    text = "\n".join(["Oscilloscope;XYZ", head, *rows, ""]).replace(".", ",")
    (tmp_path / "drive.csv").write_text(text, encoding="utf-8")
    scene = SMALL.with_values({"source": sources(**keys, signal=str(tmp_path / "drive.csv"))})
    (found,) = prepare(scene).sources
    # Twelve digits of the largest time and value
    np.testing.assert_allclose(found.source.sampled, burst_samples(), rtol=0, atol=1e-10)
    assert Scene.loads(scene.to_toml()) == scene
    assert "(81 over " in found.words
    (said,) = caplog.messages
    first, other = (re.split(r"[ _(\[]", each)[0].lower() for each in head.split(";"))
    quantities = {"t": "time", "displacement": "motion"}
    assert f"81 rows: {quantities.get(first, first)} in " in said
    assert f", {quantities.get(other, other)} in " in said
    assert said.endswith("; head to line 2; cells parted by semicolons; decimals with commas")


def test_a_crystal_takes_up_the_newtons_times_seconds_of_its_drive(tmp_path: Path) -> None:
    """Newton's second law in SI units: nothing holds the sheet, so its momentum is the integral of the force."""
    tau, value = np.array(burst_samples()).T
    seconds, newtons = 0.4e-9 * tau, 2e-10 * value
    signal = [["time_s", "force_N"], *np.column_stack([seconds, newtons]).tolist()]
    snapshots = run(SMALL.with_values({"source": sources(force="y", signal=signal)}), tmp_path / "run").snapshots()
    fit = samples.spline(np.column_stack([seconds, newtons]).tolist())
    impulse = [fit.integrate(0, min(t, seconds[-1])) for t in snapshots.tau * SMALL.scale.time]
    mass = 4 / 3 * np.pi * RADIUS**3 * SMALL.sphere.density
    momentum = mass * D0 / SMALL.scale.time * snapshots.stack("velocity")[..., 1].sum(axis=1)
    # Verlet sums the force by the trapezoidal rule: 4.4e-4 with steps of 0.05 τ, a quarter of it with half of them
    np.testing.assert_allclose(momentum, impulse, rtol=0, atol=1e-3 * np.abs(impulse).max())


def test_measured_drives_of_every_kind_do_in_lammps_what_they_do_in_the_network(tmp_path: Path) -> None:
    """The network takes newtons and metres by kg, m and s of its own, not by k1 and D0."""
    drives = []
    for place, (keys, head, second, unit) in zip([[3, 3], [1, 1], [4, 1], [1, 4]], DRIVES.values(), strict=True):
        rows = [[tau * SMALL.sphere.time_scale / second, value * unit] for tau, value in burst_samples()]
        drives.append({"spheres": [place], **keys, "signal": [head.split(";"), *rows]})
    found = compare.compare(run(SMALL.with_values({"source": drives}), tmp_path / "run"))
    assert found.theory == NETWORK
    assert max(found.error.values()) < 2e-3  # of the step, 0.05 τ: 1.4e-3 of φ


def test_a_measured_drive_keeps_its_newtons_in_another_scene() -> None:
    pairs = [[tau * 1e-9, value * 1e-10] for tau, value in burst_samples()]
    scene = SMALL.with_values({"source": sources(force="y", signal=[["time_s", "force_N"], *pairs])})
    other = scene.with_values({"wave.amplitude": 2 * SMALL.amplitude})
    assert other.source == scene.source
    assert prepare(other).sources[0].source.largest == pytest.approx(prepare(scene).sources[0].source.largest / 2)
    assert prepare(scene).sources[0].source.largest == pytest.approx(1e-10 / (K1 * D0))


# --- scenes ----------------------------------------------------------------------------------------------------------


def test_a_file_is_beside_its_scene_and_is_not_needed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    file = written(folder / "push.csv", burst_samples())
    (folder / "scene.toml").write_text(
        SMALL.with_values({"source": sources(force="x", **BURST)}).to_toml().replace('"burst"', '"push.csv"'),
        encoding="utf-8",
    )
    text = (
        (folder / "scene.toml").read_text(encoding="utf-8").replace("frequency = 1.2", "").replace("cycles = 2.0", "")
    )
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    scene = Scene.load("mine/scene.toml")
    assert (
        scene == Scene.load(folder) == SMALL.with_values({"source": sources(force="x", signal=str(file), delay=DELAY)})
    )
    run(scene.with_values({"time.duration": 12.0, "output.particles": 0.0}), "run")
    file.unlink()
    assert Scene.load("run").source == scene.source
    with pytest.raises(SceneError, match=r"mine/scene\.toml: source\.1\.signal = 'mine/push\.csv': cannot be read"):
        Scene.load("mine/scene.toml")


def test_other_samples_are_another_run() -> None:
    scene = SMALL.with_values({"source": sources(force="x", signal=burst_samples())})
    more = [[tau, 1.0001 * value] for tau, value in burst_samples()]
    assert scene_hash(scene) != scene_hash(scene.with_values({"source.1.signal": more}))
    assert Scene.loads(scene.to_toml()) == scene


def test_the_frequency_of_samples_is_that_of_their_curvature() -> None:
    sine = [[0.1 * n, float(np.sin(0.8 * 0.1 * n))] for n in range(400)]
    # Level ends bend the spline there, within an interval or two
    inside = samples.spline(sine)(np.linspace(5, 35, 400), 2)
    assert np.sqrt(np.abs(inside).max()) == pytest.approx(0.8, rel=1e-3)  # h²Ω²/12 of a spline's second derivative
    assert samples.pulsation(burst_samples()) == pytest.approx(FREQUENCY, rel=0.15)  # and the window of two cycles
    assert prepare(SMALL.with_values({"source": sources(force="x", signal=burst_samples())})).sources[
        0
    ].frequency == samples.pulsation(burst_samples())


def test_what_samples_multiply_counts_for_effects() -> None:
    loud = [[tau, 20 * value] for tau, value in burst_samples()]
    scene = SMALL.with_values({"wave.amplitude": 0.05, "source": sources(motion="x", signal=burst_samples())})
    assert not prepare(scene).on["contact_opening"]
    assert prepare(scene.with_values({"source.1.signal": loud})).on["contact_opening"]


TOO_FEW = burst_samples(17)


def changed(place: int, column: int, value: float) -> list[list[float]]:
    pairs = burst_samples()
    pairs[place][column] = value
    return pairs


@pytest.mark.parametrize(
    ("signal", "message"),
    [
        (
            "noise",
            r"source\.1\.signal = 'noise': must be one of \"tone\", .*, or a file \"NAME\.csv\" with the columns",
        ),
        ("none.csv", r"source\.1\.signal = 'none\.csv': cannot be read: No such file or directory$"),
        ("\0.csv", "cannot be read: embedded null byte"),
        (changed(7, 1, 2e6), "2e\\+06 among the numbers: must be from -1e\\+06 to 1e\\+06"),
        ([["time_s", "motion_m"], *burst_samples()], 'signal: has motion_m: must be force with force = "x"'),
        ([["time_s", "force_lb"], *burst_samples()], "column 'force_lb': the unit must be one of force_N"),
        ([["time_s", "tau"], *burst_samples()], "must have the columns tau,value, or time_s and one of force_N"),
        (burst_samples()[:4], "4 samples: must be from 5 to 10000"),
        ([[0.0, 0.0], [1.0]], r"source\.1\.signal\[1\] = \[1\.0\]: must be \[tau, value\], two numbers"),
        ([[0.0, 0.0], [1.0, True]], r"source\.1\.signal\[1\] = \[1\.0, True\]: must be \[tau, value\]"),
        ([[0.0, 0.0], [1.0, float("nan")]], r"source\.1\.signal\[1\] = \[1\.0, nan\]: must be \[tau, value\]"),
        ([[tau + 1, value] for tau, value in burst_samples()], "begins at tau = 1: must begin at 0; a delay is"),
        (changed(7, 0, 0.2), "tau = 0.2 after a later time: tau must increase"),
        (changed(7, 0, 0.95), "must be equal within 1e-06 of a step"),
        (changed(0, 1, 0.1), "first value 0.1, largest 1: must begin at 0"),
        ([[n, 0.0] for n in range(9)], "first value 0, largest 0: must begin at 0, and not be 0 throughout"),
        (TOO_FEW, r"every second sample misses the others by 0\.\d+ of the largest: must be at most 0\.01"),
        (changed(40, 1, 0.9), r"around tau = 5\."),
        (
            burst_samples()[:60],
            r"source 1: signal: ends at tau = 7\.\d+ with -?0\.\d+: must return to 0, or last to",
        ),
    ],
)
def test_samples_that_are_no_signal_are_refused_by_name(signal: Any, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        SMALL.with_values({"source": sources(force="x", signal=signal)})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "",
            "has no head; must have a line of angle_UNIT, force_UNIT, motion_UNIT, tau, time_UNIT, torque_UNIT, value",
        ),
        ("0,0\n1,1\n", "torque_UNIT, value; line 1 is '0,0'"),
        ("tau,value\n0,0\n0.1;1\n", "line 3: 1 cells under 2 heads"),
        ("tau,value\n0,0\n0.2\n", "line 3: 1 cells under 2 heads"),
        ("tau,value\n0,0,0\n", "line 2: 3 cells under 2 heads"),
        ("tau\n0\n", "must have the columns tau,value, or time_s and one of force_N, .* here tau"),
        ("tau,value\n0,inf\n", "line 2 must be two numbers, here 0, inf"),
        ("tau,value\n0,1_0\n", "line 2 must be two numbers, here 0, 1_0"),
    ],
)
def test_a_file_that_is_no_table_is_refused_with_its_line(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "file.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SceneError, match=message):
        SMALL.with_values({"source": sources(force="x", signal=str(path))})


def test_samples_go_with_no_frequency_and_no_quiet_ends() -> None:
    with pytest.raises(
        SceneError, match='frequency = 1.0: is for signal = tone or burst or chirp or ricker only, not "samples"'
    ):
        SMALL.with_values({"source": sources(force="x", signal=burst_samples(), frequency=1.0)})
    with pytest.raises(SceneError, match='signal = "samples": must be "tone" or "burst" or "chirp" with absorb.rows'):
        QUIET.with_values({"source": [{"rows": [100, 100], "motion": "x", "signal": burst_samples()}]})
    with pytest.raises(SceneError, match=r"time\.timestep = 0\.3: leaves a period of source 1 fewer than 20 steps"):
        prepare(SMALL.with_values({"source": sources(force="x", signal=burst_samples()), "time.timestep": 0.3}))
    many = [{"spheres": [[1, n]], "force": "x", "signal": burst_samples(3001)} for n in range(4)]
    with pytest.raises(SceneError, match="source: 12004 samples: must be at most 10000 in all signals together"):
        SMALL.with_values({"source": many})
