"""Two runs that differ in the time step alone: a better answer, and the error of the finer one.

Velocity Verlet's error is C Δτ² + O(Δτ⁴). Of two runs with steps Δτ and Δτ/2 the combination (4·fine − coarse)/3 is
free of the first term, and |fine − coarse|/3 is what is left in the finer run (Richardson extrapolation). Where the
error is of first order, 2·fine − coarse is.

Below all that lies the rounding of positions, which no time step cures: `granular_lmp.accuracy.rounding`.
"""

from dataclasses import replace
from math import isclose

import numpy as np

from granular_lmp.runs.record import Record
from granular_lmp.scene.scene import Scene


def halved_step(scene: Scene) -> Scene:
    """The same scene with half the time step that it uses: the second run of a Richardson pair."""
    return scene.with_values({"time.timestep": scene.time.step / 2})


def richardson(coarse: Record, fine: Record, order: int = 2) -> Record:
    """The extrapolated record of two runs of one scene, the second with half the step of the first.

    Parameters
    ----------
    coarse, fine : Record
    order : int
        Of the error in the step: 2, or 1 for the effects that spoil it (`granular_lmp.effects.table.order`).

    Returns
    -------
    Record
        With the scene of the finer run; ``info["error_estimate"]`` is the relative L2 error of its p, q and phi that
        the pair estimates (None where a component is zero). The extrapolated record itself is better than that.

    Raises
    ------
    ValueError
        When the records have other times, or steps whose ratio is not 2.

    Notes
    -----
    Breaks where the error is not of that order in the step (contacts that open or slide have none for sure) and below
    the rounding of the positions.
    """
    if coarse.tau.shape != fine.tau.shape or not np.allclose(coarse.tau, fine.tau, rtol=1e-12, atol=0):
        raise ValueError("the two records have different times")
    ratio = coarse.scene.time.step / fine.scene.time.step
    if not isclose(ratio, 2, rel_tol=1e-9):
        raise ValueError(f"the steps {coarse.scene.time.step!r} and {fine.scene.time.step!r} must have the ratio 2")
    signals, estimates = {}, {}
    for name in ("p", "q", "phi"):
        a, b = getattr(coarse, name), getattr(fine, name)
        signals[name] = (2**order * b - a) / (2**order - 1)
        norm = np.linalg.norm(signals[name])
        estimates[name] = float(np.linalg.norm(b - a) / (2**order - 1) / norm) if norm > 0 else None
    return replace(fine, **signals, info=fine.info | {"error_estimate": estimates}, folder=None)
