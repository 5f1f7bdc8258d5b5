"""Dumps of a foreign deck, with the units, spheres, laws and time step from the deck."""

from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path

from granular_lmp.errors import RunFolderError
from granular_lmp.foreign.between import changes_of
from granular_lmp.foreign.conversion import Known
from granular_lmp.foreign.interpreter import Command
from granular_lmp.foreign.laws import Law, granular
from granular_lmp.foreign.outside import outside_of, recorded_by
from granular_lmp.foreign.reading import Reading
from granular_lmp.foreign.stages import DUMPS, Recorded


def dumps_of(reading: Reading) -> list[Path]:
    """Return the files of the first dump of a deck, and of the dumps that are written at the same steps.

    Raises
    ------
    RunFolderError
        If the deck has no dump of spheres, or the files of the dump are missing.
    """
    same = _first_dumps(reading)
    if not same:
        raise RunFolderError(f"{reading.deck}: has no dump of style custom or atom; give the dumps after the deck")
    found = [path for each in same for path in files_of(Path(reading.deck).parent, each)]
    if not found:
        raise RunFolderError(
            f"{Path(reading.deck).parent / same[0].words[5]}: missing; run the deck first, which writes it"
        )
    return found


def _first_dumps(reading: Reading) -> list[Command]:
    recorded = reading.recorded
    commands = recorded.dumps if recorded else []
    commands = commands or [each for each in reading.dumps if each.words[3] in DUMPS]
    return [each for each in commands if (each.words[2], each.words[4]) == (commands[0].words[2], commands[0].words[4])]


def writers_of(reading: Reading, files: Sequence[str | Path]) -> list[Command]:
    """Return the dump commands that wrote some files of spheres, by the names of the files, in the order of the deck.

    If several commands write one file, the last one counts, as LAMMPS overwrites the file; with ``append`` all count.
    """
    found: list[Command] = []
    appended = {each.words[1] for each in reading.named("dump_modify") if "append" in each.words}
    commands = [each for each in reading.dumps if each.words[3] in DUMPS]
    for file in files:
        named = [each for each in commands if fnmatch(Path(file).name, Path(each.words[5]).name)]
        found += named if any(each.words[1] in appended for each in named) else named[-1:]
    return [each for each in commands if any(each is other for other in found)]


def files_of(folder: Path, command: Command) -> list[Path]:
    """Return the files that a dump wrote: one, or one for each step if its name holds an asterisk."""
    place = folder / command.words[5]
    return [path for path in sorted(place.parent.glob(place.name)) if path.is_file()]


def known_of(reading: Reading, given: Known, dumps: Sequence[str | Path] = ()) -> tuple[Known, list[str]]:
    """Return the knowledge of a deck and its user about some of its dumps, and remarks; the user's values count.

    The default are the dumps of `dumps_of`.

    Raises
    ------
    RunFolderError
        If LAMMPS refuses the deck before its first long run, or meets none.
    """
    writers = writers_of(reading, dumps or [each.words[5] for each in _first_dumps(reading)])
    recorded = recorded_by(reading, writers)
    if recorded is None:
        raise RunFolderError(reading.stopped or f"{reading.deck}: {_no_record(reading)}")
    stage = recorded.stage
    remarks = [f"{reading.deck}: {reading.stopped}"] if reading.stopped else []
    if len({each.timestep for each in reading.stages if each.long}) > 1 and given.timestep is None:
        remarks.append(
            f"{reading.deck}: changes its time step; times are counted with {stage.timestep:g}, that of line "
            f"{stage.command.line}"
        )
    for command in changes_of(reading, recorded, writers):
        remarks.append(
            f"{command.place}: '{command}' acts between frames of the dump, which then hold more than one motion"
        )
    known = Known(
        given.units or reading.units,
        given.timestep or (None if _unknown_step(reading, recorded) else stage.timestep),
        given.radius,
        given.density,
        given.laws or recorded.laws,
        recorded.spheres,
        outside_of(reading, writers),
    )
    return known, remarks


def _no_record(reading: Reading) -> str:
    """Return why a deck that was read to its end has no record of a run."""
    run = next((stage.command for stage in reading.stages if stage.long), None)
    if run is None:
        return "has no run of several steps" if reading.stages else "has no run"
    return (
        f"has no spheres yet at line {run.line} of {run.file}, '{run}'; dump them after they are inserted, and adopt "
        "this dump without the deck, with --units and --timestep"
    )


def _unknown_step(reading: Reading, recorded: Recorded) -> bool:
    """Return whether ``fix dt/reset`` chose the time step of a run, in it or in an earlier run.

    The dumps must then hold their times.
    """
    resetting, chosen = {id(stage.command) for stage in reading.stages if stage.resets}, False
    for command in reading.commands:
        chosen = (chosen or id(command) in resetting) and command.name not in ("timestep", "clear")
        if command is recorded.stage.command:
            break
    return chosen


def law_of(text: str, types: int) -> dict[tuple[int, int], Law]:
    """Return one law for all pairs of types from the words after the types in ``pair_coeff``.

    Raises
    ------
    RunFolderError
        If the words are not a law of ``pair_style granular``, or have an option that is not read.
    """
    words: Sequence[str] = text.split()
    command = Command("--law", 1, ("pair_coeff", "*", "*", *words))
    try:
        law = granular(command, words) if words else None
    except ValueError as error:
        raise RunFolderError(f"law = {text!r}: {error}") from error
    if law is not None and law.unread:
        raise RunFolderError(f"law = {text!r}: {law.unread} is not built; the witness knows tangential and damping")
    if law is None:
        raise RunFolderError(f"law = {text!r}: must be as in pair_coeff, for instance 'hertz/material 2e11 0 0.3'")
    return {(i, j): law for j in range(1, types + 1) for i in range(1, j + 1)}
