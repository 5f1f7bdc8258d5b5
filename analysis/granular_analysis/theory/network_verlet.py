"""Velocity Verlet with contact history as in LAMMPS: a run of LAMMPS, up to rounding, without LAMMPS.

One step of length h of `granular_analysis.theory.network`, with the accelerations a of spheres and spins:

    v ← v + ½h a,   x ← x + h v                                  half a kick, and the drift
    s ← s turned into the plane across the new n, with its old length; then s ← s + h ds/dt
    a ← a(x, v, s),   v ← v + ½h a                               forces with the velocities of the half step

Slip rates and dashpots use the velocities of the half step, as LAMMPS computes forces between the two kicks. An open
contact forgets its slip; a sliding contact keeps the slip at its limit. With the incremental law the state is the force
of the spring in place of s. At the end of a step quiet ends multiply each velocity and spin by (1 − ½h c)/(1 + ½h c).
For a moved or turned sphere, contacts use the displacement over the last step. LAMMPS sets a spin at the end of a step,
so the first step has none.

Rotations in the plane are those of the dipoles in LAMMPS, which turn by arctan(hω) in a step; in space rotations of all
steps are composed, as for the quaternions in LAMMPS.

The code runs in NumPy, or in JAX for its arrays (`granular_analysis.theory.network_traced`).

Good values: h from 0.05 to 0.2 t0; the error is of second order. When it breaks: above 2/Ω of the fastest mode.

Source: LAMMPS, fix nve/sphere and pair granular (https://docs.lammps.org/pair_granular.html).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory.network import Acting, Network, Traits
from granular_analysis.theory.network_outside import Drive, imposed
from granular_analysis.theory.network_state import (
    Contacts,
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
    """Motion, slips and accelerations that a step hands on to the next; rows are (N,) each.

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


class Moment(NamedTuple):
    """Motion after a number of steps.

    Attributes
    ----------
    number : of steps.
    state : whose pairs the motion has.
    now : what the next step takes.
    """

    number: int
    state: State
    now: Carried


class Bodies(NamedTuple):
    """Numbers of the spheres that a step of length h takes.

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
    numbers = np.arange(first, first + count)
    times: Floats = np.asarray(step * numbers, dtype=np.float64)
    found = []
    for each in network.drives:
        value = each.signal(times)
        rate = (value - each.signal(times - step)) / step if each.moves else 0 * value
        rate = rate if each.rate is None else each.rate(times)
        if each.component >= network.dimension:
            rate = rate * (numbers > 1)
        found += [value, rate]
    xp = module_of(found[0]) if found else np
    return xp.moveaxis(xp.asarray(found).reshape(len(network.drives), 2, count), -1, 0)


def _drives(network: Network | Traits) -> Sequence[Drive | Acting]:
    return network.drives


def pushed(network: Network | Traits, bodies: Bodies, values: Floats, loads: Vector) -> Vector:
    """Return f rows of loads with forces and torques, by values (D, 2) of the signals."""
    rows, drives = list(loads), _drives(network)
    for each, (value, _), share in zip(drives, values, bodies.shares, strict=True):
        if not each.moves:
            rows[each.component] = rows[each.component] + value * share
    return rows


def moved(network: Network | Traits, bodies: Bodies, values: Floats, motion: Vector) -> Vector:
    """Return 2f rows of a motion with what is prescribed, by values (D, 2) of the signals."""
    xp, rows, drives = module_of(motion[0]), list(motion), _drives(network)
    for each, pair, acts, share in zip(drives, values, bodies.acts, bodies.shares, strict=True):
        if each.moves:
            for row, value in zip((each.component, each.component + network.freedoms), pair, strict=True):
                rows[row] = xp.where(acts, value * share, rows[row])
    return rows


def begun(network: Network, state: State, bodies: Bodies) -> Carried:
    """Return what the first step begins with: the forces of a state, with its velocities."""
    (values,) = signals(network, bodies.step, 0, 1)
    motion = np.array(moved(network, bodies, values, state.motion))
    now = present(network, replace(state, motion=motion), stepped=True)
    slips = combined(np.where(now.closed, state.shear, 0.0), now.tangents.along)
    loads = pushed(network, bodies, values, resultants(state.pairs, now))
    return Carried(tuple(state.motion), slips, now.closed, times(loads, network.mobility))


def stepped(network: Network | Traits, pairs: Pairs, bodies: Bodies, before: Carried, values: Floats) -> Carried:
    """Return the motion one step later; `values` (D, 2) are those of the `signals` there."""
    freedoms, dimension, step = network.freedoms, network.dimension, bodies.step
    xp = module_of(before.begun)
    velocity = plus(before.motion[freedoms:], scaled(step / 2, before.rates))
    way = scaled(step, velocity)
    turns = before.motion[dimension:freedoms]
    turns = plus(turns, [xp.arctan(way[2])]) if dimension == 2 else _composed(turns, way[3:])
    place = plus(before.motion[:dimension], way[:dimension])
    half = moved(network, bodies, values, [*place, *turns, *velocity])
    met = meetings(network, half, pairs, before.begun)
    rate = scaled(met.stiffness, met.slip_rate) if network.law == "incremental" else met.slip_rate
    memory = scaled(met.closed, plus(_turned(before.memory, met), scaled(step, rate)))
    now = acting(network, pairs, met, memory, stepped=True)
    if network.law == "incremental":
        memory = now.spring
    elif network.friction < np.inf:
        both = zip(now.spring, memory, slip(now), strict=True)
        memory = tuple(xp.where(spring != now.stiffness * was, after, was) for spring, was, after in both)
    rates = times(pushed(network, bodies, values, resultants(pairs, now)), bodies.mobility)
    speed = scaled(bodies.kept, plus(velocity, scaled(step / 2, rates)))
    return Carried((*half[:freedoms], *speed), combined(memory, met.tangents.along), met.closed, rates)


def _composed(turn: Vector, way: Vector) -> Vector:
    """Return turns, 2 tan(ϑ/2) times an axis, after a small one more by a rotation vector."""
    more = scaled(1 + dot(way, way) / 12, way)
    across = [more[k - 2] * turn[k - 1] - more[k - 1] * turn[k - 2] for k in range(3)]
    return scaled(1 / (1 - dot(more, turn) / 4), plus(plus(turn, more), scaled(0.5, across)))


def _turned(vector: Vector, met: Meetings) -> Vector:
    """Return the parts of vectors along the tangents, with the lengths that the vectors had."""
    parts = tuple(dot(vector, each) for each in met.tangents.along)
    left = length(parts)
    return scaled(quotient(length(vector), left, left > 0, 1.0), parts)  # 1: the slope where there is no slip


def seen(network: Network | Traits, pairs: Pairs, now: Carried) -> Contacts:
    """Return the contacts at the end of a step, with its velocities."""
    met = meetings(network, now.motion, pairs, now.begun)
    return acting(network, pairs, met, [dot(now.memory, each) for each in met.tangents.along], stepped=True)


def slip_ratios(network: Network | Traits, pairs: Pairs, there: Contacts) -> Floats:
    """Return the shear forces of contacts over those at which they slide with a friction of 1, (M,), 0 where open."""
    limit = module_of(there.overlap).abs(there.repulsion)
    if network.adheres or not (network.viscosity or network.restitution is not None):
        limit = pairs.normal.repulsion(there.overlap, there.radius, there.closed) + 2 * pairs.normal.pull * pairs.F
    return quotient(length(there.shear), limit, there.closed & (limit > 0), 0.0)


def extremes(network: Network | Traits, pairs: Pairs, now: Carried, rested: Any, near: Any) -> tuple[Any, ...]:
    """Return what guards ask of the contacts of some spheres, by the names of `granular_lmp.runs.engine.Look`.

    Parameters
    ----------
    rested : (M,) whether the pairs touched at rest.
    near : (N,) which spheres are judged.
    """
    xp, there = module_of(now.begun), seen(network, pairs, now)
    wall = pairs.second >= len(network.position)
    ends = xp.concatenate([near, xp.ones(len(network.walls), dtype=bool)])
    here, other = near[pairs.first], ends[pairs.second]
    closed = there.closed & here & other
    changed = xp.sum((there.closed != rested) * (here * 1.0 + (other & ~wall))) / 2
    turning = [xp.max(xp.where(near, xp.abs(row), 0.0)) for row in resultants(pairs, there)[network.dimension :]]
    on_wall = quotient(there.overlap, pairs.overlap, closed & wall & (pairs.overlap > 0), xp.inf)
    return (
        xp.min(xp.where(closed & ~wall, there.overlap, xp.inf), initial=xp.inf),
        xp.min(on_wall, initial=xp.inf),
        xp.max(xp.where(closed, there.overlap, 0.0), initial=0.0),
        changed,
        xp.max(xp.where(closed, slip_ratios(network, pairs, there), 0.0), initial=0.0),
        xp.sqrt(sum(each * each for each in turning)),
    )


def arrays_of(pairs: Pairs) -> Pairs:
    """Return what `extremes` takes of pairs."""
    return pairs


def taken(rows: Vector, spheres: NDArray[np.int64]) -> Floats:
    """Return the values of some spheres, a row of each row (N,)."""
    return np.stack([row[spheres] for row in rows])


def moments(
    network: Network, state: State, step: float, stops: Iterable[int], begin: Moment | None = None
) -> Iterator[Moment]:
    """Yield the motion after each of some ascending numbers of steps, from a state or from a later moment of it on."""
    bodies = Bodies.of(network, step)
    last = begin or Moment(0, state, begun(network, state, bodies))
    for stop in stops:
        _, state, now = last
        for values in signals(network, step, last.number + 1, stop - last.number):
            now = stepped(network, state.pairs, bodies, now, values)
            if np.abs(now.motion[: network.dimension] - state.pairs.place).max() > network.margin / 4:
                state, now = renewed(network, state, now)
        last = Moment(stop, state, now)
        yield last


def march(network: Network, state: State, step: float, count: int, every: int) -> Iterator[Floats]:
    """Yield the motions (2f, N) at the start and after each `every` of at most `count` steps."""
    yield from motions(network, step, moments(network, state, step, range(0, count + 1, every)))


def motions(network: Network, step: float, found: Iterable[Moment]) -> Iterator[Floats]:
    """Yield the motion (2f, N) of each moment, with what drives prescribe then."""
    for each in found:
        yield imposed(network.drives, each.number * step, np.array(each.now.motion))


def renewed(network: Network, state: State, now: Carried) -> tuple[State, Carried]:
    """Return a state and what is carried with its pairs searched again."""
    met = meetings(network, now.motion, state.pairs, now.begun)
    parts = _turned(now.memory, met)
    found = searched_again(network, replace(state, motion=np.array(now.motion), shear=np.array(parts), begun=now.begun))
    there = present(network, found)
    return found, now._replace(memory=combined(found.shear, there.tangents.along), begun=found.begun)
