"""Dissipation by dashpots in a chain of spheres that just touch: in a collision, in a wave, in any motion.

The dashpots of `cases.solitary.chain` have no velocity scale: if velocities are multiplied by λ, times by λ^{−1/5} and
overlaps by λ^{4/5}, the equations do not change. So a solitary wave loses the same share of its energy to each contact
that it passes,

    dE/dn = −∫ η δ^{1/4} δ'² dt = −2Γ E,   v_n ∝ e^{−Γn},   Γ = 0.70136 ζ,   ζ = −ln e/√(π² + ln² e)

to first order in ζ, with the shape of the wave without loss. Spheres with gaps, which collide in pairs, pass on
(1 + e)/2 of their velocity: their Γ = −ln((1 + e)/2) is more than twice as large.

Γ is too large by the share 6ζ: 2 % for e = 0.99, 20 % for 0.9, where the wave still decays exponentially. It breaks
below about e = 0.85, where a broad pulse that decays as a power of n absorbs the wave. Dashpots with another power of
δ, such as the linear ones of A. Rosas, A. H. Romero, V. F. Nesterenko & K. Lindenberg, Phys. Rev. Lett. 98, 164301
(2007), do not have one Γ for all heights.
"""

from functools import cache

import numpy as np

from cases.solitary.chain import Array, Chain, Floats, dashpot_forces, rates
from cases.solitary.travelling import solitary_wave


def power(chain: Chain, u: Array, v: Array) -> Array:
    """Return the power that each dashpot dissipates, η_j δ_j^{1/4} δ_j'² (…, n + 1), in states (…, n)."""
    return dashpot_forces(chain, u, v) * rates(v)


def damping_ratio(restitution: float) -> float:
    """Return ζ = −ln e/√(π² + ln² e) for a restitution e in (0, 1]; raise ValueError for other values."""
    if not 0 < restitution <= 1:
        raise ValueError(f"restitution must be above 0 and at most 1, not {restitution}")
    loss = -np.log(restitution)
    return float(loss / np.hypot(np.pi, loss))


def decay(restitution: float) -> float:
    """Return Γ of a solitary wave in equal spheres that just touch, with v_n ∝ e^{−Γn}, to first order in ζ."""
    return _per_ratio() * damping_ratio(restitution)


@cache
def _per_ratio() -> float:
    """Return Γ/ζ = √5 √(μA) V ∫ r^{1/4} r'² ds/2E of the wave r(s) with A = m = 1, μ = 1/2."""
    wave = solitary_wave(1.0)
    step = wave.place[1] - wave.place[0]
    orders = np.fft.rfftfreq(wave.place.size, step) * 2j * np.pi
    slope: Floats = np.fft.irfft(orders * np.fft.rfft(wave.overlap), wave.place.size)
    # Sums over a period equal integrals to rounding. The energy of the chain is averaged over the places of the wave
    energy = step * np.sum(wave.velocity**2 / 2 + 0.4 * wave.overlap**2.5)
    lost = np.sqrt(2.5) * wave.speed * step * np.sum(wave.overlap**0.25 * slope**2)
    return float(lost / (2 * energy))
