"""Third order of one wave in any crystal: the shift of its frequency, and the forced third harmonic.

At third order the cubic part of the law acts on the wave, and the quadratic part acts on the wave together with the
fields that the wave generates at second order, u₂ = ½Re X₂e^{2iα} + ½Re X₀. With the forces C and N of
`granular_analysis.theory.bonds.Bonds.cubic` and `quadratic`, and with z = U e^{iα}, the forces are

    G₁ = ¾C(z, z, z*) + ½N(X₂, z*) + N(X₀, z),      G₃ = ¼C(z, z, z) + ½N(X₂, z)

G₁ runs with the wave and changes its frequency by δω = −U†G₁/(2ω U†MU), in proportion to the square of the amplitude.
G₃ forces the third harmonic. X₂ is a sum over the modes j at 2k, so

    δω = δω_s + Σ_j c_j/(w_j² − 4ω²)

TR and RT along y soften; L stiffens at long wavelengths, where the generated wave dominates, and softens at short ones.

δω has a pole on a resonance 2ω = w_j, but the motion is regular: the start launches free waves ±w_j that cancel the
generated wave at t = 0, so the wave is not affected at first. The free waves act on the wave with the detunings
δ± = 2ω ∓ w_j. In total the wave is multiplied by e^{−iθ},

    θ(t) = δω_s t + Σ_j (c_j/2w_j)[(E(δ₊) − t)/δ₊ − (E(δ₋) − t)/δ₋],   E(x) = ∫₀ᵗ e^{ixs} ds

Far from resonance the free waves leave a bounded ripple on the drift δω t. On resonance θ grows as t², the start of the
sech of `granular_analysis.theory.resonance.two_mode`.

**The cubic part** C contains the third order of the law, of the true direction N = (ℓn + w)/L and length L = ℓ + X of
the contact, and of the slip, which follows both (`granular_analysis.theory.bonds` has the second order). All are
functions of α, and with ′ = d/dα

    force on i  S − f(δ − X) N,    torques over R  [arm/R + X/2R] N × S
    secant law        S = k(δ − X) s,   s′ = L N′ − Φ′ × N − N (N′·s)
    incremental law   S′ = k(δ − X) [L N′ − Φ′ × N] − N (N′·S)

including the slip or force that a start leaves in a contact, averaged over the phase of the start. These equations are
expanded order by order at a few values of α.

Two effects are left out. The start leaves a static grating at 2k, on which a backward wave grows along y: by at most
0.01 η a² of the wave per τ, and by 1.3e-3 a² under the incremental law. Slip that winds up makes the spheres creep.

When it breaks: where |θ| is no longer small.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.bonds import Bonds, Quadratic, Strain, crossed
from granular_analysis.theory.crystal import Crystal
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.second_order import Mixed, Wave

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_MET = 1e-14  # relative detuning below which a wave is exactly on resonance: the rounding of modes
_ANGLES = 2 * np.pi * np.arange(8) / 8  # values of α; a product of three waves has harmonics up to 3
_TURNS = np.array([0, 1, 2, 3, 0, -3, -2, -1])  # harmonics resolved by these α; the 4th, which is absent, counts as 0
_SLOW = 1e-6  # least frequency of a mode at 2k, in 2ω; for modes of frequency 0 this changes θ by 1e-12


class Shift(NamedTuple):
    """Frequency shift of waves (...) in its parts.

    Attributes
    ----------
    springs : δω_s (...), by the cubic springs and the static field.
    natural : w_j (..., J), frequencies of the modes at 2k.
    through : c_j (..., J), coefficients of the modes at 2k.
    twice : 2ω (...).
    """

    springs: Floats
    natural: Floats
    through: Floats
    twice: Floats

    @property
    def total(self) -> Floats:
        """Return δω (...), the shift of the frequency for t ≫ 1/δ₊; ValueError exactly on resonance."""
        twice = self.twice[..., None]
        if np.any((np.abs(self.natural - np.abs(twice)) < _MET * np.abs(twice)) & (self.through != 0)):
            raise TheoryError("the wave is on resonance, where the frequency shift is infinite")
        return np.asarray(self.springs + np.sum(self.through / ((self.natural - twice) * (self.natural + twice)), -1))

    def phase(self, time: ArrayLike) -> Complexes:
        """Return θ (T,) of one wave at times (T,): third order multiplies the wave by e^{−iθ}."""
        t = np.asarray(time, dtype=float)[:, None]
        w = np.maximum(self.natural, _SLOW * np.abs(self.twice))
        parts = self.through / (2 * w) * (_ripple(self.twice - w, t) - _ripple(self.twice + w, t))
        return np.asarray(self.springs * t[:, 0] + np.sum(parts, axis=1))


def _ripple(x: Floats, time: Floats) -> Complexes:
    """Return (E(x) − t)/x, with the limit it²/2 at x = 0."""
    z = np.asarray(1j * x * time, dtype=np.complex128)
    small = np.abs(z) < 1e-3
    exact = np.where(small, 0, (np.expm1(z) - z) / np.where(small, 1, z) ** 2)
    near_zero = 0.5 + z / 6 + z**2 / 24 + z**3 / 120
    return np.asarray(1j * time**2 * np.where(small, near_zero, exact), dtype=np.complex128)


def shift(crystal: Crystal, wave: Wave) -> Shift:
    """Return the parts of δω for waves (...) with their amplitudes; δω is proportional to the square of the amplitude.

    Raises ValueError for the potential law.
    """
    bonds, twice, static = crystal.bonds, Mixed(crystal, wave, wave), _static(crystal, wave)
    one, back = (bonds.strain(each.shape, each.wavevector) for each in (wave, wave.reversed))
    springs, _ = cubic(bonds, one)
    springs = springs + 2 * _steady(bonds, _strain(crystal, static), one, 0 * wave.frequency, wave.frequency)
    made = np.moveaxis(0.5 * twice.steady[..., None, None] * twice.targets.shapes, -3, 0)
    through = [
        _steady(bonds, bonds.strain(each, twice.wavevector), back, twice.frequency, -wave.frequency) for each in made
    ]
    acting = np.stack([_turning(crystal, wave, ends) for ends in (springs, *through)], axis=-1)
    return Shift(acting[..., 0], twice.targets.frequencies, acting[..., 1:], twice.frequency)


def _turning(crystal: Crystal, wave: Wave, ends: Complexes) -> Floats:
    """Return −U†G/(2ω U†MU) (...) for forces G given at the ends of the contacts."""
    force = crystal.bonds.gather(ends, wave.wavevector, len(crystal))
    # The dual of the wave is its shape over U†MU
    mass = crystal.mass * (np.arange(6)[None] == np.array(crystal.freedoms)[:, None]).any(axis=0)
    share = np.sum(wave.shape.conj() * force, axis=(-2, -1)) / np.sum(mass * np.abs(wave.shape) ** 2, axis=(-2, -1))
    return np.asarray(-np.real(share) / (2 * wave.frequency))


def third_harmonic(crystal: Crystal, wave: Wave) -> Complexes:
    """Return the force G₃ (..., B, 6) on the third harmonic of waves with their amplitudes, e^{3iα}.

    Raises ValueError for the potential law.
    """
    bonds, twice = crystal.bonds, Mixed(crystal, wave, wave)
    doubled = Wave(twice.wavevector, twice.frequency, 0.5 * twice.forced())
    one = bonds.strain(wave.shape, wave.wavevector)
    _, ends = cubic(bonds, one)
    ends = ends + _steady(bonds, _strain(crystal, doubled), one, doubled.frequency, wave.frequency)
    return bonds.gather(ends, 3 * wave.wavevector, len(crystal))


def cubic(bonds: Bonds, strain: Strain) -> tuple[Complexes, Complexes]:
    """Return the third-order forces ∝ e^{iα} and ∝ e^{3iα} at the ends of the contacts, (..., C, 2, 6) each.

    Raises ValueError for the potential law.
    """
    if bonds.shear_law == "potential":
        raise TheoryError(f"law = {bonds.shear_law!r} is not in the cubic forces; allowed: 'secant', 'incremental'")
    phases = np.exp(1j * _ANGLES).reshape(-1, *(1,) * strain.slip.ndim)
    path = _path(bonds, strain, phases)
    law, n, normals, (x, longer, _) = bonds.law, bonds.normal, path.normals, path.lengths
    f, f1, f2, f3 = (each[:, None] for each in (law.push, law.stiffness, law.curvature, law.third))
    pushes = -f1 * x, -f1 * longer + f2 * x**2 / 2, -f1 * path.lengths[2] + f2 * x * longer - f3 * x**3 / 6
    sheared = _sheared(bonds, path)
    force = sheared[2] - f * normals[2] - pushes[0] * normals[1] - pushes[1] * normals[0] - pushes[2] * n
    first, second = crossed(n, sheared[0]), crossed(n, sheared[1]) + crossed(normals[0], sheared[0])
    third = crossed(n, sheared[2]) + crossed(normals[0], sheared[1]) + crossed(normals[1], sheared[0])
    couples = bonds.arms[..., None] * third[..., None, :]
    couples = couples + bonds.widening[..., None] * (x * second + longer * first)[..., None, :]
    ends = bonds.at_ends(force, couples)
    onward, tripled = (2 * np.mean(phases[..., None] ** -m * ends, axis=0) for m in (1, 3))
    return onward, tripled


class _Path(NamedTuple):
    """Motion of the contacts at A values of α, each (A, ..., C, 1 or 3).

    Attributes
    ----------
    lengths : three orders of X.
    normals : three orders of N.
    slides : three orders of LN′ − Φ′ × N.
    slip : first order of s.
    loaded : second order of the slip s that a start loads.
    """

    lengths: tuple[Floats, Floats, Floats]
    normals: tuple[Floats, Floats, Floats]
    slides: tuple[Floats, Floats, Floats]
    slip: Floats
    loaded: Floats


def _path(bonds: Bonds, strain: Strain, phases: Complexes) -> _Path:
    n, c = bonds.normal, bonds.curving[:, None]
    x, y, slip = (np.real(phases * each) for each in (strain.stretch[..., None], strain.sideways, strain.slip))
    turned = np.real(phases * (strain.twist[..., None] * n)) - crossed(y - slip, n)  # Φ, as y − s = Φ × n
    square = _dot(y, y)
    lengths = x, c * square / 2, -(c**2) * x * square / 2
    # ℓN instead of N, because it is finite also where 1/ℓ is 0
    steep = y, -c * (x * y + n * square / 2), c**2 * (x**2 * y - square * y / 2 + x * square * n)
    normals = c * steep[0], c * steep[1], c * steep[2]
    (bend, bent), turning = map(_slope, normals[:2]), _slope(turned)
    slides = (
        _slope(steep[0]) - crossed(turning, n),
        _slope(steep[1]) + x * bend - crossed(turning, normals[0]),
        _slope(steep[2]) + x * bent + lengths[1] * bend - crossed(turning, normals[1]),
    )
    # The start loads the slip in one step, along the tangents of the displaced lattice
    return _Path(lengths, normals, slides, slip, -x * normals[0] - crossed(turned, normals[0]))


def _sheared(bonds: Bonds, path: _Path) -> list[Floats]:
    """Return three orders of the shear force S."""
    (x, longer, _), law = path.lengths, bonds.law
    k, softer, soft = (each[:, None] for each in (law.shear, law.shear_growth, law.shear_curvature))
    stiffness = k, -softer * x, -softer * longer + soft * x**2 / 2

    def times(values: Sequence[Floats]) -> list[Floats]:
        """Return three orders of k(δ − X) times values, which have no order 0."""
        return [np.sum([stiffness[b] * values[m - b] for b in range(m + 1)], axis=0) for m in range(3)]

    if bonds.shear_law == "secant":
        return times(_carried(path.slides, bonds.normal, path.normals, path.slip, path.loaded))
    first, left, _ = times([path.slip, path.loaded, 0 * path.slip])
    return _carried(times(path.slides), bonds.normal, path.normals, first, left)


def _carried(
    rates: Sequence[Floats], n: Floats, normals: Sequence[Floats], first: Floats, left: Floats
) -> list[Floats]:
    """Return three orders of a vector that is perpendicular to N, is carried with N, and has these rates by α.

    Parameters
    ----------
    rates : three orders of the rates
    n, normals : N at rest, and three orders of its change
    first : first order of the vector
    left : second order of the vector that a start loads
    """

    def across(values: Floats, along: Floats) -> Floats:
        return values - n * (_dot(n, values) + along)

    second = across(_integral(rates[1]) + np.mean(left, axis=0), _dot(normals[0], first))
    third = _integral(rates[2] - normals[0] * _dot(_slope(normals[0]), first))
    return [first, second, across(third, _dot(normals[0], second) + _dot(normals[1], first))]


def _slope(values: Floats) -> Floats:
    """Return the derivative by α of values (A, ...)."""
    return _by_harmonic(values, 1j * _TURNS)


def _integral(values: Floats) -> Floats:
    """Return the integral by α, with mean 0, of values (A, ...) minus their mean."""
    return _by_harmonic(values, np.divide(-1j, _TURNS, out=np.zeros(len(_TURNS), dtype=complex), where=_TURNS != 0))


def _by_harmonic(values: Floats, factors: Complexes) -> Floats:
    shaped = factors.reshape(-1, *(1,) * (values.ndim - 1))
    return np.asarray(np.real(np.fft.ifft(shaped * np.fft.fft(values, axis=0), axis=0)))


def _dot(one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
    return np.sum(one * other, axis=-1, keepdims=True)


def _static(crystal: Crystal, wave: Wave) -> Wave:
    """Return the static field of waves, as waves of frequency 0."""
    still = Mixed(crystal, wave, wave.reversed)
    return Wave(still.wavevector, still.frequency, 0.5 * still.static())


def _steady(bonds: Bonds, one: Strain, other: Strain, *frequencies: Floats) -> Complexes:
    """Return the steady second-order forces (..., C, 2, 6) of two waves whose frequencies do not add up to 0."""
    made: Quadratic = bonds.quadratic(one, other, (frequencies[0], frequencies[1]))
    return made.running + 1j * made.winding / np.asarray(sum(frequencies))[..., None, None, None]


def _strain(crystal: Crystal, wave: Wave) -> Strain:
    return crystal.bonds.strain(wave.shape, wave.wavevector)
