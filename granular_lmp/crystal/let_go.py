"""Release of spheres, which then move against a drag until hardly any force is left; `equilibrium` has the protocol.

In units of the contact between two spheres of the first material every sphere has mass 1 and drag coefficient 1. With
friction it also has the moment of inertia Ĩ R², and a rotational drag that slows its spin at the same rate.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal import friction as shear
from granular_lmp.crystal.potential import Potential, State
from granular_lmp.crystal.sphere import INERTIA_RATIO

Floats = NDArray[np.float64]
Progress = Callable[[str, int, float, float], None]
SETTLED = 1e-3  # k1 Δ0, root mean square force from which Newton steps find the rest to which the spheres are settling
DRAG = 1.0  # √(k1 m)
# Inertia of the box in N m (2R)², and its drag in √(k1/m) times the inertia. With a hundredth of this inertia the box
# swings and tears contacts (Z = 4.5 instead of 5.0 at s = 2). With three times the drag it takes three times as long,
# and the contacts per sphere differ by 0.03.
_BOX_INERTIA, _BOX_DRAG = 100.0, 0.3
_LONGEST = 2000.0  # √(m/k1): time after which spheres that still creep are left to the Newton steps
_STEP = 1.4  # time step times an upper bound of the frequencies of one sphere; stable below 2
_CHECKED = 20  # steps between two checks of the forces, the stiffest contacts and the list of pairs
_SHORT = 400  # largest number of steps for an avalanche


def let_go(
    potential: Potential,
    state: State,
    progress: Progress | None = None,
    friction: float = 0.0,
    settled: float = SETTLED,
) -> State:
    """Return the state after spheres, released from rest, have moved against a drag until forces are small.

    Parameters
    ----------
    potential, state : energy of the crystal, and the state at the start
    progress : callable, as in `granular_lmp.crystal.equilibrium.relax`
    friction : coefficient of friction. If it is not 0, contacts have shear springs, which are discarded at the end, and
        spheres turn
    settled : root mean square force at the end, k1 Δ0
    """
    count, box = len(state.u), _BOX_INERTIA * potential.mass[-1]
    velocity, spin, rate = np.zeros_like(state.u), np.zeros(count), np.zeros_like(state.e)
    slip = np.zeros(len(state.pairs.i))
    force, torque, stress = state.force, spin, state.stress
    time, step = 0.0, 0
    while True:
        if step % _CHECKED == 0:
            if progress:
                stage = "let go with friction" if friction else "let go"
                progress(stage, step, potential.residual(state), potential.energy(state))
            on_box = stress / potential.neighbour / count
            mean_square = (np.sum(force**2) + np.sum(torque**2)) / count + np.sum(on_box**2)
            if mean_square < settled**2 or time > _LONGEST:
                return state
            known, state = state.pairs, potential.renewed(state)
            if friction:
                slip = shear.carried_over(known, state.pairs, slip)
            dt = _time_step(potential, state, shear.stiffest(state) if friction else state.normal_stiffness)
        velocity += dt * force
        velocity /= 1 + DRAG * dt
        rate = (rate + dt * stress / box) / (1 + _BOX_DRAG * dt)
        before, state = state, potential.state(state.pairs, state.u + dt * velocity, state.e + dt * rate)
        force, stress = state.force, state.stress
        if friction:
            spin = (spin + dt * torque / INERTIA_RATIO) / (1 + DRAG * dt)
            slip = shear.slipped(potential, slip, before, state, dt * spin, friction)
            sideways, torque, on_box = shear.shear_forces(potential, slip, state)
            force, stress = force + sideways, stress + on_box
        time, step = time + dt, step + 1


def let_go_near(potential: Potential, state: State, moving: NDArray[np.bool_]) -> State:
    """Return the state after some bodies (N,) have moved from rest against the drag, while all others were held.

    They move until no force on them is above `SETTLED`, or for `_SHORT` steps. In this time no sphere can reach a
    sphere outside the list of pairs.
    """
    pairs = state.pairs
    which = np.flatnonzero(moving[pairs.i] | moving[pairs.j])
    bodies = np.unique(np.concatenate([pairs.i[which], pairs.j[which], np.flatnonzero(moving)]))
    near = pairs.of(which)
    near = replace(near, i=np.searchsorted(bodies, near.i), j=np.searchsorted(bodies, near.j))
    part = replace(
        potential,
        crystal=potential.crystal[bodies[bodies < len(potential.crystal)]],
        free=(potential.free & moving)[bodies],
        breathing=np.zeros_like(potential.breathing),
    )
    now = part.state(near, state.u[bodies], state.e)
    velocity = np.zeros_like(now.u)
    for step in range(_SHORT):
        if step % _CHECKED == 0:
            if part.residual(now) < SETTLED:
                break
            dt = _time_step(part, now, now.normal_stiffness)
        velocity += dt * now.force
        velocity /= 1 + DRAG * dt
        now = part.state(near, now.u + dt * velocity, now.e)
    u = state.u.copy()
    u[bodies] = now.u
    return potential.state(pairs, u, state.e)


def _time_step(potential: Potential, state: State, stiffness: Floats) -> float:
    """Return the time step, √(m/k1), from the stiffnesses (C,) of the pairs, k1; the sum at a sphere is at least 1."""
    pairs, count = state.pairs, len(state.u)
    sums = np.bincount(pairs.i, stiffness, count) + np.bincount(pairs.j, stiffness, count)
    stiffest = max(float(sums[: len(potential.crystal)].max()), 1.0)  # without the body of the walls
    return float(_STEP / np.sqrt(2 * stiffest))
