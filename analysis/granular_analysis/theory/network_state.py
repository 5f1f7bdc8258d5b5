"""Packing of spheres at one moment: its motion, the pairs that may touch, and the forces of contacts.

The laws and their symbols are those of `granular_analysis.theory.network`. A sphere in d dimensions has f degrees of
freedom: x, y and the rotation about z in the plane, three translations and three rotations in space. A rotation by the
angle ϑ in space is stored as the vector 2 tan(ϑ/2) times its axis, as from a quaternion; forces do not depend on it.

A wall is the second body of a pair. It acts as a held sphere whose centre is `_FAR` radii R of the first sphere away,
so its normal turns by only 1e-9 of u/R for a displacement u of the first.
"""

from dataclasses import dataclass, replace
from math import hypot, log, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network import Network, Traits, Wall
from granular_analysis.theory.network_laws import LAWS, Dmt, Jkr
from granular_analysis.theory.network_tangents import (
    Tangents,
    Vector,
    combined,
    dot,
    frames,
    length,
    less,
    module_of,
    plus,
    quotient,
    rebased,
    root_of,
    scaled,
    swerved,
    tangents,
    turned,
)

__all__ = ["start"]

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
Bools = NDArray[np.bool_]
_FAR = 1e9  # distance of the centre of a wall, in radii of the sphere that touches it


@dataclass(frozen=True, eq=False)
class Pairs:
    """M pairs of spheres that touch, or may touch before the next search.

    Attributes
    ----------
    first, second : (M,) indices of the spheres; walls follow the spheres, and are always second.
    apart : (d, M) vector at rest from the first sphere to the nearest periodic image of the second.
    length : (M,) length of `apart`.
    overlap : (M,) overlap at rest, negative for a gap.
    radii : (2, M) radii of first and second; 0 for a wall.
    shortened : (M,) the lever arm is the radius minus this share of the overlap: ½, and 0 on a wall.
    mass : (M,) reduced mass 1/(1/m_i + 1/m_j); a held sphere has infinite mass, as a wall has.
    A, B, F : (M,) coefficients of the contacts.
    place : (d, N) displacements at the time of the search.
    frame : frames of the tangents (`granular_analysis.theory.network_tangents`).
    normal : law of the normal forces.
    gathered : (K, N) ends of pairs at each sphere, which has at most K of them: m for the first sphere of pair m, M + m
        for the second, 2M where there are fewer than K.
    damping : factor of the dashpots, one number or (M,).
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
    gathered: Integers
    damping: Floats | float = 1.0


@dataclass(frozen=True, eq=False)
class State:
    """Motion of a network at one moment.

    Attributes
    ----------
    motion : (2f, N) rows of displacement, turn, velocity and spin; in the plane x, y, θ, v_x, v_y, ω.
    pairs : the candidates for contacts.
    shear : (d − 1, M) slip of the pairs along their tangents, or the force of the shear spring under the incremental
        law; 0 where open.
    begun : (M,) whether the pairs have closed and not opened since; such JKR contacts stay closed at some negative
        overlaps.
    """

    motion: Floats
    pairs: Pairs
    shear: Floats
    begun: Bools


class Meetings(NamedTuple):
    """Geometry and velocities of the pairs at one moment, before any force; names as in `Contacts`, and two more.

    Attributes
    ----------
    distance : (M,) distance of the centres.
    across : d − 1 components along the tangents of the velocity of the second sphere minus that of the first, without
        spins.
    """

    overlap: Floats
    normal: Vector
    tangents: Tangents
    closed: Bools
    radius: Floats
    stiffness: Floats
    distance: Floats
    rate: Vector
    across: Vector
    spins: Vector
    slip_rate: Vector


class Contacts(NamedTuple):
    """State of the M pairs at one moment, in the symbols of `granular_analysis.theory.network`; no forces where open.

    A vector is a tuple of components, each (M,): d components in general, d − 1 along the tangents, and for a rotation
    one in the plane or three in space.

    Attributes
    ----------
    overlap : (M,) δ, 0 where open.
    normal : n, d components.
    tangents : tangents of the normals.
    closed : (M,) whether the spheres touch.
    radius : (M,) a/√Rc, which is δ^{1/2} for the DMT law.
    stiffness : (M,) k = B a/√Rc against shear.
    repulsion : (M,) P.
    shear : S along the tangents.
    twist : n × S, a rotation.
    spring : S minus its dashpot, along the tangents.
    rate : velocity of the second sphere minus that of the first, d components.
    spins : sum of the spins, a rotation.
    slip_rate : ds/dt along the tangents.
    memory_rate : rate of `State.shear`.
    """

    overlap: Floats
    normal: Vector
    tangents: Tangents
    closed: Bools
    radius: Floats
    stiffness: Floats
    repulsion: Floats
    shear: Vector
    twist: Vector
    spring: Vector
    rate: Vector
    spins: Vector
    slip_rate: Vector
    memory_rate: Vector


def search(network: Network, displacement: Floats) -> Pairs:
    """Return all pairs whose gap is below the margin, for spheres with displacements (d, N)."""
    from scipy.spatial import cKDTree  # slow to import, and only networks need it

    period = np.array(network.cell)
    periodic = np.isfinite(period)
    place = network.position + displacement.T
    box = np.where(periodic, period, 0.0)
    wrapped = np.where(periodic, np.mod(place, np.where(periodic, period, 1.0)), place)
    wrapped[periodic & (wrapped >= period)] = 0.0  # np.mod maps a tiny negative number to the period itself
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
    distance = np.sqrt(dot(apart, apart))
    lightness = 1 / network.mass if network.held is None else np.where(network.held, 0.0, 1 / network.mass)
    both = lightness[first] + lightness[second]
    mass = np.divide(1.0, both, out=np.zeros_like(both), where=both > 0)
    arms = np.full(len(first), 0.5)
    overlap = radii.sum(axis=0) - distance
    parts = [[first, second, apart, distance, overlap, radii, arms, mass, *network.coefficients(first, second)]]
    parts += [_reached(network, wall, number, displacement) for number, wall in enumerate(network.walls, len(place))]
    *both, apart, distance, overlap, radii, arms, mass, A, B, F = (
        np.concatenate(each, axis=-1) for each in zip(*parts, strict=True)
    )
    first, second = (each.astype(np.intp) for each in both)
    moved = np.array(with_walls(network, displacement))
    now = apart + moved[:, second] - moved[:, first]
    frame, law = frames(now / np.sqrt(dot(now, now))), LAWS[network.adhesion](A, F)
    gathered = _gathered(first, second, len(place))
    return Pairs(
        first, second, apart, distance, overlap, radii, arms, mass, A, B, F, displacement, frame, law, gathered
    )


def _gathered(first: Integers, second: Integers, spheres: int) -> Integers:
    """Return `Pairs.gathered` for a number of spheres; walls, whose indices follow, gather nothing."""
    ends = np.concatenate([first, second])
    order = np.argsort(ends, kind="stable")
    count = np.bincount(ends, minlength=spheres)
    place = np.arange(len(ends)) - np.repeat(np.cumsum(count) - count, count)
    table = np.full((max(int(count[:spheres].max(initial=0)), 1), spheres), len(ends))
    inside = ends[order] < spheres
    table[place[inside], ends[order][inside]] = order[inside]
    return table


def _reached(network: Network, wall: Wall, number: int, displacement: Floats) -> list[Floats | Integers]:
    """Return the pairs of spheres near a wall with the index `number`: the fields of `Pairs` from `first` to `F`."""
    beyond, normal = wall.beyond(network.position), np.array(wall.normal)
    spheres = np.flatnonzero(network.radius + beyond + normal @ displacement > -network.margin)
    own, mass = network.radius[spheres], network.mass[spheres]
    far, none = _FAR * own, np.zeros_like(own)
    ends = spheres, np.full_like(spheres, number)
    radii, overlap = np.stack([own, none]), own + beyond[spheres]
    return [*ends, np.outer(normal, far), far, overlap, radii, none, mass, *network.on_wall(wall, spheres)]


def with_walls(network: Network | Traits, motion: Vector) -> Vector:
    """Return the rows (N,) of a motion, each extended by zeros for the walls if there are any."""
    if not network.walls:
        return motion
    xp = module_of(motion[0])
    return [xp.concatenate([row, xp.zeros(len(network.walls))]) for row in motion]


def dashpots(network: Network | Traits, pairs: Pairs, root: Floats) -> Floats:
    """Return η (M,) of pairs from the root of the overlap, `root` (M,); 0 where open."""
    xp = module_of(root)
    if network.restitution is None:
        return xp.where(root > 0, network.viscosity, 0.0)
    return root_of(5 * pairs.A * pairs.mass * root) * damping_ratio(network.restitution)


def damping_ratio(restitution: float) -> float:
    """Return ζ = −ln e/√(π² + ln² e) for a restitution e."""
    loss = -log(restitution)
    return loss / hypot(pi, loss)


def contacts(network: Network, motion: Floats, pairs: Pairs, memory: Floats, begun: Bools | bool = False) -> Contacts:
    """Return the overlaps, forces and slip rates of the pairs.

    Parameters
    ----------
    motion : (2f, N) as `State.motion`.
    memory, begun : as `State.shear` and `State.begun`.
    """
    return acting(network, pairs, meetings(network, motion, pairs, begun), memory)


def meetings(network: Network | Traits, motion: Vector, pairs: Pairs, begun: Bools | bool = False) -> Meetings:
    """Return the geometry and velocities of the pairs, before any force; parameters as for `contacts`."""
    xp, dimension, freedoms = module_of(motion[0]), network.dimension, network.freedoms
    here = [row[pairs.first] for row in motion]
    there = [row[pairs.second] for row in with_walls(network, motion)]
    way, rate = (less(there[part], here[part]) for part in (slice(dimension), slice(freedoms, freedoms + dimension)))
    spin, other = here[freedoms + dimension :], there[freedoms + dimension :]
    turning = plus(scaled(pairs.radii[0], spin), scaled(pairs.radii[1], other))
    now = plus(pairs.apart, way)
    distance = xp.sqrt(dot(now, now))
    # The change of the distance since rest, written so that no digits cancel
    stretch = dot(plus(pairs.apart, now), way) / (distance + pairs.length)
    depth = pairs.overlap - stretch
    closed = pairs.normal.closed(depth, begun)
    overlap = depth * closed
    normal = tuple(each / distance for each in now)
    frame = tangents(pairs.frame, normal)
    radius = pairs.normal.radius(overlap, closed)
    across = tuple(dot(each, rate) for each in frame.along)
    slipping = less(across, [dot(each, turning) for each in frame.about])
    return Meetings(
        overlap,
        normal,
        frame,
        closed,
        radius,
        pairs.B * radius,
        distance,
        rate,
        across,
        plus(spin, other),
        scaled(closed, slipping),
    )


def acting(
    network: Network | Traits, pairs: Pairs, met: Meetings, memory: Vector, *, stepped: bool = False
) -> Contacts:
    """Return the forces of pairs from their geometry, velocities and memory (d − 1 components along the tangents).

    With `stepped`, a contact without slip that slides by its dashpot alone has no shear force, as in LAMMPS.
    """
    xp = module_of(met.overlap)
    frame, closed, slip_rate = met.tangents, met.closed, met.slip_rate
    spring: Vector
    memory_rate: Vector
    if network.law == "incremental":
        spring = tuple(xp.where(closed, each, 0.0) for each in memory)
        memory_rate = scaled(met.stiffness, slip_rate)
    else:
        spring, memory_rate = scaled(met.stiffness, memory), slip_rate
    repulsion = pairs.normal.repulsion(met.overlap, met.radius, closed)
    shear, limit = spring, repulsion + 2 * pairs.normal.pull * pairs.F
    damped = network.viscosity or network.restitution is not None
    if damped:
        dashpot = pairs.damping * dashpots(network, pairs, met.radius)
        repulsion = repulsion - dashpot * dot(met.normal, met.rate)
        shear = plus(spring, scaled(network.shear * dashpot, slip_rate))
        limit = limit if network.adheres else xp.abs(repulsion)
    if network.friction < np.inf:
        wanted, limit = shear, network.friction * limit
        size = length(wanted)
        slides = size > limit
        shear = scaled(quotient(limit, size, slides, 1.0), wanted)
        if stepped and damped:
            slips = length(memory) > 0
            shear = scaled(slips | ~slides, shear)
            slides = slides & slips
        # A sliding contact keeps the slip at which spring and dashpot together equal the limit
        left = less(shear, less(wanted, spring))
        spring = tuple(xp.where(slides, after, before) for after, before in zip(left, spring, strict=True))
        if frame.lean:
            beyond = quotient(size, limit, slides & (limit > 0), 1.0)
            memory_rate = plus(memory_rate, swerved(memory_rate, wanted, beyond))
    if frame.lean:
        memory_rate = plus(memory_rate, turned(memory, scaled(1 / met.distance, met.across), frame.lean))
    return Contacts(
        met.overlap,
        met.normal,
        frame,
        closed,
        met.radius,
        met.stiffness,
        repulsion,
        shear,
        combined(shear, frame.about),
        spring,
        met.rate,
        met.spins,
        slip_rate,
        memory_rate,
    )


def resultants(pairs: Pairs, now: Contacts) -> Vector:
    """Return the forces and torques on the spheres, f rows (N,), summed over their contacts in a fixed order."""
    xp = module_of(now.overlap)
    nothing = xp.zeros(1)
    one, other = pairs.radii - pairs.shortened * now.overlap
    pull = less(combined(now.shear, now.tangents.along), scaled(now.repulsion, now.normal))
    on_both = [(each, -each) for each in pull] + [(one * each, other * each) for each in now.twist]

    def gathered(on_first: Floats, on_second: Floats) -> Floats:
        ends = xp.concatenate([on_first, on_second, nothing])
        total = ends[pairs.gathered[0]]
        for which in pairs.gathered[1:]:
            total = total + ends[which]
        return total

    return tuple(gathered(*each) for each in on_both)


def start(
    network: Network,
    displacement: ArrayLike,
    velocity: ArrayLike,
    rotation: ArrayLike = 0.0,
    spin: ArrayLike = 0.0,
) -> State:
    """Return the state after one straight displacement from rest, without forces.

    At rest no contact is sheared. A LAMMPS deck must start in the same way: LAMMPS cannot derive shear from positions,
    so one step of `nve/noforce` takes the spheres from rest to their start. The slip is the whole relative displacement
    along the tangent at the end of the step, minus the rotations.

    Parameters
    ----------
    displacement, velocity : (N, d), or broadcast to it.
    rotation, spin : (N,) in the plane and (N, 3) in space, or broadcast to it; angles in rad.

    Raises TheoryError for values that are not finite.
    """
    count, dimension = network.position.shape
    motion = np.zeros((2, network.freedoms, count))
    for part, ways, turns in zip(motion, (displacement, velocity), (rotation, spin), strict=True):
        part[:dimension] = np.broadcast_to(np.asarray(ways, float), (count, dimension)).T
        part[dimension:] = np.broadcast_to(np.asarray(turns, float), (count, 3) if dimension == 3 else (count,)).T
    if not np.all(np.isfinite(motion)):
        raise TheoryError("displacement, velocity, rotation and spin must be finite")
    return loaded(network, motion.reshape(-1, count))


def loaded(network: Network, motion: Floats, rate: float = 0.0) -> State:
    """Return the state of a motion (2f, N) after the straight displacement of `start`.

    rate : 1 over the time of the displacement, for the dashpots of contacts that slide during it; 0 without dashpots.
    """
    dimension = network.dimension
    places, _ = np.split(motion, 2)
    pairs = search(network, places[:dimension])
    way = np.concatenate([places, places])  # as a velocity, the displacement in one unit of time
    begun = pairs.overlap > pairs.normal.end
    arrived = contacts(network, way, pairs, np.zeros((dimension - 1, len(pairs.first))), begun)
    slow = np.concatenate([places, rate * places])
    moved = settled(network, State(slow, pairs, np.array(arrived.memory_rate), begun), stepped=True)
    return settled(network, replace(moved, motion=motion), stepped=True)


def present(network: Network, state: State, *, stepped: bool = False) -> Contacts:
    """Return the contacts of a state; `stepped` as for `acting`."""
    met = meetings(network, state.motion, state.pairs, state.begun)
    return acting(network, state.pairs, met, state.shear, stepped=stepped)


def slip(now: Contacts) -> Vector:
    """Return the slip within the limit of friction, which is the spring force over k; 0 where open."""
    return tuple(quotient(each, now.stiffness, now.stiffness > 0, 0.0) for each in now.spring)


def settled(network: Network, state: State, *, stepped: bool = False) -> State:
    """Return the state with no slip in open contacts, and with the slip at the limit in sliding ones.

    stepped : as for `acting`.
    """
    now = present(network, state, stepped=stepped)
    if network.law == "incremental":
        return replace(state, shear=np.array(now.spring), begun=now.closed)
    kept = tuple(
        np.where(spring != now.stiffness * before, after, before)
        for spring, before, after in zip(now.spring, state.shear, slip(now), strict=True)
    )
    return replace(state, shear=np.where(now.closed, kept, 0.0), begun=now.closed)


def searched_again(network: Network, state: State) -> State:
    """Return the state with newly searched pairs; contacts keep their shear."""
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
    before = [[part[old] for part in each] for each in present(network, state).tangents.along]
    shear[:, new] = rebased(state.shear[:, old], before, pairs.frame[..., new])
    return replace(state, pairs=pairs, shear=shear, begun=begun)


def forces(network: Network, state: State) -> Floats:
    """Return the forces and torques on all spheres, (f, N), also held ones; for a state at rest, the residuals."""
    return np.array(resultants(state.pairs, present(network, state)))
