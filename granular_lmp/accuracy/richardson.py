"""Richardson extrapolation of runs that differ only in the time step, and the estimate of its error.

Velocity Verlet's error is C h² + D h⁴ + … in the step h. Of two runs with the steps h and h/2 the combination
R = (4·fine − coarse)/3 is free of the first term (Richardson extrapolation), and of two such R = (16·fine − coarse)/15
is free of the second. Some effects make the error one of first order (`granular_lmp.effects.selection.order`); then the
answer is 2·fine − coarse of the last two runs, because the next order is unknown.

The error of the answer is estimated by its distance to the answer without the last run, times `SAFETY`. The estimate
bounds errors of any order in h. It includes a first-order error that lies below the error of second order until the
extrapolation removes that: LAMMPS leaves one of the order of h Δ0/R, because it rotates the slip of a contact with the
contact's direction at the end of the step. It also covers waves that the coarse steps do not resolve, whose error has
no order.

The rounding of positions limits the accuracy at any time step: `granular_lmp.accuracy.rounding`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isclose

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy.halving import extrapolated
from granular_lmp.accuracy.rounding import judged
from granular_lmp.effects.selection import order
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
Signals = dict[str, Floats]

# The distance was at least 0.35 of the true error in 885 cases: 180 waves at tolerances from 1e-1 to 1e-5 with errors
# above 3e-6 (docs/accuracy.md)
SAFETY = 1.5


def richardson(coarse: Record, fine: Record, order: int = 2) -> Record:
    """Return the extrapolated record of two runs of one scene, the second with half the step of the first.

    Parameters
    ----------
    coarse, fine : Record
        Records at the same times.
    order : int
        Order of the error in the step: 2, or 1 with some effects (`effects.selection.order`); 4 for two records that
        are extrapolated themselves.

    Returns
    -------
    Record
        Extrapolated record with the scene of the finer run. ``info["error_estimate"]`` holds the relative L2 errors of
        p, q and phi of the finer run, None for a signal that is zero; the extrapolated record is better.

    Raises
    ------
    ValueError
        If the records have different times, or the ratio of their steps is not 2.

    Notes
    -----
    The extrapolation breaks down if the error is not of this order in the step, as with contacts that open or slide,
    and below the rounding of the positions.
    """
    if coarse.tau.shape != fine.tau.shape or not np.allclose(coarse.tau, fine.tau, rtol=1e-12, atol=0):
        raise ValueError("the two records have different times")
    ratio = coarse.scene.time.step / fine.scene.time.step
    if not isclose(ratio, 2, rel_tol=1e-9):
        raise ValueError(f"the steps {coarse.scene.time.step!r} and {fine.scene.time.step!r} must have the ratio 2")
    signals, estimates = {}, {}
    for name in ("p", "q", "phi"):
        a, b = getattr(coarse, name), getattr(fine, name)
        signals[name] = extrapolated(a, b, order)
        norm = np.linalg.norm(signals[name])
        estimates[name] = float(np.linalg.norm(b - a) / (2**order - 1) / norm) if norm > 0 else None
    return replace(fine, **signals, info=fine.info | {"error_estimate": estimates}, folder=None)


def answer(runs: Sequence[Record]) -> Record:
    """Return the best extrapolation of runs of one scene, each with half the step of the one before.

    A single run is returned as it is.
    """
    if len(runs) == 1:
        return runs[0]
    return combined_record(runs, judge([run.signals for run in runs], order(runs[-1].scene)))


def combined_record(runs: Sequence[Record], judgement: "Judgement") -> Record:
    """Return the answer that a judgement makes of runs."""
    weights = judgement.weights
    signals = {name: combined([run.signals[name] for run in runs], weights) for name in runs[-1].signals}
    return replace(runs[-1], p=signals["p"], q=signals["q"], phi=signals["phi"], folder=None)


def estimate(runs: Sequence[Record]) -> dict[str, float]:
    """Return the relative L2 errors of p, q, φ that the `answer` is estimated to have.

    Parameters
    ----------
    runs : sequence of Record
        Runs of one scene, each with half the step of the one before.

    Returns
    -------
    dict
        Errors by signal, without signals that vanish by symmetry; inf if there is only one run.
    """
    names = judged(runs[-1].scene, answer(runs).signals)
    errors = judge([run.signals for run in runs], order(runs[-1].scene)).errors
    return {name: errors[name] for name in names}


# --- the answer and the estimate, of any signals ---------------------------------------------------------------------


@dataclass(frozen=True)
class Judgement:
    """What the runs of a ladder say together.

    Attributes
    ----------
    weights : tuple of float
        Weight of each run, from the longest step, in the answer: a sum of runs, whose weights sum to 1.
    errors : dict of str to float
        Estimated relative L2 error of each signal of the answer; inf if it is not known, nan if the signal is.
    """

    weights: tuple[float, ...]
    errors: dict[str, float]


def judge(runs: Sequence[Signals], order: int) -> Judgement:
    """Return the answer of runs and the estimate of its error: the one place where both are decided.

    Parameters
    ----------
    runs : sequence of dict
        Signals by name, arrays whose first axis is time, of each run, from the longest step; each has half the step of
        the one before.
    order : int
        Order of the error in the step: 2, or 1 with some effects (`effects.selection.order`).
    """
    weights = weights_of(len(runs), order)
    if len(runs) == 1:
        return Judgement(weights, dict.fromkeys(runs[0], inf))
    before = (*weights_of(len(runs) - 1, order), 0.0)
    errors = {}
    for name in runs[-1]:
        values = [run[name] for run in runs]
        newer = combined(values, weights)
        size = float(np.linalg.norm(newer))
        apart = float(np.linalg.norm(combined(values, before) - newer))
        errors[name] = SAFETY * apart / size if size else 0.0
    return Judgement(weights, errors)


def weights_of(runs: int, order: int) -> tuple[float, ...]:
    """Return the weight of each run in the answer: of the last three runs, or two if the order is 1, count."""
    if runs == 1:
        return (1.0,)
    if order == 1 or runs == 2:
        used: tuple[float, ...] = (-1 / (2**order - 1), 2**order / (2**order - 1))
    else:  # (16 (4c − b)/3 − (4b − a)/3)/15
        used = (1 / 45, -20 / 45, 64 / 45)
    return (0.0,) * (runs - len(used)) + used


def combined(values: Sequence[Floats] | Floats, weights: Sequence[float]) -> Floats:
    """Return the sum of arrays of runs with their weights."""
    return np.asarray(sum(weight * each for weight, each in zip(weights, values, strict=True) if weight))
