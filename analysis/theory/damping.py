"""Contacts that dissipate: what a dashpot in each does to a plane wave, and which dashpot a restitution coefficient is.

LAMMPS's `damping velocity` adds to a closed contact the force −c·(rate of stretch) along the normal and −c·(rate of
slip) along the tangent (tangential damping factor 1). To first order in c a mode keeps its shape and frequency and
decays as e^{−Γτ}, at half the rate at which its dashpots lose its energy. Per sphere there are three contacts, right
and left to the next row and one within the row, of stretch and slip amplitudes x, t,

    Γ = ½ c Σ (|x|² + |t|²)/(P² + Q² + Ĩf²)

    L:       Γ = 4c sin²(ξ/2)
    TR, RT:  Γ = ½ c (½Dq² + 2T² + 4f²)/(Q² + Ĩf²),   Dq = 2Q sin(ξ/2),   T = (√3/2)Dq − 2f cos(ξ/2)

where T and f are left out if contacts do not resist shear. c is in units of m/t0, t0 the unit of τ.

`damping coeff_restitution` on a Hertz contact is the dashpot √5 ζ (m_eff f_N/δ)^{1/2} ∝ δ^{1/4} with
ζ = −ln e/√(π² + ln² e): two spheres that meet part again with e times their speed. `restitution_viscosity` is its
value at the overlap at rest, where f_N/δ = (2/3)k1.

Breaks where Γ is not small against the distance to the other modes: the error is of relative order Γ². The second
harmonic of a damped wave is in the lattice and the hierarchy only.
"""

import numpy as np

from analysis.second_harmonic import Mode, Ratios, refuse_oblique


def restitution_viscosity(restitution: float, kappa: float) -> float:
    """Viscosity of a Hertz contact at rest, in m/t0, whose collisions have the restitution coefficient e.

        c = √5 ζ √(m k1/3) = √5 ζ/√(6(κ+3)) m/t0,   ζ = −ln e/√(π² + ln² e)

    Parameters
    ----------
    restitution : e in (0, 1].
    kappa : κ of the spheres, which sets t0.

    Raises ValueError for an e outside (0, 1].

    Source: LAMMPS's `GranSubModDampingCoeffRestitution`, whose product of constants √(3/2)·2√(5/6) is √5; m_eff = m/2.
    """
    if not 0.0 < restitution <= 1.0:
        raise ValueError(f"restitution = {restitution} is outside (0, 1]")
    loss = -np.log(restitution)
    return float(np.sqrt(5) * loss / np.hypot(np.pi, loss) / np.sqrt(6 * (kappa + 3)))


def decay_rate(mode: Mode, ratios: Ratios, viscosity: float) -> float:
    """Γ of a linear wave ∝ e^{−Γτ}, per unit of τ: the equation at the top of this module.

    Parameters
    ----------
    mode : the wave.
    ratios : constants the mode was made with.
    viscosity : c in m/t0, of every contact.

    Raises ValueError for a mode that is not along y.
    """
    refuse_oblique(mode)
    s, c = np.sin(mode.wavenumber / 2), np.cos(mode.wavenumber / 2)
    Dp, Dq = 2 * s * mode.p, 2 * s * mode.q
    T = np.sqrt(3) / 2 * Dq - 2 * c * mode.f
    lost = (3 * Dp**2 + Dq**2) / 2
    if ratios.shear_stiffness:
        lost += Dp**2 / 2 + 2 * T**2 + 4 * mode.f**2
    return float(viscosity / 2 * lost / (mode.p**2 + mode.q**2 + ratios.inertia * mode.f**2))
