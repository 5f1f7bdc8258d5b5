"""Scenes that start with a wave and scenes of strikes, read, prepared and described alike.

Who asks the functions of this module never asks which of the two a scene is.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from granular_lmp.accuracy import ladder
from granular_lmp.crystal import equilibrium
from granular_lmp.effects import selection
from granular_lmp.errors import SceneError
from granular_lmp.problem import Problem
from granular_lmp.runs import kinds
from granular_lmp.scene.at_rest import crystal_of
from granular_lmp.scene.scene import Scene

Runnable = Scene
AnyProblem = Problem


def read(source: str | Path) -> Scene:
    """Return the scene in a TOML file, in a folder with a ``scene.toml``, or of the name of a shipped one.

    Raises
    ------
    SceneError
        As `Scene.load`.
    """
    return Scene.load(source)


def scene_of(tables: Mapping[str, Any]) -> Scene:
    """Return the scene of nested mappings.

    Raises
    ------
    SceneError
        If a key is unknown or a value is not allowed.
    """
    return Scene.from_dict(tables)


def prepare(scene: Scene) -> Any:
    """Return the problem of a scene; raises SceneError if it cannot be run."""
    problem = kinds.prepare(scene)
    if scene.wave is None:
        ladder.planned_steps(problem)  # raises if a tolerance takes too many
    return problem


def with_all(scene: Scene) -> Scene:
    """Return the scene with every effect on (`granular_lmp.effects.selection.with_all`); its wave says of which."""
    if scene.wave is None:
        raise SceneError("--all-effects: is for the scene of a wave; must be left out, and effects.friction declared")
    return selection.with_all(scene)


def notes_on(scene: Scene, progress: equilibrium.Progress | None = None) -> list[str]:
    """Return what was changed to make a scene fit, "note: ...", and which effects it lacks, "warning: ..."."""
    if scene.wave is None:
        return [f"note: {sentence}" for sentence in scene.remarks()]
    crystal = crystal_of(scene, progress)
    notes = [*scene.remarks(), *selection.remarks(scene), *crystal.remarks()]
    warnings = selection.warnings(selection.select(scene))
    return [*(f"note: {sentence}" for sentence in notes), *(f"warning: {sentence}" for sentence in warnings)]


def spheres_and_steps(scene: Scene) -> float:
    """Return spheres times steps of all runs of a scene."""
    steps = scene.time.steps if scene.time.tolerance is None else ladder.planned_steps(kinds.prepare(scene))
    return float(scene.shape.spheres * steps)
