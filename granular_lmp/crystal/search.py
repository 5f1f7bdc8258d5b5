"""The search for overlapping pairs of spheres in a crystal with any cell, even one smaller than a sphere.

The spheres and their periodic images are sorted into square bins as wide as the largest diameter, so that each sphere
is compared only with those in the bins around its own. `ase.neighborlist` finds the same pairs
(``tests/crystal/test_contacts.py``), but its import takes longer than the build of a deck, as it loads SciPy's sparse
matrices.
"""

from itertools import product

import ase
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def overlapping(crystal: ase.Atoms) -> tuple[Integers, Integers, Floats]:
    """Return each pair of overlapping spheres once, across periodic faces too.

    Parameters
    ----------
    crystal : ase.Atoms
        Crystal with the array ``radius``, in the unit of its positions.

    Returns
    -------
    i, j : (C,) int arrays
        Spheres of the pairs, i <= j, in ascending order. A sphere may touch its own images, and another one several
        times.
    vector : (C, 3) array
        Vector from the centre of i to that of j, or of the image of j that i touches.
    """
    radius = np.asarray(crystal.arrays["radius"], dtype=float)
    reach = 2 * radius.max()
    owner, shift = _images(crystal, reach)
    places = crystal.positions[owner] + shift @ crystal.cell.array
    i, image = _near(crystal.positions, places, reach)
    j = owner[image]
    vector = places[image] - crystal.positions[i]
    touching = np.linalg.norm(vector, axis=1) < radius[i] + radius[j]
    once = (i < j) | ((i == j) & (_sign(shift[image]) > 0))
    found = np.flatnonzero(touching & once)
    order = found[np.lexsort((*shift[image[found]].T, j[found], i[found]))]
    return i[order], j[order], vector[order]


def _images(crystal: ase.Atoms, reach: float) -> tuple[Integers, Integers]:
    """Return the spheres and those of their images within reach of the box around all spheres: owner and cell shift."""
    cell, positions = crystal.cell.array, crystal.positions
    # Distance of opposite faces of the cell, and the extent of the spheres across them
    heights = 1 / np.linalg.norm(np.linalg.inv(cell), axis=0)
    scaled = positions @ np.linalg.inv(cell)
    most = np.where(crystal.pbc, np.ceil(reach / heights + np.ptp(scaled, axis=0)), 0).astype(int)
    low, high = positions.min(axis=0) - reach, positions.max(axis=0) + reach
    owners, shifts = [], []
    for shift in product(*(range(-count, count + 1) for count in most)):
        place = positions + shift @ cell
        inside = np.flatnonzero(np.all((low <= place) & (place <= high), axis=1))
        owners.append(inside)
        shifts.append(np.broadcast_to(shift, (len(inside), 3)))
    return np.concatenate(owners), np.concatenate(shifts)


def _near(positions: Floats, places: Floats, reach: float) -> tuple[Integers, Integers]:
    """Return the pairs (index of a position, index of a place) in the same bin or in bins side by side."""
    origin = positions.min(axis=0) - 2 * reach
    bins = np.floor((places - origin) / reach).astype(np.int64)
    size = bins.max(axis=0) + 2
    key = np.ravel_multi_index(tuple(bins.T), size)
    order = np.argsort(key, kind="stable")
    own = np.ravel_multi_index(tuple(np.floor((positions - origin) / reach).astype(np.int64).T), size)
    # Bins that follow one another along the last axis are neighbours in the sorted list too: one range holds three
    first, second = [], []
    for along_x, along_y in product((-1, 0, 1), repeat=2):
        middle = own + (along_x * size[1] + along_y) * size[2]
        start = np.searchsorted(key[order], middle - 1, side="left")
        count = np.searchsorted(key[order], middle + 1, side="right") - start
        first.append(np.repeat(np.arange(len(positions)), count))
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        second.append(order[np.repeat(start, count) + within])
    return np.concatenate(first), np.concatenate(second)


def _sign(shift: Integers) -> Integers:
    """Return the sign of the first component that is not zero, (C,)."""
    return np.sign(np.sign(shift) @ [9, 3, 1])
