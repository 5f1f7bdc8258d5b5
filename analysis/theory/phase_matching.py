"""Resonances and antiresonances of second order: where in a crystal the second harmonic grows, and where there is none.

A wave of branch i with the wave vector k drives branch j at 2k. Along a line of wave vectors k = q e

    resonance       2ω_i(k) = ω_j(2k): the harmonic is a free wave, and grows in proportion to time
    antiresonance   the force on branch j vanishes between two waves that have one

A mirror of the crystal that contains e makes modes even or odd. The square of either is even: an odd branch at 2k gets
nothing, at any wave number, and its resonances are *forbidden*.

When it breaks: where two branches have one frequency all along the line and no mirror z → −z tells them apart, so that
their polarisation is arbitrary; a pair of crossings between two points of the grid is missed.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from granular_analysis.theory.crystal import Crystal, padded
from granular_analysis.theory.mirror import Mirror
from granular_analysis.theory.second_order import Mixed, Wave, branch_of
from granular_analysis.theory.selection import mirrors, parity

Floats = NDArray[np.float64]

COUNT = 200  # wave numbers on a line
_FLOPPY = 1e-6  # a branch below this share of the highest frequency all along has the frequency 0
_SILENT = 1e-9  # share of the largest force on any branch that is rounding, or a zero that was found
_FACING = 1e-9  # share of a reciprocal vector that is rounding
_REACH = 3  # reciprocal vectors up to this many of each


@dataclass(frozen=True)
class Match:
    """A resonance or an antiresonance.

    Attributes
    ----------
    kind : "resonance" or "antiresonance".
    wavenumber : q = |k|.
    branch, target : i and j, from 0 by frequency.
    frequency : ω of the wave.
    rate : velocity of growth of branch j, per square of the amplitude of one wave; 0 if there is none.
    forbidden : why a resonance does not grow, "" if it does.
    """

    kind: str
    wavenumber: float
    branch: int
    target: int
    frequency: float
    rate: float
    forbidden: str = ""


def zone_edge(crystal: Crystal, direction: ArrayLike) -> float:
    """Return the largest |k| along a direction that is in the first Brillouin zone."""
    return float(last_number(crystal, _unit(direction)))


def last_number(crystal: Crystal, unit: NDArray[Any]) -> Any:
    """Return the largest x of wave vectors x·unit in the first Brillouin zone; numbers may have a complex step."""
    counts = product(range(-_REACH, _REACH + 1), repeat=len(crystal.vectors))
    vectors = np.array([count for count in counts if any(count)]) @ crystal.reciprocal
    towards, squares = vectors @ unit, np.sum(vectors**2, axis=1)
    facing = towards.real > _FACING * np.sqrt(squares.real) * np.linalg.norm(unit)
    numbers = squares[facing] / (2 * towards[facing])
    return numbers[np.argmin(numbers.real)]


def matches(crystal: Crystal, direction: ArrayLike, limit: float | None = None, count: int = COUNT) -> list[Match]:
    """Return all resonances and antiresonances on a line of wave vectors, by wave number.

    Parameters
    ----------
    direction : (2,) or (3,) of any length
    limit : largest |k|; None: the zone's edge
    count : of wave numbers, from limit/count to limit
    """
    along = _unit(direction)
    most = zone_edge(crystal, along) if limit is None else limit
    numbers = most * np.arange(1, count + 1) / count
    line = _Line(crystal, along)
    frequencies, doubled, forces = line.at(numbers)
    found = []
    loudest = forces.max()
    moving = np.flatnonzero(frequencies.max(axis=0) > _FLOPPY * frequencies.max()).tolist()
    for branch, target in product(moving, range(frequencies.shape[1])):
        above = 2 * frequencies[:, branch] >= doubled[:, target]
        found += [
            line.resonance(branch, target, (numbers[n], numbers[n + 1]), loudest)
            for n in np.flatnonzero(above[1:] != above[:-1])
        ]
        size = forces[:, branch, target]
        low = np.flatnonzero((size[1:-1] < size[:-2]) & (size[1:-1] <= size[2:]) & (size[2:] > _SILENT * loudest)) + 1
        found += [
            each
            for n in low
            if (each := line.antiresonance(branch, target, numbers[n - 1], numbers[n + 1], loudest)) is not None
        ]
    return sorted(found, key=lambda each: each.wavenumber)


@dataclass(frozen=True, eq=False)
class _Line:
    """Wave vectors q·along of a crystal."""

    crystal: Crystal
    along: Floats

    @cached_property
    def mirrors(self) -> list[Mirror]:
        return list(mirrors(self.crystal))

    def wave(self, number: ArrayLike, branch: int) -> Wave:
        return branch_of(self.crystal, np.multiply.outer(np.asarray(number, dtype=float), self.along), branch)

    def doubled(self, number: ArrayLike, branch: int) -> Mixed:
        one = self.wave(number, branch)
        return Mixed(self.crystal, one, one)

    def at(self, numbers: Floats) -> tuple[Floats, Floats, Floats]:
        """Return ω_i(k) (N, J), ω_j(2k) (N, J), and the size of the forces (N, i, j) on the branches at 2k."""
        k = np.multiply.outer(numbers, self.along)
        modes = self.crystal.modes(k)
        every = Wave(k[:, None], modes.frequencies, modes.shapes)
        pairs = Mixed(self.crystal, every, every)
        return modes.frequencies, pairs.targets.frequencies[:, 0], np.abs(pairs.steady)

    def resonance(self, branch: int, target: int, between: tuple[float, float], loudest: float) -> Match:
        """Return the resonance between two wave numbers where the detuning has different signs."""

        def gap(number: float) -> float:
            pair = self.doubled(number, branch)
            return float(pair.frequency - pair.targets.frequencies[target])

        number = float(brentq(gap, *between, xtol=1e-15 * between[1], rtol=1e-14))
        pair = self.doubled(number, branch)
        size = np.abs(pair.steady)
        rate, reason = float(0.5 * size[target] / (2 * pair.targets.frequencies[target])), ""
        if size[target] < _SILENT * loudest:
            rate, reason = 0.0, self.selection(pair, target)
        return Match("resonance", number, branch, target, float(pair.first.frequency), rate, reason)

    def antiresonance(self, branch: int, target: int, low: float, high: float, loudest: float) -> Match | None:
        """Return the wave number between two where a branch gets no force, None if it gets some everywhere."""

        start = self.doubled(low, branch)

        def followed(number: float) -> tuple[complex, float]:
            """The force in the phases of the modes at `low`, where it is real, and how like the modes are to those."""
            pair = self.doubled(number, branch)
            wave = np.vdot(start.first.shape, pair.first.shape) / len(self.crystal)
            answer = np.vdot(start.targets.shapes[target], pair.targets.shapes[target]) / len(self.crystal)
            force = pair.steady[target] * wave.conj() ** 2 * answer / start.steady[target]
            return complex(force), float(min(abs(wave), abs(answer)))

        def force(number: float) -> float:
            return followed(number)[0].real

        if force(high) > 0:
            return None
        number = float(brentq(force, low, high, xtol=1e-15 * high, rtol=1e-14))
        left, like = followed(number)
        if like < 0.5 or abs(left) * abs(start.steady[target]) > _SILENT * loudest:
            return None  # another branch beyond a crossing, or a force whose phase turns
        return Match("antiresonance", number, branch, target, float(self.wave(number, branch).frequency), 0.0)

    def selection(self, pair: Mixed, target: int) -> str:
        """Return which mirror forbids that a wave drives a branch at 2k."""
        answer = Wave(pair.wavevector, pair.targets.frequencies[target], pair.targets.shapes[target])
        for mirror in self.mirrors:
            own, other = (int(parity(self.crystal, mirror, each)) for each in (pair.first, answer))
            if own and other == -1:
                name = "even" if own > 0 else "odd"
                return f"a mirror: {name} + {name} is even, and this branch is odd"
        return "vanishes, by no mirror along the wave"


def _unit(direction: ArrayLike) -> Floats:
    vector = padded(direction)
    return vector / np.linalg.norm(vector)
