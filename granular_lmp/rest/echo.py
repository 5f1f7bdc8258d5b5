"""Time at which an echo of the faces reaches some spheres, by the shortest path of waves."""

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
    """Return the time τ at which an echo of the faces may reach a block: `arrival_time` of the shortest path.

    The faces disturb a wave that fills the crystal from τ = 0 on. Waves of sources, strikers and a driven row run to a
    face and from there to the block. A face does not reflect waves that begin at it. `quiet` ends reflect no waves; but
    an end that a source moves is not quiet, and reflects the waves of other spheres.

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
        Infinite if there is no echo.
    """
    ways: list[float] = [*_from_sides(*block, pushed, shape, form)]
    if not shape.along_y:
        ways += _from_ends(block[0], pushed, shape, form, quiet)
    return arrival_time(min(ways), shape.lattice.fastest) if ways else inf


def _from_ends(
    rows: Sequence[int], pushed: Sequence[AtPlaces], shape: Shape, form: Form, quiet: Collection[str]
) -> list[int]:
    """Return the lengths of the paths of waves to some rows by way of an end, in rows."""
    end = shape.rows - 1
    beyond = {0: rows[0], end: end - rows[1]}  # rows from an end to the block
    of_wave = beyond if form.fills else {end: end + beyond[end]} if form.driven else {}
    still = {wall for wall, name in ((0, "first"), (end, "last")) if name in quiet}
    return [way for wall, way in of_wave.items() if wall not in still] + [
        abs(row - wall) + beyond[wall]
        for wall in beyond
        if wall not in still or any(each.is_in_row(wall) for each in pushed)
        for each in pushed
        if not (each.rows and each.is_in_row(wall))  # rows from the end to the place where the waves begin
        for row in each.rows_of()
        if row != wall
    ]


def _from_sides(
    rows: Sequence[int], columns: Sequence[int], pushed: Sequence[AtPlaces], shape: Shape, form: Form
) -> Iterator[float]:
    """Yield the lengths of the paths of waves to a block by way of a side, in rows; whole rows reach both sides."""
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
