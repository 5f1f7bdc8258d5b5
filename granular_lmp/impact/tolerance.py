"""An impact to a tolerance: which steps are tried, the extrapolation of their runs, and the estimate of its error.

The error of every velocity and of R times every spin, over the unit v of the impact (`ImpactScene.scale`: the velocity
of the fastest striker), and that of every displacement over the largest, is at most ``time.tolerance``, as estimated.
Three runs a, b, c, each with half the step of the
one before, show the order p of their error by the L2 norms of their differences,

    |a − b|/|b − c| = 2^p,

2 for spheres that slide on nothing, and 1 with damping or with friction and the law "incremental", whose forces LAMMPS
takes at half steps. The answer is (2^p c − b)/(2^p − 1), and its estimated error the largest difference from the same
answer of a and b, times `SAFETY`. Contacts that close and open inside a step leave an error of order 5/2 at no fixed
phase of the step, which no extrapolation removes; the difference holds it, but may be small by chance. So the error is
at least a `GAIN`-th of that of the last run, |b − c|/(2^p − 1). Runs that do not converge are not extrapolated: their
error is not known, and counts as infinite.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import ceil, inf, isclose, sqrt

import numpy as np

from granular_lmp.accuracy.halving import Plan
from granular_lmp.accuracy.richardson import Judgement, Signals, combined, weights_of
from granular_lmp.errors import SceneError
from granular_lmp.impact.problem import ImpactProblem
from granular_lmp.impact.record import ImpactRecord

# The difference was at least 0.5 of the true error in 48 answers of a compressed chain whose contacts barely open,
# and 0.97 in 82 of other chains and of sheets (docs/impacts.md)
SAFETY = 3.0
GAIN = 10.0
RUNS = 3  # the fewest that show an order
MOST_STEPS = 10**9
# Steps in the shortest collision of the first run: at a tolerance of 1e-4, and the fewest. The answer of three runs is
# then estimated to err by 2e-5 to 2e-4 after 12 collision times
_STEPS_AT = (48.0, 1e-4)
_FEWEST = 16.0
_SHARE = 0.7  # of the longest step that a rule allows: spheres may come to press each other deeper on their way
_POWER = 2.5  # power of the step in the error of the answer


def plan(problem: ImpactProblem) -> Plan:
    """Return the steps of a scene with a tolerance.

    Raises
    ------
    SceneError
        If they are more than 1e9.
    """
    time = problem.scene.time
    assert time.tolerance is not None
    steps = max(_FEWEST, _STEPS_AT[0] * (_STEPS_AT[1] / time.tolerance) ** (1 / _POWER))
    longest = min(problem.shortest_collision / steps, *(each * _SHARE for each, _ in problem.step_rules))
    found = Plan(max(1, ceil(time.sample / longest)), RUNS)
    if found.steps_per_sample * time.samples > MOST_STEPS:
        raise SceneError(f"time.tolerance = {time.tolerance!r}: would take more than {MOST_STEPS} steps in this scene")
    return found


def planned(problem: ImpactProblem) -> ImpactProblem:
    """Return the problem of the last planned run, with its time step: the problem itself if it has no tolerance."""
    scene = problem.scene
    if scene.time.tolerance is None:
        return problem
    step = scene.time.sample / (plan(problem).per_sample << RUNS - 1)
    return replace(problem, scene=scene.with_values({"time.timestep": step}))


def planned_steps(problem: ImpactProblem) -> int:
    """Return the number of time steps of all planned runs."""
    time = problem.scene.time
    return time.steps if time.tolerance is None else plan(problem).steps_per_sample * time.samples


def judge(runs: Sequence[Signals]) -> tuple[Judgement, int | None]:
    """Return the answer of runs, the estimate of its error, and the order of the error in the step.

    Parameters
    ----------
    runs : sequence of dict
        Signals of each run by name, from the longest step; each has half the step of the one before.

    Returns
    -------
    judgement : Judgement
        Errors are the largest ones: of velocities and spins in the unit v of the impact, of displacements over the
        largest of them; inf where the order is not known.
    order : int or None
        2 or 1, by the last three runs; None if they do not converge.
    """
    p = _order(runs[-RUNS:])
    if p is None:
        return Judgement(weights_of(len(runs), 1), dict.fromkeys(runs[-1], inf)), None
    weights = (0.0,) * (len(runs) - 2) + weights_of(2, p)
    before = (*weights[1:], 0.0)

    def largest(name: str) -> float:
        values = [run[name] for run in runs]
        newer = combined(values, weights)
        apart, of_run = newer - combined(values, before), newer - values[-1]
        error = float(max(SAFETY * np.max(np.abs(apart)), np.max(np.abs(of_run)) / GAIN))
        return error / float(np.max(np.abs(newer))) if name == "displacement" and error else error

    return Judgement(weights, {name: largest(name) for name in runs[-1]}), p


def _order(runs: Sequence[Signals]) -> int | None:
    if len(runs) < RUNS:
        return None
    moving = [name for name in runs[-1] if name != "displacement"]
    first, second = (sqrt(sum(float(np.sum((b[name] - a[name]) ** 2)) for name in moving)) for a, b in pairwise(runs))
    if second == 0 or first >= 2**1.5 * second:
        return 2
    return 1 if first >= 2**0.5 * second else None


def order(runs: Sequence[ImpactRecord]) -> int | None:
    """Return the order of the error in the step, by the last three runs: 2, 1, or None if they do not converge.

    Raises ValueError if a run has not half the step of the one before.
    """
    return judge(_signals(runs))[1]


def estimate(runs: Sequence[ImpactRecord]) -> dict[str, float]:
    """Return the largest errors of what the runs recorded, of the answer; see `judge`."""
    return judge(_signals(runs))[0].errors


def answer(runs: Sequence[ImpactRecord]) -> ImpactRecord:
    """Return the extrapolation of runs."""
    weights = judge(_signals(runs))[0].weights
    displacement, velocity, spin = (
        combined([getattr(run, name) for run in runs], weights) for name in ("displacement", "velocity", "spin")
    )
    return replace(runs[-1], displacement=displacement, velocity=velocity, spin=spin)


def _signals(runs: Sequence[ImpactRecord]) -> list[Signals]:
    steps = [each.scene.time.step for each in runs]
    if not all(isclose(longer, 2 * shorter, rel_tol=1e-9) for longer, shorter in pairwise(steps)):
        raise ValueError(f"the steps {steps} must each be half of the one before")
    names = ("velocity", *(["spin"] if runs[-1].problem.on["rotation"] else []), "displacement")
    return [{name: getattr(run, name) for name in names} for run in runs]
