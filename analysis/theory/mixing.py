"""The wave at (k1 ± k2, Ω1 ± Ω2) that two waves of any two directions and branches make.

The contacts answer two waves a1 Re U1 exp i(k1·r − Ω1τ) + a2 Re U2 exp i(k2·r − Ω2τ) with forces that hold every
product twice, at the sum and at the difference of wave vectors and frequencies. With k = k1 ± k2, Ω = Ω1 ± Ω2, in the
gauge (u, v, φ) = (1, 1, i)·W of `analysis.theory.springs`, in which all of this is real, the field at k is

    a1 a2 Re[X exp i k·r],    M X″ = −D(k) X − i C F exp(−iΩτ),    F = Σ_bonds (e_N A_N + e_T A_T + e_M A_M)

with C = 1/(2(κ+3)), the elongations e at k and the bilinear forces A of the two waves (`springs.quadratic_forces`):

    A_N = −¼ e_N1 e_N2,    A_T = A_M = −¼κ (e_N1 e_S2 + e_N2 e_S1)        (η = 0, secant law)

For the difference the second wave is written as (−k2, −Ω2, (u, v, −f)). From that follow the forced wave, which runs
with the two; the field from a start at rest, with the free waves at k; and, where the pair is **phase-matched**,
|Ω| = Ω_j(k), the rate at which mode j grows. One wave with itself is half of a pair of equal ones: it makes
`analysis.theory.directions.second_harmonic_amplitude`.

Units: displacements and φ = Rθ in Δ0, per product a1 a2 of the amplitudes a = D0/Δ0; time in √(m/(2(g1+3k1))); wave
vectors in 1/lattice constant, x along a close-packed row. Which drives vanish by symmetry says
`analysis.theory.selection`.

When it breaks: where contacts open; where the product is no longer small against the two, as after a time 1/(rate·a) on
a resonance, since nothing here takes energy from the two; where two branches touch. Third order shifts the frequencies
by a², and with them a resonance. The potential law and dashpots are refused.

Source: the contact laws of the paper (springN, springS), expanded to products of two, as the paper does for one wave.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.bloch import real_modes, select
from analysis.theory.contact import Contact
from analysis.theory.springs import (
    GAUGE,
    Elongations,
    Springs,
    drive,
    elongations,
    quadratic_forces,
    springs,
    stiffness,
)

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

# A difference of equal frequencies counts as EQUAL·Ω1, where 0 would be 0/0: what changes by it is EQUAL·Ω1·τ of the
# field, and the constant of ∫x dy loses 1e-16/EQUAL to rounding.
EQUAL = 1e-7


class Tone(NamedTuple):
    """A linear wave: its wave vector (..., 2), in 1/lattice constant, and its branch (...), 0, 1 or 2 by frequency."""

    wavevector: ArrayLike
    branch: ArrayLike


@dataclass(frozen=True, eq=False)
class Pair:
    """Two waves, and their sum or difference; wave vectors and branches broadcast against each other.

    Attributes
    ----------
    first, second : the two waves.
    sign : 1 for the sum, −1 for the difference (first less second).
    contact : secant or incremental law, any geometry, compression, shear and rotation, without dashpots.

    Raises
    ------
    ValueError
        For another sign, the potential law and dashpots. A branch that the lattice does not have is refused where the
        pair is first used.
    """

    first: Tone
    second: Tone
    sign: Literal[1, -1]
    contact: Contact

    def __post_init__(self) -> None:
        if self.sign not in (1, -1):
            raise ValueError(f"sign is {self.sign!r}; allowed: 1 (sum), -1 (difference)")
        if self.contact.dashpot:
            raise ValueError(f"dashpot of the contact is {self.contact.dashpot:g}; allowed: 0, waves here do not decay")
        _ = self.springs.memory  # which refuses the potential law

    @cached_property
    def springs(self) -> Springs:
        """Constants of a contact."""
        return springs(self.contact)

    @cached_property
    def tones(self) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
        """Frequency (...) and shape W (..., 3) of the first and of the second wave, as it stands in a sum."""
        first, (frequency, shape) = (
            select(*real_modes(tone.wavevector, self.springs), tone.branch) for tone in (self.first, self.second)
        )
        return first, (self.sign * frequency, shape * np.array([1.0, 1.0, self.sign]))

    @cached_property
    def wavevector(self) -> Floats:
        """Return k1 ± k2, (..., 2)."""
        first, second = (np.asarray(tone.wavevector, dtype=float) for tone in (self.first, self.second))
        return first + self.sign * second

    @property
    def frequency(self) -> Floats:
        """Return Ω1 ± Ω2, (...); a negative one is that of a wave along −k, and `EQUAL` Ω1 stands for 0 that winds."""
        (first, _), (second, _) = self.tones
        return np.where(self.winds, EQUAL * first, first + second)

    @cached_property
    def winds(self) -> NDArray[np.bool_]:
        """True where contacts gather slip in proportion to time, (...).

        They do in the difference of two waves of equal frequency, other than one wave with itself, where slip has a
        history: η > 0, or the incremental law. There is no steady drive then.
        """
        (first, _), (second, _) = self.tones
        equal = np.abs(first + second) < EQUAL * first
        branches = np.asarray(self.first.branch) != np.asarray(self.second.branch)
        return self.springs.has_history & equal & (branches | (np.linalg.norm(self.wavevector, axis=-1) > 0.0))

    @cached_property
    def targets(self) -> tuple[Floats, Floats]:
        """Frequencies (..., J) and shapes W (..., J, 3) of the modes at k1 ± k2."""
        return real_modes(self.wavevector, self.springs)

    @cached_property
    def forces(self) -> tuple[Elongations, Elongations]:
        """A of the three bonds, each (..., bond): what runs with the two waves, and what their start leaves."""
        (frequency, first), (_, second) = self.tones
        total = np.asarray(self.frequency)
        share = np.divide(frequency, total, out=np.full(total.shape, 0.5), where=total != 0)
        there = self.sign * np.asarray(self.second.wavevector, dtype=float)
        return quadratic_forces(
            elongations(self.first.wavevector).of(first), elongations(there).of(second), self.springs, share
        )

    @cached_property
    def drives(self) -> tuple[Floats, Floats]:
        """C F (..., 3) of `forces`: at the frequency of the pair, and at 0."""
        rows, stiff = elongations(self.wavevector), 2.0 * (self.springs.kappa + 3.0)
        running, left = self.forces
        return drive(rows, running) / stiff, drive(rows, left) / stiff

    def refuse_winding(self) -> None:
        """Raise ValueError where contacts wind up, so that nothing is steady."""
        if np.any(self.winds):
            raise ValueError(
                "the waves of a difference have equal frequencies, and slip with a history grows with time; allowed: "
                "different frequencies, overlap_ratio = 0 with law = 'secant', or the field in time, mixed_wave"
            )


def forced_amplitude(pair: Pair) -> Complexes:
    """Return X = −iC[D(k) − Ω²M]⁻¹F, the wave that runs with the two: a1 a2 Re X exp i(k·r − Ωτ), beside any free ones.

    u and v are imaginary, φ is real.

    Returns
    -------
    (..., 3), the complex amplitudes of (u, v, φ) in Δ0 per a1 a2

    Raises
    ------
    ValueError
        Where contacts wind up (`Pair.winds`).
    numpy.linalg.LinAlgError
        On a resonance met to the last bit, as of acoustic waves at k = 0. Nearby the amplitude is large and true, but
        see `mixed_wave`.
    """
    pair.refuse_winding()
    return -1j * GAUGE * response(pair.wavevector, pair.frequency, pair.drives[0], pair.springs)


def mixed_wave(pair: Pair, tau: ArrayLike) -> Complexes:
    """Return X(τ) of the field a1 a2 Re[X exp i k·r] that two waves make in a lattice without any at k at τ = 0.

        X = −i C Σ_j U_j [(U_j†F) Z_j(Ω) + (U_j†F₀) Z_j(0)]/(U_j†MU_j)
        Z_j(ω) = ∫₀^τ sin(w_j(τ−s))/w_j e^{−iωs} ds,    w_j the frequencies at k

    Each mode at k answers with a forced and a free part; Z_j is regular on resonance, where it grows as τ. F₀ is what
    the start leaves in the contacts, 0 in the paper's geometry and law; where contacts wind up (`Pair.winds`), X grows
    as τ too. Waves of phases ϑ1 and ϑ2 at r = 0 take the factor exp i(ϑ1 ± ϑ2). In a simulated sheet of N spheres
    a1 a2 X is (2/N) Σ u(r) exp(−ik·r), unless k and −k are one wave vector.

    Parameters
    ----------
    pair : a single one, or pairs (...)
    tau : (...), dimensionless time; broadcasts against the pairs, so that pairs (P, 1) at times (T,) give (P, T, 3)

    Returns
    -------
    (..., 3), the complex amplitudes of (u, v, φ) in Δ0 per a1 a2
    """
    time = np.asarray(tau, dtype=float)[..., None]
    frequencies, shapes = pair.targets
    weights = shapes**2 @ pair.springs.mass
    running, left = (np.einsum("...jc,...c->...j", shapes, each) / weights for each in pair.drives)
    forcing = pair.frequency[..., None]
    answer = running * duhamel(frequencies, forcing, time) + left * duhamel(frequencies, 0.0, time)
    return -1j * GAUGE * np.einsum("...j,...jc->...c", answer, shapes)


def detunings(pair: Pair) -> Floats:
    """Return |Ω1 ± Ω2| − Ω_j(k1 ± k2) for each branch j, (..., J); 0 where the pair is phase-matched."""
    return np.abs(pair.frequency)[..., None] - pair.targets[0]


def growth_rates(pair: Pair) -> Floats:
    """Return the rate C|U_j†F|/(2Ω_j U_j†MU_j) at which mode j at k1 ± k2 grows if phase-matched, (..., J).

    On resonance X = rate·τ·U_j, |U_j| = 1; off it, X beats with at most 2·rate/|detuning|. Two waves of one amplitude a
    would make a third of that amplitude in 1/(rate·a); the estimate ends before, as they pay for it.
    One wave makes half of what it makes as a pair with itself.

    Good values: 1e-2 to 1e-1; 0 where symmetry forbids the drive (`analysis.theory.selection`), and nan where Ω_j = 0.

    Raises ValueError where contacts wind up (`Pair.winds`).
    """
    pair.refuse_winding()
    return rates(pair.targets, pair.drives[0], pair.springs)


def response(wavevector: ArrayLike, frequency: ArrayLike, force: Floats, spring: Springs) -> Floats:
    """Return [D(k) − Ω²M]⁻¹ of a force (..., 3) on W, for k (..., 2) and Ω (...)."""
    moving = spring.coordinates
    squared = np.asarray(frequency, dtype=float)[..., None, None] ** 2
    dynamic = (stiffness(elongations(wavevector), spring) - squared * np.diag(spring.mass))[..., :moving, :moving]
    result = np.zeros_like(force)
    result[..., :moving] = np.linalg.solve(dynamic, force[..., :moving, None])[..., 0]
    return result


def rates(targets: tuple[Floats, Floats], force: Floats, spring: Springs) -> Floats:
    """Return |U_j†F|/(2Ω_j U_j†MU_j) of a force (..., 3) on modes (..., J), (..., J, 3); nan where Ω_j = 0."""
    frequencies, shapes = targets
    share = np.abs((shapes @ force[..., None])[..., 0]) / (shapes**2 @ spring.mass)
    return np.divide(share, 2.0 * frequencies, out=np.full(share.shape, np.nan), where=frequencies > 0)


def duhamel(natural: Floats, forcing: ArrayLike, tau: Floats) -> Complexes:
    """Return Z = ∫₀^τ sin(w(τ−s))/w e^{−iωs} ds for w = natural, ω = forcing, regular at ω = ±w and for w → 0.

    Z = [e^{iwτ}E(−ω−w) − e^{−iwτ}E(w−ω)]/(2iw),    E(x) = ∫₀^τ e^{ixs} ds = τ e^{ixτ/2} sin(xτ/2)/(xτ/2).
    """
    # Z is even and smooth in w, so a small w in place of 0 (a translation of the whole lattice) changes it by O(w²τ²).
    w, omega = np.maximum(natural, 1e-8), np.asarray(forcing, dtype=float)

    def window(x: Floats) -> Complexes:
        return tau * np.exp(0.5j * x * tau) * np.sinc(x * tau / (2.0 * np.pi))

    return (np.exp(1j * w * tau) * window(-omega - w) - np.exp(-1j * w * tau) * window(w - omega)) / (2j * w)
