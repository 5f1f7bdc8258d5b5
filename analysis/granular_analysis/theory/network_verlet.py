"""Velocity Verlet with contact history as in LAMMPS: the motion of a LAMMPS run, up to rounding, without LAMMPS.

One step of length h for `granular_analysis.theory.network`, with the accelerations a of translations and spins:

    v ← v + ½h a,   x ← x + h v                                  half a kick, and the drift
    s ← s projected on the plane normal to the new n, with its old length; then s ← s + h ds/dt
    a ← a(x, v, s),   v ← v + ½h a                               forces with the velocities of the half step

Slip rates and dashpots use the velocities of the half step, since LAMMPS computes forces between the two kicks. An open
contact forgets its slip; a sliding contact keeps the slip at its limit. Under the incremental law, the force of the
spring replaces s. At the end of a step, quiet ends of decay rate c multiply each velocity and spin by
(1 − ½h c)/(1 + ½h c). If a drive prescribes the motion of a sphere, its contacts see the mean velocity over the last
step, or `Drive.rate`. LAMMPS sets a prescribed spin at the end of a step, so in the first step it is 0.

In the plane, rotations are those of the dipoles in LAMMPS, which turn by arctan(hω) in a step. In space, the rotations
of all steps are composed, like the quaternions in LAMMPS.

The code runs on arrays of NumPy, or of JAX (`granular_analysis.theory.network_traced`).

Good values: h from 0.05 to 0.2 t0; the error is of second order in h. When it breaks: at h above 2/Ω, with the
frequency Ω of the fastest mode.

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
    """Motion, slips and accelerations that a step hands on to the next.

    Attributes
    ----------
    motion : 2f rows (N,): displacements, turns, velocities, spins.
    memory : slip of the pairs, d components (M,); under the incremental law the force of the shear spring.
    begun : (M,) whether the pairs touch.
    rates : f rows (N,) of accelerations.
    """

    motion: Vector
    memory: Vector
    begun: NDArray[np.bool_]
    rates: Vector


class Moment(NamedTuple):
    """Motion after a number of steps.

    Attributes
    ----------
    number : number of steps since the start.
    state : state at the last search; the motion uses its pairs.
    now : input of the next step.
    """

    number: int
    state: State
    now: Carried


class Bodies(NamedTuple):
    """Properties of the spheres that a step needs.

    Attributes
    ----------
    step : length h of a step.
    mobility : (f, N) accelerations per force and torque.
    kept : (N,) factor by which quiet ends multiply each velocity and spin in a step.
    acts : (D, N) whether each drive acts on each sphere.
    shares : (D, N) factor of each signal on each sphere.
    """

    step: float
    mobility: Floats
    kept: Floats
    acts: NDArray[np.bool_]
    shares: Floats

    @classmethod
    def of(cls, network: Network, step: float) -> "Bodies":
        """Return the properties for a network and a step."""
        count = len(network.position)
        loss = np.zeros(count) if network.drag is None else step / 2 * network.drag
        acts, shares = np.zeros((len(network.drives), count), dtype=bool), np.zeros((len(network.drives), count))
        for number, each in enumerate(network.drives):
            acts[number, each.spheres], shares[number, each.spheres] = True, each.share
        return cls(step, network.mobility, (1 - loss) / (1 + loss), acts, shares)


def signals(network: Network, step: float, first: int, count: int) -> Floats:
    """Return values and rates of the signals, (count, D, 2), in `count` steps from the step `first` on.

    A rate is the velocity that contacts see in that step (module docstring, `Drive.rate`), 0 for a push.
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
    """Return the loads, f rows (N,), plus the pushes of drives with values (D, 2) of the signals."""
    rows, drives = list(loads), _drives(network)
    for each, (value, _), share in zip(drives, values, bodies.shares, strict=True):
        if not each.moves:
            rows[each.component] = rows[each.component] + value * share
    return rows


def moved(network: Network | Traits, bodies: Bodies, values: Floats, motion: Vector) -> Vector:
    """Return the motion, 2f rows (N,), with prescribed rows set to values (D, 2) of the signals."""
    xp, rows, drives = module_of(motion[0]), list(motion), _drives(network)
    for each, pair, acts, share in zip(drives, values, bodies.acts, bodies.shares, strict=True):
        if each.moves:
            for row, value in zip((each.component, each.component + network.freedoms), pair, strict=True):
                rows[row] = xp.where(acts, value * share, rows[row])
    return rows


def begun(network: Network, state: State, bodies: Bodies) -> Carried:
    """Return the input of the first step: the motion, slips and accelerations of a state."""
    (values,) = signals(network, bodies.step, 0, 1)
    motion = np.array(moved(network, bodies, values, state.motion))
    now = present(network, replace(state, motion=motion), stepped=True)
    slips = combined(np.where(now.closed, state.shear, 0.0), now.tangents.along)
    loads = pushed(network, bodies, values, resultants(state.pairs, now))
    return Carried(tuple(state.motion), slips, now.closed, times(loads, network.mobility))


def stepped(network: Network | Traits, pairs: Pairs, bodies: Bodies, before: Carried, values: Floats) -> Carried:
    """Return the motion one step later; `values` (D, 2) are the `signals` of that step."""
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
    """Return rotations, 2 tan(ϑ/2) times an axis, after one more by the small rotation vector `way`."""
    more = scaled(1 + dot(way, way) / 12, way)
    across = [more[k - 2] * turn[k - 1] - more[k - 1] * turn[k - 2] for k in range(3)]
    return scaled(1 / (1 - dot(more, turn) / 4), plus(plus(turn, more), scaled(0.5, across)))


def _turned(vector: Vector, met: Meetings) -> Vector:
    """Return the components of vectors along the tangents, scaled to keep the lengths of the vectors."""
    parts = tuple(dot(vector, each) for each in met.tangents.along)
    left = length(parts)
    return scaled(quotient(length(vector), left, left > 0, 1.0), parts)  # 1 is the derivative at zero slip


def seen(network: Network | Traits, pairs: Pairs, now: Carried) -> Contacts:
    """Return the contacts at the end of a step, with the velocities there."""
    met = meetings(network, now.motion, pairs, now.begun)
    return acting(network, pairs, met, [dot(now.memory, each) for each in met.tangents.along], stepped=True)


def slip_ratios(network: Network | Traits, pairs: Pairs, there: Contacts) -> Floats:
    """Return the shear force of contacts over their sliding limit at friction 1, (M,); 0 where open."""
    limit = module_of(there.overlap).abs(there.repulsion)
    if network.adheres or not (network.viscosity or network.restitution is not None):
        limit = pairs.normal.repulsion(there.overlap, there.radius, there.closed) + 2 * pairs.normal.pull * pairs.F
    return quotient(length(there.shear), limit, there.closed & (limit > 0), 0.0)


def extremes(network: Network | Traits, pairs: Pairs, now: Carried, rested: Any, near: Any) -> tuple[Any, ...]:
    """Return the numbers that guards ask of contacts, in the order of the fields of `granular_lmp.runs.engine.Look`.

    They are the smallest overlap of pairs of spheres, the smallest overlap on a wall over that at rest, the largest
    overlap, the number of contacts that opened or closed since rest, the largest of `slip_ratios`, and the largest
    torque.

    Parameters
    ----------
    rested : (M,) whether the pairs touched at rest.
    near : (N,) whether a sphere is judged.
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
    """Return the pairs as `extremes` takes them: unchanged, since NumPy needs no copy on a device."""
    return pairs


def taken(rows: Vector, spheres: NDArray[np.int64]) -> Floats:
    """Return the values of some spheres (n,), one row for each row (N,)."""
    return np.stack([row[spheres] for row in rows])


def moments(
    network: Network, state: State, step: float, stops: Iterable[int], begin: Moment | None = None
) -> Iterator[Moment]:
    """Yield the motion after each number of steps in `stops`, ascending, from a state or a later moment `begin`."""
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
    """Yield the motions (2f, N) at the start and after every `every` steps, `count` steps at most."""
    yield from motions(network, step, moments(network, state, step, range(0, count + 1, every)))


def motions(network: Network, step: float, found: Iterable[Moment]) -> Iterator[Floats]:
    """Yield the motion (2f, N) of each moment, with prescribed rows set to their values at that time."""
    for each in found:
        yield imposed(network.drives, each.number * step, np.array(each.now.motion))


def renewed(network: Network, state: State, now: Carried) -> tuple[State, Carried]:
    """Return the state and the input of the next step with newly searched pairs."""
    met = meetings(network, now.motion, state.pairs, now.begun)
    parts = _turned(now.memory, met)
    found = searched_again(network, replace(state, motion=np.array(now.motion), shear=np.array(parts), begun=now.begun))
    there = present(network, found)
    return found, now._replace(memory=combined(found.shear, there.tangents.along), begun=found.begun)
