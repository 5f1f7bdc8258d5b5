"""Scenes that start with a wave and scenes of strikes, read, prepared, run, continued and loaded alike.

Who asks the functions of this module never asks which of the two a scene is.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from granular_lmp.accuracy import ladder, tolerance
from granular_lmp.crystal import equilibrium
from granular_lmp.effects import selection
from granular_lmp.errors import RunFolderError, SceneError
from granular_lmp.impact import deck as impact_deck
from granular_lmp.impact import tolerance as impact_tolerance
from granular_lmp.impact.deck import ImpactDeck
from granular_lmp.impact.problem import ImpactProblem
from granular_lmp.impact.problem import prepare as prepare_impact
from granular_lmp.impact.record import ImpactRecord
from granular_lmp.impact.run import resume_impact, run_impact
from granular_lmp.impact.scene import is_impact
from granular_lmp.lammps.deck import Deck
from granular_lmp.problem import Problem
from granular_lmp.problem import prepare as prepare_wave
from granular_lmp.runs import export as exports
from granular_lmp.runs import formats
from granular_lmp.runs.options import Options, Progress
from granular_lmp.runs.record import Record
from granular_lmp.scene.at_rest import crystal_of
from granular_lmp.scene.scene import Scene

Runnable = Scene
AnyProblem = Problem | ImpactProblem
AnyDeck = Deck | ImpactDeck
Motion = Record | ImpactRecord


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


def scene_in(folder: Path) -> Scene:
    """Return the scene of a run folder, or raise SceneError."""
    return formats.scene_of(folder)


def prepare(scene: Scene) -> Any:
    """Return the problem of a scene; raises SceneError if it cannot be run."""
    if scene.wave is not None:
        return prepare_wave(scene)
    problem = prepare_impact(scene)
    planned_steps(problem)  # raises if a tolerance takes too many
    return problem


def planned_steps(problem: AnyProblem) -> int:
    """Return the time steps of all runs that a problem takes, or raise SceneError if they are too many."""
    if isinstance(problem, ImpactProblem):
        return impact_tolerance.planned_steps(problem.stepped(problem.declared))
    return ladder.planned_steps(problem.declared)


def build(scene: Scene) -> Any:
    """Return the deck of a scene, with a tolerance that of the finest planned run; no file is written.

    The errors are those of `granular_lmp.accuracy.ladder.build`.
    """
    if scene.wave is None:
        return impact_deck.deck_of(impact_tolerance.planned(prepare_impact(scene)))
    return ladder.build(scene)


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
    if scene.time.tolerance is None:
        steps = scene.time.steps
    elif scene.wave is None:
        steps = planned_steps(prepare_impact(scene))
    else:
        steps = ladder.planned_steps(scene)
    return float(scene.shape.spheres * steps)


def run(what: Scene | AnyDeck, folder: str | Path, **options: Any) -> Any:
    """Run a scene or a deck, of a wave or of an impact, in `folder`, which is created, and return its record.

    Parameters
    ----------
    what : Scene, Deck or ImpactDeck
    folder : path
    **options
        ``launcher``, ``ranks``, ``force``, ``progress`` and ``kernel`` of `granular_lmp.accuracy.tolerance.run`, whose
        errors this function raises. An impact is run as by `granular_lmp.impact.run.run_impact`.

    Returns
    -------
    Record or ImpactRecord
    """
    if isinstance(what, ImpactDeck) or isinstance(what, Scene) and what.wave is None:
        return run_impact(what, folder, Options(**options))
    return tolerance.run(what, folder, **options)


def resume(folder: str | Path, *, progress: Progress | None = None) -> Motion:
    """Continue a stopped run of any scene from its last checkpoint, on the same route and ranks.

    The errors are those of `granular_lmp.accuracy.tolerance.resume`.
    """
    return (resume_impact if is_impact(folder) else tolerance.resume)(folder, progress=progress)


def load(folder: str | Path, *, unfinished: bool = False) -> Motion:
    """Return the record of a finished run: a `Record`, or an `ImpactRecord`.

    Parameters
    ----------
    folder : path
    unfinished : bool
        Read a run that was stopped or failed too.

    Raises
    ------
    RunFolderError
        If the folder holds no finished run, or one whose files were changed.
    """
    return (ImpactRecord if is_impact(folder) else Record).load(folder, unfinished=unfinished)


def export(record: Motion, path: str | Path, monitor: str | None = None) -> None:
    """Write a run for other programs, in the format of the file's ending (`granular_lmp.runs.export.export`).

    Raises
    ------
    RunFolderError
        Also if the record is that of an impact and the file is no CSV, or is to be that of a monitor.
    """
    if isinstance(record, Record):
        return exports.export(record, path, monitor)
    if monitor is not None:
        raise RunFolderError(f"--monitor {monitor}: must be left out for an impact, which has no monitors")
    if Path(path).suffix.lower() != ".csv":
        raise RunFolderError(f"{path}: must end in .csv for an impact, whose dump.particles OVITO and ASE read")
    return record.write_si(path)
