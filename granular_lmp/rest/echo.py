"""The time at which an echo of the faces reaches some spheres, by the shortest way that waves have."""

from collections.abc import Collection, Iterator, Sequence
from math import hypot, inf

from granular_lmp.crystal.lattices import Shape
from granular_lmp.rest.shape import arrival_time
from granular_lmp.scene.forms import Form
from granular_lmp.scene.places import AtPlaces


def echo_at(
    block: tuple[Sequence[int], Sequence[int]],
    pushed: Sequence[AtPlaces],
    shape: Shape,
    *,
    form: Form,
    quiet: Collection[str],
) -> float:
    """Return the time τ at which an echo of the faces may reach a block, by the shortest way and `arrival_time`.

    A wave that fills the crystal is disturbed by the faces from τ = 0 on. Waves of sources, of strikers and of a driven
    row run to a face and from there to the block. Those that begin at a face are not sent back by it. `quiet` ends send
    back no waves, but an end that a source moves is not quiet, and sends back those of other spheres.

    Parameters
    ----------
    block : (first, last) row and (first, last) column
    pushed : sequence
        Sources and strikers.
    shape : Shape
    form : Form
        How the wave begins.
    quiet : collection of str
        The quiet ends, "first" and "last".

    Returns
    -------
    float
        Infinite if no echo comes.
    """
    ways: list[float] = [*_from_sides(*block, pushed, shape, form)]
    if not shape.along_y:
        ways += _from_ends(block[0], pushed, shape, form, quiet)
    return arrival_time(min(ways), shape.lattice.fastest) if ways else inf


def _from_ends(
    rows: Sequence[int], pushed: Sequence[AtPlaces], shape: Shape, form: Form, quiet: Collection[str]
) -> list[int]:
    """Return the ways of waves to rows by an end, in rows."""
    end = shape.rows - 1
    beyond = {0: rows[0], end: end - rows[1]}  # rows from an end to these
    of_wave = beyond if form.fills else {end: end + beyond[end]} if form.driven else {}
    still = {wall for wall, name in ((0, "first"), (end, "last")) if name in quiet}
    return [way for wall, way in of_wave.items() if wall not in still] + [
        abs(row - wall) + beyond[wall]
        for wall in beyond
        if wall not in still or any(each.is_in_row(wall) for each in pushed)
        for each in pushed
        if not (each.rows and each.is_in_row(wall))  # these rows reach from the end to where their waves begin
        for row in each.rows_of()
        if row != wall
    ]


def _from_sides(
    rows: Sequence[int], columns: Sequence[int], pushed: Sequence[AtPlaces], shape: Shape, form: Form
) -> Iterator[float]:
    """Yield the ways of waves to a block by a side, in rows; whole rows reach from side to side."""
    if "sides" not in shape.faces:
        return
    side, column_width = shape.columns - 1, 1 / shape.lattice.row_spacing

    def apart(first: int, last: int) -> int:
        return 0 if shape.along_y else max(rows[0] - last, first - rows[1], 0)

    for wall, beyond in ((0, columns[0]), (side, side - columns[1])):
        if form.waves:
            yield hypot(beyond * column_width, apart(0, 0) if form.driven else 0)
        for each in pushed:
            if each.rows:
                yield hypot(beyond * column_width, apart(each.rows[0], each.rows[1]))
            for row, column in each.spheres:
                if column != wall:
                    yield hypot((abs(column - wall) + beyond) * column_width, apart(row, row))
