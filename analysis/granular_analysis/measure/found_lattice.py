"""Lattice of spheres of which only the places are known. Its vectors are translations that map spheres onto spheres.

*Good values*: a crystal of at least a few cells each way, spheres within 0.15 of the smallest distance from their
sites, and vacancies at up to a fifth of the sites. *When it breaks*: if the outline of the crystal is far from a box,
too many images fall outside at its edges, and no translation is found.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]

NEAR = 0.15  # an image within this share of the smallest distance from a sphere coincides with it
_SHARE = 0.8  # least share of images inside the crystal that coincide with spheres
_CANDIDATES = 40  # neighbours of one kind that are tried as translations
_FLAT = 1e-3  # sine of an angle below which vectors are parallel, or in one plane


class FoundLattice(NamedTuple):
    """A lattice: its vectors (d, 3), shortest first, and for each sphere the number of its site in the cell, (N,)."""

    vectors: Floats
    site: Integers

    @property
    def reciprocal(self) -> Floats:
        """Vectors of the reciprocal lattice, (d, 3), in rad per unit of length."""
        return np.asarray(2 * np.pi * np.linalg.pinv(self.vectors).T)

    def zone_edge(self, way: Floats) -> float:
        """Return the wave number of the edge of the first Brillouin zone along a unit vector (3,); inf without one."""
        if not len(self.vectors):
            return float("inf")
        every = np.array([each for each in product((-2, -1, 0, 1, 2), repeat=len(self.vectors)) if any(each)])
        vectors = every @ self.reciprocal
        along = vectors @ way
        ahead = along > _FLAT * np.linalg.norm(vectors, axis=1)
        return float(np.min(np.sum(vectors[ahead] ** 2, axis=1) / (2 * along[ahead]), initial=np.inf))


def found_lattice(places: Floats, kinds: Integers, cell: Floats, periodic: NDArray[np.bool_]) -> FoundLattice:
    """Return the lattice of spheres; a lattice that is not found has no vectors.

    Parameters
    ----------
    places : (N, 3) array
    kinds : (N,) array
        Kind of each sphere; a translation must map spheres onto spheres of the same kind.
    cell : (3, 3) array
        Edges of the box, one to a row.
    periodic : (3,) array of bool
    """
    flat = np.ptp(places, axis=0) < _FLAT * np.ptp(places, axis=0).max()  # the box of a sheet repeats across it too
    images = _Images(places, kinds, cell, periodic & ~flat)
    vectors: list[Floats] = []
    for vector in images.candidates():
        if len(vectors) == 3 or not _is_new(vector, vectors) or not images.maps(vector):
            continue
        vectors.append(vector * np.sign(vector[np.argmax(np.abs(vector))]))
    found = np.array(vectors).reshape(-1, 3)
    return FoundLattice(found, _sites(places, kinds, found, NEAR * images.apart))


def _is_new(vector: Floats, others: list[Floats]) -> bool:
    """Return whether a vector is linearly independent of others."""
    units = np.array([each / np.linalg.norm(each) for each in (*others, vector)])
    return bool(np.linalg.svd(units, compute_uv=False).min() > _FLAT)


def _sites(places: Floats, kinds: Integers, vectors: Floats, near: float) -> Integers:
    """Return the number of the site in the cell of each sphere, from 0; its kind if a cell has more than 40 sites."""
    if not len(vectors):
        return kinds
    inside = places @ np.linalg.pinv(vectors)
    rest = places - np.floor(inside) @ vectors
    site = np.full(len(places), -1)
    shifts = np.array([*product((-1, 0, 1), repeat=len(vectors))]) @ vectors
    for number in range(len(places)):
        first = int(np.argmax(site < 0))
        if site[first] >= 0:
            return site
        apart = np.min(np.linalg.norm(rest[:, None] - rest[first] + shifts, axis=-1), axis=1)
        site[(site < 0) & (apart < 2 * near) & (kinds == kinds[first])] = number
        if number >= _CANDIDATES:
            break
    return kinds


class _Images:
    """Spheres and their periodic images, to test translations."""

    def __init__(self, places: Floats, kinds: Integers, cell: Floats, periodic: NDArray[np.bool_]) -> None:
        self.kinds, self.cell, self.periodic = kinds, cell, periodic
        self.back = np.linalg.inv(cell)
        inside = places @ self.back
        self.places = np.where(periodic, inside % 1.0, inside) @ cell
        shifts = np.array([*product(*((-1, 0, 1) if each else (0,) for each in periodic))]) @ cell
        everywhere = (self.places + shifts[:, None]).reshape(-1, 3)
        self.number = np.tile(np.arange(len(places)), len(shifts))
        self.tree = cKDTree(everywhere)
        near, _ = self.tree.query(self.places, 2)
        self.apart = float(np.median(near[:, 1]))
        self.low, self.high = self.places.min(axis=0) - self.apart / 4, self.places.max(axis=0) + self.apart / 4

    def candidates(self) -> list[Floats]:
        """Return the vectors from a sphere of the most common kind in the middle to others of its kind, by length."""
        common = np.bincount(self.kinds).argmax()
        own = np.flatnonzero(self.kinds == common)
        middle = own[np.argmin(np.linalg.norm(self.places[own] - self.places.mean(axis=0), axis=1))]
        count = min(len(self.tree.data), _CANDIDATES * len(np.unique(self.kinds)) + 1)
        _, near = self.tree.query(self.places[middle], count)
        same = [each for each in near if self.kinds[self.number[each]] == common]
        vectors = [np.asarray(self.tree.data[each] - self.places[middle]) for each in same]
        return [each for each in vectors if np.linalg.norm(each) > self.apart / 2]

    def maps(self, vector: Floats) -> bool:
        """Return whether a translation maps 80 % or more of the spheres that stay inside onto spheres of their kind."""
        inside = (self.places + vector) @ self.back
        images = np.where(self.periodic, inside % 1.0, inside) @ self.cell
        there = np.all(self.periodic | ((images > self.low) & (images < self.high)), axis=1)
        distance, near = self.tree.query(images[there])
        same = (distance < NEAR * self.apart) & (self.kinds[self.number[near]] == self.kinds[there])
        return bool(there.sum() >= 2 and same.mean() >= _SHARE)
