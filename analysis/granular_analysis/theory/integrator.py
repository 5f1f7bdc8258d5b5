"""SciPy's DOP853 of Hairer, Nørsett and Wanner, for real or complex states of any shape, with output at given times.

SciPy sums the stages by BLAS, which may spread a state of a few hundred complex numbers over all its threads. That is
slow on a busy machine, so the scripts of this package use one thread (`granular_lmp.cli.entry`).
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]  # floats or complex numbers
Floats = NDArray[np.float64]
Derivative = Callable[[Array], Array]
Slope = Callable[[float, Array], Array]


def dop853(derivative: Derivative, start: Array, tau: Floats, rtol: float, atol: float, longest: float) -> Array:
    """Return the states (T, …) of y' = derivative(y), y(0) = start, at the ascending times tau ≥ 0.

    Parameters
    ----------
    derivative : state → its time derivative, a new array of the shape of `start`.
    tau : (T,) times.
    rtol, atol : relative and absolute error per step, root mean square over the numbers of a state.
    longest : largest step.

    Raises RuntimeError if the step shrinks to the rounding of τ, or if a state is not finite.
    """
    result = np.empty((len(tau), start.size), dtype=start.dtype)
    done = int(np.searchsorted(tau, 0.0, side="right"))
    result[:done] = start.ravel()
    if done < len(tau):
        end = float(tau[-1])
        solver = solver_of(of_state(derivative, start), 0.0, start.ravel(), end, rtol=rtol, atol=atol, max_step=longest)
    while done < len(tau):
        step(solver)
        upto = int(np.searchsorted(tau, solver.t, side="right"))
        if upto > done:
            result[done:upto] = between(solver, tau[done:upto])
        done = upto
    return result.reshape(len(tau), *start.shape)


def of_state(derivative: Derivative, start: Array) -> Slope:
    """Return the slope y'(t, y) of packed states y (n,), for a derivative of states of the shape of `start`."""
    return lambda _, numbers: derivative(numbers.reshape(start.shape)).ravel()


def solver_of(slope: Slope, time: float, start: Array, end: float, **options: Any) -> Any:
    """Return SciPy's solver of y' = slope(t, y), for y (n,) from `time` to `end`; advance it by `step`."""
    from scipy.integrate import DOP853  # slow to import, and only motions need it

    return DOP853(slope, time, start, end, **options)


def step(solver: Any) -> None:
    """Make one step of a solver; raise RuntimeError if the step shrinks to rounding or a state is not finite."""
    solver.step()
    if solver.status == "failed":
        raise RuntimeError(
            f"the step has fallen to {solver.h_abs:.1e} at tau = {solver.t:.6g}: the state is not smooth there"
        )


def between(solver: Any, times: Floats) -> Array:
    """Return the states (T, n) at times of the last step of a solver."""
    return np.asarray(solver.dense_output()(times).T)
