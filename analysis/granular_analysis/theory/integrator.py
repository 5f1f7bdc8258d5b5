"""DOP853 of Hairer, Nørsett and Wanner, by SciPy, for arrays of any shape, real or complex, at the times asked for.

SciPy sums the stages by BLAS, which may hand states of a few hundred complex numbers to all its threads: on a busy
machine the scripts of this package take one (`granular_analysis`).
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

Array = NDArray[Any]  # floats or complex numbers
Floats = NDArray[np.float64]
Derivative = Callable[[Array], Array]


class Solver(DOP853):
    """Steps from a time and a state (n,) to an end, as long as their error allows; attributes as of SciPy."""

    def step(self) -> None:
        """Make one step; RuntimeError when it has fallen to rounding, or a state is not finite."""
        super().step()
        if self.status == "failed":
            raise RuntimeError(
                f"the step has fallen to {self.h_abs:.1e} at tau = {self.t:.6g}: the state is not smooth there"
            )

    def between(self, times: Floats) -> Array:
        """Return the states (T, n) at times of the last step."""
        return np.asarray(self.dense_output()(times).T)


def dop853(derivative: Derivative, start: Array, tau: Floats, rtol: float, atol: float, longest: float) -> Array:
    """Return the states (T, …) of y' = derivative(y), y(0) = start, at the ascending times tau ≥ 0.

    Parameters
    ----------
    derivative : of a state, a new array like `start`.
    rtol, atol : error per step, the root mean square over the numbers of a state.
    longest : largest step.

    Raises RuntimeError when the step has fallen to rounding, or a state is not finite.
    """
    result = np.empty((len(tau), start.size), dtype=start.dtype)
    done = int(np.searchsorted(tau, 0.0, side="right"))
    result[:done] = start.ravel()
    if done < len(tau):
        solver = solver_of(derivative, start, float(tau[-1]), rtol, atol, longest)
    while done < len(tau):
        solver.step()
        upto = int(np.searchsorted(tau, solver.t, side="right"))
        if upto > done:
            result[done:upto] = solver.between(tau[done:upto])
        done = upto
    return result.reshape(len(tau), *start.shape)


def solver_of(derivative: Derivative, start: Array, end: float, rtol: float, atol: float, longest: float) -> Solver:
    """Return what makes the steps of `dop853`, one by one."""

    def slope(_: float, numbers: Array) -> Array:
        return derivative(numbers.reshape(start.shape)).ravel()

    return Solver(slope, 0.0, start.ravel(), end, rtol=rtol, atol=atol, max_step=longest)
