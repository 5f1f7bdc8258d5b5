"""Velocity Verlet with the history of contacts as LAMMPS steps it: a run of LAMMPS, to rounding, without LAMMPS.

One step of length h of `granular_analysis.theory.network`, with the accelerations a of spheres and spins:

    v ← v + ½h a,   x ← x + h v                                  half a kick, and the drift
    s ← s turned into the plane across the new n, with its old length; then s ← s + h ds/dt
    a ← a(x, v, s),   v ← v + ½h a                               forces with the velocities of the half step

Slip rates and dashpots have the velocities of the half step, as LAMMPS computes forces between the two kicks. A contact
that is open forgets its slip; one that slides keeps the slip of its limit. With the incremental law the force of the
spring is carried in the place of s. At the end of a step quiet ends leave (1 − ½h c)/(1 + ½h c) of each velocity and
spin. Of a sphere that is moved, contacts see the way over the last step, of one that is turned that over the next.

Turns in the plane are those of LAMMPS's dipoles, which turn by arctan(hω) in a step.

The lines are those of NumPy, or of JAX where its arrays come in (`granular_analysis.theory.network_traced`).

Good values: h from 0.05 to 0.2 t0; the error is of second order. When it breaks: above 2/Ω of the fastest mode.

Source: LAMMPS, fix nve/sphere and pair granular (https://docs.lammps.org/pair_granular.html).
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory.network import Network
from granular_analysis.theory.network_outside import imposed
from granular_analysis.theory.network_state import (
    Meetings,
    Pairs,
    State,
    acting,
    meetings,
    present,
    resultants,
    searched_again,
    slip,
)
from granular_analysis.theory.network_tangents import (
    Vector,
    combined,
    dot,
    length,
    module_of,
    plus,
    quotient,
    scaled,
    times,
)

__all__ = ["march"]

Floats = NDArray[np.float64]


class Carried(NamedTuple):
    """What a step hands on to the next one; rows are (N,) each.

    Attributes
    ----------
    motion : 2f rows: displacements, turns, velocities, spins.
    memory : slip of the pairs as a vector of d components (M,), or the force of its spring by the incremental law.
    begun : (M,) whether the pairs touch.
    rates : f rows of accelerations.
    """

    motion: Vector
    memory: Vector
    begun: NDArray[np.bool_]
    rates: Vector


class Bodies(NamedTuple):
    """What a step of the length h takes of the spheres.

    Attributes
    ----------
    step : h.
    mobility : (f, N) accelerations per force and torque.
    kept : (N,) share of each velocity and spin that quiet ends leave in a step.
    acts, shares : (D, N) whether each drive acts on each sphere, and the factor of its signal there.
    """

    step: float
    mobility: Floats
    kept: Floats
    acts: NDArray[np.bool_]
    shares: Floats

    @classmethod
    def of(cls, network: Network, step: float) -> "Bodies":
        """Return those of a network."""
        count = len(network.position)
        loss = np.zeros(count) if network.drag is None else step / 2 * network.drag
        acts, shares = np.zeros((len(network.drives), count), dtype=bool), np.zeros((len(network.drives), count))
        for number, each in enumerate(network.drives):
            acts[number, each.spheres], shares[number, each.spheres] = True, each.share
        return cls(step, network.mobility, (1 - loss) / (1 + loss), acts, shares)


def signals(network: Network, step: float, first: int, count: int) -> Floats:
    """Return values of the drives from a step on, and the rates that contacts see of those that move spheres.

    (count, D, 2)
    """
    times: Floats = np.asarray(step * np.arange(first, first + count), dtype=np.float64)
    found = []
    for each in network.drives:
        value, begin = each.signal(times), times if each.component >= network.dimension else times - step
        rate = (each.signal(begin + step) - each.signal(begin)) / step if each.moves else 0 * value
        found += [value, rate]
    xp = module_of(found[0]) if found else np
    return xp.moveaxis(xp.asarray(found).reshape(len(network.drives), 2, count), -1, 0)


def pushed(network: Network, bodies: Bodies, values: Floats, loads: Vector) -> Vector:
    """Return f rows of loads with forces and torques, by values (D, 2) of the signals."""
    rows = list(loads)
    for each, (value, _), share in zip(network.drives, values, bodies.shares, strict=True):
        if not each.moves:
            rows[each.component] = rows[each.component] + value * share
    return rows


def moved(network: Network, bodies: Bodies, values: Floats, motion: Vector) -> Vector:
    """Return 2f rows of a motion with what is prescribed, by values (D, 2) of the signals."""
    xp, rows = module_of(motion[0]), list(motion)
    for each, pair, acts, share in zip(network.drives, values, bodies.acts, bodies.shares, strict=True):
        if each.moves:
            for row, value in zip((each.component, each.component + network.freedoms), pair, strict=True):
                rows[row] = xp.where(acts, value * share, rows[row])
    return rows


def begun(network: Network, state: State, bodies: Bodies) -> Carried:
    """Return what the first step begins with: the forces of a state, with its velocities."""
    (values,) = signals(network, bodies.step, 0, 1)
    motion = np.array(moved(network, bodies, values, state.motion))
    now = present(network, replace(state, motion=motion))
    slips = combined(np.where(now.closed, state.shear, 0.0), now.tangents.along)
    loads = pushed(network, bodies, values, resultants(state.pairs, now))
    return Carried(tuple(state.motion), slips, now.closed, times(loads, network.mobility))


def stepped(network: Network, pairs: Pairs, bodies: Bodies, before: Carried, values: Floats) -> Carried:
    """Return the motion one step later; `values` (D, 2) are those of the `signals` there."""
    freedoms, dimension, step = network.freedoms, network.dimension, bodies.step
    xp = module_of(before.begun)
    velocity = plus(before.motion[freedoms:], scaled(step / 2, before.rates))
    way = scaled(step, velocity)
    turn = [xp.arctan(each) for each in way[dimension:]] if dimension == 2 else way[dimension:]
    place = plus(before.motion[:freedoms], [*way[:dimension], *turn])
    half = moved(network, bodies, values, [*place, *velocity])
    met = meetings(network, half, pairs, before.begun)
    rate = scaled(met.stiffness, met.slip_rate) if network.law == "incremental" else met.slip_rate
    memory = scaled(met.closed, plus(_turned(before.memory, met), scaled(step, rate)))
    now = acting(network, pairs, met, memory)
    if network.law == "incremental":
        memory = now.spring
    elif network.friction < np.inf:
        both = zip(now.spring, memory, slip(now), strict=True)
        memory = tuple(xp.where(spring != now.stiffness * was, after, was) for spring, was, after in both)
    rates = times(pushed(network, bodies, values, resultants(pairs, now)), bodies.mobility)
    speed = scaled(bodies.kept, plus(velocity, scaled(step / 2, rates)))
    return Carried((*half[:freedoms], *speed), combined(memory, met.tangents.along), met.closed, rates)


def _turned(vector: Vector, met: Meetings) -> Vector:
    """Return the parts of vectors along the tangents, with the lengths that the vectors had."""
    parts = tuple(dot(vector, each) for each in met.tangents.along)
    left = length(parts)
    return scaled(quotient(length(vector), left, left > 0, 0.0), parts)


def march(network: Network, state: State, step: float, count: int, every: int) -> Iterator[Floats]:
    """Yield the motions (2f, N) at the start and after each `every` of some steps."""
    bodies = Bodies.of(network, step)
    values = signals(network, step, 1, count)
    now = begun(network, state, bodies)
    yield imposed(network.drives, 0.0, np.array(now.motion))
    for number in range(1, count + 1):
        now = stepped(network, state.pairs, bodies, now, values[number - 1])
        if number % every == 0:
            yield imposed(network.drives, number * step, np.array(now.motion))
        if np.abs(now.motion[: network.dimension] - state.pairs.place).max() > network.margin / 4:
            state, now = renewed(network, state, now)


def renewed(network: Network, state: State, now: Carried) -> tuple[State, Carried]:
    """Return a state and what is carried with its pairs searched again."""
    met = meetings(network, now.motion, state.pairs, now.begun)
    parts = _turned(now.memory, met)
    found = searched_again(network, replace(state, motion=np.array(now.motion), shear=np.array(parts), begun=now.begun))
    there = present(network, found)
    return found, now._replace(memory=combined(found.shear, there.tangents.along), begun=found.begun)
