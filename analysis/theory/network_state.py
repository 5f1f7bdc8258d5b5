"""A packing of spheres at one moment: its motion, the pairs that may touch, and the forces of their contacts.

The laws are those of `analysis.theory.network`, in its terms. A wall is the last of the bodies of a pair: a held sphere
of `_FAR` times the radius of the first one.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.network import Network
from analysis.theory.network_laws import LAWS, Dmt, Jkr
from analysis.theory.network_outside import Wall

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
    apart : (2, M) from first to second at rest, to the image of second that is near; its length (M,).
    overlap : (M,) at rest, negative for a gap.
    radii : (2, M) of first and second, the second 0 of a wall.
    mass : (M,) reduced, 1/(1/m + 1/m) of both.
    A, B, F : (M,) coefficients of the contacts.
    place : (2, N) displacements at which the search was made.
    normal : law of the normal forces.
    """

    first: Integers
    second: Integers
    apart: Floats
    length: Floats
    overlap: Floats
    radii: Floats
    mass: Floats
    A: Floats
    B: Floats
    F: Floats
    place: Floats
    normal: Dmt | Jkr


@dataclass(frozen=True, eq=False)
class State:
    """Motion of a network at one moment.

    Attributes
    ----------
    motion : (6, N): displacement x, y, rotation θ, velocity x, y, spin ω.
    pairs : the candidates for contacts.
    shear : (M,) slip of the pairs, or their shear force under the incremental law; 0 where open.
    begun : (M,) whether the pairs have touched and not parted since: by the JKR law these hold beyond an overlap of 0.
    """

    motion: Floats
    pairs: Pairs
    shear: Floats
    begun: Bools


@dataclass(frozen=True, eq=False)
class Contacts:
    """State of the pairs at one moment, by the terms at the top of this module; forces and slip rates are 0 where open.

    Attributes
    ----------
    overlap : (M,) δ, 0 where open.
    normal : (2, M).
    closed : (M,) whether they touch.
    radius : (M,) a/√Rc, δ^{1/2} by the DMT law.
    stiffness : (M,) k = B a/√Rc.
    repulsion, shear : (M,) P and S.
    spring : (M,) S less its dashpot.
    apart : (6, M) motion of the second sphere less that of the first.
    slip_rate : (M,) ds/dt.
    """

    overlap: Floats
    normal: Floats
    closed: Bools
    radius: Floats
    stiffness: Floats
    repulsion: Floats
    shear: Floats
    spring: Floats
    apart: Floats
    slip_rate: Floats


def search(network: Network, displacement: Floats) -> Pairs:
    """Return all pairs with gaps below the margin, for spheres displaced by (2, N)."""
    from scipy.spatial import cKDTree  # slow to import, and only networks need it

    period = np.array(network.cell)
    periodic = np.isfinite(period)
    place = network.position + displacement.T
    box = np.where(periodic, period, 0.0)
    wrapped = np.where(periodic, np.mod(place, np.where(periodic, period, 1.0)), place)
    wrapped[periodic & (wrapped >= period)] = 0.0  # np.mod of a tiny negative number is the period itself
    found = cKDTree(wrapped, boxsize=box).query_pairs(network.reach, output_type="ndarray")
    first, second = found[np.lexsort((found[:, 1], found[:, 0]))].T.astype(np.intp)

    apart = network.position[second] - network.position[first]
    now = apart + (displacement.T[second] - displacement.T[first])
    apart = apart - np.where(periodic, box * np.round(now / np.where(periodic, period, 1.0)), 0.0)
    radii = np.stack([network.radius[first], network.radius[second]])
    now = apart + (displacement.T[second] - displacement.T[first])
    near = np.hypot(*now.T) < radii.sum(axis=0) + network.margin
    first, second, apart, radii = first[near], second[near], apart[near].T, radii[:, near]
    length, mass = np.hypot(*apart), 1 / (1 / network.mass[first] + 1 / network.mass[second])
    found = [
        first,
        second,
        apart,
        length,
        radii.sum(axis=0) - length,
        radii,
        mass,
        *network.coefficients(first, second),
    ]
    for number, wall in enumerate(network.walls, len(place)):
        on_wall = _reached(network, wall, number, displacement)
        found = [np.concatenate(both, axis=-1) for both in zip(found, on_wall, strict=True)]
    first, second, apart, length, overlap, radii, mass, A, B, F = map(np.ascontiguousarray, found)
    law = LAWS[network.adhesion](A, F)
    return Pairs(first, second, apart, length, overlap, radii, mass, A, B, F, displacement, law)


def _reached(network: Network, wall: Wall, number: int, displacement: Floats) -> list[Floats | Integers]:
    """Return the pairs of spheres near a wall, the body of a number: all but the last two attributes of `Pairs`."""
    beyond = wall.side * (wall.place - network.position[:, wall.axis])
    near = network.radius + beyond - wall.side * displacement[wall.axis] > -network.margin
    spheres = np.flatnonzero(near)
    own, mass = network.radius[spheres], network.mass[spheres]
    far, radii = _FAR * own, np.stack([own, np.zeros_like(own)])
    ends = spheres, np.full_like(spheres, number)
    return [*ends, np.outer(wall.normal, far), far, own + beyond[spheres], radii, mass, *network.on_walls(spheres)]


def _bodies(network: Network, motion: Floats) -> Floats:
    """Return the motion (6, N), with that of the walls behind it if there are any."""
    return np.hstack([motion, np.zeros((6, len(network.walls)))]) if network.walls else motion


def dashpots(network: Network, pairs: Pairs, root: Floats) -> Floats:
    """Return η of pairs whose overlap has the root `root`, 0 where open, (M,)."""
    if network.restitution is None:
        return np.where(root > 0, network.viscosity, 0.0)
    loss = -np.log(network.restitution)
    ratio = loss / np.hypot(np.pi, loss)
    return np.asarray(np.sqrt(5 * pairs.A * pairs.mass * root) * ratio, dtype=np.float64)


def contacts(network: Network, motion: Floats, pairs: Pairs, memory: Floats, begun: Bools | bool = False) -> Contacts:
    """Return overlaps, forces and slip rates of the pairs.

    Parameters
    ----------
    motion : (6, N).
    memory, begun : `State.shear` and `State.begun`.
    """
    here, there = motion.take(pairs.first, axis=1), _bodies(network, motion).take(pairs.second, axis=1)
    apart = there - here
    turning = pairs.radii[0] * here[5] + pairs.radii[1] * there[5]
    now = pairs.apart + apart[:2]
    distance = np.sqrt(now[0] ** 2 + now[1] ** 2)
    # The distance less the one at rest, written so that no digits cancel
    stretch = ((pairs.apart[0] + now[0]) * apart[0] + (pairs.apart[1] + now[1]) * apart[1]) / (distance + pairs.length)
    depth = pairs.overlap - stretch
    closed = (depth > 0) | (begun & (depth > pairs.normal.end))
    overlap = np.where(closed, depth, 0.0)
    normal = now / distance
    radius = pairs.normal.radius(overlap, closed)
    stiffness = pairs.B * radius
    spring = np.where(closed, memory, 0.0) if network.law == "incremental" else stiffness * memory
    slip_rate = (normal[0] * apart[4] - normal[1] * apart[3] - turning) * closed
    repulsion = pairs.normal.repulsion(overlap, radius, closed)
    shear, limit = spring, repulsion + 2 * pairs.normal.pull * pairs.F
    if network.viscosity or network.restitution is not None:
        dashpot = dashpots(network, pairs, radius)
        repulsion = repulsion - dashpot * (normal[0] * apart[3] + normal[1] * apart[4])
        shear = spring + network.shear * dashpot * slip_rate
        limit = limit if network.adheres else np.abs(repulsion)
    if np.isfinite(network.friction):
        wanted, limit = shear, network.friction * limit
        shear = np.clip(wanted, -limit, limit)
        spring = np.where(shear == wanted, spring, shear - (wanted - spring))
    return Contacts(overlap, normal, closed, radius, stiffness, repulsion, shear, spring, apart, slip_rate)


def resultants(pairs: Pairs, now: Contacts, spheres: int) -> Floats:
    """Return forces in x and y and torques on the spheres, (3, N)."""
    force_x = -now.normal[0] * now.repulsion - now.normal[1] * now.shear
    force_y = -now.normal[1] * now.repulsion + now.normal[0] * now.shear
    levers = (pairs.radii - now.overlap / 2) * now.shear

    def summed(on_first: Floats, on_second: Floats) -> Floats:
        on_both = np.bincount(pairs.first, on_first, spheres) + np.bincount(pairs.second, on_second, spheres)[:spheres]
        return np.asarray(on_both, dtype=np.float64)

    return np.stack([summed(force_x, -force_x), summed(force_y, -force_y), summed(levers[0], levers[1])])


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
    displacement, velocity : (N, 2), or broadcast to it.
    rotation, spin : (N,), or broadcast to it; angles in rad.
    """
    count = len(network.position)
    motion = np.empty((6, count))
    for rows, values in ((slice(0, 2), displacement), (slice(3, 5), velocity)):
        motion[rows] = np.broadcast_to(np.asarray(values, float), (count, 2)).T
    for row, values in ((2, rotation), (5, spin)):
        motion[row] = np.broadcast_to(np.asarray(values, float), (count,))
    if not np.all(np.isfinite(motion)):
        raise ValueError("displacement, velocity, rotation and spin must be finite")
    pairs = search(network, motion[:2])
    way = np.concatenate([motion[:3], motion[:3]])  # the way in one unit of time, as a velocity
    begun = pairs.overlap > pairs.normal.end
    arrived = contacts(network, way, pairs, np.zeros(len(pairs.first)), begun)
    sheared = arrived.stiffness * arrived.slip_rate if network.law == "incremental" else arrived.slip_rate
    still = np.concatenate([motion[:3], np.zeros((3, count))])  # so slow a way that no dashpot resists it
    moved = settled(network, State(still, pairs, sheared, begun))
    return settled(network, replace(moved, motion=motion))


def present(network: Network, state: State) -> Contacts:
    """Return the contacts of a state."""
    return contacts(network, state.motion, state.pairs, state.shear, state.begun)


def slip(now: Contacts) -> Floats:
    """Return the force of the spring of S over k, 0 where open: the slip, within the limit of friction."""
    return np.divide(now.spring, now.stiffness, out=np.zeros_like(now.shear), where=now.stiffness > 0)


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
    pairs = search(network, state.motion[:2])
    count = len(network.position) + len(network.walls)
    _, old, new = np.intersect1d(
        state.pairs.first * count + state.pairs.second,
        pairs.first * count + pairs.second,
        assume_unique=True,
        return_indices=True,
    )
    shear, begun = np.zeros(len(pairs.first)), np.zeros(len(pairs.first), dtype=bool)
    shear[new], begun[new] = state.shear[old], state.begun[old]
    return replace(state, pairs=pairs, shear=shear, begun=begun)


def forces(network: Network, state: State) -> Floats:
    """Return forces in x and y and torques on the spheres, (3, N), held ones included: at rest, the residuals."""
    return resultants(state.pairs, present(network, state), len(network.position))
