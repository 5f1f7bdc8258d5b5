"""Forces and motions of a deck beside its contacts: walls, and fixes that push, hold, move or turn spheres.

A fix that is neither known here nor harmless is kept as its line, and no witness of its deck is made.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from math import cos, radians, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.foreign.between import acts, changes_of, place_of, unread_commands, unsure
from granular_lmp.foreign.interpreter import Command
from granular_lmp.foreign.laws import PLANES, Law, is_number, law_of_wall
from granular_lmp.foreign.reading import Reading
from granular_lmp.foreign.stages import Recorded
from granular_lmp.frozen import dataclass
from granular_lmp.units import Units

Vector = tuple[float, float, float]

# Spacings of lattices along x, y and z over their scale, without options
_SPACINGS = dict.fromkeys(("none", "sq", "sq2", "sc", "bcc", "fcc", "diamond"), (1.0, 1.0, 1.0)) | {
    "hex": (1.0, 3**0.5, 1.0),
    "hcp": (1.0, 3**0.5, (8 / 3) ** 0.5),
}
_INTEGRATORS = ("nve", "nve/sphere", "nve/noforce", "move")
_FLAT = 1e-9  # times the radius; places of spheres in one plane differ by less


@dataclass(frozen=True)
class Wall:
    """A plane at rest: its axis, -1 below the spheres or 1 above them, its place, and its law."""

    axis: int
    side: int
    place: float
    law: Law


@dataclass(frozen=True)
class Motion:
    """Spheres that a fix moves by ``velocity * t + amplitude * sin(2π t/period)``, where t is 0 at a step `begin`."""

    spheres: tuple[int, ...]
    velocity: Vector
    amplitude: Vector
    period: float
    begin: int


@dataclass(frozen=True)
class Outside:
    """Actions on the spheres of a deck beside their contacts, in its units; spheres are named by their ``id``.

    Attributes
    ----------
    begin : first step of the run that writes the dump; None if it is not known.
    history : whether contacts may hold slip then, from earlier runs or a restart file.
    forgotten : step at which the deck continues an earlier run from a data file, which holds no slip; None if it does
        not.
    unturned : whether it is certain that no sphere turns at the step `begin`.
    held : spheres that no force moves; they rest or keep their velocity.
    frozen : held spheres of ``fix freeze``, whose mass LAMMPS takes as infinite in dashpots.
    pushes : constant forces.
    walls, motions : planes at rest, and moved spheres.
    rotation : whether forces turn the free spheres.
    discs : whether the free spheres have the moment of inertia of a disc.
    others : lines of the deck that act on the spheres and that no witness knows.
    unfollowed : sentences on lines and spheres of the deck that no witness can follow, with the reason.
    """

    begin: int | None = None
    history: bool = False
    forgotten: int | None = None
    unturned: bool = False
    held: tuple[int, ...] = ()
    frozen: tuple[int, ...] = ()
    pushes: Mapping[int, Vector] = field(default_factory=dict)
    walls: tuple[Wall, ...] = ()
    motions: tuple[Motion, ...] = ()
    rotation: bool = True
    discs: bool = False
    others: tuple[str, ...] = ()
    unfollowed: tuple[str, ...] = ()

    def in_si(self, units: Units) -> dict[str, Any]:
        """Return the entry of `Outside` in ``run.json``, in SI units (units lj stay)."""
        return {
            "begin": self.begin,
            "history": self.history,
            "forgotten": self.forgotten,
            "unturned": self.unturned,
            "held": [*self.held],
            "frozen": [*self.frozen],
            "pushes": [
                [number, *(units.si(each, mass=1, length=1, time=-2) for each in force)]
                for number, force in self.pushes.items()
            ],
            "walls": [
                {"axis": wall.axis, "side": wall.side, "place": units.si(wall.place, length=1), **wall.law.in_si(units)}
                for wall in self.walls
            ],
            "motions": [
                {
                    "spheres": [*each.spheres],
                    "velocity": [units.si(way, length=1, time=-1) for way in each.velocity],
                    "amplitude": [units.si(way, length=1) for way in each.amplitude],
                    "period": units.si(each.period, time=1),
                    "begin": each.begin,
                }
                for each in self.motions
            ],
            "rotation": self.rotation,
            "discs": self.discs,
            "others": [*self.others],
            "unfollowed": [*self.unfollowed],
        }


def outside_of(reading: Reading, dumps: Sequence[Command] | None = None) -> Outside:
    """Return the actions on the spheres of a deck while it writes some dumps (default: those of `Reading.recorded`)."""
    recorded = reading.recorded if dumps is None else recorded_by(reading, dumps)
    if recorded is None:
        return Outside()
    spheres, found = recorded.spheres, _Found(reading, recorded)
    for fix in recorded.stage.fixes:
        found.take(fix)
    free = found.moves & ~found.held
    turning = [fix for fix in recorded.stage.fixes if fix.words[3] in ("nve", "nve/sphere")]
    some = free.any() and found.turns[free].any()
    discs = found.discs[free].any()
    if some and (not found.turns[free].all() or (discs and not found.discs[free].all())):
        found.others += map(str, turning)
    if (found.held & ~found.frozen & found.moves & found.turns).any() and found.sheared:
        found.others += [str(fix) for fix in recorded.stage.fixes if _stops(fix)]
    excluded = unread_commands(reading, recorded, ~free & ~found.moved)
    changed = map(str, changes_of(reading, recorded, recorded.dumps if dumps is None else dumps))
    return Outside(
        begin=recorded.begin,
        history=recorded.history,
        forgotten=_forgotten(reading, recorded),
        unturned=recorded.unturned,
        frozen=tuple(np.sort(spheres.id[found.frozen]).tolist()),
        held=tuple(np.sort(spheres.id[~free & ~found.moved]).tolist()),
        pushes={
            int(spheres.id[n]): tuple(found.pushes[n].tolist()) for n in np.flatnonzero(free & found.pushes.any(axis=1))
        },
        walls=tuple(found.walls),
        motions=tuple(found.motions),
        rotation=bool(some) or not free.any(),
        discs=bool(discs),
        others=tuple(dict.fromkeys((*found.others, *excluded, *changed))),
        unfollowed=(*found.unfollowed(), *unsure(reading, recorded)),
    )


def recorded_by(reading: Reading, dumps: Sequence[Command]) -> Recorded | None:
    """Return the first long run in which one of these dumps is on; else `Reading.recorded`."""
    chosen = {id(each) for each in dumps}
    return next((each for each in reading.records if chosen & {*map(id, each.dumps)}), reading.recorded)


class _Found:
    """Actions of the fixes of a run, collected fix by fix; arrays have a value for each sphere of the deck."""

    def __init__(self, reading: Reading, recorded: Recorded) -> None:
        self.reading, self.recorded, self.spheres = reading, recorded, recorded.spheres
        count = len(self.spheres.id)
        self.moves, self.turns, self.discs, self.held, self.frozen, self.moved = np.zeros((6, count), dtype=bool)
        self.pushes = np.zeros((count, 3))
        self.integrators = np.zeros(count, dtype=int)
        self.stopped = np.zeros((count, 3), dtype=bool)  # axes along which an earlier fix sets forces to 0
        self.late: list[tuple[Command, NDArray[np.bool_]]] = []  # fixes that push after it, and spheres (N,)
        self.walls: list[Wall] = []
        self.motions: list[Motion] = []
        self.others: list[str] = []
        self.unknown: list[str] = []

    def take(self, fix: Command) -> None:
        """Add the action of a fix."""
        style, words = fix.words[3], fix.words[4:]
        members = np.isin(self.spheres.id, self.recorded.members[fix])
        self.integrators += members & (style in _INTEGRATORS)
        if style in ("nve", "nve/sphere"):
            self.moves |= members
            self.turns |= members & (style == "nve/sphere")
            self.discs |= members & ("disc" in words)
        elif style in ("freeze", "nve/noforce"):
            self.held |= members
            self.frozen |= members & (style == "freeze")
            self.stopped[members & (style == "freeze")] = True
        elif style == "setforce" and _zeros(words) is not None:
            self._stop(fix, members)
        elif style == "move" and self._moves(fix, members):
            self.moved |= members
        elif style in ("addforce", "gravity") and (force := self._force(style, words)) is not None:
            self.pushes[members] += force[members]
            self.late.append((fix, members & (self.stopped & (force != 0)).any(axis=1)))
        elif style == "wall/gran" and (walls := self._walls(fix, members)):
            self.walls += walls
            self.late += [(fix, self.stopped.any(axis=1) & self._touches(wall)) for wall in walls]
        elif acts(fix):
            self.others.append(str(fix))

    def unfollowed(self) -> Iterator[str]:
        """Yield sentences on fixes that undo one another, and on spheres with a velocity that no fix moves."""
        ids, fixes = self.spheres.id, self.recorded.stage.fixes
        yield from self.unknown
        for fix, spheres in self.late:
            if (pushed := spheres & self.moves).any():
                yield f"{fix.place}: '{fix}' pushes sphere {ids[pushed][0]}, whose forces an earlier fix sets to 0"
        for sphere in ids[self.integrators > 1][:1]:
            moving = [fix for fix in fixes if fix.words[3] in _INTEGRATORS and sphere in self.recorded.members[fix]]
            yield f"{moving[-1].place}: '{moving[-1]}' moves sphere {sphere}, which '{moving[0]}' moves too"
        speeds = self.spheres.velocity.any(axis=1) | self.spheres.spin.any(axis=1)
        for sphere in ids[speeds & (self.integrators == 0)][: 0 if self.others else 1]:
            yield f"sphere {sphere} has a velocity or a spin, and no fix moves it; its contacts slip all the same"

    def _touches(self, wall: Wall) -> NDArray[np.bool_]:
        """Return which spheres touch a plane at the beginning."""
        away = wall.side * (wall.place - self.spheres.position[:, wall.axis])
        return np.asarray(away < self.spheres.radius)

    def _stop(self, fix: Command, members: NDArray[np.bool_]) -> None:
        """Add a ``setforce`` that sets forces to 0: all of them, or those along axes along which no sphere moves."""
        stopped = _zeros(fix.words[4:])
        assert stopped is not None
        self.stopped[members] |= stopped
        self.pushes[members] *= ~stopped
        if stopped.all():
            self.held |= members
        elif not self._flat[stopped].all():
            self.others.append(str(fix))

    @property
    def _flat(self) -> NDArray[np.bool_]:
        """Axes along which no sphere moves, as all spheres have the same place there."""
        places, speeds = self.spheres.position, self.spheres.velocity
        return np.asarray((np.ptp(places, axis=0) < _FLAT * self.spheres.radius.max()) & ~speeds.any(axis=0))

    @property
    def sheared(self) -> bool:
        """Return whether contacts may turn spheres; in a line that moves along itself they do not."""
        laws, flat = [*self.recorded.laws.values(), *(wall.law for wall in self.walls)], self._flat
        pushed = self.walls or self.pushes[:, flat].any() or self.spheres.spin.any()
        return any(law.friction for law in laws) and bool(flat.sum() < 2 or pushed)

    def _moves(self, fix: Command, members: NDArray[np.bool_]) -> bool:
        """Add a straight or oscillating motion, whose time LAMMPS counts from the command of the fix.

        Return whether the motion is known.
        """
        kind, words, begin = fix.words[4], fix.words[5:], self.recorded.begin
        in_box = words[-2:] == ("units", "box")
        spacing = (1.0, 1.0, 1.0) if in_box else _spacing(self.reading, fix)
        numbers = _numbers(words[:-2] if in_box or words[-2:] == ("units", "lattice") else words)
        if numbers is None or len(numbers) != {"linear": 3, "wiggle": 4}.get(kind) or spacing is None:
            return False
        if begin is None or self._ran_since(fix):
            self.unknown.append(f"{fix.place}: '{fix}' began at a step that is not known here")
            return True
        way, none = (numbers[0] * spacing[0], numbers[1] * spacing[1], numbers[2] * spacing[2]), (0.0, 0.0, 0.0)
        spheres = tuple(np.sort(self.spheres.id[members]).tolist())
        parts = (way, none, 1.0) if kind == "linear" else (none, way, numbers[3])
        self.motions.append(Motion(spheres, *parts, begin))
        return True

    def _ran_since(self, fix: Command) -> bool:
        """Return whether steps were taken between a fix and the run that writes the dump."""
        runs = [stage.command for stage in self.reading.stages if stage.steps != 0]
        for command in self.reading.commands[place_of(self.reading, fix) :]:
            if command is self.recorded.stage.command:
                break
            if any(command is run for run in runs):
                return True
        return False

    def _force(self, style: str, words: tuple[str, ...]) -> NDArray[np.float64] | None:
        """Return constant forces on all spheres, (N, 3); None if they are not constant."""
        if style == "addforce":
            numbers = _numbers(words)
            return None if numbers is None or len(numbers) != 3 else np.tile(numbers, (len(self.spheres.id), 1))
        kind, *rest = words[1:] or ("",)
        numbers, size = _numbers(tuple(rest)), _numbers(words[:1])
        if numbers is None or size is None or len(numbers) != {"vector": 3, "chute": 1, "spherical": 2}.get(kind):
            return None
        way = np.array(numbers)
        if kind != "vector":
            slope, around = (radians(each) for each in (numbers[-1], numbers[0] if kind == "spherical" else 0.0))
            down = cos(slope) if kind == "spherical" else -cos(slope)
            way = np.array([sin(slope) * cos(around), sin(slope) * sin(around), down])
            if self.reading.dimension == 2:
                way = np.array([sin(slope), down, 0.0])
        return np.outer(self.spheres.mass, size[0] * way / np.linalg.norm(way))

    def _walls(self, fix: Command, members: NDArray[np.bool_]) -> list[Wall]:
        """Return the planes of a ``fix wall/gran granular`` for all spheres; [] if it is another wall."""
        law, surface = law_of_wall(fix)
        plane, *ends = surface[:3] or ("",)
        known = law is not None and not law.unread and plane in PLANES and not {*surface[3:]} - {"contacts"}
        if law is None or not known or len(ends) < 2 or not members.all():
            return []
        return [
            Wall(PLANES.index(plane), side, float(end), law)
            for side, end in zip((-1, 1), ends, strict=True)
            if end != "NULL"
        ]


def _spacing(reading: Reading, fix: Command) -> Vector | None:
    """Return the spacings of the lattice along x, y and z at the command of a fix; None if they are not known.

    Without ``lattice`` they are 1. In units lj its number is a density, and its options may turn or stretch the cell.
    """
    found: Vector | None = (1.0, 1.0, 1.0)
    for command in reading.commands[: place_of(reading, fix)]:
        if command.name == "clear":
            found = (1.0, 1.0, 1.0)
        elif command.name == "lattice":
            style, *rest = command.words[1:]
            numbers, factors = _numbers(tuple(rest)), _SPACINGS.get(style)
            known = numbers is not None and len(numbers) == 1 and (reading.units != "lj" or style == "none")
            found = None
            if known and numbers and factors:
                found = (numbers[0] * factors[0], numbers[0] * factors[1], numbers[0] * factors[2])
    return found


def _numbers(words: tuple[str, ...]) -> list[float] | None:
    """Return words as numbers; None if one is not a number, such as a variable."""
    return [float(word) for word in words] if all(map(is_number, words)) else None


def _zeros(words: tuple[str, ...]) -> NDArray[np.bool_] | None:
    """Return the axes along which ``setforce`` sets forces to 0; None if it sets other forces."""
    numbers = _numbers(tuple("nan" if word == "NULL" else word for word in words))
    if numbers is None or len(numbers) != 3 or np.any(np.nan_to_num(numbers)):
        return None
    return ~np.isnan(numbers)


def _stops(fix: Command) -> bool:
    """Return whether a fix sets all forces on its spheres to 0, but not their torques."""
    return fix.words[3] == "setforce" and (stopped := _zeros(fix.words[4:])) is not None and bool(stopped.all())


def _forgotten(reading: Reading, recorded: Recorded) -> int | None:
    """Return the step at which the deck continues an earlier run from a data file; None if it does not."""
    return recorded.begin if reading.data_steps and not recorded.history else None
