"""The seal of a run that ended: ``run.json`` lists each file that the run wrote, with its size and its digest.

It also holds a digest of itself, and that of a run to a tolerance lists the ``run.json`` of each of its steps. A reader
compares the files, large ones of snapshots and monitors when it reads them. What is not listed is the user's. A run
that was stopped lists its checkpoints too; of one that was killed nothing is known. A folder of format 1 lists nothing,
and is read as it was (`granular_lmp.runs.formats`).
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

# Beginnings of the names of files that few readers need
_LARGE = (SNAPSHOTS, UNNAMED, UNNAMED_CONTACTS, MONITOR.partition("{")[0])
_QUICK = 1 << 25  # bytes of such a file that every reader compares, in some hundredths of a second


def scene_digest(text: str) -> str:
    """Return the digest of a ``scene.toml``, or of another file, for ``run.json``: the SHA-256 of its text."""
    return hashlib.sha256(text.encode()).hexdigest()


def refuse_other_scene(folder: Path, info: dict[str, Any]) -> None:
    """Raise RunFolderError unless ``run.json`` holds the digest of the folder's scene."""
    try:
        text = (folder / SCENE).read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise RunFolderError(f"{folder / SCENE}: cannot be read: {one_line(error)}") from error
    if info.get("scene_sha256") != scene_digest(text):
        raise RunFolderError(f"{folder}: {SCENE} was changed since the run began; put it back, or run with force=True")


def files_of(folder: Path, *, stopped: bool = False) -> dict[str, dict[str, Any]]:
    """Return ``files`` of ``run.json``: of each file of a run, which may be `stopped`, its name, size and SHA-256."""
    checkpoints = [name for name in CHECKPOINTS if stopped and (folder / name).is_file()]
    return {name: _entry(folder / name) for name in (*written_files(folder), *checkpoints)}


def _entry(path: Path) -> dict[str, Any]:
    with path.open("rb") as stream:
        return {"bytes": path.stat().st_size, "sha256": hashlib.file_digest(stream, "sha256").hexdigest()}


def refuse_changed(folder: Path, info: dict[str, Any], *, lazily: bool = False) -> None:
    """Raise RunFolderError if a file that ``run.json`` lists is not there as it was written.

    Parameters
    ----------
    folder : Path
    info : dict
        ``run.json``.
    lazily : bool
        Of large snapshots and monitors compare the size only: `refuse_changed_record` does the rest.
    """
    if format_of(info) == 1:
        return
    for name, said in info.get("files", {}).items():
        large = name.startswith(_LARGE) and said["bytes"] > _QUICK
        _refuse_other(folder, name, info, whole=not (lazily and large))


def refuse_changed_record(folder: Path, path: Path) -> None:
    """Raise RunFolderError if a file in a run folder, or in that of one of its steps, is not as the run wrote it.

    Nothing is known of the files of a run that is on its way or was killed, or of a folder without ``run.json``.
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
        raise RunFolderError(f"{path}: is missing, and the run wrote it; {how_to_accept(folder, info)}")
    if path.stat().st_size != said["bytes"] or (whole and _entry(path) != said):
        raise RunFolderError(f"{path}: was changed since the run wrote it; {how_to_accept(folder, info)}")


def accept(folder: str | Path) -> list[str]:
    """Take the files of a finished run as they are now, on purpose, and return the names of those that differ.

    ``run.json`` keeps the names in ``accepted``. Steps of a run to a tolerance are accepted with it.

    Raises
    ------
    RunFolderError
        If the run is not finished, its folder lists no files, or its scene was changed: another scene is another run.
    """
    folder = Path(folder)
    info = read_status(folder, changed=True)
    if info["status"] != "finished":
        raise RunFolderError(f"{folder}: not a finished run (status '{info['status']}'); there is nothing to accept")
    if format_of(info) == 1:
        raise RunFolderError(f"{folder}: is of release 0.1.0, which listed no files; there is nothing to accept")
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
