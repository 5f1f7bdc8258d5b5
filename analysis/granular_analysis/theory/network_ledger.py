"""Energy of a packing of spheres, and the work by which its contact laws change the energy.

The laws of `granular_analysis.theory.network` have no potential. With the shear stiffness k = B δ^{1/2} of a contact,
the energy is

    E = Σ ½m v² + ½I ω² + Σ (2/5)A δ^{5/2} − F δ + ½S²/k

where JKR contacts have ∫P dδ of `granular_analysis.theory.network_laws` in place of (2/5)A δ^{5/2} − F δ. Two terms of
the laws change E by the work W: the shear law (+ for the secant law, − for the incremental one), and the lever arm of
LAMMPS, which for two spheres is R in the slip but R − δ/2 in the torque:

    dW/dt = Σ ±½ (dk/dδ)(S/k)² dδ/dt − (δ/2)(n × S)·(ω_i + ω_j)

The work of external pushes and prescribed motions adds to W. E − W is constant if no contact slides, nothing is damped
and no held sphere moves by itself. Sliding, dashpots and drag lower E − W by the heat. S is the force of the spring,
except in the term of the lever arm, on which the whole shear force acts.

When it breaks: where a contact of the incremental law opens, since ½S²/k has no bound there.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from granular_analysis.theory.network import Network
from granular_analysis.theory.network_state import Contacts, Pairs, State, present, slip
from granular_analysis.theory.network_tangents import dot, module_of, quotient


@dataclass(frozen=True)
class Energy:
    """Energy of a state: kinetic, ∫P dδ of the contacts (0 where they open), and ½S²/k of their shear."""

    kinetic: float
    normal: float
    shear: float

    @property
    def total(self) -> float:
        """Return the sum of the three."""
        return self.kinetic + self.normal + self.shear


def energy(network: Network, state: State) -> Energy:
    """Return the energy of a state, without the kinetic energy of held spheres, which no force ever changes."""
    now = present(network, state)
    normal = state.pairs.normal.energy(now.overlap, now.radius)
    return Energy(kinetic_energy(network, state), float(normal.sum()), float(dot(now.spring, slip(now)).sum()) / 2)


def kinetic_energy(network: Network, state: State) -> float:
    """Return Σ ½m v² + ½I ω² over the free spheres."""
    free = network.mobility[0] > 0
    velocity, spin = np.split(state.motion[network.freedoms :], [network.dimension])
    speeds = network.mass * dot(velocity, velocity) + network.inertia * dot(spin, spin)
    return float(speeds[free].sum()) / 2


def work_rate(network: Network, pairs: Pairs, now: Contacts) -> Any:
    """Return dW/dt of the shear law and the lever arm: the equation at the top of this module."""
    # ½ (dk/dδ)(S/k)² = ½ (S²/k) d(ln k)/dδ, and k ∝ a
    work = 2 * now.stiffness * pairs.normal.spreading(now.overlap, now.radius)
    law = dot(now.normal, now.rate) * quotient(dot(now.spring, now.spring), work, work > 0, 0.0)
    lever = pairs.shortened * now.overlap * dot(now.twist, now.spins)
    return module_of(lever).sum((law if network.law == "incremental" else -law) - lever)
