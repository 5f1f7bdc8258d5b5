"""The third harmonic of one wave, of any direction and branch: what runs with it at (3k, 3Ω).

Two things drive it, both of third order in the amplitude a = D0/Δ0: the cubic forces of the contacts on the wave, and
the quadratic ones between the wave and its second harmonic. With displacements in Δ0, Re[a U exp iϑ + a² ½X exp 2iϑ +
a³ Y exp 3iϑ], X from `analysis.theory.mixing.forced_amplitude` of the wave with itself, in the gauge of
`analysis.theory.springs` (U ~ W, X = −i·2V, Y ~ W₃, all real),

    [D(3k) − 9Ω²M] W₃ = C Σ_bonds [e_N (¼ c_N − a_N) + (e_T + e_M)(¼ c_S − a_S)],    C = 1/(2(κ+3))

    a = A(W, V), the bilinear forces between the two,     c_N = −(1/24) e_N³,    c_S = −⅛ κ e_S e_N²

and e at 3k: N = x − ¼x² − (1/24)x³ and S = κs(1 − ½x − ⅛x²) of the paper. Where 3Ω meets a branch at 3k the harmonic
grows with time; for TR along y that is RT(3ξ), next to the paper's resonance.

When it breaks: near a resonance of the second harmonic, 2Ω = Ω_j(2k), where X has no bound, and as in
`analysis.theory.mixing`. Free waves are left out: a wave that starts as the linear mode launches them at 2k and 3k, and
those at 2k make further ones with the wave. Only the paper's contacts are held: the secant law and η = 0. Others are
refused.

Source: the contact laws of the paper (springN, springS), expanded to products of three.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.adhesion import refuse_other_laws
from analysis.theory.bloch import real_modes, select
from analysis.theory.contact import Contact
from analysis.theory.mixing import Pair, Tone, forced_amplitude, rates, response
from analysis.theory.springs import GAUGE, Elongations, drive, elongations, quadratic_forces, springs

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


def third_harmonic_amplitude(wavevector: ArrayLike, branch: ArrayLike, contact: Contact) -> Complexes:
    """Return Y of the third harmonic a³ Re[Y exp 3iϑ], in Δ0, of the wave a Re[U exp iϑ]; in D0 it is a² Y.

    Parameters
    ----------
    wavevector : (..., 2), in 1/lattice constant
    branch : (...), 0, 1 or 2 in ascending frequency
    contact : secant law and overlap_ratio = 0, with or without rotation and shear

    Returns
    -------
    (..., 3), the complex amplitudes of (u, v, φ); u and v are real, φ is imaginary

    Raises
    ------
    ValueError
        For another law, overlap_ratio > 0 and dashpots.
    numpy.linalg.LinAlgError
        On a resonance met to the last bit; nearby the amplitude is large and true.
    """
    frequency, force = _drive(wavevector, branch, contact)
    tripled = 3.0 * np.asarray(wavevector, dtype=float)
    return GAUGE * response(tripled, 3.0 * frequency, force, springs(contact))


def third_harmonic_growth(wavevector: ArrayLike, branch: ArrayLike, contact: Contact) -> tuple[Floats, Floats]:
    """Return the detunings 3Ω − Ω_j(3k) and the rates at which mode j grows where it is phase-matched, each (..., J).

    On resonance Y = rate·τ·U_j, |U_j| = 1, so a wave of amplitude a makes a third harmonic of its own size in
    1/(rate·a²). Arguments and errors as of `third_harmonic_amplitude`; a rate is nan where Ω_j = 0.
    """
    frequency, force = _drive(wavevector, branch, contact)
    spring = springs(contact)
    targets = real_modes(3.0 * np.asarray(wavevector, dtype=float), spring)
    return 3.0 * frequency[..., None] - targets[0], rates(targets, force, spring)


def _drive(wavevector: ArrayLike, branch: ArrayLike, contact: Contact) -> tuple[Floats, Floats]:
    """Return Ω (...) of the wave and the right-hand side of the equation of W₃ at the top of this module, (..., 3)."""
    if contact.law != "secant":
        raise ValueError(f"law = {contact.law!r} is not in the cubic forces; allowed: 'secant'")
    if contact.overlap_ratio > 0:
        raise ValueError(f"overlap_ratio = {contact.overlap_ratio} is not in the cubic forces; allowed: 0")
    refuse_other_laws(contact.secant_ratios)
    spring, wave, k = springs(contact), Tone(wavevector, branch), np.asarray(wavevector, dtype=float)
    frequency, shape = select(*real_modes(k, spring), branch)
    second = 0.5 * np.real(1j * forced_amplitude(Pair(wave, wave, 1, contact)) / GAUGE)
    one, two = elongations(k).of(shape), elongations(2.0 * k).of(second)
    products, _ = quadratic_forces(one, two, spring)
    sheared = -0.125 * spring.shear * one.sheared * one.normal**2
    cubes = Elongations(-(one.normal**3) / 24.0, sheared, sheared)
    forces = Elongations(*(0.25 * cube - product for cube, product in zip(cubes, products, strict=True)))
    return frequency, drive(elongations(3.0 * k), forces) / (2.0 * (spring.kappa + 3.0))
