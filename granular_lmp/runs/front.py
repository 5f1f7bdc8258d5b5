"""Front of a wave that spreads from a strike or a source: its arrival at each sphere, and its speed.

The front arrives at a sphere at the first maximum of its speed, the vertex of the parabola through three samples. The
speed V of the front follows by least squares from

    t_i = t_0 + d_i / V

*Good values*: six or more samples per crest, and spheres that no echo has reached (`Front.between`). *When it breaks*:
a burst of several periods has several crests, and the first is faster than the group.
"""

from collections.abc import Callable, Mapping
from math import cos, inf, radians, sin
from typing import Any, Self

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import ReadoutError
from granular_lmp.frozen import dataclass
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.monitors import MonitorRecord
from granular_lmp.runs.record import Record
from granular_lmp.runs.scales import length_of
from granular_lmp.runs.snapshots import Snapshots
from granular_lmp.runs.unnamed import Unnamed
from granular_lmp.scene.places import place_troubles, spheres_at
from granular_lmp.scene.schema import allowed_names

__all__ = ["Front", "front"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_LEAST = 0.2  # A crest below this share of the largest speed of its sphere is a ripple ahead of the front
_STILL = 1e-3  # The front has not reached a sphere that stays below this share of the largest speed of all spheres
_BESIDE = 0.5  # radii: a sphere within this distance of the line lies on it, for unequal radii; a neighbour is farther
_UNITS = {"distance": "_m", "arrival": "_s", "error": "_s", "height": "_m_s"}
# Relevant part of the velocity of spheres (T, n, d), for a unit vector along the front
MOTIONS: dict[str, Callable[[Floats, Floats], Floats]] = {
    "speed": lambda velocity, _: velocity,
    "along": lambda velocity, way: (velocity @ way)[..., None],
    "across": lambda velocity, way: velocity - (velocity @ way)[..., None] * way,
}


@dataclass(frozen=True)
class Front:
    """Arrival of a front at the spheres of a line, nearest first.

    Attributes
    ----------
    places : dict of str to (n,) array
        ``row`` and ``column`` of each sphere, counted from 0; in an unnamed crystal the ``id``.
    distance : (n,) array
        Distance from the start of the front, m.
    arrival, error : (n,) arrays
        Time of the crest since the beginning of the run, s, and the difference if only every second sample is used.
    height : (n,) array
        Speed of the sphere at the crest, m/s.

    Examples
    --------
    >>> scene = Scene.load("solitary_chain").with_values({"packing.rows": 20, "time.duration": 25.0})
    >>> record = run(scene, "runs/front")
    >>> front(record).between(0.05, 0.1).row.tolist()
    [5, 6, 7, 8, 9, 10]
    """

    places: Mapping[str, Integers]
    distance: Floats
    arrival: Floats
    error: Floats
    height: Floats

    def between(self, near: float, far: float) -> Self:
        """Return the front between two distances, m."""
        inside = (self.distance >= near) & (self.distance <= far)
        places = {name: values[inside] for name, values in self.places.items()}
        return type(self)(places, *(getattr(self, name)[inside] for name in _UNITS))

    @property
    def row(self) -> Integers:
        """Row of each sphere, counted from 0."""
        return self.places["row"]

    @property
    def column(self) -> Integers:
        """Column of each sphere, counted from 0."""
        return self.places["column"]

    @property
    def speed(self) -> tuple[float, float]:
        """Speed of the front and its error, m/s.

        The error is the largest of three: the standard error of the fit, the contribution of the errors of the
        arrivals, and half of the difference between the near and the far half, which detects a front that slows down.

        Raises
        ------
        ReadoutError
            If the front has arrived at fewer than two distances.
        """
        slowness, error = _slowness(self.distance, self.arrival, self.error)
        if not slowness > 0:
            raise ReadoutError(
                f"the front has arrived at {len(self.distance)} spheres of the line, but at none later than at a "
                "nearer sphere; a speed needs two distances; use another direction, a longer run, or more recorded "
                "spheres"
            )
        half = len(self.distance) // 2
        near, far = (
            _slowness(self.distance[part], self.arrival[part], self.error[part])[0]
            for part in (slice(half), slice(half, None))
        )
        error = float(np.nanmax([error, abs(far - near) / 2]))
        return 1 / slowness, error / slowness**2

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """Columns of a table: row, column (or id), distance_m, arrival_s, error_s, height_m_s."""
        return {**self.places, **{name + unit: getattr(self, name) for name, unit in _UNITS.items()}}


def front(
    motion: Record | MonitorRecord | Snapshots | Unnamed,
    *,
    origin: tuple[int, int] | int | None = None,
    direction: float = 90.0,
    of: str = "speed",
) -> Front:
    """Return the arrival of the front of a wave at the spheres of a line, which gives its speed.

    Parameters
    ----------
    motion : Record, MonitorRecord, Snapshots or Unnamed
        Record of a scene without a wave; record of a monitor, or snapshots, of any scene; or an unnamed crystal.
    origin : (row, column), or id, optional
        Sphere from which the front starts; by default each sphere that is struck, pushed or driven. In an unnamed
        crystal the id must be given.
    direction : float
        Direction of the line of spheres from the origin, degrees from x towards y.
    of : str
        "speed" of the spheres, or only the component of velocity "along" or "across" the direction, for the
        longitudinal or the transverse front.

    Raises
    ------
    ReadoutError
        If nothing starts a front, if the record has only one sphere, or if no sphere on the line has a crest.

    Examples
    --------
    >>> scene = Scene.load("solitary_chain").with_values({"packing.rows": 20, "time.duration": 25.0})
    >>> record = run(scene, "runs/chain")
    >>> speed, error = front(record).speed
    >>> print(f"{speed:.2g} m/s")
    6.7e+02 m/s
    """
    if of not in MOTIONS:
        raise ReadoutError(f"of = {of!r}: {allowed_names(of, MOTIONS)}")
    way = np.array([cos(radians(direction)), sin(radians(direction)), 0.0])
    if isinstance(motion, Unnamed):
        return _of_unnamed(motion, origin, way, of)
    scene = motion.scene
    if isinstance(motion, Record) and scene.wave is not None:
        raise ReadoutError(
            f"{scene.name}: its trajectory has one sphere, but a front needs several; use a [[monitor]], or snapshots "
            "([output] particles)"
        )
    crystal, way = crystal_of(scene).atoms, way[: scene.space]
    places = crystal.positions[:, : scene.space]
    spheres = np.asarray(motion.spheres)
    distance = _distance(places[spheres], places[_starts(scene, crystal, origin)], way, _room(crystal, way))
    velocity = motion.stack("velocity") if isinstance(motion, Snapshots) else motion.velocity
    largest = float(np.linalg.norm(velocity, axis=-1).max(initial=0.0))
    chosen = _nearest_first(distance)
    there, arrivals = _arrivals(motion.tau, velocity[:, chosen], largest, way, of, scene.name)
    chosen = chosen[there]
    index, time = spheres[chosen], scene.scale.time
    which = {name: crystal.arrays[name][index] for name in ("row", "column")}
    si = arrivals.T * [[time], [time], [length_of(scene) / time]]
    return Front(which, distance[chosen] * scene.sphere.radius, *si)


def _of_unnamed(motion: Unnamed, origin: tuple[int, int] | int | None, way: Floats, of: str) -> Front:
    """Return the front in an unnamed crystal, from the sphere with an id."""
    if origin is None or isinstance(origin, tuple):
        raise ReadoutError(f"{motion.folder}: an unnamed crystal has no rows; give the id of a sphere, origin=ID")
    start = np.flatnonzero(motion.spheres == origin)
    if not len(start):
        raise ReadoutError(f"origin = {origin}: no sphere has this id in all snapshots")
    unit = float(motion.radius.mean())
    _, cell, periodic = motion.cell
    places = motion.rest / unit
    distance = _distance(places, places[start], way, _room(ase.Atoms(cell=cell / unit, pbc=periodic), way))
    chosen, largest, velocities = _nearest_first(distance), 0.0, []
    for moment in (motion[number] for number in range(len(motion))):  # one snapshot in memory at a time
        largest = max(largest, float(np.linalg.norm(moment.velocity, axis=1).max()))
        velocities.append(moment.velocity[chosen])
    there, arrivals = _arrivals(motion.time, np.array(velocities), largest, way, of, motion.name)
    chosen = chosen[there]
    return Front({"id": motion.spheres[chosen]}, distance[chosen] * unit, *arrivals.T)


def _nearest_first(distance: Floats) -> Integers:
    """Return the spheres on a line, nearest first."""
    chosen = np.flatnonzero(np.isfinite(distance))
    return chosen[np.argsort(distance[chosen], kind="stable")]


def _arrivals(
    time: Floats, velocity: Floats, largest: float, way: Floats, of: str, name: str
) -> tuple[NDArray[np.bool_], Floats]:
    """Return which spheres of a line have a crest, (n,), and time, its error and height of each crest, (m, 3)."""
    speed = np.linalg.norm(MOTIONS[of](velocity, way), axis=-1)
    crests = np.array([_crest(time, each, _STILL * largest) for each in speed.T]).reshape(-1, 3)
    there = np.isfinite(crests[:, 0])
    if not there.any():
        degrees = np.degrees(np.arctan2(way[1], way[0]))
        raise ReadoutError(
            f"{name}: none of the {len(there)} recorded spheres at {degrees:g} degrees has a crest; use another "
            "direction, a longer run, or more recorded spheres"
        )
    return there, crests[there]


def _starts(scene: Scene, crystal: ase.Atoms, origin: tuple[int, int] | int | None) -> Integers:
    """Return the indices of the spheres from which fronts start."""
    if isinstance(origin, int):
        raise ReadoutError(f"origin = {origin}: must be row and column of a sphere, for instance 0,30")
    if origin is not None:
        for trouble in place_troubles((), [origin], scene.shape):
            raise ReadoutError(f"origin: {trouble}")
        return spheres_at((), [origin], crystal, "origin")
    found = [
        spheres_at(each.rows, each.spheres, crystal, "origin", each.layers) for each in (*scene.striker, *scene.source)
    ]
    if scene.form.driven:
        found.append(spheres_at((0, 0), (), crystal, "origin"))
    if not found:
        raise ReadoutError(f"{scene.name}: nothing strikes, pushes or drives it; give origin, the start of the front")
    return np.unique(np.concatenate(found))


def _room(crystal: ase.Atoms, way: Floats) -> float:
    """Return the distance that a front travels before it meets itself across periodic sides, in radii."""
    sides = zip(crystal.pbc, crystal.cell.lengths(), np.abs(way), strict=False)
    return min((length / (2 * part) for periodic, length, part in sides if periodic and part > 1e-9), default=inf)


def _distance(places: Floats, starts: Floats, way: Floats, room: float) -> Floats:
    """Return the distance of spheres from the nearest start along its line, (n,); infinite for spheres on no line."""
    distance = np.full(len(places), inf)
    for start in starts:
        along = (places - start) @ way
        beside = np.linalg.norm(places - start - along[:, None] * way, axis=1)
        on_line = (beside < _BESIDE) & (along > _BESIDE) & (along <= room)
        distance = np.where(on_line, np.minimum(distance, along), distance)
    return distance


def _crest(tau: Floats, speed: Floats, least: float) -> tuple[float, float, float]:
    """Return time, error of the time, and height of the first crest of a speed (T,); nan if there is none."""
    high = max(least, _LEAST * speed.max(initial=0.0))
    tops = np.flatnonzero((speed[1:-1] > high) & (speed[1:-1] >= speed[:-2]) & (speed[1:-1] > speed[2:])) + 1
    if not len(tops):
        return np.nan, np.nan, np.nan
    top, apart = int(tops[0]), float(tau[1] - tau[0])
    shift, height = _vertex(*speed[top - 1 : top + 2])
    error = 1.0
    if 2 <= top < len(speed) - 2:
        coarse = 2 * _vertex(*speed[top - 2 : top + 3 : 2])[0]
        error = abs(coarse - shift) if abs(coarse) <= 1 else 1.0
    return float(tau[top] + shift * apart), error * apart, height


def _vertex(before: float, here: float, after: float) -> tuple[float, float]:
    """Return place and height of the vertex of the parabola through values at −1, 0 and 1."""
    bend = before - 2 * here + after
    shift = (before - after) / (2 * bend) if bend else inf
    return float(shift), float(here - (before - after) * shift / 4)


def _slowness(distance: Floats, arrival: Floats, error: Floats) -> tuple[float, float]:
    """Return the slope of arrival over distance and its error, s/m; nan with fewer than two distances."""
    if not len(distance) or np.ptp(distance) == 0:
        return np.nan, np.nan
    from_mean = distance - distance.mean()
    weights = from_mean / np.sum(from_mean**2)
    slope = float(weights @ arrival)
    rest = arrival - arrival.mean() - slope * from_mean
    free = len(distance) - 2
    fit = np.sqrt(np.sum(rest**2) / free * np.sum(weights**2)) if free else 0.0
    return slope, float(max(fit, np.linalg.norm(weights * error)))
