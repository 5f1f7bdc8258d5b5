"""Scenes that a study can run: of a wave, or of an impact. Each has its own run, its own resume and its record.

A study asks the functions of this module, and never which of the two it has.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from granular_lmp.accuracy import tolerance
from granular_lmp.accuracy.ladder import planned_steps
from granular_lmp.impact.problem import prepare as prepare_impact
from granular_lmp.impact.record import ImpactRecord
from granular_lmp.impact.run import resume_impact, run_impact
from granular_lmp.impact.scene import ImpactScene, is_impact, marked
from granular_lmp.impact.tolerance import planned_steps as planned_impact_steps
from granular_lmp.lammps.outputs import SCENE
from granular_lmp.problem import prepare
from granular_lmp.runs import formats
from granular_lmp.runs.options import Options
from granular_lmp.runs.record import Record
from granular_lmp.scene.scene import Scene

Runnable = Scene | ImpactScene
Motion = Record | ImpactRecord
Steps = Callable[[int, int], None]


def scene_of(tables: Mapping[str, Any]) -> Runnable:
    """Return the scene of nested mappings: that of an impact if its tables mark one.

    Raises
    ------
    SceneError
        If a key is unknown or a value is not allowed.
    """
    return (ImpactScene if marked(tables) else Scene).from_dict(tables)


def scene_in(folder: Path) -> Runnable:
    """Return the scene of a run folder, or raise SceneError."""
    path = folder / SCENE
    return ImpactScene.load(path) if is_impact(path) else formats.scene_of(folder)


def decided(scene: Runnable) -> Runnable:
    """Return the scene with every "auto" decided, as in a run folder; raises SceneError if it cannot be run."""
    if not isinstance(scene, ImpactScene):
        return prepare(scene).scene
    planned_impact_steps(prepare_impact(scene))  # raises if a tolerance takes too many
    return scene


def spheres_and_steps(scene: Runnable) -> float:
    """Return spheres times steps of all runs of a scene."""
    if scene.time.tolerance is None:
        steps = scene.time.steps
    elif isinstance(scene, ImpactScene):
        steps = planned_impact_steps(prepare_impact(scene))
    else:
        steps = planned_steps(scene)
    return float(scene.shape.spheres * steps)


def words(scene: Runnable) -> str:
    """Return the scene in a few words."""
    return scene.words if isinstance(scene, ImpactScene) else scene.wave_label


def run(scene: Runnable, folder: Path, *, force: bool, progress: Steps | None) -> Motion:
    """Run a scene, as `granular_lmp.run` or `granular_lmp.run_impact`."""
    if isinstance(scene, ImpactScene):
        return run_impact(scene, folder, Options(force=force, progress=progress))
    return tolerance.run(scene, folder, force=force, progress=progress)


def resume(folder: Path, *, progress: Steps | None) -> Motion:
    """Continue the run of a folder from its last checkpoint."""
    return (resume_impact if is_impact(folder) else tolerance.resume)(folder, progress=progress)


def load(folder: Path) -> Motion:
    """Return the record of a finished run; raises RunFolderError."""
    return ImpactRecord.load(folder) if is_impact(folder) else Record.load(folder)
