"""Objectives from the theory of second order, with exact derivatives, and the search for their maxima.

| objective | value, for a spot (`granular_analysis.theory.variation`) |
|---|---|
| `Growth` | growth of a resonant second harmonic: in a period it gains growth·A²/length, for a wave of amplitude A |
| `Tuned` | −(f/f₀ − 1)² for the frequency f of a resonance and a wanted f₀ |
| `Gap` | width of the gap above a branch, over the frequency at its middle |
| `Passing` | share of the energy of a wave that passes through rows, as a function of the density of these rows |

All are maximised; `Least` turns an objective around. `best` evaluates an objective on a grid between bounds and
improves the best points by L-BFGS-B. Good values: one to three numbers, each with bounds within a factor of ten.

When it breaks: if the resonance that is followed ends or meets another one between the bounds. A maximum between the
points of the grid may be missed.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize, minimize_scalar

from granular_analysis.theory.phase_matching import last_number, matches
from granular_analysis.theory.rows import Rows
from granular_analysis.theory.transfer import changes_by_mass, scattering
from granular_analysis.theory.variation import Place, Resonance, Value, Varied, resonance

Floats = NDArray[np.float64]

POINTS = 5  # values of each number on the grid
COUNT = 60  # wave numbers on a line
_TRIED = 3  # the search starts from this many of the best points of the grid
_FLAT = 1e-9  # a logarithmic derivative below this is rounding


class Objective(Protocol):
    """A function of numbers (P,) to be maximised, with its derivatives.

    Raises ValueError where it has no value.
    """

    def __call__(self, values: Floats, /) -> Value:
        """Return the value and its gradient."""


class Found(NamedTuple):
    """Numbers (P,) at which an objective is largest, its value there, and its value at the best start."""

    values: Floats
    value: float
    of_grid: float


@dataclass(frozen=True, eq=False)
class Growth:
    """Growth of a second harmonic at a resonance 2ω_i(x) = ω_j(2x), by `variation.Varied.growth`.

    Attributes
    ----------
    place : numbers → spot.
    branch, target : the branches i and j.
    near : wave number x near the resonance.
    """

    place: Place
    branch: int
    target: int
    near: float

    def at(self, values: ArrayLike) -> Resonance:
        """Return the resonance."""
        return resonance(self.place, values, self.branch, self.target, self.near)

    def __call__(self, values: Floats) -> Value:
        """Return the growth."""
        return self.at(values).growth


@dataclass(frozen=True, eq=False)
class Tuned:
    """Squared relative distance of the frequency of a resonance from a wanted one, in rad per unit of time."""

    resonant: Growth
    wanted: float

    def __call__(self, values: Floats) -> Value:
        """Return −(f/f₀ − 1)²."""
        found = self.resonant.at(values).frequency
        miss = found.value / self.wanted - 1
        return Value(-(miss**2), -2 * miss / self.wanted * found.gradient)


@dataclass(frozen=True, eq=False)
class Gap:
    """Width over middle of the gap above a branch, along the line of a spot; negative where branches overlap."""

    place: Place
    branch: int

    def __call__(self, values: Floats) -> Value:
        """Return the width over the middle.

        Its derivatives include the shift of the wave number of an extremum only at the edge of the zone, which moves;
        elsewhere a shift has no effect to first order.
        """
        varied = Varied(self.place, values, 0.0)
        limit = float(last_number(varied.spot.crystal, varied.spot.unit))
        numbers = limit * np.arange(COUNT + 1) / COUNT
        below, above = (self._extremum(varied, numbers, branch, sign) for branch, sign in ((0, -1), (1, 1)))
        width, middle = above.value - below.value, (above.value + below.value) / 2
        slopes = above.gradient - below.gradient, (above.gradient + below.gradient) / 2
        return Value(width / middle, (slopes[0] - width / middle * slopes[1]) / middle)

    def _extremum(self, varied: Varied, numbers: Floats, onward: int, sign: int) -> Value:
        """Return the lowest (sign 1) or highest (sign −1) frequency of the branch `onward` places above this one."""
        crystal, unit, _ = varied.spot
        branch = self.branch + onward

        def frequency(number: float) -> float:
            return sign * float(crystal.frequencies(number * unit)[branch])

        least = int(np.argmin(sign * crystal.frequencies(numbers[:, None] * unit)[:, branch]))
        number = float(numbers[least])
        if 0 < least < COUNT:
            around = numbers[least - 1], numbers[least + 1]
            number = float(minimize_scalar(frequency, bounds=around, method="bounded", options={"xatol": 1e-12}).x)
        at = varied.at(number)
        modes = at.here
        modes.refuse_mixed(branch)
        edges = [
            np.imag(last_number(spot.crystal, spot.unit)) / size
            for (spot, _), size in zip(at.steps[:-1], at.sizes, strict=False)
        ]
        moved = modes.rates[-1, branch] * np.array(edges) * (least == COUNT)
        return Value(float(modes.frequencies[branch]), modes.rates[:-1, branch] + moved)


@dataclass(frozen=True, eq=False)
class Passing:
    """Share of the energy of an incoming wave that passes through rows, summed over all waves behind them.

    Attributes
    ----------
    rows : numbers (P,) → rows, and derivatives (P, N) of the logarithms of the masses of the N rows.
    frequency, name : frequency and name of the incoming wave.
    """

    rows: Callable[[Floats], tuple[Rows, Floats]]
    frequency: float
    name: str

    def __call__(self, values: Floats) -> Value:
        """Return the share."""
        rows, heavier = self.rows(values)
        share = sum(scattering(rows, self.frequency, self.name).transmitted.values())
        return Value(share, heavier @ changes_by_mass(rows, self.frequency, self.name))


@dataclass(frozen=True, eq=False)
class Least:
    """Negative of an objective, for one that is to be minimised."""

    objective: Objective

    def __call__(self, values: Floats) -> Value:
        """Return the negative."""
        found = self.objective(values)
        return Value(-found.value, -found.gradient)


class Candidate(NamedTuple):
    """A resonance at numbers (P,) of a grid, with its growth and its frequency in rad per unit of time."""

    resonant: Growth
    values: Floats
    growth: float
    frequency: float


def candidates(place: Place, bounds: Sequence[tuple[float, float]], points: int = POINTS) -> list[Candidate]:
    """Return all resonances whose second harmonic grows, at all points of a grid between bounds.

    Raises ValueError if there are none.
    """
    found = []
    for values in grid(bounds, points):
        spot = place(values)
        unit = float(np.linalg.norm(spot.unit))
        for each in matches(spot.crystal, spot.unit, count=COUNT):
            if each.rate > 0:
                resonant = Growth(place, each.branch, each.target, each.wavenumber / unit)
                growth = each.rate * 2 * np.pi / each.frequency * float(spot.length)
                found.append(Candidate(resonant, values, growth, each.frequency))
    if not found:
        raise ValueError("no second harmonic resonates and grows at any of these values")
    return found


def grid(bounds: Sequence[tuple[float, float]], points: int = POINTS) -> list[Floats]:
    """Return all combinations of `points` equidistant values of each number, from bound to bound."""
    return [np.array(each) for each in product(*(np.linspace(low, high, points) for low, high in bounds))]


def best(objective: Objective, bounds: Sequence[tuple[float, float]], starts: Sequence[Floats] | None = None) -> Found:
    """Return the numbers between bounds at which an objective is largest.

    Parameters
    ----------
    bounds : P pairs, lower and upper.
    starts : points (P,) to evaluate, from the best of which the search starts; None: a grid between the bounds.

    Raises ValueError if the objective has no value at any start.
    """
    low, high = np.array(bounds, dtype=float).T
    known = [(value.value, each) for each in starts or grid(bounds) if (value := _tried(objective, each)) is not None]
    if not known:
        raise ValueError("the objective has no value between the bounds")
    known.sort(key=lambda each: -each[0])
    scale = max(abs(known[0][0]), np.finfo(float).tiny)
    worst = 2 * scale - known[-1][0]

    def descending(share: Floats) -> tuple[float, Floats]:
        found = _tried(objective, low + share * (high - low))
        if found is None:
            return worst / scale, np.zeros(len(low))
        return -found.value / scale, -found.gradient * (high - low) / scale

    ends = [
        minimize(descending, (each - low) / (high - low), jac=True, method="L-BFGS-B", bounds=[(0, 1)] * len(low))
        for _, each in known[:_TRIED]
    ]
    end = min(ends, key=lambda each: each.fun)
    return Found(low + end.x * (high - low), float(-end.fun * scale), known[0][0])


def independent(objective: Objective, bounds: Sequence[tuple[float, float]], values: Floats) -> list[bool]:
    """Return whether an objective is independent of each number (P,): its slope is 0 at `values`, and far from them."""
    here = objective(values)
    found = []
    for number, (low, high) in enumerate(bounds):
        away = values.copy()
        away[number] = (values[number] + (low if values[number] - low > high - values[number] else high)) / 2
        places = [(here, values), (_tried(objective, away), away)]
        found.append(
            all(each and abs(each.gradient[number] * at[number]) <= _FLAT * abs(each.value) for each, at in places)
        )
    return found


def _tried(objective: Objective, values: Floats) -> Value | None:
    try:
        return objective(values)
    except ValueError:
        return None
