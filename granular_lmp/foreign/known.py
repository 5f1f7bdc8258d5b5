"""The dumps of a foreign deck, with the units, spheres, laws and time step that the deck gives."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from granular_lmp.errors import RunFolderError
from granular_lmp.foreign.adopt_dump import Known
from granular_lmp.foreign.interpreter import Command
from granular_lmp.foreign.laws import Law, granular
from granular_lmp.foreign.reading import Reading

# Styles of fixes that push no sphere, or of which only spheres that stay know
_HARMLESS = (
    *("nve", "setforce", "freeze", "enforce2d", "property/atom", "store", "print"),
    *("ave", "halt", "balance", "vector", "neigh/history"),
)
_ROUNDING = 1e-9  # of the largest contact force
_DUMPS = ("custom", "custom/gz", "custom/mpiio", "atom", "atom/gz")


def dumps_of(reading: Reading) -> list[Path]:
    """Return the files of the first dump of a deck, and of those that are written at the same steps.

    Raises
    ------
    RunFolderError
        If the deck has no dump of spheres, or its files are not there.
    """
    commands = [each for each in reading.named("dump") if each.words[3] in _DUMPS]
    if not commands:
        raise RunFolderError(f"{reading.deck}: has no dump of style custom or atom; name its dumps behind it")
    first = commands[0]
    same = [each for each in commands if (each.words[2], each.words[4]) == (first.words[2], first.words[4])]
    found = [path for each in same for path in _files(Path(reading.deck).parent, each)]
    if not found:
        raise RunFolderError(f"{Path(reading.deck).parent / first.words[5]}: missing; the deck writes it, run it first")
    return found


def _files(folder: Path, command: Command) -> list[Path]:
    """Return the files that a dump wrote, one for each step where its name holds an asterisk."""
    place = folder / command.words[5]
    return [path for path in sorted(place.parent.glob(place.name)) if path.is_file()]


def known_of(reading: Reading, given: Known) -> tuple[Known, list[str]]:
    """Return what a deck and its user know together, and remarks; what the user gives counts.

    Raises
    ------
    RunFolderError
        If LAMMPS refuses the deck before its first run.
    """
    start = reading.start
    if start is None or reading.spheres is None:
        raise RunFolderError(reading.stopped or f"{reading.deck}: LAMMPS met no run in it")
    others = {each.timestep for each in reading.stages if (each.steps or 0) > 1}
    remarks = [f"{reading.deck}: {reading.stopped}"] if reading.stopped else []
    if len(others) > 1 and given.timestep is None:
        remarks.append(f"{reading.deck}: changes its time step; times are counted with {start.timestep:g}")
    constant = [fix for fix in start.fixes if _is_constant(fix)]
    resets = [fix for fix in start.fixes if fix.words[3].startswith("dt/reset")]  # then the dumps must hold their times
    idle = [*constant, *resets]
    acting = [str(fix) for fix in start.fixes if not (fix in idle or fix.words[3].startswith(_HARMLESS))]
    if acting:  # of walls, say, whose forces are not told from constant ones
        acting += map(str, constant)
        constant = []
    known = Known(
        given.units or reading.units,
        given.timestep or (None if resets else start.timestep),
        given.radius,
        given.density,
        given.laws or reading.laws,
        reading.spheres,
        acting,
        _pushes(reading) if constant else {},
    )
    return known, remarks


def _is_constant(fix: Command) -> bool:
    """Return whether a fix pushes spheres by forces that never change."""
    words = fix.words[4:7] if fix.words[3] == "addforce" else fix.words[4:5]
    known = (fix.words[3] == "addforce" and len(fix.words) == 7) or (fix.words[3] == "gravity" and "v_" not in str(fix))
    return known and all(re.fullmatch(r"[-+.\deE]+", word) for word in words)


def _pushes(reading: Reading) -> dict[int, tuple[float, float, float]]:
    """Return the forces on spheres at the start that are not those of their contacts, by ``id``."""
    spheres, pairs = reading.spheres, reading.pairs
    if spheres is None or pairs is None:
        return {}
    outside = spheres.force.copy()
    np.subtract.at(outside, pairs.i, pairs.force)
    np.add.at(outside, pairs.j, pairs.force)
    sizes = np.linalg.norm(outside, axis=1)
    pushed = np.flatnonzero(spheres.moves & (sizes > _ROUNDING * float(np.abs(pairs.force).max(initial=0.0))))
    return {
        int(number): (float(x), float(y), float(z))
        for number, (x, y, z), size in zip(spheres.id[pushed], outside[pushed], sizes[pushed], strict=True)
        if size > 0
    }


def law_of(text: str, types: int) -> dict[tuple[int, int], Law]:
    """Return one law for all pairs of types from what stands behind the types in ``pair_coeff``.

    Raises
    ------
    RunFolderError
        If the words are no law of ``pair_style granular``.
    """
    words: Sequence[str] = text.split()
    command = Command("--law", 1, ("pair_coeff", "*", "*", *words))
    try:
        law = granular(command, words) if words else None
    except ValueError as error:
        raise RunFolderError(f"law = {text!r}: {error}") from error
    if law is None:
        raise RunFolderError(f"law = {text!r}: must be as in pair_coeff, for instance 'hertz/material 2e11 0 0.3'")
    return {(i, j): law for j in range(1, types + 1) for i in range(1, j + 1)}
