"""Resonances and antiresonances of second order: where in a crystal the second harmonic grows, and where there is none.

A wave of branch i with the wave vector k drives branch j at 2k. Along a line of wave vectors k = q e

    resonance       2ω_i(k) = ω_j(2k): the harmonic is a free wave, and grows in proportion to time
    antiresonance   the force on branch j vanishes between two waves that have one

A mirror of the crystal that contains e makes modes even or odd. The square of either is even: an odd branch at 2k gets
nothing, at any wave number, and its resonances are *forbidden*.

When it breaks: where two branches have one frequency all along the line and no mirror z → −z tells them apart, so that
their polarisation is arbitrary; a pair of crossings between two points of the grid is missed.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize.elementwise import find_root

from granular_analysis.theory.crystal import Crystal, padded
from granular_analysis.theory.mirror import Mirror
from granular_analysis.theory.second_order import Mixed, Wave, branch_of, chosen
from granular_analysis.theory.selection import mirrors, parity

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Integers = NDArray[np.intp]

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
    loudest = float(forces.max())
    moving = (frequencies.max(axis=0) > _FLOPPY * frequencies.max())[:, None]
    above = 2 * frequencies[:, :, None] >= doubled[:, None, :]
    n, branch, target = np.nonzero((above[1:] != above[:-1]) & moving)
    found = line.resonances(branch, target, numbers[n], numbers[n + 1], loudest) if len(n) else []
    before, least, after = forces[:-2], forces[1:-1], forces[2:]
    n, branch, target = np.nonzero((least < before) & (least <= after) & (after > _SILENT * loudest) & moving)
    found += line.antiresonances(branch, target, numbers[n], numbers[n + 2], loudest) if len(n) else []
    return sorted(found, key=lambda each: each.wavenumber)


@dataclass(frozen=True, eq=False)
class _Line:
    """Wave vectors q·along of a crystal; pairs (N,) of a branch and its target are looked at side by side."""

    crystal: Crystal
    along: Floats

    @cached_property
    def mirrors(self) -> list[Mirror]:
        return list(mirrors(self.crystal))

    def doubled(self, number: ArrayLike, branch: ArrayLike) -> Mixed:
        one = branch_of(self.crystal, np.multiply.outer(np.asarray(number, dtype=float), self.along), branch)
        return Mixed(self.crystal, one, one)

    def at(self, numbers: Floats) -> tuple[Floats, Floats, Floats]:
        """Return ω_i(k) (N, J), ω_j(2k) (N, J), and the size of the forces (N, i, j) on the branches at 2k."""
        k = np.multiply.outer(numbers, self.along)
        modes = self.crystal.modes(k)
        every = Wave(k[:, None], modes.frequencies, modes.shapes)
        pairs = Mixed(self.crystal, every, every)
        return modes.frequencies, pairs.targets.frequencies[:, 0], np.abs(pairs.steady)

    def resonances(self, branch: Integers, target: Integers, low: Floats, high: Floats, loudest: float) -> list[Match]:
        """Return the resonances of pairs between two wave numbers where the detuning has different signs."""

        def gap(number: Floats, branch: Integers, target: Integers) -> Floats:
            k, each = np.multiply.outer([1.0, 2.0], np.multiply.outer(number, self.along)), np.arange(len(number))
            waves, targets = self.crystal.frequencies(k)
            return np.asarray(2 * waves[each, branch] - targets[each, target])

        number = _crossings(gap, low, high, branch, target)
        pairs, each = self.doubled(number, branch), (np.arange(len(branch)), target)
        size = np.abs(pairs.steady[each])
        rate = np.where(size < _SILENT * loudest, 0.0, 0.5 * size / (2 * pairs.targets.frequencies[each]))
        found = _listed("resonance", number, branch, target, pairs.first.frequency, rate)
        return [one if one.rate else replace(one, forbidden=self.selection(one)) for one in found]

    def antiresonances(
        self, branch: Integers, target: Integers, low: Floats, high: Floats, loudest: float
    ) -> list[Match]:
        """Return the wave numbers between two where pairs have no force, for those of which it changes its sign."""
        start = self.doubled(low, branch)
        turns = np.flatnonzero(self.followed(high, start, np.arange(len(low)), branch, target)[0].real <= 0)
        if not len(turns):
            return []
        branch, target, low, high = branch[turns], target[turns], low[turns], high[turns]

        def force(number: Floats, begun: Integers, branch: Integers, target: Integers) -> Floats:
            return np.asarray(self.followed(number, start, begun, branch, target)[0].real)

        number = _crossings(force, low, high, turns, branch, target)
        share, like = self.followed(number, start, turns, branch, target)
        left = np.abs(share * start.steady[turns, target])
        frequency = self.doubled(number, branch).first.frequency
        found = _listed("antiresonance", number, branch, target, frequency, np.zeros(len(number)))
        # Others are another branch beyond a crossing, or a force whose phase turns
        return [found[n] for n in np.flatnonzero((like >= 0.5) & (left <= _SILENT * loudest))]

    def followed(
        self, number: Floats, start: Mixed, begun: Integers, branch: Integers, target: Integers
    ) -> tuple[Complexes, Floats]:
        """Return the force over that at the start, in the phases of the modes there, and how like these the modes are.

        The first is real, unless the phase of the force turns. `begun` are the places of the pairs in the start.
        """
        now, then, pairs = (np.arange(len(target)), target), (begun, target), self.doubled(number, branch)
        wave = np.sum(start.first.shape[begun].conj() * pairs.first.shape, axis=(-2, -1)) / len(self.crystal)
        answers = start.targets.shapes[then].conj() * pairs.targets.shapes[now]
        answer = np.sum(answers, axis=(-2, -1)) / len(self.crystal)
        share = pairs.steady[now] * wave.conj() ** 2 * answer / start.steady[then]
        return np.asarray(share), np.minimum(np.abs(wave), np.abs(answer))

    def selection(self, match: Match) -> str:
        """Return which mirror forbids that a wave drives a branch at 2k."""
        pair = self.doubled(match.wavenumber, match.branch)
        answer = chosen(pair.targets, pair.wavevector, match.target)
        for mirror in self.mirrors:
            own, other = (int(parity(self.crystal, mirror, each)) for each in (pair.first, answer))
            if own and other == -1:
                name = "even" if own > 0 else "odd"
                return f"a mirror: {name} + {name} is even, and this branch is odd"
        return "vanishes, by no mirror along the wave"


def _crossings(function: Callable[..., Floats], low: Floats, high: Floats, *pairs: Integers) -> Floats:
    """Return where functions of a number and what says which pair it is cross 0, each between two numbers, (N,)."""
    return np.asarray(find_root(function, (low, high), args=pairs, tolerances={"xatol": 0.0, "xrtol": 1e-14}).x)


def _listed(kind: str, *columns: NDArray[Any]) -> list[Match]:
    """Return matches of one kind, from the columns of their other attributes."""
    return [Match(kind, *row) for row in zip(*(each.tolist() for each in columns), strict=True)]


def _unit(direction: ArrayLike) -> Floats:
    vector = padded(direction)
    return vector / np.linalg.norm(vector)
