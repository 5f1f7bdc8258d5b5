"""The energy of a plane wave: the paper's law has no potential, and the wave gains and loses by it.

The spring of a sheared contact has the stiffness k_S = g1 (δ/Δ0)^{1/2}, which follows the overlap δ. Whoever changes δ
at a shear δ_S changes the stored energy ½ k_S δ_S² by work that no force of the secant law accounts for. With

    E = Σ ½m(u̇² + v̇²) + ½Iθ̇² + ∫f_N + ½ f_S δ_S,    W = ±∫ Σ ½ (dk_S/dδ) δ_S² dδ,    δ_S = f_S/k_S

E − W is constant, with + for the secant law and − for the incremental one; a shear force derived from a potential does
no such work. Here, per row (one sphere and three contacts), averaged over the phase torus, in units of k1Δ0², with the
stretch x = 1 − δ/Δ0 and slip s of `granular_analysis.theory.lattice`:

    kinetic (κ+3)(p'² + q'² + Ĩφ'²),   normal Σ (2/3)[x + (2/5)((1−x)^{5/2} − 1)],   shear Σ ½κ(1−x)^{1/2} s²
    dW/dτ = ∓Σ ¼κ(1−x)^{−1/2} s² x'        (sums over the three contacts ahead)

and in the JKR law with its force and contact radius in their places (`granular_analysis.theory.adhesion`).

W is integrated as a further state: no sampling step enters. Simpson's rule on the power agrees with it to 2e-11 of E,
but only from 16 samples per τ on. What limits the ledger is the trajectory, its accumulated error and its interpolation
between the integrator's steps: 1e-11 to 5e-10 of E for rtol = 1e-11, a = 0.2, τ ≤ 400.

The shifts to the neighbours ahead and behind are transposed, so the K points of the torus obey this ledger exactly. It
proves the law and the integration in time; that K harmonics are enough it cannot see.

Breaks when a contact opens: ½S²/k_S of the incremental law has no bound there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.contact import Contact
from granular_analysis.theory.integrator import of_state, solver_of, step
from granular_analysis.theory.lattice import Touching, integrate, longest_step, rhs, touching
from granular_analysis.theory.lattice_loop import torus_slope
from granular_analysis.theory.neighbours import Neighbours
from granular_analysis.theory.wave import Wave
from tests.stepped import on_torus

Floats = NDArray[np.float64]

# Sign of the work: the force of the incremental law is kept when the stiffness changes, the slip of the secant law is.
WORK_SIGN = {"secant": 1.0, "incremental": -1.0, "potential": 0.0}


@dataclass(frozen=True)
class Energy:
    """Energy per row in k1Δ0², averaged over the torus; each part of shape (...)."""

    kinetic: Floats
    normal: Floats
    shear: Floats

    @property
    def total(self) -> Floats:
        """Sum of the three."""
        return self.kinetic + self.normal + self.shear


@dataclass(frozen=True)
class Ledger:
    """Energy (T,) of a wave at the times tau (T,), and the work (T,) its shear law has done since τ=0, in k1Δ0²."""

    tau: Floats
    energy: Energy
    work: Floats

    @property
    def relative(self) -> Floats:
        """E(τ)/E(0)."""
        return self.energy.total / self.energy.total[0]

    @property
    def gap(self) -> float:
        """Largest |E − W − E(0)|/E(0): 0 for an exact integration."""
        balance = self.energy.total - self.work
        return float(np.max(np.abs(balance - balance[0])) / self.energy.total[0])


def energy(states: Floats, contact: Contact, neighbours: Neighbours) -> Energy:
    """Energy per row of states (..., 6 or 9, K) of the lattice: the equations at the top of this module.

    Arguments as of `lattice.rhs`. Raises ValueError for overlap_ratio > 0, whose normals turn, and for dashpots.
    """
    now, tangential = _contacts(states, contact, neighbours)
    p_rate, q_rate, phi_rate = np.moveaxis(states[..., 3:6, :], -2, 0)
    normal = contact.adhesion.energy(now.overlap, now.root)
    normal += contact.adhesion.pull(now.overlap, now.root) * (now.stretch + now.overlap - 1)  # open contacts
    shear = 0.5 * contact.shear_stiffness * now.root * tangential**2
    kinetic = (contact.kappa + 3) * (p_rate**2 + q_rate**2 + contact.inertia * phi_rate**2)
    return Energy(
        kinetic=kinetic.mean(axis=-1),
        normal=normal.sum(axis=-2).mean(axis=-1),
        shear=shear.sum(axis=-2).mean(axis=-1),
    )


def law_power(state: Floats, contact: Contact, neighbours: Neighbours) -> Floats:
    """Power dW/dτ (K,) of the shear law at each row, in k1Δ0²: ±Σ ½ (dk_S/dδ) δ_S² dδ/dτ, of one state.

    Arguments as of `lattice.rhs`. Raises ValueError as `energy`.
    """
    if not WORK_SIGN[contact.law]:
        _refuse(contact)
        return np.zeros(state.shape[-1])
    now, tangential = _contacts(state, contact, neighbours)
    softening = contact.shear_stiffness * contact.adhesion.growth(now.overlap, now.root)
    stretching = neighbours.deform(state[3:6])[0]
    power: Floats = -0.5 * WORK_SIGN[contact.law] * (softening * tangential**2 * stretching).sum(axis=0)
    return power


def ledger(wave: Wave, tau: ArrayLike, *, points: int = 31, rtol: float = 1e-11) -> Ledger:
    """Energy and work of the shear law along the trajectory of `lattice.torus_trajectory`, arguments as there.

    The gap of the ledger is about 10 rtol at the resonance (ξ=1.475, a=0.2, τ ≤ 400).
    """
    laws = wave.contact
    _refuse(laws)
    start, neighbours = on_torus(wave, points)

    moves = torus_slope(start, laws, neighbours) or (lambda moving: rhs(moving, laws, neighbours))

    def derivative(state: Floats) -> Floats:
        moving = np.ascontiguousarray(state[:-1])
        return np.concatenate([moves(moving), law_power(moving, laws, neighbours)[None]])

    start = np.concatenate([start, np.zeros((1, points))])
    states = integrate(derivative, start, tau, rtol, wave.amplitude, longest_step(laws))
    work = states[:, -1].mean(axis=-1)
    return Ledger(np.asarray(tau, dtype=float), energy(states[:, :-1], laws, neighbours), work)


def opening_time(wave: Wave, until: float, *, points: int = 31, rtol: float = 1e-11) -> float | None:
    """Time τ at which the first contact of the wave opens, x = 1 in the DMT law; None if none has by τ = until.

    Past it the laws of the lattice are no longer those of a contact: this is where a wave that gains energy blows up.
    """
    laws = wave.contact
    start, neighbours = on_torus(wave, points)

    def closed(state: Floats) -> bool:
        return bool(np.max(touching(state, laws, neighbours).stretch) < 1 - laws.adhesion.least_overlap)

    slope = torus_slope(start, laws, neighbours) or (lambda state: rhs(state, laws, neighbours))
    options = {"rtol": rtol, "atol": rtol * wave.amplitude, "max_step": longest_step(laws)}
    solver = solver_of(of_state(slope, start), 0.0, start.ravel(), until, **options)
    while solver.t < until:
        step(solver)
        if not closed(solver.y.reshape(start.shape)):
            low, high, motion = solver.t_old, solver.t, solver.dense_output()
            while low < (middle := (low + high) / 2) < high:
                low, high = (middle, high) if closed(motion(middle).reshape(start.shape)) else (low, middle)
            return high
    return None


def _contacts(states: Floats, contact: Contact, neighbours: Neighbours) -> tuple[Touching, Floats]:
    """The contacts ahead, and their slip δ_S = S/k_S (..., 3, K)."""
    _refuse(contact)
    now = touching(states, contact, neighbours)
    return now, states[..., 6:, :] / (contact.shear_stiffness * now.root) if contact.has_history else now.slip()


def _refuse(contact: Contact) -> None:
    if contact.overlap_ratio:
        raise ValueError(f"overlap_ratio = {contact.overlap_ratio} is not 0: the ledger is that of fixed normals")
    if contact.dashpot:
        raise ValueError(f"viscosity = {contact.dashpot} is not 0: the ledger has no entry for what dashpots take")
