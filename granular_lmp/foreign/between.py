"""Find commands that change the motion while a dump is on, act beside contacts and fixes, or depend on skipped runs."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from granular_lmp.foreign.interpreter import Command
from granular_lmp.foreign.reading import Reading
from granular_lmp.foreign.stages import Recorded, at_work

# Beginnings of the styles of fixes that push no sphere; with dt/reset the dump must hold times
HARMLESS_FIXES = (
    *("enforce2d", "property/atom", "store", "print", "ave", "halt", "balance", "vector", "neigh/history"),
    "dt/reset",
)
# Commands that leave the motion of the spheres as it is
_NEUTRAL = (
    *("compute", "compute_modify", "uncompute", "thermo", "thermo_modify", "thermo_style", "variable", "region"),
    *("dump", "dump_modify", "undump", "print", "log", "echo", "info", "restart", "timer", "balance", "lattice"),
    *("write_coeff", "write_data", "write_dump", "write_restart", "package", "suffix", "processors"),
    *("label", "jump", "next", "if", "include", "min_modify", "min_style", "neighbor", "comm_modify", "comm_style"),
)
# Commands whose effect is fully in the spheres, box, laws and fixes that were read, or in the order of commands
UNDERSTOOD = (
    *_NEUTRAL,
    *("atom_modify", "atom_style", "boundary", "change_box", "create_atoms", "create_box", "delete_atoms", "dimension"),
    *(
        "displace_atoms",
        "fix",
        "unfix",
        "group",
        "mass",
        "minimize",
        "neigh_modify",
        "newton",
        "pair_coeff",
        "pair_style",
    ),
    *("read_data", "replicate", "reset_atoms", "reset_timestep", "run", "set", "timestep", "units", "velocity"),
    *("clear", "quit"),
)
_NAMES = ("molecule", "labelmap", "group2ndx")  # they define or write names, and leave the motion as it is
# Commands that set a state which the first snapshot of the dump holds
_OF_STATE = ("read_restart", "read_dump", "rerun", "box", "fix_modify")
MOVING = ("minimize", "rerun", "displace_atoms", "read_dump", "change_box")  # they move spheres while no time passes
_BY_STATE = ("region", "variable")  # styles of group that choose spheres by their places or other values


def acts(fix: Command) -> bool:
    """Return whether a fix may change the motion of spheres."""
    return not fix.words[3].startswith(HARMLESS_FIXES)


def changes(reading: Reading, dumps: Sequence[Command], begin: int = 0) -> Iterator[Command]:
    """Yield the commands that change the motion of spheres between two frames of some dumps, in their order.

    A minimization is one of them, as it writes frames of its own. Commands are read from the number `begin` on. If
    no dump is given, frames may be written from there to the end of the deck.
    """
    commands, on, begun = reading.commands, set[str](), False
    moving = {id(stage.command) for stage in reading.stages}
    chosen, waiting = {id(each) for each in dumps}, list[Command]()
    for number in range(begin, len(commands)):
        command, name = commands[number], commands[number].name
        if id(command) in chosen or (not dumps and number == begin):
            chosen.discard(id(command))
            on.add(command.words[1] if dumps else "")
        elif name == "clear":
            on.clear()
        elif name in ("dump", "undump"):
            on -= {*command.words[1:2]}
        if not on and not chosen:
            return
        if not on and not begun:
            continue
        if name in ("minimize", "rerun") and (id(command) in moving or name == "rerun"):
            yield from (*waiting, command)
            begun, waiting = True, []
        elif id(command) in moving:
            yield from waiting
            begun, waiting = True, []
            if _within(command):
                yield command
        elif begun and _changes(commands, number):
            waiting.append(command)


def changes_of(reading: Reading, recorded: Recorded, dumps: Sequence[Command]) -> Iterator[Command]:
    """Yield the `changes` between frames of some dumps; if none is given, from a recorded run on."""
    return changes(reading, dumps, 0 if dumps else recorded.stage.number)


def _within(run: Command) -> bool:
    """Return whether a run executes commands after each of its parts."""
    words = run.words
    return "every" in words and bool({*words[words.index("every") + 2 :]} - {"NULL"})


def _changes(commands: Sequence[Command], number: int) -> bool:
    """Return whether a command, by its number, may change the motion of spheres; an unknown command may."""
    command = commands[number]
    if command.name == "fix":
        return acts(command)
    if command.name == "unfix":
        return any(acts(each) for each in at_work(commands[:number], "fix") if each.words[1] == command.words[1])
    if command.name == "group":
        return any(each.name == "group" and each.words[1] == command.words[1] for each in commands[:number])
    if command.name == "neigh_modify":
        return "exclude" in command.words
    return command.name not in (*_NEUTRAL, *_NAMES)


def _unsure_groups(reading: Reading, recorded: Recorded) -> dict[str, Command]:
    """Return the groups whose spheres change or depend on skipped runs, each with the command that makes it so."""
    found: dict[str, Command] = {}
    skipped = {id(stage.command) for stage in reading.stages if stage.long or stage.steps is None}
    late = False
    for command in reading.commands[: recorded.stage.number]:
        late |= id(command) in skipped
        if command.name == "group" and len(command.words) > 2:
            name, style, *rest = command.words[1:]
            if style == "dynamic" or command.unsure or (late and style in _BY_STATE) or {*rest} & found.keys():
                found[name] = command
            elif style in ("clear", "delete", "static"):
                found.pop(name, None)
    return found


def place_of(reading: Reading, command: Command) -> int:
    """Return the place of a command in the order of execution; in a loop a line is executed several times."""
    return next(n for n, each in enumerate(reading.commands) if each is command)


def unread_commands(reading: Reading, recorded: Recorded, held: NDArray[np.bool_]) -> Iterator[str]:
    """Yield commands before a run whose effect is not in spheres, laws and fixes, such as bonds.

    Pairs of held spheres may be excluded from the lists of neighbours, as nothing moves held spheres.
    """
    resting = recorded.spheres.id[held]
    for command in reading.commands[: recorded.stage.number]:
        excludes = command in recorded.members and command.name == "neigh_modify"
        if command.name == "run_style" and command.words[1] == "verlet":
            continue
        if command.name not in (*UNDERSTOOD, *_NAMES, *_OF_STATE) or (
            excludes and "none" not in command.words and not np.isin(recorded.members[command], resting).all()
        ):
            yield str(command)


def unsure(reading: Reading, recorded: Recorded) -> Iterator[str]:
    """Yield sentences on lines whose spheres or values depend on runs that are not executed here."""
    groups, end = _unsure_groups(reading, recorded), recorded.stage.number
    acting = [fix for fix in recorded.stage.fixes if acts(fix)]
    for fix in acting:
        if by := groups.get(fix.words[2]):
            yield (
                f"{fix.place}: '{fix}' acts on the group of {by.place}, '{by}', whose spheres change or depend on runs "
                "that are not executed here"
            )
    deciding = [each for each in reading.commands[:end] if each.name == "if"]
    for command in (*acting, *(law.command for law in recorded.laws.values()), *deciding):
        if command.unsure:
            yield f"{command.place}: '{command}' has a value that depends on runs that are not executed here"
