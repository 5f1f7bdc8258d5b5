"""Stopped runs of every kind of scene: continued from a checkpoint to the same bytes, on either route."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_analysis.theory.signals import tone
from granular_lmp import Record, Scene, resume, run
from granular_lmp.cli import main
from granular_lmp.errors import RunFolderError, RunInterrupted, SceneError
from granular_lmp.lammps.checkpoints import SPEED, checkpoint_steps
from granular_lmp.lammps.deck import deck_of
from granular_lmp.lammps.guards import line_interval
from granular_lmp.lammps.outputs import CHECKPOINTS
from granular_lmp.problem import prepare
from granular_lmp.runs.record import read_status, write_status
from tests.conftest import PAPER, members
from tests.lammps.test_space import CUBE, layer
from tests.pause import paused
from tests.scene.test_faces import ENDS, LOAD, SIDES, WALLED
from tests.scene.test_faces import SHEET as FACED
from tests.scene.test_sources import SHAKEN
from tests.scene.test_sources import SHEET as SOURCES
from tests.validation.test_strikes_at_rest import WATCHED

# 1200 steps; a checkpoint at each 125 of them
SHEET = Scene.load("point_impact").with_values(
    {
        "packing.rows": 8,
        "packing.columns": 9,
        "striker.1.spheres": [[0, 4]],
        "time.duration": 60.0,
        "output.checkpoint": 5e-5,
    }
)
RUBS = {"effects.friction": 0.3}
DAMPED = {**RUBS, "effects.restitution": 0.8}
CHAIN = Scene.load("solitary_chain").with_values(
    {"packing.rows": 10, "packing.last": "free"}
    | {"time.duration": 200.0, "time.sample": 1.0, "output.checkpoint": 3e-5}
)

SAMPLES = [[0.1 * n, float(tone(0.5, 6.0)(np.array([0.1 * n]))[0])] for n in range(241)]
WAVE = PAPER.with_values(
    {"packing.rows": 201, "time.duration": 75.0, "time.allow_echo": True, "output.checkpoint": 603 * 100 / SPEED / 60}
)
SCENES = {
    "wave": WAVE,
    "imperfect": WAVE.with_values({"disorder.density": 0.1, "disorder.seed": 2, "packing.columns": 4}),
    "sheet": SHEET,
    "secant": SHEET.with_values({**RUBS, "effects.shear_law": "secant"}),
    "walls": SHEET.with_values({**RUBS, "packing.last": "wall", "packing.sides": "wall", "effects.restitution": 0.8}),
    "held": SHEET.with_values(
        {**RUBS, "packing.last": "held", "packing.sides": "periodic", "effects.restitution": 0.8}
    ),
    "slides": SHEET.with_values({"effects.friction": 0.02, "packing.last": "wall"}),
    # Spheres fly off, and the box of the dump follows them
    "chain": CHAIN,
    # Constant forces on free ends; displacements that count from rest, not from the state at the beginning
    "pressed": CHAIN.with_values({"packing.contact_force": 30.0}),
    "state": Scene.load("breather").with_values({"time.duration": 50.0, "time.sample": 0.5, "output.checkpoint": 1e-5}),
    "layer": layer(
        **{"wave__amplitude": 0.05, "time__duration": 200.0, "time__timestep": 0.05, "time__sample": 1.0},
        **{"output__checkpoint": 1e-4, "output__particles": 50.0},
        monitor=[{"name": "rows", "rows": [2, 4], "what": "flux"}, {"name": "all", "rows": [2, 4], "what": "contacts"}],
    ),
    "sources in space": PAPER.with_values(
        CUBE
        | {"output.checkpoint": 1e-4, "time.duration": 40.0, "time.timestep": 0.01}
        | {
            "source": [
                {"rows": [3, 3], "frequency": 0.5, "ramp": 5.0, "force": "torque_x"},
                {"rows": [1, 1], "frequency": 0.5, "ramp": 5.0, "motion": "rotation_y"},
                {"rows": [5, 5], "frequency": 0.5, "ramp": 5.0, "motion": "z"},
            ]
        }
    ),
    "sheet between walls": FACED.with_values(
        WALLED
        | LOAD
        | {"time.duration": 150.0, "time.timestep": 0.05, "output.checkpoint": 1e-4, "output.particles": 50.0}
    ),
    "free faces": FACED.with_values(SIDES | ENDS | {"time.duration": 60.0, "output.particles": 0.0}),
    "sources": SHAKEN,
    "samples": SOURCES.with_values(
        {"packing.rows": 6, "packing.columns": 6, "time.duration": 24.0, "output.particles": 0.0}
        | {"output.checkpoint": 36 * 100 / SPEED / 60}
        | {
            "source": [
                {"spheres": [[3, 3]], "motion": "x", "signal": SAMPLES, "delay": 1.0},
                {"spheres": [[1, 1]], "force": "y", "signal": SAMPLES},
            ]
        }
    ),
    # A force of drag would be set up with other velocities than those between two steps: 1e-5 D0
    "quiet ends": Scene.load("quiet_ends").with_values(
        {"packing.rows": 29, "absorb.reflection": 0.1, "time.duration": 40.0, "time.sample": 2.0}
        | {"source.1.rows": [14, 14], "source.1.ramp": 5.0, "monitor.1.rows": [18, 18], "monitor.2.rows": [12, 16]}
        | {"effects.rotation": False, "output.particles": 2.0, "output.checkpoint": 1e-9}  # as often as they may be
    ),
    # Contacts that are pulled beyond an overlap of 0 at rest
    "stretched": Scene.load("tr_periodic").with_values(
        {"sphere.adhesion_law": "jkr", "packing.rows": 24, "packing.columns": 6, "wave.wavenumber": np.pi / 3}
        | {"disorder.radius": 1.5e-4, "time.duration": 12.0, "time.timestep": 0.02, "output.particles": 6.0}
        | {"monitor": [{"name": "rows", "rows": [10, 12], "what": "contacts"}]}
    ),
    "struck crystal": WATCHED.with_values({"time.duration": 60.0, "output.checkpoint": 117 * 200 / SPEED / 60}),
}
# Runs to a tolerance, long enough to be stopped in the second of them
TOLERANCES = {
    "wave": PAPER.with_values(
        {"packing.rows": 16, "packing.ends": "periodic", "wave.wavenumber": np.pi / 4, "time.duration": 300.0}
        | {"time.sample": 1.0, "time.tolerance": 1e-3, "wave.amplitude": 0.2}
    ),
    "sheet": SHEET.with_values(
        {"packing.rows": 7, "packing.columns": 7, "striker.1.spheres": [[0, 3]], "time.duration": 40.0}
        | {"effects.friction": 0.2, "time.sample": 1.0, "time.tolerance": 1e-3, "output.checkpoint": 3e-5}
    ),
}


def recorded(folder: Path) -> dict[str, bytes]:
    """Return the bytes that a run recorded, by file."""
    names = ("dump.centre", "dump.particles", "trajectory.csv", "monitor.*")
    return {path.name: path.read_bytes() for name in names for path in sorted(folder.glob(name))}


def stopped(scene: Scene, folder: Path, launcher: str = "module", ranks: int = 1) -> None:
    with paused(folder), pytest.raises(RunInterrupted, match="continue with: granular-lmp resume"):
        run(scene, folder, launcher=launcher, ranks=ranks)


# Imperfect crystals stop like the perfect one, sheets like the one with friction and walls, the chain like the one
# under a force, and sources like samples
MORE = ["imperfect", "sheet", "slides", "held", "chain", "sources in space", "sources"]


@pytest.mark.parametrize("name", members(SCENES, *MORE))
def test_a_stopped_run_is_continued_to_the_same_bytes(name: str, tmp_path: Path, fast_looks: None) -> None:
    scene = SCENES[name]
    whole = run(scene, tmp_path / "whole")
    stopped(scene, tmp_path / "cut")
    before = len(Record.load(tmp_path / "cut", unfinished=True).tau)
    assert before < len(whole.tau)
    record = resume(tmp_path / "cut")
    assert recorded(tmp_path / "whole") == recorded(tmp_path / "cut") != {}
    if scene.wave is None:  # the looks of a wave fall on other steps after a stop
        assert record.info["guards"] == whole.info["guards"]
    if name == "wave":  # guards and clock have seen both parts
        assert record.info["smallest_overlap"] == pytest.approx(whole.info["smallest_overlap"], rel=0.05)
        assert record.info["wall_seconds"]["other"] > 0
    assert record.info["status"] == "finished"
    assert Record.load(tmp_path / "cut").tau.tolist() == whole.tau.tolist()
    assert not any((tmp_path / "cut" / name).exists() for name in CHECKPOINTS)
    with pytest.raises(RunFolderError, match="the run is finished; there is nothing to resume"):
        resume(tmp_path / "cut")


def test_a_row_at_rest_on_a_face_of_the_default_bins_is_continued_to_the_same_bytes(tmp_path: Path) -> None:
    scene = SCENES["imperfect"].with_values({"packing.rows": 101, "time.duration": 40.0})
    run(scene, tmp_path / "whole")
    with paused(tmp_path / "cut", 0.3), pytest.raises(RunInterrupted):  # the row is on the other side of the face
        run(scene, tmp_path / "cut")
    resume(tmp_path / "cut")
    assert recorded(tmp_path / "whole") == recorded(tmp_path / "cut") != {}


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Record]:
    """Runs to a tolerance that nobody stopped."""
    return {name: run(scene, tmp_path_factory.mktemp(name) / "whole") for name, scene in TOLERANCES.items()}


@pytest.mark.parametrize(
    ("name", "share", "begun"),
    [
        ("wave", 0.02, 1),
        ("sheet", 0.5, 2),
        pytest.param("sheet", 0.02, 1, marks=pytest.mark.more),
        pytest.param("wave", 0.5, 2, marks=pytest.mark.more),
    ],
)
def test_stopped_runs_to_a_tolerance_are_continued_to_the_same_bytes(
    name: str, share: float, begun: int, answers: dict[str, Record], tmp_path: Path, fast_looks: None
) -> None:
    scene, whole = TOLERANCES[name], answers[name]
    assert whole.folder is not None

    def late(step: int, steps: int) -> None:
        if step > share * steps:
            raise KeyboardInterrupt

    with pytest.raises(RunInterrupted, match="continue with: granular-lmp resume"):
        run(scene, tmp_path / "cut", progress=late)
    assert read_status(tmp_path / "cut")["status"] == "interrupted"
    there = {folder: read_status(folder)["status"] for folder in (tmp_path / "cut").glob("*_per_sample")}
    done = [folder for folder, status in there.items() if status == "finished"]
    assert len(done) >= begun - 1
    assert len(there) == len(done) + 1
    written = {folder: (folder / "run.json").stat().st_mtime_ns for folder in done}
    record = resume(tmp_path / "cut")
    assert all((folder / "run.json").stat().st_mtime_ns == time for folder, time in written.items())
    assert recorded(whole.folder) == recorded(tmp_path / "cut") != {}
    assert record.info["error_estimate"] == whole.info["error_estimate"]
    with pytest.raises(RunFolderError, match="the run is finished"):
        resume(tmp_path / "cut")


@pytest.mark.parametrize("ranks", members([1, 2], 1))
def test_the_program_continues_on_its_ranks(ranks: int, tmp_path: Path, fast_looks: None) -> None:
    # Half the minutes on two ranks are as many steps
    scene = SHEET.with_values({**RUBS, "output.checkpoint": 5e-5 / ranks, "time.duration": 30.0})
    whole = run(scene, tmp_path / "whole", launcher="lmp", ranks=ranks)
    stopped(scene, tmp_path / "cut", "lmp", ranks)
    record = resume(tmp_path / "cut")
    assert record.info["ranks"] == ranks
    dumps = [(tmp_path / name / "dump.particles").read_bytes() for name in ("whole", "cut")]
    assert dumps[0] == dumps[1]
    assert record.info["guards"] == whole.info["guards"]


def test_a_scene_that_was_changed_after_the_stop_is_refused(tmp_path: Path, fast_looks: None) -> None:
    stopped(SHEET, tmp_path / "cut")
    (tmp_path / "cut" / "scene.toml").write_text(SHEET.with_values({"effects.friction": 0.31}).to_toml())
    with pytest.raises(RunFolderError, match="scene"):
        resume(tmp_path / "cut")


def test_a_run_is_stopped_and_continued_twice(tmp_path: Path, fast_looks: None) -> None:
    scene = SHEET.with_values({**RUBS, "time.duration": 120.0})
    whole = run(scene, tmp_path / "whole")

    stopped(scene, tmp_path / "cut")
    with paused(tmp_path / "cut", 2 / 3), pytest.raises(RunInterrupted):
        resume(tmp_path / "cut")
    assert main(["resume", str(tmp_path / "cut")]) == 0
    dumps = [(tmp_path / name / "dump.particles").read_bytes() for name in ("whole", "cut")]
    assert dumps[0] == dumps[1]
    assert len(whole.tau) == 121


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"status": "finished"}, "the run is finished; there is nothing to resume"),
        ({"edited": ["+ x"]}, "its deck was edited"),
    ],
)
def test_what_cannot_be_continued_is_said(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    run(CHAIN.with_values({"time.duration": 2.0}), tmp_path / "run")
    write_status(tmp_path / "run", read_status(tmp_path / "run") | {"status": "interrupted"} | change)
    with pytest.raises(RunFolderError, match=message):
        resume(tmp_path / "run")


def test_a_checkpoint_is_declared_in_minutes_and_falls_on_a_look(tmp_path: Path) -> None:
    problem = prepare(SHEET)
    steps = checkpoint_steps(problem)
    assert steps % line_interval(problem) == 0
    assert f"variable checkpoint index {steps}  #" in deck_of(problem).input_text
    assert checkpoint_steps(problem, 2) == pytest.approx(2 * steps, abs=line_interval(problem))
    assert Scene.loads(SHEET.to_toml()) == SHEET
    with pytest.raises(SceneError, match=re.escape("output.checkpoint = 0.0: must be a number in (0, 100000]")):
        SHEET.with_values({"output.checkpoint": 0.0})
    # It chooses no spheres
    assert len(problem.rest.recorded) == len(problem.rest.atoms)
    some = prepare(SHEET.with_values({"output.rows": [1, 2]}))
    assert (some.scene.output.checkpoint, len(some.rest.recorded)) == (5e-5, 18)
