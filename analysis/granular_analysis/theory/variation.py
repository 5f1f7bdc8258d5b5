"""Exact derivatives of results of second order: modes, resonances, and the growth of a second harmonic.

A *spot* is a crystal with a line of wave vectors k = x·unit, as a function of some numbers. The function consists of
sums, products and roots, so it accepts complex numbers. At v + ih e with h → 0, its real part is the value and its
imaginary part is h times the derivative along e, without a difference that rounds (the complex step). Waves are complex
themselves, with a second imaginary unit j. Their real and imaginary parts therefore pass through the contacts as two
fields. This is exact for the linear forces, and for the quadratic forces because

    Q(a + jb, a + jb) = Q(a, a) − Q(b, b) + 2j Q(a, b).

The derivative dA of A = M⁻¹D gives the derivatives of the modes, A U_j = λ_j U_j, and of their duals. With G_lj =
dual_l·dA·U_j,

    dλ_j = G_jj,   dU_j = Σ_l U_l G_lj/(λ_j − λ_l) + α U_j,   d dual_j = Σ_l G_jl/(λ_j − λ_l) dual_l − α dual_j

where l ≠ j and α keeps Σ|U_j|². At a resonance 2ω_i(x) = ω_j(2x) the wave number x changes with the crystal; all
derivatives there are total ones.

When it breaks: if two branches of one frequency mix, which is refused; if contacts open or close as a number changes,
since the contacts are those of the unchanged spot.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.bonds import Bonds, Strain
from granular_analysis.theory.crystal import Crystal
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.second_order import Mixed, Wave

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Pair = tuple[NDArray[Any], NDArray[Any]]  # real and imaginary part of a wave field, each with a complex step

_STEP = 1e-30  # relative size of a complex step: nothing is subtracted, so nothing rounds
_SAME = 1e-9  # squared frequencies are equal if they differ by less than this share of the highest
_MIXED = 1e-9  # largest coupling of two branches of one frequency, over the largest change of all
_TURNS = 60  # most Newton steps to a resonance


class Spot(NamedTuple):
    """A crystal, the wave vector (3,) at wave number 1, and the unit of length of amplitudes."""

    crystal: Crystal
    unit: NDArray[Any]
    length: Any


Place = Callable[[NDArray[Any]], Spot]


class Value(NamedTuple):
    """A number, and its derivatives (P,) with respect to the numbers of the spot."""

    value: float
    gradient: Floats


@dataclass(frozen=True, eq=False)
class Varied:
    """Modes of a spot at a wave number, and their changes with the numbers of the spot and with the wave number.

    Attributes
    ----------
    place : numbers → spot.
    values : (P,) numbers of the spot.
    wavenumber : x.
    """

    place: Place
    values: Floats
    wavenumber: float

    @cached_property
    def spot(self) -> Spot:
        """Return the spot."""
        return self.place(self.values)

    @cached_property
    def spots(self) -> list[Spot]:
        """Return P spots, each with a complex step in one number."""
        spots = []
        for number, value in enumerate(self.values):
            moved = self.values.astype(complex)
            moved[number] += 1j * _STEP * max(abs(value), _STEP)
            spots.append(self.place(moved))
        return spots

    def at(self, wavenumber: float) -> "Varied":
        """Return the same spots at another wave number."""
        other = replace(self, wavenumber=wavenumber)
        vars(other).update(spot=self.spot, spots=self.spots)
        return other

    @property
    def steps(self) -> list[tuple[Spot, NDArray[Any]]]:
        """Return P + 1 pairs of spot and k, with a complex step in each number, and last in the wave number."""
        return [*((each, self.wavenumber * each.unit) for each in self.spots), self.onward]

    @property
    def onward(self) -> tuple[Spot, NDArray[Any]]:
        """Return the spot and k with a complex step in the wave number."""
        return self.spot, (self.wavenumber + 1j * _STEP) * self.spot.unit

    @property
    def sizes(self) -> Floats:
        """Return the size of each complex step, (P + 1,)."""
        return _STEP * np.append(np.maximum(np.abs(self.values), _STEP), 1.0)

    @cached_property
    def here(self) -> "Modes":
        """Return the modes at the wave number, with their derivatives."""
        return self.modes(1, self.steps, self.sizes)

    @cached_property
    def there(self) -> "Modes":
        """Return the modes at twice the wave number, with their derivatives."""
        return self.modes(2, self.steps, self.sizes)

    def detuning(self, branch: int, target: int) -> tuple[float, float]:
        """Return 2ω_i(x) − ω_j(2x) and its derivative with respect to the wave number x."""
        here, there = (self.modes(factor, [self.onward], self.sizes[-1:]) for factor in (1, 2))
        slope = 2 * here.rates[0, branch] - there.rates[0, target]
        return float(2 * here.frequencies[branch] - there.frequencies[target]), float(slope)

    def modes(self, factor: int, steps: Sequence[tuple[Spot, NDArray[Any]]], sizes: Floats) -> "Modes":
        """Return the modes at `factor` times the wave number, with their derivatives from steps of these sizes."""
        spot, k = self.spot, factor * self.wavenumber * self.spot.unit
        crystal = spot.crystal
        found = crystal.modes(k)
        units = crystal.whole(np.eye(len(crystal.moving(crystal.mass)))).real
        none = np.zeros_like(units)
        changes = []
        for (moved, at), size in zip(steps, sizes, strict=True):
            forces = [part.imag / size for part in _linear(moved.crystal, factor * at, (units, none))]
            stiffness = -(forces[0] + 1j * forces[1])  # dD times each unit vector, (F, B, 6)
            heavier = moved.crystal.mass.imag / size
            rest = np.einsum("fbc,jf->jbc", stiffness, crystal.moving(found.shapes))
            rest = rest - found.frequencies[:, None, None] ** 2 * heavier * found.shapes
            changes.append(np.einsum("lbc,jbc->lj", found.duals, crystal.accelerations(rest)))
        return Modes(crystal, found.frequencies, found.shapes, found.duals, np.array(changes))

    def growth(self, branch: int, target: int) -> Value:
        """Return the growth of the second harmonic in the branch `target`, which a wave of `branch` drives.

        In a period 2π/ω, the second harmonic of a wave of amplitude A gains the amplitude growth·A²/length, with the
        length of the spot.
        """
        crystal, k = self.spot.crystal, self.wavenumber * self.spot.unit
        here, there = self.here, self.there
        wave, frequency = here.shapes[branch], here.frequencies[branch]
        force = Mixed(crystal, *(Wave(k, frequency, wave),) * 2).forces.running
        accelerations = crystal.accelerations(force)
        share = np.sum(there.duals[target] * accelerations)
        shapes, duals = here.shape_changes(branch), there.dual_changes(target)
        pushed = []
        for (moved, at), size, shape in zip(self.steps, self.sizes, shapes, strict=True):
            parts = wave.real + 1j * size * shape.real, wave.imag + 1j * size * shape.imag
            real, imaginary = (part.imag / size for part in _quadratic(moved.crystal, at, parts))
            pushed.append(real + 1j * imaginary - moved.crystal.mass.imag / size * accelerations)
        changes = np.sum(there.duals[target] * crystal.accelerations(np.array(pushed)), axis=(-2, -1))
        changes = changes + np.sum(duals * accelerations, axis=(-2, -1))
        natural, length = there.frequencies[target], float(np.real(self.spot.length))
        value = np.pi * abs(share) * length / (2 * natural * frequency)
        lengths = [np.imag(moved.length) / size for (moved, _), size in zip(self.steps, self.sizes, strict=True)]
        logarithm = np.real(changes / share) - there.rates[:, target] / natural - here.rates[:, branch] / frequency
        return Value(float(value), value * (logarithm + np.array(lengths) / length))


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes at a wave vector, and their derivatives.

    Attributes
    ----------
    crystal : crystal of the spot.
    frequencies, shapes, duals : (J,), (J, B, 6), (J, B, 6), as in `granular_analysis.theory.crystal.Modes`.
    changes : (P + 1, J, J) G for each number, and last for the wave number.
    """

    crystal: Crystal
    frequencies: Floats
    shapes: Complexes
    duals: Complexes
    changes: Complexes

    @cached_property
    def rates(self) -> Floats:
        """Return the derivatives (P + 1, J) of the frequencies; nan for a rigid motion."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.einsum("pjj->pj", self.changes).real / (2 * self.frequencies))

    def shape_changes(self, branch: int) -> Complexes:
        """Return the derivatives (P + 1, B, 6) of a mode whose size stays constant.

        Raises TheoryError if another branch of the same frequency mixes with it.
        """
        moved = np.einsum("pl,lbc->pbc", self._weights(self.changes[:, :, branch], branch), self.shapes)
        return np.asarray(moved - self._longer(moved, branch)[:, None, None] * self.shapes[branch])

    def dual_changes(self, branch: int) -> Complexes:
        """Return the derivatives (P + 1, B, 6) of the dual of a mode of constant size, as `shape_changes`."""
        moved = np.einsum("pl,lbc->pbc", self._weights(self.changes[:, :, branch], branch), self.shapes)
        turned = np.einsum("pl,lbc->pbc", self._weights(self.changes[:, branch], branch), self.duals)
        return np.asarray(turned + self._longer(moved, branch)[:, None, None] * self.duals[branch])

    def _longer(self, moved: Complexes, branch: int) -> Floats:
        """Return the relative change of length, (P + 1,), that a change `moved` of a mode makes."""
        shape = self.shapes[branch]
        return np.asarray(np.real(np.sum(shape.conj() * moved, axis=(-2, -1))) / np.sum(np.abs(shape) ** 2))

    def _weights(self, changes: Complexes, branch: int) -> Complexes:
        """Return changes (P + 1, J) over λ_j − λ_l for the branch j; 0 for l = j."""
        self.refuse_mixed(branch)
        gaps, same = self._gaps(branch)
        return np.where(same, 0.0, changes / np.where(same, 1.0, gaps))

    def refuse_mixed(self, branch: int) -> None:
        """Raise TheoryError if another branch of the same frequency mixes with a branch."""
        same = self._gaps(branch)[1] & (np.arange(len(self.frequencies)) != branch)
        others = np.abs(self.changes[:, same, branch]), np.abs(self.changes[:, branch, same])
        if np.any(np.maximum(*others) > _MIXED * np.abs(self.changes).max(axis=(1, 2))[:, None]):
            raise TheoryError(f"branch {branch} has the same frequency as another branch here, and mixes with it")

    def _gaps(self, branch: int) -> tuple[Floats, NDArray[np.bool_]]:
        """Return λ_j − λ_l for a branch j and all l, and whether each is 0."""
        squares = self.frequencies**2
        gaps = squares[branch] - squares
        return gaps, np.abs(gaps) < _SAME * squares.max()


@dataclass(frozen=True)
class Resonance:
    """A resonance 2ω_i(x) = ω_j(2x) of a spot, with total derivatives with respect to its numbers.

    Attributes
    ----------
    wavenumber : x.
    frequency : ω_i.
    growth : growth of the second harmonic, as from `Varied.growth`.
    """

    wavenumber: Value
    frequency: Value
    growth: Value


def resonance(place: Place, values: ArrayLike, branch: int, target: int, near: float) -> Resonance:
    """Return the resonance of a branch with a target near a wave number, by Newton's method.

    Raises TheoryError if Newton's method finds no resonance from there, or if branches mix at it.
    """
    at = Varied(place, np.asarray(values, dtype=float), near)
    for _ in range(_TURNS):
        gap, slope = at.detuning(branch, target)
        step = -gap / slope
        if not abs(step) < 0.2 * near:
            break
        if abs(step) < 1e-13 * near:
            rates, growth = at.here.rates[:, branch], at.growth(branch, target)
            slopes = 2 * rates - at.there.rates[:, target]
            moves = -slopes[:-1] / slopes[-1]
            return Resonance(
                Value(float(at.wavenumber), moves),
                Value(float(at.here.frequencies[branch]), rates[:-1] + rates[-1] * moves),
                Value(growth.value, growth.gradient[:-1] + growth.gradient[-1] * moves),
            )
        at = at.at(at.wavenumber + step)
    raise TheoryError(f"branches {branch} and {target} have no resonance near the wave number {near:.6g}")


def _linear(crystal: Crystal, k: NDArray[Any], field: Pair) -> Pair:
    """Return the forces (..., B, 6) of first order in a field."""
    return _gathered(crystal, k, tuple(map(crystal.bonds.linear, _strains(crystal.bonds, k, field))))


def _quadratic(crystal: Crystal, k: NDArray[Any], field: Pair) -> Pair:
    """Return the second-order forces (B, 6) of a field with itself, at 2k, that run with the wave."""
    one, other = _strains(crystal.bonds, k, field)
    first, second, both = (crystal.bonds.running(*pair) for pair in ((one, one), (other, other), (one, other)))
    return _gathered(crystal, 2 * k, (first - second, 2 * both))


def _strains(bonds: Bonds, k: NDArray[Any], field: Pair) -> tuple[Strain, Strain]:
    """Return the deformations of the contacts in the real and the imaginary part of a field times e^{ik·r}."""
    cosine, sine = _turns(bonds, k)
    (a, b), (c, d) = (
        [np.where(spheres[:, None] < 0, 0.0, each[..., spheres, :]) for each in field]
        for spheres in (bonds.first, bonds.second)
    )
    here = a * cosine + b * sine, b * cosine - a * sine
    there = c * cosine - d * sine, d * cosine + c * sine
    one, other = (
        bonds.deformed((far - near)[..., :3], (far + near)[..., 3:]) for near, far in zip(here, there, strict=True)
    )
    return one, other


def _gathered(crystal: Crystal, k: NDArray[Any], ends: tuple[NDArray[Any], ...]) -> Pair:
    """Return the real and imaginary forces (..., B, 6) on spheres from those at both ends of the contacts."""
    cosine, sine = (each[:, None] for each in _turns(crystal.bonds, k))
    sine = sine * np.array([[1.0], [-1.0]])
    one, other = ends
    turned = one * cosine - other * sine, other * cosine + one * sine
    real, imaginary = (crystal.bonds.gather(each, np.zeros(3), len(crystal)) for each in turned)
    return real, imaginary


def _turns(bonds: Bonds, k: NDArray[Any]) -> Pair:
    """Return the cosine and sine (C, 1) of the phase from the middle of a contact to its end."""
    phase = 0.5 * (bonds.apart @ k)[:, None]
    return np.cos(phase), np.sin(phase)
