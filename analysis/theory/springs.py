"""Springs of a contact to second order in the displacements, in LAMMPS's geometry, for a plane wave of any direction.

A sphere touches six neighbours, at d_l = n_l (unit: the lattice constant), with tangent t_l = ẑ × n_l. A contact is
stretched, shifted sideways and sheared by

    δN = n·(u_l − u_0),    δT = t·(u_l − u_0),    δS = δT − (φ_l + φ_0),    φ = Rθ.

Three things follow from η = Δ0/2R > 0, all through h = η/(1−η) (in Δ0, the contact has the length 1/h):

* normals turn, n → n + hδT t, and a sideways shift lengthens the contact, x = δN + ½hδT²;
* the slip s is the integral of (tangent of now)·(relative velocity) − (φ'_l + φ'_0), so s' = δS' − hδT δN';
* the lever arm is R − δ/2, so the torque is (1−η)(1 + hx) times the shear force.

With N = x − nx² − F0 and S = κs(1 − mx) to second order (forces in k1Δ0, displacements in Δ0; n = ¼ and m = ½ of the
paper's contacts, others of the JKR law: `analysis.theory.adhesion`), χ = hF0, and F0 of compression that adhesion does
not balance, (2/3)·prestress in the DMT law, the components along n, along t, and the torque are

    first order    δN,    κδS − χδT,    (1−η) κδS
    second order   A_N = −nδN² + ½h(1+χ)δT² − hκδTδS
                   A_T = S₂ + h(1+χ)δTδN
                   A_M = S₂ + hκδNδS                                              (the torque, over 1−η)

S₂ is the shear force's own second order. In a plane mode δT, δS and δN of a contact are in phase, so ∫δT dδN is
½δTδN and a constant, which the start of the wave decides (LAMMPS loads the springs in one step, along the tangents of
the displaced lattice, s = δS − hδTδN). With subscript 0 for the product at τ = 0,

    secant        S₂ = κ[−mδNδS − ½hδTδN − ½h(δTδN)₀]
    incremental   S₂ = κ[−½mδNδS − ½m(δNδS)₀ − ½hδTδN − ½h(δTδN)₀]            (dS = κ(1−mx) ds)

With h = 0 these are the paper's springs, k2 = −¼, g2 = −½κ, at fixed normals. What the start leaves in a contact is a
static force: the wave drives the lattice at (2k, 2Ω), and its start at (2k, 0).

Two waves meet in the same products, taken once each way: δN² becomes 2δN₁δN₂, at (k1+k2, Ω1+Ω2). Their δT and δN are
out of phase, so that of the integral S₂ = −κ{mδNδS + h[(δTδN)₀ + ∫δT dδN]} (secant; the incremental law has
m[(δNδS)₀ + ∫δN dδS] first) each product runs with the share of the wave that is differentiated,

    ∫(δT₁ dδN₂ + δT₂ dδN₁) = r₂ δT₁δN₂ + r₁ δT₂δN₁ and a constant,    rᵢ = Ωᵢ/(Ω1+Ω2)

A wave (k, Ω, W) is also the wave (−k, −Ω, (u, v, −f)), written so for a difference. At Ω1 = Ω2 the difference gathers
slip in proportion to time: rᵢ has no bound, unless all of it vanishes, as for a wave with itself.

**Everything is real.** Inversion together with time reversal maps the wave exp i(k·r − Ωτ) on itself, so a mode has
real (u, v) and an imaginary φ = i f. In the gauge W = (u, v, f) a contact of phase θ = k·d carries δ = i e exp(iθ/2)
with the real elongations

    e_N = 2 sin(θ/2) n·u,    e_T = 2 sin(θ/2) t·u,    e_S = e_T + e_M,    e_M = −2 cos(θ/2) f.

When it breaks: beyond second order; where contacts open.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.contact import Contact, Law

Floats = NDArray[np.float64]

# One bond of each ± pair: the contact at −d repeats the elongations of the one at d, up to a phase.
BONDS = np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)], [-0.5, np.sqrt(0.75)]])
TANGENTS = np.stack([-BONDS[:, 1], BONDS[:, 0]], axis=-1)
RECIPROCAL = 2 * np.pi * np.array([[1.0, -1 / np.sqrt(3)], [0.0, 2 / np.sqrt(3)]])  # basis of the reciprocal lattice

GAUGE: NDArray[np.complex128] = np.array([1.0, 1.0, 1j])  # (u, v, φ) = GAUGE · (u, v, f)


@dataclass(frozen=True)
class Springs:
    """Constants of a contact, by the terms of this module: made by `springs`.

    kappa is the spheres' own κ, which sets the units; shear is κ too, or 0 where contacts do not resist shear.
    inertia is Ĩ/(1−η); turns says whether spheres turn; normal_softening is n, shear_softening m.
    """

    kappa: float
    shear: float
    h: float
    chi: float
    inertia: float
    turns: bool
    law: Law
    normal_softening: float
    shear_softening: float

    @property
    def mass(self) -> Floats:
        """M = diag(1, 1, Ĩ/(1−η)) as a vector."""
        return np.array([1.0, 1.0, self.inertia])

    @property
    def coordinates(self) -> int:
        """Number of (u, v, f) that move."""
        return 3 if self.turns else 2

    @property
    def memory(self) -> float:
        """1 for the incremental law, 0 for the secant law; ValueError for the potential law, whose S₂ is another."""
        if self.law == "potential":
            raise ValueError("law = 'potential' is not in these springs, whose second order knows secant, incremental")
        return 1.0 if self.law == "incremental" else 0.0

    @property
    def has_history(self) -> bool:
        """True if the slip of a contact depends on how it came about: S₂ holds an integral."""
        return self.h > 0.0 or self.memory > 0.0


class Elongations(NamedTuple):
    """e_N, e_T and e_M of the three bonds: rows on W, (..., bond, 3), or numbers in one mode, (..., bond)."""

    normal: Floats
    sideways: Floats
    turning: Floats

    @property
    def sheared(self) -> Floats:
        """e_S."""
        return self.sideways + self.turning

    def of(self, shape: Floats) -> "Elongations":
        """The elongations in the mode W (..., 3)."""
        return Elongations(*((rows @ shape[..., None])[..., 0] for rows in self))


def springs(contact: Contact) -> Springs:
    """Return the springs of a contact; dashpots are in none of them, and the law is in the second order alone."""
    h = contact.overlap_ratio / (1.0 - contact.overlap_ratio)
    return Springs(
        kappa=contact.kappa,
        shear=contact.shear_stiffness,
        h=h,
        chi=h * contact.adhesion.load / 1.5,
        inertia=contact.inertia / (1.0 - contact.overlap_ratio),
        turns=contact.turns,
        law=contact.law,
        normal_softening=contact.adhesion.expansion.normal,
        shear_softening=contact.adhesion.expansion.shear,
    )


def elongations(wavevector: ArrayLike) -> Elongations:
    """Return the rows of the three bonds on W = (u, v, f) at wave vectors (..., 2), each (..., bond, 3)."""
    half = 0.5 * np.asarray(wavevector, dtype=float) @ BONDS.T
    sine, cosine = 2.0 * np.sin(half)[..., None], 2.0 * np.cos(half)[..., None]
    zero = np.zeros_like(cosine)
    turning = np.concatenate([zero, zero, -cosine], axis=-1)
    return Elongations(
        np.concatenate([sine * BONDS, zero], axis=-1), np.concatenate([sine * TANGENTS, zero], axis=-1), turning
    )


def stiffness(rows: Elongations, contact: Springs) -> Floats:
    """Return D = Σ_bonds (e_N e_Nᵀ + κ e_S e_Sᵀ − χ e_T e_Tᵀ)/(2(κ+3)) (..., 3, 3), real, in the gauge (u, v, f)."""

    def outer(e: Floats) -> Floats:
        return np.swapaxes(e, -1, -2) @ e

    total = outer(rows.normal) + contact.shear * outer(rows.sheared) - contact.chi * outer(rows.sideways)
    return total / (2.0 * (contact.kappa + 3.0))


def quadratic_forces(
    first: Elongations, second: Elongations, contact: Springs, share: ArrayLike = 0.5
) -> tuple[Elongations, Elongations]:
    """Return (A_N, A_T, A_M) of the three bonds, each (..., bond): what runs with two waves, and what the start leaves.

    The forces are bilinear: of a wave with itself they are its own, of two waves half of what they make of each other.
    With the elongations e of a mode for δ: fields δ = Re(i e exp(iθ/2 + iϑ)) have −½ Re(A exp(iθ + 2iϑ)) at 2k, with
    ϑ that of τ = 0 in the second part, and ½A at k = 0. Two waves have −Re(A exp(i(θ1+θ2)/2 + i(ϑ1+ϑ2))) at k1+k2.

    Parameters
    ----------
    first, second : numbers in one mode, each (..., bond)
    share : r₁ = Ω1/(Ω1+Ω2) (...), which only memory and true normals ask for; ½ for a wave with itself
    """
    kappa, h, first_share = contact.shear, contact.h, np.asarray(share, dtype=float)[..., None]
    n, t, s = (
        (one, other)
        for one, other in zip(
            (first.normal, first.sideways, first.sheared), (second.normal, second.sideways, second.sheared), strict=True
        )
    )

    def product(x: tuple[Floats, Floats], y: tuple[Floats, Floats]) -> Floats:
        return 0.5 * (x[0] * y[1] + x[1] * y[0])

    def gathered(x: tuple[Floats, Floats], y: tuple[Floats, Floats]) -> Floats:
        """∫x dy less its constant."""
        return 0.5 * ((1.0 - first_share) * x[0] * y[1] + first_share * x[1] * y[0])

    slid, rolled = contact.memory * (product(n, s) - gathered(n, s)), h * gathered(t, n)
    running = -kappa * (contact.shear_softening * (product(n, s) - slid) + rolled)
    left = -kappa * (contact.shear_softening * slid + h * product(t, n) - rolled)
    normal = 0.5 * h * (1.0 + contact.chi) * t[0] * t[1] - h * kappa * product(t, s)
    normal -= contact.normal_softening * n[0] * n[1]
    return (
        Elongations(normal, running + h * (1.0 + contact.chi) * product(t, n), running + h * kappa * product(n, s)),
        Elongations(np.zeros_like(left), left, left),
    )


def drive(rows: Elongations, forces: Elongations) -> Floats:
    """Return Σ_bonds (e_N A_N + e_T A_T + e_M A_M) (..., 3), rows e at 2k: the force on W = (u, v, f) over −i/2."""
    return np.sum([force[..., None] * row for row, force in zip(rows, forces, strict=True)], axis=(0, -2))
