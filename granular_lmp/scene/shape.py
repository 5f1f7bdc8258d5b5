"""How large a packing must be for its wave: rows, columns and ends that are left to us.

What costs time is particles and steps, so the fewest spheres that give the same answer are taken. A plane wave along y
moves all spheres of a row alike: 3 columns, the fewest that LAMMPS does right, stand for any number. Between fixed ends
the walls must be farther from the centre than the wave runs; a periodic cell has none, but carries phase advances of
2πk/rows and 2πk/columns only.
"""

from dataclasses import dataclass
from math import ceil, floor
from typing import Literal

from granular_lmp.crystal.lattices import Shape
from granular_lmp.crystal.wavevector import WaveVector, snapped
from granular_lmp.scene.schema import AUTO

# A long wave of the L mode runs ½ row per τ (Ω = sin(ξ/2)); no branch of the lattice is faster.
FASTEST_ROWS_PER_TAU = 0.5
FEWEST_COLUMNS = 3
# A periodic cell that is "auto" is the smallest whose 2πk/N is this near to the phase advance, rad.
SNAP = 1e-3
LARGEST_CELL = 200  # rows or columns, beyond those that an envelope takes
EXACT = 1e-12  # rad: rounding of 2πk/N

Auto = Literal["auto"]


@dataclass(frozen=True)
class Room:
    """What the envelope of a wave takes: rows between walls, rows and columns of a periodic cell; has it a length."""

    strip: float = 0.0
    rows: float = 0.0
    columns: float = 0.0
    along: bool = False


NO_ROOM = Room()


def decide(
    rows: int | Auto,
    columns: int | Auto,
    ends: str,
    vector: WaveVector,
    duration: float,
    *,
    room: Room = NO_ROOM,
    driven: bool = False,
) -> Shape:
    """What the declared rows, columns and ends come to.

    ``columns = "auto"`` is 3, the fewest that LAMMPS does right, as the spheres of a row all move alike in a plane wave
    along y; in another direction the fewest that carry the wave to 1e-3. ``rows = "auto"`` is, between fixed ends, the
    fewest whose walls the centre does not hear, and in a periodic cell the fewest that carry the wave to 1e-3. ``ends =
    "auto"`` is what the number of rows allows; where that is auto too, a periodic cell if one with fewer rows than the
    strip carries the wave exactly, else fixed ends; a wave that is not along y has a periodic cell, a driven one and a
    packet along y have ends.

    Parameters
    ----------
    rows, columns, ends
        As declared.
    vector : WaveVector
    duration : float
        τ.
    room : Room
    driven : bool
        Whether the first row is the source.
    """
    fewest_rows, fewest_columns = ceil(room.rows), max(FEWEST_COLUMNS, ceil(room.columns))
    quiet = max(quiet_rows(duration, driven=driven), 2 * ceil((room.strip - 1) / 2) + 1)
    even = range(max(4, fewest_rows + fewest_rows % 2), fewest_rows + LARGEST_CELL + 1, 2)
    if ends == AUTO and driven:
        ends = "fixed"
    if ends == AUTO and vector.axis != "y":
        ends = "periodic"
    if ends == AUTO and rows != AUTO:
        ends = "fixed" if rows % 2 else "periodic"
    if ends == AUTO and room.along:
        ends = "fixed"
    if ends == AUTO:
        cell = smallest_cell(vector.per_row, EXACT, even)
        exact = abs(snapped(vector.per_row, cell) - vector.per_row) <= EXACT
        ends = "periodic" if exact and cell < quiet else "fixed"
        if ends == "periodic":
            rows = cell
    if rows == AUTO:
        rows = quiet if ends == "fixed" else smallest_cell(vector.per_row, SNAP, even)
    if columns == AUTO:
        columns = smallest_cell(vector.per_column, SNAP, range(fewest_columns, fewest_columns + LARGEST_CELL + 1))
    return Shape(int(rows), int(columns), ends)


def echo_time(rows: int, *, driven: bool = False) -> float:
    """τ until which the centre of a strip of this many rows does not hear its walls.

    The wall disturbs the wave from τ = 0 on and the disturbance runs at most ½ row per τ. Ahead of that front the
    lattice response falls like an Airy function of width d^{1/3} rows after d rows; 3.5 widths ahead it is below 1e-6
    of the wave. Of a driven row the centre hears the echo from the other end, which has come all that way first.
    """
    distance = (rows - 1) // 2 + (rows - 1 if driven else 0)
    return max(0.0, distance - 3.5 * distance ** (1 / 3)) / FASTEST_ROWS_PER_TAU


def quiet_rows(duration: float, *, driven: bool = False) -> int:
    """Fewest rows, an odd number, whose `echo_time` is at least the duration (τ)."""
    share = 3 if driven else 1
    rows = 2 * ceil(FASTEST_ROWS_PER_TAU * duration / share) + 1
    while echo_time(rows, driven=driven) < duration:
        # the missing distance, of which a part is lost again to the wider front
        rows += 2 * max(1, floor(FASTEST_ROWS_PER_TAU * (duration - echo_time(rows, driven=driven)) / share))
    return max(rows, 5)


def smallest_cell(advance: float, tolerance: float, counts: range) -> int:
    """The first of these numbers of rows (columns) with a 2πk/count this near to a phase advance; else the nearest."""

    def distance(count: int) -> float:
        return abs(snapped(advance, count) - advance)

    return next((count for count in counts if distance(count) <= tolerance), None) or min(counts, key=distance)
