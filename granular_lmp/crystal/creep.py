"""Creep of a crystal in a running wave: slip that accumulates in the contacts, and the resulting steady motion.

The tangent of a contact turns by δT/ℓ. If δT is out of phase with the stretch δN, or with the twist Φ·n by which both
spheres turn the contact, slip accumulates in every period, at the mean rate

    ds/dt = (ω/2ℓ) Im[δT δN* + n × δT (Φ·n)*],    Φ = φ_i + φ_j,

and pushes the spheres with the force g s, where g is the shear stiffness. The incremental law adds the force
−g′(ω/2) Im[δS δN*] per unit of time. The spheres follow slowly, so forces balance: K v + Σ g ds/dt = 0, with the
stiffness K of motions that are the same in all cells. With one sphere per cell, in the bulk or in the plane, shapes are
real and there is no creep by the secant law. On a wall, whose normal does not turn, u_z is 90° out of phase with the
motion along the wave: a layer rolls away, in proportion to time and to a²Δ0/2R.

When it breaks: near a resonance, where the second harmonic creeps too and takes energy from the wave. The error is a
tenth of the creep over many beats of the two waves, and more than the creep over one beat.
"""

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.bloch import stretch_rows, twist_rows
from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.mode import TURNS, Mode, Physics
from granular_lmp.crystal.sphere import Sphere

_HELD = 1e-12  # stiffness, over the largest, added against free motions of a thick film; its softest motion has 1e-6
_FREE = 1e-9  # a motion with a stiffness below this share of the largest is free: no contact resists it


@lru_cache(maxsize=64)  # the rule, the guard and the deck of a scene ask for the same result
def creep_velocities(
    contacts: Contacts, sphere: Sphere, mode: Mode, physics: Physics, *, incremental: bool = False
) -> NDArray[np.float64]:
    """Return the creep velocities (P, 6) of u and φ of the spheres of a cell in a running wave, in D0/t0 per D0 in m.

    Parameters
    ----------
    contacts : Contacts
        Contacts of the cell, with its walls.
    sphere, mode
        As in `granular_lmp.crystal.modes.contact_stretches`.
    physics : Physics
        Degrees of freedom; without shear nothing creeps.
    incremental : bool
        True if shear forces follow the incremental law.
    """
    creeping = np.zeros(6 * len(contacts.mass), dtype=complex)
    if not physics.shear:
        return np.real(creeping).reshape(-1, 6)
    moving = np.array([6 * each + column for each in range(len(contacts.mass)) for column in physics.coordinates])
    k, still = np.array(mode.vector.components) / sphere.lattice_constant, np.zeros(2)
    shape, curving = (mode.shape() / TURNS).ravel(), np.where(contacts.on_wall, 0.0, 1 / contacts.length)
    growth = sphere.contact_law.softening(sphere.static_overlap)[1] / contacts.overlap * incremental
    normal, sideways, turn = stretch_rows(contacts, k)  # rows of −i times δN, δT and δS − δT
    stretch, twist = normal @ shape, twist_rows(contacts, k) @ shape
    one, other = (rows @ shape for rows in sideways)
    normal, moved, turned = stretch_rows(contacts, still)
    stiffness, load = _stiffness(contacts.normal_stiffness, normal), np.zeros_like(creeping)
    for way, (aside, across) in enumerate(((one, -other), (other, one))):  # n × t1 = t2, n × t2 = −t1
        wound = curving * np.imag(aside * stretch.conj() + across * twist.conj())
        wound -= growth * np.imag((aside + turn[way] @ shape) * stretch.conj())
        slip = moved[way] + turned[way]
        load += slip.conj().T @ (-0.5j * mode.frequency * contacts.shear_stiffness * wound)
        stiffness = stiffness + _stiffness(contacts.shear_stiffness, slip)
        stiffness = stiffness - _stiffness(contacts.contact_force * curving, moved[way])
    if isinstance(stiffness, np.ndarray):
        inverse = np.linalg.pinv(stiffness[np.ix_(moving, moving)], rcond=_FREE, hermitian=True)
        creeping[moving] = -inverse @ load[moving]
    else:
        from scipy.sparse import eye_array  # slow to import, and only thick films need it
        from scipy.sparse.linalg import splu

        held = stiffness.tocsr()[moving][:, moving]
        held = held + _HELD * abs(held).max() * eye_array(len(moving))  # holds motions that no contact resists
        creeping[moving] = -splu(held.tocsc()).solve(load[moving])
    return np.real(creeping.reshape(-1, 6) * TURNS)


def _stiffness(weight: NDArray[np.float64], rows: Any) -> Any:
    return rows.conj().T @ (rows * weight[:, None])
