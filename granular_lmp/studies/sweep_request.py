"""Request of a sweep folder, ``sweep.json``: its scene, the values of its keys, and its engine."""

import json
from pathlib import Path
from typing import Any

from granular_lmp.errors import RunFolderError, one_line
from granular_lmp.lammps.outputs import STATUS, SWEEP, replace_text, writable
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.folder import clear
from granular_lmp.scene.sphere_table import located
from granular_lmp.studies.sweep_points import scene_hash

TABLE = "sweep.csv"


def claim(folder: Path, request: dict[str, Any], force: bool) -> None:
    """Write the request into the folder, or raise RunFolderError if it belongs to another sweep or run."""
    there = read_request(folder)
    if there is not None and not force and (by := by_whom(there)) != by_whom(request):
        raise RunFolderError(
            f"{folder}: holds a sweep by {by}, which only {by} can continue, not {by_whom(request)}; choose another "
            "folder or say force=True"
        )
    if there is not None and not force and _identity(folder, there) != _identity(folder, request):
        asked = ", ".join(f"{key} ({len(values)})" for key, values in there["over"].items())
        raise RunFolderError(f"{folder}: holds another sweep, over {asked}; choose another folder or say force=True")
    if there is None and not force and any(folder.iterdir()):
        raise RunFolderError(f"{folder}: exists already; choose another folder or say force=True")
    if there is None and (folder / STATUS).exists():  # the folder held one run
        clear(folder)
    if there != request:
        with writable(folder):
            (folder / TABLE).unlink(missing_ok=True)  # a killed sweep would leave the table of the other sweep
            replace_text(folder / SWEEP, json.dumps(request, indent=2) + "\n")


def scene_asked(folder: Path, request: dict[str, Any]) -> Scene:
    """Return the scene of a request; the folder has the table of its spheres."""
    return Scene.from_dict(located(request["scene"], folder))


def _identity(folder: Path, request: dict[str, Any]) -> str:
    over = request["over"]
    first = {key: values[0] for key, values in over.items() if values}  # a swept value may be wrong in the scene
    return json.dumps([list(over.items()), scene_hash(scene_asked(folder, request).with_values(first))])


def by_whom(request: dict[str, Any]) -> str:
    """Return the name of what takes the steps of the runs."""
    return f"the network ({request['device']})" if "device" in request else "LAMMPS"


def read_request(folder: Path) -> dict[str, Any] | None:
    """Return the contents of ``sweep.json``, or None if there is no file."""
    path = folder / SWEEP
    try:
        request = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(request["over"], dict) or not isinstance(request["scene"], dict):
            raise TypeError("over and scene must be JSON objects")
        if not all(isinstance(values, list) for values in request["over"].values()):
            raise TypeError("the values of over must be lists")
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise RunFolderError(f"{path}: cannot be read: {one_line(error)}") from error
    return {key: request[key] for key in ("over", "scene", "device") if key in request}
