"""A packing of spheres at one moment: its motion, the pairs that may touch, and the forces of their contacts.

The laws are those of `granular_analysis.theory.network`, in its terms. Spheres in d dimensions have f freedoms: x, y
and the turn about z in the plane, three ways and three turns in space. Turns in space are 2 tan(ϑ/2) times the axis of
the turn ϑ, as a quaternion gives it; forces do not depend on them.

A wall is the last of the bodies of a pair: a held sphere of `_FAR` times the radius of the first one, whose normal
turns by 1e-9 of the way of that one, relative to R.
"""

from dataclasses import dataclass, replace
from math import hypot, log, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network import Network, Wall
from granular_analysis.theory.network_laws import LAWS, Dmt, Jkr
from granular_analysis.theory.network_tangents import (
    Tangents,
    combined,
    dot,
    frames,
    rebased,
    swerved,
    tangents,
    turned,
)

__all__ = ["start"]

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
Bools = NDArray[np.bool_]
_FAR = 1e9  # a plane, in radii of the sphere on it


@dataclass(frozen=True, eq=False)
class Pairs:
    """M pairs of spheres that touch or may do so before the next search.

    Attributes
    ----------
    first, second : (M,) indices of the spheres.
    apart : (d, M) from first to second at rest, to the image of second that is near; its length (M,).
    overlap : (M,) at rest, negative for a gap.
    radii : (2, M) of first and second, the second 0 of a wall.
    shortened : (M,) by how much of the overlap an arm is shorter than its radius: ½, and 0 on a wall.
    mass : (M,) reduced, 1/(1/m + 1/m) of both.
    A, B, F : (M,) coefficients of the contacts.
    place : (d, N) displacements at which the search was made.
    frame : of the tangents (`granular_analysis.theory.network_tangents`).
    normal : law of the normal forces.
    """

    first: Integers
    second: Integers
    apart: Floats
    length: Floats
    overlap: Floats
    radii: Floats
    shortened: Floats
    mass: Floats
    A: Floats
    B: Floats
    F: Floats
    place: Floats
    frame: Floats
    normal: Dmt | Jkr


@dataclass(frozen=True, eq=False)
class State:
    """Motion of a network at one moment.

    Attributes
    ----------
    motion : (2f, N): displacement, turn, velocity, spin; x, y, θ, v_x, v_y, ω in the plane.
    pairs : the candidates for contacts.
    shear : (d − 1, M) slip of the pairs along their tangents, or their shear force under the incremental law; 0 where
        open.
    begun : (M,) whether the pairs have touched and not parted since: by the JKR law these hold beyond an overlap of 0.
    """

    motion: Floats
    pairs: Pairs
    shear: Floats
    begun: Bools


class Contacts(NamedTuple):
    """State of the pairs at one moment, by the terms at the top of this module; forces and slip rates are 0 where open.

    Attributes
    ----------
    overlap : (M,) δ, 0 where open.
    normal : (d, M).
    tangents : of the normals.
    closed : (M,) whether they touch.
    radius : (M,) a/√Rc, δ^{1/2} by the DMT law.
    stiffness : (M,) k = B a/√Rc.
    repulsion, shear : P (M,), and S along the tangents (d − 1, M).
    twist : (1 or 3, M) n × S.
    spring : (d − 1, M) S less its dashpot.
    rate : (d, M) velocity of the second sphere less that of the first.
    spins : (1 or 3, M) sum of their spins.
    slip_rate : (d − 1, M) ds/dt.
    memory_rate : (d − 1, M) rate of `State.shear`.
    """

    overlap: Floats
    normal: Floats
    tangents: Tangents
    closed: Bools
    radius: Floats
    stiffness: Floats
    repulsion: Floats
    shear: Floats
    twist: Floats
    spring: Floats
    rate: Floats
    spins: Floats
    slip_rate: Floats
    memory_rate: Floats


def search(network: Network, displacement: Floats) -> Pairs:
    """Return all pairs with gaps below the margin, for spheres displaced by (d, N)."""
    from scipy.spatial import cKDTree  # slow to import, and only networks need it

    period = np.array(network.cell)
    periodic = np.isfinite(period)
    place = network.position + displacement.T
    box = np.where(periodic, period, 0.0)
    wrapped = np.where(periodic, np.mod(place, np.where(periodic, period, 1.0)), place)
    wrapped[periodic & (wrapped >= period)] = 0.0  # np.mod of a tiny negative number is the period itself
    found = cKDTree(wrapped, boxsize=box).query_pairs(network.reach, output_type="ndarray")
    first, second = found.T
    order = np.lexsort((second, first))
    first, second = found[order].T.astype(np.intp)

    way = (displacement.T[second] - displacement.T[first]).T
    apart = (network.position[second] - network.position[first]).T
    images = np.round((apart + way) / np.where(periodic, period, 1.0)[:, None])
    apart = apart - np.where(periodic, box, 0.0)[:, None] * images
    radii = np.stack([network.radius[first], network.radius[second]])
    near = np.sqrt(dot(apart + way, apart + way)) < radii.sum(axis=0) + network.margin
    first, second, apart, radii = first[near], second[near], apart[:, near], radii[:, near]
    length, mass = np.sqrt(dot(apart, apart)), 1 / (1 / network.mass[first] + 1 / network.mass[second])
    arms = np.full(len(first), 0.5)
    overlap = radii.sum(axis=0) - length
    parts = [[first, second, apart, length, overlap, radii, arms, mass, *network.coefficients(first, second)]]
    parts += [_reached(network, wall, number, displacement) for number, wall in enumerate(network.walls, len(place))]
    *both, apart, length, overlap, radii, arms, mass, A, B, F = (
        np.concatenate(each, axis=-1) for each in zip(*parts, strict=True)
    )
    first, second = (each.astype(np.intp) for each in both)
    moved = _bodies(network, displacement)
    now = apart + moved[:, second] - moved[:, first]
    frame, law = frames(now / np.sqrt(dot(now, now))), LAWS[network.adhesion](A, F)
    return Pairs(first, second, apart, length, overlap, radii, arms, mass, A, B, F, displacement, frame, law)


def _reached(network: Network, wall: Wall, number: int, displacement: Floats) -> list[Floats | Integers]:
    """Return the pairs of spheres near a wall, the body of a number: `Pairs` from first to F."""
    beyond, normal = wall.beyond(network.position), np.array(wall.normal)
    spheres = np.flatnonzero(network.radius + beyond + normal @ displacement > -network.margin)
    own, mass = network.radius[spheres], network.mass[spheres]
    far, none = _FAR * own, np.zeros_like(own)
    ends = spheres, np.full_like(spheres, number)
    radii, overlap = np.stack([own, none]), own + beyond[spheres]
    return [*ends, np.outer(normal, far), far, overlap, radii, none, mass, *network.on_wall(wall, spheres)]


def _bodies(network: Network, motion: Floats) -> Floats:
    """Return motions (..., N), with those of the walls behind them if there are any."""
    return np.hstack([motion, np.zeros((len(motion), len(network.walls)))]) if network.walls else motion


def dashpots(network: Network, pairs: Pairs, root: Floats) -> Floats:
    """Return η of pairs whose overlap has the root `root`, 0 where open, (M,)."""
    if network.restitution is None:
        return np.where(root > 0, network.viscosity, 0.0)
    return np.asarray(np.sqrt(5 * pairs.A * pairs.mass * root) * damping_ratio(network.restitution), dtype=np.float64)


def damping_ratio(restitution: float) -> float:
    """Return ζ of a restitution e."""
    loss = -log(restitution)
    return loss / hypot(pi, loss)


def contacts(network: Network, motion: Floats, pairs: Pairs, memory: Floats, begun: Bools | bool = False) -> Contacts:
    """Return overlaps, forces and slip rates of the pairs.

    Parameters
    ----------
    motion : (2f, N).
    memory, begun : `State.shear` and `State.begun`.
    """
    dimension, freedoms = network.dimension, network.freedoms
    here, there = motion.take(pairs.first, axis=1), _bodies(network, motion).take(pairs.second, axis=1)
    apart = there - here
    spin, other = here[freedoms + dimension :], there[freedoms + dimension :]
    turning = pairs.radii[0] * spin + pairs.radii[1] * other
    way, rate = apart[:dimension], apart[freedoms : freedoms + dimension]
    now = pairs.apart + way
    distance = np.sqrt(dot(now, now))
    # The distance less the one at rest, written so that no digits cancel
    stretch = dot(pairs.apart + now, way) / (distance + pairs.length)
    depth = pairs.overlap - stretch
    closed = pairs.normal.closed(depth, begun)
    overlap = depth * closed
    normal = now / distance
    frame = tangents(pairs.frame, normal)
    radius = pairs.normal.radius(overlap, closed)
    stiffness = pairs.B * radius
    spring = np.where(closed, memory, 0.0) if network.law == "incremental" else stiffness * memory
    across = dot(frame.along, rate)
    slip_rate = (across - dot(frame.about, turning)) * closed
    memory_rate = stiffness * slip_rate if network.law == "incremental" else slip_rate
    repulsion = pairs.normal.repulsion(overlap, radius, closed)
    shear, limit = spring, repulsion + 2 * pairs.normal.pull * pairs.F
    if network.viscosity or network.restitution is not None:
        dashpot = dashpots(network, pairs, radius)
        repulsion = repulsion - dashpot * dot(normal, rate)
        shear = spring + network.shear * dashpot * slip_rate
        limit = limit if network.adheres else np.abs(repulsion)
    if network.friction < np.inf:
        wanted, limit = shear, network.friction * limit
        size = np.sqrt(dot(wanted, wanted))
        slides = size > limit
        shear = wanted * np.divide(limit, size, out=np.ones_like(size), where=slides)
        spring = np.where(slides, shear - (wanted - spring), spring)
        if frame.lean is not None:
            beyond = np.divide(size, limit, out=np.ones_like(size), where=slides & (limit > 0))
            memory_rate = memory_rate + swerved(memory_rate, wanted, beyond)
    if frame.lean is not None:
        memory_rate = memory_rate + turned(memory, across / distance, frame.lean)
    twist = combined(shear, frame.about)
    forces = repulsion, shear, twist, spring
    return Contacts(
        overlap, normal, frame, closed, radius, stiffness, *forces, rate, spin + other, slip_rate, memory_rate
    )


def resultants(pairs: Pairs, now: Contacts, spheres: int) -> Floats:
    """Return forces and torques on the spheres, (f, N)."""
    both = zip(now.tangents.along, now.normal, strict=True)
    forces = [dot(now.shear, along) - now.repulsion * normal for along, normal in both]
    levers = pairs.radii - pairs.shortened * now.overlap

    def summed(on_first: Floats, on_second: Floats) -> Floats:
        on_both = np.bincount(pairs.first, on_first, spheres) + np.bincount(pairs.second, on_second, spheres)[:spheres]
        return np.asarray(on_both, dtype=np.float64)

    pushes = [summed(each, -each) for each in forces]
    return np.array(pushes + [summed(levers[0] * each, levers[1] * each) for each in now.twist])


def start(
    network: Network,
    displacement: ArrayLike,
    velocity: ArrayLike,
    rotation: ArrayLike = 0.0,
    spin: ArrayLike = 0.0,
) -> State:
    """Return the state after one straight way without forces from rest, where no contact is sheared.

    That is how a LAMMPS deck is to start: LAMMPS knows no shear from positions, so one step of `nve/noforce` takes the
    spheres from rest to where they start. The slip is the whole way along the tangent of the step's end, less the
    rotations.

    Parameters
    ----------
    displacement, velocity : (N, d), or broadcast to it.
    rotation, spin : (N,) in the plane and (N, 3) in space, or broadcast to it; angles in rad.
    """
    count, dimension = network.position.shape
    motion = np.zeros((2, network.freedoms, count))
    for part, ways, turns in zip(motion, (displacement, velocity), (rotation, spin), strict=True):
        part[:dimension] = np.broadcast_to(np.asarray(ways, float), (count, dimension)).T
        part[dimension:] = np.broadcast_to(np.asarray(turns, float), (count, 3) if dimension == 3 else (count,)).T
    if not np.all(np.isfinite(motion)):
        raise TheoryError("displacement, velocity, rotation and spin must be finite")
    return loaded(network, motion.reshape(-1, count))


def loaded(network: Network, motion: Floats) -> State:
    """Return the state of a motion (2f, N) after the straight way of `start`."""
    dimension = network.dimension
    places, rates = np.split(motion, 2)
    pairs = search(network, places[:dimension])
    way = np.concatenate([places, places])  # the way in one unit of time, as a velocity
    begun = pairs.overlap > pairs.normal.end
    arrived = contacts(network, way, pairs, np.zeros((dimension - 1, len(pairs.first))), begun)
    still = np.concatenate([places, 0 * rates])  # so slow a way that no dashpot resists it
    moved = settled(network, State(still, pairs, arrived.memory_rate, begun))
    return settled(network, replace(moved, motion=motion))


def present(network: Network, state: State) -> Contacts:
    """Return the contacts of a state."""
    return contacts(network, state.motion, state.pairs, state.shear, state.begun)


def slip(now: Contacts) -> Floats:
    """Return the force of the spring of S over k, 0 where open: the slip, within the limit of friction."""
    return np.divide(now.spring, now.stiffness, out=np.zeros_like(now.spring), where=now.stiffness > 0)


def settled(network: Network, state: State) -> State:
    """Return the state without the slip of contacts that are open, or beyond the limit of friction."""
    now = present(network, state)
    if network.law == "incremental":
        return replace(state, shear=now.spring, begun=now.closed)
    sliding = now.spring != now.stiffness * state.shear
    shear = np.where(now.closed, np.where(sliding, slip(now), state.shear), 0.0)
    return replace(state, shear=shear, begun=now.closed)


def searched_again(network: Network, state: State) -> State:
    """Return the state with its candidate pairs searched again; contacts keep their shear."""
    pairs = search(network, state.motion[: network.dimension])
    count = len(network.position) + len(network.walls)
    _, old, new = np.intersect1d(
        state.pairs.first * count + state.pairs.second,
        pairs.first * count + pairs.second,
        assume_unique=True,
        return_indices=True,
    )
    shear, begun = np.zeros((len(state.shear), len(pairs.first))), np.zeros(len(pairs.first), dtype=bool)
    begun[new] = state.begun[old]
    before = present(network, state).tangents.along[..., old]
    shear[:, new] = rebased(state.shear[:, old], before, pairs.frame[..., new])
    return replace(state, pairs=pairs, shear=shear, begun=begun)


def forces(network: Network, state: State) -> Floats:
    """Return forces and torques on the spheres, (f, N), held ones included: at rest, the residuals."""
    return resultants(state.pairs, present(network, state), len(network.position))
