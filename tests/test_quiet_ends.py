"""Quiet ends: the theory of the layer, what a scene may ask of it, and the reflection in LAMMPS."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_lmp import Scene, build, run
from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.modes import FULL, Mode, Physics, bloch_mode
from granular_lmp.crystal.quiet_ends import QuietEnd, quiet_end, reflection
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.errors import SceneError
from granular_lmp.lammps.checkpoints import SPEED
from granular_lmp.problem import prepare
from granular_lmp.runs.launch import resume
from granular_lmp.scene.absorption import quiet_end_of, waves_at_ends
from tests.test_sphere import SILICA

LATTICE = unit_lattice(SILICA)
DRIVEN = Scene.load("tr_driven").with_values({"wave.amplitude": 1e-4, "packing.rows": 81, "absorb.rows": "auto"})


def wave(name: str, wavenumber: float, physics: Physics = FULL) -> Mode:
    return bloch_mode(LATTICE, SILICA, WaveVector.of(wavenumber), name, physics)


# --- theory ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["L", "TR", "RT"])
def test_rows_without_damping_reflect_everything(name: str) -> None:
    # All energy comes back, also that of RT, whose crests run against it; 1e-4: 2e-7 times the rows over the speed
    for rows in (3, 20):
        assert reflection(LATTICE, SILICA, wave(name, 1.0), QuietEnd(rows, 0.0, 2.0, 0.0)) == pytest.approx(1, abs=1e-4)


def test_a_weak_layer_lets_the_wave_through_twice() -> None:
    # WKB: |r| = exp(−∫ c dn/v), while the rate changes little over a wave; v = cos(ξ/2)/2 rows per τ
    rows, strength, xi = 200, 0.02, 1.2
    end = QuietEnd(rows, strength, 2.0, 0.0)
    speed = np.cos(xi / 2) / 2
    expected = strength * rows / 3 / speed
    # The exponent counts rows: the last one half or whole, at either side of the held row
    found = -np.log(reflection(LATTICE, SILICA, wave("L", xi), end))
    assert found == pytest.approx(expected, abs=1.1 * strength / speed)


def test_a_sudden_layer_reflects_by_itself() -> None:
    # A hundred rows with a constant strong rate let nothing through; what comes back is reflected at the step
    sudden, smooth = (QuietEnd(100, 1.0, power, 0.0) for power in (0.0, 3.0))
    assert reflection(LATTICE, SILICA, wave("L", 1.0), sudden) > 0.1
    assert reflection(LATTICE, SILICA, wave("L", 1.0), smooth) < 1e-4


def test_more_rows_reflect_less() -> None:
    found = [quiet_end(LATTICE, SILICA, [wave("TR", 0.4)], 0.5, rows).reflection for rows in (6, 12, 24)]
    assert found[0] > 3 * found[1] > 9 * found[2]


def test_the_fewest_rows_are_taken() -> None:
    waves = [wave("L", 0.5), wave("TR", 0.8)]
    end = quiet_end(LATTICE, SILICA, waves, 1e-3)
    assert end.reflection <= 1e-3
    # To a row in twenty, and one
    assert quiet_end(LATTICE, SILICA, waves, 1e-3, int(0.9 * end.rows) - 1).reflection > 1e-3


def test_without_rotation_a_layer_is_found_too() -> None:
    flat = Physics(rotation=False)
    assert quiet_end(LATTICE, SILICA, [wave("TR", 1.0, flat)], 1e-2, physics=flat).reflection <= 1e-2


def test_oblique_waves_are_refused() -> None:
    oblique = bloch_mode(LATTICE, SILICA, WaveVector.of(1.0, 30.0), "L")
    with pytest.raises(ValueError, match="quiet ends are for waves along y"):
        reflection(LATTICE, SILICA, oblique, QuietEnd(10, 0.1, 2.0, 0.0))


# --- scenes ----------------------------------------------------------------------------------------------------------


def test_auto_is_decided_and_no_echo_limits_the_run() -> None:
    problem = prepare(DRIVEN.with_values({"time.duration": 5000.0}))
    end = quiet_end_of(problem.scene)
    assert end is not None
    assert problem.scene.absorb.rows == end.rows
    assert end.reflection <= 1e-3
    (effect,) = (each for each in problem.effects if each.name == "quiet_ends")
    assert effect.on
    assert effect.number == end.reflection


def test_the_free_second_harmonic_and_the_spectrum_of_a_packet_reach_the_ends() -> None:
    (fundamental, doubled) = waves_at_ends(DRIVEN.with_values({"wave.wavenumber": 0.8}))
    assert doubled.name == "L"
    assert doubled.frequency == pytest.approx(2 * fundamental.frequency, rel=1e-9)  # bisection to 1e-12
    above = DRIVEN.with_values({"wave.mode": "L", "wave.wavenumber": 2.0})  # 2Ω = 2 sin 1 > 1
    assert [each.name for each in waves_at_ends(above)] == ["L"]
    packet = DRIVEN.with_values(
        {"wave.form": "running", "envelope.ramp": 20.0, "envelope.length": 5.0, "packing.rows": 201, "absorb.rows": 40}
    )
    assert len({each.wavenumber for each in waves_at_ends(packet) if each.name == "TR"}) == 3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"absorb.rows": 3}, r"absorb\.rows = 3: reflect 0\.\d+ of the wave, .* must be at least \d+, or \"auto\""),
        ({"packing.rows": 9}, r"absorb\.rows = \d+: leave no room in packing\.rows = 9"),
        ({"packing.rows": "auto"}, r'packing\.rows = "auto": must be declared with absorb\.rows'),
        ({"wave.form": "running"}, r"would damp a wave that fills the packing"),
        ({"wave.form": "running", "packing.ends": "periodic", "packing.rows": 80}, "a periodic cell has no ends"),
        ({"packing.lattice": "square"}, r'packing\.lattice = "square": must be "hexagonal" with absorb\.rows'),
        ({"absorb.reflection": 0.9}, r"absorb\.reflection = 0\.9: must be a number in \[1e-5, 0\.5\]"),
    ],
)
def test_what_cannot_be_quiet_is_refused(changes: dict[str, Any], message: str) -> None:
    plain = changes if "wave.form" not in changes else changes | {"envelope.ramp": 20.0}
    with pytest.raises(SceneError, match=message):
        prepare(DRIVEN.with_values(plain))


def test_only_the_end_that_is_not_driven_absorbs() -> None:
    text = build(DRIVEN).input_text
    assert "variable     depth atom (y-" in text
    packet = {"wave.form": "running", "envelope.ramp": 20.0, "envelope.length": 4.0, "packing.rows": 141}
    assert "variable     depth atom (abs(y)-" in build(DRIVEN.with_values(packet)).input_text


# --- LAMMPS ----------------------------------------------------------------------------------------------------------


def test_quiet_ends_shorten_the_stable_step(tmp_path: Path) -> None:
    scene = DRIVEN.with_values({"packing.rows": 41, "absorb.rows": 12, "time.duration": 100.0, "output.particles": 0})
    limit = prepare(scene).largest_step
    still = scene.with_values({"absorb.rows": 0, "time.duration": 20.0})
    assert limit < 0.8 * prepare(still).largest_step
    with pytest.raises(SceneError, match="with drag"):
        prepare(scene.with_values({"time.sample": limit, "time.timestep": limit}))
    step = 0.95 * limit
    record = run(scene.with_values({"time.sample": step, "time.timestep": step}), tmp_path / "run")
    assert np.abs(record.q).max() < 2  # the wave of the row and what it was switched on with


def test_the_reflection_in_lammps_is_that_of_the_layer(tmp_path: Path) -> None:
    wavenumber, rows = 1.0, 10
    changes = {"wave.mode": "L", "wave.wavenumber": wavenumber, "absorb.rows": rows, "absorb.reflection": 0.5}
    times = {"time.duration": 450.0, "time.sample": 2.0, "output.particles": 2.0, "envelope.ramp": 150.0}
    scene = DRIVEN.with_values(changes | times | {"packing.rows": 41, "time.timestep": 0.1})
    snapshots = run(scene, tmp_path / "run").snapshots()
    tau, frequency = snapshots.tau, prepare(scene).mode.frequency
    field = snapshots.stack("displacement")[:, ::3, 1]
    late = tau > 350  # the ramp has passed all rows twice
    waves = np.column_stack([np.cos(frequency * tau[late]), np.sin(frequency * tau[late])])
    (cosine, sine), *_ = np.linalg.lstsq(waves, field[late])
    n = np.arange(8, 41 - 1 - rows - 6)
    both = np.exp(1j * wavenumber * n[:, None] * [1, -1])
    (ahead, back), *_ = np.linalg.lstsq(both, (cosine + 1j * sine)[n])
    end = quiet_end_of(scene)
    assert end is not None
    expected = reflection(LATTICE, SILICA, prepare(scene).mode, end)
    # Waves that the ramp excites beside the wave leave 3e-3 of it behind
    assert min(abs(ahead), abs(back)) / max(abs(ahead), abs(back)) == pytest.approx(expected, abs=3e-3)
    assert expected > 0.015


def test_a_stopped_run_continues_to_the_rounding_of_its_drags(
    tmp_path: Path, stop: Callable[[Scene, Path], None]
) -> None:
    often = {"output.checkpoint": 123 * 100 / SPEED / 60, "output.particles": 0.0}
    scene = DRIVEN.with_values({"packing.rows": 31, "absorb.rows": 10, "time.duration": 75.0} | often)

    whole = run(scene, tmp_path / "whole")
    stop(scene, tmp_path / "stopped")
    resumed = resume(tmp_path / "stopped")
    # LAMMPS sets a run up with the velocities of the whole step, where drags take those of half a step before
    np.testing.assert_allclose(resumed.q, whole.q, rtol=0, atol=1e-9)
    assert np.abs(whole.q).max() > 0.1
