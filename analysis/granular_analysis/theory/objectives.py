"""Objectives that second order gives, with exact derivatives, and the numbers of a crystal at which they are best.

| objective | what it is, of a spot (`granular_analysis.theory.variation`) |
|---|---|
| `Growth` | growth of a resonant second harmonic in a period, in the amplitude of the wave per length of the spot |
| `Tuned` | −(f/f₀ − 1)² of the frequency f of a resonance |
| `Gap` | width of the gap above a branch, over the frequency of its middle |
| `Passing` | share of the energy of a wave that passes rows, by the density of these rows |

All are to be as large as possible; `Least` turns one around. `best` looks at a grid of numbers between bounds, and
improves the best of them by L-BFGS-B. Good values: one to three numbers, whose bounds are not farther apart than a
factor of ten.

When it breaks: where the resonance that is followed ends or meets another one between the bounds. A maximum that the
grid does not see is not found.
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
_TRIED = 3  # points of the grid from which a maximum is looked for
_FLAT = 1e-9  # logarithmic derivative of an objective that is rounding


class Objective(Protocol):
    """A function of numbers (P,) that is to be as large as possible, with its derivatives.

    Raises ValueError where it has no value.
    """

    def __call__(self, values: Floats, /) -> Value:
        """Return the value and its gradient."""


class Found(NamedTuple):
    """Numbers (P,) at which an objective is largest, its value there, and that at the best point of the grid."""

    values: Floats
    value: float
    of_grid: float


@dataclass(frozen=True, eq=False)
class Growth:
    """Growth of a second harmonic in a period, on the resonance of a branch with a target near a wave number."""

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
    """Distance of the frequency of a resonance from one that is wanted, in rad per unit of time."""

    resonant: Growth
    wanted: float

    def __call__(self, values: Floats) -> Value:
        """Return −(f/f₀ − 1)²."""
        found = self.resonant.at(values).frequency
        miss = found.value / self.wanted - 1
        return Value(-(miss**2), -2 * miss / self.wanted * found.gradient)


@dataclass(frozen=True, eq=False)
class Gap:
    """Width of the gap above a branch along the line of a spot, over its middle; negative where branches overlap."""

    place: Place
    branch: int

    def __call__(self, values: Floats) -> Value:
        """Return the width. The wave number of an extremum counts at the edge of the zone only, which moves."""
        varied = Varied(self.place, values, 0.0)
        limit = float(last_number(varied.spot.crystal, varied.spot.unit))
        numbers = limit * np.arange(COUNT + 1) / COUNT
        below, above = (self._extremum(varied, numbers, branch, sign) for branch, sign in ((0, -1), (1, 1)))
        width, middle = above.value - below.value, (above.value + below.value) / 2
        slopes = above.gradient - below.gradient, (above.gradient + below.gradient) / 2
        return Value(width / middle, (slopes[0] - width / middle * slopes[1]) / middle)

    def _extremum(self, varied: Varied, numbers: Floats, onward: int, sign: int) -> Value:
        """Return the lowest (sign 1) or highest (−1) frequency of the branch, or of the one onward."""
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
    """Share of the energy of a wave that passes rows, as all waves behind them.

    Attributes
    ----------
    rows : of numbers, (P,) densities or what decides them; and the derivatives (P, N) of the logarithms of the masses.
    frequency, name : of the wave that comes.
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
    """An objective that is to be as small as possible: its negative."""

    objective: Objective

    def __call__(self, values: Floats) -> Value:
        """Return the negative."""
        found = self.objective(values)
        return Value(-found.value, -found.gradient)


class Candidate(NamedTuple):
    """A resonance at numbers (P,) of a grid: its growth, and its frequency in rad per unit of time."""

    resonant: Growth
    values: Floats
    growth: float
    frequency: float


def candidates(place: Place, bounds: Sequence[tuple[float, float]], points: int = POINTS) -> list[Candidate]:
    """Return the resonances that grow on a grid of numbers between bounds.

    Raises ValueError if there is none.
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
    """Return all combinations of values at equal distances, the bounds among them."""
    return [np.array(each) for each in product(*(np.linspace(low, high, points) for low, high in bounds))]


def best(objective: Objective, bounds: Sequence[tuple[float, float]], starts: Sequence[Floats] | None = None) -> Found:
    """Return the numbers between bounds at which an objective is largest.

    Parameters
    ----------
    bounds : (P) pairs, lower and upper
    starts : numbers from which to look; None: the best points of a grid

    Raises ValueError if the objective has no value anywhere it was looked for.
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
    """Return of which numbers (P,) an objective does not depend: its slope is 0 at values, and far from them."""
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
