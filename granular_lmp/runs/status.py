"""The file ``run.json`` of a run folder: how the run was started, how far it has come, and how it ended."""

import json
from pathlib import Path
from typing import Any

from granular_lmp.errors import RunFolderError
from granular_lmp.lammps.outputs import STATUS as STATUS
from granular_lmp.lammps.outputs import replace_text
from granular_lmp.runs.fields import refuse_malformed
from granular_lmp.runs.folder import is_held
from granular_lmp.runs.formats import as_today, format_of


def read_status(folder: str | Path) -> dict[str, Any]:
    """Return the contents of ``run.json``; a killed run, whose status is still "running", is "interrupted".

    Raises
    ------
    RunFolderError
        If the folder holds no ``run.json``, or it is malformed.
    """
    folder = Path(folder)
    info = _status(folder)
    if info.get("status") == "running" and not is_held(folder):
        info = _status(folder)  # the run may have ended since the file was read
        if info.get("status") == "running":
            info |= {"status": "interrupted", "message": f"killed: {STATUS} says that it runs, and no process does"}
    return info


def _status(folder: Path) -> dict[str, Any]:
    path = folder / STATUS
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise RunFolderError(f"{folder}: not a run folder (there is no {STATUS})") from error
    except (OSError, ValueError, RecursionError) as error:
        raise RunFolderError(f"{path}: cannot be read: {error}") from error
    if not isinstance(info, dict):
        raise RunFolderError(f"{path}: must hold a JSON object")
    try:
        format_of(info)
        refuse_malformed(info)
    except ValueError as error:
        raise RunFolderError(f"{path}: {error}") from error
    return as_today(info)


def write_status(folder: str | Path, info: dict[str, Any]) -> None:
    """Write ``run.json``."""
    replace_text(Path(folder) / STATUS, json.dumps(info, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
