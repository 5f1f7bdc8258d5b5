"""Wave vectors of the hexagonal lattice, as phase advances from column to column and from row to row.

Rows lie along x, columns a lattice constant a apart; rows are √3/2 a apart along y and shifted by half a column. A wave
vector k is stored as its phase advances (k_x a, (√3/2) k_y a); a periodic cell holds 2π i/columns and 2π j/rows. The
wave number is ξ = (√3/2)|k|a in every direction: rad per row for a wave along y, the paper's direction.
"""

from dataclasses import dataclass
from math import atan2, cos, degrees, hypot, pi, radians, sin, sqrt
from typing import Self, TypeVar

import numpy as np
from numpy.typing import NDArray

ROW_SPACING = sqrt(3) / 2  # in lattice constants
DIRECTIONS = {"x": 0.0, "y": 90.0}
# Directions, in degrees, of the three pairs of edges of the first Brillouin zone, each at ξ = π
_EDGES = (90.0, 30.0, -30.0)

Value = TypeVar("Value", float, NDArray[np.float64])


@dataclass(frozen=True)
class WaveVector:
    """A wave vector by its phase advances, rad.

    Attributes
    ----------
    per_column : float
        Advance k_x a along x to the next sphere of the row.
    per_row : float
        Advance (√3/2) k_y a along y to the next row.
    """

    per_column: float
    per_row: float

    @classmethod
    def of(cls, wavenumber: float, direction: float = 90.0) -> Self:
        """Return the wave vector with ξ (rad per row spacing) and a direction in degrees from x towards y."""
        quarter, rest = divmod(direction, 90.0)
        if rest == 0:  # exactly along an axis, where cos 90° would leave 6e-17
            along_x, along_y = ((1, 0), (0, 1), (-1, 0), (0, -1))[int(quarter) % 4]
            return cls(along_x * wavenumber / ROW_SPACING, along_y * wavenumber)
        angle = radians(direction)
        return cls(wavenumber * cos(angle) / ROW_SPACING, wavenumber * sin(angle))

    @property
    def components(self) -> tuple[float, float]:
        """Components (k_x, k_y) in 1/a."""
        return self.per_column, self.per_row / ROW_SPACING

    @property
    def wavenumber(self) -> float:
        """Wave number ξ, rad per row spacing."""
        return abs(self.per_row) if self.per_column == 0 else hypot(ROW_SPACING * self.per_column, self.per_row)

    @property
    def direction(self) -> float:
        """Direction in degrees from x towards y, in (−180, 180]."""
        return degrees(atan2(self.per_row, ROW_SPACING * self.per_column))

    @property
    def unit(self) -> tuple[float, float]:
        """Unit vector k/|k|."""
        size = self.wavenumber
        return ROW_SPACING * self.per_column / size, self.per_row / size

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
        """ "x" or "y" when the wave runs along it, up or down; None in between."""
        return "y" if self.per_column == 0 else "x" if self.per_row == 0 else None

    def snapped(self, rows: int, columns: int) -> "WaveVector":
        """Return the nearest wave vector of a periodic cell."""
        return WaveVector(snapped(self.per_column, columns), snapped(self.per_row, rows))


def snapped(advance: float, count: int) -> float:
    """Return the 2πk/count nearest to a phase advance."""
    return 2 * pi * round(advance * count / (2 * pi)) / count


def zone_edge(direction: float) -> float:
    """Return the ξ at which the first Brillouin zone ends in a direction (degrees): π along y, 2π/√3 along x.

    A wave vector beyond it is equivalent to a shorter one.
    """
    return pi / max(abs(cos(radians(direction - edge))) for edge in _EDGES)


def zone_path(points: int) -> NDArray[np.float64]:
    """Return wave vectors on the edges Γ–M and M–K of an irreducible twelfth of the zone, (2 points, 2), in 1/a."""
    m, k = np.array([pi, pi / sqrt(3)]), np.array([4 * pi / 3, 0.0])
    share = np.linspace(0, 1, points)[:, None]
    return np.vstack([share * m, m + share * (k - m)])
