"""Objectives that a design reads off whole runs of a scene, by their names, and the scene as a run of factors.

| objective | what it is |
|---|---|
| second-harmonic | displacements along k with 2k in the last quarter of a run, root mean square, in D0; even orders |
| largest:MONITOR | largest displacement of the spheres of a monitor, in D0 |
| motion:MONITOR | mean squared velocity of these spheres, in (D0/t0)² |
| motion:MONITOR/OTHER | that of one monitor over that of another, as its mirror image |
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jax.tree_util import Partial
from numpy.typing import NDArray

from granular_analysis.measure.snapshot import FirstSnapshot
from granular_analysis.measure.stepping import first_of
from granular_analysis.theory import network_objectives
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network_design import Goal
from granular_analysis.theory.network_factors import Run
from granular_analysis.theory.network_gradient import Record as Motion
from granular_analysis.theory.scenes import Setting, need_wave
from granular_lmp.runs.record import Record, Scene

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
_EQUAL = 1e-6  # of the largest motion at the start


@dataclass(frozen=True, eq=False)
class Subject:
    """A scene whose runs are read, and the first moment of its run.

    Attributes
    ----------
    scene : of equal spheres, with a time step.
    first, step : the spheres, and the step in units of the deck.
    """

    scene: Scene
    first: FirstSnapshot
    step: float

    @classmethod
    def of(cls, scene: Scene) -> "Subject":
        """Return that of a scene.

        Raises TheoryError for a scene without a wave or a time step, whose spheres differ, or that the network leaves
        out.
        """
        need_wave(scene)
        if scene.time.tolerance is not None:
            raise TheoryError(f"time.tolerance = {scene.time.tolerance:g}: must be a step, as time.timestep = 0.1")
        first, setting = first_of(scene)
        return cls(scene, first, setting.step)

    @cached_property
    def places(self) -> Integers:
        """Return the index of the sphere at each row, column and layer, (rows, columns, layers)."""
        shape = self.scene.shape
        size = shape.rows, shape.columns, shape.layers
        if len(self.first.network.position) != np.prod(size):
            raise TheoryError("disorder.vacancies: must be left out, as a design counts the places of the lattice")
        return np.arange(np.prod(size)).reshape(size)

    def monitor(self, name: str) -> Integers:
        """Return the spheres of a monitor."""
        known = {each.name: each for each in self.scene.monitor}
        if name not in known:
            raise TheoryError(f"monitor {name!r}: must be one of the scene's, {', '.join(known) or 'which has none'}")
        own, layers = known[name], known[name].layers or (0, self.scene.shape.layers - 1)
        inside = self.places[:, :, layers[0] : layers[1] + 1]
        if own.rows:
            return np.asarray(inside[own.rows[0] : own.rows[1] + 1].ravel())
        return np.concatenate([inside[row, column] for row, column in own.spheres])

    def groups(self, per: str) -> Integers:
        """Return the number of the density of each sphere, (N,), from 0: per "sphere", "row", or cell "RxC"."""
        row, column, layer = np.unravel_index(self.places.ravel(), self.places.shape)
        if per == "sphere":
            return self.places.ravel()
        if per == "row":
            return np.asarray(row)
        rows, columns = _cell(per, self.places.shape)
        return np.asarray(((row % rows) * columns + column % columns) * self.places.shape[2] + layer)

    def run(self, spheres: Integers) -> Run:
        """Return the run that records some spheres at each sample."""
        time = self.scene.time
        return Run(self.first.network, self.first.state, self.step, time.samples, time.steps_per_sample, spheres)


def _cell(per: str, shape: tuple[int, ...]) -> tuple[int, int]:
    sizes = [int(each) if each.isdecimal() else 0 for each in per.split("x")]
    if len(sizes) != 2 or not all(size > 0 and number % size == 0 for size, number in zip(sizes, shape, strict=False)):
        rows, columns, _ = shape
        raise TheoryError(
            f"--per {per}: must be sphere, row, or a cell as 4x2, rows and columns that divide {rows} and {columns}"
        )
    return sizes[0], sizes[1]


def _second_harmonic(subject: Subject, _: str) -> tuple[Goal, Integers]:
    scene, first = subject.scene, subject.first
    if scene.source:
        raise TheoryError("second-harmonic: the wave must be all that moves the spheres, without [[source]]")
    vector = Setting(scene.with_values({"packing.table": ""})).mode().wavevector[: first.network.dimension]
    read = Partial(
        network_objectives.second_harmonic,
        places=first.network.position,
        wavevector=np.real(vector) * first.scales.metre,
        unit=first.length,
    )
    return Goal(read, (1.0, -1.0)), np.arange(len(first.network.position))


def _largest(subject: Subject, name: str) -> tuple[Goal, Integers]:
    spheres = subject.monitor(name)
    return Goal(Partial(network_objectives.farthest, unit=subject.first.length)), spheres


def _motion(subject: Subject, name: str) -> tuple[Goal, Integers]:
    near, _, far = name.partition("/")
    here, there = subject.monitor(near), subject.monitor(far) if far else np.empty(0, dtype=np.intp)
    ends = np.arange(len(here)), len(here) + np.arange(len(there))
    unit = subject.first.length / subject.first.time
    read = Partial(network_objectives.motion, near=ends[0], far=ends[1], unit=unit)
    return Goal(read), np.concatenate([here, there])


Make = Callable[[Subject, str], tuple[Goal, Integers]]
OBJECTIVES: Mapping[str, tuple[Make, str]] = {
    "second-harmonic": (_second_harmonic, ""),
    "largest": (_largest, ":MONITOR"),
    "motion": (_motion, ":MONITOR or :MONITOR/OTHER"),
}


def goal_of(subject: Subject, objective: str) -> tuple[Goal, Integers]:
    """Return what is to be largest, and the spheres that it reads; TheoryError for an unknown objective."""
    name, colon, of = objective.partition(":")
    if name not in OBJECTIVES or bool(colon) != bool(OBJECTIVES[name][1]):
        known = ", ".join(name + of for name, (_, of) in OBJECTIVES.items())
        raise TheoryError(f"--maximize {objective}: must be one of {known}")
    return OBJECTIVES[name][0](subject, of)


def read_off(records: Sequence[Record], objective: str) -> float:
    """Return an objective of runs that recorded snapshots at each sample: one for each sign of the start.

    Raises TheoryError for another number of runs, for one whose snapshots are rarer, and for starts of equal sign.
    """
    subject = Subject.of(records[0].scene)
    goal, spheres = goal_of(subject, objective)
    if len(records) != len(goal.signs):
        raise TheoryError(f"{objective}: is read off {len(goal.signs)} runs, not {len(records)}")
    for each in records:
        asked, sample = each.scene.output.particles, each.scene.time.sample
        if asked != sample:
            raise TheoryError(
                f"output.particles = {asked:g}: must be time.sample = {sample:g}, at which a design reads"
            )
    motions = [_motion_of(each, subject.first, spheres) for each in records]
    starts = [sign * each.motion[0] for sign, each in zip(goal.signs, motions, strict=True)]
    if not all(np.allclose(each, starts[0], rtol=0, atol=_EQUAL * np.abs(starts[0]).max()) for each in starts):
        raise TheoryError(f"{objective}: is read off runs that start with opposite signs: wave.phase differs by pi")
    return goal.of(motions)[0]


def _motion_of(record: Record, first: FirstSnapshot, spheres: Integers) -> Motion:
    """Return the motion of some spheres in the snapshots of a run, without turns, in units of its deck."""
    snapshots = record.snapshots()
    place, rate = (np.moveaxis(each[:, spheres], 2, 1) for each in snapshots.stacks("displacement", "velocity"))
    still = np.zeros_like(place[:, :1] if place.shape[1] == 2 else place)
    rows = np.concatenate([place, still, rate / first.time, still], axis=1) * first.length
    return Motion(snapshots.tau * first.time, rows, np.zeros((len(rows), 0)))


def designed(scene: Scene, best: Floats) -> Scene:
    """Return a scene with the densities of its spheres, in that of the scene, in a table."""
    return scene.with_values({"packing.table": {"density": (scene.sphere.density * best).tolist()}})
