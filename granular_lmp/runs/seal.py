"""Seal of a run that ended: ``run.json`` lists each file that the run wrote, with its size and its digest.

It also holds a digest of itself; for a run to a tolerance it lists the ``run.json`` of each of its steps. A reader
compares the files; large snapshots and monitors only when it reads them. Files that are not listed belong to the user.
A stopped run also lists its checkpoints; nothing is known about files of a killed run. A folder of format 1 has no
list, and is read without comparison (`granular_lmp.runs.formats`).
"""

import hashlib
from pathlib import Path
from typing import Any

from granular_lmp.errors import RunFolderError, one_line
from granular_lmp.lammps.outputs import (
    CHECKPOINTS,
    MONITOR,
    SCENE,
    SNAPSHOTS,
    STATUS,
    UNNAMED,
    UNNAMED_CONTACTS,
    writable,
)
from granular_lmp.runs.folder import written_files
from granular_lmp.runs.formats import format_of
from granular_lmp.runs.status import how_to_accept, read_status, write_status

# Prefixes of the names of files that few readers need
_LARGE = (SNAPSHOTS, UNNAMED, UNNAMED_CONTACTS, MONITOR.partition("{")[0])
_QUICK = 1 << 25  # bytes up to which every reader compares such a file, in a few hundredths of a second


def scene_digest(text: str) -> str:
    """Return the digest of a ``scene.toml`` or another file for ``run.json``: the SHA-256 of its text."""
    return hashlib.sha256(text.encode()).hexdigest()


def refuse_other_scene(folder: Path, info: dict[str, Any]) -> None:
    """Raise RunFolderError unless ``run.json`` holds the digest of the scene in the folder."""
    try:
        text = (folder / SCENE).read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise RunFolderError(f"{folder / SCENE}: cannot be read: {one_line(error)}") from error
    if info.get("scene_sha256") != scene_digest(text):
        raise RunFolderError(f"{folder}: {SCENE} was changed since the run began; put it back, or run with force=True")


def files_of(folder: Path, *, stopped: bool = False) -> dict[str, dict[str, Any]]:
    """Return ``files`` of ``run.json``: name, size and SHA-256 of each file of a run, which may be `stopped`."""
    checkpoints = [name for name in CHECKPOINTS if stopped and (folder / name).is_file()]
    return {name: _entry(folder / name) for name in (*written_files(folder), *checkpoints)}


def _entry(path: Path) -> dict[str, Any]:
    with path.open("rb") as stream:
        return {"bytes": path.stat().st_size, "sha256": hashlib.file_digest(stream, "sha256").hexdigest()}


def refuse_changed(folder: Path, info: dict[str, Any], *, lazily: bool = False) -> None:
    """Raise RunFolderError if a file that ``run.json`` lists is missing or was changed.

    Parameters
    ----------
    folder : Path
    info : dict
        ``run.json``.
    lazily : bool
        Compare only the size of large snapshots and monitors; `refuse_changed_record` does the rest.
    """
    if format_of(info) == 1:
        return
    for name, said in info.get("files", {}).items():
        large = name.startswith(_LARGE) and said["bytes"] > _QUICK
        _refuse_other(folder, name, info, whole=not (lazily and large))


def refuse_changed_record(folder: Path, path: Path) -> None:
    """Raise RunFolderError if a file in a run folder, or in the folder of a step, was changed since the run.

    Nothing is known about files of a run that is in progress or was killed, or of a folder without ``run.json``.
    """
    places = [(folder, path)] if path.parent == folder else [(folder, path.parent / STATUS), (path.parent, path)]
    for place, file in places:
        info: dict[str, Any] = read_status(place) if (place / STATUS).is_file() else {"status": "none"}
        if (info["status"] == "finished" and format_of(info) > 1) or "files" in info:
            name = file.relative_to(place).as_posix()
            if name not in info.get("files", {}):
                raise RunFolderError(f"{file}: was not written by the run of its folder; {how_to_accept(place, info)}")
            _refuse_other(place, name, info, whole=True)


def _refuse_other(folder: Path, name: str, info: dict[str, Any], *, whole: bool) -> None:
    path, said = folder / name, info["files"][name]
    if not path.is_file():
        raise RunFolderError(f"{path}: is missing, although the run wrote it; {how_to_accept(folder, info)}")
    if path.stat().st_size != said["bytes"] or (whole and _entry(path) != said):
        raise RunFolderError(f"{path}: was changed since the run wrote it; {how_to_accept(folder, info)}")


def accept(folder: str | Path) -> list[str]:
    """Accept the present files of a finished run on purpose, and return the names of the changed files.

    ``run.json`` keeps the names in ``accepted``. Steps of a run to a tolerance are accepted too.

    Raises
    ------
    RunFolderError
        If the run is not finished, its folder has no list of files, or its scene was changed, which makes it another
        run.
    """
    folder = Path(folder)
    info = read_status(folder, changed=True)
    if info["status"] != "finished":
        raise RunFolderError(f"{folder}: not a finished run (status '{info['status']}'); there is nothing to accept")
    if format_of(info) == 1:
        raise RunFolderError(
            f"{folder}: was written by release 0.1.0, which listed no files; there is nothing to accept"
        )
    refuse_other_scene(folder, info)
    before = info.get("files", {})
    steps = [name for name in before if "/" in name and (folder / name).is_file()]
    found = [f"{Path(name).parent}/{each}" for name in steps for each in accept((folder / name).parent)]
    now = files_of(folder)
    found += sorted(name for name in {*before, *now} if before.get(name) != now.get(name))
    found += [] if _is_sealed(folder) else [STATUS]
    if found:
        with writable(folder):
            write_status(folder, info | {"files": now, "accepted": sorted({*info.get("accepted", ()), *found})})
    return found


def _is_sealed(folder: Path) -> bool:
    try:
        return bool(read_status(folder))
    except RunFolderError:
        return False
