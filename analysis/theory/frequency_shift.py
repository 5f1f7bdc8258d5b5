"""The frequency of a mode depends on its amplitude, Ω(a) = Ω + σa², and in closed form second order can follow it.

Second order (`second_harmonic`) leaves a fundamental that runs at the linear frequency. The true one drifts away from
it by the phase σa²τ, which is the largest error of second order in the fundamental: 1.8e-2 of the first harmonic of q
at ξ=2.127, a = 0.2, τ ≤ 120 (ν=0.17), of which `shifted_second_order` leaves 5.0e-4.

Harmonic balance at order a³ needs two things that act on harmonic 1 again. In D0, with ϑ counted from the middle of a
contact, the fundamental has dq = −Dq sin ϑ, σ = φ₊+φ = −Sg sin ϑ (TR, RT) or dp = −Dp sin ϑ (L), where

    Dq = 2Q sin(ξ/2),   Sg = 2f cos(ξ/2),   Dp = 2 sin(ξ/2),   T = (√3/2)Dq − Sg (slip).

1. The generated wave, dp = aY cos 2ϑ with Y = −ε̂ sin ξ P̃1/i, ε̂ = ε/a. Its product with the fundamental is
   aY cos 2ϑ · sin ϑ = −½aY sin ϑ + harmonic 3, so in the ε-terms of the equations of motion dp becomes −½aY.
2. The contacts' cubic springs, N = … − x³/24 and S = … − κtx²/8, with x = ∓Dq sin ϑ/2 and ⟨sin⁴⟩ = 3/8.

The work of both on the mode, over its inertia 2Ω(Q² + Ĩf²) or 2Ω, is the shift:

    TR, RT:  σ = −{(ε̂Y/8)[γDq² − (5/√3)βDqSg + 2βSg²] + (3C/64)Dq²[Dq²/12 + κT²]}/(2Ω(Q² + Ĩf²)),  C = 1/(2(κ+3))
    L:       σ = −ε̂YΩ/4 − 6χΩ³ = ε̂²Ω cos²(ξ/2)/4 − 6χΩ³,  χ = 3(1+κ)/(128(κ+3))

TR and RT soften; L stiffens at long waves, where the wave it generates dominates, and softens at short ones.

σ has a pole on the resonance 2Ω = w̃ = sin ξ, but not the wave: the start launches two free waves (±w̃) that cancel the
generated one at τ=0, so that the fundamental feels nothing of it at first. With these, which act on it out of tune by
δ± = 2Ω ∓ w̃, its amplitude relative to the linear wave is

    d ln A/dτ = −ia²[σ_s + σ_p(1 + r₊e^{iδ₊τ} + r₋e^{iδ₋τ})],  r± = P̃±/P̃1 = ∓δ∓/2w̃

with σ = σ_s + σ_p, of springs and of generated wave. Far from resonance the free waves leave a bounded ripple on the
drift −iσa²τ; on resonance the sum is ln A ≈ a²ghτ²/2, the start of the sech of `resonance.two_mode` (gh < 0).

Breaks where |ln A| stops being small near the resonance (a = 0.2: τ ≳ 120; `resonance.three_mode` goes on), and for L
at small ξ once it steepens.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.second_harmonic import Mode, Ratios, doubled_frequency, nonlinearity, second_harmonic
from analysis.theory.adhesion import refuse_other_laws

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


class Shift(NamedTuple):
    """σ_s of the cubic springs, and σ_p·(w̃² − 4Ω²) of the generated wave, which is regular on resonance."""

    springs: float
    through_p: float


def shift_parts(mode: Mode, ratios: Ratios) -> Shift:
    """The two parts of σ by the equations at the top of this module. Arguments as in `frequency_shift`."""
    refuse_other_laws(ratios)
    kappa, beta, omega, sine = ratios.shear_stiffness, ratios.beta, mode.frequency, np.sin(mode.wavenumber)
    unit, squared = 128 * (ratios.kappa + 3), ratios.speed**2
    s, c = np.sin(mode.wavenumber / 2), np.cos(mode.wavenumber / 2)
    strength = nonlinearity(ratios, 1.0)  # ε̂
    if mode.name == "L":
        chi = 3 * (1 + kappa) / unit
        # In the paper's geometry Y = −ε̂c², and w̃² − 4Ω² = −4s⁴
        through_p = -omega * (ratios.longitudinal * strength * c * s**2) ** 2 / squared
        return Shift(float(-6 * chi * omega**3 / squared**2), float(through_p))
    Dq, Sg = 2 * s * mode.q, 2 * c * mode.f
    T = np.sqrt(3) / 2 * Dq - Sg
    inertia = 2 * omega * (mode.q**2 + ratios.inertia * mode.f**2)
    springs = 3 / unit * Dq**2 * (Dq**2 / 12 + kappa * T**2)
    drive = sine * mode.q * (ratios.alpha * s**2 * mode.q - beta / np.sqrt(3) * sine * mode.f)  # P̃1/i·(w̃² − 4Ω²)
    felt = ratios.gamma * Dq**2 - 5 / np.sqrt(3) * beta * Dq * Sg + 2 * beta * Sg**2
    return Shift(float(-springs / inertia), float(strength**2 * sine * drive * felt / 8 / inertia))


def frequency_shift(mode: Mode, ratios: Ratios) -> float:
    """σ of Ω(a) = Ω + σa², rad per unit of τ, a = D0/Δ0: the equation at the top of this module.

    Parameters
    ----------
    mode : the fundamental, L, TR or RT.
    ratios : constants the mode was made with. The cubic springs are those of the paper's geometry: with
        overlap_ratio η > 0, σ lacks corrections of relative order η.

    Raises
    ------
    ValueError
        Exactly on resonance, where σ is infinite.

    Breaks near the resonance, where σ is what the fundamental would do after τ ≫ 1/|δ₊|, if it lived to see it.
    The error of Ω(a) is of order a⁴.

    Source: not in the paper.
    """
    springs, through_p = shift_parts(mode, ratios)
    below, above = _detunings(mode, ratios)
    if below == 0:
        raise ValueError(f"wavenumber = {mode.wavenumber} is on resonance: the frequency shift is infinite")
    return springs - through_p / (below * above)


def _detunings(mode: Mode, ratios: Ratios) -> tuple[float, float]:
    """δ₊ = 2Ω − w̃ and δ₋ = 2Ω + w̃; of L without the cancellation of 2 sin(ξ/2) − sin ξ at small ξ."""
    w = doubled_frequency(mode, ratios)
    above = 2 * mode.frequency + w
    return 4 * mode.frequency**4 / ratios.speed**2 / above if mode.name == "L" else 2 * mode.frequency - w, above


def slow_amplitude(mode: Mode, ratios: Ratios, amplitude: float, tau: ArrayLike) -> Complexes:
    """A(τ) of the fundamental A e^{iϑ}, A(0) = 1, of the shape of tau; regular on resonance and at any ξ.

        ln A = −ia²{σ_s τ + (σ_p r₊)[E(δ₊) − τ] + (σ_p r₋)[E(δ₋) − τ]},   E(x) = ∫₀^τ e^{ixt} dt

    Arguments and limits as in `shifted_second_order`.
    """
    tau = np.asarray(tau, dtype=float)
    springs, through_p = shift_parts(mode, ratios)
    below, above = _detunings(mode, ratios)
    # σ_p r± = ±through_p/(2w̃δ±): the 1/δ± is in _ripple.
    ripple = through_p / (2 * doubled_frequency(mode, ratios)) * (_ripple(below, tau) - _ripple(above, tau))
    return np.asarray(np.exp(-1j * amplitude**2 * (springs * tau + ripple)), dtype=np.complex128)


def _ripple(x: float, tau: Floats) -> Complexes:
    """(E(x) − τ)/x, which is iτ²/2 at x = 0."""
    z = np.asarray(1j * x * tau, dtype=np.complex128)
    small = np.abs(z) < 1e-3
    exact = np.where(small, 0, (np.expm1(z) - z) / np.where(small, 1, z) ** 2)
    near_zero = 0.5 + z / 6 + z**2 / 24 + z**3 / 120
    return np.asarray(1j * tau**2 * np.where(small, near_zero, exact), dtype=np.complex128)


def shifted_second_order(
    mode: Mode, ratios: Ratios, amplitude: float, tau: ArrayLike, row: float = 0, phase: float = 0.0
) -> tuple[Floats, Floats, Floats]:
    """Displacements p, q, φ in units of D0: `second_harmonic.second_order` with the fundamental times `slow_amplitude`.

        q = Re Q A e^{iϑ},   φ = Re i f A e^{iϑ},   p = Re P A e^{iϑ} + p_SH

    p_SH is left as it is. Its generated wave does follow A², but its free waves are shifted as well, by the fundamental
    they run in. To move one without the other halves the error of p at ξ=0.802 and doubles it at ξ=1.4 (TR, a = 0.2);
    `resonance.three_mode` moves both.

    Parameters
    ----------
    mode, ratios : as in `frequency_shift`.
    amplitude, tau, row, phase : as in `second_harmonic.second_harmonic`.

    Breaks in p as second order does. What remains in q and φ is their third harmonic and free waves, bounded (unless
    RT(3ξ) resonates) and of relative order a²: at ξ=2.127, a = 0.2, τ ≤ 120 they leave 3.4e-4 of q in row 0.
    """
    tau = np.asarray(tau, dtype=float)
    theta = mode.wavenumber * row - mode.frequency * tau + phase
    wave = slow_amplitude(mode, ratios, amplitude, tau) * np.exp(1j * theta)
    p = mode.p * wave.real + second_harmonic(mode, ratios, amplitude, tau, row, phase)
    return p, mode.q * wave.real, -mode.f * wave.imag
