"""Runs without a wave to a tolerance: the first step, and the estimate of the error.

The estimated error is at most ``time.tolerance``: for velocities and R times spins over the unit v of the impact
(`granular_lmp.crystal.scale`: the velocity of the fastest striker), for all else over the largest value of its kind.
The error is of order 2 in the step without sliding, and of order 1 with damping, or with friction and the law
"incremental", whose forces LAMMPS takes at half steps. Answer and estimate are as for waves
(`granular_lmp.accuracy.extrapolation`), with the largest error in place of the L2 norm. Contacts that close and open
within a step leave an error of order 5/2 at random phases of the step, which extrapolation cannot remove; `SAFETY` is
therefore larger.

In a crystal at rest under load the collision is half a period of the fastest wave, the order is that of the effects
(`granular_lmp.effects.selection.order`), and an error is one over the largest value of its kind that a run recorded:
of all velocities and spins, of all displacements, of all forces.
"""

from collections.abc import Sequence
from math import ceil

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy import extrapolation
from granular_lmp.accuracy.extrapolation import Judgement, Signals
from granular_lmp.problem import Problem
from granular_lmp.runs.components import FORCES, RATES
from granular_lmp.scene.monitor_kinds import OF_ROWS

SAFETY = 4.0  # with 3, two of 130 ladders in 35 scenes ended with up to 1.3 times the tolerance (tests/hard)
# Steps in the shortest collision of the first run: at a tolerance of 1e-4, and at least
_STEPS_AT = (24.0, 1e-4)
_FEWEST = 11.0
_POWER = 2.5  # power of the step in the error of the answer
_RATES = {"velocity", "spin", *RATES}


def first_count(problem: Problem, tolerance: float) -> int:
    """Return the steps per sample of the first run of the ladder that should meet a tolerance."""
    steps = max(_FEWEST, _STEPS_AT[0] * (_STEPS_AT[1] / tolerance) ** (1 / _POWER))
    longest = min(problem.rest.shortest_collision / steps, *(rule.first for rule in problem.rest.step_rules()))
    return max(1, ceil(problem.scene.time.sample / longest))


def judge(runs: Sequence[Signals], counts: Sequence[int], order: int, *, of_impact: bool = True) -> Judgement:
    """Return the answer of runs and the estimate of its error.

    Parameters
    ----------
    runs : sequence of dict
        Signals of each run by name, in the order in which they were made.
    counts : sequence of int
        Steps per sample of each run.
    order : int
        Order of the error in the step.
    of_impact : bool
        True if velocities are in v of an impact (`granular_lmp.crystal.scale.Scale.of_impact`).

    Returns
    -------
    Judgement
        Largest errors: of velocities and spins in the unit v of the impact, of all else over the largest value of the
        signal.
    """
    units = _units(runs[-1], of_impact=of_impact)
    scaled = [{name: values / units.get(name, 1.0) for name, values in run.items()} for run in runs]
    hidden = dict.fromkeys(runs[-1], 0.0)  # the hidden error of the slip is below 1e-6 of the velocities
    return extrapolation.judge(scaled, counts, order, hidden=hidden, norm=_largest, relative=False, safety=SAFETY)


def _units(signals: Signals, *, of_impact: bool) -> dict[str, float]:
    """Return the unit of the error of each signal, if it is not 1."""
    largest = {name: _largest(values) for name, values in signals.items()}
    if of_impact:
        return {name: each or 1.0 for name, each in largest.items() if _kind(name) != "rate"}
    of_kind: dict[str, float] = {}
    for name, each in largest.items():
        of_kind[_kind(name)] = max(each, of_kind.get(_kind(name), 0.0))
    return {name: of_kind[_kind(name)] or 1.0 for name in largest}


def _kind(name: str) -> str:
    """Return the kind of a signal: "rate", "force", "motion", or the name of a signal of rows."""
    last = name.rpartition(".")[2]
    return "rate" if last in _RATES else "force" if last in FORCES else last if last in OF_ROWS else "motion"


def _largest(values: NDArray[np.float64]) -> float:
    return float(np.max(np.abs(values), initial=0.0))
