"""DOP853 of Hairer, Nørsett and Wanner for arrays, real or complex, without BLAS.

The method, its step control and its interpolation are those of `scipy.integrate.solve_ivp`, with SciPy's coefficients.
SciPy sums the stages by BLAS, which may hand states of a few hundred complex numbers to all its threads: on a busy
machine of four cores `granular_analysis.tools.compare` of one run then took 41 s of processor time, and 1.5 s with one
thread.

Large states are summed by the loops of `granular_analysis.theory.loops` where these are there.

**Places and speeds.** Where a state begins with places, whose slopes are the speeds behind them, sums of slopes of
places are sums of those of speeds: Σ_i w_i v_i = (Σ_i w_i) v + h Σ_j (w A)_j v'_j, with the coefficients A of the
stages. A slope that is `Fused` makes its steps so, and keeps no slopes of places.
"""

import json
from collections.abc import Callable
from functools import cache
from math import hypot
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory import loops

Array = NDArray[Any]  # floats or complex numbers
Floats = NDArray[np.float64]
Derivative = Callable[[Array], Array]
Plain = Callable[[float, Array, Array], None]  # writes the slope at a time and a state into the last argument

SAFETY, LEAST, MOST = 0.9, 0.2, 10.0  # the change from one step to the next, as in SciPy


class Tableau(NamedTuple):
    """Coefficients of the method: of its 12 stages, its result and 3 more for its interpolation, a row each; then those
    of its errors, and of its interpolation."""

    stages: Array
    errors: Array
    dense: Array

    @property
    def times(self) -> Array:
        """Return when each stage is, in steps."""
        return np.asarray(self.stages.sum(axis=1))


STAGES, ROWS = 12, 16  # A step has 12 stages, and 16 with its result and interpolation


@cache
def tableau() -> Tableau:
    """Return the coefficients, those of SciPy, whose import would take longer than many a motion."""
    table = json.loads(Path(__file__).with_name("dop853.json").read_text(encoding="utf-8"))
    return Tableau(**{name: np.array(rows) for name, rows in table.items()})


@cache
def terms() -> Array:
    """Return the weights (7, 16) of the slopes in the factors of x, x(1−x), x²(1−x), … of the interpolation."""
    table = tableau()
    first, last, rise = np.eye(ROWS)[0], np.eye(ROWS)[STAGES], np.pad(table.stages[STAGES], (0, 1))[:ROWS]
    return np.stack([rise, first - rise, 2 * rise - first - last, *table.dense])


def of_places(weights: Array, length: float) -> Array:
    """Return the weights of speeds and of their slopes, (R, 1 + S), that those of slopes of places (R, S) stand for."""
    count = weights.shape[1]
    rows = length * weights @ tableau().stages[:count, :count]
    return np.concatenate([weights.sum(axis=1, keepdims=True), rows], axis=1)


@runtime_checkable
class Fused(Protocol):
    """A slope that fills the stages of a step by itself, but for the slopes of the places that a state begins with."""

    places: int

    def __call__(self, time: float, state: Array, out: Array) -> None:
        """Write the slope at a time and a state into `out`."""

    def stages(
        self, step: "Step", first: int, last: int, length: float, tolerance: tuple[float, Floats | float] | None
    ) -> tuple[float, float] | None:
        """Fill the slopes of a step as `Step.stages`, and return its errors, 0 without a tolerance; or refuse: None."""


Slope = Plain | loops.Slope | Fused


class Step:
    """A state and the slopes of its step, one array, so that a stage is one sum over the rows before it.

    Attributes
    ----------
    stack : (17, …) where the step begins, and the slopes; `numbers` (17, n) are the same.
    after, trial : where the step ended, and where the last slope was taken.
    ended : whether the step is over, so that `after` and its slope have yet to become the first of the next.
    lean : whether slopes of places are not there, as a `Fused` slope leaves them.
    fused : the slope if it is `Fused`; a protocol is asked for once, as that takes longer than a small stage.
    """

    def __init__(self, slope: Slope, time: float, start: Array) -> None:
        self.slope, self.time = slope, time
        self.fused = slope if isinstance(slope, Fused) else None
        self.stack = np.empty((1 + ROWS, *start.shape), dtype=start.dtype)
        self.numbers = _real(self.stack)
        self.trial, self.after = np.empty_like(start, order="C"), np.empty_like(start, order="C")  # `_real` takes views
        self.begin, self.slopes = self.stack[0], self.stack[1:]
        self.begin[...] = start
        self.ended = self.lean = False
        slope(time, self.begin, self.slopes[0])

    def stages(
        self, first: int, last: int, length: float, tolerance: tuple[float, Floats | float] | None = None
    ) -> tuple[float, float] | None:
        """Fill the slopes from the first to the last of a step; `trial` is left where the last was taken.

        Returns the errors of the step if a tolerance is given and the slope is `Fused`.
        """
        if self.fused:
            errors = self.fused.stages(self, first, last, length, tolerance)
            if errors is not None:
                return errors
        self._begin()
        weights = np.empty((ROWS, 1 + ROWS))
        weights[:, 0], weights[:, 1:] = 1.0, length * tableau().stages
        if self.lean and self.fused:
            slopes, speeds = self.slopes[:, : self.fused.places], self.numbers[:, self.fused.places :]
            for row, slope in enumerate(slopes[:first]):
                loops.weighted(weights[row : row + 1, : row + 1], speeds[:, : len(slope)], slope[None])
            self.lean = False
        if isinstance(self.slope, loops.Slope):
            self.slope.stages(first, last, weights, self.stack, self.trial)
            return None
        times = (self.time + length * tableau().times).tolist()
        place = _real(self.trial[None])
        for row in range(first, last + 1):
            loops.weighted(weights[row : row + 1, : row + 1], self.numbers, place)
            self.slope(times[row], self.trial, self.slopes[row])
        return None

    def try_out(self, length: float, rtol: float, atol: Floats | float) -> float:
        """Make the step: its slopes, and the state `after` it.

        Returns the error per unit of τ over the tolerance, from the embedded formulas of orders 5 and 3.
        """
        errors = self.stages(1, STAGES, length, (rtol, atol))
        self.after, self.trial = self.trial, self.after
        fifth, third = errors or loops.errors(tableau().errors, self.slopes, self.begin, self.after, rtol, atol)
        both = hypot(fifth, 0.1 * third)
        return fifth**2 / both if both else 0.0

    def between(self, length: float, places: Floats) -> Array:
        """Return the states at the places x in (0, 1] of the step, by the interpolation of order 7."""
        self.stages(STAGES + 1, ROWS - 1, length)
        factors = np.empty((len(places), len(terms())))
        factors[:, ::2], factors[:, 1::2] = places[:, None], 1 - places[:, None]
        weights = np.empty((len(places), 1 + ROWS))
        weights[:, 0], weights[:, 1:] = 1.0, length * (np.cumprod(factors, axis=1) @ terms())
        states = np.empty((len(places), *self.begin.shape), dtype=self.begin.dtype)
        cut, numbers = self.fused.places if self.lean and self.fused else 0, _real(states)
        loops.weighted(weights, self.numbers[:, cut:], numbers[:, cut:])
        if cut:
            loops.weighted(of_places(weights[:, 1:], length), self.numbers[:, cut : 2 * cut], numbers[:, :cut])
            numbers[:, :cut] += self.numbers[0, :cut]
        return states

    def advance(self, time: float) -> None:
        """Let the next step begin where this one ended."""
        self.time, self.ended = time, True

    def _begin(self) -> None:
        if self.ended:
            self.begin[...], self.slopes[0], self.ended = self.after, self.slopes[STAGES], False


class Solver:
    """Steps from a time and a state to an end, as long as their error allows.

    Parameters
    ----------
    slope : writes the derivative at a time and a state into an array; it neither keeps nor changes the state.
    rtol, atol : error per step, the root mean square over the numbers of a state; atol may be one for each number.
    longest : largest step.
    first : length of the first step, chosen by the motion if None.

    Attributes
    ----------
    before, time : where the last step began and ended.
    length : of the last step.
    """

    def __init__(
        self,
        slope: Slope,
        time: float,
        start: Array,
        end: float,
        rtol: float,
        atol: Floats | float,
        longest: float,
        first: float | None = None,
    ) -> None:
        self.now = Step(slope, time, start)
        self.before = self.time = time
        self.end, self.rtol, self.atol, self.longest = end, rtol, atol, longest
        self._next = first or _first_step(self.now, end - time, rtol, atol)
        self._made = False

    def step(self) -> None:
        """Make one step; RuntimeError when it has fallen to rounding, or a state is not finite."""
        if self._made:
            self.now.advance(self.time)
        step, rejected, self.before = self._next, False, self.time
        while True:
            step = min(step, self.longest, self.end - self.time)
            if not (step > 10 * np.spacing(self.time) or step == self.end - self.time):
                raise RuntimeError(
                    f"the step has fallen to {step:.1e} at tau = {self.time:.6g}: the state is not smooth there"
                )
            error = step * self.now.try_out(step, self.rtol, self.atol)
            if error < 1:
                break
            rejected, step = True, step * max(LEAST, SAFETY * error ** (-1 / 8))
        growth = SAFETY * error ** (-1 / 8) if error > 0 else MOST
        self.length, self._next, self._made = step, step * min(1.0 if rejected else MOST, growth), True
        self.time = self.time + step if step < self.end - self.time else self.end

    @property
    def state(self) -> Array:
        """Return the state after the last step."""
        return self.now.after

    @property
    def earlier(self) -> Array:
        """Return the state before the last step."""
        return self.now.begin

    def between(self, times: Floats) -> Array:
        """Return the states (T, …) at times of the last step."""
        return self.now.between(self.length, (times - self.before) / self.length)


def dop853(
    derivative: Derivative | loops.Slope, start: Array, tau: Floats, rtol: float, atol: float, longest: float
) -> Array:
    """Return the states (T, …) of y' = derivative(y), y(0) = start, at the ascending times tau ≥ 0.

    Parameters
    ----------
    derivative : of a state, an array like `start`, which it neither keeps nor changes.
    rtol, atol, longest : as of `Solver`.

    Raises RuntimeError when the step has fallen to rounding, or a state is not finite.
    """
    result = np.empty((len(tau), *start.shape), dtype=start.dtype)
    done = int(np.searchsorted(tau, 0.0, side="right"))
    result[:done] = start
    if done == len(tau):
        return result

    solver = Solver(written(derivative), 0.0, start, float(tau[-1]), rtol, atol, longest)
    while done < len(tau):
        solver.step()
        upto = int(np.searchsorted(tau, solver.time, side="right"))
        if upto > done:
            result[done:upto] = solver.between(tau[done:upto])
        done = upto
    return result


def written(derivative: Derivative | loops.Slope) -> Slope:
    """Return a derivative that writes into an array."""
    if isinstance(derivative, loops.Slope):
        return derivative

    def slope(time: float, state: Array, out: Array) -> None:
        out[...] = derivative(state)

    return slope


def _real(values: Array) -> NDArray[np.float64]:
    """Return the numbers of each row, (S, …) to (S, n) of the same memory; a complex number is two."""
    return values.reshape(len(values), -1).view(np.float64)


def _first_step(now: Step, span: float, rtol: float, atol: Floats | float) -> float:
    """Return the first step: Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I, section II.4."""
    begin, slope = now.begin, now.slopes[0]
    scale = atol + rtol * np.abs(begin)
    size, speed = loops.norm(begin / scale), loops.norm(slope / scale)
    guess = min(1e-6 if min(size, speed) < 1e-5 else 0.01 * size / speed, span)
    now.slope(now.time + guess, begin + guess * slope, now.trial)
    turning = loops.norm((now.trial - slope) / scale) / guess
    fastest = max(speed, turning)
    return min(100 * guess, max(1e-6, guess * 1e-3) if fastest <= 1e-15 else (0.01 / fastest) ** (1 / 8))
