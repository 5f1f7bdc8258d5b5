"""DOP853 of Hairer, Nørsett and Wanner for arrays, real or complex, without BLAS.

The method, its step control and its interpolation are those of `scipy.integrate.solve_ivp`, with SciPy's coefficients.
SciPy sums the stages by BLAS, which may hand states of a few hundred complex numbers to all its threads: on a busy
machine of four cores `analysis.compare` of one run then took 41 s of processor time, and 1.5 s with one thread.
"""

import json
from collections.abc import Callable
from functools import cache
from math import hypot, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]  # floats or complex numbers
Derivative = Callable[[Array], Array]

SAFETY, LEAST, MOST = 0.9, 0.2, 10.0  # the change from one step to the next, as in SciPy


class Tableau(NamedTuple):
    """Coefficients of the method: of its 12 stages, its result and 3 more for its interpolation, a row each; then those
    of its errors, and of its interpolation."""

    stages: Array
    errors: Array
    dense: Array


STAGES, ROWS = 12, 16  # A step has 12 stages, and 16 with its result and interpolation


@cache
def tableau() -> Tableau:
    """Return the coefficients, those of SciPy, whose import would take longer than many a motion."""
    table = json.loads(Path(__file__).with_name("dop853.json").read_text(encoding="utf-8"))
    return Tableau(**{name: np.array(rows) for name, rows in table.items()})


class Step:
    """A state and the slopes of its step, one array, so that a stage is one sum over the rows before it."""

    def __init__(self, derivative: Derivative, start: Array) -> None:
        self.derivative = derivative
        self.stack = np.empty((1 + ROWS, *start.shape), dtype=start.dtype)
        self.numbers = _real(self.stack)
        self.trial, self.after = np.empty((2, *start.shape), dtype=start.dtype)
        self.stack[0], self.stack[1] = start, derivative(start)
        self.begin, self.slopes = self.stack[0], self.stack[1:]

    def stages(self, first: int, last: int, length: float) -> None:
        """Fill the slopes from the first to the last of a step; `trial` is left where the last was taken."""
        weights = np.empty((ROWS, 1 + ROWS))
        weights[:, 0], weights[:, 1:] = 1.0, length * tableau().stages
        place = _real(self.trial[None])[0]
        for row in range(first, last + 1):
            np.einsum("i,ij->j", weights[row, : row + 1], self.numbers[: row + 1], out=place)
            self.stack[row + 1] = self.derivative(self.trial)

    def try_out(self, length: float) -> None:
        """Make the step: its slopes, and the state `after` it."""
        self.stages(1, STAGES, length)
        self.after[...] = self.trial

    def error(self, rtol: float, atol: float) -> float:
        """Return the error per unit of τ over the tolerance, from the embedded formulas of orders 5 and 3."""
        scale = atol + rtol * np.maximum(np.abs(self.begin), np.abs(self.after))
        fifth, third = map(_norm, _sum(tableau().errors, self.slopes) / scale)
        both = hypot(fifth, 0.1 * third)
        return fifth**2 / both if both else 0.0

    def between(self, length: float, places: NDArray[np.float64]) -> Array:
        """Return the states at the places x in (0, 1] of the step, by the interpolation of order 7."""
        self.stages(STAGES + 1, ROWS - 1, length)
        rise, first, last = self.after - self.begin, length * self.slopes[0], length * self.slopes[STAGES]
        terms = np.stack([rise, first - rise, 2 * rise - first - last, *length * _sum(tableau().dense, self.slopes)])
        # x, x(1−x), x²(1−x), …
        factors = np.stack([places, 1 - places] * len(terms), axis=-1)[:, : len(terms)]
        return self.begin + _sum(np.cumprod(factors, axis=-1), terms)

    def advance(self) -> None:
        """Begin the next step where this one ended."""
        self.stack[0], self.stack[1] = self.after, self.slopes[STAGES]


def dop853(
    derivative: Derivative,
    start: Array,
    tau: NDArray[np.float64],
    rtol: float,
    atol: float,
    longest: float,
) -> Array:
    """Return the states (T, …) of y' = derivative(y), y(0) = start, at the ascending times tau ≥ 0.

    Parameters
    ----------
    derivative : of a state, an array like `start`, which it neither keeps nor changes.
    rtol, atol : error per step, the root mean square over the numbers of a state.
    longest : largest step.

    Raises RuntimeError when the step has fallen to rounding, or a state is not finite.
    """
    result = np.empty((len(tau), *start.shape), dtype=start.dtype)
    done = int(np.searchsorted(tau, 0.0, side="right"))
    result[:done] = start
    if done == len(tau):
        return result
    time, now = 0.0, Step(derivative, start)
    step = min(_first_step(derivative, now.begin, now.slopes[0], rtol, atol), longest)
    rejected = False
    while done < len(tau):
        step = min(step, longest, tau[-1] - time)
        if not step > 10 * np.spacing(time):
            raise RuntimeError(f"the step has fallen to {step:.1e} at tau = {time:.6g}: the state is not smooth there")
        now.try_out(step)
        error = step * now.error(rtol, atol)
        if not error < 1:
            rejected, step = True, step * max(LEAST, SAFETY * error ** (-1 / 8))
            continue
        end = time + step if step < tau[-1] - time else float(tau[-1])
        upto = int(np.searchsorted(tau, end, side="right"))
        if upto > done:
            result[done:upto] = now.between(step, (tau[done:upto] - time) / step)
        now.advance()
        growth = SAFETY * error ** (-1 / 8) if error > 0 else MOST
        step *= min(1.0 if rejected else MOST, growth)
        time, done, rejected = end, upto, False
    return result


def _real(values: Array) -> NDArray[np.float64]:
    """Return the numbers of each row, (S, …) to (S, n) of the same memory; a complex number is two."""
    return values.reshape(len(values), -1).view(np.float64)


def _sum(weights: Array, slopes: Array) -> Array:
    """Return Σ_i weights_i slopes_i, for each row of weights (R, S)."""
    total: Array = np.einsum("ki,ij->kj", weights, _real(slopes[: weights.shape[-1]]))
    return total.view(slopes.dtype).reshape(len(weights), *slopes.shape[1:])


def _norm(values: Array) -> float:
    numbers = values.reshape(-1).view(np.float64)
    return sqrt(np.einsum("i,i", numbers, numbers) / values.size)


def _first_step(derivative: Derivative, y: Array, slope: Array, rtol: float, atol: float) -> float:
    """Return the first step: Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, section II.4."""
    scale = atol + rtol * np.abs(y)
    size, speed = _norm(y / scale), _norm(slope / scale)
    guess = 1e-6 if min(size, speed) < 1e-5 else 0.01 * size / speed
    turning = _norm((derivative(y + guess * slope) - slope) / scale) / guess
    fastest = max(speed, turning)
    return min(100 * guess, max(1e-6, guess * 1e-3) if fastest <= 1e-15 else (0.01 / fastest) ** (1 / 8))
