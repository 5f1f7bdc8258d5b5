"""Lattices of equal touching spheres at rest, as `ase.Atoms`: the unit cell and the packing of each.

**Lengths are in radii R**: ASE, which thinks in Å and draws cells in steps of a fraction of one, then shows spheres of
5 mm as well as of 50 nm. Touching spheres are a lattice constant a = 2R − Δ0 apart.

Rows along x are stacked along y. A `Lattice` holds how, and the places of the spheres of its cell: what is `HEXAGONAL`,
`SQUARE` or `CHAIN` is known here and, for directions other than y in the hexagonal lattice, in
`granular_lmp.crystal.wavevector`. Others ask it for distances, wave vectors and `offsets`.
"""

from dataclasses import dataclass
from functools import cache
from math import pi, sqrt
from typing import Any

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import Contacts, find_contacts
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.wavevector import EDGES, ROW_SPACING, WaveVector, zone_edge

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
_SAME_LATTICE = 1e-9  # relative: rounding of a lattice constant is far below it
_BESIDE_CHAIN = 2.0  # radii from the centre of a chain to the faces of its box, which no other sphere is behind


@dataclass(frozen=True)
class Lattice:
    """Geometry of a lattice whose rows are alike; the spheres of a cell lie in one row, one column each.

    A row need not be straight: that of a honeycomb is a zigzag of two spheres a cell, each lower than the one before by
    a third of the distance of the rows or higher by as much.

    Attributes
    ----------
    name : str
        Value of ``packing.lattice``.
    row_spacing : float
        Distance of the rows along y, in distances of columns.
    shift : float
        Shift of the cells of every other row along x, columns.
    sheet : bool
        True if the spheres of a row touch; False if each row is one sphere.
    corners : tuple of (kx, ky)
        Γ and corners of the Brillouin zone, rad per column. The highest frequency of a lattice of one sphere a cell
        lies on the edges between them.
    column_spacing : float
        Distance of the columns along x, in that of two spheres that touch.
    places : tuple of (x, y)
        Places of the spheres of a cell, column by column: x in columns, y in rows. The first is (0, 0).
    collapses : bool
        True if it resists no shear without friction: spheres that press on each other would leave their places.
    """

    name: str
    row_spacing: float
    shift: float
    sheet: bool
    corners: tuple[tuple[float, float], ...]
    column_spacing: float = 1.0
    places: tuple[tuple[float, float], ...] = ((0.0, 0.0),)
    collapses: bool = False

    @property
    def column_period(self) -> int:
        """Number of columns after which they repeat, the spheres of a cell: a packing has a multiple of it."""
        return len(self.places)

    def zone_edge(self, direction: float) -> float:
        """Return the ξ at which the zone ends in a direction (degrees): a hexagon, a square where no row is shifted."""
        return zone_edge(direction, EDGES if self.shift else (0.0, 90.0))

    @property
    def fewest_columns(self) -> int:
        """Fewest columns between periodic sides that LAMMPS simulates correctly.

        With 1 or 2 columns of a periodic row a sphere touches two images of the same neighbour, and LAMMPS, which finds
        the shear of a contact by the neighbour's tag, mixes up the shear of both.
        """
        return 3 + -3 % self.column_period if self.sheet else 1

    @property
    def row_period(self) -> int:
        """Number of rows after which they repeat: a periodic cell has a multiple of it."""
        return 2 if self.shift else 1

    def column_distance(self, touching: float) -> float:
        """Return the distance of the columns where spheres that touch are `touching` apart, in its unit."""
        return touching * self.column_spacing

    def row_distance(self, touching: float) -> float:
        """Return the distance of the rows where spheres that touch are `touching` apart, in its unit."""
        return self.column_distance(touching) * self.row_spacing

    def vector(self, wavenumber: float, direction: float = 90.0) -> WaveVector:
        """Return the wave vector with ξ (rad per row) and a direction in degrees from x towards y."""
        return WaveVector.of(wavenumber, direction, self.row_spacing, self.column_spacing)

    def place(self, row: Integers, column: Integers) -> Integers:
        """Return which sphere of its cell each is, counted from 0, by row and column from the first of a cell."""
        return np.asarray((column - int(self.shift) * (row % 2)) % self.column_period)

    def offsets(self, row: Integers, column: Integers) -> tuple[Floats, Floats]:
        """Return places relative to column 0 of row 0, the first of its cell: along x in columns, along y in rows.

        A shift by whole columns leaves the numbers of the columns where they are, and shifts the cells.
        """
        x, y = np.array(self.places).T
        begun, place = column - int(self.shift) * (row % 2), self.place(row, column)
        return begun - place + x[place] + self.shift * (row % 2), row + y[place]


HEXAGONAL = Lattice("hexagonal", ROW_SPACING, 0.5, True, ((0.0, 0.0), (pi, pi / sqrt(3)), (4 * pi / 3, 0.0)))
SQUARE = Lattice("square", 1.0, 0.0, True, ((0.0, 0.0), (0.0, pi), (pi, pi)), collapses=True)
CHAIN = Lattice("chain", 1.0, 0.0, False, ((0.0, 0.0), (0.0, pi)))
# Rows are zigzags, 3/2 of a contact apart
HONEYCOMB = Lattice(
    "honeycomb",
    sqrt(3),
    1.0,
    True,
    ((0.0, 0.0), (pi / 2, sqrt(3) * pi / 6), (2 * pi / 3, 0.0)),
    column_spacing=sqrt(3) / 2,
    places=((0.0, 0.0), (1.0, -1 / 3)),
    collapses=True,
)
LATTICES = {each.name: each for each in (HEXAGONAL, SQUARE, CHAIN, HONEYCOMB)}


HELD, FREE, PERIODIC, WALL = "held", "free", "periodic", "wall"  # what a face of a packing is


@dataclass(frozen=True)
class Shape:
    """Rows and columns of a packing, its lattice, and its faces.

    Attributes
    ----------
    rows, columns : int
    ends : "fixed" or "periodic"
        Whether the packing ends along y.
    lattice : Lattice
    first, last : "held" or "free"
        The first and the last row where it ends.
    sides : "periodic", "held" or "free"
        The first and the last column of a sheet; a chain has none.
    """

    rows: int
    columns: int
    ends: str
    lattice: Lattice = HEXAGONAL
    first: str = HELD
    last: str = HELD
    sides: str = PERIODIC

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
        """What each face is, by "first", "last" and "sides"; without those across which the packing is periodic."""
        along_y = {} if self.along_y else {"first": self.first, "last": self.last}
        return along_y | ({"sides": self.sides} if self.lattice.sheet and not self.along_x else {})

    @property
    def free(self) -> tuple[str, ...]:
        """The faces that are free."""
        return tuple(name for name, face in self.faces.items() if face == FREE)

    @property
    def infinite(self) -> bool:
        """True if held ends alone cut the lattice off, so that it is the infinite one until their echo."""
        return not self.free and "sides" not in self.faces

    @property
    def cut(self) -> str:
        """The faces in words: "fixed ends", "periodic ends, sides free", "first row free, last row held"."""
        rows = [f"first row {self.first}", f"last row {self.last}"]
        held = FREE not in (self.faces.get("first"), self.faces.get("last"))
        sides = [f"sides {self.sides}"] if "sides" in self.faces else []
        return ", ".join(([f"{self.ends} ends"] if held else rows) + sides)

    @property
    def edge(self) -> str:
        """Name of what sends waves back: "walls" where nothing is free, else "faces"."""
        return "faces" if self.free else "walls"

    def holds(self, row: Any, column: Any) -> Any:
        """Return whether spheres are held, by row and column: numbers or arrays."""
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
        return self.rows * self.columns

    @property
    def words(self) -> str:
        """Rows and columns in words, and the lattice unless it is hexagonal."""
        if self.lattice == CHAIN:
            return f"a chain of {self.rows} rows"
        square = " of a square lattice" if self.lattice == SQUARE else ""
        return f"{self.rows} rows x {self.columns} column{'s' * (self.columns != 1)}{square}"


def lattice_constant(sphere: Sphere) -> float:
    """Return the distance a = 2 − Δ0/R of two spheres that touch, the constant of a lattice of one a cell, in radii."""
    return sphere.lattice_constant / sphere.radius


# --- unit cells ------------------------------------------------------------------------------------------------------


def unit_cell(sphere: Sphere, lattice: Lattice = HEXAGONAL) -> ase.Atoms:
    """Return the primitive cell of a lattice, periodic along y and, unless it is a chain, along x."""
    a, across, count = lattice_constant(sphere), lattice.sheet, lattice.column_period
    column, row = lattice.column_distance(a), lattice.row_distance(a)
    vectors = [[count * column if across else 2, 0, 0], [lattice.shift * column, row, 0], [0, 0, 2]]
    positions = [[x * column, y * row, 0] for x, y in lattice.places]
    cell = ase.Atoms(f"X{count}", positions=positions, cell=vectors, pbc=[across, True, False])
    cell.set_array("radius", np.ones(count))
    return cell


@cache
def unit_lattice(sphere: Sphere, lattice: Lattice = HEXAGONAL) -> Contacts:
    """Return the contacts of the spheres of one cell of an infinite lattice.

    The one sphere of a cell touches images of itself opposite to each other, which are one contact: three in the
    hexagonal lattice, two in the square one, one in a chain.
    """
    return find_contacts(unit_cell(sphere, lattice), [sphere], sphere.contact_force)


def lattice_of_contacts(contacts: Contacts, sphere: Sphere) -> Lattice:
    """Return the lattice whose contacts these are, as `unit_lattice` returns them.

    Raises
    ------
    ValueError
        If the contacts are those of no lattice of the sphere.
    """
    for lattice in LATTICES.values():
        known = unit_lattice(sphere, lattice).vector
        if contacts.vector.shape == known.shape and np.allclose(
            contacts.vector, known, rtol=0, atol=_SAME_LATTICE * sphere.lattice_constant
        ):
            return lattice
    raise ValueError(
        f"{len(contacts)} contacts: not those of the sphere's {', '.join(LATTICES)} lattice; see `unit_lattice`"
    )


# --- the packing -----------------------------------------------------------------------------------------------------


def packed(sphere: Sphere, shape: Shape) -> ase.Atoms:
    """Return the packing at rest.

    Parameters
    ----------
    sphere : Sphere
        Gives radius and lattice constant.
    shape : Shape
        Rows, columns, faces and lattice: any number of rows between fixed ends, in a periodic cell a multiple of
        `Lattice.row_period`; columns a multiple of `Lattice.column_period`.

    Returns
    -------
    ase.Atoms
        One entry ("X") per sphere, row by row, positions in radii, periodic as the shape is. ``info`` holds ``rows``,
        ``columns`` and ``lattice_name``, also after spheres are left out.
        Arrays: ``row`` and ``column`` (counted from 0), ``fixed`` (True on held faces), ``radius`` (1).
        The centre sphere lies next to the origin, where coordinates have the finest resolution. No sphere is on a
        periodic face: columns are shifted by a quarter of their distance, rows by half a row.

    Notes
    -----
    ASE draws it (``ase.visualize.view``) and writes it to its own formats.
    """
    lattice = shape.lattice
    a, spacing = lattice_constant(sphere), lattice.row_distance(lattice_constant(sphere))
    row, column = (index.ravel() for index in np.indices((shape.rows, shape.columns)))
    along_x, along_y = _offsets(row, column, shape)
    step = lattice.column_distance(a)
    if shape.along_x:
        x, left, width = (along_x + 0.25) * step, -(shape.columns // 2) * step, shape.columns * step
    else:
        x, beside = along_x * step, 1.0 if lattice.sheet else _BESIDE_CHAIN
        left, width = x.min() - beside, np.ptp(x) + 2 * beside
    y = along_y * spacing
    periodic = shape.along_y
    low, high = (edge(place for _, place in lattice.places) * spacing for edge in (min, max))
    # Half a row below the first row when periodic; a radius of air beyond the held rows otherwise.
    below, above = (0.5 * spacing, -0.5 * spacing) if periodic else (1.0 - low, 1.0 + high)
    bottom = -shape.centre_row * spacing - below
    rows = shape.rows if periodic else shape.rows - 1
    height = rows * lattice.row_spacing * lattice.column_distance(a) + (below + above)
    packing = ase.Atoms(
        numbers=np.zeros(len(row), dtype=int),
        positions=np.column_stack([x, y, np.zeros_like(x)]),
        cell=[width, height, 2.0],
        celldisp=[left, bottom, -1.0],
        pbc=[shape.along_x, periodic, False],
        info={"rows": shape.rows, "columns": shape.columns, "lattice_name": lattice.name},
    )
    packing.set_array("row", row)
    packing.set_array("column", column)
    packing.set_array("fixed", shape.holds(row, column))
    packing.set_array("radius", np.ones(len(row)))
    return packing


def offsets(packing: ase.Atoms) -> tuple[Floats, Floats]:
    """Return the places relative to the centre sphere: along x in columns, (N,), and along y in rows, (N,)."""
    return _offsets(packing.arrays["row"], packing.arrays["column"], _shape_of(packing))


def places(packing: ase.Atoms) -> Integers:
    """Return which sphere of its cell each is, (N,), counted from 0; the centre sphere is the first of its own."""
    shape = _shape_of(packing)
    return shape.lattice.place(packing.arrays["row"] - shape.centre_row, packing.arrays["column"] - shape.columns // 2)


def _offsets(row: Integers, column: Integers, shape: Shape) -> tuple[Floats, Floats]:
    return shape.lattice.offsets(row - shape.centre_row, column - shape.columns // 2)


def _shape_of(packing: ase.Atoms) -> Shape:
    ends = "periodic" if packing.pbc[1] else "fixed"
    return Shape(packing.info["rows"], packing.info["columns"], ends, LATTICES[packing.info["lattice_name"]])


def centre(packing: ase.Atoms) -> int:
    """Return the index of the centre sphere: row (rows−1)//2, column columns//2."""
    shape = _shape_of(packing)
    in_row, in_column = packing.arrays["row"] == shape.centre_row, packing.arrays["column"] == shape.columns // 2
    (index,) = np.flatnonzero(in_row & in_column)
    return int(index)
