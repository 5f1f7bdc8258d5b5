"""Lattices of equal touching spheres at rest, as `ase.Atoms`: the unit cell and the packing of each.

**Lengths are in radii R**: ASE, which thinks in Å and draws cells in steps of a fraction of one, then shows spheres of
5 mm as well as of 50 nm. Touching spheres are a lattice constant a = 2R − Δ0 apart.

Rows along x are stacked along y. A `Lattice` holds how: what is `HEXAGONAL`, `SQUARE` or `CHAIN` is known here and, for
directions other than y in the hexagonal lattice, in `granular_lmp.crystal.wavevector`.
"""

from dataclasses import dataclass
from functools import cache
from math import pi, sqrt

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import Contacts, find_contacts
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.wavevector import ROW_SPACING

_SAME_LATTICE = 1e-9  # relative: rounding of a lattice constant is far below it
_BESIDE_CHAIN = 2.0  # radii from the centre of a chain to the faces of its box, which no other sphere is behind


@dataclass(frozen=True)
class Lattice:
    """Geometry of a lattice of one sphere a cell.

    Attributes
    ----------
    name : str
        Value of ``packing.lattice``.
    row_spacing : float
        Distance of the rows along y, lattice constants.
    shift : float
        Shift of every other row along x, lattice constants.
    endless_rows : bool
        True if the spheres of a row touch and rows are periodic; False if each row is one sphere.
    corners : tuple of (kx, ky)
        Γ and corners of the Brillouin zone, 1/a: the highest frequency lies on the edges between them.
    """

    name: str
    row_spacing: float
    shift: float
    endless_rows: bool
    corners: tuple[tuple[float, float], ...]

    @property
    def fewest_columns(self) -> int:
        """Fewest columns that LAMMPS simulates correctly.

        With 1 or 2 columns of a periodic row a sphere touches two images of the same neighbour, and LAMMPS, which finds
        the shear of a contact by the neighbour's tag, mixes up the shear of both.
        """
        return 3 if self.endless_rows else 1

    @property
    def row_period(self) -> int:
        """Number of rows after which they repeat: a periodic cell has a multiple of it."""
        return 2 if self.shift else 1


HEXAGONAL = Lattice("hexagonal", ROW_SPACING, 0.5, True, ((0.0, 0.0), (pi, pi / sqrt(3)), (4 * pi / 3, 0.0)))
SQUARE = Lattice("square", 1.0, 0.0, True, ((0.0, 0.0), (0.0, pi), (pi, pi)))
CHAIN = Lattice("chain", 1.0, 0.0, False, ((0.0, 0.0), (0.0, pi)))
LATTICES = {each.name: each for each in (HEXAGONAL, SQUARE, CHAIN)}


@dataclass(frozen=True)
class Shape:
    """Rows, columns and ends of a packing, and its lattice."""

    rows: int
    columns: int
    ends: str
    lattice: Lattice = HEXAGONAL

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
    """Return the lattice constant a = 2 − Δ0/R, in radii."""
    return sphere.lattice_constant / sphere.radius


# --- unit cells ------------------------------------------------------------------------------------------------------


def unit_cell(sphere: Sphere, lattice: Lattice = HEXAGONAL) -> ase.Atoms:
    """Return the primitive cell of a lattice: one sphere, periodic along y and, unless it is a chain, along x."""
    a, across = lattice_constant(sphere), lattice.endless_rows
    vectors = [[a if across else 2, 0, 0], [lattice.shift * a, lattice.row_spacing * a, 0], [0, 0, 2]]
    cell = ase.Atoms("X", positions=[[0, 0, 0]], cell=vectors, pbc=[across, True, False])
    cell.set_array("radius", np.ones(1))
    return cell


@cache
def unit_lattice(sphere: Sphere, lattice: Lattice = HEXAGONAL) -> Contacts:
    """Return the contacts of the one sphere of an infinite lattice, each with an image of itself.

    A sphere touches images opposite to each other, which are one contact: three in the hexagonal lattice, two in the
    square one, one in a chain.
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
        Rows, columns, ends and lattice: any number of rows between fixed ends, in a periodic cell a multiple of
        `Lattice.row_period`.

    Returns
    -------
    ase.Atoms
        One entry ("X") per sphere, row by row, positions in radii, periodic along x unless it is a chain, and along y
        with periodic ends. ``info`` holds ``rows``, ``columns`` and ``lattice_name``, also after spheres are left out.
        Arrays: ``row`` and ``column`` (counted from 0), ``fixed`` (True on the held rows), ``radius`` (1).
        The centre sphere lies next to the origin, where coordinates have the finest resolution. No sphere is on a
        periodic face: columns are shifted by a quarter of the lattice constant, rows by half a row.

    Notes
    -----
    ASE draws it (``ase.visualize.view``) and writes it to its own formats.
    """
    a, lattice = lattice_constant(sphere), shape.lattice
    row, column = (index.ravel() for index in np.indices((shape.rows, shape.columns)))
    along_x, n = _offsets(row, column, shape)
    if lattice.endless_rows:
        x, left, width = (along_x + 0.25) * a, -(shape.columns // 2) * a, shape.columns * a
    else:
        x, left, width = along_x * a, -_BESIDE_CHAIN, 2 * _BESIDE_CHAIN
    spacing = lattice.row_spacing * a
    y = n * spacing
    periodic = shape.ends == "periodic"
    # Half a row below the first row when periodic; a radius of air beyond the held rows otherwise.
    margin = 0.5 * spacing if periodic else 1.0
    bottom = -shape.centre_row * spacing - margin
    rows = shape.rows if periodic else shape.rows - 1
    height = rows * lattice.row_spacing * a + (0.0 if periodic else 2 * margin)
    packing = ase.Atoms(
        numbers=np.zeros(len(row), dtype=int),
        positions=np.column_stack([x, y, np.zeros_like(x)]),
        cell=[width, height, 2.0],
        celldisp=[left, bottom, -1.0],
        pbc=[lattice.endless_rows, periodic, False],
        info={"rows": shape.rows, "columns": shape.columns, "lattice_name": lattice.name},
    )
    packing.set_array("row", row)
    packing.set_array("column", column)
    packing.set_array("fixed", (row == 0) | (row == shape.rows - 1) if not periodic else np.zeros(len(row), dtype=bool))
    packing.set_array("radius", np.ones(len(row)))
    return packing


def offsets(packing: ase.Atoms) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the places relative to the centre sphere: along x in columns, (N,), and along y in rows, (N,)."""
    return _offsets(packing.arrays["row"], packing.arrays["column"], _shape_of(packing))


def _offsets(
    row: NDArray[np.int64], column: NDArray[np.int64], shape: Shape
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    n = row - shape.centre_row
    return column - shape.columns // 2 + shape.lattice.shift * (n % 2), n


def _shape_of(packing: ase.Atoms) -> Shape:
    ends = "periodic" if packing.pbc[1] else "fixed"
    return Shape(packing.info["rows"], packing.info["columns"], ends, LATTICES[packing.info["lattice_name"]])


def centre(packing: ase.Atoms) -> int:
    """Return the index of the centre sphere: row (rows−1)//2, column columns//2."""
    shape = _shape_of(packing)
    in_row, in_column = packing.arrays["row"] == shape.centre_row, packing.arrays["column"] == shape.columns // 2
    (index,) = np.flatnonzero(in_row & in_column)
    return int(index)
