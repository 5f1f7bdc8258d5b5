"""The wave at (k1 ± k2, Ω1 ± Ω2) that two waves of any two directions and branches make in the paper's crystal.

`granular_analysis.theory.second_order` has the theory, for any crystal. Here it speaks of waves by wave vector and
branch, in the units of `granular_analysis.theory.contact`, and of (u, v, φ). Two waves a1 Re U1 exp i(k1·r − Ω1τ) + a2
Re U2 exp i(k2·r − Ω2τ) make, at k = k1 ± k2 and Ω = Ω1 ± Ω2, the field a1 a2 Re[X exp i k·r]: the forced wave, which
runs with the two; the field from a start at rest, with the free waves at k; and, where the pair is **phase-matched**,
|Ω| = Ω_j(k), the rate at which mode j grows. One wave with itself is half of a pair of equal ones.

Units: displacements and φ = Rθ in Δ0, per product a1 a2 of the amplitudes a = D0/Δ0; time in √(m/(2(g1+3k1))); wave
vectors in 1/lattice constant, x along a close-packed row. Which drives vanish by symmetry says
`granular_analysis.theory.selection`.

When it breaks: where contacts open; where the product is no longer small against the two, as after a time 1/(rate·a) on
a resonance, since nothing here takes energy from the two; where two branches touch. Third order shifts the frequencies
by a², and with them a resonance. Dashpots are refused.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.bloch import hexagonal, in_plane
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.second_order import RIGID, Mixed, branch_of

__all__ = ["Pair", "Tone", "detunings", "forced_amplitude", "growth_rates"]

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


class Tone(NamedTuple):
    """A linear wave: its wave vector (..., 2), in 1/lattice constant, and its branch (...), 0, 1 or 2 by frequency."""

    wavevector: ArrayLike
    branch: ArrayLike


@dataclass(frozen=True, eq=False)
class Pair:
    """Two waves, and their sum (sign 1) or difference (sign −1); wave vectors and branches broadcast.

    Raises ValueError for another sign, and dashpots. A branch that the lattice does not have is refused where the pair
    is first used.
    """

    first: Tone
    second: Tone
    sign: Literal[1, -1]
    contact: Contact

    def __post_init__(self) -> None:
        if self.sign not in (1, -1):
            raise ValueError(f"sign is {self.sign!r}; allowed: 1 (sum), -1 (difference)")
        self.contact.refuse_dashpots()

    @cached_property
    def mixed(self) -> Mixed:
        """Return the pair in the theory of any crystal."""
        crystal = hexagonal(self.contact)
        first, second = (branch_of(crystal, each.wavevector, each.branch) for each in (self.first, self.second))
        return Mixed(crystal, first, second if self.sign == 1 else second.reversed)

    @property
    def wavevector(self) -> Floats:
        """Return k1 ± k2, (..., 2)."""
        return self.mixed.wavevector[..., :2]

    @property
    def frequency(self) -> Floats:
        """Return Ω1 ± Ω2, (...); a negative one is that of a wave along −k."""
        return self.mixed.frequency


def forced_amplitude(pair: Pair) -> Complexes:
    """Return the wave X (..., 3), in Δ0 per a1 a2, that runs with the two; u and v are imaginary, φ is real.

    Raises ValueError where contacts wind up (`Mixed.winds`), and for a rigid motion, which is no wave.
    """
    mixed = pair.mixed
    if np.any(np.minimum(mixed.first.frequency, np.abs(mixed.second.frequency)) < RIGID * mixed.crystal.highest):
        raise ValueError("a wave has the frequency 0: a rigid motion makes no waves; allowed: wave vectors but 0")
    return in_plane(mixed.forced())


def mixed_wave(pair: Pair, tau: ArrayLike) -> Complexes:
    """Return X(τ) (..., 3), in Δ0 per a1 a2, in a lattice without any at k at τ = 0; regular on resonance.

    Where contacts wind up X grows as τ too. Waves of phases ϑ1 and ϑ2 at r = 0 take the factor exp i(ϑ1 ± ϑ2). In a
    simulated sheet of N spheres a1 a2 X is (2/N) Σ u(r) exp(−ik·r), unless k and −k are one wave vector. tau (...)
    broadcasts against the pairs, so that pairs (P, 1) at times (T,) give (P, T, 3).
    """
    return in_plane(pair.mixed.signal(tau))


def detunings(pair: Pair) -> Floats:
    """Return |Ω1 ± Ω2| − Ω_j(k1 ± k2) for each branch j, (..., J); 0 where the pair is phase-matched."""
    return np.abs(pair.frequency)[..., None] - pair.mixed.targets.frequencies


def growth_rates(pair: Pair) -> Floats:
    """Return the rate at which mode j at k1 ± k2 grows if phase-matched, (..., J): X = rate·τ·U_j, |U_j| = 1.

    Off resonance X beats with at most 2·rate/|detuning|. Two waves of one amplitude a would make a third of that
    amplitude in 1/(rate·a); the estimate ends before, as they pay for it. Good values: 1e-2 to 1e-1; 0 where symmetry
    forbids the drive, and nan where Ω_j = 0. Raises ValueError where contacts wind up (`Mixed.winds`).
    """
    return pair.mixed.growth_rates()
