"""Shear springs with Coulomb's limit, for contacts between spheres that move and turn in the plane.

With the normal n of a contact from i to j and t = ẑ × n, the slip s of the contact and its force f_S on i along t are
those of the deck (LAMMPS's ``tangential mindlin``), with the shear stiffness g of the law, B √δ by the DMT law:

    ds/dt = t·(v_j − v_i) − (R_i ω_i + R_j ω_j),    f_S = g s,    |f_S| ≤ μ (f_N + 2F)

A sliding contact keeps the slip at its limit; a contact that opens loses its slip. The lever arms of the torque are
R − δ/2, so no contact turns its pair as a whole. The forces depend on the path and do not derive from an energy.

Units are those of `granular_lmp.crystal.potential`; an angle is the path of a point at the distance R of the first
material.
"""

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.potential import Pairs, Potential, State
from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.errors import CrystalError

Floats = NDArray[np.float64]


def slipped(potential: Potential, slip: Floats, before: State, after: State, turn: Floats, friction: float) -> Floats:
    """Return the slips (C,) after a short step in which the spheres turn by angles (N,).

    `friction` is μ; inf for contacts that never slide.
    """
    pairs, radius = after.pairs, potential.crystal.arrays["radius"]
    # t·(d after − d before) = −t·d before, because t is perpendicular to the contact after the step
    along = (after.vector[1] * before.vector[0] - after.vector[0] * before.vector[1]) / after.length
    moved = slip + along - radius[pairs.i] * turn[pairs.i] - radius[pairs.j] * turn[pairs.j]
    stiffness = after.shear_stiffness
    touching = stiffness > 0
    limit = np.full_like(slip, np.inf)
    np.divide(friction * (after.contact_force + 2 * pairs.law.pull_off_force), stiffness, out=limit, where=touching)
    return np.where(touching, np.clip(moved, -limit, limit), 0.0)


def shear_forces(potential: Potential, slip: Floats, state: State) -> tuple[Floats, Floats, Floats]:
    """Return the forces (N, 2) and torques (N,) on the free spheres and the stress (2,) on the box from slips (C,)."""
    pairs, count, radius = state.pairs, len(state.u), potential.crystal.arrays["radius"]
    push = state.shear_stiffness * slip
    across = np.stack([-state.vector[1], state.vector[0]]) * (push / state.length)  # on i; the opposite on j
    force = np.stack([np.bincount(pairs.i, part, count) - np.bincount(pairs.j, part, count) for part in across], axis=1)
    half = state.overlap * potential.unit / 2
    arms = np.concatenate([radius[pairs.i] - half, radius[pairs.j] - half])
    ends = np.concatenate([pairs.i, pairs.j])
    torque = np.asarray(np.bincount(ends, np.tile(push, 2) * arms, count), dtype=float)
    stress = -np.einsum("ac,ac->a", across, state.vector) / (1 + state.e)
    return (
        force * potential.free[:, None] * (1 + state.e),
        torque * potential.free,
        np.where(potential.breathing, stress, 0.0),
    )


def stiffest(state: State) -> Floats:
    """Return a normal stiffness for each pair, (C,), that makes it vibrate at least as fast as its two springs do.

    A contact of two free spheres of mass 1 adds at most 2 k to the square of a frequency through its normal spring and
    2 (1 + 1/Ĩ) k through its shear spring.
    """
    return np.maximum(state.normal_stiffness, (1 + 1 / INERTIA_RATIO) * state.shear_stiffness)


def carried_over(old: Pairs, new: Pairs, slip: Floats) -> Floats:
    """Return the slips (C,) of a new list of pairs from those of the old list; new pairs have slip 0."""
    count = int(max(old.j.max(initial=0), new.j.max(initial=0))) + 1
    known, wanted = old.i * count + old.j, new.i * count + new.j
    place = np.minimum(np.searchsorted(known, wanted), len(known) - 1)
    return np.where(known[place] == wanted, slip[place], 0.0)


def require_friction(friction: float, pairs: Pairs) -> None:
    """Raise a CrystalError unless the coefficient of friction is valid and every pair of spheres touches only once."""
    if not friction >= 0:
        raise CrystalError(f"friction = {friction!r}: must be at least 0")
    if not friction:
        return
    both = np.column_stack([pairs.i, pairs.j])
    pair, count = np.unique(both, axis=0, return_counts=True)
    twice = pair[(count > 1) | (pair[:, 0] == pair[:, 1])]
    if len(twice):
        raise CrystalError(
            f"friction = {friction!r}: spheres {twice[0, 0]} and {twice[0, 1]} meet more than once across periodic "
            "faces, but each pair can have only one slip; take at least 3 columns and 4 rows, or friction = 0"
        )
