"""Lattices of equal spheres that touch: primitive vectors and positions, in units of the distance of two spheres.

Rows are stacked along y, the usual direction of a wave, and layers along z. The first two vectors of a lattice in space
lie in a layer. `row` is the distance of two rows; wave numbers are in rad per row.

| lattice, orientation | direction of y | a layer is |
|---|---|---|
| hcp "c" | the hexagonal axis: rows are close-packed layers, AB | rectangular |
| hcp "[1-100]" | between two contacts | close-packed |
| fcc "[001]" | a fourfold axis: rows are square layers | rectangular, (110) |
| fcc "[111]" | a threefold axis: rows are close-packed layers, ABC | rectangular, (11-2) |
| fcc "[110]" | a line of contacts | square, (001) |
| fcc "[11-2]" | between two contacts | close-packed, (111) |
| cubic "[001]" | a line of contacts | square |
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory.errors import TheoryError

Floats = NDArray[np.float64]
_ROOT = {n: float(np.sqrt(n)) for n in (2, 3, 6)}


class Lattice(NamedTuple):
    """A lattice, in units of the distance of two spheres.

    Attributes
    ----------
    vectors : (d, 3) primitive vectors.
    basis : (B, 3) positions in a cell.
    row : distance of two rows.
    layer : distance of two layers; 0 for a plane lattice. Rows of one layer may differ in height by less than that.
    """

    vectors: Floats
    basis: Floats
    row: float
    layer: float

    @property
    def shift(self) -> float:
        """Return the shift along x from one row to the next, for lattices with one sphere per cell."""
        return float(self._step()[0])

    @property
    def repeats(self) -> int:
        """Return the number of rows after which the lattice repeats straight along y."""
        counts = self.row * np.outer(np.arange(1, 13), np.linalg.pinv(self.vectors)[1])
        whole = np.abs(counts - np.rint(counts)).max(axis=1) < 1e-9
        return 1 + whole.tolist().index(True)

    def rows(self, period: int) -> tuple[Floats, Floats, NDArray[np.intp]]:
        """Return vectors (d, 3), positions (B, 3) and rows (B,) of a cell for rows that repeat after a period.

        Raises TheoryError if the lattice has no cell of this many rows.
        """
        up = self.vectors[:, 1] / self.row
        counts = np.rint(up).astype(int)
        step = self._step()
        risen = int(np.rint(step[1] / self.row))
        beside = (self.basis[:, 1] / self.row) % 1 if len(self.vectors) == 3 else np.zeros(1)
        if max(np.abs(up - counts).max(), beside.max()) > 1e-9 or period % risen:
            raise TheoryError(f"a pattern of {period} rows does not fit this lattice, whose layers have other rows")
        level = self.vectors - np.multiply.outer(counts / risen, step)
        inside = level[np.linalg.norm(level, axis=1) > 1e-9]
        places = (step * np.arange(period // risen)[:, None, None] + self.basis).reshape(-1, 3)
        return np.vstack([inside, period // risen * step]), places, np.rint(places[:, 1] / self.row).astype(np.intp)

    def film(self, layers: int) -> tuple[Floats, Floats]:
        """Return the two vectors of a film of `layers` layers, and the positions in its cell, the lowest first."""
        height = layers * self.layer * (1 - 1e-9)
        stacks = np.arange(np.ceil(height / self.vectors[2, 2]))
        places = (stacks[:, None, None] * self.vectors[2] + self.basis).reshape(-1, 3)
        inside = places[places[:, 2] < height]
        return self.vectors[:2], inside[np.argsort(inside[:, 2], kind="stable")]

    def _step(self) -> Floats:
        """Return the primitive vector that rises by the fewest rows."""
        rising = self.vectors[np.abs(self.vectors[:, 1]) > 1e-9]
        return np.asarray(rising[np.argmin(np.abs(rising[:, 1]))])


def _lattice(row: float, vectors: Any, basis: Any = ((0.0, 0.0, 0.0),), layer: float | None = None) -> Lattice:
    found = np.asarray(vectors, dtype=float)
    height = float(found[2, 2]) if len(found) == 3 else 0.0
    return Lattice(found, np.asarray(basis, dtype=float), row, height if layer is None else layer)


_HIGH = _ROOT[6] / 3  # distance of two close-packed layers
_TRIANGLE = [0.5, _ROOT[3] / 2, 0.0]
# By name and orientation; a plane lattice has no orientation
LATTICES: dict[tuple[str, str], Lattice] = {
    ("chain", ""): _lattice(1.0, [[0, 1, 0]]),
    ("square", ""): _lattice(1.0, [[1, 0, 0], [0, 1, 0]]),
    ("hexagonal", ""): _lattice(_ROOT[3] / 2, [[1, 0, 0], _TRIANGLE]),
    ("honeycomb", ""): _lattice(1.5, [[_ROOT[3], 0, 0], [_ROOT[3] / 2, 1.5, 0]], [[0, 0, 0], [_ROOT[3] / 2, -0.5, 0]]),
    ("cubic", "[001]"): _lattice(1.0, np.eye(3)),
    ("fcc", "[001]"): _lattice(_ROOT[2] / 2, [[1, 0, 0], [0, _ROOT[2], 0], [0.5, _ROOT[2] / 2, 0.5]], layer=1.0),
    ("fcc", "[111]"): _lattice(_HIGH, [[1, 0, 0], [0, 3 * _HIGH, 0], [0.5, _HIGH, _ROOT[3] / 6]], layer=_ROOT[3] / 2),
    ("fcc", "[110]"): _lattice(1.0, [[1, 0, 0], [0, 1, 0], [0.5, 0.5, _ROOT[2] / 2]]),
    ("fcc", "[11-2]"): _lattice(_ROOT[3] / 2, [[1, 0, 0], _TRIANGLE, [0.5, _ROOT[3] / 6, _HIGH]]),
    ("hcp", "c"): _lattice(
        _HIGH,
        [[1, 0, 0], [0, 2 * _HIGH, 0], [0.5, 0, _ROOT[3] / 2]],
        [[0, 0, 0], [0.5, _HIGH, _ROOT[3] / 6]],
        layer=_ROOT[3] / 2,
    ),
    ("hcp", "[1-100]"): _lattice(
        _ROOT[3] / 2, [[1, 0, 0], _TRIANGLE, [0, 0, 2 * _HIGH]], [[0, 0, 0], [0.5, _ROOT[3] / 6, _HIGH]], layer=_HIGH
    ),
}
