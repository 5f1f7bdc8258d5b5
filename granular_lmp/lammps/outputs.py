"""The files of a run folder: their names, and how to read and mend the dumps and logs of LAMMPS."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import RunFolderError

SCENE = "scene.toml"
DUMP = "dump.centre"
PARTICLES = "dump.particles"
PER_SAMPLE = "_per_sample"  # suffix of the folders that hold the runs of a tolerance
CONTACTS = f"{DUMP}.contacts"  # single contacts at the looks where a guard needs them
LOG = "log.lammps"
STATUS = "run.json"
SWEEP = "sweep.json"
COST = "cost.json"
CHECKPOINTS = ("checkpoint.a", "checkpoint.b")  # written in turn, so that one is complete at any moment
# Columns of decks whose spheres turn and are tracked, turn untracked, and do not turn
DUMP_COLUMNS = (
    ["id", "ux", "uy", "theta", "vx", "vy", "omegaz"],
    ["id", "ux", "uy", "vx", "vy", "omegaz"],
    ["id", "ux", "uy", "vx", "vy"],
)
_LINES_BEFORE_ATOMS = 9  # header lines of a snapshot in a LAMMPS text dump; _SNAPSHOT is the first
_SNAPSHOT = b"ITEM: TIMESTEP\n"


@contextmanager
def writable(folder: Path) -> Iterator[None]:
    """Turn system errors while a folder is created or written into a RunFolderError of one line."""
    try:
        yield
    except FileExistsError as error:
        raise RunFolderError(f"{folder}: is there already; choose another folder or say force=True") from error
    except OSError as error:
        raise RunFolderError(f"{folder}: cannot be written: {error.strerror or error}") from error


def replace_text(path: Path, text: str) -> None:
    """Replace a file atomically, so that a reader or a crash finds the old or the new text, never a part."""
    draft = _draft(path)
    draft.write_text(text, encoding="utf-8")
    os.replace(draft, path)


def _draft(path: Path) -> Path:
    return path.with_name(path.name + ".part")


def read_dump(path: str | Path) -> dict[str, NDArray[np.float64]]:
    """Return the columns of a LAMMPS text dump of one sphere by name, with ``step``.

    An incomplete snapshot at the end is left out.

    Raises
    ------
    RunFolderError
        If the file cannot be read or its columns are not those of a deck.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8").split("\n")[:-1]
        size = _LINES_BEFORE_ATOMS + 1
        whole = len(lines) // size * size
        names = lines[_LINES_BEFORE_ATOMS - 1].split()[2:] if whole else DUMP_COLUMNS[0]
        if names not in DUMP_COLUMNS:
            raise ValueError(f"columns {names}, expected {DUMP_COLUMNS[0]} or those without theta and omegaz")
        steps = np.array(lines[1:whole:size], dtype=float)
        rows = np.array([line.split() for line in lines[_LINES_BEFORE_ATOMS:whole:size]], dtype=float)
    except (OSError, ValueError) as error:
        raise RunFolderError(f"{path}: not a dump of one sphere: {error}") from error
    return {"step": steps} | dict(zip(names, rows.reshape(-1, len(names)).T, strict=True))


def read_local(path: str | Path) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Yield step and table (entries, columns) of each complete snapshot of a LAMMPS dump of local quantities."""
    with Path(path).open(encoding="utf-8") as stream:
        while stream.readline():
            step = stream.readline().strip()
            stream.readline()
            count = stream.readline().strip()
            columns = [stream.readline() for _ in range(5)][-1].split()[2:]  # the names follow the box
            if not columns:
                return
            words = "".join(stream.readline() for _ in range(int(count))).split()
            if len(words) != int(count) * len(columns):
                return  # a killed run left an incomplete snapshot
            yield int(step), np.array(words, dtype=float).reshape(-1, len(columns))


@dataclass(frozen=True)
class Snapshot:
    """A complete snapshot of a LAMMPS text dump: its step, its number of spheres, and its place in the file.

    Attributes
    ----------
    step : int
    particles : int
        Number of spheres.
    begin, end : int
        Offsets in the file, bytes.
    """

    step: int
    particles: int
    begin: int
    end: int


def snapshots(path: str | Path) -> Iterator[Snapshot]:
    """Yield the complete snapshots of a LAMMPS text dump in the order of the file, without empty ones."""
    begin = end = lines = 0
    head: list[bytes] = []
    last = b""
    with Path(path).open("rb") as stream:
        for line in chain(stream, [_SNAPSHOT]):
            cut = line.find(_SNAPSHOT)
            if cut > 0:  # the last line of the snapshot before is incomplete
                lines, last = lines + 1, line[:cut]
            if cut >= 0:
                end += cut
                if _is_whole(head, lines - _LINES_BEFORE_ATOMS, last):
                    yield Snapshot(int(head[1]), int(head[3]), begin, end)
                begin, lines, head = end, 0, []
            last = line[max(cut, 0) :]
            if lines < _LINES_BEFORE_ATOMS:
                head.append(last)
            lines += 1
            end += len(last)


def _is_whole(head: list[bytes], particles: int, last: bytes) -> bool:
    numbers = [line.strip() for line in head[1:4:2]]
    return particles > 0 and all(map(bytes.isdigit, numbers)) and int(numbers[1]) == particles and last.endswith(b"\n")


def mend_dump(path: str | Path) -> None:
    """Turn the dump of a stopped run, or of a run and its continuation, into that of one uninterrupted run.

    Incomplete and empty snapshots are removed; of snapshots with the same step the later one, written by the
    continuation, is kept. The dump of an uninterrupted run is not touched.
    """
    path = Path(path)
    kept: list[Snapshot] = []
    for snapshot in snapshots(path):
        while kept and kept[-1].step >= snapshot.step:
            kept.pop()
        kept.append(snapshot)
    if sum(each.end - each.begin for each in kept) == path.stat().st_size:
        return
    draft = _draft(path)
    with path.open("rb") as source, draft.open("wb") as target:
        for each in kept:
            source.seek(each.begin)
            target.write(source.read(each.end - each.begin))
    os.replace(draft, path)


def mend_log(path: str | Path) -> None:
    """Remove an incomplete last line from the log of a killed run, so that the continuation starts a new line."""
    text = Path(path).read_bytes()
    os.truncate(path, text.rfind(b"\n") + 1)


def read_log(path: str | Path) -> tuple[dict[str, NDArray[np.float64]], float]:
    """Return the thermo table of the last run in a LAMMPS log by column name, and the seconds of its time loop.

    Runs with the same columns (a run and its continuations) form one table, in which the step of a checkpoint stands
    twice: with the extremes before it, and with those after it. The seconds are nan if no time loop has ended. An
    incomplete last line is left out.

    Raises
    ------
    RunFolderError
        If the log cannot be read.
    """
    tables: dict[tuple[str, ...], list[list[float]]] = {}
    seconds: dict[tuple[str, ...], float] = {}
    names: tuple[str, ...] = ()
    try:
        lines = Path(path).read_text(encoding="utf-8", errors="replace").split("\n")[:-1]
    except OSError as error:
        raise RunFolderError(f"{path}: cannot be read: {error}") from error
    inside = False
    for line in lines:
        words = line.split()
        if words[:1] == ["Step"]:
            names, inside = tuple(words), True
            tables.setdefault(names, [])
        elif words[:3] == ["Loop", "time", "of"]:
            seconds[names] = seconds.get(names, 0.0) + float(words[3])
            inside = False
        elif inside and len(words) == len(names):
            try:
                row = [float(word) for word in words]
            except ValueError:
                continue  # a warning between two thermo lines
            while tables[names] and tables[names][-1][0] > row[0]:
                tables[names].pop()  # a continuation repeats the lines after its checkpoint
            tables[names].append(row)
    rows = tables.get(names, [])
    table = np.array(rows, dtype=float).reshape(len(rows), len(names))
    return dict(zip(names, table.T, strict=True)), seconds.get(names, float("nan"))
