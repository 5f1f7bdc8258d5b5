"""Resonances and antiresonances of second order: wave vectors where the second harmonic grows or vanishes.

A wave of branch i with the wave vector k drives branch j at 2k. Along a line of wave vectors k = q e

    resonance       2ω_i(k) = ω_j(2k): the harmonic is a free wave, and grows in proportion to time
    antiresonance   the force on branch j changes its sign

If a mirror plane of the crystal contains e, modes are even or odd. The square of either is even, so no wave number
drives an odd branch at 2k: its resonances are *forbidden*, and it has no antiresonance. From one wave number to the
next a branch continues as the most similar mode, so branches of different symmetry cross.

When it breaks: the polarisation of two branches is arbitrary if they are degenerate along the whole line and no mirror
z → −z separates them. The search misses a pair of zeros between two points of the grid. Branches that repel each other
within less than a tenth of a step count as crossing, so zeros between them are missed. A detuning that touches 0
without crossing, as at the edge of the zone, is not a resonance.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.crystal import Crystal, Modes, padded
from granular_analysis.theory.second_order import Mixed, Wave, branch_of, chosen
from granular_analysis.theory.selection import mirrors, parity

__all__ = ["matches"]

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Integers = NDArray[np.intp]

COUNT = 200  # wave numbers on a line
_FLOPPY = 1e-6  # a branch that stays below this share of the highest frequency has frequency 0
_SILENT = 1e-9  # a force below this share of the largest force is 0: rounding, or a zero at its root
_TOUCHING = 1e-12  # a detuning below this share of the highest frequency is 0
_ALIKE = 0.99  # least overlap of a mode at successive wave numbers; less means that branches repel in between
_HALVINGS = 4  # grid steps with less overlap are halved up to this many times
_FACING = 1e-9  # a component below this share of a reciprocal vector is rounding
_REACH = 3  # largest multiple of each primitive reciprocal vector


@dataclass(frozen=True)
class Match:
    """Resonance or antiresonance, in the units of the crystal.

    Attributes
    ----------
    kind : "resonance" or "antiresonance".
    wavenumber : q = |k|.
    branch, target : i and j, from 0 by frequency.
    frequency : ω of the wave.
    rate : growth of branch j per time and per square of the amplitude of the wave; 0 if it does not grow.
    forbidden : reason why a resonance does not grow; "" if it grows.
    """

    kind: str
    wavenumber: float
    branch: int
    target: int
    frequency: float
    rate: float
    forbidden: str = ""


def zone_edge(crystal: Crystal, direction: ArrayLike) -> float:
    """Return the largest |k| along a direction (2,) or (3,) inside the first Brillouin zone."""
    return float(last_number(crystal, _unit(direction)))


def last_number(crystal: Crystal, unit: NDArray[Any]) -> Any:
    """Return the largest x such that x·unit is in the first Brillouin zone; inputs may have a complex step."""
    counts = product(range(-_REACH, _REACH + 1), repeat=len(crystal.vectors))
    vectors = np.array([count for count in counts if any(count)]) @ crystal.reciprocal
    towards, squares = vectors @ unit, np.sum(vectors**2, axis=1)
    facing = towards.real > _FACING * np.sqrt(squares.real) * np.linalg.norm(unit)
    numbers = squares[facing] / (2 * towards[facing])
    return numbers[np.argmin(numbers.real)]


def matches(crystal: Crystal, direction: ArrayLike, count: int = COUNT) -> list[Match]:
    """Return all resonances and antiresonances on a line of wave vectors, sorted by wave number.

    Parameters
    ----------
    crystal : its wave vectors are in 1/length
    direction : (2,) or (3,), direction of the line, of any length
    count : number of wave numbers of the grid, up to the edge of the zone

    Raises ValueError for an unstable crystal.
    """
    along = _unit(direction)
    most = zone_edge(crystal, along)
    numbers = most * np.arange(1, count + 1) / count
    line = _Line(crystal, along)
    numbers, grid = line.grid(numbers)
    frequencies, loudest = grid.waves.frequencies, float(np.abs(grid.force).max())
    moving = (frequencies.max(axis=0) > _FLOPPY * frequencies.max())[:, None]
    gap = 2 * frequencies[:, :, None] - grid.targets.frequencies[:, None, :]
    found = []
    for step, turns in enumerate(_turns(gap, gap[1:], gap[2:], _TOUCHING * frequencies.max()), 1):
        n, branch, target = np.nonzero(turns & moving)
        found += line.resonances(branch, target, numbers[n], numbers[n + step], loudest) if len(n) else []
    for step, turns in enumerate(_turns(grid.force, grid.after(1), grid.after(2), _SILENT * loudest), 1):
        n, branch, target = np.nonzero(turns & moving)
        start = grid.chosen(n, branch, target)
        found += line.antiresonances(start, numbers[n], numbers[n + step], loudest) if len(n) else []
    # Degenerate branches have equal wave numbers up to rounding; the order must not depend on it
    return sorted(found, key=lambda each: (round(each.wavenumber / most, 9), each.kind, each.branch, each.target))


class _Forces(NamedTuple):
    """Modes at N wave vectors k (N, I) and at 2k (N, J), with the force of each wave on each branch at 2k (N, I, J)."""

    waves: Modes
    targets: Modes
    force: Complexes

    def chosen(self, n: Integers, branch: Integers, target: Integers) -> "_Forces":
        """Return M pairs of a branch and its target, with shapes (M, 1), (M, 1) and (M, 1, 1)."""
        waves, targets = (
            Modes._make(each[n, which, None] for each in modes)
            for modes, which in ((self.waves, branch), (self.targets, target))
        )
        return _Forces(waves, targets, self.force[n, branch, target, None, None])

    def unlike(self) -> NDArray[np.bool_]:
        """Return the steps (N − 1,) over which a wave or a target has no similar mode at the next wave number."""
        return np.logical_or(
            *(
                np.any(np.abs(_likest(each.duals[:-1], each.shapes[1:])[0]) < _ALIKE, axis=-1)
                for each in (self.waves, self.targets)
            )
        )

    def inserted(self, place: Integers, more: "_Forces") -> "_Forces":
        """Return these forces with others inserted before the given places."""
        waves, targets = (
            Modes._make(np.insert(one, place, other, axis=0) for one, other in zip(each, others, strict=True))
            for each, others in ((self.waves, more.waves), (self.targets, more.targets))
        )
        return _Forces(waves, targets, np.insert(self.force, place, more.force, axis=0))

    def after(self, step: int) -> Complexes:
        """Return the forces (N − step, I, J) `step` wave numbers later, in the phases of the present modes."""
        wave, branch = _likest(self.waves.duals[:-step], self.waves.shapes[step:])
        answer, target = _likest(self.targets.duals[:-step], self.targets.shapes[step:])
        n = np.arange(len(branch))[:, None, None]
        force = self.force[step:][n, branch[:, :, None], target[:, None, :]]
        return _in_phase(force, wave[:, :, None], answer[:, None, :])


def _turns(
    now: NDArray[Any], next_one: NDArray[Any], next_two: NDArray[Any], zero: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return where values change sign before the next wave number (N − 1, I, J), and before the next but one.

    The second result (N − 2, I, J) concerns values that are 0 at the next wave number, where their sign is rounding. A
    value that touches 0 without crossing does not change sign.
    """
    first, second = (
        (np.abs(now[: len(other)]) > zero) & (np.abs(other) > zero) & ((other * now[: len(other)].conj()).real < 0)
        for other in (next_one, next_two)
    )
    return first, second & (np.abs(next_one[:-1]) <= zero)


def _likest(duals: Complexes, shapes: Complexes) -> tuple[Complexes, Integers]:
    """Return, for modes with duals (N, I, B, 6), the most similar shapes (N, J, B, 6): their overlaps and indices."""
    overlap = np.einsum("nibc,njbc->nij", duals, shapes)
    best = np.argmax(np.abs(overlap), axis=-1)
    return np.take_along_axis(overlap, best[..., None], axis=-1)[..., 0], best


def _in_phase(force: Complexes, wave: Complexes, answer: Complexes) -> Complexes:
    """Return forces in the phases of earlier modes, from the overlaps of these with the present waves and targets.

    The result is a real multiple of the earlier force unless its phase turns.
    """
    return force * wave.conj() ** 2 * answer


@dataclass(frozen=True, eq=False)
class _Line:
    """Line of wave vectors q·along in a crystal; methods treat pairs (N,) of a branch and its target together."""

    crystal: Crystal
    along: Floats

    def doubled(self, number: ArrayLike, branch: ArrayLike) -> Mixed:
        one = branch_of(self.crystal, np.multiply.outer(np.asarray(number, dtype=float), self.along), branch)
        return Mixed(self.crystal, one, one)

    def grid(self, numbers: Floats) -> tuple[Floats, _Forces]:
        """Return wave numbers and their forces, with more wave numbers where a mode is unlike all modes at the next."""
        found = self.at(numbers)
        for _ in range(_HALVINGS):
            if not np.any(unlike := found.unlike()):
                break
            more = 0.5 * (numbers[1:] + numbers[:-1])[unlike]
            place = np.flatnonzero(unlike) + 1
            found, numbers = found.inserted(place, self.at(more)), np.insert(numbers, place, more)
        return numbers, found

    def at(self, numbers: Floats) -> _Forces:
        """Return all modes at k and 2k, and the forces on the modes at 2k."""
        k = np.multiply.outer(numbers, self.along)
        modes = self.crystal.modes(k)
        every = Wave(k[:, None], modes.frequencies, modes.shapes)
        pairs = Mixed(self.crystal, every, every)
        return _Forces(modes, Modes._make(each[:, 0] for each in pairs.targets), pairs.steady)

    def resonances(self, branch: Integers, target: Integers, low: Floats, high: Floats, loudest: float) -> list[Match]:
        """Return the resonances of pairs, each between two wave numbers at which the detuning has different signs."""

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

    def antiresonances(self, start: _Forces, low: Floats, high: Floats, loudest: float) -> list[Match]:
        """Return the antiresonances of pairs, each between two wave numbers at which the force has different signs.

        start : modes and forces of the pairs at the lower wave number.
        """

        def force(number: Floats, begun: Integers) -> Floats:
            share = self.followed(number, start, begun)[0] / start.force[begun, 0, 0]
            return np.asarray(share.real)

        every = np.arange(len(low))
        number = _crossings(force, low, high, every)
        left, branch, target, frequency = self.followed(number, start, every)
        found = _listed("antiresonance", number, branch, target, frequency, np.zeros(len(number)))
        # All other roots belong to another branch beyond a crossing, or to a force whose phase turns
        return [found[n] for n in np.flatnonzero(np.abs(left) <= _SILENT * loudest)]

    def followed(self, number: Floats, start: _Forces, begun: Integers) -> tuple[Complexes, Integers, Integers, Floats]:
        """Return the pairs `begun` (M,) of the start, continued to other wave numbers (M,).

        Results, each (M,): forces in the phases of the start, branches and targets at the new wave numbers, and
        frequencies of the waves.
        """
        k = np.multiply.outer(number, self.along)
        modes = self.crystal.modes(k)
        wave, branch = _likest(start.waves.duals[begun], modes.shapes)
        one = chosen(modes, k, branch[:, 0])
        pairs = Mixed(self.crystal, one, one)
        answer, target = _likest(start.targets.duals[begun], pairs.targets.shapes)
        force = np.take_along_axis(pairs.steady, target, axis=-1)
        return _in_phase(force, wave, answer)[:, 0], branch[:, 0], target[:, 0], one.frequency

    def selection(self, match: Match) -> str:
        """Return the rule by which a wave cannot drive a branch at 2k, as text for the table of resonances."""
        pair = self.doubled(match.wavenumber, match.branch)
        answer = chosen(pair.targets, pair.wavevector, match.target)
        for mirror in mirrors(self.crystal):
            own, other = (int(parity(self.crystal, mirror, each)) for each in (pair.first, answer))
            if own and other == -1:
                name = "even" if own > 0 else "odd"
                return f"forbidden by a mirror: {name} + {name} is even, and this branch is odd"
        return "vanishes, but no mirror symmetry along the wave explains it"


def _crossings(function: Callable[..., Floats], low: Floats, high: Floats, *pairs: Integers) -> Floats:
    """Return the zeros (N,) of functions of a wave number and the indices of a pair, each between low and high."""
    from scipy.optimize.elementwise import find_root  # slow to import, and only a search needs it

    return np.asarray(find_root(function, (low, high), args=pairs, tolerances={"xatol": 0.0, "xrtol": 1e-14}).x)


def _listed(kind: str, *columns: NDArray[Any]) -> list[Match]:
    """Return the matches of one kind from the columns of their other attributes."""
    return [Match(kind, *row) for row in zip(*(each.tolist() for each in columns), strict=True)]


def _unit(direction: ArrayLike) -> Floats:
    vector = padded(direction)
    return vector / np.linalg.norm(vector)
