"""The dumps of a foreign deck, with the units, spheres, laws and time step that the deck gives."""

from collections.abc import Sequence
from pathlib import Path

from granular_lmp.errors import RunFolderError
from granular_lmp.foreign.adopt_dump import Known
from granular_lmp.foreign.interpreter import Command
from granular_lmp.foreign.laws import Law, granular
from granular_lmp.foreign.outside import outside_of
from granular_lmp.foreign.reading import DUMPS, Reading


def dumps_of(reading: Reading) -> list[Path]:
    """Return the files of the first dump of a deck, and of those that are written at the same steps.

    Raises
    ------
    RunFolderError
        If the deck has no dump of spheres, or its files are not there.
    """
    commands = [each for each in reading.dumps if each.words[3] in DUMPS]
    if not commands:
        raise RunFolderError(f"{reading.deck}: has no dump of style custom or atom; name its dumps behind it")
    first = commands[0]
    same = [each for each in commands if (each.words[2], each.words[4]) == (first.words[2], first.words[4])]
    found = [path for each in same for path in files_of(Path(reading.deck).parent, each)]
    if not found:
        raise RunFolderError(f"{Path(reading.deck).parent / first.words[5]}: missing; the deck writes it, run it first")
    return found


def files_of(folder: Path, command: Command) -> list[Path]:
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
    outside = outside_of(reading)
    resets = [fix for fix in start.fixes if fix.words[3].startswith("dt/reset")]  # then the dumps must hold their times
    known = Known(
        given.units or reading.units,
        given.timestep or (None if resets else start.timestep),
        given.radius,
        given.density,
        given.laws or reading.laws,
        reading.spheres,
        outside,
    )
    return known, remarks


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
