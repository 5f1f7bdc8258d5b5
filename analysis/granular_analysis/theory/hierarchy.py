"""The perturbation hierarchy to any order in the amplitude: the exact lattice, on a circle of complex amplitudes.

With a = D0/Δ0 the displacements (in Δ0) of a wave are a power series, y = a y1 + a² y2 + … + aⁿ yn + O(aⁿ⁺¹). Put into
the equations of motion, each power of a gives the equation of one order: the linear lattice, driven by the orders
below. Nobody needs to write these equations down. While contacts stay closed `lattice.rhs` is analytic, so it holds for
complex amplitudes too, and Cauchy's integral over a circle |a| = r, by the rule of M equidistant points, is exact but
for the orders that alias:

    r^k yk = (1/M) Σ_j y(r e^{iθ_j}) e^{−ikθ_j} − Σ_{l≥1} r^{k+lM} y_{k+lM},    θ_j = 2πj/M

The waves of the circle are integrated side by side, in the paper's geometry or with contacts of true direction and
length, under compression, any shear law, with dashpots or without shear or rotation. Since y(a*) = y(a)*, half of the
circle is enough.

In units of D0 the displacement to order n is y1 + a y2 + … + aⁿ⁻¹ yn. Order k holds the harmonics k, k−2, … of ϑ, so
2n+1 points of phase are exact. Order 2 is that of `granular_analysis.theory.wave`.
For TR and RT along y, p has even orders only, q and φ odd ones only: the relative error of p falls as aⁿ, that of q and
φ (n odd) as aⁿ⁺¹.

**Antiresonance.** There y2 is next to nothing in p, and p is of order a⁴: error of p at ξ=2.127, a=0.2, τ≤120, ν=0.17

    order        2      4        6
    error of p   1.13   4.2e-2   1.6e-3

What a⁴ brings is the harmonic 2ξ (99 % of its mean square) and a little 4ξ. Most of it is there because the wave was
started as the linear mode, without the harmonics that go with it. Of the 2ξ part 61 % are free L waves, ±Ω_L(2ξ), and
37 % are driven by the fundamental with a free TR or RT wave of order a³ (Ω_RT(3ξ) − Ω and Ω_RT(ξ) ± Ω above all);
only 1.7 % are bound to the fundamental, at 2Ω. Of the 4ξ part it is 46, 42 and 12 %.

**When it breaks.** Orders grow with time where waves resonate or frequencies shift, so any order fails at last. At
a=0.2 the error of p at order 6, averaged over 80 τ, has grown at τ=400 to 6e-6 (TR, ξ=0.802), 7e-3 (TR, ξ=1.475, the
resonance), 8e-3 (L, ξ=0.802), 2.5e-2 (TR, ξ=2.127). A contact that opens has no power series. Aliasing adds
1e-11 of order k+11 to order k, less than what a sum to order 6 leaves out at any a > 0.02.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.second_harmonic import Mode
from granular_analysis.theory import lattice
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.neighbours import periodic_kernel, torus_phases
from granular_analysis.theory.wave import Wave

Floats = NDArray[np.float64]

# The circle is small enough that no contact opens and aliasing is small, large enough for order 2 to be well above the
# tolerance. Rounding enters the term aᵏ⁻¹ yk as 1e-16 (a/r)ᵏ⁻¹.
RADIUS = 0.1
FEWEST = 11  # points of the circle: aliasing is then r¹¹ = 1e-11 of the order k+11


def hierarchy_orders(mode: Mode, contact: Contact, tau: ArrayLike, *, order: int = 6, rtol: float = 1e-10) -> Floats:
    """Every order of p, q, φ on the phase torus, (n, T, 3, 2n+1): [k−1] is yk, the factor of aᵏ in units of Δ0.

    Parameters
    ----------
    mode : the wave at τ=0 (all of it in y1), a mode of the contact's lattice.
    contact : the physics of every contact.
    tau : (T,) ascending times.
    order : n ≥ 2, the highest power of a.
    rtol : error per step of the waves of the circle, relative to their amplitude. At τ=60 the error of y2 has become up
        to 160 rtol (p of TR at the resonance); a higher order has up to ten times that for each power of a.

    Raises
    ------
    ValueError
        For an order below 2, an invalid time, and a mode of another contact.

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
    """Displacements p, q, φ (T,) of one sphere to order n in units of D0: Σ aᵏ⁻¹ yk, where ϑ = ξ·row + phase at τ=0.

    row is as in `lattice.torus`; order and rtol are those of `hierarchy_orders`, which serves all amplitudes, rows and
    phases at once. For TR and RT along y, orders 2 and 3 differ in q and φ only, orders 3 and 4 in p only.
    """
    orders = hierarchy_orders(wave.mode, wave.contact, tau, order=order, rtol=rtol)
    points = orders.shape[-1]
    weights = periodic_kernel(wave.mode.wavenumber * row + wave.phase - torus_phases(points), points)
    p, q, phi = np.tensordot(wave.amplitude ** np.arange(order), orders @ weights, axes=1).T
    return p, q, phi
