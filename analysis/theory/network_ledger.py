"""Energy and momentum of a packing of spheres, and the work by which its contact laws change the energy.

The laws of `analysis.theory.network` have no potential. With the stiffness k = B δ^{1/2} of a contact against shear,

    E = Σ ½m v² + ½I ω² + Σ (2/5)A δ^{5/2} − F δ + ½S²/k

(with ∫P dδ of `analysis.theory.network_laws` by the JKR law) changes by the work W of the shear law, + for the secant
one and − for the incremental one, and of LAMMPS's lever arm, which is R for the slip and R − δ/2 for the torque:

    dW/dt = Σ ±½ (dk/dδ)(S/k)² dδ/dt − S (δ/2)(ω_i + ω_j)

and by that of what pushes or moves spheres from outside. E − W is constant where nothing slides, nothing is damped and
no held sphere moves by itself. Sliding, dashpots and drag let it fall, by the heat. S is the force of the spring, but
for the lever arm, on which the whole shear force acts.

Breaks where a contact of the incremental law opens: ½S²/k has no bound there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.theory.network import Network
from analysis.theory.network_state import Contacts, Pairs, State, present, slip

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Energy:
    """Kinetic energy, ∫f_N of the contacts (0 where they open), and ½S²/k of their shear."""

    kinetic: float
    normal: float
    shear: float

    @property
    def total(self) -> float:
        """Return the sum of the three."""
        return self.kinetic + self.normal + self.shear


def energy(network: Network, state: State) -> Energy:
    """Return the energy of a state; that of held spheres is left out, no force ever changes it."""
    now = present(network, state)
    free = network.mobility[0] > 0
    speeds = network.mass * (state.motion[3] ** 2 + state.motion[4] ** 2) + network.inertia * state.motion[5] ** 2
    normal = state.pairs.normal.energy(now.overlap, now.radius)
    return Energy(float(speeds[free].sum()) / 2, float(normal.sum()), float((now.spring * slip(now)).sum()) / 2)


def momentum(network: Network, state: State) -> Floats:
    """Return the momentum in x and y, and the angular momentum about the origin, (3,).

    Both are conserved where no sphere is held, the angular one in networks without periods only.
    """
    m, (ux, uy, _, vx, vy, omega) = network.mass, state.motion
    x, y = network.position[:, 0] + ux, network.position[:, 1] + uy
    return np.array([m @ vx, m @ vy, m @ (x * vy - y * vx) + network.inertia @ omega])


def work_rate(network: Network, motion: Floats, pairs: Pairs, now: Contacts) -> float:
    """Return dW/dt of the shear law and of the lever arm: the equation at the top of this module."""
    closing = -(now.normal[0] * now.apart[3] + now.normal[1] * now.apart[4])
    # ½ (dk/dδ)(S/k)² = ½ (S²/k) d(ln k)/dδ, and k ∝ a
    work = 2 * now.stiffness * pairs.normal.spreading(now.overlap, now.radius)
    law = closing * np.divide(now.spring**2, work, out=np.zeros_like(work), where=work > 0)
    turning = 2 * motion[5].take(pairs.first) + now.apart[5]
    lever = now.shear * now.overlap / 2 * turning
    return float(np.sum((-law if network.law == "incremental" else law) - lever))
