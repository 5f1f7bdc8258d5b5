"""Wave vectors of the hexagonal lattice: how far the phase of a wave advances from column to column and row to row.

Rows lie along x, columns a lattice constant a apart; rows are √3/2 a apart along y and shifted by half a column. A wave
vector k is kept as its phase advances (k_x a, (√3/2) k_y a); a periodic cell holds those of 2π i/columns and 2π j/rows.
Its wave number is ξ = (√3/2)|k|a in every direction: rad per row for a wave along y, the paper's direction.
"""

from dataclasses import dataclass
from math import atan2, cos, degrees, hypot, pi, radians, sin, sqrt
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray

ROW_SPACING = sqrt(3) / 2  # in lattice constants
DIRECTIONS = {"x": 0.0, "y": 90.0}
# Degrees of the three pairs of edges of the first Brillouin zone, each at ξ = π
_EDGES = (90.0, 30.0, -30.0)

Value = TypeVar("Value", float, NDArray[np.float64])


@dataclass(frozen=True)
class WaveVector:
    """A wave vector by its phase advances, rad.

    Attributes
    ----------
    per_column : float
        k_x a, along x to the next sphere of the row.
    per_row : float
        (√3/2) k_y a, along y to the next row.
    """

    per_column: float
    per_row: float

    @classmethod
    def of(cls, wavenumber: float, direction: float = 90.0) -> Self:
        """From ξ (rad per row spacing) and a direction in degrees from x towards y."""
        quarter, rest = divmod(direction, 90.0)
        if rest == 0:  # exactly along an axis, where cos 90° would leave 6e-17
            along_x, along_y = ((1, 0), (0, 1), (-1, 0), (0, -1))[int(quarter) % 4]
            return cls(along_x * wavenumber / ROW_SPACING, along_y * wavenumber)
        angle = radians(direction)
        return cls(wavenumber * cos(angle) / ROW_SPACING, wavenumber * sin(angle))

    @property
    def components(self) -> tuple[float, float]:
        """(k_x, k_y) in 1/lattice constant."""
        return self.per_column, self.per_row / ROW_SPACING

    @property
    def wavenumber(self) -> float:
        """ξ, rad per row spacing."""
        return abs(self.per_row) if self.per_column == 0 else hypot(ROW_SPACING * self.per_column, self.per_row)

    @property
    def direction(self) -> float:
        """Degrees from x towards y, in (−180, 180]."""
        return degrees(atan2(self.per_row, ROW_SPACING * self.per_column))

    @property
    def unit(self) -> tuple[float, float]:
        """k/|k|."""
        size = self.wavenumber
        return ROW_SPACING * self.per_column / size, self.per_row / size

    def along(self, ux: Value, uy: Value) -> Value:
        """Component of a vector along k: p of a displacement, u_y for k along y."""
        x, y = self.unit
        return x * ux + y * uy

    def across(self, ux: Value, uy: Value) -> Value:
        """Component of a vector along ẑ × k: q of a displacement, −u_x for k along y."""
        x, y = self.unit
        return x * uy - y * ux

    @property
    def axis(self) -> str | None:
        """ "x" or "y" when the wave runs along it, up or down; None in between."""
        return "y" if self.per_column == 0 else "x" if self.per_row == 0 else None

    def snapped(self, rows: int, columns: int) -> "WaveVector":
        """The nearest one that a periodic cell holds."""
        return WaveVector(snapped(self.per_column, columns), snapped(self.per_row, rows))


def snapped(advance: float, count: int) -> float:
    """The 2πk/count next to a phase advance."""
    return 2 * pi * round(advance * count / (2 * pi)) / count


def zone_edge(direction: float) -> float:
    """ξ at which the first Brillouin zone ends in a direction (degrees): π along y, 2π/√3 along x.

    Beyond it a wave vector names a wave that a shorter one names too.
    """
    return pi / max(abs(cos(radians(direction - edge))) for edge in _EDGES)
