"""Size of a packing: rows, columns and ends that a scene leaves to "auto".

The time of a run is proportional to spheres times steps, so "auto" takes the fewest spheres with the same result. A
plane wave along y moves all spheres of a row alike, so the fewest columns that LAMMPS simulates correctly are enough.
Between fixed ends the walls must be farther from the centre than the wave travels; a periodic cell has no walls, but
carries only phase advances of 2πk/rows and 2πk/columns.
"""

from math import ceil, floor

from granular_lmp.crystal.lattice import FASTEST_IN_PLANE
from granular_lmp.crystal.lattices import HELD, HEXAGONAL, PERIODIC, QUIET, Lattice, Shape
from granular_lmp.crystal.wavevector import WaveVector, snapped
from granular_lmp.frozen import dataclass
from granular_lmp.scene.schema import AUTO, Auto
from granular_lmp.scene.sections import Packing

# For lattices of one layer; `Lattice.fastest` is for any lattice
FASTEST_ROWS_PER_TAU = FASTEST_IN_PLANE
# rad: an "auto" periodic cell is the smallest with a 2πk/N this close to the phase advance
SNAP = 1e-3
LARGEST_CELL = 200  # rows or columns, in addition to those of an envelope
EXACT = 1e-12  # rad: rounding of 2πk/N


@dataclass(frozen=True)
class Room:
    """Room for the envelope of a wave: rows between walls, rows and columns of a periodic cell.

    `along` is true if the envelope has a length.
    """

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
    lattice: Lattice = HEXAGONAL,
    first: str = AUTO,
    last: str = AUTO,
    sides: str = PERIODIC,
    layers: int | Auto = 1,
) -> Shape:
    """Return rows, columns and faces of a packing with every "auto" decided.

    ``columns = "auto"`` or 1 means `Lattice.fewest_columns` for a plane wave along y; in another direction it means the
    fewest that carry the wave to 1e-3 rad. ``rows = "auto"`` means, between fixed ends, the fewest rows whose echo
    reaches the centre after the run, and in a periodic cell the fewest that carry the wave to 1e-3 rad. ``ends =
    "auto"`` means fixed if `first` or `last` is declared; otherwise it follows from the number of rows. If that is
    "auto" too, the cell is periodic if it carries the wave exactly with fewer rows than the strip, and has fixed ends
    otherwise. A wave that is not along y gets a periodic cell; a driven wave and a packet along y get fixed ends.

    Parameters
    ----------
    rows, columns, ends
        As declared.
    vector : WaveVector
        Declared wave vector.
    duration : float
        Duration of the run, τ.
    room : Room
        Room for the envelope.
    driven : bool
        True if the first row is the source.
    lattice : Lattice
    first, last, sides
        Faces as declared.
    layers
        As declared; "auto" is 1, or `Lattice.fewest_layers` in a crystal that is periodic along z.

    Returns
    -------
    Shape
    """
    fewest_rows, fewest_columns = ceil(room.rows), max(lattice.fewest_columns, ceil(room.columns))
    fewest_columns += -fewest_columns % lattice.column_period
    quiet = max(quiet_rows(duration, lattice.fastest, driven=driven), 2 * ceil((room.strip - 1) / 2) + 1)
    period = lattice.row_period
    least = max(4, fewest_rows)
    cells = range(least + -least % period, fewest_rows + LARGEST_CELL + 1, period)
    if ends == AUTO and (driven or (first, last) != (AUTO, AUTO)):
        ends = "fixed"
    if ends == AUTO and vector.axis != "y":
        ends = "periodic"
    if ends == AUTO and rows != AUTO:
        ends = "fixed" if rows % 2 else "periodic"
    if ends == AUTO and room.along:
        ends = "fixed"
    if ends == AUTO:
        cell = smallest_cell(vector.per_row, EXACT, cells)
        exact = abs(snapped(vector.per_row, cell) - vector.per_row) <= EXACT
        ends = "periodic" if exact and cell < quiet else "fixed"
        if ends == "periodic":
            rows = cell
    if rows == AUTO:
        rows = quiet if ends == "fixed" else smallest_cell(vector.per_row, SNAP, cells)
    if columns == AUTO and not lattice.sheet:
        columns = 1
    # Scenes of earlier releases have 1 column for a plane wave, whose columns are all alike
    if columns == 1 and sides == PERIODIC:
        columns = lattice.fewest_columns
    if columns == AUTO:
        columns = smallest_cell(
            vector.per_column, SNAP, range(fewest_columns, fewest_columns + LARGEST_CELL + 1, lattice.column_period)
        )
    first, last = map(_closed, (first, last))
    return Shape(int(rows), int(columns), ends, lattice, first, last, sides, _layers(layers, lattice))


def _layers(layers: int | Auto, lattice: Lattice) -> int:
    """Return the layers of a packing; "auto" is 1, or the fewest in a crystal that is periodic along z."""
    if layers != AUTO:
        return int(layers)
    return lattice.fewest_layers if lattice.solid and not lattice.film else 1


def declared_shape(packing: Packing, lattice: Lattice) -> Shape:
    """Return the shape of a packing without a wave, in which nothing is "auto"."""
    size, faces = (int(packing.rows), int(packing.columns)), (_closed(packing.first), _closed(packing.last))
    return Shape(*size, packing.ends, lattice, *faces, packing.sides, _layers(packing.layers, lattice))


def _closed(face: str) -> str:
    """Return the kind of a face; a quiet end and "auto" have a held row."""
    return HELD if face in (AUTO, QUIET) else face


def echo_time(rows: int, fastest: float = FASTEST_ROWS_PER_TAU, *, driven: bool = False) -> float:
    """Return the time τ at which the echo of the walls reaches the centre of a strip of this many rows.

    A wall disturbs the wave from τ = 0 on, and the disturbance travels at most `fastest` rows per τ. Ahead of this
    front the response of the lattice decays like an Airy function of width d^{1/3} rows after d rows; 3.5 widths ahead
    it is below 1e-6 of the wave. If the first row drives the wave, the echo comes from the other end after the wave has
    reached it.
    """
    distance = (rows - 1) // 2 + (rows - 1 if driven else 0)
    return arrival_time(distance, fastest)


def arrival_time(distance: float, fastest: float = FASTEST_ROWS_PER_TAU) -> float:
    """Return the time τ after which a disturbance arrives at a distance in rows, by the rule of `echo_time`."""
    return max(0.0, distance - 3.5 * distance ** (1 / 3)) / fastest


def quiet_rows(duration: float, fastest: float = FASTEST_ROWS_PER_TAU, *, driven: bool = False) -> int:
    """Return the fewest rows, an odd number, whose `echo_time` is at least the duration (τ)."""
    share = 3 if driven else 1
    rows = 2 * ceil(fastest * duration / share) + 1
    while echo_time(rows, fastest, driven=driven) < duration:
        # The wider front takes a part of the added distance, hence the loop
        rows += 2 * max(1, floor(fastest * (duration - echo_time(rows, fastest, driven=driven)) / share))
    return max(rows, 5)


def smallest_cell(advance: float, tolerance: float, counts: range) -> int:
    """Return the first count of rows or columns with a 2πk/count within `tolerance` of a phase advance.

    If there is none, the count with the nearest 2πk/count is returned.
    """

    def distance(count: int) -> float:
        return abs(snapped(advance, count) - advance)

    return next((count for count in counts if distance(count) <= tolerance), None) or min(counts, key=distance)
