"""Branches of any crystal in its Brillouin zone: paths between corners, group velocities, density of states.

Corners have their usual names: Γ ("G"), M and K of a hexagonal zone, X and M of a square zone, X, L, W, K and U of fcc,
X, M and R of cubic, A of hcp. A film has the zone of its plane. Wave vectors are in 1/R.
"""

from collections.abc import Sequence
from itertools import pairwise, product
from math import pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.bloch import bloch_modes
from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.lattice import Lattice
from granular_lmp.crystal.lattices import lattice_constant
from granular_lmp.crystal.mode import FULL, FX, UX, UZ, F, Physics
from granular_lmp.crystal.modes import MODES, branch_names
from granular_lmp.crystal.sphere import INERTIA_RATIO, Sphere
from granular_lmp.crystal.wavevector import ROW_SPACING, zone_edge
from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass

Floats = NDArray[np.float64]
CHARACTERS = ("along", "across", "vertical", "rocking", "torsion")  # shares of the kinetic energy of a mode
_STEP = 1e-4  # 1/R, step of central differences: relative errors of 1e-8 by rounding and 1e-8 by curvature
_POINTS = 60  # points of a path from corner to corner
_DIRECTIONS = 360  # directions of k over the full circle; an even number
_LENGTHS = 160  # values of |k| between Γ and the edge of the zone; a crossing is interpolated linearly between two
_BINS = 200  # bins of a density of states
_SAMPLES = 1_000_000  # samples of a density of states: 5000 per bin, whose scatter is invisible in a figure
_HEXAGON = {"M": (0.0, 2 * pi / sqrt(3)), "K": (4 * pi / 3, 0.0)}
_FCC = {"X": (0, 0, 1), "L": (0.5, 0.5, 0.5), "W": (0.5, 0, 1), "K": (0.75, 0.75, 0), "U": (0.25, 0.25, 1)}
_CUBIC = {"X": (0, 1, 0), "M": (1, 1, 0), "R": (1, 1, 1)}
# Columns are the cubic axes of fcc in the box, by the orientation along y
_AXES = {
    "[001]": np.array([[1, 1, 0], [0, 0, sqrt(2)], [1, -1, 0]]) / sqrt(2),
    "[110]": np.array([[1, -1, 0], [1, 1, 0], [0, 0, sqrt(2)]]) / sqrt(2),
    "[111]": np.array([[sqrt(3), -sqrt(3), 0], [sqrt(2), sqrt(2), sqrt(2)], [-1, -1, 2]]) / sqrt(6),
}
_AXES["[11-2]"] = _AXES["[111]"][[0, 2, 1]]


@dataclass(frozen=True, eq=False)
class Branches:
    """Branches along a path of wave vectors.

    Attributes
    ----------
    wavevector : (K, 3) array
        Wave vectors, 1/R.
    way : (K,) array
        Distance along the path, 1/R.
    frequency : (K, B) array
        Frequencies, rad/t0, ascending.
    character : (K, B, 5) array
        Shares of `CHARACTERS` in the kinetic energy.
    corners : tuple of (way, name)
        Distance along the path and name of each corner.
    """

    wavevector: Floats
    way: Floats
    frequency: Floats
    character: Floats
    corners: tuple[tuple[float, str], ...] = ()


def corners_of(lattice: Lattice) -> dict[str, Floats]:
    """Return the corners of the zone in the order of the default path, in 1/distance of touching spheres."""
    name, _, orientation = lattice.name.partition(" ")
    found: dict[str, Sequence[float]] = {"G": (0.0, 0.0, 0.0)}
    if lattice.solid and not lattice.film:
        if name == "fcc":
            side = 2 * pi / sqrt(2)
            return {"G": np.zeros(3)} | {key: side * _AXES[orientation] @ place for key, place in _FCC.items()}
        if name == "cubic":
            return {"G": np.zeros(3)} | {key: pi * np.array(place) for key, place in _CUBIC.items()}
        height = np.eye(3)[1 if orientation == "c" else 2] * pi / (2 * sqrt(2 / 3))
        second = 2 if orientation == "c" else 1
        layer = {key: x * np.eye(3)[0] + y * np.eye(3)[second] for key, (x, y) in _HEXAGON.items()}
        return {"G": np.zeros(3)} | layer | {"A": height}
    across, along = (float(np.linalg.norm(each)) / 2 for each in lattice.reciprocal())
    if not lattice.sheet:
        found |= {"X": (0.0, along, 0.0)}
    elif lattice.name == "honeycomb":
        found |= {key: (x / sqrt(3), y / sqrt(3), 0.0) for key, (x, y) in _HEXAGON.items()}
        found["M"] = (0.0, found["M"][1], 0.0)
    elif lattice.row_period == 2 and not lattice.highest_shift(2):
        found |= {key: (x, y, 0.0) for key, (x, y) in _HEXAGON.items()}
    else:
        found |= {"X": (0.0, along, 0.0), "M": (across, along, 0.0)}
    return {key: np.array(place) for key, place in found.items()}


def path_of(lattice: Lattice, names: str) -> tuple[Floats, tuple[str, ...]]:
    """Return the corners of a path such as "G-M-K-G", and their names; "" is the path through all corners back to Γ.

    Raises
    ------
    SceneError
        If the zone has no corner of this name, or the path has only one corner.
    """
    corners = corners_of(lattice)
    asked = tuple(names.upper().split("-")) if names else (*corners, "G")
    for name in asked:
        if name not in corners:
            raise SceneError(f"path = {names!r}: {name!r}: must be corners of the zone, {', '.join(corners)}, with '-'")
    if len(asked) < 2:
        raise SceneError(f"path = {names!r}: must be at least two corners of {', '.join(corners)}")
    return np.array([corners[name] for name in asked]), asked


def along_path(crystal: Contacts, sphere: Sphere, physics: Physics, lattice: Lattice, names: str) -> Branches:
    """Return the branches along a path through the zone, with `_POINTS` wave vectors from corner to corner."""
    places, asked = path_of(lattice, names)
    places = places / lattice_constant(sphere)
    share = np.linspace(0, 1, _POINTS)[:, None]
    wavevector = np.vstack([start + share * (end - start) for start, end in pairwise(places)])
    edges = np.linalg.norm(np.diff(places, axis=0), axis=1)
    ends = np.concatenate([[0.0], np.cumsum(edges)])
    way = np.concatenate([before + share[:, 0] * edge for before, edge in zip(ends, edges, strict=False)])
    frequency, shapes = bloch_modes(crystal, sphere, wavevector, physics)
    corners = tuple(zip(ends.tolist(), asked, strict=True))
    return Branches(wavevector, way, frequency, characters(shapes, wavevector, crystal.mass), corners)


def characters(shapes: NDArray[Any], wavevector: Floats, mass: Floats) -> Floats:
    """Return the shares of `CHARACTERS` in modes (K, B, 6N) at wave vectors (K, 3); at Γ "along" means along y.

    They are shares of the kinetic energy: displacement along k in the plane, across k, and along z; rotation about axes
    in the plane, and about z.
    """
    plane = wavevector[:, :2]
    size = np.linalg.norm(plane, axis=1, keepdims=True)
    unit = np.divide(plane, size, out=np.tile([0.0, 1.0], (len(plane), 1)), where=size > 0)[:, None, None]
    each = shapes.reshape(*shapes.shape[:2], -1, 6) * np.sqrt(mass)[:, None]
    u, f = each[..., UX:FX], each[..., FX:]
    along = u[..., 0] * unit[..., 0] + u[..., 1] * unit[..., 1]
    across = u[..., 1] * unit[..., 0] - u[..., 0] * unit[..., 1]
    squares = [np.abs(along) ** 2, np.abs(across) ** 2, np.abs(u[..., UZ]) ** 2]
    turned = INERTIA_RATIO * np.abs(f) ** 2
    squares += [turned[..., 0] + turned[..., 1], turned[..., F - FX]]
    energy = np.stack([np.sum(square, axis=-1) for square in squares], axis=-1)
    return np.asarray(energy / energy.sum(axis=-1, keepdims=True))


def group_velocities(crystal: Contacts, sphere: Sphere, wavevector: Floats, physics: Physics) -> Floats:
    """Return ∂Ω/∂k of each branch at wave vectors (..., 2 or 3), (..., B, 2 or 3), R/t0, by central differences.

    When it breaks: where two branches cross within 1e-4/R, because branches are followed by the order of frequencies,
    not by shape.
    """
    steps = _STEP * np.eye(wavevector.shape[-1])
    nearby = wavevector[..., None, :]
    ahead, behind = (bloch_modes(crystal, sphere, nearby + way * steps, physics)[0] for way in (1, -1))
    return np.asarray((ahead - behind).swapaxes(-1, -2) / (2 * _STEP))


def fronts(lattice: Contacts, sphere: Sphere, frequency: float, physics: Physics = FULL) -> dict[str, Floats]:
    """Return the group velocities of the waves at a frequency in the hexagonal lattice, by name of their mode.

    Far from its source, a signal of frequency Ω travels with the energy at this frequency:

        r(τ) = v_g(k) τ,    v_g = ∂Ω_j/∂k    for every k with Ω_j(k) = Ω

    The curve of v_g over all these k is the group-velocity surface of branch j; for long waves it is a circle. Where
    the contour Ω_j(k) = Ω is flat or has an inflection, energy is focused and the curve has cusps. Group velocities of
    RT point against k.

    Parameters
    ----------
    lattice, sphere : Contacts, Sphere
        Contacts of the hexagonal lattice with one sphere per cell, and its sphere.
    frequency : float
        Ω, rad/t0.
    physics : Physics
        Degrees of freedom.

    Returns
    -------
    dict of str to (n, 2) array
        v_g in R/t0, in the order of the directions of k, for each mode that has the frequency in some direction: L
        moves most along k, TR is the lower and RT the upper of the others. A direction in which a mode has the
        frequency at several k gives several rows. Velocities are accurate to about 1e-3, because |k| is interpolated.
    """
    # Half the directions suffice: −k has the frequency of k and the opposite velocity. None is along a mirror line
    degrees = np.linspace(-180, 0, _DIRECTIONS // 2, endpoint=False) + 180 / _DIRECTIONS
    along = np.column_stack([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    edge = np.array([zone_edge(each) for each in degrees]) / ROW_SPACING / lattice_constant(sphere)
    share = np.linspace(0.01, 1.0, _LENGTHS)
    size = edge[:, None] * share
    found, shapes = bloch_modes(lattice, sphere, size[..., None] * along[:, None], physics)
    crossed = np.diff(np.sign(found - frequency), axis=1) != 0  # (directions, samples - 1, branches)
    if not crossed.any():
        return {}
    place, at, branch = np.argwhere(crossed).T
    below, above = (found[place, each, branch] - frequency for each in (at, at + 1))
    length = size[place, at] + (size[place, at + 1] - size[place, at]) * below / (below - above)
    k = length[:, None] * along[place]
    velocities = group_velocities(lattice, sphere, k, physics)[np.arange(len(k)), branch]
    result: dict[str, list[Floats]] = {}
    for direction, sample, each, velocity in zip(place, at, branch, velocities, strict=True):
        name = branch_names(shapes[direction, sample], along[direction])[each]
        result.setdefault(name, []).append(velocity)
    return {name: np.concatenate([result[name], np.negative(result[name])]) for name in MODES if name in result}


def density_of_states(
    crystal: Contacts, sphere: Sphere, physics: Physics, lattice: Lattice, points: int
) -> tuple[Floats, Floats]:
    """Return the middles of bins, rad/t0, and the density of states in each bin, normalised to the integral 1.

    `points` is the number of wave vectors along each primitive reciprocal vector, starting at Γ. Frequencies are
    interpolated linearly between wave vectors, because otherwise each wave vector would appear as a separate line. Good
    values: 30 in a layer, 20 in a bulk crystal.
    """
    vectors = lattice.reciprocal() / lattice_constant(sphere)
    share = np.arange(points) / points
    if not lattice.sheet:
        vectors = vectors[1:]
    shares = np.array(list(product(share, repeat=len(vectors))))
    found = [
        bloch_modes(crystal, sphere, part @ vectors, physics)[0]
        for part in np.array_split(shares, max(1, len(shares) // 512))
    ]
    frequencies = np.concatenate(found).reshape(*[points] * len(vectors), -1)
    count, edges = np.histogram(_between(frequencies), bins=_BINS, density=True)
    return (edges[1:] + edges[:-1]) / 2, np.asarray(count)


def _between(frequencies: Floats) -> Floats:
    """Return the frequencies of a periodic grid (n, …, n, B) over the zone, interpolated to about `_SAMPLES` values."""
    axes = frequencies.ndim - 1
    finer = max(1, round((_SAMPLES / frequencies.size) ** (1 / axes)))
    for axis in range(axes):
        ahead = np.roll(frequencies, -1, axis)
        way = (np.arange(finer) + 0.5) / finer
        frequencies = np.concatenate([(1 - x) * frequencies + x * ahead for x in way], axis)
    return frequencies
