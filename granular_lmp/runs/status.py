"""File ``run.json`` of a run folder: the start, the progress and the end of the run."""

import hashlib
import json
from pathlib import Path
from shlex import quote
from typing import Any

from granular_lmp.errors import RunFolderError, one_line
from granular_lmp.lammps.outputs import STATUS as STATUS
from granular_lmp.lammps.outputs import replace_text
from granular_lmp.runs.folder import is_held
from granular_lmp.runs.formats import as_today, format_of

SEAL = "sealed"  # entry of run.json: SHA-256 of all other entries


def read_status(folder: str | Path, *, changed: bool = False) -> dict[str, Any]:
    """Return the contents of ``run.json``; a killed run with the status "running" becomes "interrupted".

    Raises
    ------
    RunFolderError
        If the folder has no ``run.json``, or the file is malformed or was changed (without `changed`).
    """
    folder = Path(folder)
    info = _status(folder, changed)
    if info.get("status") == "running" and not is_held(folder):
        info = _status(folder, changed)  # the run may have ended since the file was read
        if info.get("status") == "running":
            info |= {"status": "interrupted", "message": f"killed: {STATUS} says that it runs, but there is no process"}
    return info


def _status(folder: Path, changed: bool) -> dict[str, Any]:
    path = folder / STATUS
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise RunFolderError(f"{folder}: not a run folder (there is no {STATUS})") from error
    except NotADirectoryError as error:
        raise RunFolderError(f"{folder}: is a file; give the run folder that holds {STATUS}") from error
    except (OSError, ValueError, RecursionError) as error:
        raise RunFolderError(f"{path}: cannot be read: {one_line(error)}") from error
    if not isinstance(info, dict):
        raise RunFolderError(f"{path}: must hold a JSON object")
    try:
        number = format_of(info)
        if "status" not in info:
            raise ValueError("status: missing key")
    except ValueError as error:
        raise RunFolderError(f"{path}: {error}") from error
    sealed = info.pop(SEAL, None)
    if number > 1 and not changed and sealed != seal_of(info):
        raise RunFolderError(f"{path}: was changed since the run wrote it; {how_to_accept(folder, info)}")
    return as_today(info)


def how_to_accept(folder: Path, info: dict[str, Any]) -> str:
    """Return advice for a file that was changed since the run; only a finished run can be accepted."""
    if info["status"] != "finished":
        return "put it back, or run the scene again with force=True"
    accept = f"granular-lmp accept {quote(str(folder))}"
    return f"put it back, run the scene again with force=True, or, if the change is on purpose: {accept}"


def write_status(folder: str | Path, info: dict[str, Any]) -> None:
    """Write ``run.json`` with a digest of its entries."""
    sealed = info | {SEAL: seal_of(info)}
    replace_text(Path(folder) / STATUS, json.dumps(sealed, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def seal_of(info: dict[str, Any]) -> str:
    """Return the SHA-256 of ``run.json`` without its own seal."""
    said = {key: value for key, value in info.items() if key != SEAL}
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()
