"""Find rows, columns and layers of spheres in one of the lattices of a scene, from their places only.

Each lattice is tried in each orientation along the axes of the box. The spheres around a sphere in the middle get their
numbers from the shifts of the lattice (`granular_lmp.crystal.lattice`). An affine map from numbers to places is fitted
to them and numbers the spheres within twice the distance, until all spheres have a number. The map shows whether the
lattice is strained, sheared or turned; such a crystal is refused, and the message says which.

*Good values*: spheres within a tenth of the distance of neighbours from their places, and vacancies at up to a fifth
of them.
"""

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattice import LATTICES, Lattice
from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

_NEAR = 0.25  # times the distance of neighbours; a sphere belongs to a place if it is nearer than this
_FIRST = 1.6  # the spheres within this many distances of neighbours of the first one are numbered first
_MOST_EMPTY = 0.2  # share of the places; with more vacancies the lattice is another one
_FLAT = 0.5  # times the distance of neighbours; rows and layers are farther apart than this
_ORDER, _NAMES = [1, 0, 2], ("rows", "columns", "layers")  # by the axes y, x and z
_FITS = 1e-3  # relative deviation from a whole number of rows in the box


@dataclass(frozen=True, eq=False)
class Indexed:
    """Spheres in a lattice, N of them.

    Attributes
    ----------
    lattice : Lattice
    turn : (3, 3) array
        Rotation that takes a vector of the deck to one of the scene, along axes: of entries 0, 1 and -1.
    row, column, layer : (N,) arrays
        Counted from 0, as a scene counts.
    shape : (int, int, int)
        Numbers of rows, columns and layers.
    touching : float
        Distance of neighbours.
    empty : (E, 3) array
        Row, column and layer of the places without a sphere.
    """

    lattice: Lattice
    turn: Floats
    row: Integers
    column: Integers
    layer: Integers
    shape: tuple[int, int, int]
    touching: float
    empty: Integers

    @property
    def sites(self) -> Integers:
        """Place of each sphere, counted row by row, in a row column by column, and there layer by layer, (N,)."""
        _, columns, layers = self.shape
        return np.asarray((self.row * columns + self.column) * layers + self.layer)


def index(places: Floats, edges: Floats, periodic: NDArray[np.bool_], strain: float) -> Iterator[Indexed]:
    """Yield the ways to number spheres in a lattice of a scene, ways without vacancies first.

    Parameters
    ----------
    places : (N, 3) array
    edges : (3,) array
        Lengths of the box.
    periodic : (3,) array of bool
    strain : float
        Largest strain of the whole crystal.

    Raises
    ------
    SceneError
        If there is none; the message says how the crystal differs from the nearest lattice.
    """
    if len(places) < 2:
        raise SceneError("a single sphere is no crystal")
    apart = neighbours(places)
    wide = np.ptp(places, axis=0) > _FLAT * apart
    found: list[Indexed] = []
    troubles: list[str] = []
    whole = False
    for turn in _turns(wide):
        at, sides, around = places @ turn.T, np.abs(turn @ edges), (np.abs(turn) @ periodic).astype(bool)
        for lattice in LATTICES.values():
            if _dimension(lattice) != wide.sum():
                continue
            try:
                for each in _indexed(lattice, turn, at, apart, sides, around, strain):
                    if len(each.empty):
                        found.append(each)
                    else:
                        whole = True
                        yield each
            except SceneError as error:
                troubles.append(str(error))
    if not (found or whole):
        raise SceneError(troubles[0] if troubles else _turned(places, apart, wide))
    yield from sorted(found, key=lambda each: len(each.empty))


def neighbours(places: Floats) -> float:
    """Return the median distance of spheres from their nearest neighbours."""
    from scipy.spatial import cKDTree  # kept out of start-up

    return float(np.median(cKDTree(places).query(places, 2)[0][:, 1]))


def _dimension(lattice: Lattice) -> int:
    return 3 if lattice.solid else 2 if lattice.sheet else 1


def _axes(lattice: Lattice) -> list[int]:
    """Return the axes along which a lattice has rows, columns and layers."""
    return [0, 1, 2][: _dimension(lattice)] if lattice.sheet else [1]


def _turns(wide: NDArray[np.bool_]) -> list[Floats]:
    """Return the rotations of the axes that turn a plane of spheres into z = const, and a line into the axis y.

    Rotations that change least come first. A line has two, one for each end.
    """
    found, axes = [], np.flatnonzero(wide)
    for order in permutations(range(3)):
        if (len(axes) == 1 and order[1] != axes[0]) or (len(axes) == 2 and order[2] in axes):
            continue
        for signs in product((1.0, -1.0), repeat=3):
            turn = np.array(signs)[:, None] * np.eye(3)[list(order)]
            if np.linalg.det(turn) > 0:
                found.append(turn)
    found.sort(key=lambda turn: (-np.trace(turn), -turn[1].sum()))
    return found if len(axes) > 1 else [*{tuple(turn[1]): turn for turn in reversed(found)}.values()][::-1]


def _indexed(
    lattice: Lattice,
    turn: Floats,
    places: Floats,
    apart: float,
    edges: Floats,
    periodic: NDArray[np.bool_],
    strain: float,
) -> Iterator[Indexed]:
    """Yield the ways to number turned places in a lattice, one for each place of its period at which they may begin."""
    first = int(np.argmin(np.linalg.norm(places - (places.max(axis=0) + places.min(axis=0)) / 2, axis=1)))
    from_first = places - places[first]
    distance = np.linalg.norm(from_first, axis=1)
    periods = (lattice.row_period, lattice.column_period, lattice.layer_period)
    for start in np.ndindex(periods):
        numbered = _grown(lattice, start, from_first, distance, apart)
        if numbered is None:
            continue
        numbers, strained = numbered
        around = periodic & [lattice.sheet, True, lattice.solid]
        counts = _counts(lattice, numbers, strained, edges, around)
        touching = _distance(lattice, strained / _spacing(lattice, 1.0), around, strain)
        place = _in_box(lattice, numbers, counts)
        if place is not None:
            row, column, layer = place[0].T
            yield Indexed(lattice, turn, row, column, layer, counts, touching, place[1])


def _spacing(lattice: Lattice, touching: float) -> Floats:
    """Return the distances of columns, rows and layers; 1 along an axis that the lattice does not have."""
    found = np.array([lattice.column_distance(touching), lattice.row_distance(touching), 1.0])
    found[0] = found[0] if lattice.sheet else 1.0
    found[2] = lattice.layer_distance(touching) if lattice.solid else 1.0
    return found


def _grown(
    lattice: Lattice, start: tuple[int, ...], places: Floats, distance: Floats, apart: float
) -> tuple[Integers, Floats] | None:
    """Return row, column and layer of all spheres, (N, 3), and the fitted map (3, 3); None if they do not fit."""
    begin = np.array(lattice.offsets(*np.array(start)))
    axes, scale, shift = _axes(lattice), np.diag(_spacing(lattice, apart)), np.zeros(3)
    reach, farthest = _FIRST * apart, float(distance.max())
    while True:
        near = distance <= reach
        numbers = _numbers(lattice, (places[near] - shift) @ np.linalg.inv(scale).T + begin)
        of_lattice = np.array(lattice.offsets(*numbers.T)).T - begin
        away = np.linalg.norm((places[near] - shift - of_lattice @ scale.T)[:, axes], axis=1)
        if away.max() > _NEAR * apart or len(np.unique(numbers, axis=0)) < len(numbers):
            return None
        centred, middle = of_lattice - of_lattice.mean(axis=0), places[near].mean(axis=0)
        if np.linalg.matrix_rank(centred[:, axes]) == len(axes):
            scale = scale.copy()
            scale[:, axes] = np.linalg.lstsq(centred[:, axes], places[near] - middle, rcond=None)[0].T
            shift = middle - scale @ of_lattice.mean(axis=0)
        if near.all():
            return numbers, scale
        reach = min(2 * reach, farthest)


def _numbers(lattice: Lattice, offsets: Floats) -> Integers:
    """Return row, column and layer of the places nearest to offsets in columns, rows and layers, (N, 3)."""
    best, nearest = np.full(len(offsets), np.inf), np.zeros((len(offsets), 3), dtype=np.int64)
    spacing = _spacing(lattice, 1.0)
    for row, layer, place in product(*map(range, (lattice.row_period, lattice.layer_period, lattice.column_period))):
        x, y, z = lattice.stacking[row][layer]
        along_x, along_y = lattice.places[place]
        period = lattice.column_period
        rows = row + lattice.row_period * np.round((offsets[:, 1] - y - along_y - row) / lattice.row_period)
        layers = layer + lattice.layer_period * np.round((offsets[:, 2] - z - layer) / lattice.layer_period)
        begun = place + period * np.round((offsets[:, 0] - x - along_x) / period)
        tried = np.stack([rows, begun + int(x), layers if lattice.solid else 0 * layers], axis=1).astype(np.int64)
        if not lattice.sheet:
            tried[:, 1] = 0
        away = np.linalg.norm((np.array(lattice.offsets(*tried.T)).T - offsets) * spacing, axis=1)
        better = away < best
        best[better], nearest[better] = away[better], tried[better]
    return nearest


def _counts(
    lattice: Lattice, numbers: Integers, strained: Floats, edges: Floats, periodic: NDArray[np.bool_]
) -> tuple[int, int, int]:
    """Return the numbers of rows, columns and layers; along periodic axes the box replaces the fitted map.

    Raises
    ------
    SceneError
        If the box does not hold whole periods of the lattice.
    """
    counts, periods = np.ptp(numbers, axis=0) + 1, (lattice.row_period, lattice.column_period, lattice.layer_period)
    for number, axis in enumerate(_ORDER):
        if not periodic[axis]:
            continue
        held = edges[axis] / strained[axis, axis]
        counts[number] = round(held)
        if abs(held / counts[number] - 1) > _FITS or counts[number] % periods[number]:
            raise SceneError(
                f"the periodic box holds {held:.6g} {_NAMES[number]} of {_words(lattice)}, and a scene has a whole "
                f"multiple of {periods[number]}"
            )
        strained[:, axis] = 0.0
        strained[axis, axis] = edges[axis] / counts[number]
    return int(counts[0]), int(counts[1]), int(counts[2])


def _in_box(lattice: Lattice, numbers: Integers, counts: tuple[int, int, int]) -> tuple[Integers, Integers] | None:
    """Return numbers from 0 and the empty places; None if no scene begins at this place of the lattice's period."""
    lowest, periods = numbers.min(axis=0), np.array((lattice.row_period, lattice.column_period, lattice.layer_period))
    # As `granular_lmp.crystal.lattices.packed` counts: rows from the middle one, columns from theirs
    wanted = -np.array([(counts[0] - 1) // 2, counts[1] // 2, 0])
    if np.any((lowest - wanted) % periods):
        return None
    found = (numbers - lowest) % counts
    places = np.zeros(counts, dtype=np.int64)
    np.add.at(places, tuple(found.T), 1)
    empty = np.argwhere(places == 0)
    if places.max() > 1 or len(empty) > _MOST_EMPTY * places.size:
        return None
    return found, empty


def _distance(lattice: Lattice, strained: Floats, periodic: NDArray[np.bool_], most: float) -> float:
    """Return the distance of touching spheres in a lattice that an affine map only scales; refuse other maps.

    Along periodic axes the box gives this distance; without any, it is the mean over all axes.
    """
    axes = _axes(lattice)
    left, stretches, right = np.linalg.svd(strained[:, axes], full_matrices=False)
    whole = float(np.mean(np.diag(strained)[periodic]) if periodic.any() else np.prod(stretches) ** (1 / len(axes)))
    turned = float(np.abs(left @ right - np.eye(3)[:, axes]).max())
    if turned > most:
        raise SceneError(
            f"the spheres are {_words(lattice)} that is turned by {np.degrees(np.arcsin(turned)):.4g} degrees; a scene "
            "has its rows along an axis of the box"
        )
    part = strained[axes][:, axes] / whole - np.eye(len(axes))
    symmetric = (part + part.T) / 2
    if np.abs(symmetric).max() > most:
        along = ", ".join(f"{'xyz'[axis]} {value:+.2e}" for axis, value in zip(axes, np.diag(symmetric), strict=True))
        shear = float(np.abs(symmetric - np.diag(np.diag(symmetric))).max())
        raise SceneError(
            f"the spheres are {_words(lattice)} that is strained: along the axes of a scene {along}, sheared by "
            f"{shear:.2e}; the contacts of a scene are alike in all directions"
        )
    return whole


def _words(lattice: Lattice) -> str:
    return f"the {lattice.name} lattice" if lattice.sheet else "a chain"


def _turned(places: Floats, apart: float, wide: NDArray[np.bool_]) -> str:
    """Return the message that spheres are in no lattice, or that the rows of their plane are not along an axis."""
    from scipy.spatial import cKDTree  # kept out of start-up

    said = "the spheres are in none of the lattices of a scene"
    if wide.sum() != 2:
        return said
    one, other = np.flatnonzero(wide)
    middle = int(np.argmin(np.linalg.norm(places - places.mean(axis=0), axis=1)))
    (_, near) = cKDTree(places).query(places[middle], 2)[1]
    way = (places[near] - places[middle])[[one, other]]
    angle = float(np.arctan2(way[1], way[0]))
    back = np.eye(3)
    back[np.ix_([one, other], [one, other])] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    turned, free = places @ back.T, np.zeros(3, dtype=bool)
    for lattice in LATTICES.values():
        for turn in _turns(wide) if _dimension(lattice) == 2 else ():
            try:
                if any(True for _ in _indexed(lattice, turn, turned @ turn.T, apart, np.zeros(3), free, 1.0)):
                    off = abs((np.degrees(angle) + 45) % 90 - 45)
                    return (
                        f"the spheres are the {lattice.name} lattice with rows at {off:.4g} degrees to an axis of the "
                        "box; a scene has its rows along an axis"
                    )
            except SceneError:
                continue
    return said
