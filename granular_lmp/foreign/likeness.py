"""Compare the deck of a scene with a foreign deck at their beginning, as LAMMPS reads both.

Places, velocities and forces are compared sphere by sphere, stiffnesses contact by contact. The deck of the scene is
built and read too, so that an error in the reading of either deck shows.
"""

import tempfile
from collections.abc import Callable
from math import isclose
from pathlib import Path
from typing import Any

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import SceneError
from granular_lmp.foreign.indexing import Indexed
from granular_lmp.foreign.laws import Law
from granular_lmp.foreign.outside import Outside, outside_of
from granular_lmp.foreign.reading import Reading, read
from granular_lmp.foreign.stages import Spheres
from granular_lmp.foreign.vibrations import effective_radius
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.deck import deck_of
from granular_lmp.problem import Problem, prepare
from granular_lmp.rest.scene import Scene
from granular_lmp.units import STYLES, AnyUnits

Floats = NDArray[np.float64]

# A scene with larger differences describes another crystal
_PLACE = 0.01  # times the static compression; for an impact, times the unit of overlaps
_STIFFNESS = 0.01
_MOTION = 1e-6  # relative to the largest speed, to radii, masses and the time step
_FORCE = 0.01  # times the largest force on a sphere that moves
_FAINT = 1e-4  # times the unit of forces; if the largest force is smaller, it is rounding
_TOUCHING = 1e-8  # times the radius; contacts with smaller overlaps just touch, and rounding parts them
_SHALLOW = 1e-4  # times the radius; overlap at which laws are compared
_OF_WALL = ("normal", "young", "poisson", "gamma", "friction", "damping_law")
_OF_SLIDING = ("tangential", "shear_stiffness", "shear_damping")  # where there is friction
_ZERO = np.finfo(float).tiny


@dataclass(frozen=True)
class Likeness:
    """Differences of the deck of a scene from a foreign one at their beginning.

    Attributes
    ----------
    largest, rms : float
        Distances of places, m.
    diameter, compression : float
        2R, and the overlap at rest, m; the latter is 0 for an impact.
    normal, shear : float
        Largest relative differences of the stiffnesses of contacts.
    spheres : float
        Largest relative difference of radii, of masses, and of the time steps.
    motion : float
        Largest difference of velocities over the largest velocity.
    force : float
        Largest difference of forces on spheres that move, over the largest of these forces.
    contacts : int
        Number of contacts that both have.
    """

    largest: float
    rms: float
    diameter: float
    compression: float
    normal: float
    shear: float
    spheres: float
    motion: float
    force: float
    contacts: int

    @property
    def lines(self) -> list[str]:
        """Lines of the output."""
        of = [(self.diameter, "diameter")] + [(self.compression, "static compression")] * bool(self.compression)
        shares = ", ".join(f"{self.largest / size:.1e} (rms {self.rms / size:.1e}) of the {name}" for size, name in of)
        return [
            f"places differ by at most {self.largest:.1e} m, {shares}",
            f"stiffnesses of {self.contacts} contacts differ by at most {self.normal:.1e}, of shear {self.shear:.1e}",
            f"radii, masses and time steps differ by at most {self.spheres:.1e}",
            f"at the beginning velocities differ by at most {self.motion:.1e}, forces by {self.force:.1e}",
        ]


def likeness(reading: Reading, spheres: Spheres, scene: Scene, indexed: Indexed, outside: Outside) -> Likeness:
    """Return the differences of a scene from a foreign deck whose spheres, in SI units, have places in its lattice.

    `outside` are the actions on the spheres of the deck beside their contacts.

    Raises
    ------
    SceneError
        If the scene describes another crystal: places, contacts or forces differ.
    """
    problem = prepare(scene)
    own = _read(problem)
    units, mine = problem.units, own.spheres
    assert mine is not None
    order = np.argsort(mine.id)
    rank = np.argsort(np.argsort(indexed.sites))  # spheres of a deck of ours are in the order of their places
    if len(order) != len(rank):
        raise SceneError(f"the scene has {len(order)} spheres, and the deck {len(rank)}")

    def of_mine(values: Floats, mass: int, length: int, time: int) -> Floats:
        return np.asarray(units.si(values[order][rank], mass=mass, length=length, time=time))

    def turned(values: Floats) -> Floats:
        return np.asarray(values @ indexed.turn.T)

    away = turned(spheres.position) - of_mine(mine.position, 0, 1, 0)
    away = aligned(away, problem.rest.atoms, scene.sphere.radius, indexed, ~spheres.moves)
    distance = np.linalg.norm(away, axis=1)
    speed = float(np.linalg.norm(spheres.velocity, axis=1).max())
    rates = turned(spheres.velocity) - of_mine(mine.velocity, 0, 1, -1)
    spins = (turned(spheres.spin) - of_mine(mine.spin, 0, 0, -1)) * spheres.radius[:, None]
    turning = float((np.linalg.norm(spheres.spin, axis=1) * spheres.radius).max()) if problem.on["rotation"] else 0.0
    motion = float(max(np.abs(rates).max(), np.abs(spins).max() if problem.on["rotation"] else 0.0))
    forces = (turned(spheres.force) - of_mine(mine.force, 1, 1, -2))[spheres.moves]
    scale = scene.scale
    unit = scale.force(scale.length, scene.sphere.normal_stiffness)
    # Rounding of places pushes struck spheres too: the scale is the force that stops them in a unit of time
    struck = 0.0 if scene.form.fills else speed * scale.mass / scale.time
    largest = max(float(np.abs(spheres.force[spheres.moves]).max()), _FAINT * unit, struck)
    _refuse_walls(_planes(outside, reading, spheres, indexed.turn), _planes_of(own, of_mine, problem), scene)
    contacts, normal, shear = _stiffnesses(reading, own, indexed, problem, order)
    found = Likeness(
        float(distance.max()),
        float(np.sqrt(np.mean(distance**2))),
        2 * scene.sphere.radius,
        scene.sphere.static_overlap,
        normal,
        shear,
        _unlike(reading, spheres, own, of_mine),
        motion / (max(speed, turning) or scale.velocity),
        float(np.abs(forces).max()) / largest,
        contacts,
    )
    _refuse(found, scene)
    if found.force > _FORCE:
        worst = int(np.argmax(np.abs(forces).max(axis=1)))
        number = spheres.id[spheres.moves][worst]
        force = np.linalg.norm(spheres.force[spheres.moves][worst])
        raise SceneError(
            f"forces at the beginning differ by up to {found.force:.2g} from those of the nearest scene: sphere "
            f"{number} bears {force:.3g} N in the deck, which differs by {np.abs(forces).max():.3g} N from the scene"
        )
    return found


def _unlike(reading: Reading, spheres: Spheres, own: Reading, of_mine: Callable[..., Floats]) -> float:
    """Return the largest relative difference of radii, of masses, and of the time steps.

    Raises
    ------
    SceneError
        If other spheres are held.
    """
    mine = own.spheres
    assert mine is not None
    assert own.start is not None
    assert reading.start is not None
    radius, mass = of_mine(mine.radius, 0, 1, 0), of_mine(mine.mass, 1, 0, 0)
    if not np.array_equal(of_mine(mine.moves, 0, 0, 0) > 0, spheres.moves):
        raise SceneError("the scene holds other spheres than the deck")
    step = STYLES[reading.units].si(reading.start.timestep, time=1)
    steps = of_mine(np.full(len(mass), own.start.timestep), 0, 0, 1)[:1] / step
    ratios = np.concatenate([radius / spheres.radius, mass / spheres.mass, steps])
    return float(np.abs(ratios - 1).max())


Planes = list[tuple[int, int, float, dict[str, Any]]]


def _planes(outside: Outside, reading: Reading, spheres: Spheres, turn: Floats) -> Planes:
    """Return the walls of a deck along the axes of a scene: axis, side, distance from the spheres in m, and law."""
    units, found = STYLES[reading.units], []
    for wall in outside.walls:
        way = turn[:, wall.axis] * wall.side
        axis = int(np.argmax(np.abs(way)))
        surface = (wall.side * spheres.position[:, wall.axis] + spheres.radius).max()
        away = float(wall.side * units.si(wall.place, length=1) - surface)
        found.append((axis, int(way[axis]), away, _said(wall.law, units)))
    return sorted(found, key=lambda each: each[:2])


def _planes_of(own: Reading, of_mine: Callable[..., Floats], problem: Problem) -> Planes:
    """Return the same for the deck of a scene, whose units may be its own."""
    mine, units = own.spheres, problem.units
    assert mine is not None
    place, radius, found = of_mine(mine.position, 0, 1, 0), of_mine(mine.radius, 0, 1, 0), []
    for wall in outside_of(own).walls:
        away = wall.side * units.si(wall.place, length=1) - (wall.side * place[:, wall.axis] + radius).max()
        found.append((wall.axis, wall.side, float(away), _said(wall.law, units)))
    return sorted(found, key=lambda each: each[:2])


def _said(law: Law, units: AnyUnits) -> dict[str, Any]:
    """Return the entry of a law in SI units, with the shear stiffness of the material if it is NULL."""
    shear = law.shear_stiffness if law.shear_stiffness is not None else 8 * law.effective()[1]
    return law.in_si(units) | {"shear_stiffness": units.si(shear, mass=1, length=-1, time=-2)}


def _refuse_walls(theirs: Planes, ours: Planes, scene: Scene) -> None:
    """Refuse a scene whose walls stand elsewhere, or have another law."""
    if [each[:2] for each in theirs] != [each[:2] for each in ours]:
        raise SceneError(f"the deck has {len(theirs)} walls, and the nearest scene {len(ours)}")
    for (axis, _, away, law), (_, _, own, ours_law) in zip(theirs, ours, strict=True):
        if abs(away - own) > _PLACE * (scene.sphere.static_overlap or scene.scale.length):
            raise SceneError(
                f"a wall stands {away:.3g} m beyond the spheres along {'xyz'[axis]}, and in a scene {own:.3g} m"
            )
        loss = "viscosity" if law["damping_law"] == "velocity" else "damping"
        for name in (*_OF_WALL, loss, *(_OF_SLIDING if law["friction"] else ())):
            one, other = law[name], ours_law[name]
            if one != other and not (isinstance(one, float) and isclose(one, other, rel_tol=_MOTION)):
                raise SceneError(
                    f"a wall has {name} {one}, and {other} in a scene, whose walls are rigid: twice the Young's "
                    "modulus of the spheres, and their law"
                )


def _refuse(found: Likeness, scene: Scene) -> None:
    length = found.compression or scene.scale.length
    if found.largest > _PLACE * length:
        raise SceneError(
            f"spheres are up to {found.largest:.3g} m from their places in the scene, {found.largest / length:.2g} of "
            "the overlap; this is not the crystal of a scene"
        )
    for name, value, most in (
        ("normal stiffnesses of contacts", found.normal, _STIFFNESS),
        ("shear stiffnesses of contacts", found.shear, _STIFFNESS),
        ("radii, masses or time steps", found.spheres, _MOTION),
        ("velocities", found.motion, _MOTION),
    ):
        if value > most:
            raise SceneError(f"{name} at the beginning differ by up to {value:.2g} from those of the nearest scene")


def _read(problem: Problem) -> Reading:
    with tempfile.TemporaryDirectory(prefix="granular-lmp-") as folder:
        deck = deck_of(problem)
        deck.write(folder, force=True)
        found = read(Path(folder, deck.input_name))
    if found.spheres is None:
        raise SceneError(found.stopped or "the deck of the scene has no spheres")
    return found


def aligned(away: Floats, atoms: ase.Atoms, radius: float, indexed: Indexed, held: NDArray[np.bool_]) -> Floats:
    """Return differences of places, m, without a common shift, to the nearest image across periodic faces.

    The mean difference of held spheres is 0; if no sphere is held, that of all spheres.
    """
    away = away - away[int(np.argmin(indexed.sites))]
    for axis in np.flatnonzero(atoms.pbc):
        side = atoms.cell.lengths()[axis] * radius
        away[:, axis] -= side * np.round(away[:, axis] / side)
    return np.asarray(away - away[held if held.any() else slice(None)].mean(axis=0))


def _stiffnesses(
    reading: Reading, own: Reading, indexed: Indexed, problem: Problem, order: NDArray[np.int64]
) -> tuple[int, float, float]:
    """Return the number of contacts of both decks and the largest relative differences of their stiffnesses.

    The laws are also compared at an overlap of `_SHALLOW`, as contacts that just touch have no stiffness.

    Raises
    ------
    SceneError
        If a contact is in only one of the decks.
    """
    units, deck = problem.units, STYLES[reading.units]
    theirs = _by_pair(reading, np.argsort(np.argsort(indexed.sites)))
    ours = _by_pair(own, np.argsort(order))
    if not np.array_equal(theirs[0], ours[0]):
        odd = np.setxor1d(theirs[0], ours[0])
        one, other = divmod(int(odd[0]) if len(odd) else 0, len(order))
        raise SceneError(
            f"{len(theirs[0])} contacts are in the deck and {len(ours[0])} in the nearest scene, which differ at the "
            f"spheres {one + 1} and {other + 1} of the scene"
        )
    found = []
    for their, our in zip(theirs[1:], ours[1:], strict=True):
        first, second = deck.si(their, mass=1, time=-2), units.si(our, mass=1, time=-2)
        found.append(float(np.max(np.abs(first - second) / np.maximum(first, _ZERO), initial=0.0)))
    return len(theirs[0]), found[0], found[1] if problem.on["shear"] else 0.0


def _by_pair(reading: Reading, place: NDArray[np.int64]) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Return both spheres of each contact as one number, ascending, and its stiffnesses, in units of the deck."""
    spheres, pairs = reading.spheres, reading.pairs
    assert spheres is not None
    assert pairs is not None
    near = pairs.of(pairs.overlap > _TOUCHING * spheres.radius.max())
    radius, (normal, shear) = effective_radius(spheres, near), np.zeros((2, len(near.i)))
    for law, which in reading.law_of(near):
        normal[which], shear[which] = law.stiffnesses(radius[which], near.overlap[which])
    one, other = place[near.i], place[near.j]
    pair = np.minimum(one, other) * len(place) + np.maximum(one, other)
    ascending = np.lexsort((normal, pair))
    law, size = reading.laws[(int(spheres.type[0]),) * 2], spheres.radius.max(keepdims=True)
    alone = law.stiffnesses(size / 2, _SHALLOW * size)
    return pair[ascending], np.append(normal[ascending], alone[0]), np.append(shear[ascending], alone[1])
