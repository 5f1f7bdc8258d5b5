"""Third order of one wave in any crystal: the shift of its frequency, and the third harmonic that runs with it.

The cubic part of the law acts on the wave, and the quadratic part on the wave and the fields that it has made to second
order, u₂ = ½Re X₂e^{2iα} + ½Re X₀. With the forces C and N of `analysis.theory.bonds.Bonds.cubic` and
`quadratic`, for z = U e^{iα} these are

    G₁ = ¾C(z, z, z*) + ½N(X₂, z*) + N(X₀, z),      G₃ = ¼C(z, z, z) + ½N(X₂, z)

The first runs with the wave and changes its frequency by δω = −U†G₁/(2ω U†MU), which grows as the square of its
amplitude; the second forces the third harmonic. X₂ is a sum over the modes j at 2k, so that

    δω = δω_s + Σ_j c_j/(w_j² − 4ω²)

TR and RT along y soften; L stiffens at long waves, where the wave it generates dominates, and softens at short ones.

δω has a pole on a resonance 2ω = w_j, but not the wave: the start launches free waves ±w_j that cancel the generated
one at t = 0, so that the wave feels nothing of it at first. With these, which act on it out of tune by δ± = 2ω ∓ w_j,
it is multiplied by e^{−iθ},

    θ(t) = δω_s t + Σ_j (c_j/2w_j)[(E(δ₊) − t)/δ₊ − (E(δ₋) − t)/δ₋],   E(x) = ∫₀ᵗ e^{ixs} ds

Far from resonance the free waves leave a bounded ripple on the drift δω t; on resonance θ grows as t², the start of the
sech of `analysis.theory.resonance.two_mode`.

The geometry's own cubic terms are left out: along y, 5δ/2R of the third harmonic of TR at ξ = 0.802, 0.1 % in the
paper's silica. So is memory, and every law but the secant one is refused.
When it breaks: where |θ| is no longer small.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.bonds import Strain
from analysis.theory.crystal import Crystal
from analysis.theory.second_order import Mixed, Wave

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_MET = 1e-14  # share of a frequency, the rounding of modes, within which a resonance is met
_SLOW = 1e-6  # a mode of frequency 0 at 2k is taken as one of this share of 2ω, which changes θ by 1e-12


class Shift(NamedTuple):
    """Parts of δω (...) of waves: δω_s of springs and static field; w_j and c_j (..., J) of the modes at 2k; and 2ω."""

    springs: Floats
    natural: Floats
    through: Floats
    twice: Floats

    @property
    def total(self) -> Floats:
        """Return δω (...), what the wave is out of tune for t ≫ 1/δ₊; ValueError exactly on resonance."""
        twice = self.twice[..., None]
        if np.any((np.abs(self.natural - np.abs(twice)) < _MET * np.abs(twice)) & (self.through != 0)):
            raise ValueError("the wave is on resonance, where the frequency shift is infinite")
        return np.asarray(self.springs + np.sum(self.through / ((self.natural - twice) * (self.natural + twice)), -1))

    def phase(self, time: ArrayLike) -> Complexes:
        """Return θ (T,) of one wave at times (T,), by which third order multiplies it with e^{−iθ}."""
        t = np.asarray(time, dtype=float)[:, None]
        w = np.maximum(self.natural, _SLOW * np.abs(self.twice))
        parts = self.through / (2 * w) * (_ripple(self.twice - w, t) - _ripple(self.twice + w, t))
        return np.asarray(self.springs * t[:, 0] + np.sum(parts, axis=1))


def _ripple(x: Floats, time: Floats) -> Complexes:
    """Return (E(x) − t)/x, which is it²/2 at x = 0."""
    z = np.asarray(1j * x * time, dtype=np.complex128)
    small = np.abs(z) < 1e-3
    exact = np.where(small, 0, (np.expm1(z) - z) / np.where(small, 1, z) ** 2)
    near_zero = 0.5 + z / 6 + z**2 / 24 + z**3 / 120
    return np.asarray(1j * time**2 * np.where(small, near_zero, exact), dtype=np.complex128)


def shift(crystal: Crystal, wave: Wave) -> Shift:
    """Return the parts of δω of waves (...) with their amplitudes, as the square of which they grow.

    Raises ValueError for the incremental law, and where slip winds up.
    """
    _refuse_incremental(crystal)
    bonds, twice, static = crystal.bonds, Mixed(crystal, wave, wave), _static(crystal, wave)
    one, back = (bonds.strain(each.shape, each.wavevector) for each in (wave, wave.reversed))
    springs = 0.75 * bonds.cubic(one, one, back)
    springs = springs + 2 * bonds.quadratic(_strain(crystal, static), one, (0.0, wave.frequency)).running
    made = np.moveaxis(0.5 * twice.steady[..., None, None] * twice.targets.shapes, -3, 0)
    through = [
        bonds.quadratic(bonds.strain(each, twice.wavevector), back, (twice.frequency, -wave.frequency)).running
        for each in made
    ]
    acting = np.stack([_turning(crystal, wave, ends) for ends in (springs, *through)], axis=-1)
    return Shift(acting[..., 0], twice.targets.frequencies, acting[..., 1:], twice.frequency)


def _turning(crystal: Crystal, wave: Wave, ends: Complexes) -> Floats:
    """Return −U†G/(2ω U†MU) (...) of the forces at the ends of the contacts."""
    force = crystal.bonds.gather(ends, wave.wavevector, len(crystal))
    # The dual of the wave itself: its shape, over its energy
    mass = crystal.mass * (np.arange(6)[None] == np.array(crystal.freedoms)[:, None]).any(axis=0)
    share = np.sum(wave.shape.conj() * force, axis=(-2, -1)) / np.sum(mass * np.abs(wave.shape) ** 2, axis=(-2, -1))
    return np.asarray(-np.real(share) / (2 * wave.frequency))


def third_harmonic(crystal: Crystal, wave: Wave) -> Complexes:
    """Return the force G₃ (..., B, 6) on the third harmonic of waves with their amplitudes, e^{3iα}.

    Raises ValueError for the incremental law.
    """
    _refuse_incremental(crystal)
    bonds, twice = crystal.bonds, Mixed(crystal, wave, wave)
    doubled = Wave(twice.wavevector, twice.frequency, 0.5 * twice.forced())
    one = bonds.strain(wave.shape, wave.wavevector)
    ends = 0.25 * bonds.cubic(one, one, one)
    ends = ends + bonds.quadratic(_strain(crystal, doubled), one, (doubled.frequency, wave.frequency)).running
    return bonds.gather(ends, 3 * wave.wavevector, len(crystal))


def _static(crystal: Crystal, wave: Wave) -> Wave:
    """Return the static field of waves, as waves."""
    still = Mixed(crystal, wave, wave.reversed)
    return Wave(still.wavevector, still.frequency, 0.5 * still.static())


def _refuse_incremental(crystal: Crystal) -> None:
    if crystal.bonds.shear_law != "secant":
        raise ValueError(f"law = {crystal.bonds.shear_law!r} is not in the cubic forces; allowed: 'secant'")


def _strain(crystal: Crystal, wave: Wave) -> Strain:
    return crystal.bonds.strain(wave.shape, wave.wavevector)
