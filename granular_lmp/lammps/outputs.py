"""Files of a run folder: their names, and functions that read and repair the dumps and logs of LAMMPS."""

import csv
import io
import os
import re
import shutil
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import chain, islice
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import RunFolderError, one_line
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.installation import advice_to_ranks
from granular_lmp.scene.schema import cut

SCENE = "scene.toml"
DUMP = "dump.centre"
SNAPSHOTS = "dump.particles"
UNNAMED = "dump.unnamed.bin"  # dump of a run without a scene, in place of all other dumps; binary, in SI units
UNNAMED_CONTACTS = "contacts.unnamed.bin"  # contacts of such a run, if there were local dumps
PER_SAMPLE = "_per_sample"  # suffix of the folders with the runs to a tolerance
CONTACTS = f"{DUMP}.contacts"  # single contacts, at looks where a guard needs them
UNWAVED_CONTACTS = f"{SNAPSHOTS}.contacts"  # contacts of a run without a wave
MONITOR = "monitor.{}.bin"  # motion of the spheres of a monitor, binary
MONITOR_CONTACTS = "monitor.{}.contacts"  # forces of their contacts, as text: the only form in LAMMPS
LOG = "log.lammps"
UNKNOWN = "-"  # word in a line of a log, in place of a number that was not measured
STATUS = "run.json"
SWEEP = "sweep.json"
COST = "cost.json"
SCATTER = "scatter.csv"
CHECKPOINTS = ("checkpoint.a", "checkpoint.b")  # written in turn, so that one of them is always complete
CENTRE_COLUMNS = ("id", "ux", "uy")  # and rates, and spins and angles if spheres turn and are tracked
FOR_VIEWERS = ("type", "x", "y", "z", "radius", "mass")  # columns of spheres that a reader knows from the scene
_LINES_BEFORE_ATOMS = 9  # header lines of a snapshot in a LAMMPS text dump; _SNAPSHOT is the first
_LINES_AT_ONCE = 10_000  # size of a piece of a dump to read: a megabyte or two
_SNAPSHOT = b"ITEM: TIMESTEP\n"
_OF_PAIRS = b"ITEM: NUMBER OF ENTRIES\n"  # a dump of spheres has "ATOMS"
_LONGEST = 1e12  # s, of a time loop: 30,000 years
LOOP_SECTIONS = tuple(f"loop.{name}" for name in ("pair", "neigh", "comm", "output", "modify", "other"))
_EVERY = re.compile(r"^thermo +([1-9]\d{0,17})$", re.MULTILINE)
_SECTION = re.compile(
    r"^(Pair|Neigh|Comm|Output|Modify) *\|[^|\n]*\|([^|\n]*)\|", re.MULTILINE
)  # average over all ranks


@contextmanager
def writable(folder: Path) -> Iterator[None]:
    """Turn system errors while a folder is created or written into a one-line RunFolderError."""
    try:
        yield
    except FileExistsError as error:
        advice = f"choose another folder or say force=True{advice_to_ranks()}"
        raise RunFolderError(f"{folder}: exists already; {advice}") from error
    except OSError as error:
        raise RunFolderError(f"{folder}: cannot be written: {one_line(error)}") from error


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yield the path of a draft that later becomes the file; a failure leaves no part of it and no new folder.

    A path that is not a regular file, such as ``/dev/stdout``, is written directly. System errors are those of
    `writable`.
    """
    path = Path(os.path.realpath(path))
    new = [each for each in path.parents if not each.exists()]
    with writable(path):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists() and not path.is_file():
                yield path
            else:
                with _drafted(path, path.suffix) as draft:
                    yield draft
        except BaseException:
            for each in new:
                with suppress(OSError):
                    each.rmdir()
            raise


def write_files(folder: Path, files: Mapping[str, Iterable[str]]) -> None:
    """Write files, name → text in pieces, into an existing folder."""
    with writable(folder):
        for name, pieces in files.items():
            with (folder / name).open("w", encoding="utf-8") as stream:
                stream.writelines(pieces)


def write_deck(folder: str | Path, files: Mapping[str, Iterable[str]], *, force: bool) -> None:
    """Write the files of a deck into a folder, which is created, and remove the status of an earlier run.

    Raises
    ------
    RunFolderError
        If the folder exists (without `force`) or cannot be written.
    """
    folder = Path(folder)
    with writable(folder):
        folder.mkdir(parents=True, exist_ok=force)
        (folder / STATUS).unlink(missing_ok=True)
    write_files(folder, files)


def replace_text(path: Path, text: str) -> None:
    """Replace a file atomically: a reader, or a crash, finds the old or the new text, never a part."""
    with _drafted(path) as draft:
        draft.write_text(text, encoding="utf-8")


def csv_text(columns: Iterable[str], lines: Iterable[Iterable[Any]]) -> str:
    """Return a table as CSV, each number in the shortest form that reads back to the same double."""
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(chain([columns], lines))
    return stream.getvalue()


@contextmanager
def _drafted(path: Path, suffix: str = "") -> Iterator[Path]:
    """Yield the path of a draft that becomes the file at the end, or is removed after a failure."""
    draft = path.with_name(f"{path.name}.part{suffix}")
    try:
        yield draft
        os.replace(draft, path)
    except BaseException:
        with suppress(OSError):  # for instance on a read-only disk
            (shutil.rmtree if draft.is_dir() else os.unlink)(draft)
        raise


Snapshot = tuple[int, list[str], NDArray[np.float64]]


def read_snapshot(stream: Iterator[str], but: Collection[str] = ()) -> Snapshot | None:
    """Return step, column names and table (entries, columns) of the next snapshot of a LAMMPS text dump.

    The table omits the columns in `but`, since reading numbers of 17 digits takes most of the time. None means the end
    of the file, or an incomplete snapshot of a killed run.

    Raises
    ------
    ValueError
        If the file holds something else at this place.
    """
    head = list(islice(stream, _LINES_BEFORE_ATOMS))
    if len(head) < _LINES_BEFORE_ATOMS or not head[-1].endswith("\n"):
        return None
    if head[0] != _SNAPSHOT.decode():
        raise ValueError(f"line {cut(head[0].strip())!r}, expected {_SNAPSHOT.decode().strip()!r}")
    step, entries, names = int(head[1]), int(head[3]), head[-1].split()[2:]
    lines = list(islice(stream, entries))
    if len(lines) < entries or (lines and not lines[-1].endswith("\n")):
        return None
    words = "".join(lines).split()
    if len(words) != entries * len(names):
        raise ValueError(f"{len(words)} words at step {step}, expected {entries} lines of {len(names)}")
    kept = [words[number :: len(names)] for number, name in enumerate(names) if name not in but]
    return step, names, np.array(kept, dtype=float).T.copy()


def _alike(lines: list[str], names: list[str], entries: int, but: Collection[str]) -> list[Snapshot]:
    """Return the snapshots in some lines, read at once; [] unless all are complete, with these columns and entries."""
    length = _LINES_BEFORE_ATOMS + entries
    heads = [{*lines[at::length]} for at in (0, 3, _LINES_BEFORE_ATOMS - 1)]
    if len(lines) % length or heads[:2] != [{_SNAPSHOT.decode()}, {f"{entries}\n"}] or len(heads[2]) != 1:
        return []
    begins = range(0, len(lines), length)
    words = "".join(chain.from_iterable(lines[at + _LINES_BEFORE_ATOMS : at + length] for at in begins)).split()
    wrong = heads[2].pop().split()[2:] != names or len(words) != len(begins) * entries * len(names)
    if wrong or not lines[-1].endswith("\n"):
        return []
    kept = [words[number :: len(names)] for number, name in enumerate(names) if name not in but]
    tables = np.array(kept, dtype=float).T.reshape(len(begins), entries, len(kept))
    return [(int(lines[at + 1]), names, table.copy()) for at, table in zip(begins, tables, strict=True)]


def read_snapshots(path: str | Path, but: Collection[str] = ()) -> Iterator[Snapshot]:
    """Yield step, column names and table (entries, columns) of each complete snapshot of a LAMMPS text dump.

    The table omits the columns in `but`.

    Raises
    ------
    RunFolderError
        If the file cannot be read or is not such a dump.
    """
    try:
        with Path(path).open(encoding="utf-8") as file:
            stream, even = iter(file), True
            while (snapshot := read_snapshot(stream, but)) is not None:
                yield snapshot
                _, names, table = snapshot
                length = _LINES_BEFORE_ATOMS + len(table)
                # Many snapshots of a few spheres are read at once, twice as fast
                if even and (lines := list(islice(stream, _LINES_AT_ONCE // length * length))):
                    yield from (more := _alike(lines, names, len(table), but))
                    if not more:
                        stream, even = chain(lines, stream), False
    except (OSError, ValueError) as error:
        raise RunFolderError(f"{path}: not a LAMMPS dump: {one_line(error)}") from error


def read_dump(
    path: str | Path, spheres: int | None, needed: Sequence[str], but: Collection[str] = ()
) -> dict[str, NDArray[np.float64]]:
    """Return ``step`` (T,) and the columns by name, (T, spheres) each, of a dump with the `needed` columns.

    Columns in `but` are left out. The default number of spheres is that of the first snapshot.

    Raises
    ------
    RunFolderError
        If the file cannot be read or lacks a column, or if a later snapshot has other columns or another number of
        spheres.
    """
    steps: list[int] = []
    tables: list[NDArray[np.float64]] = []
    held = list(needed)
    for step, names, table in read_snapshots(path, but):
        spheres = len(table) if spheres is None else spheres
        fits = names == held if tables else {*needed} <= {*names}
        if not fits or len(table) != spheres:
            raise RunFolderError(
                f"{path}: holds {cut(' '.join(names))} of {len(table)} spheres at step {step}, "
                f"expected {' '.join(held)} of {spheres}"
            )
        held = names
        steps.append(step)
        tables.append(table)
    columns = [name for name in held if name not in but]
    values = np.array(tables).reshape(-1, spheres or 0, len(columns))
    return {"step": np.array(steps, dtype=float)} | dict(zip(columns, np.moveaxis(values, 2, 0), strict=True))


def read_centre(path: str | Path) -> dict[str, NDArray[np.float64]]:
    """Return ``step`` and the columns by name, (T,) each, of the dump of the centre sphere.

    Raises
    ------
    RunFolderError
        As for `read_dump`.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise RunFolderError(f"{path}: not a LAMMPS dump: {one_line(error)}") from error
    even = _even_table(text)
    return even or {name: values.reshape(-1) for name, values in read_dump(path, 1, CENTRE_COLUMNS).items()}


def _even_table(dump: str) -> dict[str, NDArray[np.float64]] | None:
    """Return the result of `read_centre`, but faster; None unless all snapshots are complete and have one sphere."""
    *lines, end = dump.split("\n")
    length = _LINES_BEFORE_ATOMS + 1
    heads = [set(lines[at::length]) for at in (0, 3, 8)]
    if end or len(lines) % length or heads[:2] != [{_SNAPSHOT.decode().strip()}, {"1"}] or len(heads[2]) != 1:
        return None
    names, rows = heads[2].pop().split()[2:], [line.split() for line in lines[length - 1 :: length]]
    if not {*CENTRE_COLUMNS} <= {*names} or {*map(len, rows)} != {len(names)}:
        return None
    try:
        values = np.fromiter(map(float, chain.from_iterable(rows)), dtype=float).reshape(-1, len(names))
        steps = np.fromiter(map(int, lines[1::length]), dtype=float)
    except ValueError:
        return None
    return {"step": steps} | dict(zip(names, values.T, strict=True))


@dataclass(frozen=True)
class SnapshotPlace:
    """Place of a complete snapshot in a LAMMPS text dump, with its step and its number of entries.

    Attributes
    ----------
    step : int
    entries : int
        Number of spheres, or of local quantities.
    begin, end : int
        Offsets in the file, bytes.
    """

    step: int
    entries: int
    begin: int
    end: int


def whole_snapshots(path: str | Path) -> Iterator[SnapshotPlace]:
    """Yield the places of the complete snapshots of a LAMMPS text dump in the order of the file."""
    begin = end = lines = 0
    head: list[bytes] = []
    last = b""
    with Path(path).open("rb") as stream:
        for line in chain(stream, [_SNAPSHOT]):
            cut = line.find(_SNAPSHOT)
            if cut > 0:  # the last line of the previous snapshot is incomplete
                lines, last = lines + 1, line[:cut]
            if cut >= 0:
                end += cut
                if _is_whole(head, lines - _LINES_BEFORE_ATOMS, last):
                    yield SnapshotPlace(int(head[1]), int(head[3]), begin, end)
                begin, lines, head = end, 0, []
            last = line[max(cut, 0) :]
            if lines < _LINES_BEFORE_ATOMS:
                head.append(last)
            lines += 1
            end += len(last)


def last_step(path: Path) -> int | None:
    """Return the step of the last snapshot of a LAMMPS text dump; None if it is incomplete or missing."""
    size = path.stat().st_size
    with path.open("rb") as stream:
        for back in (1 << 16, 1 << 22, size):
            stream.seek(max(0, size - back))
            head, found, tail = stream.read().rpartition(_SNAPSHOT)
            if found:
                return int(tail.split(b"\n", 1)[0]) if tail.endswith(b"\n") else None
    return None


def _is_whole(head: list[bytes], entries: int, last: bytes) -> bool:
    """Return whether a snapshot is complete; a snapshot of spheres must have entries, one of contacts need not."""
    numbers, fewest = [line.strip() for line in head[1:4:2]], 0 if head[2:3] == [_OF_PAIRS] else 1
    if entries < fewest or not last.endswith(b"\n"):
        return False
    return all(map(bytes.isdigit, numbers)) and int(numbers[1]) == entries


def mend_dump(path: str | Path) -> None:
    """Turn the dump of a stopped run, or of a run and its continuation, into that of an uninterrupted run.

    Incomplete snapshots and empty snapshots of spheres are removed. If two snapshots have the same step, the later one,
    from the continuation, is kept. The dump of an uninterrupted run does not change.
    """
    keep_latest(Path(path), whole_snapshots(path))


def keep_latest(path: Path, snapshots: Iterable[SnapshotPlace]) -> None:
    """Replace a file by its last snapshot of each step at these places, unless it holds only these."""
    kept: list[SnapshotPlace] = []
    for snapshot in snapshots:
        while kept and kept[-1].step >= snapshot.step:
            kept.pop()
        kept.append(snapshot)
    if sum(each.end - each.begin for each in kept) == path.stat().st_size:
        return
    with _drafted(path) as draft, path.open("rb") as source, draft.open("wb") as target:
        for each in kept:
            source.seek(each.begin)
            target.write(source.read(each.end - each.begin))


def mend_log(path: str | Path) -> None:
    """Remove an incomplete last line from the log of a killed run, so that a continuation starts a new line."""
    text = Path(path).read_bytes()
    os.truncate(path, text.rfind(b"\n") + 1)


@dataclass(frozen=True)
class RunLog:
    """Data in a LAMMPS log on its last run.

    Attributes
    ----------
    table : dict of str to array
        Thermo table by column.
    loop : float
        Wall time of the time loop, s; nan if no loop has ended.
    sections : dict of str to float
        Wall time by the sections of LAMMPS, ``loop.pair`` to ``loop.other``, averaged over the ranks; empty if no loop
        has ended.
    every : int
        Steps between two lines of the table in the deck; 1 if the log does not say.
    """

    table: dict[str, NDArray[np.float64]]
    loop: float
    sections: dict[str, float]
    every: int = 1


def read_log(path: str | Path) -> RunLog:
    """Read a LAMMPS log.

    Runs with the same columns (a run and its continuations) form one table. The step of a checkpoint stands in it
    twice, with the extremes before and after it. Wall times add up. An incomplete last line is left out.

    Raises
    ------
    RunFolderError
        If the log cannot be read, or its wall time is not a number.
    """
    try:
        return _log_of(Path(path).read_text(encoding="utf-8", errors="replace"))
    except (OSError, ValueError) as error:
        raise RunFolderError(f"{path}: cannot be read as a log of LAMMPS: {one_line(error)}") from error


def _log_of(text: str) -> RunLog:
    tables: dict[tuple[str, ...], list[list[float]]] = {}
    seconds: dict[tuple[str, ...], float] = {}
    names: tuple[str, ...] = ()
    rows: list[list[float]] = []
    inside = False
    for line in text.split("\n")[:-1]:
        words = line.split()
        if inside and len(words) == len(names) and (row := _numbers(words)):
            while rows and rows[-1][0] > row[0]:
                rows.pop()  # a continuation repeats the lines after its checkpoint
            rows.append(row)
        elif words[:1] == ["Step"]:
            names, inside = tuple(words), True
            rows = tables.setdefault(names, [])
        elif words[:3] == ["Loop", "time", "of"]:
            seconds[names] = seconds.get(names, 0.0) + _seconds(" ".join(words[3:4]))
            inside = False
    names = next(
        (each for each in reversed(tables) if len(each) > 1), names
    )  # a run that has not reached a look has one line
    rows = tables.get(names, [])
    table = np.array(rows, dtype=float).reshape(len(rows), len(names))
    loop = seconds.get(names, float("nan"))
    sections = _sections(text, loop) if isfinite(loop) else {}
    every = _EVERY.findall(text)
    return RunLog(dict(zip(names, table.T, strict=True)), loop, sections, int(every[-1]) if every else 1)


def _numbers(words: list[str]) -> list[float] | None:
    """Return the numbers in a line of a thermo table; None for a warning between two lines."""
    try:
        return [*map(float, words)] if UNKNOWN not in words else [nan if w == UNKNOWN else float(w) for w in words]
    except ValueError:
        return None


def _seconds(word: str) -> float:
    try:
        seconds = float(word)
    except ValueError:
        seconds = nan
    if not 0 <= seconds < _LONGEST:
        raise ValueError(f"{cut(word.strip())!r}: must be a number of seconds")
    return seconds


def _sections(log: str, loop: float) -> dict[str, float]:
    sections = dict.fromkeys(LOOP_SECTIONS, 0.0)
    for name, seconds in _SECTION.findall(log):  # the preload of one step has no such line
        sections[f"loop.{name.lower()}"] += _seconds(seconds)
    return sections | {"loop.other": loop - sum(sections.values())}
