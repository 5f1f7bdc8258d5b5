"""Three laws for the shear force of a contact, and the second harmonic each gives: it is the law that decides p.

All three have k_S = g1(δ/Δ0)^{1/2} and the same linear waves; with stretch x = 1 − δ/Δ0, slip t (in Δ0), κ = g1/k1
and forces in k1Δ0, to second order

    secant       S = κ t (1−x)^{1/2}        = κ(t − ½tx)               the paper; LAMMPS mindlin
    incremental  dS = κ (1−x)^{1/2} dt      = κ(dt − ½x dt)            LAMMPS mindlin/force
    potential    S as secant, N → N − ¼κt²(1−x)^{−1/2}                 from V = V_N + ½κt²(1−x)^{1/2}: conservative

In a plane mode x and t of a contact are in phase, so ∫x dt = ½xt + a constant: the incremental law halves g2 and keeps
a memory of its start. The potential law adds the normal force −¼κt². With X = sin(ξ/2) Q and Y = cos(ξ/2) f the drive
of the second harmonic of TR and RT (`second_harmonic._source`) becomes, times 2κ+3,

    secant       (2κ−1) X² − (4κ/√3) XY
    incremental   (κ−1) X² − (2κ/√3) XY
    potential   −(κ+1) X² + (8κ/√3) XY − 4κ Y²

and that of L is −sin²(ξ/2) times 2κ+3, κ+3, 3κ+3.

**Antiresonance.** The secant law has one for −1 ≤ ν ≤ 0.5. The incremental law needs X/Y = 2κ/(√3(κ−1)) > 0 on TR, so
κ > 1, ν < 0. The potential law has none, for any inertia: its form has the discriminant 64κ²/3 − 16κ(κ+1) =
16κ(κ/3 − 1), negative as κ ≤ 4/3; so it is negative unless X = Y = 0, which no mode inside (0, π) is.

Not covered: LAMMPS mindlin_rescale, which shrinks the slip whenever the contact radius does and so damps the wave.
"""

from dataclasses import replace
from typing import Final, TypedDict, Unpack, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis import second_harmonic as sh
from analysis.second_harmonic import SOLID_SPHERE, Mode, Ratios
from analysis.theory.lattice import Law

Floats = NDArray[np.float64]


LAWS: Final[tuple[Law, ...]] = get_args(Law)


SILICA = 0.17  # Poisson's ratio of the paper's spheres


class Lattice(TypedDict, total=False):
    """Options of `sh.ratios` beyond ν and inertia."""

    overlap_ratio: float
    prestress: float
    shear: bool
    rotation: bool


def shear_law_ratios(
    poisson_ratio: float, law: Law, mode: Mode | None = None, inertia: float = SOLID_SPHERE, **lattice: Unpack[Lattice]
) -> Ratios:
    """Constants with which the functions of `analysis.second_harmonic` give the second harmonic under a shear law.

        secant       α = (2κ−1)/(2κ+3),  β = 2κ/(2κ+3),   L: ε as in the paper
        incremental  α = (κ−1)/(2κ+3),   β = κ/(2κ+3),    L: ε·(κ+3)/(2κ+3)
        potential    α = −(κ+1)/(2κ+3),  β = −4κ/(2κ+3),  L: ε·(3κ+3)/(2κ+3),  and ζσ² beside −αdq² + (2/√3)βσdq in
                     [eqp], ζ = 4κ/(2κ+3). In a mode σ = (Y/X)dq, so that term is in α: α − ζ(Y/X)²

    γ keeps its value of the paper: no second harmonic depends on it. The modes are those of `sh.ratios`, for any law.

    Parameters
    ----------
    poisson_ratio : ν in [−1, 0.5].
    law : "secant", "incremental" or "potential".
    mode : the fundamental; needed for "potential", whose α holds for this mode only.
    inertia : I/(mR²).
    lattice : overlap_ratio, prestress, shear, rotation of `sh.ratios`, for the secant and the incremental law. What
        they change is the same for both: to second order the laws differ by ½κ(xt − ∫x dt), where x and t are linear.

    Raises
    ------
    ValueError
        For another law, a ν or an inertia out of range, or "potential" without a mode or with an option of the lattice.
    """
    secant = sh.ratios(poisson_ratio, inertia, **lattice)
    kappa, unit = secant.kappa, 2 * secant.kappa + 3
    if law == "secant":
        return secant
    if law == "incremental":
        less = secant.shear_stiffness / unit
        return replace(
            secant,
            alpha=secant.alpha - less,
            beta=secant.beta - less,
            longitudinal=secant.longitudinal - less,
            memory=less,
        )
    if law != "potential":
        raise ValueError(f"law = {law!r} is none of {LAWS}")
    if mode is None:
        raise ValueError("law = 'potential' needs the mode: it has a term in σ², which Ratios holds mode by mode")
    if lattice:
        raise ValueError(f"law = 'potential' is that of the paper's lattice, not with {', '.join(lattice)}")
    alpha = -(kappa + 1) / unit
    if mode.name != "L":
        alpha -= 4 * kappa / unit * (mode.f / (mode.q * np.tan(mode.wavenumber / 2))) ** 2
    return replace(secant, alpha=alpha, beta=-4 * kappa / unit, longitudinal=(3 * kappa + 3) / unit)


def generated_amplitude(mode: Mode, poisson_ratio: float, law: Law, inertia: float = SOLID_SPHERE) -> float:
    """Amplitude P̃1/i of the generated wave per ε (complex fields; real fields take half) under a shear law.

    ε is the secant law's, `sh.nonlinearity`, for all three. See `sh.generated_amplitude`.
    """
    return sh.generated_amplitude(mode, shear_law_ratios(poisson_ratio, law, mode, inertia))


def antiresonance(poisson_ratio: float, law: Law, inertia: float = SOLID_SPHERE) -> float | None:
    """Wavenumber where TR generates no p at order ε; None if there is none, and always for the potential law.

    Proof at the top of this module. The resonance belongs to the linear lattice and is the same for every law.
    """
    if law == "potential":
        return None
    return sh.antiresonance(shear_law_ratios(poisson_ratio, law, inertia=inertia))


def second_harmonic(
    mode: Mode,
    poisson_ratio: float,
    law: Law,
    amplitude: float,
    tau: ArrayLike,
    row: float = 0,
    phase: float = 0.0,
    inertia: float = SOLID_SPHERE,
) -> Floats:
    """Second-harmonic displacement p_SH(τ) in units of D0 under a shear law, arguments as of `sh.second_harmonic`.

    Under the incremental law it depends on how the start was reached. Here, as in `analysis.theory.lattice` and in
    LAMMPS after one force-free step, the wave starts with the force of the secant law. What the two laws disagree on at
    τ=0 then stays in the contacts as a static force of wave number 2ξ: a drive of frequency 0, which is

        p_memory = (ε/2)(g_incremental − g_secant) sin 2(ξn + phase) (1 − cos w̃τ)/w̃,    w̃ = sin ξ

    It vanishes where ξn + phase is a multiple of π/2, as in the centre row at phase 0.
    """
    own = shear_law_ratios(poisson_ratio, law, mode, inertia)
    return sh.second_harmonic(mode, own, amplitude, tau, row, phase)
