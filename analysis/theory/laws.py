"""Three laws for the shear force of a contact, and the second harmonic each gives: it is the law that decides p.

All three have k_S = g1(δ/Δ0)^{1/2} and the same linear waves; with stretch x = 1 − δ/Δ0, slip t (in Δ0), κ = g1/k1
and forces in k1Δ0, to second order

    secant       S = κ t (1−x)^{1/2}        = κ(t − ½tx)               the paper; LAMMPS mindlin
    incremental  dS = κ (1−x)^{1/2} dt      = κ(dt − ½x dt)            LAMMPS mindlin/force
    potential    S as secant, N → N − ¼κt²(1−x)^{−1/2}                 from V = V_N + ½κt²(1−x)^{1/2}: conservative

In a plane mode x and t of a contact are in phase, so ∫x dt = ½xt + a constant: the incremental law halves g2 and keeps
a memory of its start. The potential law adds the normal force −¼κt². With X = sin(ξ/2) Q and Y = cos(ξ/2) f the drive
of the second harmonic of TR and RT (`second_harmonic.source`) becomes, times 2κ+3,

    secant       (2κ−1) X² − (4κ/√3) XY
    incremental   (κ−1) X² − (2κ/√3) XY
    potential   −(κ+1) X² + (8κ/√3) XY − 4κ Y²

and that of L is −sin²(ξ/2) times 2κ+3, κ+3, 3κ+3.

**Antiresonance.** The secant law has one for −1 ≤ ν ≤ 0.5. The incremental law needs X/Y = 2κ/(√3(κ−1)) > 0 on TR, so
κ > 1, ν < 0. The potential law has none, for any inertia: its form has the discriminant 64κ²/3 − 16κ(κ+1) =
16κ(κ/3 − 1), negative as κ ≤ 4/3; so it is negative unless X = Y = 0, which no mode inside (0, π) is.

Not covered: LAMMPS mindlin_rescale, which shrinks the slip whenever the contact radius does and so damps the wave.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis import second_harmonic as sh
from analysis.second_harmonic import Mode
from analysis.theory.contact import Contact
from analysis.theory.wave import Wave

Floats = NDArray[np.float64]


def generated_amplitude(mode: Mode, contact: Contact) -> float:
    """Amplitude P̃1/i of the generated wave per ε (complex fields; real fields take half) under a shear law.

    ε is the secant law's, `sh.nonlinearity`, for all three. See `sh.generated_amplitude`.
    """
    return sh.generated_amplitude(mode, contact.ratios_of(mode))


def antiresonance(contact: Contact) -> float | None:
    """Wavenumber where TR generates no p at order ε; None if there is none, and always for the potential law.

    Proof at the top of this module. The resonance belongs to the linear lattice and is the same for every law.
    """
    return None if contact.law == "potential" else sh.antiresonance(contact.ratios)


def second_harmonic(wave: Wave, tau: ArrayLike, row: float = 0) -> Floats:
    """Second-harmonic displacement p_SH(τ) in units of D0 under the wave's shear law; see `sh.second_harmonic`.

    Under the incremental law it depends on how the start was reached. Here, as in `analysis.theory.lattice` and in
    LAMMPS after one force-free step, the wave starts with the force of the secant law. What the two laws disagree on at
    τ=0 then stays in the contacts as a static force of wave number 2ξ: a drive of frequency 0, which is

        p_memory = (ε/2)(g_incremental − g_secant) sin 2(ξn + phase) (1 − cos w̃τ)/w̃,    w̃ = sin ξ

    It vanishes where ξn + phase is a multiple of π/2, as in the centre row at phase 0.
    """
    return sh.second_harmonic(wave.mode, wave.ratios, wave.amplitude, tau, row, wave.phase)
