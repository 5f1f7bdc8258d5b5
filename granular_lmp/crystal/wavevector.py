"""Wave vectors of a lattice, stored as phase advances from column to column and from row to row.

Rows lie along x, columns a distance a apart, and rows are h a apart along y: in the hexagonal lattice a is the lattice
constant, h = √3/2, and rows are shifted by half a column. A wave vector k has the phase advances (k_x a, h k_y a); a
periodic cell allows 2π i/columns and 2π j/rows. The wave number is ξ = h|k|a in every direction: rad per row for a wave
along y, the paper's direction.
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
# Directions, in degrees, normal to the edges of the first Brillouin zone of the hexagonal lattice, which are at ξ = π
EDGES = (90.0, 30.0, -30.0)

Value = TypeVar("Value", float, NDArray[np.float64])


@dataclass(frozen=True)
class WaveVector:
    """Wave vector, given by its phase advances in rad.

    Attributes
    ----------
    per_column : float
        Advance k_x a along x to the next column.
    per_row : float
        Advance h k_y a along y to the next row.
    row_spacing : float
        Distance h of the rows, in distances of columns.
    column_spacing : float
        Distance of the columns, in distances of two touching spheres.
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
        if rest == 0:  # exactly along an axis, because cos 90° is 6e-17 in floating point
            along_x, along_y = ((1, 0), (0, 1), (-1, 0), (0, -1))[int(quarter) % 4]
            return cls(along_x * wavenumber / row_spacing, along_y * wavenumber, row_spacing, column_spacing)
        angle = radians(direction)
        return cls(wavenumber * cos(angle) / row_spacing, wavenumber * sin(angle), row_spacing, column_spacing)

    @property
    def components(self) -> tuple[float, float]:
        """Components (k_x, k_y) in 1/distance of two touching spheres, which is 1/a with one sphere per cell."""
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
        """Unit vector k/|k|; along y at Γ, where k has no direction."""
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
        """Axis, "x" or "y", along which the wave runs, in either direction; None for other directions."""
        return "y" if self.per_column == 0 else "x" if self.per_row == 0 else None

    def snapped(self, rows: int | None, columns: int | None) -> "WaveVector":
        """Return the nearest wave vector that a cell allows; rows or columns are None if the cell is not periodic."""
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
    """Return the multiple of 2π/count nearest to a phase advance."""
    return 2 * pi * round(advance * count / (2 * pi)) / count


def zone_edge(direction: float, edges: Sequence[float] = EDGES) -> float:
    """Return ξ at the edge of the first Brillouin zone in a direction (degrees): π along y, 2π/√3 along x.

    The zone is that of the hexagonal lattice, or a zone with edges normal to other directions, also at ξ = π. A wave
    vector beyond the zone is equivalent to a shorter one.
    """
    return pi / max(abs(cos(radians(direction - edge))) for edge in edges)


def zone_path(corners: Sequence[tuple[float, float]], points: int) -> NDArray[np.float64]:
    """Return wave vectors (P, 2) on straight lines between successive corners of a zone, `points` per line."""
    ends = np.array(corners)
    share = np.linspace(0, 1, points)[:, None]
    return np.vstack([start + share * (end - start) for start, end in pairwise(ends)])
