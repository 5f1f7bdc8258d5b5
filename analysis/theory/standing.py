"""The second harmonic of a standing wave, such as a laser-induced transient grating leaves, in closed form.

Two waves of half the amplitude run against each other along y; the lattice is let go at rest at τ = 0. In units of D0,

    q = Q cos θ cos Ωτ,  φ = −f sin θ cos Ωτ (TR, RT)    or    p = cos θ cos Ωτ (L),    θ = ξn + phase,

is the linear wave. The sources of p are squares of it, so they have the space of the running wave's, frozen at its
start, times cos²Ωτ:

    p_SH = −(ε/2) G sin 2θ Z(τ),    Z'' + w̃²Z = cos²Ωτ,  Z(0) = Z'(0) = 0,    w̃ = Ω_L(2ξ) = speed·sin ξ
    Z = τ² [sinc²(w̃τ/2) + sinc((w̃+2Ω)τ/2) sinc((w̃−2Ω)τ/2)]/4,    sinc x = sin x/x
    G = sin ξ Q[α sin²(ξ/2) Q − (β/√3) sin ξ f] (TR, RT),    G = −longitudinal·sin ξ sin²(ξ/2) (L)

The first part of Z is the answer to the mean of cos², a static push; the second grows as τ on the resonance 2Ω = w̃.
p_SH vanishes where cos θ = 0 and where sin θ = 0, at the nodes *and* the antinodes of the fundamental, and has twice
its wave number. Contacts start as those of the running wave do, displaced alike, and keep the same static force
(`second_harmonic._start_wave`), which no motion after τ = 0 enters.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.second_harmonic import Mode, Ratios, second_harmonic

Floats = NDArray[np.float64]


def standing(
    mode: Mode, ratios: Ratios, amplitude: float, tau: ArrayLike, row: ArrayLike = 0, phase: float = 0.0
) -> tuple[Floats, Floats, Floats]:
    """Displacements p, q, φ in units of D0 of a standing wave to second order: the mode, and p_SH of the module.

    The two running waves of half the amplitude each make a quarter of `second_harmonic`, at ±Ω; their product is the
    same pattern at frequency 0 and makes half of that. The sum is the formula above, start of the contacts included.

    Parameters
    ----------
    mode : of `second_harmonic.mode`, made from the ratios.
    ratios : constants of the lattice, any geometry and shear law `second_harmonic` takes.
    amplitude : a = D0/Δ0 of the standing wave, twice that of either running wave.
    tau, row : times and rows n, of shapes that broadcast.
    phase : rad; 0 puts an antinode of p and q at row 0.

    Breaks where the running wave's `second_harmonic` does. The relative errors of p (TR, RT), q and φ fall as a².

    Source: eqP1TR and eqP1 of the paper, with the initial condition of rest; not in the paper.
    """
    tau = np.asarray(tau, dtype=float)
    theta = mode.wavenumber * np.asarray(row, dtype=float) + phase
    forward, frozen, backward = (
        # Where sin 2θ = 1
        second_harmonic(replace(mode, frequency=frequency), ratios, amplitude, tau, phase=np.pi / 4)
        for frequency in (mode.frequency, 0.0, -mode.frequency)
    )
    swing = np.cos(mode.frequency * tau)
    p = mode.p * np.cos(theta) * swing + np.sin(2 * theta) * (frozen / 2 + (forward + backward) / 4)
    return p, mode.q * np.cos(theta) * swing, -mode.f * np.sin(theta) * swing
