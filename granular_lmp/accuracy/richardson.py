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
from dataclasses import replace
from math import inf, isclose

import numpy as np

from granular_lmp.accuracy.halving import extrapolated
from granular_lmp.accuracy.rounding import judged
from granular_lmp.effects.selection import order
from granular_lmp.runs.record import Record

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

    A single run is returned as it is; of more runs the last three are used.
    """
    if len(runs) == 1:
        return runs[0]
    exponent = order(runs[-1].scene)
    newer = richardson(runs[-2], runs[-1], exponent)
    if len(runs) == 2 or exponent == 1:
        return newer
    return richardson(richardson(runs[-3], runs[-2]), newer, order=4)


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
    newer = answer(runs)
    names = judged(newer.scene, newer.signals)
    if len(runs) == 1:
        return dict.fromkeys(names, inf)
    older = answer(runs[:-1])

    def distance(name: str) -> float:
        values = newer.signals[name]
        return float(np.linalg.norm(older.signals[name] - values) / np.linalg.norm(values))

    return {name: SAFETY * distance(name) for name in names}
