"""Wave vectors of a lattice, as phase advances from column to column and from row to row.

Rows lie along x, columns a distance a apart, and rows are h a apart along y: in the hexagonal lattice a is the lattice
constant, h = √3/2, and rows are shifted by half a column. A wave vector k is stored as its phase advances
(k_x a, h k_y a); a periodic cell holds 2π i/columns and 2π j/rows. The wave number is ξ = h|k|a in every direction: rad
per row for a wave along y, the paper's direction.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import atan2, cos, degrees, hypot, pi, radians, sin, sqrt
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from granular_lmp.frozen import dataclass

ROW_SPACING = sqrt(3) / 2  # hexagonal lattice, in lattice constants
DIRECTIONS = {"x": 0.0, "y": 90.0}
# Directions, in degrees, of the pairs of edges of the first Brillouin zone of the hexagonal lattice, each at ξ = π
EDGES = (90.0, 30.0, -30.0)

Value = TypeVar("Value", float, NDArray[np.float64])


@dataclass(frozen=True)
class WaveVector:
    """A wave vector by its phase advances, rad.

    Attributes
    ----------
    per_column : float
        Advance k_x a along x to the next column.
    per_row : float
        Advance h k_y a along y to the next row.
    row_spacing : float
        Distance h of the rows, in that of the columns.
    column_spacing : float
        Distance of the columns, in that of two spheres that touch.
    """

    per_column: float
    per_row: float
    row_spacing: float = ROW_SPACING
    column_spacing: float = 1.0

    @classmethod
    def of(
        cls,
        wavenumber: float,
        direction: float = 90.0,
        row_spacing: float = ROW_SPACING,
        column_spacing: float = 1.0,
    ) -> Self:
        """Return the wave vector with ξ (rad per row spacing) and a direction in degrees from x towards y."""
        quarter, rest = divmod(direction, 90.0)
        if rest == 0:  # exactly along an axis, where cos 90° would leave 6e-17
            along_x, along_y = ((1, 0), (0, 1), (-1, 0), (0, -1))[int(quarter) % 4]
            return cls(along_x * wavenumber / row_spacing, along_y * wavenumber, row_spacing, column_spacing)
        angle = radians(direction)
        return cls(wavenumber * cos(angle) / row_spacing, wavenumber * sin(angle), row_spacing, column_spacing)

    @property
    def components(self) -> tuple[float, float]:
        """Components (k_x, k_y) over the distance of two spheres that touch; of one sphere a cell in 1/a."""
        return self.per_column / self.column_spacing, self.per_row / self.row_spacing / self.column_spacing

    @property
    def wavenumber(self) -> float:
        """Wave number ξ, rad per row spacing."""
        return abs(self.per_row) if self.per_column == 0 else hypot(self.row_spacing * self.per_column, self.per_row)

    @property
    def direction(self) -> float:
        """Direction in degrees from x towards y, in (−180, 180]."""
        return degrees(atan2(self.per_row, self.row_spacing * self.per_column))

    @property
    def unit(self) -> tuple[float, float]:
        """Unit vector k/|k|; at Γ, where all directions are alike, that of y."""
        size = self.wavenumber
        if size == 0:
            return 0.0, 1.0
        return self.row_spacing * self.per_column / size, self.per_row / size

    def along(self, ux: Value, uy: Value) -> Value:
        """Return the component of a vector along k: p of a displacement, u_y for k along y."""
        x, y = self.unit
        return x * ux + y * uy

    def across(self, ux: Value, uy: Value) -> Value:
        """Return the component of a vector along ẑ × k: q of a displacement, −u_x for k along y."""
        x, y = self.unit
        return x * uy - y * ux

    @property
    def axis(self) -> str | None:
        """Axis, "x" or "y", along which the wave runs, up or down; None in between."""
        return "y" if self.per_column == 0 else "x" if self.per_row == 0 else None

    def snapped(self, rows: int | None, columns: int | None) -> "WaveVector":
        """Return the nearest wave vector of a cell that is periodic after rows and columns; None: not periodic."""
        return replace(
            self,
            per_column=self.per_column if columns is None else snapped(self.per_column, columns),
            per_row=self.per_row if rows is None else snapped(self.per_row, rows),
        )

    @property
    def doubled(self) -> "WaveVector":
        """Wave vector 2k of the second harmonic."""
        return replace(self, per_column=2 * self.per_column, per_row=2 * self.per_row)


def snapped(advance: float, count: int) -> float:
    """Return the 2πk/count nearest to a phase advance."""
    return 2 * pi * round(advance * count / (2 * pi)) / count


def zone_edge(direction: float, edges: Sequence[float] = EDGES) -> float:
    """Return the ξ at which the first Brillouin zone ends in a direction (degrees): π along y, 2π/√3 along x.

    The zone is that of the hexagonal lattice, or one whose pairs of edges lie in other directions, at π too. A wave
    vector beyond it is equivalent to a shorter one.
    """
    return pi / max(abs(cos(radians(direction - edge))) for edge in edges)


def zone_path(corners: Sequence[tuple[float, float]], points: int) -> NDArray[np.float64]:
    """Return wave vectors on the straight edges between corners of a zone, `points` an edge, (P, 2)."""
    ends = np.array(corners)
    share = np.linspace(0, 1, points)[:, None]
    return np.vstack([start + share * (end - start) for start, end in pairwise(ends)])
