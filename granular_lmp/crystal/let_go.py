"""Spheres that are let go: they move against a drag until hardly any force is left; see `equilibrium` for the protocol.

In units of the contact between two spheres of the first material every sphere has the mass 1 and the drag coefficient
1, and with friction the moment of inertia Ĩ R² and a drag on its turning that slows it at the same rate.
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
SETTLED = 1e-3  # k1 Δ0, root mean square: from here Newton steps find the rest that the spheres are settling to
DRAG = 1.0  # √(k1 m)
# N m (2R)², and √(k1/m) of that. A box of a hundredth of this inertia tears contacts by its swing (Z = 4.5 for 5.0 at
# s = 2); one that is damped three times as much takes three times as long, to contacts that differ by 0.03 a sphere.
_BOX_INERTIA, _BOX_DRAG = 100.0, 0.3
_LONGEST = 2000.0  # √(m/k1): spheres that still creep then are handed to the Newton steps
_STEP = 1.4  # time step, times the highest frequency that the contacts of one sphere could have; stable below 2
_CHECKED = 20  # steps between two looks at the forces, the stiffest contacts and the list of pairs
_SHORT = 400  # steps, in which an avalanche ends


def let_go(
    potential: Potential,
    state: State,
    progress: Progress | None = None,
    friction: float = 0.0,
    settled: float = SETTLED,
) -> State:
    """Return the state that spheres at rest come to as they move against a drag, until the mean force is small.

    `settled` is that force, root mean square in k1 Δ0. With `friction` contacts have shear springs and spheres turn;
    the springs are forgotten at the end.
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
    """Return the state after some bodies (N,) have moved against the drag, from rest, while all others were held.

    They move until no force on them is above `SETTLED`, or for `_SHORT` steps. That is too short for a sphere to reach
    one that is not in the list of pairs.
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
    """Return the time step, √(m/k1), at stiffnesses (C,) of the pairs, k1; one contact of a sphere has at least 1."""
    pairs, count = state.pairs, len(state.u)
    sums = np.bincount(pairs.i, stiffness, count) + np.bincount(pairs.j, stiffness, count)
    stiffest = max(float(sums[: len(potential.crystal)].max()), 1.0)  # without that of the walls
    return float(_STEP / np.sqrt(2 * stiffest))
