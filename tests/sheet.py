"""A periodic hexagonal sheet row by row as in LAMMPS's deck, in the paper's units: what tests start waves on."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cases.fields import ROW
from cases.fields import Sheet as Places
from granular_analysis.theory.bloch import BONDS, hexagonal
from granular_analysis.theory.cell import Cell, fields
from granular_analysis.theory.contact import Contact

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Sheet(Places):
    """A sheet of spheres. overlap_ratio is η, 0 in the paper's geometry of contacts."""

    poisson_ratio: float
    overlap_ratio: float = 0.0

    @property
    def contact(self) -> Contact:
        """Return the contact of its spheres."""
        return Contact(self.poisson_ratio, overlap_ratio=self.overlap_ratio)

    @cached_property
    def neighbours(self) -> NDArray[np.intp]:
        """Return the indices (6, N) of the spheres at the ends of `BONDS`, then of those against them."""
        cell = np.array([self.columns, self.rows * ROW])
        found = []
        for bond in (*BONDS, *-BONDS):
            apart = (self.rest[:, None] + bond - self.rest) / cell
            found.append(np.argmin(np.linalg.norm(cell * (apart - np.round(apart)), axis=-1), axis=1))
        return np.array(found)

    def wavevector(self, x: int, y: int) -> Floats:
        """Return the wave vector (2,) with x periods across the sheet and y along it."""
        return 2 * np.pi * np.array([x / self.columns, y / (self.rows * ROW)])

    @cached_property
    def cell(self) -> Cell:
        """Return all spheres with their contacts, in Δ0, k1Δ0 and t0."""
        crystal, count = hexagonal(self.contact), len(self.rest)
        one = crystal.bonds
        repeated = {
            name: np.repeat(getattr(one, name), count, axis=0)
            for name in ("apart", "normal", "curving", "arms", "widening")
        }
        law = type(one.law)(*(np.repeat(each, count) for each in one.law))
        ends = {"first": np.tile(np.arange(count), len(BONDS)), "second": self.neighbours[: len(BONDS)].ravel()}
        mobility = np.repeat(1 / crystal.mass[0, [0, 1, 5], None], count, axis=1)
        return Cell(replace(one, law=law, **ends, **repeated), mobility, np.ones(count))


def evolve(
    sheet: Sheet, field: Floats, rate: Floats, tau: ArrayLike, *, timestep: float = 0.0
) -> tuple[Floats, Floats]:
    """Return the fields y1 and y2 (T, N, 3) of y = y1 + a y2 in D0, from those (N, 3) of the first time in tau."""
    times = np.asarray(tau, dtype=float)
    both = fields(sheet.cell, field.ravel(), rate.ravel(), times - times[0], timestep)
    first, second = (each.reshape(len(times), -1, 3) for each in both)
    return first, second
