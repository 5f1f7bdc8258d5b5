"""Lattices of spheres that just touch, and compressed chains: rounding neither separates nor presses neighbours.

A gap would delay a wave, and an overlap would start a motion in the lattice at rest. With the radius R as the unit of
length, as in the deck, positions are exact binary numbers:

* square lattice, and chain of equal spheres: whole and half numbers, so that every overlap is exactly 0;
* chain of unequal spheres: radii are rounded to a multiple of a power of two, `grain`, of which all sums are exact,
  and spheres are put side by side: every overlap is exactly 0;
* hexagonal lattice: the distance of the rows, √3, is rounded *down* to a multiple of `grain`. All contacts between
  rows are then equal, and overlap by less than √3/2 of the rounding of the farthest position, 1e-14 R in 100 rows.
  Positions of moving spheres are no finer, so no other choice would be better.

In a chain compressed by a force F0, the overlaps (F0/A)^{2/3} are rounded to a multiple of `grain` too. Overlaps of
equal spheres are then equal to the last bit, and nothing moves; overlaps of unequal spheres leave a residual force
(`granular_lmp.rest.meeting.Meeting.residual_force`).

Unequal spheres of a sheet cannot all touch. They are on the lattice of the nominal radius R, and no sphere is larger:
sphere s has the radius R_s (1 − σ |g_s|), with the radius R_s ≤ R of its inclusion and the deviate g_s of
`granular_lmp.crystal.disorder`, so there are gaps between neighbours. No contact has a force, so all spheres are at
rest.
"""

from dataclasses import replace
from math import ceil, floor, log2

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import Contacts, contacts_between, law_between
from granular_lmp.crystal.disorder import Disorder, Inclusion, imperfect
from granular_lmp.crystal.lattices import CHAIN, Lattice, Shape, offsets, packed
from granular_lmp.crystal.search import overlapping
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.sphere_table import NO_TABLE, SphereTable

_MANTISSA = 53  # bits of a double
_REACH = 1e-6  # radii: gaps of touching neighbours are smaller, and gaps of other spheres are much larger
_APART = 100.0  # factor that spreads a chain while its spheres are chosen, as radii differ by a factor of up to 10


def grain(length: float) -> float:
    """Return the power of two whose multiples up to a length are all exact floating-point numbers."""
    return 2.0 ** (ceil(log2(length)) - _MANTISSA)


def touching(
    sphere: Sphere,
    lattice: Lattice,
    rows: int,
    columns: int,
    *,
    held: tuple[bool, bool] = (False, False),
    periodic: tuple[bool, bool] = (False, False),
    force: float = 0.0,
    disorder: Disorder | None = None,
    inclusions: tuple[Inclusion, ...] = (),
    table: SphereTable = NO_TABLE,
) -> tuple[ase.Atoms, tuple[Sphere, ...]]:
    """Return spheres that just touch, or form a compressed chain, and their materials.

    Parameters
    ----------
    sphere : Sphere
        Sphere with the law of closed contacts, with or without adhesion.
    lattice : Lattice
        Lattice in the plane.
    rows, columns : int
        Number of rows and columns.
    held : (bool, bool)
        Whether the first and the last row are held.
    periodic : (bool, bool)
        Whether the first column touches the last, and whether the first row of a sheet touches the last.
    force : float
        Force F0 on the contacts of a chain, N; 0 in a sheet.
    disorder, inclusions, table
        As in `granular_lmp.crystal.disorder.imperfect`. Radii of a sheet are at most the nominal radius (see above).

    Returns
    -------
    crystal : ase.Atoms
        Positions and radii in radii R of `sphere`, the centre sphere near the origin; arrays ``row``, ``column``,
        ``fixed``, ``radius``, ``density`` and ``material``.
    materials : tuple of Sphere
        Materials by index.

    Raises
    ------
    CrystalError
        If imperfections do not fit into the lattice.
    """
    crystal = packed(sphere.unloaded, Shape(rows, columns, "periodic" if periodic[1] else "fixed", lattice))
    crystal.arrays["fixed"] = (crystal.arrays["row"] == 0) & held[0] | (crystal.arrays["row"] == rows - 1) & held[1]
    crystal.pbc = (*periodic, False)
    centre_row = (rows - 1) // 2
    unit = grain(float(rows))
    distance = floor(lattice.row_distance(2.0) / unit) * unit
    crystal.positions[:, 1] = offsets(crystal)[1] * distance
    if periodic[1]:
        crystal.cell[1, 1] = rows * distance
    # The search for neighbours needs an overlap, so radii are increased; chains are put side by side afterwards
    crystal.arrays["radius"] = np.full(len(crystal), 1 + _REACH)
    places = crystal.copy()
    if lattice == CHAIN:
        places.positions[:, 1] *= _APART
    crystal, materials = imperfect(places, sphere, disorder, inclusions, table=table)
    if lattice == CHAIN:
        radius = crystal.arrays["radius"]
        unit = grain(float(2 * radius.sum()))
        crystal.arrays["radius"] = radius = np.round(radius / unit) * unit
        lower = np.arange(len(crystal) - 1)
        law = law_between(crystal, materials, lower, lower + 1)
        overlap = law.overlap_under(force) / sphere.radius if force else np.zeros(len(lower))
        y = np.concatenate([[0.0], np.cumsum(radius[:-1] + radius[1:] - np.round(overlap / unit) * unit)])
        crystal.positions[:, 1] = y - y[centre_row]
        crystal.info["reach"] = _REACH
    else:
        alike = replace(disorder or Disorder(), radius=0.0)
        mean = imperfect(places, sphere, alike, inclusions, table=table)[0].arrays["radius"]
        crystal.arrays["radius"] = radius = mean - np.abs(crystal.arrays["radius"] - mean)
        crystal.info["reach"] = _REACH + 1 - float(radius.min())
    return crystal, materials


def neighbours(crystal: ase.Atoms) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return the pairs (i, j) of neighbours and the vectors from i to j or to its image, (C, 2), radii.

    Neighbours touch, or have the gap between unequal spheres of a sheet.
    """
    wider = crystal.copy()
    wider.arrays["radius"] = wider.arrays["radius"] + crystal.info["reach"]
    i, j, vector = overlapping(wider)
    return i, j, vector[:, :2]


def contacts_of_neighbours(crystal: ase.Atoms, materials: tuple[Sphere, ...], *, pressed: bool) -> Contacts:
    """Return the contacts of neighbours; neighbours that just touch or have a gap get the overlap 0.

    pressed : True if a force compresses the contacts, which then have the overlaps of the positions.
    """
    i, j, vector = neighbours(crystal)
    radius, unit = crystal.arrays["radius"], materials[0].radius
    overlap = np.zeros(len(i))
    if pressed:
        overlap = (radius[i] + radius[j] - np.linalg.norm(vector, axis=1)) * unit
    return contacts_between(crystal, materials, i, j, vector * unit, overlap)
