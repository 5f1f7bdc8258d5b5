"""The frequency of a mode depends on its amplitude, Ω(a) = Ω + σa², and second order can follow it.

Second order leaves a fundamental that runs at the linear frequency. The true one drifts away from it by the phase
σa²τ, which is the largest error of second order in the fundamental: 1.8e-2 of the first harmonic of q at ξ=2.127,
a = 0.2, τ ≤ 120 (ν=0.17), of which `shifted_second_order` leaves 5.0e-4.

`analysis.theory.third_order` has σ, for any crystal: the cubic springs of the contacts, the static field, and the wave
X e^{2iϑ} that the wave makes at 2k, a sum over the modes j there, act on the wave again,

    σ = σ_s + Σ_j c_j/(w_j² − 4Ω²)

TR and RT along y soften; L stiffens at long waves, where the wave it generates dominates, and softens at short ones.

σ has a pole on a resonance 2Ω = w_j, but not the wave: the start launches free waves ±w_j that cancel the generated one
at τ=0, so that the fundamental feels nothing of it at first. With these, which act on it out of tune by δ± = 2Ω ∓ w_j,
its amplitude relative to the linear wave is

    ln A = −ia²{σ_s τ + Σ_j (c_j/2w_j)[(E(δ₊) − τ)/δ₊ − (E(δ₋) − τ)/δ₋]},   E(x) = ∫₀^τ e^{ixt} dt

Far from resonance the free waves leave a bounded ripple on the drift −iσa²τ; on resonance the sum is ln A ≈ a²ghτ²/2,
the start of the sech of `resonance.two_mode` (gh < 0).

Breaks where |ln A| stops being small near the resonance (a = 0.2: τ ≳ 120; `resonance.three_mode` goes on), and for L
at small ξ once it steepens. Cubic terms of the geometry, of relative order η, are left out. The incremental law and
dashpots are refused.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.second_order import Mixed
from analysis.theory.second_order import Wave as Linear
from analysis.theory.third_order import shift_by
from analysis.theory.wave import Wave, second_harmonic

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


_MET = 1e-14  # share of a frequency, the rounding of modes, within which a resonance is met


class Shift(NamedTuple):
    """σ_s of springs and static field, and by mode at 2k (J,): its w_j and c_j, which are regular on resonance."""

    springs: float
    frequencies: Floats
    through: Floats


def shift_parts(wave: Wave) -> Shift:
    """Return the parts of σ of a wave, whose amplitude and phase do not enter.

    Raises ValueError for the incremental law and for dashpots.
    """
    wave.contact.refuse_dashpots()
    crystal, one = wave.crystal, wave.linear
    still = Mixed(crystal, one, one.reversed)
    static = Linear(still.wavevector, still.frequency, 0.5 * still.static())
    springs = shift_by(crystal, one, static=static, cubic=True)
    twice = wave.doubled
    made = [
        Linear(twice.wavevector, twice.frequency, 0.5 * share * shape)
        for share, shape in zip(twice.steady, twice.targets.shapes, strict=True)
    ]
    through = [float(shift_by(crystal, one, doubled=each)) for each in made]
    return Shift(float(springs), twice.targets.frequencies, np.array(through))


def frequency_shift(wave: Wave) -> float:
    """Return σ of Ω(a) = Ω + σa², rad per unit of τ, a = D0/Δ0.

    Raises ValueError exactly on resonance, for the incremental law and for dashpots.

    Breaks near the resonance, where σ is what the fundamental would do after τ ≫ 1/|δ₊|, if it lived to see it.
    The error of Ω(a) is of order a⁴.
    """
    springs, natural, through = shift_parts(wave)
    twice = 2 * wave.mode.frequency
    if np.any(np.abs(natural - twice) < _MET * twice):
        raise ValueError(f"wavenumber = {wave.mode.wavenumber} is on resonance: the frequency shift is infinite")
    return float(springs + np.sum(through / ((natural - twice) * (natural + twice))))


def slow_amplitude(wave: Wave, tau: ArrayLike) -> Complexes:
    """Return A(τ) of the fundamental A e^{iϑ}, A(0) = 1, of the shape of tau; regular on resonance and at any ξ."""
    times, twice = np.asarray(tau, dtype=float), 2 * wave.mode.frequency
    springs, natural, through = shift_parts(wave)
    turned = springs * times + 0j
    for w, each in zip(natural, through, strict=True):
        turned += each / (2 * w) * (_ripple(twice - w, times) - _ripple(twice + w, times))
    return np.asarray(np.exp(-1j * wave.amplitude**2 * turned), dtype=np.complex128)


def _ripple(x: float, tau: Floats) -> Complexes:
    """(E(x) − τ)/x, which is iτ²/2 at x = 0."""
    z = np.asarray(1j * x * tau, dtype=np.complex128)
    small = np.abs(z) < 1e-3
    exact = np.where(small, 0, (np.expm1(z) - z) / np.where(small, 1, z) ** 2)
    near_zero = 0.5 + z / 6 + z**2 / 24 + z**3 / 120
    return np.asarray(1j * tau**2 * np.where(small, near_zero, exact), dtype=np.complex128)


def shifted_second_order(wave: Wave, tau: ArrayLike, row: float = 0) -> tuple[Floats, Floats, Floats]:
    """Return p, q, φ in units of D0 to second order with the fundamental times `slow_amplitude`.

        q = Re Q A e^{iϑ},   φ = Re i f A e^{iϑ},   p = Re P A e^{iϑ} + p_SH

    p_SH is left as it is. Its generated wave does follow A², but its free waves are shifted as well, by the fundamental
    they run in. To move one without the other halves the error of p at ξ=0.802 and doubles it at ξ=1.4 (TR, a = 0.2);
    `resonance.three_mode` moves both.

    Breaks in p as second order does. What remains in q and φ is their third harmonic and free waves, bounded (unless
    RT(3ξ) resonates) and of relative order a²: at ξ=2.127, a = 0.2, τ ≤ 120 they leave 3.4e-4 of q in row 0.
    """
    mode, times = wave.mode, np.asarray(tau, dtype=float)
    moved = slow_amplitude(wave, times) * np.exp(1j * (mode.wavenumber * row - mode.frequency * times + wave.phase))
    p, q, phi = second_harmonic(wave, times, row)
    return mode.p * moved.real + p, mode.q * moved.real + q, -mode.f * moved.imag + phi
