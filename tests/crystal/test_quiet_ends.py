"""Quiet ends: the theory of the layer, what a scene may ask of it, and the reflection in LAMMPS."""

import re
from pathlib import Path

import numpy as np
import pytest

from cases.quiet.case import expected
from cases.quiet.case import measured as reflected
from granular_lmp import Scene, build, run
from granular_lmp.crystal.lattices import CHAIN, HEXAGONAL, SQUARE, Lattice, unit_lattice
from granular_lmp.crystal.mode import FULL, Mode, Physics
from granular_lmp.crystal.modes import bloch_mode
from granular_lmp.crystal.quiet_ends import QuietEnd, frequency_in_lattice, frequency_in_run, quiet_end, reflection
from granular_lmp.crystal.row_waves import line_of, waves
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.problem import prepare
from granular_lmp.rest.absorption import quiet_end_of, waves_at_ends
from granular_lmp.rest.held import largest_step
from tests.crystal.test_sphere import SILICA
from tests.manual import Measure, Mutant, verifies

LATTICE = unit_lattice(SILICA)
DRIVEN = Scene.load("tr_driven").with_values({"wave.amplitude": 1e-4, "packing.rows": 81, "absorb.rows": "auto"})


def wave(name: str, wavenumber: float, physics: Physics = FULL) -> Mode:
    return bloch_mode(LATTICE, SILICA, WaveVector.of(wavenumber), name, physics)


# --- theory ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["L", "TR", "RT"])
@verifies(
    "Quiet end without damping, reflection of L, TR, RT less 1",
    reference="analytic: energy is conserved",
    tolerance=0.0001,
    reason="the frequency has an imaginary part of 1e-7, times the rows over the speed",
    mutant=Mutant(
        "granular_lmp/crystal/quiet_ends.py",
        "(frequency + 1j * rate) * inertia",
        "(frequency + 1j * (rate + 1e-3)) * inertia",
    ),
)
def test_rows_without_damping_reflect_everything(name: str, measured: Measure) -> None:
    # All energy comes back, also that of RT, whose crests run against it; 1e-4: 2e-7 times the rows over the speed
    for rows in (3, 20):
        measured(reflection(LATTICE, SILICA, wave(name, 1.0), QuietEnd(rows, 0.0, 2.0, 0.0)) - 1)


def test_a_sudden_layer_reflects_by_itself() -> None:
    # A hundred rows with a constant strong rate let nothing through; what comes back is reflected at the step
    sudden, smooth = (QuietEnd(100, 1.0, power, 0.0) for power in (0.0, 3.0))
    assert reflection(LATTICE, SILICA, wave("L", 1.0), sudden) > 0.1
    assert reflection(LATTICE, SILICA, wave("L", 1.0), smooth) < 1e-4


@pytest.mark.parametrize("lattice", [SQUARE, CHAIN], ids=lambda lattice: lattice.name)
def test_rows_that_let_the_next_ones_roll_have_waves_that_end_after_one_row(lattice: Lattice) -> None:
    # A contact between rows resists two of the three motions: one wave of three decays at once in either direction
    line = line_of(unit_lattice(SILICA, lattice), SILICA)
    still = line.on_site - (0.4 * (1 + 1e-7j)) ** 2 * np.diag(line.mass)
    factor, shape = waves(line, still)
    size = np.sort(np.abs(factor))
    assert size[0] < 1e-12
    assert size[-1] > 1e12
    for step, s in zip(factor, shape.T, strict=True):
        if 1e-12 < abs(step) < 1e12:
            left = line.behind @ s / step + still @ s + line.ahead @ s * step
            assert np.abs(left).max() < 1e-12


# The slopes of sin(ξ/2) and of √(2/(κ + 3)) sin(ξ/2), rows per τ
@pytest.mark.parametrize(
    ("lattice", "slope"),
    [(HEXAGONAL, 0.5), *((each, 1 / np.sqrt(2 * (SILICA.stiffness_ratio + 3))) for each in (SQUARE, CHAIN))],
)
def test_a_weak_layer_lets_the_wave_through_twice(lattice: Lattice, slope: float) -> None:
    # WKB: |r| = exp(−∫ c dn/v), while the rate changes little over a wave
    contacts, rows, strength, xi = unit_lattice(SILICA, lattice), 200, 0.02, 1.2
    wave = bloch_mode(contacts, SILICA, lattice.vector(xi), "L", FULL)
    speed = slope * np.cos(xi / 2)
    # The exponent counts rows: the last one half or whole, at either side of the held row
    found = -np.log(reflection(contacts, SILICA, wave, QuietEnd(rows, strength, 2.0, 0.0)))
    assert found == pytest.approx(strength * rows / 3 / speed, abs=1.1 * strength / speed)


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


def test_only_the_end_that_is_not_driven_absorbs() -> None:
    text = build(DRIVEN).input_text
    assert "variable     depth atom round((y-" in text
    packet = {"wave.form": "running", "envelope.ramp": 20.0, "envelope.length": 4.0, "packing.rows": 141}
    assert "variable     depth atom round((abs(y)-" in build(DRIVEN.with_values(packet)).input_text


# --- the step --------------------------------------------------------------------------------------------------------


RT = DRIVEN.with_values({"wave.mode": "RT", "wave.wavenumber": 0.6, "time.sample": 2.0, "output.particles": 0.0})


@pytest.mark.parametrize("step", [0.0125, 0.1, 0.4])
def test_what_is_promised_is_the_largest_reflection_at_the_step_that_runs(step: float) -> None:
    problem = prepare(RT.with_values({"time.timestep": step}))
    end = quiet_end_of(problem.scene)
    assert end is not None
    found = [reflection(LATTICE, SILICA, wave, end, step=step) for wave in waves_at_ends(problem.scene, step)]
    assert end.reflection == max(found) <= 1e-3
    (effect,) = (each for each in problem.effects if each.name == "quiet_ends")
    assert effect.number == end.reflection
    assert f"; {end.reflection:.1e} of the amplitude is reflected at this step" in build(problem.scene).input_text


def test_a_longer_step_takes_more_rows() -> None:
    # It lowers the frequency in the lattice that a driven row has, and slow waves of RT are the higher ones
    rows = [prepare(RT.with_values({"time.timestep": step})).scene.absorb.rows for step in (0.0125, 0.4)]
    assert rows[0] < rows[1]


def test_the_step_lowers_the_frequency_in_the_lattice_and_the_drag() -> None:
    # From M (X₊ − 2X + X₋)/h² + cM (X₊ − X₋)/2h with X = e^{−iΩ'τ}, the definition of the step
    frequency, step, rate = 1.3, 0.4, 0.7
    of_run = frequency_in_run(frequency, step)
    assert frequency_in_lattice(of_run, step) == pytest.approx(frequency, rel=1e-14)
    ahead, back = np.exp(-1j * of_run * step), np.exp(1j * of_run * step)
    inertia = -(ahead - 2 + back) / step**2 - rate * (ahead - back) / (2 * step)
    expected = frequency * (frequency + 1j * rate * np.sqrt(1 - (frequency * step / 2) ** 2))
    assert inertia == pytest.approx(expected, rel=1e-13)  # 1/h² of rounding


def test_all_runs_to_a_tolerance_have_one_layer() -> None:
    scene = prepare(RT.with_values({"time.tolerance": 1e-2})).scene
    whole = quiet_end_of(scene)
    assert whole is not None
    assert whole.reflection <= 1e-3  # at step zero, to which they are extrapolated
    said = []
    for step in (0.4, 0.2, 0.1, 0.05):
        part = prepare(scene.with_values({"time.timestep": step}))
        end = quiet_end_of(part.scene)
        assert end is not None
        assert (end.rates() == whole.rates()).all()
        said += [each for each in part.warnings() if "absorb.rows" in each]
    # Only the steps that are too long for these rows are remarked on, and none is refused
    assert re.fullmatch(
        rf"absorb\.rows = {whole.rows}: reflect 0\.00\d+ of the wave at time\.timestep = 0\.4, more than "
        r"absorb\.reflection = 0\.001; use \d+ rows, or a shorter step",
        said[0],
    )
    assert len(said) < 4
    enough = int(said[0].split("take ")[1].split()[0])
    assert not prepare(RT.with_values({"time.timestep": 0.4, "absorb.rows": enough})).warnings()


# --- LAMMPS ----------------------------------------------------------------------------------------------------------


def test_quiet_ends_leave_the_stable_step_as_it_is(tmp_path: Path) -> None:
    scene = DRIVEN.with_values({"packing.rows": 41, "absorb.rows": 12, "time.duration": 100.0, "output.particles": 0})
    limit = largest_step(prepare(scene).scene)
    assert limit == largest_step(prepare(scene.with_values({"absorb.rows": 0, "time.duration": 20.0})).scene)
    step = 0.95 * limit
    record = run(scene.with_values({"time.sample": step, "time.timestep": step}), tmp_path / "run")
    assert np.abs(record.q).max() < 2  # the wave of the row and what it was switched on with


# At step zero the layer of RT reflects half as much, 2.4e-3; with a drag as a force it had 1.6e-2 at this step
@pytest.mark.parametrize(
    ("lattice", "name", "wavenumber", "rows", "step"),
    [
        ("hexagonal", "L", 0.7, 6, 0.4),
        pytest.param("hexagonal", "TR", 2.3, 6, 0.25, marks=pytest.mark.more),
        pytest.param("hexagonal", "RT", 1.3, 5, 0.25, marks=pytest.mark.more),
        pytest.param("square", "L", 0.9, 5, 0.4, marks=pytest.mark.more),
        pytest.param("square", "TR", 1.3, 5, 0.25, marks=pytest.mark.more),
        pytest.param("square", "RT", 1.3, 4, 0.25, marks=pytest.mark.more),
        pytest.param("chain", "L", 0.9, 4, 0.25, marks=pytest.mark.more),
        ("chain", "RT", 1.3, 4, 0.4),
    ],
)
@verifies(
    "Quiet ends in LAMMPS: reflection of eight waves at their time steps, relative",
    reference="other code: the layer in theory, at the same step",
    tolerance=0.008,
    reason="what the ramp excites leaves 3e-5 of the wave, the reflections are 4e-3 and more",
    mutant=Mutant(
        "granular_lmp/crystal/quiet_ends.py",
        "rates = end.rates()[None] * sqrt(1 - half**2)",
        "rates = end.rates()[None] * (1 - half**2)",
    ),
)
def test_the_reflection_in_lammps_is_that_of_the_layer_at_its_step(
    lattice: str, name: str, wavenumber: float, rows: int, step: float, tmp_path: Path, measured: Measure
) -> None:
    changes = {"packing.lattice": lattice, "packing.columns": 1}
    changes |= {"wave.mode": name, "wave.wavenumber": wavenumber, "absorb.rows": rows, "absorb.reflection": 0.5}
    slow = 1 if lattice == "hexagonal" else 2  # no wave of the others runs faster than 0.41 rows per tau
    times = {"time.duration": 520.0 * slow, "time.sample": 2.0, "output.particles": 2.0, "envelope.ramp": 150.0 * slow}
    scene = DRIVEN.with_values(changes | times | {"packing.rows": 31, "time.timestep": step})
    found = reflected(run(scene, tmp_path / "run"))
    # What the ramp excites beside the wave has left 3e-5 of it behind
    assert found == pytest.approx(expected(scene), rel=2e-3, abs=3e-5)
    assert found > 0.004
    measured(found / expected(scene) - 1)


def test_the_page_has_the_reflection_at_each_step() -> None:
    lines = (Path(__file__).parents[2] / "docs/studies.md").read_text("utf-8").splitlines()
    steps, numbers, found = (
        [float(cell) for cell in line.strip("| ").split(" | ")[1:]]
        for line in lines
        if line.startswith(("| step | 0 |", "| ξ of the wave that", "| reflection of five"))
    )
    scene = RT.with_values({"packing.rows": 31, "absorb.rows": 5, "absorb.reflection": 0.5})
    for step, number, share in zip(steps, numbers, found, strict=True):
        at_step = scene.with_values({"time.timestep": step or 1e-3})
        # As many digits as are printed
        assert waves_at_ends(at_step, at_step.time.step)[0].wavenumber == pytest.approx(number, abs=5.1e-4)
        assert expected(at_step) == pytest.approx(share, abs=5.1e-6)
