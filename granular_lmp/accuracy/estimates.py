"""The errors of the runs of a ladder, from the runs alone: those of a wave, and those without one."""

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import Any, Protocol

from granular_lmp.accuracy import collisions
from granular_lmp.accuracy.budget import error_budget
from granular_lmp.accuracy.extrapolation import Judgement, needed
from granular_lmp.accuracy.halving import FINEST
from granular_lmp.accuracy.ladder import finest_step, with_step
from granular_lmp.accuracy.noise import counted, lost, out_of_reach, refuse_noise
from granular_lmp.accuracy.recorded import Recorded
from granular_lmp.accuracy.richardson import judge
from granular_lmp.effects.selection import order
from granular_lmp.problem import Problem
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.record import Record

FEWEST = 3  # runs that show how an error falls


class Estimate(Protocol):
    """The estimate of the errors of runs, to which each run is added after it was made."""

    def __call__(self, records: Sequence[Record]) -> Judgement:
        """Return the answer of all runs so far, of which the last is new, with the errors that count."""

    def outcome(self, judgement: Judgement, answer: Record) -> dict[str, Any]:
        """Return the entries of ``run.json`` about the errors of the answer."""


def estimate_of(problem: Problem) -> Estimate:
    """Return the estimate of the errors of the runs of a problem."""
    return OfCollisions(problem) if problem.mode is None else OfWave(problem)


class OfWave:
    """Relative L2 errors; signals that rounding drowns do not count (`granular_lmp.accuracy.noise`)."""

    def __init__(self, problem: Problem) -> None:
        self._scene = problem.scene
        self._recorded, self._noise = Recorded(), dict[str, float]()
        self._judgements: list[Judgement] = []

    def __call__(self, records: Sequence[Record]) -> Judgement:
        """Return the answer of all runs so far, with the errors of the signals that count."""
        scene, noise, tolerance = self._scene, self._noise, self._scene.time.tolerance
        self._recorded.add(records[-1])
        signals = self._recorded.signals
        if len(records) == 1:
            noise.update(lost(scene, signals[0], with_step(scene, finest_step(scene))))
        names = [name for name in counted(scene, signals[-1]) if name not in noise]
        self._judgements.append(judge(signals, [record.scene for record in records], names))
        if len(records) >= FEWEST and tolerance is not None:
            before = self._judgements[-2].errors if len(records) > FEWEST else {}
            noise.update(out_of_reach(tolerance, records[-1].scene, signals[-1], before, self._missed(records, names)))
            refuse_noise(tolerance, noise, counted(scene, signals[-1]))
            names = [name for name in names if name not in noise]
        return replace(self._judgements[-1], errors={name: self._judgements[-1].errors[name] for name in names})

    def _missed(self, records: Sequence[Record], names: Sequence[str]) -> dict[str, tuple[float, Scene]]:
        """Return the errors above the tolerance by name, and the scene with the step that is expected to meet it."""
        judgement, time, found = self._judgements[-1], self._scene.time, {}
        counts = [each.scene.time.steps_per_sample for each in records]
        for name in names:
            error = judgement.errors[name]
            if time.tolerance is not None and time.tolerance < error < inf:
                _, steps = needed(counts, judgement, error, time.tolerance)
                found[name] = error, with_step(self._scene, time.sample / min(steps, FINEST * max(counts)))
        return found

    def outcome(self, judgement: Judgement, answer: Record) -> dict[str, Any]:
        """Return the errors of p, q, φ and of monitors, and the budget of the former."""
        there = counted(self._scene, self._recorded.signals[-1])
        noise = {name: self._noise[name] for name in there if name in self._noise}
        found = judgement.errors | {name: self._judgements[-1].errors[name] for name in noise}
        own = {name: error for name, error in found.items() if "." not in name}
        return {
            "error_estimate": {name: found.get(name) for name in ("p", "q", "phi")},
            "errors_of_monitors": {name: error for name, error in found.items() if "." in name},
            "noise": noise,
            "error_budget": error_budget(self._scene, answer.signals, own),
        }


class OfCollisions:
    """The largest errors, over the velocity of the fastest striker (`granular_lmp.accuracy.collisions`)."""

    def __init__(self, problem: Problem) -> None:
        self._order, self._of_impact, self._recorded = order(problem.scene), problem.scale.of_impact, Recorded()

    def __call__(self, records: Sequence[Record]) -> Judgement:
        """Return the answer of all runs so far, with the errors of all that is recorded."""
        self._recorded.add(records[-1])
        counts = [each.scene.time.steps_per_sample for each in records]
        return collisions.judge(self._recorded.signals, counts, self._order, of_impact=self._of_impact)

    def outcome(self, judgement: Judgement, answer: Record) -> dict[str, Any]:
        """Return the errors of recorded spheres and of monitors, and the order of the error in the step."""
        of_monitors = {name: error for name, error in judgement.errors.items() if "." in name}
        own = {name: error for name, error in judgement.errors.items() if name not in of_monitors}
        found = {"error_estimate": own, "order": self._order}
        return found | ({"errors_of_monitors": of_monitors} if of_monitors else {})
