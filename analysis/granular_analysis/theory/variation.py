"""Exact derivatives of what second order gives: modes, resonances, and the growth of a second harmonic.

A *spot* is a crystal with a line of wave vectors k = x·unit, as a function of some numbers. That function is made of
sums, products and roots, and holds for complex numbers too: at v + ih e with h → 0 it has the value in its real part,
and h times the derivative along e in its imaginary part, without a difference that rounds (the complex step). Waves
are complex themselves. So their real and imaginary parts go through the contacts as two fields, which is exact for the
linear forces, and for the quadratic ones,

    Q(a + jb, a + jb) = Q(a, a) − Q(b, b) + 2j Q(a, b).

With the derivative dA of A = M⁻¹D follow those of the modes A U_j = λ_j U_j and their duals, G_lj = dual_l·dA·U_j,

    dλ_j = G_jj,   dU_j = Σ_l U_l G_lj/(λ_j − λ_l) + α U_j,   d dual_j = Σ_l G_jl/(λ_j − λ_l) dual_l − α dual_j

over l ≠ j, with the α that keeps Σ|U_j|². At a resonance 2ω_i(x) = ω_j(2x) the wave number moves with the crystal, and
all derivatives there are total ones.

When it breaks: where two branches of one frequency mix, which is refused; where contacts open or close as a number
changes, since the contacts are those of the spot itself.
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
Pair = tuple[NDArray[Any], NDArray[Any]]  # real and imaginary part of a field, each with a complex step

_STEP = 1e-30  # relative size of a complex step: nothing is subtracted, so nothing rounds
_SAME = 1e-9  # squared frequencies within this share of the highest are one
_MIXED = 1e-9  # share of the highest squared frequency by which branches of one frequency may mix
_TURNS = 60  # Newton steps to a resonance


class Spot(NamedTuple):
    """A crystal, the wave vector (3,) of the wave number 1, and the length in which amplitudes are given."""

    crystal: Crystal
    unit: NDArray[Any]
    length: Any


Place = Callable[[NDArray[Any]], Spot]


class Value(NamedTuple):
    """A number, and its derivatives by those of the spot (P,)."""

    value: float
    gradient: Floats


@dataclass(frozen=True, eq=False)
class Varied:
    """A wave number of a spot, and how the modes there change with the numbers of the spot and the wave number.

    Attributes
    ----------
    place : of the spot.
    values : (P,) its numbers.
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
        """Return the spot with a complex step in each number."""
        spots = []
        for number, value in enumerate(self.values):
            moved = self.values.astype(complex)
            moved[number] += 1j * _STEP * max(abs(value), _STEP)
            spots.append(self.place(moved))
        return spots

    def at(self, wavenumber: float) -> "Varied":
        """Return another wave number, of the same spots."""
        other = replace(self, wavenumber=wavenumber)
        vars(other).update(spot=self.spot, spots=self.spots)
        return other

    @property
    def steps(self) -> list[tuple[Spot, NDArray[Any]]]:
        """Return the spot and k, with a complex step in each number, and in the wave number last."""
        return [*((each, self.wavenumber * each.unit) for each in self.spots), self.onward]

    @property
    def onward(self) -> tuple[Spot, NDArray[Any]]:
        """Return the spot and k, with a complex step in the wave number."""
        return self.spot, (self.wavenumber + 1j * _STEP) * self.spot.unit

    @property
    def sizes(self) -> Floats:
        """Return the size of each complex step."""
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
        """Return 2ω_i(x) − ω_j(2x) and its derivative by the wave number."""
        here, there = (self.modes(factor, [self.onward], self.sizes[-1:]) for factor in (1, 2))
        slope = 2 * here.rates[0, branch] - there.rates[0, target]
        return float(2 * here.frequencies[branch] - there.frequencies[target]), float(slope)

    def modes(self, factor: int, steps: Sequence[tuple[Spot, NDArray[Any]]], sizes: Floats) -> "Modes":
        """Return the modes at the wave number, times a factor, with their derivatives by steps of these sizes."""
        spot, k = self.spot, factor * self.wavenumber * self.spot.unit
        crystal = spot.crystal
        found = crystal.modes(k)
        units = crystal.whole(np.eye(len(crystal.moving(crystal.mass)))).real
        none = np.zeros_like(units)
        changes = []
        for (moved, at), size in zip(steps, sizes, strict=True):
            forces = [part.imag / size for part in _linear(moved.crystal, factor * at, (units, none))]
            stiffness = -(forces[0] + 1j * forces[1])  # dD of each unit vector, (F, B, 6)
            heavier = moved.crystal.mass.imag / size
            rest = np.einsum("fbc,jf->jbc", stiffness, crystal.moving(found.shapes))
            rest = rest - found.frequencies[:, None, None] ** 2 * heavier * found.shapes
            changes.append(np.einsum("lbc,jbc->lj", found.duals, crystal.accelerations(rest)))
        return Modes(crystal, found.frequencies, found.shapes, found.duals, np.array(changes))

    def growth(self, branch: int, target: int) -> Value:
        """Return the amplitude that the second harmonic gains in a period, in that of the wave per length of the spot.

        That is its rate 2π/ω times the length of the spot; a wave of the branch drives the target.
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
    """Modes at a wave vector, and how they change.

    Attributes
    ----------
    frequencies, shapes, duals : (J,), (J, B, 6), (J, B, 6), as `granular_analysis.theory.crystal.Modes`.
    changes : (P + 1, J, J) G by each number and the wave number.
    """

    crystal: Crystal
    frequencies: Floats
    shapes: Complexes
    duals: Complexes
    changes: Complexes

    @cached_property
    def rates(self) -> Floats:
        """Return the derivatives (P + 1, J) of the frequencies; nan of a rigid motion."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.einsum("pjj->pj", self.changes).real / (2 * self.frequencies))

    def shape_changes(self, branch: int) -> Complexes:
        """Return the derivatives (P + 1, B, 6) of a mode of constant size.

        Raises ValueError where another branch of the same frequency mixes with it.
        """
        moved = np.einsum("pl,lbc->pbc", self._weights(self.changes[:, :, branch], branch), self.shapes)
        return np.asarray(moved - self._longer(moved, branch)[:, None, None] * self.shapes[branch])

    def dual_changes(self, branch: int) -> Complexes:
        """Return the derivatives (P + 1, B, 6) of the dual of a mode of constant size."""
        moved = np.einsum("pl,lbc->pbc", self._weights(self.changes[:, :, branch], branch), self.shapes)
        turned = np.einsum("pl,lbc->pbc", self._weights(self.changes[:, branch], branch), self.duals)
        return np.asarray(turned + self._longer(moved, branch)[:, None, None] * self.duals[branch])

    def _longer(self, moved: Complexes, branch: int) -> Floats:
        """Return by how much a change of a mode makes it longer, (P + 1,)."""
        shape = self.shapes[branch]
        return np.asarray(np.real(np.sum(shape.conj() * moved, axis=(-2, -1))) / np.sum(np.abs(shape) ** 2))

    def _weights(self, changes: Complexes, branch: int) -> Complexes:
        """Return changes (P + 1, J) over λ_j − λ_l, 0 for the branch itself."""
        self.refuse_mixed(branch)
        gaps, same = self._gaps(branch)
        return np.where(same, 0.0, changes / np.where(same, 1.0, gaps))

    def refuse_mixed(self, branch: int) -> None:
        """Raise ValueError where another branch of the same frequency mixes with a branch."""
        same = self._gaps(branch)[1] & (np.arange(len(self.frequencies)) != branch)
        others = np.abs(self.changes[:, same, branch]), np.abs(self.changes[:, branch, same])
        if np.any(np.maximum(*others) > _MIXED * np.abs(self.changes).max(axis=(1, 2))[:, None]):
            raise TheoryError(f"branch {branch} has the frequency of another one here, and mixes with it")

    def _gaps(self, branch: int) -> tuple[Floats, NDArray[np.bool_]]:
        """Return λ_j − λ_l of a branch, and where it is 0."""
        squares = self.frequencies**2
        gaps = squares[branch] - squares
        return gaps, np.abs(gaps) < _SAME * squares.max()


@dataclass(frozen=True)
class Resonance:
    """A resonance 2ω_i(x) = ω_j(2x) of a spot, with total derivatives by its numbers.

    Attributes
    ----------
    wavenumber : x.
    frequency : ω_i.
    growth : of the second harmonic in a period, in the amplitude of the wave per length of the spot.
    """

    wavenumber: Value
    frequency: Value
    growth: Value


def resonance(place: Place, values: ArrayLike, branch: int, target: int, near: float) -> Resonance:
    """Return the resonance of a branch with a target near a wave number, by Newton's method.

    Raises ValueError if there is none, or none that the method finds from there.
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
    """Return the forces (B, 6) at 2k that run with the square of a field."""
    one, other = _strains(crystal.bonds, k, field)
    first, second, both = (crystal.bonds.running(*pair) for pair in ((one, one), (other, other), (one, other)))
    return _gathered(crystal, 2 * k, (first - second, 2 * both))


def _strains(bonds: Bonds, k: NDArray[Any], field: Pair) -> tuple[Strain, Strain]:
    """Return the deformation of the contacts in the real and in the imaginary part of a field e^{ik·r}."""
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
    """Return the forces (..., B, 6) on spheres of the real and the imaginary part of those at both ends."""
    cosine, sine = (each[:, None] for each in _turns(crystal.bonds, k))
    sine = sine * np.array([[1.0], [-1.0]])
    one, other = ends
    turned = one * cosine - other * sine, other * cosine + one * sine
    real, imaginary = (crystal.bonds.gather(each, np.zeros(3), len(crystal)) for each in turned)
    return real, imaginary


def _turns(bonds: Bonds, k: NDArray[Any]) -> Pair:
    """Return cosine and sine (C, 1) of the phase from the middle of a contact to its end."""
    phase = 0.5 * (bonds.apart @ k)[:, None]
    return np.cos(phase), np.sin(phase)
