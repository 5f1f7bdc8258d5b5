"""Hexagonal 2D packings of touching spheres at rest, as `ase.Atoms`.

Rows are stacked along y; within a row the spheres touch along x. Lattice constant
a = 2R − Δ0, row spacing (√3/2) a, every other row shifted by a/2. **Lengths are in radii R**: ASE, which thinks in Å
and draws cells in steps of a fraction of one, then shows spheres of 5 mm as well as of 50 nm.
"""

from functools import cache

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.wavevector import ROW_SPACING
from granular_lmp.scene.shape import Shape


def hexagonal(sphere: Sphere, shape: Shape) -> ase.Atoms:
    """The packing at rest.

    Parameters
    ----------
    sphere : Sphere
        Gives radius and lattice constant.
    shape : Shape
        Rows, columns and ends; `granular_lmp.scene.scene` checks that they make a lattice.

    Returns
    -------
    ase.Atoms
        One atom ("X") a sphere, row by row, positions in radii, periodic along x, and along y with periodic ends.
        Arrays: ``row`` and ``column`` (counted from 0), ``fixed`` (True on the held rows), ``radius`` (1).
        The centre sphere sits next to the origin, where coordinates carry the most digits. No sphere is on a periodic
        face: columns are shifted by a quarter of the lattice constant, rows by half a row.

    Notes
    -----
    ASE draws it (``ase.visualize.view``) and writes it to its own formats, but has none for LAMMPS spheres: see
    `granular_lmp.lammps.datafile`.
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


def lattice_constant(sphere: Sphere) -> float:
    """a = 2 − Δ0/R, in radii."""
    return sphere.lattice_constant / sphere.radius


@cache
def unit_lattice(sphere: Sphere) -> ase.Atoms:
    """The smallest periodic packing whose centre sphere stands for the infinite lattice; not to be changed."""
    return hexagonal(sphere, Shape(rows=4, columns=3, ends="periodic"))


def offsets(packing: ase.Atoms) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Where the spheres are, from the centre sphere: along x in columns, (N,), and along y in rows, (N,)."""
    return _offsets(packing.arrays["row"], packing.arrays["column"])


def _offsets(row: NDArray[np.int64], column: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    n = row - row.max() // 2
    return column - (column.max() + 1) // 2 + 0.5 * (n % 2), n


def centre(packing: ase.Atoms) -> int:
    """Index of the centre sphere: row (rows−1)//2, column columns//2."""
    rows, columns = packing.arrays["row"], packing.arrays["column"]
    (index,) = np.flatnonzero((rows == rows.max() // 2) & (columns == (columns.max() + 1) // 2))
    return int(index)


def contacts(packing: ase.Atoms, index: int) -> NDArray[np.float64]:
    """Vectors (contacts, 2), in radii, from the centre of sphere `index` to those of the spheres that it overlaps."""
    radius = packing.arrays["radius"]
    height = packing.cell.lengths()[1]
    along_y = packing.positions[:, 1] - packing.positions[index, 1]
    along_y -= height * np.round(along_y / height) * packing.pbc[1]
    # Nearest images of a million spheres would take ten times the memory of the packing
    others = np.flatnonzero(np.abs(along_y) < radius[index] + radius.max())
    others = others[others != index]
    vectors = packing.get_distances(index, others, mic=True, vector=True)[:, :2]
    return vectors[np.linalg.norm(vectors, axis=1) < radius[index] + radius[others]]
