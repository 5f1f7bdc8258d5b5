"""The paper's lattice with its full contact laws, integrated in time: a witness without perturbation theory.

Displacements are in units of Δ0: p along the wave, q along ẑ × k (q = −u for a wave along y), φ = Rθ. A sphere has
three contacts ahead, in the directions n at 0°, 60° and 120° to a close-packed row, and three behind. Let d be (p, q)
of the sphere ahead minus that of the sphere itself, σ = φ₊ + φ, and t = ẑ × n the tangent; along each bond, let
D X = X_n − X_{n−1} and S X = X_n + X_{n−1}. Then

    stretch x = n·d          normal force  N = (2/3)(1 − (1−x)₊^{3/2})     [springN; in units of k1Δ0]
    slip    s = t·d − σ      shear force   S = κ s (1−x)₊^{1/2}            (Eq. 5)

    (p, q)'' = C Σ_bonds D[n N + t S],    Ĩφ'' = C Σ_bonds S[S],    C = 1/(2(κ+3))

Along y the bonds at 60° and 120° lead to the next row, with n = (√3, ∓1)/2, and the bond at 0° stays within the row:
these are equ, eqv, eqphi of the paper. The paper prints √(3/2) in place of √3/2, and v6 − v6 in place of v6 − v0 in
δ_6,S.

**Departures from the paper** are members of `granular_analysis.theory.contact.Contact`:

`law` "incremental": the shear force grows with the slip, dS = κ(1−x)₊^{1/2} ds, and does not follow later changes of
the overlap (LAMMPS mindlin/force).

`law` "potential": the shear energy ½κs²(1−x)₊^{1/2} also acts on the normal force, N → N − ¼κs²(1−x)^{−1/2} while the
contact is closed, which makes the lattice conservative.

`overlap_ratio` η = Δ0/2R > 0: contacts have their true direction and length, as in LAMMPS. The slip is then no function
of the configuration, so `law` "potential" is refused, and the slip is integrated as a state,

    ds/dτ = (present tangent)·(relative velocity) − (φ'₊ + φ'),     torque = S·[1 − η(1−x)₊]     (lever arm R − δ/2)

It starts as LAMMPS leaves it after one force-free step from equilibrium: the displacement along the final tangent.

`adhesion_law` "jkr": N(x) is that of JKR, and the JKR contact radius replaces (1−x)₊^{1/2}
(`granular_analysis.theory.adhesion`).

`prestress`: adhesion holds the lattice at 0, compression at 1. The contacts at rest push with F0 = (2/3)·prestress, N →
N − F0, which cancels unless the normals turn (η > 0).

`shear` False sets S = 0. `rotation` False sets φ = 0; it is a flag, since an infinite Ĩ would make Ĩφ'² = 0·∞.

`viscosity` c (in m/t0, t0 the unit of τ): every closed contact has a dashpot along its normal and, if it resists shear,
one along its tangent, N → N + 2(κ+3)c dx/dτ and S → S + 2(κ+3)c ds/dτ (LAMMPS damping velocity).

`restitution`: the same with c ∝ (1−x)^{1/4} (LAMMPS damping coeff_restitution;
`granular_analysis.theory.contact.restitution_viscosity`).

When it breaks: if contacts stay open for long. The paper's law keeps the adhesive force at any distance (with
prestress = 1 there is none). An open contact also keeps its slip, or under the incremental law its shear force, where
LAMMPS forgets it.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.second_harmonic import Mode
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.integrator import Array, Derivative, dop853
from granular_analysis.theory.lattice_loop import torus_slope
from granular_analysis.theory.neighbours import Neighbours, periodic_kernel, torus_neighbours, torus_phases
from granular_analysis.theory.wave import Wave

Floats = NDArray[np.float64]


class Touching(NamedTuple):
    """Deformation of the contacts ahead in a state, before their forces; the axis of bonds is before that of spheres.

    Attributes
    ----------
    apart : (..., 3, 3, K) n·d, t·d, σ along the directions at rest, as from `neighbours.Neighbours.deform`.
    rates : (..., 3, 3, K) the same for the velocities; equal to `apart` where velocities do not matter.
    turned : cos and sin (..., 3, K) of the angle by which the contact has turned; None if its direction is fixed.
    stretch : (..., 3, K) x.
    overlap : (..., 3, K) (1−x)₊; a JKR contact may have a negative overlap.
    root : (..., 3, K) contact radius, which is the root of the overlap except for JKR
        (`granular_analysis.theory.adhesion`).
    """

    apart: Floats
    rates: Floats
    turned: tuple[Floats, Floats] | None
    stretch: Floats
    overlap: Floats
    root: Floats

    def _along(self, apart: Floats) -> Floats:
        """Return the component of d along the present direction of the contact."""
        along, across = apart[..., 0, :, :], apart[..., 1, :, :]
        return along if self.turned is None else self.turned[0] * along + self.turned[1] * across

    def _slid(self, apart: Floats) -> Floats:
        """Return t·d − σ with the present tangent of the contact."""
        along, across, turning = apart[..., 0, :, :], apart[..., 1, :, :], apart[..., 2, :, :]
        return (across if self.turned is None else self.turned[0] * across - self.turned[1] * along) - turning

    def slip(self) -> Floats:
        """Return s (..., 3, K) from the positions, which holds for η = 0 and at the start."""
        return self._slid(self.apart)

    def slip_rate(self) -> Floats:
        """Return ds/dτ (..., 3, K)."""
        return self._slid(self.rates)

    def stretch_rate(self) -> Floats:
        """Return dx/dτ (..., 3, K)."""
        return self._along(self.rates)

    def shear_rate(self, contact: Contact) -> Floats:
        """Return the rate of the state of the contacts: the slip, or the shear force under the incremental law."""
        return contact.shear_stiffness * self.root * self.slip_rate() if contact.incremental else self.slip_rate()


def touching(state: Floats, contact: Contact, neighbours: Neighbours) -> Touching:
    """Return the deformation of the contacts ahead in a state; parameters as for `rhs`."""
    # Velocities matter only if slip is a state or contacts have dashpots
    kinds = 2 if contact.has_history or contact.dashpot else 1
    places = state[..., : 3 * kinds, :]
    apart = neighbours.deform(places.reshape(*places.shape[:-2], kinds, 3, places.shape[-1]))
    return as_placed(apart[..., 0, :, :, :], apart[..., -1, :, :, :], contact)


def as_placed(apart: Floats, rates: Floats, contact: Contact) -> Touching:
    """Return the deformation of contacts from n·d, t·d, σ along the directions at rest, and from their rates.

    With η > 0 the vector between the centres is r = ℓ n + d, ℓ = 1/η − 1, and x = |r| − ℓ.
    """
    along, across = apart[..., 0, :, :], apart[..., 1, :, :]
    stretch, turned = along, None
    if contact.overlap_ratio:
        length = 1 / contact.overlap_ratio - 1
        # x from |r|² − ℓ², which keeps the four digits that |r| − ℓ would lose
        ahead = length + along
        excess = (length + ahead) * along + across * across
        distance = np.sqrt(length**2 + excess)
        stretch, turned = excess / (distance + length), (ahead / distance, across / distance)
    overlap = np.maximum(1 - stretch, contact.adhesion.least_overlap)
    return Touching(apart, rates, turned, stretch, overlap, contact.adhesion.radius(overlap))


def accelerations(state: Floats, now: Touching, contact: Contact, neighbours: Neighbours) -> Floats:
    """Return p'', q'', φ'' (..., 3, K) of a state with the contacts `now`: the equations at the top of this module."""
    overlap, root = now.overlap, now.root
    normal = contact.adhesion.pull(overlap, root)
    if contact.has_history:
        shear = state[..., 6:, :] if contact.incremental else contact.shear_stiffness * root * state[..., 6:, :]
    else:
        slip = now.slip()
        shear = contact.shear_stiffness * root * slip
        if contact.law == "potential":
            normal -= np.divide(shear * slip, 4 * overlap, out=np.zeros_like(overlap), where=overlap > 0)
    if contact.dashpot:
        dashpot = 2 * (contact.kappa + 3) * contact.dashpot
        closed = np.sqrt(root) if contact.restitution else overlap.real > contact.adhesion.least_overlap
        normal = normal + dashpot * closed * now.stretch_rate()
        if contact.shear:
            shear = shear + dashpot * closed * now.slip_rate()

    force = np.empty(now.apart.shape, dtype=now.apart.dtype)
    if now.turned is None:
        force[..., 0, :, :], force[..., 1, :, :] = normal, shear
    else:
        cosine, sine = now.turned
        force[..., 0, :, :] = cosine * normal - sine * shear
        force[..., 1, :, :] = sine * normal + cosine * shear
    force[..., 2, :, :] = shear * (contact.overlap_ratio * overlap - 1) if contact.overlap_ratio else -shear
    return neighbours.gather(force[..., None, :, :, :])[..., 0, :, :] * contact.mobility


def rhs(state: Floats, contact: Contact, neighbours: Neighbours) -> Floats:
    """Return the time derivative of a state: its velocities, its `accelerations`, and the rate of its shear.

    Parameters
    ----------
    state : (..., 6, K) p, q, φ, p', q', φ' of K spheres, displacements in Δ0; (..., 9, K) if the contact has a history,
        where the last three are the slip s (secant) or shear force S (incremental, in k1Δ0) of the contacts ahead.
    contact : constants of all contacts.
    neighbours : maps between spheres and contacts.
    """
    now = touching(state, contact, neighbours)
    rate = np.empty(state.shape, dtype=state.dtype)
    rate[..., :3, :] = state[..., 3:6, :]
    rate[..., 3:6, :] = accelerations(state, now, contact, neighbours)
    if contact.has_history:
        rate[..., 6:, :] = now.shear_rate(contact)
    return rate


def initial_state(mode: Mode, amplitude: ArrayLike, phases: Floats, contact: Contact, neighbours: Neighbours) -> Floats:
    """Return the state (..., 6 or 9, K) at τ=0 of a mode with amplitudes D0/Δ0 (...) and phases ϑ (K,).

    Source: Eqs. 17, 20, 21 of the paper.
    """
    cos, sin = np.cos(phases), np.sin(phases)
    omega = mode.frequency
    moving = np.stack(
        [mode.p * cos, mode.q * cos, -mode.f * sin, mode.p * omega * sin, mode.q * omega * sin, mode.f * omega * cos]
    )
    return with_shear(np.asarray(amplitude)[..., None, None] * moving, contact, neighbours)


def with_shear(moving: Floats, contact: Contact, neighbours: Neighbours) -> Floats:
    """Return the state (..., 6, K), with three rows of shear appended if the contact has a history."""
    if not contact.has_history:
        return moving
    apart = neighbours.deform(moving[..., None, :3, :])[..., 0, :, :, :]
    start = as_placed(apart, apart, contact)
    shear = start.slip()
    if contact.incremental:
        shear *= contact.shear_stiffness * start.root
    return np.concatenate([moving, shear], axis=-2)


REACH = 5.0  # see `longest_step`


def longest_step(contact: Contact) -> float:
    """Return the longest step of τ with which DOP853 lets no free motion of the lattice grow, at any wavenumber.

        h = REACH/λ,   λ = β/2 + √(Ω² + β²/4),   Ω² = max(3(1+κ), 6κ/Ĩ)/(κ+3),   β = c max(12, 12/Ĩ)

    λ bounds every rate of the linear lattice. Ω² bounds its squared frequencies (RT at ξ=0 has Ω² = 6κ/Ĩ(κ+3) at η=0),
    since the energy of a contact has x² ≤ 2(n·u₊)² + 2(n·u)² and s² ≤ 2(t·u₊ − φ₊)² + 2(t·u + φ)², and the three bonds
    have Σ n n = 3/2. β bounds the dashpots in the same way. Prestress and η only lower the rates.

    DOP853 lets no e^{λτ} grow if |λh| < 5.96 in the left half-plane. REACH is smaller, since contacts under pressure
    are stiffer: it covers overlaps up to (5.96/REACH)⁴, twice that at rest. Without this bound, error control would
    allow steps of 17 τ in a long L wave, and φ would grow out of rounding.
    """
    kappa = contact.shear_stiffness
    squared, damping = 3 * (1 + kappa), 12.0 if contact.shear else 6.0
    if contact.turns:
        squared = max(squared, 6 * kappa / contact.inertia)
        damping = max(damping, 12 / contact.inertia)
    half = damping * contact.dashpot / 2
    return REACH / float(half + np.sqrt(squared / (contact.kappa + 3) + half**2))


def integrate(
    derivative: Derivative,
    start: Floats,
    tau: ArrayLike,
    rtol: float,
    scale: float,
    longest: float,
) -> Floats:
    """Return the states (T, …) of y' = derivative(y), y(0) = start, at the times tau, by DOP853.

    Parameters
    ----------
    tau : (T,) ascending times ≥ 0.
    rtol, scale : errors per step are rtol times the state, plus rtol·scale.
    longest : largest step; see `longest_step`.

    Raises ValueError unless tau is one-dimensional, not empty, ascending and not negative, RuntimeError if the
    integration fails.
    """
    tau = np.asarray(tau, dtype=float)
    if tau.ndim != 1 or tau.size == 0 or tau[0] < 0 or np.any(np.diff(tau) <= 0):
        raise ValueError("tau must be one-dimensional, not empty, not negative and ascending")
    return dop853(derivative, start, tau, rtol, rtol * scale, longest)


def motion(
    start: Floats, contact: Contact, neighbours: Neighbours, tau: ArrayLike, rtol: float, scale: float
) -> Floats:
    """Return the states (T, …) of the free lattice at the times tau, from `start` at τ=0: `integrate` of `rhs`."""
    loop = torus_slope(start, contact, neighbours)
    derivative = loop or (lambda state: rhs(state, contact, neighbours))
    return integrate(derivative, start, tau, rtol, scale, longest_step(contact))


def torus_trajectory(wave: Wave, tau: ArrayLike, *, points: int = 31, rtol: float = 1e-11) -> Floats:
    """Return P, Q, Φ in units of D0 on the phase torus, (T, 3, K): the wave in the infinite lattice, for any ξ.

    Let p(r, τ) = P(k·r + phase, τ), with P 2π-periodic in its first argument. Such a wave obeys the equations of the
    lattice if the neighbour at d is a shift of that argument by k·d. So one period of K points holds every sphere and
    every phase at once. There are no boundaries in any direction, and k need not be commensurate. The phase of the wave
    enters only in `torus`.

    Parameters
    ----------
    wave : the wave at τ=0.
    tau : (T,) ascending times.
    points : K, odd. At a = 0.2, τ ≤ 120, K=31 agrees with K=61 to 1e-12, K=21 to 5e-9 (L at ξ=2), K=15 to 2e-6.
    rtol : error per step of the integration; at a = 0.2, τ=120 the error of φ, the largest one, is about 50 rtol.

    When it breaks: once the wave has steepened so much that harmonic (K−1)/2 carries weight.
    """
    (states,) = torus_trajectories(wave.mode, [wave.amplitude], wave.contact, tau, points=points, rtol=rtol)
    return states / wave.amplitude


def torus_trajectories(
    mode: Mode, amplitudes: ArrayLike, contact: Contact, tau: ArrayLike, *, points: int = 31, rtol: float = 1e-11
) -> Array:
    """Return P, Q, Φ in units of Δ0 on the phase torus, (A, T, 3, K), for one mode with several amplitudes (A,).

    Amplitudes may be complex as long as contacts stay closed. rtol is relative to the smallest amplitude; the error is
    a mean over all waves. Other parameters are as for `torus_trajectory`.
    """
    sizes = np.asarray(amplitudes)
    neighbours = torus_neighbours(mode.wavenumber, points, mode.direction)
    start = initial_state(mode, sizes, torus_phases(points), contact, neighbours)
    states = motion(start, contact, neighbours, tau, rtol, float(np.min(np.abs(sizes))))
    return np.moveaxis(states[..., :3, :], 1, 0)


def torus(
    wave: Wave, tau: ArrayLike, *, row: float = 0, points: int = 31, rtol: float = 1e-11
) -> tuple[Floats, Floats, Floats]:
    """Return the displacements p, q, φ (T,) of one sphere in units of D0; at τ=0 its phase is ϑ = ξ·row + phase.

    row : position of the sphere along k in row spacings (√3/2 lattice constants); along y the number of its row.

    Other parameters are as for `torus_trajectory`.
    """
    trajectory = torus_trajectory(wave, tau, points=points, rtol=rtol)
    weights = periodic_kernel(wave.mode.wavenumber * row + wave.phase - torus_phases(points), points)
    p, q, phi = (trajectory @ weights).T
    return p, q, phi
