"""The fastest vibration of the spheres of a deck, from the stiffnesses of their contacts, and the fastest decay.

The stretch of a contact with the normal n and its slip along the tangent t are

    n·(u_i − u_j),    t·(u_i − u_j) + (R_i φ_i + R_j φ_j)·(n × t)

The square of the largest frequency is the largest eigenvalue of M^(−1/2) Bᵀ K B M^(−1/2), where B holds these rows and
K the stiffnesses. Held spheres have no mobility. Walls that are not planes are left out; they raise the frequency.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from granular_lmp.crystal.lanczos import top_bound
from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.foreign.laws import PLANES, law_of_wall
from granular_lmp.foreign.reading import Reading
from granular_lmp.foreign.stages import Pairs, Spheres
from granular_lmp.frozen import dataclass
from granular_lmp.units import STYLES

Floats = NDArray[np.float64]
_ZERO = np.finfo(float).tiny
_TOUCHING = 1e-10  # times the radius; spheres with a smaller overlap just touch, apart from rounding


@dataclass(frozen=True, eq=False)
class ContactsAtStart:
    """Contacts at the beginning, C of them, with their stiffnesses.

    Attributes
    ----------
    pairs : the contacts among all pairs.
    normal, shear : (C,) stiffnesses.
    dashpot : (C,) coefficients of the damping of the normal motion.
    on_wall : whether the contacts are with a wall; i and j of `pairs` are then the same sphere.
    """

    pairs: Pairs
    normal: Floats
    shear: Floats
    dashpot: Floats
    on_wall: bool = False


@lru_cache(maxsize=1)
def contacts_of(reading: Reading) -> ContactsAtStart | None:
    """Return the contacts of a deck whose laws are known; None if there are none."""
    spheres, pairs = reading.spheres, reading.pairs
    if spheres is None or pairs is None or not reading.laws or reading.units not in STYLES:
        return None
    closed = pairs.of(pairs.overlap > _TOUCHING * spheres.radius[pairs.i])
    if not len(closed.i):
        return None
    normal, shear, dashpot = np.zeros((3, len(closed.i)))
    radius = effective_radius(spheres, closed)
    mass = 1 / (1 / spheres.mass[closed.i] + 1 / spheres.mass[closed.j])
    for law, which in reading.law_of(closed):
        normal[which], shear[which] = law.stiffnesses(radius[which], closed.overlap[which])
        dashpot[which] = law.dashpot(radius[which], closed.overlap[which], mass[which])
    known = np.isfinite(normal + shear + dashpot) & (normal >= 0) & (shear >= 0)  # no deck means a negative spring
    return ContactsAtStart(closed.of(known), normal[known], shear[known], dashpot[known]) if known.any() else None


def effective_radius(spheres: Spheres, pairs: Pairs) -> Floats:
    """Return Rc of each pair."""
    one, other = spheres.radius[pairs.i], spheres.radius[pairs.j]
    return one * other / (one + other)


def expected_displacement(reading: Reading) -> float | None:
    """Return the overlap at rest; without contacts, the depth of the fastest sphere's collision; None without both.

    Waves and impacts move spheres by about this distance.
    """
    contacts = contacts_of(reading)
    if contacts is not None:
        return float(np.median(contacts.pairs.overlap))
    collision = first_collision(reading)
    return None if collision is None else collision[0] * collision[1] / 3  # from 2.943 and π


def first_collision(reading: Reading) -> tuple[float, float] | None:
    """Return the speed of the fastest sphere and its contact time with an equal sphere at rest; None if unknown."""
    spheres = reading.spheres
    if spheres is None or not spheres.moves.any() or reading.units not in STYLES:
        return None
    speeds = np.linalg.norm(spheres.velocity, axis=1)
    who = int(np.argmax(speeds))
    law, speed = reading.laws.get((int(spheres.type[who]),) * 2), float(speeds[who])
    if law is None or not speed:
        return None
    duration = law.collision(float(spheres.radius[who]) / 2, float(spheres.mass[who]) / 2, speed)
    return None if duration is None else (speed, duration)


@lru_cache(maxsize=1)
def fastest(reading: Reading) -> float | None:
    """Return the largest frequency of the spheres at the start (rad per unit of time); None without contacts."""
    found = _contacts_and_walls(reading)
    return sqrt(_top(reading, [(each, each.normal, each.shear) for each in found])) if found else None


def fastest_decay(reading: Reading) -> float | None:
    """Return the largest decay rate by the dashpots of contacts, per unit of time; None without dashpots."""
    found = [each for each in _contacts_and_walls(reading) if each.dashpot.any()]
    return _top(reading, [(each, each.dashpot, np.zeros_like(each.dashpot)) for each in found]) if found else None


def turning(reading: Reading) -> float:
    """Return how strongly contacts turn spheres at first: the largest torque, or its rate, over that of one contact.

    It is 0 if symmetry forbids rotation, and 1 if nothing moves yet.
    """
    contacts, spheres = contacts_of(reading), reading.spheres
    if contacts is None or spheres is None:
        return 0.0
    pairs = contacts.pairs
    axis = pairs.vector / np.linalg.norm(pairs.vector, axis=1, keepdims=True)
    slip = spheres.velocity[pairs.i] - spheres.velocity[pairs.j]
    rate = contacts.shear[:, None] * np.cross(axis, slip)
    whole, sizes = np.zeros_like(spheres.velocity), np.linalg.norm(rate, axis=1)
    for ends in (pairs.i, pairs.j):
        np.add.at(whole, ends, rate)
    torques = np.linalg.norm(spheres.torque, axis=1).max()
    forces = np.linalg.norm(spheres.force, axis=1).max() * spheres.radius.max()
    shares = [float(np.linalg.norm(whole, axis=1).max() / sizes.max())] if sizes.any() else []
    shares += [float(torques / forces)] if forces else []
    return max(shares, default=1.0)


def _contacts_and_walls(reading: Reading) -> list[ContactsAtStart]:
    contacts = contacts_of(reading)
    return [each for each in (contacts, *_walls_of(reading)) if each is not None]


def _walls_of(reading: Reading) -> Iterator[ContactsAtStart]:
    """Yield the contacts of spheres with planes of ``fix wall/gran granular``."""
    spheres, start = reading.spheres, reading.start
    if spheres is None or start is None or reading.units not in STYLES:
        return
    for fix in start.fixes:
        law, surface = law_of_wall(fix)
        for axis, keyword in enumerate(PLANES):
            if law is None or surface[:1] != (keyword,):
                continue
            for word in surface[1:3]:
                away = spheres.position[:, axis] - (float(word) if word != "NULL" else np.inf)
                which = np.flatnonzero(np.abs(away) < spheres.radius * (1 - _TOUCHING))
                if not len(which):
                    continue
                radius, overlap = spheres.radius[which], spheres.radius[which] - np.abs(away[which])
                vector = away[which, None] * np.eye(3)[axis]
                pairs = Pairs(which, which, vector, overlap, np.zeros_like(vector))
                dashpot = law.dashpot(radius, overlap, spheres.mass[which])
                yield ContactsAtStart(pairs, *law.stiffnesses(radius, overlap), dashpot, on_wall=True)


def _top(reading: Reading, springs: Sequence[tuple[ContactsAtStart, Floats, Floats]]) -> float:
    spheres = reading.spheres
    assert spheres is not None
    rows = []
    for contacts, normal, shear in springs:
        pairs = contacts.pairs
        axis = pairs.vector / np.linalg.norm(pairs.vector, axis=1, keepdims=True)
        rows.append(_row(spheres, contacts, axis, np.zeros_like(axis), normal))
        for tangent in _tangents(axis, flat=reading.dimension == 2) if shear.any() else ():
            # The vector points from j to i, and the arms of both spheres to the contact make the same sign
            rows.append(_row(spheres, contacts, tangent, -np.cross(axis, tangent), shear))
    spin = spheres.turns / (INERTIA_RATIO * spheres.mass * spheres.radius**2 + _ZERO)
    mobility = np.sqrt(np.concatenate((np.repeat(spheres.moves / spheres.mass, 3), np.repeat(spin, 3))))
    values, columns = (np.concatenate([row[n] for row in rows]) for n in range(2))
    starts = np.arange(0, values.size + 1, values.shape[1])
    matrix = csr_array((values.ravel() * mobility[columns.ravel()], columns.ravel(), starts))
    matrix.resize((len(values), mobility.size))
    start = np.random.default_rng(0).standard_normal(mobility.size) * mobility
    if not start.any():
        return 0.0
    return top_bound(lambda vector: matrix.T @ (matrix @ vector), start, mobility.size)


def _tangents(axis: Floats, *, flat: bool) -> list[Floats]:
    if flat:
        return [np.stack((-axis[:, 1], axis[:, 0], np.zeros(len(axis))), axis=1)]
    least = np.eye(3)[np.argmin(np.abs(axis), axis=1)]
    first = np.cross(axis, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return [first, np.cross(axis, first)]


def _row(
    spheres: Spheres, contacts: ContactsAtStart, along: Floats, about: Floats, stiffness: Floats
) -> tuple[Floats, NDArray[np.int64]]:
    """Return the twelve values and columns of each contact: displacements and rotations of its two spheres."""
    pairs, other = contacts.pairs, 0.0 if contacts.on_wall else 1.0
    arms = spheres.radius[pairs.i, None] * about, spheres.radius[pairs.j, None] * about
    values = np.hstack((along, -other * along, arms[0], other * arms[1])) * np.sqrt(stiffness)[:, None]
    three = np.arange(3)
    places = [3 * pairs.i[:, None] + three, 3 * pairs.j[:, None] + three]
    return values, np.hstack((*places, *(3 * len(spheres.mass) + place for place in places)))
