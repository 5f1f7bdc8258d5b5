"""The memory of a finished sweep: ``known.json`` holds its table, and the digests of all that the table follows from.

These are the request, the modules of this package, ``run.json`` of each run, and through it each file of the run
(`granular_lmp.runs.seal`). A sweep that is asked for again compares them, which takes a tenth of the time that it takes
to read the runs. Where anything differs there is no memory: the runs are read, with all that a reader refuses.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp.errors import RunFolderError
from granular_lmp.lammps.outputs import STATUS, replace_text
from granular_lmp.runs.formats import format_of
from granular_lmp.runs.seal import refuse_changed
from granular_lmp.runs.status import SEAL, seal_of

KNOWN = "known.json"
_PACKAGE = Path(__file__).parents[1]
# A file that is missing, cut off or of another form raises these, and so do numbers that JSON does not know
_NOTHING_KNOWN = (OSError, ValueError, TypeError, LookupError, AttributeError, RunFolderError)

Request = dict[str, Any]
Table = list[dict[str, Any]]


def remember(folder: Path, request: Request, rows: Table, notes: list[str]) -> None:
    """Write the table and the notes of a sweep into its locked folder; nothing, if a run of it is not finished."""
    (folder / KNOWN).unlink(missing_ok=True)
    if _reads_files(request) or any(row["status"] != "finished" for row in rows):
        return
    try:
        digests = {run: _digest(folder / run, request) for run in {row["run"] for row in rows}}
        known = {"origin": _origin(request), "runs": digests, "rows": rows, "notes": notes}
        text = json.dumps(known | {SEAL: seal_of(known)})
    except _NOTHING_KNOWN:
        return
    replace_text(folder / KNOWN, text + "\n")


def recalled(folder: Path, request: Request) -> tuple[Table, list[str]] | None:
    """Return the table and the notes of a sweep, or None if it is not finished or anything changed since."""
    try:
        known = json.loads((folder / KNOWN).read_text(encoding="utf-8"))
        fits = known.pop(SEAL) == seal_of(known) and known["origin"] == _origin(request)
        fits = fits and all(_digest(folder / run, request) == digest for run, digest in known["runs"].items())
    except _NOTHING_KNOWN:
        return None
    return (known["rows"], known["notes"]) if fits else None


def _reads_files(request: Request) -> bool:
    """Return whether a value names a file, which may hold something else each time."""
    return any(
        isinstance(value, str) and value.endswith(".csv") for values in request["over"].values() for value in values
    )


def _origin(request: Request) -> str:
    """Return a digest of a request and of the modules that make a table of it, by their sizes and times."""
    modules = [(str(path), path.stat()) for path in sorted(_PACKAGE.rglob("*.py"))]
    code = [np.__version__, *((name, about.st_size, about.st_mtime_ns) for name, about in modules)]
    return hashlib.sha256(json.dumps([request, code]).encode()).hexdigest()


def _digest(folder: Path, request: Request) -> str:
    """Return the digest of ``run.json`` of a finished run; raise RunFolderError if a file of the run was changed.

    A folder of format 1 does not say what its files were, which is an error here.
    """
    text = (folder / STATUS).read_bytes()
    info = json.loads(text)
    if format_of(info) == 1:
        raise RunFolderError(f"{folder}: is of release 0.1.0, which listed no files")
    refuse_changed(folder, info, lazily="wave" in request["scene"])
    return hashlib.sha256(text).hexdigest()
