"""The third harmonic of one wave of the paper's crystal, of any direction and branch: what runs with it at (3k, 3Ω).

Two things drive it, both of third order in the amplitude a = D0/Δ0: the cubic forces of the contacts on the wave, and
the quadratic ones between the wave and its second harmonic (`analysis.theory.third_order`, for any crystal). Where 3Ω
meets a branch at 3k the harmonic grows with time; for TR along y that is RT(3ξ), next to the paper's resonance.

When it breaks: near a resonance of the second harmonic, 2Ω = Ω_j(2k), where X has no bound, and as in
`analysis.theory.mixing`. Free waves are left out: a wave that starts as the linear mode launches them at 2k and 3k, and
those at 2k make further ones with the wave. Only the paper's contacts are held: the secant law and η = 0. Others are
refused.

Source: the contact laws of the paper (springN, springS), expanded to products of three.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.adhesion import refuse_other_laws
from analysis.theory.bloch import hexagonal, in_plane
from analysis.theory.contact import Contact
from analysis.theory.second_order import Answer, wave
from analysis.theory.third_order import third_harmonic

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
    """
    return in_plane(_answer(wavevector, branch, contact).forced())


def third_harmonic_growth(wavevector: ArrayLike, branch: ArrayLike, contact: Contact) -> tuple[Floats, Floats]:
    """Return the detunings 3Ω − Ω_j(3k) and the rates at which mode j grows where it is phase-matched, each (..., J).

    On resonance Y = rate·τ·U_j, |U_j| = 1, so a wave of amplitude a makes a third harmonic of its own size in
    1/(rate·a²). Arguments and errors as of `third_harmonic_amplitude`; a rate is nan where Ω_j = 0.
    """
    answer = _answer(wavevector, branch, contact)
    return answer.frequency[..., None] - answer.targets.frequencies, answer.growth_rates()


def _answer(wavevector: ArrayLike, branch: ArrayLike, contact: Contact) -> Answer:
    """Return the answer of the crystal to the forces at 3k."""
    if contact.law != "secant":
        raise ValueError(f"law = {contact.law!r} is not in the cubic forces; allowed: 'secant'")
    if contact.overlap_ratio > 0:
        raise ValueError(f"overlap_ratio = {contact.overlap_ratio} is not in the cubic forces; allowed: 0")
    if contact.dashpot:
        raise ValueError(f"dashpot of the contact is {contact.dashpot:g}; allowed: 0, waves here do not decay")
    refuse_other_laws(contact.secant_ratios)
    crystal = hexagonal(contact)
    one = wave(crystal, wavevector, branch)
    return Answer(crystal, 3 * one.wavevector, 3 * one.frequency, third_harmonic(crystal, one))
