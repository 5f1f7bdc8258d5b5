"""Thermo table of a run by another engine: the columns with which the guards of its deck judge it."""

from collections.abc import Callable
from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray

from granular_lmp.effects.between_looks import nearly_open
from granular_lmp.effects.case import Case
from granular_lmp.effects.creep import creeping
from granular_lmp.effects.openings import by_pairs, lingers
from granular_lmp.effects.width import centre_row
from granular_lmp.errors import SceneError
from granular_lmp.frozen import cached_property
from granular_lmp.lammps.guards import GUARDS, columns, has_looks
from granular_lmp.lammps.region_of_influence import reach
from granular_lmp.problem import Problem
from granular_lmp.runs.engine import Look, Moment


class Observer:
    """Compute the columns of the thermo table of a problem; raise SceneError for a column that only LAMMPS has."""

    def __init__(self, problem: Problem) -> None:
        self.problem, scene, units = problem, problem.scene, problem.units
        self.names = _names(problem)
        self.length = units.number(scene.scale.length, length=1)  # Δ0, or ℓ for spheres that meet
        self.shift = self.length if scene.wave is None else units.number(scene.displacement_amplitude, length=1)
        self.radius = units.number(scene.sphere.radius, length=1)
        self.friction = Case(scene, problem.on).friction
        looked: dict[str, Callable[[Look], float]] = {
            "v_slip": lambda look: look.slip / self.friction,
            "v_open": self.opened,
            "v_overlap": self.smallest,
            "v_torque": self.torque,
        }
        if not has_looks(problem):
            looked = {"v_overlap": self.in_diameters, "v_omega_dt": self.omega_dt}
        self.looked = {name: looked[name] for name in self.names if name in looked}
        moved: dict[str, Callable[[Moment], float]] = {
            "v_tau": lambda moment: moment.number * scene.time.step,
            "v_spread": self.spread,
            "v_sideways": self.sideways,
            "v_creep": self.creep,
        }
        self.moved = {name: moved[name] for name in self.names if name in moved}
        if lacks := [name for name in self.names if name not in self.looked | self.moved]:
            raise SceneError(f"guards: only LAMMPS knows {', '.join(lacks)}", because="not built")
        suspects = "v_open" in self.looked and not (by_pairs(scene) and lingers(problem))
        self.nearly = nearly_open(problem.rest) if suspects else -np.inf

    @property
    def head(self) -> str:
        """Line above the table."""
        return f"Step {' '.join(self.names)}\n"

    def line(self, moment: Moment) -> str:
        """Return the line of a moment."""
        values = {name: value(moment) for name, value in self.moved.items()}
        if self.looked:
            look = moment.look(reach(self.problem, moment.number))
            values |= {name: value(look) for name, value in self.looked.items()}
        return f"{moment.number} {' '.join(repr(float(values[name])) for name in self.names)}\n"

    def smallest(self, look: Look) -> float:
        """Return the smallest overlap of touching contacts, in Δ0; with a wall relative to its overlap at rest."""
        return min(look.smallest / self.length, look.on_wall)

    def opened(self, look: Look) -> float:
        """Return the number of contacts that have opened or formed; at least 1 if one may have between two looks."""
        return max(ceil(look.changed), float(self.smallest(look) < self.nearly))

    def torque(self, look: Look) -> float:
        """Return the largest torque, in R g1 D0."""
        stiffness = self.problem.units.number(self.problem.scene.sphere.shear_stiffness, mass=1, time=-2)
        return look.torque / (self.radius * stiffness * self.shift)

    def in_diameters(self, look: Look) -> float:
        """Return the deepest overlap over the smallest diameter."""
        return look.deepest / (2 * self.radius * float(self.problem.rest.atoms.arrays["radius"].min()))

    def omega_dt(self, look: Look) -> float:
        """Return the time step in units of 1/ω of the stiffest contact."""
        stiffest = self.problem.rest.square_rate * sqrt(look.deepest / self.length)
        return self.problem.scene.time.step * sqrt(stiffest)

    @cached_property
    def row(self) -> NDArray[np.int64]:
        """Spheres of the centre row."""
        return centre_row(self.problem)

    def spread(self, moment: Moment) -> float:
        """Return the distance by which spheres of the centre row have moved apart, in D0."""
        return float(np.ptp(moment.fields(self.row)[0], axis=0).sum()) / self.shift

    def sideways(self, moment: Moment) -> float:
        """Return the largest distance of a sphere of a chain from its line, in D0."""
        every = np.arange(len(self.problem.rest.atoms))
        return float(np.abs(moment.fields(every)[0][:, 0]).max()) / self.shift

    def creep(self, moment: Moment) -> float:
        """Return the mean displacement of the spheres that creep most, in D0."""
        means = moment.fields(creeping(self.problem))[0].mean(axis=0)
        return float(np.hypot(means[0], means[1])) / self.shift


def _names(problem: Problem) -> list[str]:
    """Return the columns behind the step."""
    if not problem.looks:
        return ["v_tau"]
    if has_looks(problem):
        return columns(problem)
    return ["v_tau", *dict.fromkeys(GUARDS[name].column for name in problem.guards)]
