"""Continuation of a stopped run: how it was started, the scene that it had, and a whole checkpoint of it."""

from pathlib import Path
from shlex import quote
from typing import Any

from granular_lmp.errors import RunFolderError
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.outputs import CHECKPOINTS
from granular_lmp.runs.formats import FORMAT, format_of
from granular_lmp.runs.manifest import triggered
from granular_lmp.runs.seal import refuse_changed, refuse_other_scene
from granular_lmp.runs.status import read_status

_MARK = b"LammpS RestartT\0"  # LAMMPS writes it at the beginning and the end of a restart file (lmprestart.h)


def read_unfinished(folder: Path) -> dict[str, Any]:
    """Return ``run.json`` of a run, or of the runs to a tolerance, that can go on as it was started.

    Raises
    ------
    RunFolderError
        If it is finished, or failed by a guard, or its scene or another file changed.
    """
    info = read_status(folder)
    if info["status"] == "finished":
        raise RunFolderError(f"{folder}: the run is finished; there is nothing to resume")
    if format_of(info) != FORMAT:
        raise RunFolderError(f"{folder}: was begun by an earlier release; run it again with force=True")
    if failed := triggered(info):
        raise RunFolderError(f"{folder}: the run failed; there is nothing to resume: {'; '.join(failed)}")
    refuse_other_scene(folder, info)
    refuse_changed(folder, info)
    return info


def read_start(folder: Path) -> dict[str, Any]:
    """Return ``run.json`` of a run that can be continued from its last checkpoint.

    Raises
    ------
    RunFolderError
        As `read_unfinished`, and if its deck was edited or it ran with another kernel.
    """
    info = read_unfinished(folder)
    if "edited" in info:
        raise RunFolderError(f"{folder}: its deck was edited, which resume does not know of; run it again")
    if info.get("kernel", library.description()) != library.description():
        raise RunFolderError(f"{folder}: ran with another kernel or LAMMPS than those of now; run it again")
    return info


def last_checkpoint(folder: Path, dump: str) -> Path:
    """Return the newest whole checkpoint of a run, of which `dump` is the record.

    Raises
    ------
    RunFolderError
        If the run was stopped before its first checkpoint.
    """
    checkpoints = whole_checkpoints(folder)
    if not checkpoints or not (folder / dump).is_file():
        raise RunFolderError(f"{folder}: stopped before its first checkpoint; run it again with force=True")
    return max(checkpoints, key=lambda path: path.stat().st_mtime_ns)


def how_to_continue(folder: Path) -> str:
    """Return the command that continues a stopped run, or that starts it again if there is no checkpoint."""
    if whole_checkpoints(folder):
        return f"continue with: granular-lmp resume {quote(str(folder))}"
    return "it has no checkpoint yet, run it again with force=True"


def whole_checkpoints(folder: Path) -> list[Path]:
    """Return the checkpoints of a run that were written to their end."""
    return [path for path in map(folder.joinpath, CHECKPOINTS) if path.is_file() and _is_whole(path)]


def _is_whole(checkpoint: Path) -> bool:
    with checkpoint.open("rb") as stream:
        stream.seek(max(0, checkpoint.stat().st_size - len(_MARK)))
        return stream.read() == _MARK
