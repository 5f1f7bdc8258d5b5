"""Places in a packing, for sources, monitors and strikers: whole rows, or single spheres by row and column."""

from collections.abc import Iterator, Sequence
from dataclasses import field
from typing import Any

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import Shape
from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.schema import ArrayRule, Interval, shown

Rows = Sequence[int]
Spheres = Sequence[tuple[int, int]]
_ANY = Interval(0, 10_000_000)  # rows or columns
_INDICES = ("row", "column", "layer")


def rows_rule(meaning: str = "first and last row, counted from 0") -> ArrayRule:
    """Return the rule of a key that holds two rows."""
    return ArrayRule(int, "", meaning, _ANY, entries=("first", "last"))


def spheres_rule(meaning: str = "[row, column] of each") -> ArrayRule:
    """Return the rule of a key that holds spheres by row and column."""
    return ArrayRule(int, "", meaning, _ANY, several=True)


def places_field(rule: ArrayRule) -> Any:
    """Return a dataclass field for places; the default is none."""
    return field(default=(), metadata={"rule": rule})


LAYERS_RULE = rows_rule("first and last layer along z, counted from 0, that contain them")


@dataclass(frozen=True)
class AtPlaces:
    """Whole rows or single spheres of a packing, in all layers or some."""

    rows: Rows = places_field(rows_rule())
    spheres: Spheres = places_field(spheres_rule())
    layers: Rows = field(default=(), metadata={"rule": LAYERS_RULE}, kw_only=True)

    @property
    def places(self) -> str:
        """Rows or spheres in words."""
        return in_words(self.rows, self.spheres, self.layers)

    def rows_of(self) -> list[int]:
        """Return the first and last row of each block of rows with its spheres."""
        return list(self.rows) if self.rows else sorted({row for row, _ in self.spheres})

    def marks(self, column: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the rows and columns of its spheres; for whole rows, of one column."""
        rows = range(self.rows[0], self.rows[1] + 1) if self.rows else ()
        places = [*((row, column) for row in rows), *self.spheres]
        first, second = np.array(places, dtype=int).reshape(-1, 2).T
        return first, second

    def is_in_row(self, row: int) -> bool:
        """Return True if it has spheres in a row."""
        return self.rows[0] <= row <= self.rows[1] if self.rows else row in self.rows_of()


def counting_trouble(at: Sequence[AtPlaces], rows: int | str, columns: int | str, table: str) -> str:
    """Return an error if a table counts rows or columns that are "auto"; "" if there is none."""
    if at and isinstance(rows, str):
        return f"packing.rows = {rows!r}: must be a number with {table}, which counts rows"
    if isinstance(columns, str) and any(each.spheres for each in at):
        return f"packing.columns = {columns!r}: must be a number where {table} has single spheres"
    return ""


def in_words(rows: Rows, spheres: Spheres, layers: Rows = ()) -> str:
    """Return the places as a scene file has them: "rows = [3, 5]"."""
    here = f"rows = {list(rows)}" if rows else f"spheres = {shown([list(each) for each in spheres])}"
    return f"{here}, layers = {list(layers)}" if layers else here


def place_troubles(rows: Rows, spheres: Spheres, shape: Shape, layers: Rows | None = ()) -> Iterator[str]:
    """Yield each error of places in a packing: they must be either rows or spheres, and lie inside.

    `layers` is None if they cannot be given.
    """
    given = [name for name, value in (("rows", rows), ("spheres", spheres)) if value]
    if len(given) != 1:
        yield f"{' and '.join(given) or 'neither'} given: must be either rows or spheres"
    if rows and not 0 <= rows[0] <= rows[1] < shape.rows:
        yield f"rows = {list(rows)}: must be [first, last], from 0 to {shape.rows - 1}"
    if layers and not 0 <= layers[0] <= layers[1] < shape.layers:
        yield f"layers = {list(layers)}: must be [first, last], from 0 to {shape.layers - 1}"
    if spheres and shape.layers > 1 and not layers:
        top = shape.layers - 1
        cure = "must be left out" if layers is None else f"needs layers, for instance layers = [{top}, {top}],"
        yield (
            f"{in_words(rows, spheres)}: {cure} in a crystal of several layers, each of which "
            "has a sphere at a row and a column"
        )
    for row, column in spheres:
        if row >= shape.rows or column >= shape.columns:
            yield (
                f"sphere [{row}, {column}]: must be [row, column], from [0, 0] to [{shape.rows - 1}, "
                f"{shape.columns - 1}]"
            )


def place_of(crystal: ase.Atoms, sphere: int) -> list[int]:
    """Return the row and the column of a sphere."""
    return [int(crystal.arrays[name][sphere]) for name in ("row", "column")]


def spheres_at(rows: Rows, spheres: Spheres, crystal: ase.Atoms, role: str, layers: Rows = ()) -> NDArray[np.int64]:
    """Return the indices of the spheres at some places of a crystal, ascending.

    Parameters
    ----------
    rows : (first, last)
        All spheres of these rows and of those between; or
    spheres : sequence of (row, column)
    crystal : ase.Atoms
        With the arrays ``row`` and ``column``.
    role : str
        Purpose of the places, "source" or "monitor", for the error message.
    layers : (first, last)
        Layers of a crystal with the array ``layer``; all layers if empty.

    Raises
    ------
    SceneError
        If a sphere is a vacancy, or the rows hold only vacancies.
    """
    row, column, layer = (crystal.arrays.get(name, np.zeros(len(crystal), dtype=int)) for name in _INDICES)
    inside = (layers[0] <= layer) & (layer <= layers[1]) if layers else np.ones(len(crystal), dtype=bool)
    if rows:
        chosen = np.flatnonzero((rows[0] <= row) & (row <= rows[1]) & inside)
        if not len(chosen):
            raise SceneError(f"{in_words(rows, spheres, layers)}: holds vacancies only", because="physics")
        return chosen
    index: dict[tuple[int, ...], list[int]] = {}
    for each in np.flatnonzero(inside).tolist():
        index.setdefault((int(row[each]), int(column[each])), []).append(each)
    for place in spheres:
        if tuple(place) not in index:
            raise SceneError(f"sphere {list(place)}: is a vacancy, and cannot be a {role}", because="physics")
    return np.unique([each for at in spheres for each in index[tuple(at)]])
