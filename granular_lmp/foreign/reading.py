"""Read a deck of any origin as LAMMPS has it before its first long run: spheres, contacts, laws, step, integrators.

`read` executes the deck in this process and in a temporary folder, and writes nothing into the folder of the deck. As a
deck can crash the process, the programs use `granular_lmp.foreign.apart`.
"""

import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import chdir
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import DeckError
from granular_lmp.foreign.interpreter import FEWEST, Command, Interpreter
from granular_lmp.foreign.laws import Law, laws_of
from granular_lmp.foreign.stages import (
    Pairs,
    Recorded,
    Spheres,
    Stage,
    excluding,
    of_spheres,
    start_of,
)
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.lammps.installation import lammps_module

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_PAIRS = "compute granular_lmp_{} all {} cutoff type"
_WRITTEN = re.compile(r"write_data.*timestep = ([1-9]\d*)")
_LOCAL, _ARRAY, _ATOM = 2, 2, 1  # LMP_STYLE_LOCAL, LMP_TYPE_ARRAY, LMP_VAR_ATOM


@dataclass(frozen=True, eq=False)
class Reading:
    """A deck as LAMMPS has it.

    Attributes
    ----------
    deck : path of the deck.
    commands : commands in the order of their execution, with resolved words.
    stages : runs and minimizations.
    stopped : why reading stopped; "" if it came to the end.
    data_heads : first line of each data file, by the command that reads it.
    units, dimension, periodic, low, high, tilt : units, dimensions and box; the tilt is xy, yz, xz.
    laws : law of each pair of types, the lower type first; empty if it is not known.
    spheres, pairs : spheres and neighbours; None if reading stopped earlier, or there are no spheres then.
    records : a record of each long run in which other dumps of spheres are on than in the record before.

    Units, box, laws, spheres and pairs are those at the beginning of the first long run; without one, those of the last
    run. In a deck without runs, units, box and laws are those at its end.
    """

    deck: str
    commands: tuple[Command, ...]
    stages: tuple[Stage, ...]
    stopped: str
    data_heads: Mapping[Command, str]
    units: str
    dimension: int
    periodic: tuple[bool, bool, bool]
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    tilt: tuple[float, float, float]
    laws: Mapping[tuple[int, int], Law]
    spheres: Spheres | None
    pairs: Pairs | None
    records: tuple[Recorded, ...]

    def named(self, *names: str) -> list[Command]:
        """Return the commands with one of these names."""
        return [command for command in self.commands if command.name in names]

    @property
    def dumps(self) -> list[Command]:
        """Return the complete commands of dumps; LAMMPS does not execute them here, and refuses no incomplete one."""
        return [command for command in self.named("dump") if len(command.words) >= FEWEST["dump"]]

    @property
    def data_steps(self) -> dict[Command, int]:
        """Return the commands that read the data file of an earlier run, each with the step at which it was written."""
        found = {command: _WRITTEN.search(head) for command, head in self.data_heads.items()}
        return {command: int(match[1]) for command, match in found.items() if match}

    @property
    def is_granular(self) -> bool:
        """Return whether the pair style of the first long run is granular, or may come from a restart file."""
        before = self.commands[: None if self.start is None else self.start.number]
        styles = [each for each in before if each.name == "pair_style"]
        return not styles or any(word.startswith("gran") for word in styles[-1].words[1:])

    @property
    def recorded(self) -> Recorded | None:
        """Return the first run that writes a dump of spheres; the first long run if none does, None without any."""
        return next((each for each in self.records if each.dumps), self.records[0] if self.records else None)

    @cached_property
    def fastest(self) -> Stage | None:
        """The run of several steps with the longest time step; else `start`."""
        long = [stage for stage in self.stages if stage.long]
        return max(long, key=lambda stage: stage.timestep, default=self.start)

    @cached_property
    def start(self) -> Stage | None:
        """The first run of several steps; else the last of all."""
        return start_of(self.stages)

    def law_of(self, pairs: Pairs) -> list[tuple[Law, NDArray[np.bool_]]]:
        """Return the laws of pairs, each with the pairs that have it."""
        if self.spheres is None:
            return []
        types = np.sort(np.stack((self.spheres.type[pairs.i], self.spheres.type[pairs.j])), axis=0)
        found: dict[Law, NDArray[np.bool_]] = {}
        for (one, other), law in self.laws.items():
            which = (types[0] == one) & (types[1] == other)
            found[law] = found.get(law, False) | which
        return [(law, which) for law, which in found.items() if which.any()]


def read(
    deck: str | Path, variables: Mapping[str, str] | None = None, tell: Callable[[Command], object] | None = None
) -> Reading:
    """Return a deck as LAMMPS has it, up to the forces at the beginning of each of its runs.

    Parameters
    ----------
    deck : str or Path
        The deck, as for ``lmp -in``.
    variables : mapping of str to str, optional
        Values of its index variables, as for ``lmp -var``.
    tell : callable, optional
        Called with each command before LAMMPS executes it.

    Raises
    ------
    DeckError
        If the deck cannot be read, runs other programs, or LAMMPS refuses a command before the first run.
    LammpsMissingError
        As `granular_lmp.lammps.installation.lammps_module`.
    """
    path = Path(deck).absolute()
    if not path.is_file():
        raise DeckError(f"{deck}: no such deck; give the input file, as for 'lmp -in'")
    given = [word for name, value in (variables or {}).items() for word in ("-var", name, *value.split())]
    with tempfile.TemporaryDirectory(prefix="granular-lmp-") as folder, chdir(folder):
        lmp = lammps_module().lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite", *given])
        try:
            return _read(lmp, path, tell)
        finally:
            lmp.close()


def _read(lmp: Any, path: Path, tell: Callable[[Command], object] | None) -> Reading:
    stages: list[Stage] = []
    found: dict[str, Any] = {"spheres": None, "pairs": None}
    records: list[Recorded] = []
    deck = Interpreter(lmp, path, lambda command, steps: _run(deck, command, steps, stages, found, records), tell)
    stopped = ""
    try:
        deck.read()
    except DeckError as error:
        stopped = str(error)
        if not deck.commands:
            raise
    if "units" not in found:
        found |= _system(lmp, deck.commands[: -1 if stopped else None])
    return Reading(
        deck=str(path),
        commands=tuple(deck.commands),
        stages=tuple(stages),
        stopped=stopped,
        data_heads={
            command: _head(path.parent / command.words[1]) for command in deck.commands if _reads_data(command)
        },
        records=tuple(records),
        **found,
    )


def _system(lmp: Any, commands: Sequence[Command]) -> dict[str, Any]:
    """Return the present units, box and laws."""
    box = lmp.extract_box() if lmp.extract_setting("box_exist") else ((0.0,) * 3, (0.0,) * 3, 0, 0, 0, (0,) * 3, 0)
    return {
        "units": str(lmp.extract_global("units")),
        "dimension": int(lmp.extract_setting("dimension")),
        "periodic": (bool(box[5][0]), bool(box[5][1]), bool(box[5][2])),
        "low": tuple(box[0]),
        "high": tuple(box[1]),
        "tilt": (float(box[2]), float(box[3]), float(box[4])),
        "laws": laws_of(commands, int(lmp.extract_setting("ntypes"))),
    }


def _reads_data(command: Command) -> bool:
    return command.name == "read_data"


def _head(path: Path) -> str:
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            return file.readline(1000).strip()
    except OSError:
        return ""


def _run(
    deck: Interpreter,
    command: Command,
    steps: int | None,
    stages: list[Stage],
    found: dict[str, Any],
    records: list[Recorded],
) -> None:
    """Note a stage. LAMMPS executes a run of one step, and computes the forces of the first step of a longer one."""
    lmp = deck.lmp
    fixes, dumps = (tuple(deck.on[kind].values()) for kind in ("fix", "dump"))
    begin = _begin(deck, stages)
    if steps is not None and "upto" in command.words[2:]:
        steps = max(0, steps - (begin or 0))
    exact = all(stage.steps is not None and not stage.long for stage in _since_clear(deck, stages))
    number = len(deck.commands) - 1
    stages.append(Stage(command, number, steps, float(lmp.extract_global("dt")), fixes, dumps, exact))
    if lmp.extract_setting("box_exist") and lmp.get_natoms():
        _record(deck, stages, begin, records)
    short = steps is not None and steps <= 1
    if start_of(stages) is not stages[-1]:
        lmp.command(f"run {steps if short else 0} post no")
        return
    local = ("property/local patom1 patom2", "pair/local dist dx dy dz fx fy fz") if _has_pairs(deck.noted) else ()
    names = [f"granular_lmp_{n}" for n in range(len(local))]
    for n, words in enumerate(local):
        lmp.command(_PAIRS.format(n, words))
    lmp.command("run 0 post no")
    found |= _system(lmp, deck.noted)
    if lmp.get_natoms():
        found["spheres"] = spheres = _spheres(lmp, fixes)
        ends, between = [np.array(_local(lmp, name)) for name in names] or [np.zeros((0, 2)), np.zeros((0, 7))]
        found["pairs"] = _pairs(spheres, ends, between)
    for name in names:
        lmp.command(f"uncompute {name}")
    if short and steps:
        lmp.command(f"run {steps} post no")


def _since_clear(deck: Interpreter, stages: Sequence[Stage]) -> list[Stage]:
    """Return the stages of the present system, behind the last ``clear``."""
    return [stage for stage in stages if stage.number >= deck.cleared]


def _has_pairs(commands: Sequence[Command]) -> bool:
    """Return whether there is a pair style; LAMMPS refuses to compute pairs without one."""
    given = [each for each in commands if each.name in ("pair_style", "read_restart", "clear")]
    return bool(given) and given[-1].name != "clear" and given[-1].words[1:2] != ("none",)


def _begin(deck: Interpreter, stages: list[Stage]) -> int | None:
    """Return the step at which a run begins, including the steps of earlier runs that were not executed here.

    The step is None after a minimization, and after a run that ``fix halt`` may have ended.
    """
    step = int(deck.lmp.extract_global("ntimestep"))
    for stage in stages:
        if stage.number < deck.reset:
            continue
        if stage.steps is None or (stage.long and any(fix.words[3] == "halt" for fix in stage.fixes)):
            return None
        step += stage.steps if stage.long else 0
    return step


def _record(deck: Interpreter, stages: list[Stage], begin: int | None, records: list[Recorded]) -> None:
    """Add the record of a long run if other dumps of spheres are on than in the record before."""
    stage = stages[-1]
    dumps = of_spheres(stage.dumps)
    if not stage.long or (records and (not dumps or [*map(id, dumps)] == [*map(id, records[-1].dumps)])):
        return
    lmp, spheres = deck.lmp, _spheres(deck.lmp, stage.fixes)
    members = {fix: spheres.id[_members(lmp, fix.words[2])] for fix in stage.fixes}
    for each in excluding(deck.noted):
        style, *groups = each.words[each.words.index("exclude") + 1 :]
        both = [_members(lmp, group) for group in groups[:2]] if style == "group" else [spheres.id > 0]
        members[each] = spheres.id[np.any(both, axis=0)]
    records.append(
        Recorded(
            stage,
            begin,
            history=any(each.steps != 0 for each in _since_clear(deck, stages[:-1]))
            or any(each.name == "read_restart" for each in deck.noted),
            unturned=stage.exact and not np.any(spheres.spin),
            spheres=spheres,
            laws=laws_of(deck.noted, int(lmp.extract_setting("ntypes"))),
            members=members,
        )
    )


def _local(lmp: Any, name: str) -> Any:
    rows = lmp.extract_compute(name, _LOCAL, 4)  # LMP_SIZE_ROWS
    columns = lmp.extract_compute(name, _LOCAL, 5)  # LMP_SIZE_COLS
    return lmp.numpy.extract_compute(name, _LOCAL, _ARRAY) if rows else np.zeros((0, columns))


def _spheres(lmp: Any, fixes: tuple[Command, ...]) -> Spheres:
    def each(name: str) -> Any:
        array = lmp.numpy.extract_atom(name)
        return None if array is None else np.array(array)[: int(lmp.extract_setting("nlocal"))]

    types, mass, radius = each("type"), each("rmass"), each("radius")
    if mass is None:
        mass = np.array(lmp.numpy.extract_atom("mass"))[types]
    moves, turns = np.zeros(len(types), dtype=bool), np.zeros(len(types), dtype=bool)
    for fix in fixes:
        if fix.words[3].startswith(("nve", "nvt", "npt", "nph", "rigid", "move")):
            members = _members(lmp, fix.words[2])
            moves |= members & (fix.words[3] != "nve/noforce")
            turns |= members & ("sphere" in fix.words[3])
    return Spheres(
        id=each("id").astype(np.int64),
        type=types.astype(np.int64),
        radius=np.zeros(len(types)) if radius is None else radius,
        mass=mass,
        position=each("x"),
        velocity=each("v"),
        spin=np.zeros((len(types), 3)) if (spin := each("omega")) is None else spin,
        force=each("f"),
        torque=np.zeros((len(types), 3)) if (torque := each("torque")) is None else torque,
        moves=moves,
        turns=turns,
    )


def _members(lmp: Any, group: str) -> NDArray[np.bool_]:
    lmp.command(f"variable granular_lmp_member atom gmask({group})")
    members = np.array(lmp.numpy.extract_variable("granular_lmp_member", "all", _ATOM)) > 0
    lmp.command("variable granular_lmp_member delete")
    return members


def _pairs(spheres: Spheres, ends: Floats, between: Floats) -> Pairs:
    order = np.argsort(spheres.id)
    i, j = (order[np.searchsorted(spheres.id[order], tags)] for tags in ends.T.astype(np.int64))
    overlap = spheres.radius[i] + spheres.radius[j] - between[:, 0]
    return Pairs(i, j, between[:, 1:4], overlap, between[:, 4:7])
