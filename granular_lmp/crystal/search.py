"""Search for overlapping pairs of spheres in a crystal with any cell, even a cell smaller than a sphere.

The spheres and their periodic images are sorted into cubic bins as wide as the largest diameter, so each sphere is
compared only with the spheres in its own and the adjacent bins. `ase.neighborlist` finds the same pairs, but loads
SciPy's sparse matrices, so its import takes longer than the build of a deck.
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
# Lattice vectors that differ by less are equal, in radii; coordinates have a relative rounding of 1e-13
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
        Spheres of the pairs, i <= j, in ascending order. A sphere may touch its own images, and may touch several
        images of another sphere.
    vector : (C, 3) array
        Vector from the centre of i to the centre of j, or of the image of j that i touches.
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
    """Return vectors (C, D) in which all vectors that differ only by rounding are replaced by their mean.

    A perfect lattice then has exactly the same contact everywhere. All other vectors are unchanged.
    """
    key = np.round(vector / _SAME_VECTOR)
    # Opposite vectors are averaged too, because the few contacts across a periodic face all have the same rounding
    sign = np.sign(reduce(lambda before, part: np.where(part == 0, before, part), key.T))[:, None]
    _, first, like = np.unique(key * sign, axis=0, return_index=True, return_inverse=True)
    like, vector = like.ravel(), vector * sign
    away = vector - vector[first][like]  # small differences: a sum of many whole vectors would add rounding
    count = np.bincount(like)
    mean = np.column_stack([np.bincount(like, part) / count for part in away.T])
    return (vector[first] + mean)[like] * sign


def _images(crystal: ase.Atoms, reach: float) -> tuple[Integers, Integers]:
    """Return all spheres, and their images within reach of the box around all spheres, by owner and cell shift."""
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
        for axis in np.flatnonzero(offsets[image]):  # after each axis fewer spheres of this image are left
            place = positions[inside, axis] + offsets[image, axis]
            inside = inside[(low[axis] <= place) & (place <= high[axis])]
        owners.append(inside)
        shifts.append(np.broadcast_to(every[image], (len(inside), 3)))
    return np.concatenate(owners), np.concatenate(shifts)


def _near(positions: Floats, places: Floats, reach: float) -> Iterator[tuple[Integers, Integers]]:
    """Yield the pairs (index of a position, index of a place) in the same bin or in adjacent bins.

    The positions are processed in order, in blocks.
    """
    axes = np.argsort(np.ptp(positions, axis=0), kind="stable")  # the longest axis last
    origin = positions.min(axis=0) - 2 * reach
    bins = np.floor((places - origin) / reach).astype(np.int64)[:, axes]
    size = bins.max(axis=0) + 2
    key = np.ravel_multi_index(tuple(bins.T), size)
    order = np.argsort(key, kind="stable")
    key = key[order]
    flat = np.ptp(bins, axis=0)[:2] == 0  # axes with a single bin have no adjacent bins
    sides = [(0,) if alone else (-1, 0, 1) for alone in flat]
    for block in blocks(len(positions)):
        own = np.floor((positions[block] - origin) / reach).astype(np.int64)[:, axes]
        at = np.ravel_multi_index(tuple(own.T), size)
        first, second = [], []
        # Successive bins along the last axis are also successive in the sorted list: one range has all three of them
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
