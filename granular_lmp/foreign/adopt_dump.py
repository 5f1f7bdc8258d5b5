"""Make the run folder of an unnamed crystal from foreign dumps of LAMMPS (`granular_lmp.runs.unnamed`).

Memory holds one snapshot of each dump at a time. A quantity that the dumps lack is never guessed: an error asks for it
by name.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import chain, pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import RunFolderError
from granular_lmp.foreign.conversion import Conversion, Known
from granular_lmp.lammps.binary_dump import binary_head, binary_snapshots
from granular_lmp.lammps.custom_dump import PLACES, Frame, Say, frames
from granular_lmp.lammps.local_dump import WORDS, checked_words, local_snapshots
from granular_lmp.lammps.outputs import UNNAMED, UNNAMED_CONTACTS, SnapshotPlace, keep_latest, writable
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.folder import clear, locked
from granular_lmp.runs.formats import FORMAT
from granular_lmp.runs.seal import files_of
from granular_lmp.runs.status import write_status
from granular_lmp.runs.unnamed import ENTRY, Unnamed
from granular_lmp.units import Units
from granular_lmp.version import __version__

__all__ = ["adopt_dump"]

Floats = NDArray[np.float64]


def adopt_dump(
    dumps: Sequence[str | Path],
    folder: str | Path,
    known: Known | None = None,
    *,
    contacts: Mapping[Path, Sequence[str] | None] | None = None,
    force: bool = False,
) -> Unnamed:
    """Make the run folder of an unnamed crystal from the dumps of one run, which are not touched.

    Parameters
    ----------
    dumps : sequence of path
        Dumps of spheres. Those with the same columns follow one another; those with others are joined to them by step
        and ``id``.
    folder : path
        The run folder.
    known : Known, optional
        Quantities that the dumps lack.
    contacts : mapping, optional
        Local dumps of contacts, each with the words of LAMMPS for its columns (`granular_lmp.lammps.local_dump`), or
        None if these are their names.
    force : bool
        Replace the files of an earlier run in `folder`.

    Raises
    ------
    RunFolderError
        If a dump cannot be read, a quantity is missing, or no sphere is in all snapshots.
    """
    place = absolute(folder)
    conversion = Conversion(known or Known())
    paths = [absolute(each) for each in dumps]
    if inside := [each for each in paths if place in each.parents]:
        raise RunFolderError(f"{place}: holds the dump {inside[0].name}; choose another folder for the run")
    snapshots = _joined(paths, conversion.say)
    first = next(snapshots, None)
    if first is None:
        raise RunFolderError(f"{paths[0]}: holds no whole snapshot")
    conversion.begin(first)  # a missing quantity is asked for before a folder is made
    local = _contacts({absolute(path): words for path, words in (contacts or {}).items()}, conversion)
    first_contacts = next(local, None)
    with locked(place, make=True, force=force):
        clear(place)
        with writable(place), (place / UNNAMED).open("wb") as stream:
            try:
                for frame in chain([first], snapshots):
                    conversion.write(frame, stream)
                described = conversion.described(paths)
                if first_contacts is not None:
                    with (place / UNNAMED_CONTACTS).open("wb") as of_contacts:
                        for piece in chain([first_contacts], local):
                            of_contacts.write(piece)
            except BaseException:
                (place / UNNAMED).unlink()
                (place / UNNAMED_CONTACTS).unlink(missing_ok=True)
                with suppress(OSError):  # it holds files of the user
                    place.rmdir()
                raise
        for name in (UNNAMED, *([] if first_contacts is None else [UNNAMED_CONTACTS])):
            keep_latest(place / name, (SnapshotPlace(*each) for each in _places(place / name)))
        info = {
            "format": FORMAT,
            "status": "finished",
            "message": None,
            "name": place.name,
            "versions": {"granular_lmp": __version__, "numpy": np.__version__},
            ENTRY: described,
            "remarks": conversion.remarks,
        }
        write_status(place, info | {"files": files_of(place)})
    return Unnamed.load(place)


def _places(path: Path) -> Iterator[tuple[int, int, int, int]]:
    for each in binary_snapshots(path):
        yield each.step, len(each.table), each.begin, each.end


def _contacts(dumps: Mapping[Path, Sequence[str] | None], conversion: Conversion) -> Iterator[bytes]:
    """Yield the snapshots of local dumps as the folder has them, in SI units (of units lj in these)."""
    units, begins = conversion.units, []
    for path in dumps:
        snapshot = next(local_snapshots(path, lambda _: None), None)
        if snapshot is None:
            raise RunFolderError(f"{path}: holds no whole snapshot")
        begins.append((snapshot.step, path, checked_words(path, snapshot.names, dumps[path])))
    begins.sort(key=lambda each: each[:2])
    for (step, path, words), (other, after, others) in pairwise(begins):
        _refuse_together((step, path), (other, after))
        if {*words} & {*WORDS} != {*others} & {*WORDS}:
            raise RunFolderError(f"{after}: holds {', '.join(others)}, and {path.name} {', '.join(words)}; choose one")
    for _, path, words in begins:
        kept = [(n, word) for n, word in enumerate(words) if word in WORDS]
        names, factors = [word for _, word in kept], [_factor(units, *WORDS[word]) for _, word in kept]
        for each in local_snapshots(path, conversion.say):
            numbers = np.ascontiguousarray(each.table[:, [n for n, _ in kept]] * factors)
            style = "lj" if units.style == "lj" else "si"
            yield binary_head(each.step, names, len(numbers), [0, 0, 0], np.zeros((3, 2)), units=style)
            yield numbers.tobytes()


def _factor(units: Units, mass: int, length: int, time: int) -> float:
    return float(units.si(1.0, mass=mass, length=length, time=time))


def _joined(paths: Sequence[Path], say: Say) -> Iterator[Frame]:
    """Yield the snapshots of the dumps of one run; dumps with different columns are joined by step."""
    groups: dict[frozenset[str], list[tuple[int, Path]]] = {}
    for path in paths:
        first = next(frames(path, lambda _: None), None)
        if first is None:
            raise RunFolderError(f"{path}: holds no whole snapshot")
        groups.setdefault(frozenset(first.columns), []).append((first.step, path))
    for each in groups.values():
        for one, other in pairwise(sorted(each)):
            _refuse_together(one, other)
    streams = [_following([path for _, path in sorted(each)], say) for each in groups.values()]
    while True:
        heads = [next(stream, None) for stream in streams]
        while len({None if head is None else head.step for head in heads}) > 1:
            if None in heads:
                say("the dumps end at different steps; snapshots after the end of the shortest are left out")
                return
            last = max(head.step for head in heads if head is not None)
            heads = [
                next(stream, None) if head is not None and head.step < last else head
                for head, stream in zip(heads, streams, strict=True)
            ]
        whole = [head for head in heads if head is not None]
        if not whole:
            return
        yield _merged(whole)


def _refuse_together(one: tuple[int, Path], other: tuple[int, Path]) -> None:
    """Raise RunFolderError if two dumps with the same columns begin at the same step."""
    (step, path), (begin, after) = one, other
    if step == begin:
        raise RunFolderError(
            f"{after}: begins at step {step}, as {path.name} does; dumps of one run follow one another"
        )


def _following(paths: Sequence[Path], say: Say) -> Iterator[Frame]:
    for path in paths:
        yield from frames(path, say)


def _merged(heads: Sequence[Frame]) -> Frame:
    """Join snapshots of the same step into one, with the spheres that are in all of them."""
    first = heads[0]
    if len(heads) == 1:
        return first
    ids = first.columns["id"]
    for head in heads[1:]:
        ids = np.intersect1d(ids, head.columns["id"])
    finest = sorted(heads, key=lambda head: head.resolution)  # the dump with the most digits comes first
    columns = {
        name: values[np.isin(head.columns["id"], ids)]
        for head in reversed(finest)
        for name, values in head.columns.items()
    }
    digits = [head.resolution for head in finest if any(names[0] in head.columns for names, *_ in PLACES)]
    time = next((head.time for head in heads if head.time is not None), None)
    units = next((head.units for head in heads if head.units is not None), None)
    return Frame(first.step, time, units, first.origin, first.cell, first.periodic, columns, min(digits, default=0.0))
