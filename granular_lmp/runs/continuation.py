"""Continuation of a stopped run: its start, its scene, and a complete checkpoint."""

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

NETWORK = "network"  # launcher of a run by another engine (`granular_lmp.runs.engine`)
END = b"LammpS RestartT\0"  # end of a checkpoint, as LAMMPS writes it in a restart file (lmprestart.h)


def read_unfinished(folder: Path) -> dict[str, Any]:
    """Return ``run.json`` of a run, or of runs to a tolerance, that can continue as it was started.

    Raises
    ------
    RunFolderError
        If the run is finished or was failed by a guard, or if its scene or another file changed.
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
        As for `read_unfinished`; also if its deck was edited or it ran with another kernel.
    """
    info = read_unfinished(folder)
    if "edited" in info:
        raise RunFolderError(f"{folder}: its deck was edited, and resume cannot repeat the edits; run it again")
    if info.get("kernel", library.description()) != library.description():
        raise RunFolderError(f"{folder}: ran with another kernel or LAMMPS than the present ones; run it again")
    return info


def last_checkpoint(folder: Path, dump: str) -> Path:
    """Return the newest complete checkpoint of a run whose record is `dump`.

    Raises
    ------
    RunFolderError
        If the run was stopped before its first checkpoint.
    """
    checkpoints = whole_checkpoints(folder)
    if not checkpoints or not (folder / dump).is_file():
        raise RunFolderError(f"{folder}: stopped before its first checkpoint; run it again with force=True")
    return max(checkpoints, key=lambda path: path.stat().st_mtime_ns)


def resuming(folder: Path, launcher: str) -> str:
    """Return the command that continues a run."""
    command = "granular-analysis network --resume" if launcher == NETWORK else "granular-lmp resume"
    return f"{command} {quote(str(folder))}"


def how_to_continue(folder: Path, launcher: str) -> str:
    """Return the command that continues a stopped run, or that starts it again if there is no checkpoint."""
    if whole_checkpoints(folder):
        return f"continue with: {resuming(folder, launcher)}"
    return "it has no checkpoint yet; run it again with force=True"


def whole_checkpoints(folder: Path) -> list[Path]:
    """Return the complete checkpoints of a run."""
    return [path for path in map(folder.joinpath, CHECKPOINTS) if path.is_file() and _is_whole(path)]


def _is_whole(checkpoint: Path) -> bool:
    with checkpoint.open("rb") as stream:
        stream.seek(max(0, checkpoint.stat().st_size - len(END)))
        return stream.read() == END
