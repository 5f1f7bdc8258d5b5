"""The perturbation hierarchy to any order in the amplitude, from the exact lattice on a circle of complex amplitudes.

With a = D0/Δ0, the displacements of a wave (in Δ0) are a power series, y = a y1 + a² y2 + … + aⁿ yn + O(aⁿ⁺¹). In the
equations of motion, each power of a gives the equation of one order: the linear lattice, driven by the orders below.
These equations need not be written down. While contacts stay closed, `lattice.rhs` is analytic and so accepts complex
amplitudes. Cauchy's integral over a circle |a| = r, by a sum over M equidistant points, is then exact except for
aliased orders:

    r^k yk = (1/M) Σ_j y(r e^{iθ_j}) e^{−ikθ_j} − Σ_{l≥1} r^{k+lM} y_{k+lM},    θ_j = 2πj/M

The waves of the circle are integrated side by side: in the paper's geometry or with contacts of true direction and
length, with or without compression, dashpots, shear and rotation, under any shear law. Half of the circle is enough,
since y(a*) = y(a)*.

In units of D0 the displacement to order n is y1 + a y2 + … + aⁿ⁻¹ yn. Order k holds the harmonics k, k−2, … of ϑ, so
2n+1 points of phase are exact. Order 2 is that of `granular_analysis.theory.wave`. For TR and RT along y, p has only
even orders, q and φ only odd ones: the relative error of p falls as aⁿ, that of q and φ (n odd) as aⁿ⁺¹.

**Antiresonance.** Here y2 has almost no p, so p is of order a⁴. Error of p at ξ=2.127, a=0.2, τ≤120, ν=0.17:

    order        2      4        6
    error of p   1.13   4.2e-2   1.6e-3

Order a⁴ consists of the harmonic 2ξ (99 % of its mean square) and a little 4ξ. Most of it arises because the wave
starts as the linear mode, without its own harmonics. Of the 2ξ part, 61 % are free L waves at ±Ω_L(2ξ), 37 % are driven
by the fundamental together with a free TR or RT wave of order a³ (mainly at Ω_RT(3ξ) − Ω and Ω_RT(ξ) ± Ω), and only
1.7 % are bound to the fundamental, at 2Ω. Of the 4ξ part, these shares are 46, 42 and 12 %.

**When it breaks.** Orders grow with time where waves resonate or frequencies shift, so every order fails in the end.
At a=0.2, the error of p at order 6, averaged over 80 τ, has grown by τ=400 to 6e-6 (TR, ξ=0.802), 7e-3 (TR, ξ=1.475,
the resonance), 8e-3 (L, ξ=0.802), 2.5e-2 (TR, ξ=2.127). If a contact opens there is no power series. Aliasing adds
1e-11 of order k+11 to order k, less than a sum to order 6 leaves out at any a > 0.02.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.second_harmonic import Mode
from granular_analysis.theory import lattice
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.neighbours import periodic_kernel, torus_phases
from granular_analysis.theory.wave import Wave

Floats = NDArray[np.float64]

# Radius r of the circle: so small that no contact opens and aliasing is small, so large that order 2 is well above the
# tolerance. Rounding enters the term aᵏ⁻¹ yk as 1e-16 (a/r)ᵏ⁻¹.
RADIUS = 0.1
FEWEST = 11  # points on the circle: aliasing is then r¹¹ = 1e-11 of order k+11


def hierarchy_orders(mode: Mode, contact: Contact, tau: ArrayLike, *, order: int = 6, rtol: float = 1e-10) -> Floats:
    """Return all orders of p, q, φ on the phase torus, (n, T, 3, 2n+1): [k−1] is yk, the factor of aᵏ in units of Δ0.

    Parameters
    ----------
    mode : the wave at τ=0, all of it in y1; a mode of the lattice with this contact.
    contact : constants of all contacts.
    tau : (T,) ascending times.
    order : n ≥ 2, the highest power of a.
    rtol : error per step of the waves of the circle, relative to their amplitude. By τ=60 the error of y2 grows to at
        most 160 rtol (p of TR at the resonance); each higher order has up to ten times the error of the one below.

    Raises
    ------
    ValueError
        For an order below 2, invalid times, and a mode of another contact.

    Source: the equations of `granular_analysis.theory.lattice` (equ, eqv, eqphi of the paper).
    """
    if order < 2:
        raise ValueError(f"order = {order} must be at least 2")
    Wave(mode, RADIUS, contact)  # checks that the two agree
    points, circle = 2 * order + 1, max(FEWEST, order + 1)
    half = circle // 2 + 1
    amplitudes = RADIUS * np.exp(2j * np.pi * np.arange(half) / circle)
    waves = lattice.torus_trajectories(mode, amplitudes, contact, tau, points=points, rtol=rtol)
    orders = np.fft.irfft(waves.conj(), circle, axis=0)[1 : order + 1]
    return orders / (RADIUS ** np.arange(1, order + 1))[:, None, None, None]


def hierarchy(
    wave: Wave, tau: ArrayLike, *, order: int = 6, row: float = 0, rtol: float = 1e-10
) -> tuple[Floats, Floats, Floats]:
    """Return the displacements p, q, φ (T,) of one sphere to order n in units of D0: Σ aᵏ⁻¹ yk.

    At τ=0 its phase is ϑ = ξ·row + phase.

    row : as in `lattice.torus`.
    order, rtol : as in `hierarchy_orders`, which serves all amplitudes, rows and phases at once.

    For TR and RT along y, orders 2 and 3 differ only in q and φ, orders 3 and 4 only in p.
    """
    orders = hierarchy_orders(wave.mode, wave.contact, tau, order=order, rtol=rtol)
    points = orders.shape[-1]
    weights = periodic_kernel(wave.mode.wavenumber * row + wave.phase - torus_phases(points), points)
    p, q, phi = np.tensordot(wave.amplitude ** np.arange(order), orders @ weights, axes=1).T
    return p, q, phi
