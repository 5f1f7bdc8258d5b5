"""Runs of a foreign deck, and the spheres, contacts, laws, fixes and dumps at the beginning of a run."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.foreign.interpreter import Command, switch
from granular_lmp.foreign.laws import Law
from granular_lmp.frozen import dataclass

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

DUMPS = ("custom", "custom/gz", "custom/mpiio", "atom", "atom/gz")  # styles of dumps of spheres


@dataclass(frozen=True)
class Stage:
    """A run or a minimization.

    Attributes
    ----------
    command : its command.
    number : number of the command in `Reading.commands`.
    steps : number of steps; None for a minimization.
    timestep : in units of the deck.
    fixes, dumps : commands of the fixes and dumps that are on.
    exact : whether the spheres are at the places that the deck gives them: no earlier run was skipped.
    """

    command: Command
    number: int
    steps: int | None
    timestep: float
    fixes: tuple[Command, ...]
    dumps: tuple[Command, ...]
    exact: bool

    @property
    def long(self) -> bool:
        """Return whether it is a run of several steps, which is skipped here."""
        return self.steps is not None and self.steps > 1

    @property
    def resets(self) -> list[Command]:
        """Fixes that change the time step."""
        return [fix for fix in self.fixes if fix.words[3].startswith("dt/reset")]


@dataclass(frozen=True, eq=False)
class Spheres:
    """Spheres at the beginning of a run, in units of the deck.

    Attributes
    ----------
    id, type : (N,) arrays.
    radius, mass : (N,) arrays.
    position, velocity, spin, force, torque : (N, 3) arrays; forces and torques include those of all fixes.
    moves : (N,) array; whether an integrator moves the sphere.
    turns : (N,) array; whether it turns the sphere.
    """

    id: Integers
    type: Integers
    radius: Floats
    mass: Floats
    position: Floats
    velocity: Floats
    spin: Floats
    force: Floats
    torque: Floats
    moves: NDArray[np.bool_]
    turns: NDArray[np.bool_]

    @property
    def density(self) -> Floats:
        """Mass over volume, (N,)."""
        return np.asarray(self.mass / (4 / 3 * np.pi * self.radius**3))


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of neighbours within the range of their law, P pairs, each once.

    Attributes
    ----------
    i, j : (P,) arrays; indices of `Spheres`.
    vector : (P, 3) array; from the centre of j to that of i.
    overlap : (P,) array; below 0 across a gap.
    force : (P, 3) array; force on i.
    """

    i: Integers
    j: Integers
    vector: Floats
    overlap: Floats
    force: Floats

    def of(self, which: Any) -> "Pairs":
        """Return some of the pairs."""
        return Pairs(self.i[which], self.j[which], self.vector[which], self.overlap[which], self.force[which])


@dataclass(frozen=True, eq=False)
class Recorded:
    """The first long run in which some dumps of spheres are on; the first long run of all, if none is on in it.

    Attributes
    ----------
    stage : the run.
    begin : its first step; None if the steps of earlier runs are not known.
    history : whether steps were taken before, or a restart file was read, so that contacts may hold slip.
    unturned : whether it is certain that no sphere turns at its beginning.
    spheres : spheres at its beginning; places and velocities are those before the earlier runs, which are skipped.
    laws : law of each pair of types, the lower type first; empty if it is not known.
    members : numbers (``id``) of the spheres of each fix, and of the groups that ``neigh_modify exclude`` names.
    """

    stage: Stage
    begin: int | None
    history: bool
    unturned: bool
    spheres: Spheres
    laws: Mapping[tuple[int, int], Law]
    members: Mapping[Command, Integers]

    @property
    def dumps(self) -> list[Command]:
        """Return the dumps of spheres that it writes."""
        return of_spheres(self.stage.dumps)


def start_of(stages: Sequence[Stage]) -> Stage | None:
    """Return the first run of several steps; else the last of all, or None."""
    long = (stage for stage in stages if stage.long)
    return next(long, stages[-1] if stages else None)


def at_work(commands: Sequence[Command], kind: str) -> tuple[Command, ...]:
    """Return the commands of the fixes or dumps that are on after some commands, in the order of LAMMPS."""
    found: dict[str, Command] = {}
    for each in commands:
        switch(found, each, kind)
    return tuple(found.values())


def of_spheres(dumps: Sequence[Command]) -> list[Command]:
    """Return the dumps of spheres among some dumps."""
    return [each for each in dumps if each.words[3:4] and each.words[3] in DUMPS]


def excluding(commands: Sequence[Command]) -> list[Command]:
    """Return the commands that keep pairs of spheres out of the lists of neighbours."""
    return [each for each in commands if each.name == "neigh_modify" and "exclude" in each.words]
