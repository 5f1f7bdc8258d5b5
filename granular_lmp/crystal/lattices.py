"""Lattices of equal touching spheres at rest, as `ase.Atoms`: their unit cells and packings.

**Lengths are in radii R**, because ASE expects lengths of order 1: it then shows spheres of 5 mm as well as of 50 nm.
The distance of touching spheres is the lattice constant a = 2R − Δ0.

Rows along x are stacked along y. A `Lattice` has the stacking and the places of the spheres in its cell. Only this
module and, for directions other than y in the hexagonal lattice, `granular_lmp.crystal.wavevector` depend on the kind
of lattice; other code uses distances, wave vectors and `offsets`.
"""

from dataclasses import replace
from functools import cache
from typing import Any

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import FACTORS, Contacts, find_contacts
from granular_lmp.crystal.lattice import CHAIN as CHAIN
from granular_lmp.crystal.lattice import HEXAGONAL as HEXAGONAL
from granular_lmp.crystal.lattice import HONEYCOMB as HONEYCOMB
from granular_lmp.crystal.lattice import LATTICE_NAMES as LATTICE_NAMES
from granular_lmp.crystal.lattice import LATTICES as LATTICES
from granular_lmp.crystal.lattice import ORIENTATIONS as ORIENTATIONS
from granular_lmp.crystal.lattice import PLANE_LATTICES as PLANE_LATTICES
from granular_lmp.crystal.lattice import SQUARE as SQUARE
from granular_lmp.crystal.lattice import Lattice as Lattice
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.stiffnesses import factors_of
from granular_lmp.crystal.walls import Wall, on_wall
from granular_lmp.frozen import dataclass

__all__ = ["CHAIN", "Shape", "packed", "unit_cell"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
_SAME_LATTICE = 1e-9  # relative tolerance, far above the rounding of a lattice constant
_BESIDE_CHAIN = 2.0  # radii from the centre of a chain to the sides of its box, so that no image of a sphere is near


HELD, FREE, PERIODIC, WALL, QUIET = "held", "free", "periodic", "wall", "quiet"  # kinds of the faces of a packing
ENDS_OF_Y = ("first", "last")  # faces across y


@dataclass(frozen=True)
class Shape:
    """Rows and columns of a packing, its lattice, and its faces.

    Attributes
    ----------
    rows, columns : int
        Number of rows along y, and of columns along x.
    ends : "fixed" or "periodic"
        Whether the packing ends along y, or is periodic.
    lattice : Lattice
    first, last : "held", "free" or "wall"
        Kind of the first and the last row, if the packing ends.
    sides : "periodic", "held", "free" or "wall"
        Kind of the first and the last column of a sheet; a chain has no sides.
    layers : int
        Number of layers along z.
    """

    rows: int
    columns: int
    ends: str
    lattice: Lattice = HEXAGONAL
    first: str = HELD
    last: str = HELD
    sides: str = PERIODIC
    layers: int = 1

    @property
    def along_z(self) -> bool:
        """True if the packing is periodic along z."""
        return self.lattice.solid and not self.lattice.film

    @property
    def along_x(self) -> bool:
        """True if the packing is periodic along x."""
        return self.lattice.sheet and self.sides == PERIODIC

    @property
    def along_y(self) -> bool:
        """True if the packing is periodic along y."""
        return self.ends == PERIODIC

    @property
    def faces(self) -> dict[str, str]:
        """Kind of each face, by "first", "last" and "sides"; periodic faces are left out."""
        along_y = {} if self.along_y else {"first": self.first, "last": self.last}
        return along_y | ({"sides": self.sides} if self.lattice.sheet and not self.along_x else {})

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the free faces."""
        return tuple(name for name, face in self.faces.items() if face == FREE)

    @property
    def infinite(self) -> bool:
        """True if the only faces are held ends: until their echo arrives, waves are those of the infinite lattice."""
        return not self.free and "sides" not in self.faces

    @property
    def cut(self) -> str:
        """Description of the faces: "fixed ends", "periodic ends, sides free", "first row free, last row held"."""
        rows = [f"first row {self.first}", f"last row {self.last}"]
        held = not {FREE, WALL} & {self.faces.get("first"), self.faces.get("last")}
        sides = [f"sides {self.sides}"] if "sides" in self.faces else []
        return ", ".join(([f"{self.ends} ends"] if held else rows) + sides)

    @property
    def edge(self) -> str:
        """Word for the faces that reflect waves: "faces" if one is free, otherwise "walls"."""
        return "faces" if self.free else "walls"

    def holds(self, row: Any, column: Any) -> Any:
        """Return whether spheres are held, for rows and columns that are numbers or arrays."""
        at = {"first": row == 0, "last": row == self.rows - 1, "sides": (column == 0) | (column == self.columns - 1)}
        held = [at[name] for name, face in self.faces.items() if face == HELD]
        return np.logical_or.reduce([np.zeros(np.shape(row), dtype=bool), *held])

    @property
    def centre_row(self) -> int:
        """Row n = 0 of the wave, counted from 0."""
        return (self.rows - 1) // 2

    @property
    def spheres(self) -> int:
        """Number of spheres."""
        return self.rows * self.columns * self.layers

    @property
    def words(self) -> str:
        """Rows, columns and layers as text, with the lattice if it is square or a chain."""
        if self.lattice == CHAIN:
            return f"a chain of {self.rows} rows"
        square = " of a square lattice" if self.lattice == SQUARE else ""
        layers = f" x {self.layers} layer{'s' * (self.layers != 1)}" if self.lattice.solid else ""
        return f"{self.rows} rows x {self.columns} column{'s' * (self.columns != 1)}{layers}{square}"


def lattice_constant(sphere: Sphere) -> float:
    """Return the distance a = 2 − Δ0/R of two touching spheres, in radii."""
    return sphere.lattice_constant / sphere.radius


# --- unit cells ------------------------------------------------------------------------------------------------------


def unit_cell(sphere: Sphere, lattice: Lattice = HEXAGONAL) -> ase.Atoms:
    """Return the primitive cell of a lattice, periodic along y, along x except for a chain, and along z in the bulk."""
    a, count = lattice_constant(sphere), lattice.cell_size
    shape = np.indices((lattice.cell_rows, lattice.column_period, lattice.cell_layers))
    row, column, layer = (index.ravel() for index in shape)
    x, y, z = lattice.offsets(row, column, layer)
    places = np.column_stack(
        [x * lattice.column_distance(a), y * lattice.row_distance(a), z * lattice.layer_distance(a)]
    )
    positions = np.empty_like(places)
    positions[lattice.place(row, column, layer)] = places
    periodic = [lattice.sheet, True, lattice.solid and not lattice.film]
    cell = ase.Atoms(f"X{count}", positions=positions, cell=lattice.cell(a), pbc=periodic)
    cell.set_array("radius", np.ones(count))
    if lattice.densities:
        rows = row[np.argsort(lattice.place(row, column, layer))]
        cell.set_array("density", np.array(lattice.densities)[rows])
    if lattice.pairs:
        kinds, material = np.unique(lattice.kinds, return_inverse=True)
        cell.set_array("material", material[rows])
        radii = [sphere.radius] * (max(kinds) + 1)
        cell.info[FACTORS] = factors_of([sphere] * len(kinds), kinds.tolist(), radii, lattice.pairs)
    return cell


@cache
def unit_lattice(sphere: Sphere, lattice: Lattice = HEXAGONAL, wall: Wall | None = None) -> Contacts:
    """Return the contacts of the spheres of one cell of an infinite lattice, and of its outer layers with walls.

    In a cell of one sphere, the sphere touches pairs of opposite images of itself, and each pair counts as one contact:
    three in the hexagonal lattice, two in the square lattice, one in a chain.
    """
    cell = unit_cell(sphere, lattice)
    contacts = find_contacts(cell, [sphere] * max(1, len(set(lattice.kinds))), sphere.contact_force)
    if wall is None:
        return contacts
    for height in wall.heights:
        outside = height * cell.positions[:, 2]
        spheres = np.flatnonzero(outside > outside.max() - _SAME_LATTICE)
        contacts = on_wall(contacts, wall, spheres, np.full(len(spheres), wall.overlap), height * np.eye(3)[2])
    return contacts


def lattice_of_contacts(contacts: Contacts, sphere: Sphere) -> Lattice:
    """Return the lattice in the plane to which these contacts, a result of `unit_lattice`, belong.

    Raises
    ------
    ValueError
        If no lattice of the sphere has these contacts.
    """
    for lattice in PLANE_LATTICES.values():
        known = unit_lattice(sphere, lattice).vector
        if contacts.vector.shape == known.shape and np.allclose(
            contacts.vector, known, rtol=0, atol=_SAME_LATTICE * sphere.lattice_constant
        ):
            return lattice
    raise ValueError(
        f"{len(contacts)} contacts: belong to no {', '.join(PLANE_LATTICES)} lattice of this sphere; see `unit_lattice`"
    )


# --- the packing -----------------------------------------------------------------------------------------------------


def packed(sphere: Sphere, shape: Shape) -> ase.Atoms:
    """Return the packing at rest.

    Parameters
    ----------
    sphere : Sphere
        Sphere that sets the radius and the lattice constant.
    shape : Shape
        Rows, columns, faces and lattice. The number of rows is arbitrary between fixed ends, and a multiple of
        `Lattice.row_period` in a periodic cell; the number of columns is a multiple of `Lattice.column_period`.

    Returns
    -------
    ase.Atoms
        One entry ("X") per sphere, row by row, with positions in radii, and periodic as the shape is. ``info`` has
        ``rows``, ``columns`` and ``lattice_name``, which stay if spheres are left out.
        Arrays: ``row`` and ``column`` (counted from 0), ``fixed`` (True on held faces), ``radius`` (1).
        The centre sphere lies next to the origin, where coordinates have the finest resolution. No sphere is on a
        periodic face: columns are shifted by a quarter of their distance, rows by half a row.

    Notes
    -----
    ASE draws it (``ase.visualize.view``) and writes it to its own formats.
    """
    lattice = shape.lattice
    a, spacing = lattice_constant(sphere), lattice.row_distance(lattice_constant(sphere))
    indices = np.indices((shape.rows, shape.columns, shape.layers))
    row, column, layer = (index.ravel() for index in indices)
    along_x, along_y, along_z = _offsets(row, column, layer, shape)
    step = lattice.column_distance(a)
    if shape.along_x:
        x, left, width = (along_x + 0.25) * step, -(shape.columns // 2) * step, shape.columns * step
    else:
        x, beside = along_x * step, 1.0 if lattice.sheet else _BESIDE_CHAIN
        left, width = x.min() - beside, np.ptp(x) + 2 * beside
    y = along_y * spacing
    periodic = shape.along_y
    low, high = (edge(place for _, place in lattice.places) * spacing for edge in (min, max))
    shifted = lattice.highest_shift(1)
    # A periodic box begins half a row below the first row, less half of the largest shift; otherwise the box extends a
    # radius beyond the outer spheres
    half = (1 - shifted) / 2
    below, above = (half * spacing, -half * spacing) if periodic else (1.0 - low, 1.0 + high)
    bottom = -shape.centre_row * spacing - below
    rows = shape.rows if periodic else shape.rows - 1 + shifted
    height = rows * lattice.row_spacing * lattice.column_distance(a) + (below + above)
    z, (under, depth) = along_z * lattice.layer_distance(a), _depth(shape, a)
    packing = ase.Atoms(
        numbers=np.zeros(len(row), dtype=int),
        positions=np.column_stack([x, y, z]),
        cell=[width, height, depth],
        celldisp=[left, bottom, under],
        pbc=[shape.along_x, periodic, shape.along_z],
        info={"rows": shape.rows, "columns": shape.columns, "lattice_name": lattice.name},
    )
    packing.set_array("row", row)
    packing.set_array("column", column)
    if lattice.solid:
        packing.info["layers"] = shape.layers
        packing.set_array("layer", layer)
    packing.set_array("fixed", shape.holds(row, column))
    packing.set_array("radius", np.ones(len(row)))
    return packing


def _depth(shape: Shape, touching: float) -> tuple[float, float]:
    """Return the lower face of the box along z and its depth: a radius beyond the outer spheres unless periodic."""
    spacing, shifted = shape.lattice.layer_distance(touching), shape.lattice.highest_shift(2)
    if shape.along_z:
        return -(1 - shifted) / 2 * spacing, shape.layers * spacing
    return -1.0, (shape.layers - 1 + shifted) * spacing + 2.0


def offsets(packing: ase.Atoms) -> tuple[Floats, Floats]:
    """Return the places relative to the centre sphere: along x in columns, (N,), and along y in rows, (N,)."""
    return _offsets(*_indices(packing), _shape_of(packing))[:2]


def places(packing: ase.Atoms, size: int = 1) -> Integers:
    """Return the index of each sphere in its primitive cell, (N,), from 0; the centre sphere has index 0.

    If `size` exceeds the number of spheres in the primitive cell, the cell has this number of rows of a pattern
    (`Lattice.patterned`).
    """
    shape = _shape_of(packing)
    if size > shape.lattice.cell_size:
        shape = replace(shape, lattice=replace(shape.lattice, cell_rows=size))
    row, column, layer = _indices(packing)
    return shape.lattice.place(row - shape.centre_row, column - shape.columns // 2, layer)


def _indices(packing: ase.Atoms) -> tuple[Integers, Integers, Integers]:
    row, column = packing.arrays["row"], packing.arrays["column"]
    return row, column, packing.arrays.get("layer", np.zeros_like(row))


def _offsets(row: Integers, column: Integers, layer: Integers, shape: Shape) -> tuple[Floats, Floats, Floats]:
    return shape.lattice.offsets(row - shape.centre_row, column - shape.columns // 2, layer)


def _shape_of(packing: ase.Atoms) -> Shape:
    lattice, layers = LATTICES[packing.info["lattice_name"]], packing.info.get("layers", 1)
    if lattice.solid and not packing.pbc[2]:
        lattice = lattice.layered(layers)
    ends = "periodic" if packing.pbc[1] else "fixed"
    return Shape(packing.info["rows"], packing.info["columns"], ends, lattice, layers=layers)


def centre(packing: ase.Atoms) -> int:
    """Return the index of the centre sphere: row (rows−1)//2, column columns//2, the first layer."""
    shape, (row, column, layer) = _shape_of(packing), _indices(packing)
    (index,) = np.flatnonzero((row == shape.centre_row) & (column == shape.columns // 2) & (layer == 0))
    return int(index)
