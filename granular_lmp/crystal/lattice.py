"""Geometry of the lattices: stacking of rows along y and of layers along z, by tables of shifts.

The sphere (row, column, layer) sits at (column + sx, row + sy, layer + sz) in distances of columns, rows and layers.
`Lattice.stacking` has the shift s of each row and layer in a period. A crystal in space is a stack of equal layers:

=========  ==========  ============================================  =================
lattice    along y     rows across y                                 layers across z
=========  ==========  ============================================  =================
cubic      [001]       square layers                                 square layers
fcc        [001]       square layers, AB                             (110) planes
fcc        [111]       close-packed layers, ABC                      (11-2) planes
fcc        [110]       (110) planes                                  square layers, AB
fcc        [11-2]      (11-2) planes                                 close-packed layers, ABC
hcp        c           close-packed layers, AB                       (1-100) planes
hcp        [1-100]     (1-100) planes                                close-packed layers, AB
=========  ==========  ============================================  =================

Films on a substrate use the last two orientations of fcc and the last of hcp.
"""

from collections.abc import Sequence
from dataclasses import field, replace
from itertools import product
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.stiffnesses import Pair
from granular_lmp.crystal.wavevector import EDGES, ROW_SPACING, WaveVector, zone_edge
from granular_lmp.frozen import cached_property, dataclass

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Shift = tuple[float, float, float]
_STRAIGHT = (((0.0, 0.0, 0.0),),)
FASTEST_IN_PLANE = 0.5
_KAPPA = (0.0, 4 / 3)  # least and largest ratio of the stiffnesses of a material
_TOUCHES = 1e-6
_REACH = 2  # largest multiple of each primitive reciprocal vector in a search


@dataclass(frozen=True)
class Lattice:
    """Geometry of a lattice with equal rows.

    Rows need not be straight: a row of a honeycomb is a zigzag with two spheres per cell, whose heights alternate by a
    third of the distance of the rows.

    Attributes
    ----------
    name : str
        Value of ``packing.lattice``; for a lattice in space with its orientation, as in "fcc [001]".
    row_spacing : float
        Distance of the rows along y, in distances of columns.
    sheet : bool
        True if the spheres of a row touch; False if each row is one sphere.
    stacking : tuple of tuples of (x, y, z)
        Shifts in columns, rows and layers: for each row of a period, the shift in each layer of a period.
    corners : tuple of (kx, ky)
        Γ and corners of the Brillouin zone in the plane, rad per column. For a lattice in the plane with one sphere per
        cell, the highest frequency lies on the edges between them.
    column_spacing : float
        Distance of the columns along x, in distances of two touching spheres.
    places : tuple of (x, y)
        Places of the spheres of a cell in one row, column by column: x in columns, y in rows. The first is (0, 0).
    collapses : bool
        True if the lattice has straight lines of contacts that resist no shear without friction: unequal spheres would
        press each other out of them. A honeycomb has so few contacts that each can come to rest alone.
    layer_spacing : float
        Distance of the layers along z, in distances of columns; 0 for a lattice of one layer.
    cell_rows, cell_layers : int
        Rows and layers of a primitive cell.
    film : bool
        True if the cell contains all layers, and the first and the last layer are free or on a wall.
    densities : tuple of float
        Densities of the rows of a cell, kg/m³, if rows differ in a pattern; otherwise ().
    kinds, pairs : tuple of int, tuple of Pair
        Kinds of these rows, and measured stiffnesses between two kinds.
    ratio : float or None
        κ = g/k of contacts whose waves are faster than in solid spheres; it is not part of the geometry.
    """

    name: str
    row_spacing: float
    sheet: bool
    stacking: tuple[tuple[Shift, ...], ...]
    corners: tuple[tuple[float, float], ...] = ()
    column_spacing: float = 1.0
    places: tuple[tuple[float, float], ...] = ((0.0, 0.0),)
    collapses: bool = False
    layer_spacing: float = 0.0
    cell_rows: int = 1
    cell_layers: int = 1
    film: bool = False
    densities: tuple[float, ...] = ()
    kinds: tuple[int, ...] = ()
    pairs: tuple[Pair, ...] = ()
    ratio: float | None = field(default=None, compare=False)

    @property
    def solid(self) -> bool:
        """True for a lattice in space, which may have several layers."""
        return self.layer_spacing > 0

    @property
    def shift(self) -> float:
        """Shift of the second row along x, columns."""
        return self.stacking[1 % self.row_period][0][0]

    @property
    def column_period(self) -> int:
        """Number of columns after which the columns repeat: a packing has a multiple of it."""
        return len(self.places)

    @property
    def row_period(self) -> int:
        """Number of rows after which the rows repeat: a periodic cell has a multiple of it."""
        return len(self.stacking)

    @property
    def layer_period(self) -> int:
        """Number of layers after which the layers repeat: a periodic cell has a multiple of it."""
        return len(self.stacking[0])

    @property
    def cell_size(self) -> int:
        """Number of spheres in a primitive cell."""
        return self.column_period * self.cell_rows * self.cell_layers

    def layered(self, layers: int) -> "Lattice":
        """Return the lattice of a film with this number of layers; rows that are shifted along z stay in one cell."""
        rows = self.row_period if self.highest_shift(2) else self.cell_rows
        return replace(self, cell_rows=rows, cell_layers=layers, film=True)

    def patterned(self, densities: Sequence[float], kinds: Sequence[int] = (), pairs: Sequence[Pair] = ()) -> "Lattice":
        """Return the one-layer lattice whose cell has one row for each of these densities and kinds, in this order."""
        return replace(
            self, cell_rows=len(densities), densities=tuple(densities), kinds=tuple(kinds), pairs=tuple(pairs)
        )

    def zone_edge(self, direction: float) -> float:
        """Return ξ at the edge of the zone in a direction (degrees); in the plane the zone is a hexagon, or a square.

        The zone of a lattice in the plane is a square if its rows are not shifted.
        """
        if not self.solid:
            return zone_edge(direction, EDGES if self.shift else (0.0, 90.0))
        points = self.reciprocal_points()
        ahead = points[:, :2] @ self.vector(1.0, direction).components
        before = ahead > 1e-9
        return float(np.min(np.sum(points[before] ** 2, axis=1) / (2 * ahead[before])))

    def reciprocal(self) -> Floats:
        """Return the primitive reciprocal vectors as rows, in 1/distance of touching spheres."""
        count = 2 if self.film or not self.solid else 3
        return np.asarray(2 * np.pi * np.linalg.inv(self.cell(1.0)[:count, :count]).T)

    def reciprocal_points(self) -> Floats:
        """Return the points of the reciprocal lattice around 0, (P, 2 or 3)."""
        vectors = self.reciprocal()
        steps = product(range(-_REACH, _REACH + 1), repeat=len(vectors))
        return np.array([step for step in steps if any(step)]) @ vectors

    @cached_property
    def fastest(self) -> float:
        """Upper bound of the speed of waves in the plane of wave vectors, rows per τ; ½ for lattices of one layer.

        A long L wave runs 0.5 rows per τ in a hexagonal sheet, and 0.41 in the other sheets. In space the bound is
        c² = Σ (k n² + g (1 − n²)) d²/2m over the contacts of a sphere, with components n and d along the wave, for the
        fastest direction and the worst κ = g/k of a material. For a larger `ratio` transverse waves are faster: the
        bound is then the speed for spheres that do not turn, which in the plane is √((1 + 3κ)/(3 + κ)) times as much.
        """
        if not self.solid:
            return FASTEST_IN_PLANE * sqrt(1.0 if self.ratio is None else (1 + 3 * self.ratio) / (3 + self.ratio))
        index = np.indices((5, 5, 5)).reshape(3, -1) - 2
        spacings = np.array([1.0, self.row_spacing, self.layer_spacing])
        vectors = np.array(self.offsets(*index[[1, 0, 2]])).T * spacings
        bonds = vectors[np.abs(np.linalg.norm(vectors, axis=1) - 1) < _TOUCHES]
        angle = np.radians(np.arange(0, 180, 5))
        squares = (bonds[:, :2] @ np.array([np.cos(angle), np.sin(angle)])) ** 2
        if self.ratio is not None:
            across = self.ratio * np.eye(3) + (1 - self.ratio) * bonds[:, :, None] * bonds[:, None]
            bound = np.linalg.eigvalsh(np.einsum("ba,bij->aij", squares, across)).max() / (4 * (3 + self.ratio))
            return sqrt(bound) / self.row_spacing
        per_kappa = [np.sum((squares + kappa * (1 - squares)) * squares, axis=0) / 2 for kappa in _KAPPA]
        bound = max(float(np.max(sums)) / (2 * (3 + kappa)) for sums, kappa in zip(per_kappa, _KAPPA, strict=True))
        return sqrt(bound) / self.row_spacing

    @property
    def fewest_columns(self) -> int:
        """Least number of columns between periodic sides that LAMMPS simulates correctly.

        With 1 or 2 columns in a periodic row, a sphere touches two images of the same neighbour. LAMMPS finds the shear
        of a contact by the tag of the neighbour, and confuses the shear of the two contacts.
        """
        return 3 + -3 % self.column_period if self.sheet else 1

    @property
    def fewest_rows(self) -> int:
        """Least number of rows of a sheet that is periodic along y, for the same reason as `fewest_columns`."""
        return 3 + -3 % self.row_period

    @property
    def fewest_layers(self) -> int:
        """Least number of layers of a crystal that is periodic along z, for the same reason as `fewest_columns`."""
        return 3 + -3 % self.layer_period

    def column_distance(self, touching: float) -> float:
        """Return the distance of the columns, in the unit of `touching`, the distance of touching spheres."""
        return touching * self.column_spacing

    def row_distance(self, touching: float) -> float:
        """Return the distance of the rows, in the unit of `touching`, the distance of touching spheres."""
        return self.column_distance(touching) * self.row_spacing

    def layer_distance(self, touching: float) -> float:
        """Return the distance of the layers, in the unit of `touching`, the distance of touching spheres."""
        return self.column_distance(touching) * self.layer_spacing

    def vector(self, wavenumber: float, direction: float = 90.0) -> WaveVector:
        """Return the wave vector with ξ (rad per row) and a direction in degrees from x towards y."""
        return WaveVector.of(wavenumber, direction, self.row_spacing, self.column_spacing)

    def place(self, row: Integers, column: Integers, layer: Integers | int = 0) -> Integers:
        """Return the index of each sphere in its primitive cell, from 0, by row, column and layer."""
        in_row = (column - self._shifts(row, layer)[0].astype(int)) % self.column_period
        return np.asarray(
            (in_row * self.cell_rows + row % self.cell_rows) * self.cell_layers + layer % self.cell_layers
        )

    def offsets(self, row: Integers, column: Integers, layer: Integers | int = 0) -> tuple[Floats, Floats, Floats]:
        """Return places relative to the first sphere of the cell at row 0, column 0, layer 0, in columns, rows, layers.

        A shift by whole columns does not change the numbers of the columns; it shifts the cells.
        """
        x, y = np.array(self.places).T
        along_x, along_y, along_z = self._shifts(row, layer)
        begun = column - along_x.astype(int)
        place = begun % self.column_period
        return begun - place + x[place] + along_x, row + y[place] + along_y, layer + along_z

    def _shifts(self, row: Integers, layer: Integers | int) -> Floats:
        """Return the shifts along x, y and z by row and layer, (3, ...)."""
        return np.moveaxis(np.array(self.stacking)[row % self.row_period, layer % self.layer_period], -1, 0)

    def highest_shift(self, axis: int) -> float:
        """Return the largest shift along an axis, 1 for y or 2 for z."""
        return max(shift[axis] for row in self.stacking for shift in row)

    def cell(self, touching: float) -> Floats:
        """Return the primitive vectors as rows, (3, 3), in the unit of `touching`, the distance of touching spheres.

        For a lattice of one layer and for a film, the vector along z has the length 2. For a chain, the vector along x
        has the length 2.
        """
        steps = [(self.column_period, 0, 0), (0, self.cell_rows, 0), (0, 0, self.cell_layers)]
        shifts = [self.stacking[row % self.row_period][layer % self.layer_period] for _, row, layer in steps]
        spacings = [self.column_distance(touching), self.row_distance(touching), self.layer_distance(touching)]
        vectors = (np.array(steps) + np.array(shifts)) * spacings
        if not self.solid or self.film:
            vectors[2] = [0.0, 0.0, 2.0]
        if not self.sheet:
            vectors[0] = [2.0, 0.0, 0.0]
        return np.asarray(vectors)


def _rows(*along_x: float) -> tuple[tuple[Shift, ...], ...]:
    """Return the stacking of rows in the plane, from their shifts along x."""
    return tuple(((x, 0.0, 0.0),) for x in along_x)


HEXAGONAL = Lattice(
    "hexagonal", ROW_SPACING, True, _rows(0.0, 0.5), ((0.0, 0.0), (pi, pi / sqrt(3)), (4 * pi / 3, 0.0))
)
SQUARE = Lattice("square", 1.0, True, _STRAIGHT, ((0.0, 0.0), (0.0, pi), (pi, pi)), collapses=True)
CHAIN = Lattice("chain", 1.0, False, _STRAIGHT, ((0.0, 0.0), (0.0, pi)))
# Rows are zigzags, 3/2 of a contact apart
HONEYCOMB = Lattice(
    "honeycomb",
    sqrt(3),
    True,
    _rows(0.0, 1.0),
    ((0.0, 0.0), (pi / 2, sqrt(3) * pi / 6), (2 * pi / 3, 0.0)),
    column_spacing=sqrt(3) / 2,
    places=((0.0, 0.0), (1.0, -1 / 3)),
)
# Close-packed layers: A, B, C by column and by a third of the rows of the layer
_ABC = ((0.0, 0.0), (0.5, 1 / 3), (0.0, 2 / 3))


def _close_packed(layers: int, axis: int) -> tuple[tuple[Shift, ...], ...]:
    """Return the stacking of close-packed layers along y (axis 1) or z (axis 2), whose rows are shifted in turn."""

    def shift(layer: int, within: int) -> Shift:
        x, across = _ABC[layer]
        x += 0.5 * within
        return (x, 0.0, across) if axis == 1 else (x, across, 0.0)

    if axis == 1:
        return tuple(tuple(shift(layer, within) for within in range(2)) for layer in range(layers))
    return tuple(tuple(shift(layer, within) for layer in range(layers)) for within in range(2))


_HEIGHT = sqrt(2 / 3)  # distance of close-packed layers, in distances of touching spheres
_SQUARE_HEIGHT = sqrt(1 / 2)
IN_SPACE = (
    Lattice("cubic [001]", 1.0, True, _STRAIGHT, collapses=True, layer_spacing=1.0),
    Lattice("fcc [001]", _SQUARE_HEIGHT, True, (_STRAIGHT[0], ((0.5, 0.0, 0.5),)), layer_spacing=1.0),
    Lattice("fcc [111]", _HEIGHT, True, _close_packed(3, 1), layer_spacing=ROW_SPACING),
    Lattice("fcc [110]", 1.0, True, ((*_STRAIGHT[0], (0.5, 0.5, 0.0)),), layer_spacing=_SQUARE_HEIGHT),
    Lattice("fcc [11-2]", ROW_SPACING, True, _close_packed(3, 2), layer_spacing=_HEIGHT),
    Lattice("hcp c", _HEIGHT, True, _close_packed(2, 1), layer_spacing=ROW_SPACING, cell_rows=2),
    Lattice("hcp [1-100]", ROW_SPACING, True, _close_packed(2, 2), layer_spacing=_HEIGHT, cell_layers=2),
)
PLANE_LATTICES = {each.name: each for each in (HEXAGONAL, SQUARE, CHAIN, HONEYCOMB)}
LATTICES = PLANE_LATTICES | {each.name: each for each in IN_SPACE}
LATTICE_NAMES = (*PLANE_LATTICES, *dict.fromkeys(each.name.partition(" ")[0] for each in IN_SPACE))
ORIENTATIONS = tuple(dict.fromkeys(each.name.partition(" ")[2] for each in IN_SPACE))


def orientations_of(name: str) -> tuple[str, ...]:
    """Return the orientations of a lattice in space, the default first; () for a lattice of one layer."""
    return tuple(each.name.partition(" ")[2] for each in IN_SPACE if each.name.partition(" ")[0] == name)
