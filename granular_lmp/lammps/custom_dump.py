"""Dumps of LAMMPS as people have them: ``dump atom`` and ``dump custom`` as text, gzip or binary, any columns.

Columns stand in any order, and spheres in any order in each snapshot. Places are unwrapped (``xu``), scaled (``xs``,
``xsu``) or wrapped (``x``), with image flags (``ix``) or without; the box may be triclinic and may change. One snapshot
is in memory at a time. https://docs.lammps.org/dump.html
"""

import gzip
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import islice
from math import inf
from pathlib import Path
from typing import IO, TypeVar

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import RunFolderError, one_line
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.binary_dump import binary_snapshots
from granular_lmp.scene.schema import cut

Floats = NDArray[np.float64]
Say = Callable[[str], None]
Snapshot = TypeVar("Snapshot")

# Ways in which a dump says places, the best first: columns, scaled by the box or not, wrapped into the box or not
PLACES = (
    (("xu", "yu", "zu"), False, False),
    (("xsu", "ysu", "zsu"), True, False),
    (("x", "y", "z"), False, True),
    (("xs", "ys", "zs"), True, True),
)
IMAGES = ("ix", "iy", "iz")
_KNOWN = {*(name for names, *_ in PLACES for name in names), *IMAGES, "id", "type", "mol", "radius", "diameter", "mass"}
_KNOWN |= {f"{name}{axis}" for name in ("v", "omega", "f") for axis in "xyz"}
GZIP, _MAGIC = b"\x1f\x8b", b"DUMPCUSTOM"
_SAMPLE = 200  # lines of a snapshot in which digits are counted


@dataclass(frozen=True)
class Frame:
    """A snapshot of a foreign dump, in its own units.

    Attributes
    ----------
    step : int
    time : float or None
        As the dump says it (``dump_modify time yes``).
    units : str or None
        Style, where the dump says it (``dump_modify units yes``).
    origin : (3,) array
        Corner of the box.
    cell : (3, 3) array
        Edges of the box, one to a row.
    periodic : (3,) array of bool
    columns : dict of str to (N,) array
        Columns that the reader knows, by name, in ascending order of ``id``.
    resolution : float
        Distance of two places that the text tells apart, 0 of a binary dump.
    """

    step: int
    time: float | None
    units: str | None
    origin: Floats
    cell: Floats
    periodic: NDArray[np.bool_]
    columns: dict[str, Floats]
    resolution: float = 0.0

    @property
    def way(self) -> tuple[tuple[str, str, str], bool, bool]:
        """Columns of the places, whether these are scaled, and whether they are wrapped.

        Raises
        ------
        RunFolderError
            If there are none.
        """
        axes = [axis for axis in range(3) if any(names[axis] in self.columns for names, *_ in PLACES)]
        for way in PLACES:
            if axes and all(way[0][axis] in self.columns for axis in axes):
                return way
        if axes:
            raise RunFolderError(
                f"step {self.step}: the dump mixes places; it must have x y z, xu yu zu, or scaled ones"
            )
        raise RunFolderError(f"step {self.step}: the dump holds no places; it must have x, xu, xs or xsu")

    def places(self) -> tuple[Floats, bool]:
        """Return places (N, 3), 0 along an axis that the dump lacks, and whether they are still wrapped."""
        names, scaled, wrapped = self.way
        count = len(self.columns["id"])
        found = np.stack([self.columns.get(name, np.zeros(count)) for name in names], axis=1)
        if scaled:
            found = self.origin + found @ self.cell
        if wrapped and all(name in self.columns for name, there in zip(IMAGES, names, strict=True) if there in names):
            images = np.stack([self.columns[name] for name in IMAGES], axis=1)
            return found + images @ self.cell, False
        return found, wrapped

    def nearest_image(self, apart: Floats) -> Floats:
        """Return differences of places (N, 3) less the periods of the box that make them shortest."""
        turns = np.round(apart @ np.linalg.inv(self.cell)) * self.periodic
        return np.asarray(apart - turns @ self.cell)


def is_dump(path: str | Path) -> bool:
    """Return whether a file begins as a dump does: as text, gzip, or binary."""
    with Path(path).open("rb") as stream:
        begin = stream.read(8 + len(_MAGIC))
    return begin.startswith((b"ITEM:", GZIP)) or begin[8:] == _MAGIC


def frames(path: str | Path, say: Say) -> Iterator[Frame]:
    """Yield the whole snapshots of a foreign dump; `say` takes what a reader should know, as that its end is missing.

    Raises
    ------
    RunFolderError
        If the file cannot be read, is not a dump of spheres, holds molecules, or lacks ``id``.
    """
    path = Path(path)
    try:
        with path.open("rb") as stream:
            begin = stream.read(8 + len(_MAGIC))
        if begin[8:] == _MAGIC:
            found = _binary(path, say)
        else:
            found = text_snapshots(path, say, partial(_snapshot, context=_Context()))
        for frame in found:
            _refuse(path, frame)
            yield frame
    except (OSError, ValueError) as error:
        raise RunFolderError(f"{path}: not a dump of LAMMPS: {one_line(error)}") from error


def _refuse(path: Path, frame: Frame) -> None:
    columns = frame.columns
    if "id" not in columns:
        raise RunFolderError(f"{path}: holds no id at step {frame.step}, without which no sphere can be followed")
    if "mol" in columns and columns["mol"].any():
        raise RunFolderError(f"{path}: holds molecules (column mol); only single spheres are read")


def _frame(
    step: int,
    table: dict[str, Floats],
    box: tuple[Floats, Floats, NDArray[np.bool_]],
    said: tuple[float | None, str | None],
    resolution: float = 0.0,
) -> Frame:
    """Return a frame with its spheres in ascending order of id."""
    if "diameter" in table and "radius" not in table:
        table["radius"] = table["diameter"] / 2
    order = np.argsort(table["id"], kind="stable") if "id" in table else slice(None)
    (time, units), (origin, cell, periodic) = said, box
    columns = {name: values[order] for name, values in table.items()}
    return Frame(step, time, units, origin, cell, periodic, columns, resolution)


def _box(bounds: Floats, tilt: Floats | None, periodic: NDArray[np.bool_]) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return corner and edges from the bounds (3, 2) that a dump says, which enclose a tilted box."""
    xy, xz, yz = tilt if tilt is not None else (0.0, 0.0, 0.0)
    low, high = (bounds - _overhang(xy, xz, yz)).T
    length = high - low
    length[length == 0] = 1.0  # an atom_style without a third dimension
    cell = np.array([[length[0], 0.0, 0.0], [xy, length[1], 0.0], [xz, yz, length[2]]])
    return low, cell, periodic


def enclosing(origin: Floats, cell: Floats) -> tuple[Floats, Floats]:
    """Return the bounds (3, 2) that a dump says of a box with this corner and these edges, and its tilt xy, xz, yz."""
    tilt = cell[[1, 2, 2], [0, 0, 1]]
    return np.stack([origin, origin + np.diag(cell)], axis=1) + _overhang(*tilt), tilt


def _overhang(xy: float, xz: float, yz: float) -> Floats:
    """Return how far a tilted box reaches beyond its corners, (3, 2)."""
    ends = (0.0, xy, xz, xy + xz)
    return np.array([[min(ends), max(ends)], [min(0.0, yz), max(0.0, yz)], [0.0, 0.0]])


def _binary(path: Path, say: Say) -> Iterator[Frame]:
    last = 0
    for each in binary_snapshots(path):
        last = each.end
        names = [name for name in each.names if name in _KNOWN]
        table = {name: each.table[:, each.names.index(name)].copy() for name in names}
        yield _frame(each.step, table, _box(each.bounds, each.tilt, each.periodic), (each.time, each.units))
    if last < path.stat().st_size:
        say(f"{path}: the snapshot at its end is cut off, and left out")


@contextmanager
def _opened(path: Path, zipped: bool) -> Iterator[IO[str]]:
    with gzip.open(path, "rt", encoding="utf-8") if zipped else path.open(encoding="utf-8") as stream:
        yield stream


def text_snapshots(path: Path, say: Say, read: "Callable[[Lines], Snapshot | None]") -> Iterator[Snapshot]:
    """Yield what `read` makes of the snapshots of a text or gzip, of which the last may be cut off."""
    with path.open("rb") as begin:
        zipped = begin.read(len(GZIP)) == GZIP
    with _opened(path, zipped) as stream:
        lines = Lines(stream)
        while True:
            try:
                if (frame := read(lines)) is None:
                    return
            except (CutError, EOFError, zlib.error):
                if lines.back is None:
                    say(f"{path}: the snapshot at its end is cut off, and left out")
                    return
                say(f"{path}: a snapshot ends where that of another run begins, and is left out")
            else:
                yield frame


class CutError(Exception):
    """A snapshot is not whole."""


class Lines:
    """Lines of a file, of which the last may be cut off; the first ones of a table are kept to count digits."""

    def __init__(self, stream: Iterable[str]) -> None:
        self.stream = iter(stream)
        self.back: str | None = None  # what begins within a table, as a restarted run appends
        self.kept: list[str] = []

    def next(self) -> str | None:
        """Return the next line, None at the end."""
        line, self.back = self.back or next(self.stream, None), None
        if line is not None and not line.endswith("\n"):
            raise CutError
        return line

    def must(self) -> str:
        """Return the next line of a snapshot, which must not end here."""
        line = self.next()
        if line is None:
            raise CutError
        return line

    def many(self, count: int) -> Iterator[str]:
        """Yield lines of a table."""
        for line in islice(self.stream, count):
            if "ITEM:" in line:
                self.back = line[line.index("ITEM:") :]
                raise CutError
            if not line.endswith("\n"):
                raise CutError
            if len(self.kept) < _SAMPLE:
                self.kept.append(line)
            yield line


class _Context:
    """Units and digits of all snapshots of a file, which the first ones give."""

    units: str | None = None
    resolution: float = inf


def _snapshot(lines: Lines, context: _Context) -> Frame | None:
    """Return the next snapshot, None at the end of the file."""
    line = lines.next()
    if line is None:
        return None
    head: dict[str, list[str]] = {}
    while not line.startswith("ITEM: ATOMS"):
        title, count = _title(line)
        head[title] = [line, *(lines.must() for _ in range(count))]
        line = lines.must()
    if not {"TIMESTEP", "NUMBER OF ATOMS", "BOX BOUNDS"} <= head.keys():
        raise ValueError(f"line {cut(line.strip())!r} stands before step, number of atoms and box")
    if "UNITS" in head:
        context.units = head["UNITS"][1].strip()
    time = float(head["TIME"][1]) if "TIME" in head else None
    step, count, names = int(head["TIMESTEP"][1]), int(head["NUMBER OF ATOMS"][1]), line.split()[2:]
    lines.kept.clear()
    table = _table(lines, names, count, step)
    context.resolution = min(context.resolution, _resolution(lines.kept, names))  # places at rest may be short numbers
    box = _text_box(head["BOX BOUNDS"])
    scaled = next((way[1] for way in PLACES if way[0][0] in names), False)
    size = context.resolution * (float(np.abs(box[1]).max()) if scaled else 1.0)
    return _frame(step, table, box, (time, context.units), size)


_AFTER = {"UNITS": 1, "TIME": 1, "TIMESTEP": 1, "NUMBER OF ATOMS": 1, "BOX BOUNDS": 3}


def _title(line: str) -> tuple[str, int]:
    """Return the title of a part of the head of a snapshot, and how many lines follow it."""
    said = line.strip().removeprefix("ITEM: ")
    title = next((title for title in _AFTER if said == title or said.startswith(f"{title} ")), None)
    if said.startswith("NUMBER OF ENTRIES"):
        raise ValueError("it is a local dump, of pairs or bonds; a dump of spheres is needed")
    if title is None or not line.startswith("ITEM: "):
        raise ValueError(f"line {cut(line.strip())!r}, expected ITEM: {', '.join(_AFTER)} or ATOMS")
    return title, _AFTER[title]


def _text_box(lines: list[str]) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    words = lines[0].split()[3:]
    if words[:2] == ["abc", "origin"]:
        raise ValueError("its box is of general triclinic form; write it without triclinic/general")
    numbers = np.array([line.split() for line in lines[1:]], dtype=float)
    tilt = numbers[:, 2] if words[:3] == ["xy", "xz", "yz"] else None
    if len(words) < 3:
        raise ValueError("its box does not say which faces are periodic, as BOX BOUNDS pp pp pp does")
    periodic = np.array([word == "pp" for word in words[-3:]])
    return _box(numbers[:, :2], tilt, periodic)


def _table(lines: Lines, names: list[str], count: int, step: int) -> dict[str, Floats]:
    """Return the known columns of the next table; `loadtxt` reads it line by line."""
    known = [(place, name) for place, name in enumerate(names) if name in _KNOWN]
    if not known or not count:
        lines_left = sum(1 for _ in lines.many(count))
        if lines_left < count:
            raise CutError
        return {name: np.empty(0) for _, name in known}
    try:
        read = np.loadtxt(lines.many(count), usecols=[place for place, _ in known], ndmin=2, dtype=float, comments=None)
    except ValueError as error:
        raise ValueError(f"step {step}: {error}") from error
    if len(read) < count:
        raise CutError
    return {name: values.copy() for (_, name), values in zip(known, read.T, strict=True)}


def _resolution(lines: Collection[str], names: list[str]) -> float:
    """Return the distance of two places that the digits of some lines tell apart.

    The format %g drops zeros at the end, so that the number with the most digits counts, at the size of the largest.
    """
    columns = next((way[0] for way in PLACES if way[0][0] in names), ())
    places = [names.index(name) for name in columns if name in names]
    words = [each[place] for each in map(str.split, lines) for place in places]
    digits = max((_digits(word) for word in words), default=17)
    largest = max((abs(float(word)) for word in words), default=0.0)
    return 0.0 if digits >= 16 or not largest else float(10.0 ** (np.floor(np.log10(largest)) + 1 - digits))


def _digits(word: str) -> int:
    """Return the number of significant digits of a printed number."""
    mantissa = word.lower().partition("e")[0].lstrip("+-").replace(".", "").lstrip("0")
    return len(mantissa)
