"""Errors of the runs of a ladder, from the runs only, and the answer to which they are extrapolated.

The error of velocity Verlet is C h² + D h⁴ + … in the step h. Some effects make it of first order, or without an
expansion (`granular_lmp.effects.selection.order`). `granular_lmp.accuracy.extrapolation` sums runs with any steps and
estimates the error; this module provides its input from a scene. For a wave, errors are relative L2 norms, and signals
below the rounding noise do not count (`granular_lmp.accuracy.noise`). Without a wave they are largest errors over the
velocity of the fastest striker (`granular_lmp.accuracy.collisions`).
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from math import inf, isclose
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy import collisions, extrapolation
from granular_lmp.accuracy.budget import error_budget
from granular_lmp.accuracy.extrapolation import Judgement, combined, needed
from granular_lmp.accuracy.ladder import deciding_frequency, planned
from granular_lmp.accuracy.noise import counted, lost, out_of_reach, refuse_noise
from granular_lmp.accuracy.recorded import Recorded
from granular_lmp.effects.selection import order
from granular_lmp.problem import Problem
from granular_lmp.runs.components import FORCES, NAMES, RATES
from granular_lmp.runs.record import IN_SPACE, Record

Signals = Mapping[str, NDArray[np.float64]]

FINEST = 128  # largest ratio of the steps of the finest run to those of the first
FEWEST = 3  # number of runs that show how an error decreases
# The largest were 0.35 in 70 scenes of every kind (tests/hard); what adds up is that of an L wave of 0.4 Δ0 in 60 τ
SLIP, ADDS_UP = 0.8, 1 / 3


class Estimate:
    """Estimate of the errors of the runs of a problem; each run is added after it was made."""

    def __init__(self, problem: Problem) -> None:
        self._problem, self._order = problem, order(problem.scene)
        self._recorded, self._noise = Recorded(), dict[str, float]()
        self._judgements: list[Judgement] = []

    def __call__(self, records: Sequence[Record]) -> Judgement:
        """Return the answer of all runs so far, of which the last is new, with the errors of the counted signals."""
        problem, noise, tolerance = self._problem, self._noise, self._problem.scene.time.clock.tolerance
        self._recorded.add(records[-1])
        signals, counts = self._recorded.signals, _counts(records)
        if problem.wave is None:
            return collisions.judge(signals, counts, self._order, of_impact=problem.rest.scale.of_impact)
        if len(records) == 1:
            noise.update(lost(problem, signals[0], planned(problem)))
        names = [name for name in counted(problem, signals[-1]) if name not in noise]
        self._judgements.append(judge(problem, signals, counts, names))
        if len(records) >= FEWEST:
            before = self._judgements[-2].errors if len(records) > FEWEST else {}
            if missed := self._missed(counts, names):
                last = self._with_steps(counts[-1])
                noise.update(out_of_reach(tolerance, last, signals[-1], before, missed))
            refuse_noise(tolerance, noise, counted(problem, signals[-1]))
            names = [name for name in names if name not in noise]
        return replace(self._judgements[-1], errors={name: self._judgements[-1].errors[name] for name in names})

    def _with_steps(self, count: float) -> Problem:
        """Return the problem with some steps per sample."""
        return self._problem.stepped(self._problem.scene.time.sample / count)

    def _missed(self, counts: Sequence[int], names: Sequence[str]) -> dict[str, tuple[float, Problem]]:
        """Return the errors above the tolerance by name, and the problem with the step that should meet it."""
        judgement, found = self._judgements[-1], {}
        tolerance = self._problem.scene.time.clock.tolerance
        for name in names:
            error = judgement.errors[name]
            if tolerance < error < inf:
                _, steps = needed(counts, judgement, error, tolerance)
                found[name] = error, self._with_steps(min(steps, FINEST * max(counts)))
        return found

    def outcome(self, judgement: Judgement, answer: Record) -> dict[str, Any]:
        """Return the entries of ``run.json`` on the errors of the answer: for the record and for monitors."""
        if self._problem.wave is None:
            of_monitors = {name: error for name, error in judgement.errors.items() if "." in name}
            own = {name: error for name, error in judgement.errors.items() if name not in of_monitors}
            found = {"error_estimate": own, "order": self._order}
            return found | ({"errors_of_monitors": of_monitors} if of_monitors else {})
        there = counted(self._problem, self._recorded.signals[-1])
        noise = {name: self._noise[name] for name in there if name in self._noise}
        errors = judgement.errors | {name: self._judgements[-1].errors[name] for name in noise}
        own = {name: error for name, error in errors.items() if "." not in name}
        return {
            "error_estimate": {name: errors.get(name) for name in ("p", "q", "phi")},
            "errors_of_monitors": {name: error for name, error in errors.items() if "." in name},
            "noise": noise,
            "error_budget": error_budget(self._problem, answer.signals, own),
        }


def _counts(records: Sequence[Record]) -> list[int]:
    """Return the steps per sample of runs."""
    return [each.scene.time.steps_per_sample for each in records]


def richardson(coarse: Record, fine: Record, order: int = 2) -> Record:
    """Return the extrapolated record of two runs of one scene, the second with half the step of the first.

    Parameters
    ----------
    coarse, fine : Record
        Records at the same times.
    order : int
        Order of the error in the step: 2, or 1 with some effects (`effects.selection.order`); 4 for two records that
        are already extrapolated; 0 for an error without expansion, for which the finer run is returned.

    Returns
    -------
    Record
        Extrapolated record with the scene of the finer run. ``info["error_estimate"]`` holds the relative L2 errors of
        the signals of the finer run, None for a signal that is zero; the extrapolated record is better. For order 0
        they are the differences of the two runs.

    Raises
    ------
    ValueError
        If the records have different times, or the ratio of their steps is not 2.

    Notes
    -----
    The extrapolation fails if the error has another order in the step, and below the rounding of the positions.
    """
    if coarse.tau.shape != fine.tau.shape or not np.allclose(coarse.tau, fine.tau, rtol=1e-12, atol=0):
        raise ValueError("the two records have different times")
    ratio = coarse.scene.time.step / fine.scene.time.step
    if not isclose(ratio, 2, rel_tol=1e-9):
        raise ValueError(f"the steps {coarse.scene.time.step!r} and {fine.scene.time.step!r} must have the ratio 2")
    signals, estimates = {}, {}
    weights = extrapolation.weights_of((1, 2), (order,)) if order else (0.0, 1.0)
    for name, b in fine.signals.items():
        a = coarse.signals[name]
        signals[name] = combined((a, b), weights)
        norm = np.linalg.norm(signals[name])
        estimates[name] = float(np.linalg.norm(b - a) / max(2**order - 1, 1) / norm) if norm > 0 else None
    return replace(fine, signals=signals, info=fine.info | {"error_estimate": estimates}, folder=None)


def combined_record(runs: Sequence[Record], judgement: Judgement) -> Record:
    """Return the record of the answer that a judgement makes from runs."""
    weights = judgement.weights
    signals = {name: combined([run.signals[name] for run in runs], weights) for name in runs[-1].signals}
    return replace(runs[-1], signals=signals, folder=None)


def judge(
    problem: Problem, runs: Sequence[Signals], counts: Sequence[int], counted: Collection[str] | None = None
) -> Judgement:
    """Return the answer of runs and the estimate of its error (`granular_lmp.accuracy.extrapolation.judge`).

    Parameters
    ----------
    problem : Problem
        Problem of the runs, with any step.
    runs : sequence of dict
        Signals by name, arrays whose first axis is time, of each run, in the order in which they were made.
    counts : sequence of int
        Steps per sample of each run.
    counted : collection of str, optional
        Names of the signals by which the answer is chosen; all of them if left out.
    """
    hidden = slip_bounds(problem, runs[-1])
    return extrapolation.judge(runs, counts, order(problem.scene), counted=counted, hidden=hidden)


def slip_bounds(problem: Problem, signals: Signals) -> dict[str, float]:
    """Return bounds on the first-order error of the slip in LAMMPS, as L2 norms for a step of one sample.

    LAMMPS rotates the slip of a contact with its direction at the end of the step. This adds ½h (t·v)(n·v)/2R to the
    rate of the slip, of order ½h a U² Ω² Δ0/2R in D0/t0 for displacements U in D0, and moves spheres by `SLIP` times as
    much, without the factor ½. It also shifts the phase of the wave, in the next order of a and in proportion to time.
    Fluxes have no bound.
    """
    scene, frequency = problem.scene, deciding_frequency(problem)
    swing = max(1.0, float(np.max(sum(signals[name] ** 2 for name in ("p", "q", "phi") if name in signals))))
    amplitude, duration = scene.amplitude, scene.time.duration
    moved = SLIP * amplitude * frequency**2 * scene.sphere.overlap_ratio * swing * scene.time.sample
    moved *= 1 + ADDS_UP * amplitude * frequency * duration
    moves = ("p", "q", *NAMES, *IN_SPACE)
    factors = dict.fromkeys(moves, 1.0) | dict.fromkeys(RATES, frequency)
    pushes = [name for name in FORCES if not name.startswith("rolling")]
    factors |= dict.fromkeys(pushes, 2.0)  # in k1 D0, of two spheres that move
    return {
        name: moved * factors[column] * float(np.sqrt(values.size))
        for name, values in signals.items()
        if (column := name.rpartition(".")[2]) in factors
    }
