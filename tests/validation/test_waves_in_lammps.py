"""Waves of any direction, and finite ones, through LAMMPS: symmetries, driven rows, resumption."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.tools import compare
from granular_lmp import Record, Scene, run
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


@pytest.mark.parametrize("scene", members([DRIVEN, BEAM, PULSE, GRATING], BEAM), ids=lambda scene: scene.name)
def test_compare_says_what_a_wave_of_another_form_is_compared_with(scene: Scene, tmp_path: Path) -> None:
    record = run(scene.with_values({"time.duration": 8.0}), tmp_path / "run")
    found = compare.compare(record)
    (note,) = (note for note in found.notes if "compared" in note)
    assert note.startswith("no theory of a plane wave holds ")
    assert f"is compared with {compare.INSTEAD[found.theory]}" in note
