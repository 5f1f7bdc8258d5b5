"""Arrival and speed of the front of an impact in a chain or a sheet of Hertz contacts, predicted from a scene.

Chain and sheet are integrated as networks of Hertz's springs without friction (`granular_analysis.theory.network`).
The front arrives at a sphere with the first crest of the sphere's speed; times count from the strike.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.measure.points import Point
from granular_analysis.measure.strikes import Sites, densities
from granular_analysis.theory.network import RIGID, Material, Network, Wall, mixed
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_outside import Drive
from granular_analysis.theory.network_state import start
from granular_lmp.runs.record import Scene

Floats = NDArray[np.float64]
# Tables and keys of a scene that the integration of an impact includes, or that do not change the motion
IMPACT_KEYS = {"name", "description", "inclusion", "striker", "monitor", "output", "time"} | {
    f"{section}.{key}"
    for section, keys in {
        "sphere": "radius youngs_modulus poisson_ratio density",
        "packing": "lattice rows columns first last sides contact_force",
        "effects": "shear_law rotation",
    }.items()
    for key in keys.split()
}
_ENDS = ("free", "held")  # allowed first and last rows of a sheet
_SAMPLES = 400  # samples up to the end; a crest at a tenth of the rows has ten
_LATER = 1.3  # the integration ends at the last measured arrival times this, so slower fronts still arrive
_RTOL = 1e-8
SILENCE = 1e-5  # share of the striker's speed below which a crest is rounding, or the foot of the front
_WEAK = 1e-2  # factor on _RTOL in a chain that is pressed together


def fronts(scene: Scene, points: Sequence[Point]) -> Floats:
    """Return the predicted arrivals (s) and speeds (m/s) of the front for measured points, (N,).

    A speed is the distance of two spheres over the difference of their arrivals.

    Raises ValueError for a scene that declares more than a strike on a chain or a sheet, for a sphere that is not
    there, and for a sphere that no front reaches within 1.3 times the last measured arrival.
    """
    if scene.wave is not None or not scene.striker:
        raise ValueError("arrivals and front speeds need a scene with [[striker]] and without [wave]")
    _refuse(scene)
    sites = Sites.of(scene)
    place, velocity = sites.place * scene.sphere.radius, np.zeros((len(sites.row), 2))
    struck = [sites.chosen(each) for each in scene.striker]
    for chosen, each in zip(struck, scene.striker, strict=True):
        velocity[chosen] = each.components[:2]
    ends = [_ends(scene, sites, int(struck[0][0]), each) for each in points]
    needed = np.unique([sphere for pair in ends for sphere in pair])
    if arrivals := [each.value for each in points if each.kind == "arrival"]:
        last = max(arrivals)
    else:
        farthest = np.linalg.norm(place[needed] - place[struck[0][0]], axis=1).max()
        last = float(farthest) / min(each.value for each in points)
    times = np.linspace(0.0, _LATER * last, _SAMPLES)
    if scene.lattice.sheet:
        speeds = _in_sheet(scene, sites, place, velocity, times, needed)
    else:
        place, speeds = _in_chain(scene, place, velocity, times, needed)
    fastest = np.linalg.norm(velocity, axis=1).max()
    at = {sphere: crest(times, each)[0] for sphere, each in zip(needed.tolist(), speeds.T / fastest, strict=True)}
    for sphere, time in at.items():
        if not np.isfinite(time):
            raise ValueError(f"row {sites.row[sphere]}: no front arrives there by {times[-1]:.4g} s")
    found = [at[one] for one, *_ in ends]
    for number, (one, *other) in enumerate(ends):
        if other:
            found[number] = float(np.linalg.norm(place[other[0]] - place[one])) / (at[other[0]] - at[one])
    return np.array(found)


def _refuse(scene: Scene) -> None:
    """Raise ValueError for a scene with keys that the integration of an impact leaves out."""
    tables = {key: table if isinstance(table, dict) else {} for key, table in scene.given().items()}
    keys = [(each, f"{each}.{name}") for each, table in tables.items() for name in table or [""]]
    if other := sorted(key.rstrip(".") for section, key in keys if not {section, key} & IMPACT_KEYS):
        raise ValueError(f"arrivals and front speeds need a struck chain or sheet without {', '.join(other)}")
    packing = scene.packing
    if scene.lattice.sheet and packing.contact_force:
        raise ValueError(f"packing.contact_force = {packing.contact_force!r}: must be 0 in a sheet with arrivals")
    for key, allowed in {"first": _ENDS, "last": _ENDS, "sides": ("free", "periodic")}.items():
        if scene.lattice.sheet and getattr(packing, key) not in allowed:
            raise ValueError(
                f"packing.{key} = {getattr(packing, key)!r}: must be one of {', '.join(allowed)} in a sheet with "
                "arrivals"
            )


def _ends(scene: Scene, sites: Sites, striker: int, point: Point) -> list[int]:
    """Return the spheres of a point: one for an arrival, the first and the last for a speed."""
    found = []
    for row, column in ((point.row, point.column), (point.to_row, point.to_column))[: 1 + (point.kind == "speed")]:
        column = int(sites.column[striker]) if column < 0 else column
        rows, columns = int(scene.packing.rows), int(scene.packing.columns)
        if row >= rows or column >= columns:
            raise ValueError(f"line {point.line}: row {row}, column {column}: must be below {rows} and {columns}")
        found.append(row * columns + column)
    if found[1:] == found[:1]:
        raise ValueError(f"line {point.line}: both ends of the speed are one sphere in row {point.row}; it needs two")
    return found


def _in_chain(
    scene: Scene, place: Floats, velocity: Floats, times: Floats, needed: NDArray[np.intp]
) -> tuple[Floats, Floats]:
    """Return the places at rest (N, 2) of a chain under its load, and the speeds (T, n) of the `needed` spheres."""
    packing, sphere, count = scene.packing, scene.sphere, len(place)
    material, radius, load = Material(sphere.youngs_modulus, sphere.poisson_ratio), sphere.radius, packing.contact_force
    pair, wall = (
        (load / mixed((material, RIGID), (np.array([0]), np.array([kind])), (np.array([radius]), np.array([other])))[0])
        ** (2 / 3)
        for kind, other in ((0, radius), (1, np.inf))
    )
    place = place * (1 - float(pair[0]) / (2 * radius))
    held, walls, drives = np.zeros(count, dtype=bool), [], []
    for end, last, onward in ((packing.first, 0, -1.0), (packing.last, count - 1, 1.0)):
        if end == "wall":
            walls.append(Wall((0.0, place[last, 1] + onward * (radius - float(wall[0]))), (0.0, onward)))
        elif end == "held":
            held[last] = True
        elif load:
            drives.append(Drive(np.array([last]), 1, partial(_constant, -onward * load)))
    network = Network(
        *(place, np.full(count, radius), densities(scene), (material,)),
        held=held,
        walls=tuple(walls),
        drives=tuple(drives),
        shear=False,
        rotation=False,
    )
    # Errors are relative to the overlap at rest, which is larger than the motion of a weak wave
    rtol = _RTOL * (_WEAK if load else 1.0)
    run = integrate(network, start(network, 0.0, velocity), times, rtol=rtol, spheres=needed)
    return place, np.abs(run.velocity[..., 1])


def _constant(force: float, times: Floats) -> Floats:
    return np.full(len(times), force)


def _in_sheet(
    scene: Scene, sites: Sites, place: Floats, velocity: Floats, times: Floats, needed: NDArray[np.intp]
) -> Floats:
    """Return the speeds (T, n) of the `needed` spheres of a sheet."""
    packing, sphere = scene.packing, scene.sphere
    edges = {"first": sites.row == 0, "last": sites.row == sites.row.max()}
    held = np.any([own for name, own in edges.items() if getattr(packing, name) == "held"] or [sites.row < 0], axis=0)
    width = 2 * sphere.radius * int(packing.columns) if packing.sides == "periodic" else np.inf
    network = Network(
        place,
        np.full(len(place), sphere.radius),
        densities(scene)[sites.row],
        (Material(sphere.youngs_modulus, sphere.poisson_ratio),),
        held=held,
        cell=(width, np.inf),
        shear=False,
        rotation=False,
    )
    run = integrate(network, start(network, 0.0, velocity), times, rtol=_RTOL, spheres=needed)
    return np.asarray(np.linalg.norm(run.velocity, axis=-1))


def crest(times: ArrayLike, speed: ArrayLike) -> tuple[float, float]:
    """Return time and height of the first crest of a speed (T,), from a parabola through three samples.

    Both are nan if no maximum exceeds `SILENCE`; the speed is in units of the striker's. Good values: with ten samples
    to a crest the height is right to 1e-3.
    """
    times, speed = np.asarray(times, dtype=float), np.asarray(speed, dtype=float)
    inner = speed[1:-1]
    tops = np.flatnonzero((inner > SILENCE) & (inner >= speed[:-2]) & (inner > speed[2:])) + 1
    if not len(tops):
        return np.nan, np.nan
    top = int(tops[0])
    before, here, after = speed[top - 1 : top + 2]
    shift = (before - after) / (2 * (before - 2 * here + after))
    step = times[top] - times[top - 1]
    return float(times[top] + shift * step), float(here - (before - after) * shift / 4)
