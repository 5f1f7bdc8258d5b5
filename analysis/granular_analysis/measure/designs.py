"""Objectives of a design, by name, computed from whole runs of a scene; and the run of a scene with free densities.

| objective | quantity |
|---|---|
| second-harmonic | rms displacement along k with wave vector 2k in the last quarter of a run, even orders only, in D0 |
| largest:MONITOR | largest displacement of the spheres of a monitor, in D0 |
| motion:MONITOR | mean squared velocity of the spheres of a monitor, in (D0/t0)² |
| motion:MONITOR/OTHER | mean squared velocity of one monitor over that of another, for example its mirror image |
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
_EQUAL = 1e-6  # starts that differ by less than this share of the largest motion are equal


@dataclass(frozen=True, eq=False)
class Subject:
    """A scene and the start of its run.

    Attributes
    ----------
    scene : scene with a wave and a time step.
    first : spheres at the start.
    step : time step in units of the deck.
    """

    scene: Scene
    first: FirstSnapshot
    step: float

    @classmethod
    def of(cls, scene: Scene) -> "Subject":
        """Return the subject of a scene.

        Raises TheoryError (a ValueError) for a scene without a wave, with a tolerance in place of a time step, or that
        the network leaves out.
        """
        need_wave(scene)
        if scene.time.tolerance is not None:
            raise TheoryError(f"time.tolerance = {scene.time.tolerance:g}: must be a step, as time.timestep = 0.1")
        first, setting = first_of(scene)
        return cls(scene, first, setting.step)

    @cached_property
    def places(self) -> Integers:
        """Return the index of the sphere at each row, column and layer, (rows, columns, layers).

        Raises TheoryError for a scene with vacancies.
        """
        shape = self.scene.shape
        size = shape.rows, shape.columns, shape.layers
        if len(self.first.network.position) != np.prod(size):
            raise TheoryError("disorder.vacancies: must be 0, because a design counts the places of the lattice")
        return np.arange(np.prod(size)).reshape(size)

    def monitor(self, name: str) -> Integers:
        """Return the indices of the spheres of a monitor, (n,); raise TheoryError for an unknown monitor."""
        known = {each.name: each for each in self.scene.monitor}
        if name not in known:
            there = f"must be one of {', '.join(known)}" if known else "the scene has no [[monitor]]"
            raise TheoryError(f"monitor {name!r}: {there}")
        own, layers = known[name], known[name].layers or (0, self.scene.shape.layers - 1)
        inside = self.places[:, :, layers[0] : layers[1] + 1]
        if own.rows:
            return np.asarray(inside[own.rows[0] : own.rows[1] + 1].ravel())
        return np.concatenate([inside[row, column] for row, column in own.spheres])

    def groups(self, per: str) -> Integers:
        """Return the number of the density of each sphere, (N,), from 0.

        Each sphere (`per` "sphere"), each row ("row"), or each sphere of a cell of R rows and C columns ("RxC") has a
        density of its own. Raises TheoryError for another word, or a cell that does not divide the crystal.
        """
        row, column, layer = np.unravel_index(self.places.ravel(), self.places.shape)
        if per == "sphere":
            return self.places.ravel()
        if per == "row":
            return np.asarray(row)
        rows, columns = _cell(per, self.places.shape)
        return np.asarray(((row % rows) * columns + column % columns) * self.places.shape[2] + layer)

    def run(self, spheres: Integers) -> Run:
        """Return a run that records the given spheres (n,) at each sample."""
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
        raise TheoryError("second-harmonic: only the wave may move the spheres; remove [[source]]")
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
    """Return the goal of an objective and the spheres (n,) that it reads.

    Raises TheoryError for an unknown objective, an unknown monitor, and for "second-harmonic" with a source.
    """
    name, colon, of = objective.partition(":")
    if name not in OBJECTIVES or bool(colon) != bool(OBJECTIVES[name][1]):
        known = ", ".join(name + of for name, (_, of) in OBJECTIVES.items())
        raise TheoryError(f"--maximize {objective}: must be one of {known}")
    return OBJECTIVES[name][0](subject, of)


def read_off(records: Sequence[Record], objective: str) -> float:
    """Return an objective from runs with snapshots at each sample, one run for each sign of the start.

    Raises TheoryError for a wrong number of runs, for snapshots at other times than the samples, and unless the starts
    differ in sign only.
    """
    subject = Subject.of(records[0].scene)
    goal, spheres = goal_of(subject, objective)
    if len(records) != len(goal.signs):
        raise TheoryError(f"{objective}: needs {len(goal.signs)} runs, not {len(records)}")
    for each in records:
        asked, sample = each.scene.output.particles, each.scene.time.sample
        if asked != sample:
            raise TheoryError(
                f"output.particles = {asked:g}: must be time.sample = {sample:g}, as a design needs each sample"
            )
    motions = [_motion_of(each, subject.first, spheres) for each in records]
    starts = [sign * each.motion[0] for sign, each in zip(goal.signs, motions, strict=True)]
    if not all(np.allclose(each, starts[0], rtol=0, atol=_EQUAL * np.abs(starts[0]).max()) for each in starts):
        raise TheoryError(f"{objective}: the runs must start with opposite signs: wave.phase must differ by pi")
    return goal.of(motions)[0]


def _motion_of(record: Record, first: FirstSnapshot, spheres: Integers) -> Motion:
    """Return the motion of some spheres in the snapshots of a run, in units of its deck; rotations and spins are 0."""
    snapshots = record.snapshots()
    place, rate = (np.moveaxis(each[:, spheres], 2, 1) for each in snapshots.stacks("displacement", "velocity"))
    still = np.zeros_like(place[:, :1] if place.shape[1] == 2 else place)
    rows = np.concatenate([place, still, rate / first.time, still], axis=1) * first.length
    return Motion(snapshots.tau * first.time, rows, np.zeros((len(rows), 0)))


def designed(scene: Scene, best: Floats) -> Scene:
    """Return a scene with a table of densities: `best` (N,) times the density of the scene."""
    return scene.with_values({"packing.table": {"density": (scene.sphere.density * best).tolist()}})
