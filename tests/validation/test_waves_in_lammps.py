"""Waves of any direction, and finite ones, through LAMMPS: symmetries, routes, resumption."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.measure import sheets
from granular_analysis.measure.norms import relative_error
from granular_analysis.measure.rows import load_form
from granular_analysis.theory import catalogue
from granular_analysis.theory.choice import traits_of
from granular_analysis.tools import compare
from granular_lmp import Record, Scene, run
from granular_lmp.accuracy.estimates import richardson
from granular_lmp.runs.launch import resume
from tests.conftest import PAPER, members
from tests.manual import Measure, Mutant, differing, off, verifies

EIGHTH = np.pi / 4  # rad per row
SHORT = {"wave.amplitude": 0.2, "time.duration": 40.0, "wave.wavenumber": EIGHTH}
ALONG_Y = PAPER.with_values(SHORT | {"packing.ends": "periodic", "packing.rows": 8})
# 60° from y, where the lattice is the same: ξ at 30° advances the phase by ξ a column and ξ/2 a row
TURNED = PAPER.with_values(
    SHORT | {"packing.ends": "periodic", "packing.rows": 16, "packing.columns": 8, "wave.direction": 30.0}
)
OBLIQUE = Scene.load("tr_oblique").with_values({"time.duration": 5.0, "output.particles": 1.0})
DRIVEN = Scene.load("tr_driven").with_values({"packing.rows": 41, "time.duration": 40.0, "output.particles": 1.0})
BEAM = Scene.load("l_beam").with_values({"time.duration": 20.0, "packing.rows": 21})
PULSE = Scene.load("tr_pulse").with_values({"time.duration": 6.0})
GRATING = Scene.load("tr_grating").with_values({"time.duration": 10.0})
HEARD = DRIVEN.with_values({"packing.rows": 15, "time.duration": 22.0})  # at the centre, within the duration
ALL = [OBLIQUE, HEARD, BEAM, PULSE, GRATING]


@pytest.mark.parametrize("mode", members(["L", "TR", "RT"], "RT"))
@verifies(
    "LAMMPS: a wave turned by 60° as one along y, L, TR, RT, in D0",
    reference="analytic: symmetry of the hexagonal lattice",
    tolerance=1e-08,
    reason="rounding of positions, 1e-10 of D0 in cells this small, and what 800 steps add",
    mutant=Mutant(
        "granular_lmp/runs/record.py", 'scene.vector.along(table["ux"], table["uy"]) / (metre', 'table["uy"] / (metre'
    ),
)
def test_a_wave_turned_by_60_degrees_is_the_same_wave(mode: str, tmp_path: Path, measured: Measure) -> None:
    up, turned = (
        run(scene.with_values({"wave.mode": mode}), tmp_path / name)
        for name, scene in (("up", ALONG_Y), ("turned", TURNED))
    )
    # To the rounding of positions, 1e-10 of D0 in cells this small, and what 800 steps add
    for name in ("p", "q", "phi"):
        measured(off(getattr(turned, name), getattr(up, name), size=1))
    assert np.abs(up.p).max() > 1e-4  # RT has the smallest second harmonic


def test_a_wave_that_runs_down_is_the_mirror_of_one_that_runs_up(tmp_path: Path) -> None:
    up = run(ALONG_Y, tmp_path / "up")
    down = run(ALONG_Y.with_values({"wave.direction": -90.0}), tmp_path / "down")
    # The mode of −k: p and q in its own frame are those of k, which is turned by 180°
    for name in ("p", "q", "phi"):
        np.testing.assert_allclose(getattr(down, name), getattr(up, name), atol=1e-9)


@pytest.mark.parametrize("scene", members(ALL, OBLIQUE, BEAM, PULSE, GRATING), ids=lambda scene: scene.name)
def test_module_and_program_write_the_same_bytes(scene: Scene, tmp_path: Path) -> None:
    for launcher in ("module", "lmp"):
        run(scene, tmp_path / launcher, launcher=launcher)
    for name in ("dump.centre", "trajectory.csv"):
        assert (tmp_path / "module" / name).read_bytes() == (tmp_path / "lmp" / name).read_bytes()


@pytest.mark.more  # as the paper's wave in tests/runs/test_launch.py
@pytest.mark.parametrize("scene", [OBLIQUE, HEARD], ids=lambda scene: scene.name)
def test_two_ranks_agree_with_one(scene: Scene, tmp_path: Path) -> None:
    one, two = (run(scene, tmp_path / str(ranks), ranks=ranks) for ranks in (1, 2))
    for name in ("p", "q", "phi"):
        np.testing.assert_allclose(getattr(two, name), getattr(one, name), atol=1e-9)


@pytest.mark.parametrize("scene", members([OBLIQUE, DRIVEN, BEAM], BEAM), ids=lambda scene: scene.name)
@verifies(
    "Resume: a run that was stopped and continued, bytes that differ",
    reference="other run: the same without a stop",
    tolerance=0.0,
    reason="the same bytes: a checkpoint holds every bit of positions, velocities and slips",
    mutant=Mutant(
        "granular_lmp/lammps/start.py",
        "return [_REFERENCE, *plane(problem), STEP]",
        'return [_REFERENCE, *plane(problem), STEP.replace("v_step", "1.001*v_step")]',
    ),
)
def test_a_stopped_run_resumes_as_if_it_had_not_been_stopped(
    scene: Scene, tmp_path: Path, stop: Callable[[Scene, Path], None], measured: Measure
) -> None:
    scene = scene.with_values({"time.timestep": scene.time.duration / 600})  # long enough to be stopped on the way
    whole = run(scene, tmp_path / "whole")

    stop(scene, tmp_path / "stopped")
    resumed = resume(tmp_path / "stopped")
    assert len(resumed.tau) == len(whole.tau)
    if scene is BEAM:  # a wide sheet between held rows: contacts may be summed in another order
        for name in ("p", "q", "phi"):
            np.testing.assert_allclose(getattr(resumed, name), getattr(whole, name), atol=1e-13)
            measured(0.0)
        return
    for name in ("dump.centre", "dump.particles"):
        measured(differing(*((tmp_path / each / name).read_bytes() for each in ("stopped", "whole"))))


def rows_of(record: Record) -> dict[str, Any]:
    """Displacements (T, rows, columns, 2) and rotations (T, rows, columns) of all spheres, in D0."""
    snapshots, shape = record.snapshots(), record.scene.shape
    grid = (len(snapshots), shape.rows, shape.columns)
    displacement, rotation = snapshots.stacks("displacement", "rotation")
    return {
        "tau": snapshots.tau,
        "displacement": displacement.reshape(*grid, 2),
        "rotation": rotation.reshape(grid),
    }


@pytest.fixture(scope="module", params=members([0.4, -1.3], -1.3))
def driven(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Record:
    """A run of a driven row, whose phase is a parameter."""
    return run(DRIVEN.with_values({"wave.phase": request.param}), tmp_path_factory.mktemp("driven") / "run")


def test_the_driven_row_does_what_it_is_told_and_does_not_turn(driven: Record) -> None:
    scene, rows = driven.scene, rows_of(driven)
    s = np.minimum(rows["tau"] / scene.envelope.ramp, 1)
    swing = s**3 * (10 - 15 * s + 6 * s**2) * np.cos(driven.info["frequency"] * rows["tau"] - scene.wave.phase)
    # 1e-9: the rounding of positions of the first row, 17 µm from the centre
    np.testing.assert_allclose(-rows["displacement"][:, 0, :, 0], np.tile(swing[:, None], 3), atol=1e-9)
    assert not rows["displacement"][:, 0, :, 1].any()
    assert not rows["rotation"][:, 0].any()
    assert not rows["displacement"][:, -1].any()


def test_nothing_runs_ahead_of_the_fastest_wave(driven: Record) -> None:
    rows, n = rows_of(driven), np.arange(41)
    for tau, moved in zip(rows["tau"], np.abs(rows["displacement"]).max(axis=(2, 3)), strict=True):
        ahead = n > tau / 2 + 3.5 * max(tau / 2, 1.0) ** (1 / 3)  # `shape.echo_time`
        assert moved[ahead].max(initial=0.0) < 1e-6


def test_a_pulse_runs_with_its_group_velocity(tmp_path: Path) -> None:
    weak = {"time.duration": 30.0, "time.timestep": 0.1, "wave.amplitude": 0.01}
    record = run(PULSE.with_values(weak), tmp_path / "run")
    snapshots = record.snapshots()
    positions = snapshots.rest / (snapshots.rest[1] - snapshots.rest[0])[0]
    shape, vector = record.scene.shape, record.scene.vector
    box = np.array([shape.columns, shape.rows * np.sqrt(0.75)])
    middles = []
    for moment in (snapshots[0], snapshots[-1]):
        around = np.exp(2j * np.pi * positions / box)  # a mean that the periodic cell does not cut
        energy = moment.energy[:, None]
        middles.append(np.angle((energy * around).sum(axis=0)) / (2 * np.pi) * box)
    way = (middles[1] - middles[0] + box / 2) % box - box / 2
    speed = way / snapshots.tau[-1]
    expected = group_velocity(record.scene)
    # 5 %: the middle of the kinetic energy sways with the phase, and the branch bends over the width of the pulse
    np.testing.assert_allclose(speed, expected, atol=0.05 * np.linalg.norm(expected))
    assert vector.along(*way) > 5


def group_velocity(scene: Scene) -> np.ndarray:
    """dΩ/dk of the scene's mode, lattice constants per τ, by differences."""
    from granular_lmp.crystal.lattices import unit_lattice
    from granular_lmp.crystal.modes import bloch_mode
    from granular_lmp.crystal.wavevector import ROW_SPACING, WaveVector

    k, h = scene.vector, 1e-4
    frequencies = [
        bloch_mode(
            unit_lattice(scene.sphere),
            scene.sphere,
            WaveVector(k.per_column + x, k.per_row + y * ROW_SPACING),
            scene.wave.mode,
        ).frequency
        for x, y in ((h, 0), (-h, 0), (0, h), (0, -h))
    ]
    return np.array([frequencies[0] - frequencies[1], frequencies[2] - frequencies[3]]) / (2 * h)


@pytest.mark.parametrize("scene", members([DRIVEN, BEAM, PULSE, GRATING], BEAM), ids=lambda scene: scene.name)
def test_compare_names_a_script_that_takes_the_run(scene: Scene, tmp_path: Path) -> None:
    record = run(scene.with_values({"time.duration": 8.0}), tmp_path / "run")
    (note,) = (note for note in compare.compare(record).notes if "compared" in note)
    script = catalogue.script_for(traits_of(record))
    assert script is None or script in note
    if script == "granular-analysis sheets":
        sheets.refuse(record)
    elif script:
        load_form(tmp_path / "run", script.removeprefix("granular-analysis "))
    else:
        assert record.scene.wave.form == "driven"
        assert record.scene.envelope.finite


@pytest.fixture(
    scope="module",
    params=members([OBLIQUE, GRATING, HEARD, PULSE], GRATING, HEARD, PULSE),
    ids=lambda scene: scene.name,
)
def refined(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Record], Record]:
    """A scene run to two tolerances, and a pair of half of the finest step that was taken, a sixteenth of the error."""
    scene = request.param.with_values({"output.particles": 0.0})
    folder = tmp_path_factory.mktemp("refined")
    records = [run(scene.with_values({"time.tolerance": each}), folder / str(each)) for each in (1e-2, 1e-4)]
    finest = min(step for record in records for step in record.info["extrapolated_from"])
    runs = [run(scene.with_values({"time.timestep": finest / part}), folder / str(part)) for part in (1, 2)]
    return records, richardson(*runs)


@pytest.mark.parametrize("index", [0, 1], ids=["1e-2", "1e-4"])
def test_a_tolerance_is_met_for_every_wave(index: int, refined: tuple[list[Record], Record]) -> None:
    record, reference = refined[0][index], refined[1]
    estimates = {name: value for name, value in record.info["error_estimate"].items() if value is not None}
    assert {"p", "q", "phi"} >= set(estimates)
    assert estimates
    for name, estimate in estimates.items():
        error = relative_error(getattr(record, name), getattr(reference, name))
        assert error <= (1e-2, 1e-4)[index]
        assert error <= estimate + 1e-7  # what two extrapolated records differ by; the reference has an error too
    assert record.folder is not None
    assert len(list(record.folder.glob("*_per_sample"))) >= 2 + index
