"""Lattices of equal touching spheres at rest, as `ase.Atoms`: unit cells, and the hexagonal sheet.

**Lengths are in radii R**: ASE, which thinks in Å and draws cells in steps of a fraction of one, then shows spheres of
5 mm as well as of 50 nm. Touching spheres are a lattice constant a = 2R − Δ0 apart.

Only this module and `granular_lmp.crystal.wavevector` depend on the geometry of the hexagonal sheet: rows along x are
stacked along y, (√3/2) a apart, every other one shifted by a/2.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import Contacts, find_contacts
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.wavevector import ROW_SPACING


@dataclass(frozen=True)
class Shape:
    """Rows, columns and ends of a hexagonal sheet."""

    rows: int
    columns: int
    ends: str

    @property
    def centre_row(self) -> int:
        """Row n = 0 of the wave, counted from 0."""
        return (self.rows - 1) // 2

    @property
    def spheres(self) -> int:
        """Number of spheres."""
        return self.rows * self.columns


def lattice_constant(sphere: Sphere) -> float:
    """Return the lattice constant a = 2 − Δ0/R, in radii."""
    return sphere.lattice_constant / sphere.radius


# --- unit cells ------------------------------------------------------------------------------------------------------


def hexagonal_cell(sphere: Sphere) -> ase.Atoms:
    """Return the primitive cell of the hexagonal sheet: one sphere, periodic along x and at 60° to it."""
    a = lattice_constant(sphere)
    return _cell([[a, 0, 0], [a / 2, ROW_SPACING * a, 0], [0, 0, 2]], [True, True, False])


def square_cell(sphere: Sphere) -> ase.Atoms:
    """Return the primitive cell of the square sheet: one sphere, periodic along x and y."""
    a = lattice_constant(sphere)
    return _cell([[a, 0, 0], [0, a, 0], [0, 0, 2]], [True, True, False])


def chain_cell(sphere: Sphere) -> ase.Atoms:
    """Return the primitive cell of a straight chain: one sphere, periodic along y."""
    return _cell([[2, 0, 0], [0, lattice_constant(sphere), 0], [0, 0, 2]], [False, True, False])


def _cell(vectors: Sequence[Sequence[float]], periodic: Sequence[bool]) -> ase.Atoms:
    cell = ase.Atoms("X", positions=[[0, 0, 0]], cell=vectors, pbc=periodic)
    cell.set_array("radius", np.ones(1))
    return cell


@cache
def unit_lattice(sphere: Sphere) -> Contacts:
    """Return the contacts of the infinite hexagonal lattice: three of its one sphere, each with an image of itself.

    A sphere touches six images; those opposite to each other are one contact.
    """
    return find_contacts(hexagonal_cell(sphere), [sphere], sphere.contact_force)


# --- the hexagonal sheet ---------------------------------------------------------------------------------------------


def hexagonal(sphere: Sphere, shape: Shape) -> ase.Atoms:
    """Return the sheet at rest.

    Parameters
    ----------
    sphere : Sphere
        Gives radius and lattice constant.
    shape : Shape
        Rows, columns and ends: any number of rows between fixed ends, an even one in a periodic cell.

    Returns
    -------
    ase.Atoms
        One entry ("X") per sphere, row by row, positions in radii, periodic along x, and along y with periodic ends.
        Arrays: ``row`` and ``column`` (counted from 0), ``fixed`` (True on the held rows), ``radius`` (1).
        The centre sphere lies next to the origin, where coordinates have the finest resolution. No sphere is on a
        periodic face: columns are shifted by a quarter of the lattice constant, rows by half a row.

    Notes
    -----
    ASE draws it (``ase.visualize.view``) and writes it to its own formats.
    """
    a = lattice_constant(sphere)
    row, column = (index.ravel() for index in np.indices((shape.rows, shape.columns)))
    left = -(shape.columns // 2)
    along_x, n = _offsets(row, column)
    x = (along_x + 0.25) * a
    y = n * (ROW_SPACING * a)
    periodic = shape.ends == "periodic"
    # Half a row below the first row when periodic; a radius of air beyond the held rows otherwise.
    margin = 0.5 * ROW_SPACING * a if periodic else 1.0
    bottom = -shape.centre_row * (ROW_SPACING * a) - margin
    height = shape.rows * ROW_SPACING * a if periodic else (shape.rows - 1) * ROW_SPACING * a + 2 * margin
    packing = ase.Atoms(
        numbers=np.zeros(len(row), dtype=int),
        positions=np.column_stack([x, y, np.zeros_like(x)]),
        cell=[shape.columns * a, height, 2.0],
        celldisp=[left * a, bottom, -1.0],
        pbc=[True, periodic, False],
    )
    packing.set_array("row", row)
    packing.set_array("column", column)
    packing.set_array("fixed", (row == 0) | (row == shape.rows - 1) if not periodic else np.zeros(len(row), dtype=bool))
    packing.set_array("radius", np.ones(len(row)))
    return packing


def offsets(packing: ase.Atoms) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the positions relative to the centre sphere: along x in columns, (N,), and along y in rows, (N,)."""
    return _offsets(packing.arrays["row"], packing.arrays["column"])


def _offsets(row: NDArray[np.int64], column: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    n = row - row.max() // 2
    return column - (column.max() + 1) // 2 + 0.5 * (n % 2), n


def centre(packing: ase.Atoms) -> int:
    """Return the index of the centre sphere: row (rows−1)//2, column columns//2."""
    rows, columns = packing.arrays["row"], packing.arrays["column"]
    (index,) = np.flatnonzero((rows == rows.max() // 2) & (columns == (columns.max() + 1) // 2))
    return int(index)
