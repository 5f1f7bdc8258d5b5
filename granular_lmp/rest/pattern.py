"""Rows of different densities that repeat: the cell of the modes of such a crystal."""

from collections.abc import Sequence

import numpy as np

from granular_lmp.crystal.disorder import Inclusion
from granular_lmp.crystal.lattice import Lattice
from granular_lmp.crystal.stiffnesses import Pair
from granular_lmp.errors import SceneError
from granular_lmp.scene.schema import AUTO, shown
from granular_lmp.scene.sections import Packing

LONGEST = 6  # rows in a pattern: longer ones would have a cell of 18 branches or more
_ALLOWED = ("rows", "every", "density")
_NEEDS = "the number of a branch needs rows of different densities that repeat"


def patterned(
    lattice: Lattice,
    packing: Packing,
    density: float,
    inclusions: Sequence[Inclusion],
    pairs: Sequence[Pair],
    mode: str,
) -> Lattice:
    """Return the lattice with the shortest cell that repeats the densities and kinds of rows, the centre row first.

    Parameters
    ----------
    density : float
        Density of the sphere of the lattice, kg/m³.
    pairs : sequence of Pair
        Measured stiffnesses between two kinds of spheres.
    mode : str
        ``wave.mode``, for the error message.

    Raises
    ------
    SceneError
        If inclusions are not rows of different densities, or rows do not repeat.
    """
    for number, each in enumerate(inclusions, 1):
        default = Inclusion()
        other = [key for key, value in vars(each).items() if key not in _ALLOWED and value != getattr(default, key)]
        if other:
            raise SceneError(
                f"wave.mode = {mode!r}: {_NEEDS}, and inclusion {number} has {other[0]} = "
                f"{shown(getattr(each, other[0]))}; must be L, TR or RT, or inclusions of rows, every and density "
                "alone",
                because="not built",
            )
    if packing.rows == AUTO:
        raise SceneError(
            f"packing.rows = {packing.rows!r}: must be a number with [[inclusion]], which counts rows",
            because="not built",
        )
    rows, named = np.tile([density, 0.0], (int(packing.rows), 1)), {kind for pair in pairs for kind in pair.of}
    for number, each in enumerate(inclusions, 1):
        chosen = slice(each.rows[0], each.rows[1] + 1, each.every)
        rows[chosen] = density if each.density is None else each.density, number if number in named else 0
    if not np.ptp(rows, axis=0).any():
        return lattice
    length = _length(rows, lattice.row_period, periodic=packing.ends == "periodic")
    if not length:
        raise SceneError(
            f"wave.mode = {mode!r}: {_NEEDS}, and those of {len(rows)} rows do not repeat after {LONGEST} rows or fewer"
            f"{', all around the periodic cell' if packing.ends == 'periodic' else ''}; must be L, TR or RT",
            because="not built",
        )
    densities, kinds = np.roll(rows, -((len(rows) - 1) // 2), axis=0)[:length].T
    return lattice.patterned(densities.tolist(), kinds.astype(int).tolist(), pairs)


def _length(rows: np.ndarray, period: int, *, periodic: bool) -> int:
    """Return the number of rows, a multiple of a period, after which all repeat; 0 if it exceeds `LONGEST`."""
    for length in range(period, min(LONGEST, len(rows) - 1) + 1, period):
        if np.array_equal(rows[length:], rows[:-length]) and not (periodic and len(rows) % length):
            return length
    return 0
