"""Scenes of a wave and of an impact, run, continued and read alike: `run`, `resume` and `load` of `granular_lmp`.

Who asks the functions of this module never asks which of the two a scene is.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, overload

from granular_lmp.accuracy import tolerance
from granular_lmp.accuracy.ladder import planned_steps
from granular_lmp.impact.deck import ImpactDeck
from granular_lmp.impact.problem import prepare as prepare_impact
from granular_lmp.impact.record import ImpactRecord
from granular_lmp.impact.run import resume_impact, run_impact
from granular_lmp.impact.scene import ImpactScene, is_impact, marked
from granular_lmp.impact.tolerance import planned_steps as planned_impact_steps
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.outputs import SCENE
from granular_lmp.problem import prepare
from granular_lmp.runs import formats
from granular_lmp.runs.options import Options, Progress
from granular_lmp.runs.record import Record
from granular_lmp.scene.scene import Scene

Runnable = Scene | ImpactScene
Motion = Record | ImpactRecord


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


@overload
def run(what: Scene | Deck, folder: str | Path, **options: Any) -> Record: ...
@overload
def run(what: ImpactScene | ImpactDeck, folder: str | Path, **options: Any) -> ImpactRecord: ...
def run(what: Runnable | Deck | ImpactDeck, folder: str | Path, **options: Any) -> Motion:
    """Run a scene or a deck, of a wave or of an impact, in `folder`, which is created, and return its record.

    Parameters
    ----------
    what : Scene, Deck, ImpactScene or ImpactDeck
    folder : path
    **options
        ``launcher``, ``ranks``, ``force``, ``progress`` and ``kernel`` of `granular_lmp.accuracy.tolerance.run`, whose
        errors this function raises. An impact is run as by `granular_lmp.impact.run.run_impact`.

    Returns
    -------
    Record or ImpactRecord
    """
    if isinstance(what, ImpactScene | ImpactDeck):
        return run_impact(what, folder, Options(**options))
    return tolerance.run(what, folder, **options)


def resume(folder: str | Path, *, progress: Progress | None = None) -> Motion:
    """Continue a stopped run of any scene from its last checkpoint, on the same route and ranks.

    The errors are those of `granular_lmp.accuracy.tolerance.resume`.
    """
    return (resume_impact if is_impact(folder) else tolerance.resume)(folder, progress=progress)


def load(folder: str | Path) -> Motion:
    """Return the record of a finished run: a `Record`, or an `ImpactRecord`.

    Raises
    ------
    RunFolderError
        If the folder holds no finished run, or one whose files were changed.
    """
    return ImpactRecord.load(folder) if is_impact(folder) else Record.load(folder)
