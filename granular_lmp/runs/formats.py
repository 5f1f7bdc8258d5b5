"""Format of a run folder: ``format`` in ``run.json``, a whole number that increases when folders hold more.

1. Release 0.1.0, which wrote no number.
2. Release 0.2.0, which lists the files of a run and their digests.
3. Release 0.3.0, whose decks look at contacts in another way, and in which a folder of foreign dumps has no scene.

A folder of an earlier format is read with the defaults of the time when it was written.
"""

from pathlib import Path
from typing import Any

from granular_lmp.effects.selection import EFFECTS
from granular_lmp.lammps.outputs import SCENE
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.schema import AUTO

FORMAT = 3  # this release writes folders of this format


def format_of(info: dict[str, Any]) -> int:
    """Return the format of a folder from its ``run.json``.

    Raises
    ------
    ValueError
        If this release does not read the format.
    """
    found = info.get("format", 1)
    if type(found) is not int or found < 1:
        raise ValueError(f"format = {found!r}: must be a whole number from 1 to {FORMAT}")
    if found > FORMAT:
        raise ValueError(
            f"format = {found}: was written by a newer release of granular-lmp; this one reads formats up to {FORMAT}: "
            "pip install --upgrade granular-lmp"
        )
    return found


def scene_of(folder: Path) -> Scene:
    """Return the scene of a run folder; effects that were unknown when it was written are off.

    Raises
    ------
    SceneError
        If there is no such scene, or this release does not allow it.
    """
    scene = Scene.load(folder / SCENE)
    if not scene.held_at_rest:
        return scene
    off = {effect.key: False for effect in EFFECTS if effect.wanted(scene) == AUTO}
    return scene.with_values(off) if off else scene


def is_one_column(scene: Scene) -> bool:
    """Return whether a run folder has one column, as release 0.1.0 ran it, where this release uses more."""
    return scene.packing.columns not in (AUTO, scene.shape.columns)


def as_today(info: dict[str, Any]) -> dict[str, Any]:
    """Return ``run.json`` without the errors of the theory, which format 1 put into the budget of the run."""
    if "error_budget" not in info:
        return info
    return info | {"error_budget": [line for line in info["error_budget"] if line.get("of") != "theory"]}
