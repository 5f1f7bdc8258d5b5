"""An impact to a tolerance: which step is tried first, and the estimate of the error of its runs.

The error of every velocity and of R times every spin, over the unit v of the impact (`ImpactScene.scale`: the velocity
of the fastest striker), and that of every displacement over the largest, is at most ``time.tolerance``, as estimated.
The error of a run is of order 2 in the step for spheres that slide on nothing, and of order 1 with damping or with
friction and the law "incremental", whose forces LAMMPS takes at half steps. Answer and estimate are those of waves
(`granular_lmp.accuracy.extrapolation`), with the largest error in place of the L2 norm. Contacts that close and open
inside a step leave an error of order 5/2 at no fixed phase of the step, which no extrapolation removes; `SAFETY` is
larger for that.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import ceil

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy import extrapolation
from granular_lmp.accuracy.extrapolation import Judgement, Signals, combined
from granular_lmp.accuracy.halving import Plan
from granular_lmp.errors import SceneError
from granular_lmp.impact.problem import ImpactProblem
from granular_lmp.impact.record import ImpactRecord
from granular_lmp.impact.scene import ImpactScene

Floats = NDArray[np.float64]

SAFETY = 4.0  # with 3, two in 130 ladders of 35 scenes ended with up to 1.3 of the tolerance (tests/hard)
RUNS = 3  # runs that are planned
MOST_STEPS = 10**9
# Steps in the shortest collision of the first run: at a tolerance of 1e-4, and the fewest
_STEPS_AT = (24.0, 1e-4)
_FEWEST = 11.0
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
    longest = min(problem.shortest_collision / steps, *(rule.first for rule in problem.step_rules))
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
    return problem.stepped(scene.with_values({"time.timestep": step}))


def planned_steps(problem: ImpactProblem) -> int:
    """Return the number of time steps of all planned runs."""
    time = problem.scene.time
    return time.steps if time.tolerance is None else plan(problem).steps_per_sample * time.samples


def order(scene: ImpactScene) -> int:
    """Return the order of the error in the step: 1 where LAMMPS has forces of half a step before, else 2."""
    effects = scene.effects
    halfway = effects.restitution < 1 or (float(effects.friction) > 0 and effects.shear_law == "incremental")
    return 1 if halfway else 2


def judge(runs: Sequence[Signals], counts: Sequence[int], order: int) -> Judgement:
    """Return the answer of runs and the estimate of its error.

    Parameters
    ----------
    runs : sequence of dict
        Signals of each run by name, in the order in which they were made.
    counts : sequence of int
        Steps per sample of each run.
    order : int
        Order of the error in the step.

    Returns
    -------
    Judgement
        Errors are the largest ones: of velocities and spins in the unit v of the impact, of displacements over the
        largest of them.
    """
    units = {name: _largest(values) or 1.0 for name, values in runs[-1].items() if name == "displacement"}
    scaled = [{name: values / units.get(name, 1.0) for name, values in run.items()} for run in runs]
    hidden = dict.fromkeys(runs[-1], 0.0)  # what the slip hides is below 1e-6 of the velocities
    return extrapolation.judge(scaled, counts, order, hidden=hidden, norm=_largest, relative=False, safety=SAFETY)


def signals(record: ImpactRecord) -> Signals:
    """Return what a run has recorded, by name."""
    names = ("velocity", *(["spin"] if record.problem.on["rotation"] else []), "displacement")
    return {name: getattr(record, name) for name in names}


def estimate(runs: Sequence[ImpactRecord]) -> Judgement:
    """Return the answer of runs and the largest errors of what they recorded; see `judge`."""
    scenes = [run.scene for run in runs]
    return judge([*map(signals, runs)], [scene.time.steps_per_sample for scene in scenes], order(scenes[-1]))


def answer(runs: Sequence[ImpactRecord]) -> ImpactRecord:
    """Return the extrapolation of runs."""
    weights = estimate(runs).weights
    displacement, velocity, spin = (
        combined([getattr(run, name) for run in runs], weights) for name in ("displacement", "velocity", "spin")
    )
    return replace(runs[-1], displacement=displacement, velocity=velocity, spin=spin)


def _largest(values: Floats) -> float:
    return float(np.max(np.abs(values), initial=0.0))
