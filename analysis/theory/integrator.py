"""DOP853 of Hairer, Nørsett and Wanner for arrays, real or complex, without BLAS.

The method, its step control and its interpolation are those of `scipy.integrate.solve_ivp`, with SciPy's coefficients.
SciPy sums the stages by BLAS, which may hand states of a few hundred complex numbers to all its threads: on a busy
machine of four cores `analysis.compare` of one run then took 41 s of processor time, and 1.5 s with one thread.
"""

from collections.abc import Callable
from functools import cache
from math import hypot, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]  # floats or complex numbers
Derivative = Callable[[Array], Array]

SAFETY, LEAST, MOST = 0.9, 0.2, 10.0  # the change from one step to the next, as in SciPy


class Tableau(NamedTuple):
    """Coefficients of the method: of its 12 stages, its result, its errors, and its interpolation."""

    stages: Array
    result: Array
    errors: Array
    extra: Array
    dense: Array


@cache
def tableau() -> Tableau:
    """Return SciPy's coefficients."""
    from scipy.integrate import DOP853  # slow to import, and only motions need it

    return Tableau(DOP853.A, DOP853.B, np.stack([DOP853.E5, DOP853.E3]), DOP853.A_EXTRA, DOP853.D)


def dop853(
    derivative: Callable[[Array], Array],
    start: Array,
    tau: NDArray[np.float64],
    rtol: float,
    atol: float,
    longest: float,
) -> Array:
    """Return the states (T, …) of y' = derivative(y), y(0) = start, at the ascending times tau ≥ 0.

    Parameters
    ----------
    derivative : of a state, an array like `start`.
    rtol, atol : error per step, the root mean square over the numbers of a state.
    longest : largest step.

    Raises RuntimeError when the step has fallen to rounding, or a state is not finite.
    """
    result = np.empty((len(tau), *start.shape), dtype=start.dtype)
    done = int(np.searchsorted(tau, 0.0, side="right"))
    result[:done] = start
    if done == len(tau):
        return result
    table = tableau()
    count = len(table.stages)
    slopes = np.empty((count + 1 + len(table.extra), *start.shape), dtype=start.dtype)
    time, y, slopes[0] = 0.0, start, derivative(start)
    step = min(_first_step(derivative, y, slopes[0], rtol, atol), longest)
    rejected = False
    while done < len(tau):
        step = min(step, longest, tau[-1] - time)
        if not step > 10 * np.spacing(time):
            raise RuntimeError(f"the step has fallen to {step:.1e} at tau = {time:.6g}: the state is not smooth there")
        for stage in range(1, count):
            slopes[stage] = derivative(y + step * _sum(table.stages[stage, :stage], slopes))
        after = y + step * _sum(table.result, slopes)
        slopes[count] = derivative(after)
        error = step * _error(slopes, atol + rtol * np.maximum(np.abs(y), np.abs(after)))
        if not error < 1:
            rejected, step = True, step * max(LEAST, SAFETY * error ** (-1 / 8))
            continue
        end = time + step if step < tau[-1] - time else float(tau[-1])
        upto = int(np.searchsorted(tau, end, side="right"))
        if upto > done:
            result[done:upto] = _between(derivative, y, after, slopes, step, (tau[done:upto] - time) / step)
        growth = SAFETY * error ** (-1 / 8) if error > 0 else MOST
        step *= min(1.0 if rejected else MOST, growth)
        time, y, slopes[0], done, rejected = end, after, slopes[count], upto, False
    return result


def _sum(weights: Array, slopes: Array) -> Array:
    """Return Σ_i weights_i slopes_i, for each row of weights (…, S)."""
    stages = weights.shape[-1]
    numbers = slopes[:stages].reshape(stages, -1).view(np.float64)  # a complex number is two
    total: Array = np.einsum("...i,ij->...j", weights, numbers)
    return total.view(slopes.dtype).reshape(weights.shape[:-1] + slopes.shape[1:])


def _norm(values: Array) -> float:
    numbers = values.reshape(-1).view(np.float64)
    return sqrt(np.einsum("i,i", numbers, numbers) / values.size)


def _error(slopes: Array, scale: Array) -> float:
    """Return the error per unit of τ over the tolerance, from the embedded formulas of orders 5 and 3."""
    fifth, third = map(_norm, _sum(tableau().errors, slopes) / scale)
    both = hypot(fifth, 0.1 * third)
    return fifth**2 / both if both else 0.0


def _first_step(derivative: Derivative, y: Array, slope: Array, rtol: float, atol: float) -> float:
    """Return the first step: Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, section II.4."""
    scale = atol + rtol * np.abs(y)
    size, speed = _norm(y / scale), _norm(slope / scale)
    guess = 1e-6 if min(size, speed) < 1e-5 else 0.01 * size / speed
    turning = _norm((derivative(y + guess * slope) - slope) / scale) / guess
    fastest = max(speed, turning)
    return min(100 * guess, max(1e-6, guess * 1e-3) if fastest <= 1e-15 else (0.01 / fastest) ** (1 / 8))


def _between(
    derivative: Callable[[Array], Array],
    y: Array,
    after: Array,
    slopes: Array,
    step: float,
    places: NDArray[np.float64],
) -> Array:
    """Return the states at the places x in (0, 1] of a step, by the interpolation of order 7."""
    table = tableau()
    count = len(table.stages)
    for row, weights in enumerate(table.extra, count + 1):
        slopes[row] = derivative(y + step * _sum(weights[:row], slopes))
    rise, first, last = after - y, step * slopes[0], step * slopes[count]
    terms = np.stack([rise, first - rise, 2 * rise - first - last, *step * _sum(table.dense, slopes)])
    # x, x(1−x), x²(1−x), …
    factors = np.stack([places, 1 - places] * len(terms), axis=-1)[:, : len(terms)]
    return y + _sum(np.cumprod(factors, axis=-1), terms)
