"""The search for overlapping pairs of spheres in a crystal with any cell, even one smaller than a sphere.

The spheres and their periodic images are sorted into square bins as wide as the largest diameter, so that each sphere
is compared only with those in the bins around its own. `ase.neighborlist` finds the same pairs, but its import takes
longer than the build of a deck, as it loads SciPy's sparse matrices.
"""

from collections.abc import Iterator
from functools import reduce
from itertools import product

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.blocks import blocks

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# Vectors of the lattice that differ by less are one vector, in radii: coordinates are rounded to 1e-13 of them.
_SAME_VECTOR = 1e-8


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
    after, rank = _sign(shift) > 0, shift @ (2 * np.abs(shift).max(initial=0) + 1) ** np.arange(3)
    found = []
    for i, image in _near(crystal.positions, places, reach):
        j = owner[image]
        once = np.flatnonzero((i < j) | (i == j) & after[image])
        i, j, image = i[once], j[once], image[once]
        vector = places[image] - crystal.positions[i]
        x, y, z = vector.T
        touching = np.flatnonzero(np.sqrt(x * x + y * y + z * z) < radius[i] + radius[j])
        order = touching[np.lexsort((rank[image[touching]], j[touching], i[touching]))]
        found.append((i[order], j[order], vector[order]))
    i, j, vector = (np.concatenate(each) for each in zip(*found, strict=True))
    return i, j, vector


def lattice_vectors(vector: Floats) -> Floats:
    """Return the vectors (C, 2) with those that differ by rounding only made the same, each the mean of its like.

    A perfect lattice has then exactly the same contact everywhere. Vectors that are not of a lattice stay as they are.
    """
    key = np.round(vector / _SAME_VECTOR)
    # A vector and its opposite are alike too: few contacts cross a periodic face, all rounded in the same way
    sign = np.sign(reduce(lambda before, part: np.where(part == 0, before, part), key.T))[:, None]
    _, first, like = np.unique(key * sign, axis=0, return_index=True, return_inverse=True)
    like, vector = like.ravel(), vector * sign
    away = vector - vector[first][like]  # small: a sum of many whole vectors would be rounded more than they are
    count = np.bincount(like)
    mean = np.column_stack([np.bincount(like, part) / count for part in away.T])
    return (vector[first] + mean)[like] * sign


def _images(crystal: ase.Atoms, reach: float) -> tuple[Integers, Integers]:
    """Return the spheres and those of their images within reach of the box around all spheres: owner and cell shift."""
    cell, positions = crystal.cell.array, crystal.positions
    # Distance of opposite faces of the cell, and the extent of the spheres across them
    heights = 1 / np.linalg.norm(np.linalg.inv(cell), axis=0)
    scaled = positions @ np.linalg.inv(cell)
    most = np.where(crystal.pbc, np.ceil(reach / heights + np.ptp(scaled, axis=0)), 0).astype(int)
    low, high = positions.min(axis=0) - reach, positions.max(axis=0) + reach
    every = np.array(list(product(*(range(-count, count + 1) for count in most))))
    offsets = every @ cell
    near = (positions.max(axis=0) + offsets >= low) & (positions.min(axis=0) + offsets <= high)
    owners, shifts = [], []
    for image in np.flatnonzero(near.all(axis=1)):
        inside = np.arange(len(positions))
        for axis in np.flatnonzero(offsets[image]):  # few are left of an image
            place = positions[inside, axis] + offsets[image, axis]
            inside = inside[(low[axis] <= place) & (place <= high[axis])]
        owners.append(inside)
        shifts.append(np.broadcast_to(every[image], (len(inside), 3)))
    return np.concatenate(owners), np.concatenate(shifts)


def _near(positions: Floats, places: Floats, reach: float) -> Iterator[tuple[Integers, Integers]]:
    """Yield the pairs (index of a position, index of a place) in the same bin or in bins side by side.

    The positions are taken in their order, some at a time.
    """
    axes = np.argsort(np.ptp(positions, axis=0), kind="stable")  # the longest last
    origin = positions.min(axis=0) - 2 * reach
    bins = np.floor((places - origin) / reach).astype(np.int64)[:, axes]
    size = bins.max(axis=0) + 2
    key = np.ravel_multi_index(tuple(bins.T), size)
    order = np.argsort(key, kind="stable")
    key = key[order]
    flat = np.ptp(bins, axis=0)[:2] == 0  # a single bin has none at its sides
    sides = [(0,) if alone else (-1, 0, 1) for alone in flat]
    for block in blocks(len(positions)):
        own = np.floor((positions[block] - origin) / reach).astype(np.int64)[:, axes]
        at = np.ravel_multi_index(tuple(own.T), size)
        first, second = [], []
        # Bins that follow one another along the last axis are neighbours in the sorted list too: one range holds three
        for across in product(*sides):
            middle = at + (across[0] * size[1] + across[1]) * size[2]
            start = np.searchsorted(key, middle - 1, side="left")
            count = np.searchsorted(key, middle + 1, side="right") - start
            first.append(np.repeat(np.arange(block.start, block.stop), count))
            within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
            second.append(order[np.repeat(start, count) + within])
        yield np.concatenate(first), np.concatenate(second)


def _sign(shift: Integers) -> Integers:
    """Return the sign of the first component that is not zero, (C,)."""
    return np.sign(np.sign(shift) @ [9, 3, 1])
