"""Interface of another engine that replaces the time loop of LAMMPS.

The engine steps the spheres of a deck with the scheme of LAMMPS. `granular_lmp.runs.stepping` writes the results into
the files that LAMMPS would write; everything else, from the lock of the folder to its seal, is as in any run. This
package has no engine: `granular-analysis network` provides one.
"""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import centre
from granular_lmp.errors import SceneError as SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.beginning import Beginning, beginning
from granular_lmp.lammps.region_of_influence import distances
from granular_lmp.problem import Problem, prepare
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.continuation import NETWORK
from granular_lmp.runs.manifest import description

__all__ = ["Engine", "Look", "Moment", "Motion", "Setting"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Look(NamedTuple):
    """Extremes of the contacts within the reach at a moment, for the guards of a deck.

    Attributes
    ----------
    smallest : smallest overlap of two touching spheres; infinite if there are none.
    on_wall : smallest overlap of spheres with walls, over that at rest.
    deepest : largest overlap of any contact; 0 if there are none.
    changed : contacts that have opened or formed since rest.
    slip : largest shear force over the force at which the contact would slide with a friction of 1.
    torque : largest torque on a sphere; in space of the largest components.
    """

    smallest: float
    on_wall: float
    deepest: float
    changed: float
    slip: float
    torque: float


class Moment(Protocol):
    """Spheres after a number of steps, in units of the deck."""

    @property
    def number(self) -> int:
        """Number of steps."""

    def fields(self, spheres: Integers) -> tuple[Floats, Floats, Floats, Floats]:
        """Return displacement, velocity, rotation and spin of n spheres, (n, d); in the plane rotations are (n, 1)."""

    def forces(self, spheres: Integers) -> Floats:
        """Return the forces on n spheres that are neither held nor moved, (n, d)."""

    def contacts(self, spheres: Integers) -> tuple[Integers, Floats]:
        """Return the closed contacts among some spheres: both ends (2, C), and the columns of a monitor, (C, 1 + 2d).

        The columns are the normal force, positive if repulsive; the tangential force on the first sphere; and the
        vector from the second to the first.
        """

    def look(self, reach: float) -> Look:
        """Return the extremes for guards of the spheres whose `Setting.distances` are below a reach."""

    def kept(self) -> Mapping[str, NDArray[Any]]:
        """Return everything that the next step needs, for a checkpoint."""


class Motion(Protocol):
    """Motion of the spheres of a run."""

    def moments(self, stops: Iterable[int], kept: Mapping[str, NDArray[Any]] | None) -> Iterator[Moment]:
        """Yield the spheres after each of some ascending numbers of steps, from the start or from a checkpoint."""


@dataclass(frozen=True, eq=False)
class Setting:
    """Spheres and time step of a run, for an engine.

    Attributes
    ----------
    scene : Scene
        With every "auto" decided.
    info : dict
        Part of ``run.json`` that is known before the run: effects, drag of quiet ends.
    spheres : Beginning
    step : float
        Time step in units of the deck.
    recorded : int
        Index of the centre sphere; −1 without a wave.
    distances : (N,) array
        Distance of each sphere from the recorded spheres.
    """

    scene: Scene
    info: Mapping[str, Any]
    spheres: Beginning
    step: float
    recorded: int
    distances: Floats

    @classmethod
    def of(cls, problem: Problem, info: Mapping[str, Any], begun: Beginning) -> Self:
        """Return the setting of a problem with this initial state, whose ``run.json`` begins with `info`."""
        recorded = -1 if problem.scene.wave is None else centre(problem.rest.atoms)
        step = problem.units.number(problem.scene.time.step * problem.scene.scale.time, time=1)
        return cls(problem.scene, info, begun, step, recorded, distances(problem))


def setting_of(scene: Scene) -> Setting:
    """Return the setting of the run of a scene, without starting it."""
    problem = prepare(scene)
    return Setting.of(problem, description(problem, [], NETWORK, 1), beginning(problem))


class Engine(Protocol):
    """Engine that steps the spheres of a deck in place of LAMMPS."""

    @property
    def device(self) -> str:
        """Device on which it runs, for ``run.json``; a run continues on the same device."""

    @property
    def versions(self) -> Mapping[str, str]:
        """Versions of its software, for ``run.json``."""

    def begin(self, setting: Setting) -> Motion:
        """Return the motion of a setting; raise `GranularError` that names what the engine does not support."""
