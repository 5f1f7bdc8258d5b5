"""Dumps of contacts, ``dump local``, as text or gzip: a line for each contact, with any columns.

What a column holds its name does not say: "c_3[1]" is the first value of a compute. `Contacts` are the values that a
reader knows by the words of ``compute property/local`` and ``compute pair/local`` (`WORDS`). One snapshot is in memory
at a time. https://docs.lammps.org/dump.html
"""

import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import RunFolderError, one_line
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.custom_dump import GZIP, CutError, Lines, Say, text_snapshots
from granular_lmp.scene.schema import allowed_names

Floats = NDArray[np.float64]

# Words of LAMMPS for a column, and its dimension in mass, length and time. A force acts on the first sphere; p1 to p4
# are the components and the size of the shear force in the granular pair styles
WORDS: dict[str, tuple[int, int, int]] = {
    **dict.fromkeys(("patom1", "patom2"), (0, 0, 0)),
    "dist": (0, 1, 0),
    **dict.fromkeys(("force", "fx", "fy", "fz", "p1", "p2", "p3", "p4"), (1, 1, -2)),
}
ENDS = ("patom1", "patom2")
OTHER = "-"  # kind of a column that is not read
_ONE_LINE = ("UNITS", "TIME", "TIMESTEP", "NUMBER OF")
_BOX = 3  # lines
_HEAD = 4096  # bytes, and
_LINES = 12  # in which the head of a dump says what it is of


@dataclass(frozen=True, eq=False)
class LocalSnapshot:
    """The contacts of a step: names of the columns, and a table (contacts, columns)."""

    step: int
    names: list[str]
    table: Floats


def is_local(path: str | Path) -> bool:
    """Return whether a file is a dump of contacts, bonds or the like, and not of spheres."""
    with Path(path).open("rb") as stream:
        head = stream.read(_HEAD)
    if head.startswith(GZIP):
        try:
            head = zlib.decompressobj(wbits=zlib.MAX_WBITS + 16).decompress(head)
        except zlib.error:
            return False
    lines = head.split(b"\n")[:_LINES]
    return any(line.startswith(b"ITEM: NUMBER OF ") and b"ATOMS" not in line for line in lines)


def local_snapshots(path: str | Path, say: Say) -> Iterator[LocalSnapshot]:
    """Yield the whole snapshots of a dump of contacts; `say` takes what a reader should know.

    Raises
    ------
    RunFolderError
        If the file cannot be read, or is no such dump.
    """
    path = Path(path)
    try:
        yield from text_snapshots(path, say, _snapshot)
    except (OSError, ValueError) as error:
        raise RunFolderError(f"{path}: not a local dump of LAMMPS: {one_line(error)}") from error


def checked_words(path: Path, names: Sequence[str], words: Sequence[str] | None) -> list[str]:
    """Return the words of the columns of a dump; without any they are the names of the columns.

    Raises
    ------
    RunFolderError
        If a word is not known, or both spheres of a contact are not said.
    """
    found = [*(names if words is None else words)]
    if len(found) != len(names):
        raise RunFolderError(f"columns = {','.join(found)}: {path} has {len(names)} columns, {' '.join(names)}")
    if words is None:
        found = [word if word in WORDS else OTHER for word in found]
    for word in found:
        if word not in (*WORDS, OTHER):
            raise RunFolderError(f"columns = {','.join(found)}: {word}: {allowed_names(word, [*WORDS, OTHER])}")
    if not {*ENDS} <= {*found}:
        raise RunFolderError(
            f"{path}: what its columns {' '.join(names)} hold is not said; give columns=WORDS, one for each: "
            f"{', '.join(WORDS)}, or {OTHER} for another"
        )
    return found


def _snapshot(lines: Lines) -> LocalSnapshot | None:
    """Return the next snapshot, None at the end of the file."""
    line = lines.next()
    if line is None:
        return None
    step = count = -1
    while True:
        said = line.strip().removeprefix("ITEM: ")
        if said.startswith("BOX BOUNDS"):
            for _ in range(_BOX):
                lines.must()
        elif said.startswith(_ONE_LINE):
            value = lines.must().strip()
            step = int(value) if said == "TIMESTEP" else step
            count = int(value) if said.startswith("NUMBER OF") else count
        else:
            break
        line = lines.must()
    if step < 0 or count < 0 or not line.startswith("ITEM: "):
        raise ValueError("step and number of entries do not stand before the table")
    names = line.split()[2:]
    if not count:
        return LocalSnapshot(step, names, np.empty((0, len(names))))
    table = np.loadtxt(lines.many(count), ndmin=2, dtype=float, comments=None)
    if len(table) < count:
        raise CutError
    return LocalSnapshot(step, names, table)
