"""How large a packing must be for its wave: rows, columns and ends that are left to us.

What costs time is particles and steps, so the fewest spheres that give the same answer are taken. A plane wave along y
moves all spheres of a row alike: 3 columns, the fewest that LAMMPS does right, stand for any number. Between fixed ends
the walls must be farther from the centre than the wave runs; a periodic cell has none, but carries 2πk/rows only.
"""

from dataclasses import dataclass
from math import ceil, floor, pi
from typing import Literal

from granular_lmp.fields import AUTO

# A long wave of the L mode runs ½ row per τ (Ω = sin(ξ/2)); no branch of the lattice is faster.
FASTEST_ROWS_PER_TAU = 0.5
FEWEST_COLUMNS = 3
# A periodic cell of rows = "auto" is the smallest whose 2πk/N is this near to the wave number, rad per row.
SNAP = 1e-3
LARGEST_CELL = 200
EXACT = 1e-12  # rad per row: rounding of 2πk/N

Auto = Literal["auto"]


@dataclass(frozen=True)
class Shape:
    """Rows, columns and ends of a packing, all decided."""

    rows: int
    columns: int
    ends: str

    @property
    def centre_row(self) -> int:
        """Row n = 0 of the wave, counted from 0."""
        return (self.rows - 1) // 2

    @property
    def spheres(self) -> int:
        """How many there are."""
        return self.rows * self.columns


def decide(rows: int | Auto, columns: int | Auto, ends: str, wavenumber: float, duration: float) -> Shape:
    """What the declared rows, columns and ends come to for a wave number (rad per row) and a duration (τ).

    ``columns = "auto"`` is 3, the fewest that LAMMPS does right, as the spheres of a row all move alike in a plane
    wave. ``rows = "auto"`` is, between fixed ends, the fewest whose walls the centre does not hear, and in a periodic
    cell the fewest that carry the wave number to 1e-3. ``ends = "auto"`` is what the number of rows allows; where that
    is auto too, a periodic cell if one with fewer rows than the strip carries the wave number exactly, else fixed ends.
    """
    columns = FEWEST_COLUMNS if columns == AUTO else columns
    if ends == AUTO and rows != AUTO:
        ends = "fixed" if rows % 2 else "periodic"
    if ends == AUTO:
        cell = smallest_cell(wavenumber, EXACT)
        exact = abs(snapped(wavenumber, cell) - wavenumber) <= EXACT
        ends = "periodic" if exact and cell < quiet_rows(duration) else "fixed"
        if ends == "periodic":
            rows = cell
    if rows == AUTO:
        rows = quiet_rows(duration) if ends == "fixed" else smallest_cell(wavenumber, SNAP)
    return Shape(int(rows), int(columns), ends)


def echo_time(rows: int) -> float:
    """τ until which the centre of a strip of this many rows does not hear its walls.

    The wall disturbs the wave from τ = 0 on and the disturbance runs at most ½ row per τ. Ahead of that front the
    lattice response falls like an Airy function of width d^{1/3} rows after d rows; 3.5 widths ahead it is below 1e-6
    of the wave.
    """
    distance = (rows - 1) // 2
    return max(0.0, distance - 3.5 * distance ** (1 / 3)) / FASTEST_ROWS_PER_TAU


def quiet_rows(duration: float) -> int:
    """Fewest rows, an odd number, whose `echo_time` is at least the duration (τ)."""
    rows = 2 * ceil(FASTEST_ROWS_PER_TAU * duration) + 1
    while echo_time(rows) < duration:
        # the missing distance, of which a part is lost again to the wider front
        rows += 2 * max(1, floor(FASTEST_ROWS_PER_TAU * (duration - echo_time(rows))))
    return max(rows, 5)


def smallest_cell(wavenumber: float, tolerance: float) -> int:
    """Fewest rows, even and at most 200, of a periodic cell with a 2πk/rows this near; else those of the nearest."""
    cells = range(4, LARGEST_CELL + 1, 2)
    distance = {rows: abs(snapped(wavenumber, rows) - wavenumber) for rows in cells}
    return next((rows for rows in cells if distance[rows] <= tolerance), min(cells, key=distance.__getitem__))


def snapped(wavenumber: float, rows: int) -> float:
    """The 2πk/rows next to a wave number."""
    return 2 * pi * round(wavenumber * rows / (2 * pi)) / rows
