"""Table of values for single spheres of a crystal, by the number of their place in the lattice.

A table has densities, radii and stiffness factors. The factors s of two spheres give the factor of their contact,

    c = 2 s_i s_j/(s_i + s_j),    with a wall c = s_i

as for two springs in series, in the same way as E* follows from the moduli of two materials. The factor scales the
force of the law at every overlap (`granular_lmp.crystal.stiffnesses`).

A table is represented by the name of its file, ``spheres-0123456789abcdef.csv``, which depends only on the values.
Scenes with the same values are therefore equal, and a scene file can be read back if this file lies beside it.
"""

import hashlib
from collections.abc import Iterator, Mapping
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.blocks import blocks
from granular_lmp.errors import CrystalError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
SITE = "sphere"  # column with the number of the place in the lattice, from 0
STIFFNESSES = ("normal_stiffness", "shear_stiffness")
HEADS = {
    SITE: SITE,
    "density": "density_kg/m3",
    "radius": "radius_m",
    **{each: each for each in STIFFNESSES},
}
_DIGITS = 16  # number of digits of the digest in a name
PATTERN = rf"spheres-[0-9a-f]{{{_DIGITS}}}\.csv"


class SphereTable(str):
    """Values for single spheres; as a string, the name of the file with these values, or "" for an empty table.

    Attributes
    ----------
    columns : mapping of str to array
        Values by the names of `HEADS`, in SI units, nan where a sphere has the value of the scene. Without the column
        ``sphere`` there is one row for each place, in the order of the lattice.
    said : str
        Value that the user wrote for the table.
    """

    columns: Mapping[str, Floats]
    said: str

    @classmethod
    def of(cls, columns: Mapping[str, Any], said: str = "") -> Self:
        """Return the table of these columns."""
        arrays = {name: np.array(columns[name], dtype=np.float64) for name in HEADS if name in columns}
        if SITE in arrays:
            order = np.argsort(arrays[SITE], kind="stable")
            arrays = {name: values[order] for name, values in arrays.items()}
        digest = hashlib.sha256()
        for name, values in arrays.items():
            values.setflags(write=False)
            digest.update(f"{name} {len(values)} ".encode() + values.astype("<f8").tobytes())
        table = cls(f"spheres-{digest.hexdigest()[:_DIGITS]}.csv" if arrays else "")
        table.columns, table.said = arrays, said or str(table)
        return table

    def __deepcopy__(self, _: Any) -> Self:
        return self  # it never changes

    @property
    def factors(self) -> bool:
        """True if spheres have factors of stiffness."""
        return any(name in self.columns for name in STIFFNESSES)

    def values(self, name: str, count: int, otherwise: float) -> Floats:
        """Return the values of a column for all places of a lattice, (count,), with `otherwise` for missing values.

        Raises
        ------
        CrystalError
            If the table does not fit a lattice with this number of places.
        """
        found = np.full(count, otherwise)
        if name not in self.columns:
            return found
        sites, given = self.sites(count), self.columns[name]
        there = np.isfinite(given)
        found[sites[there]] = given[there]
        return found

    def levels(self, count: int) -> tuple[Floats, Integers]:
        """Return the distinct pairs of factors, (L, 2), (1, 1) first, and the index (count,) of each place's pair."""
        both = np.stack([self.values(name, count, 1.0) for name in STIFFNESSES], axis=1)
        plain = (both == 1).all(axis=1)
        others, which = np.unique(both[~plain], axis=0, return_inverse=True)
        found = np.zeros(count, dtype=np.int64)
        found[~plain] = 1 + which.reshape(-1)
        return np.concatenate([np.ones((1, 2)), others]), found

    def sites(self, count: int) -> Integers:
        """Return the place of each row in a lattice of `count` places; CrystalError if the table does not fit."""
        rows = len(next(iter(self.columns.values())))
        if SITE not in self.columns:
            if rows != count:
                raise CrystalError(
                    f"packing.table = {self.said!r}: {rows} rows: must be {count}, one for each place of the lattice, "
                    f"or the table must have a column {SITE} with numbers of places, counted from 0"
                )
            return np.arange(count)
        sites = self.columns[SITE].astype(np.int64)
        if rows and sites[-1] >= count:
            raise CrystalError(
                f"packing.table = {self.said!r}: {SITE} = {sites[-1]}: must be from 0 to {count - 1}, a place of the "
                "lattice"
            )
        return sites

    def extremes(self, name: str) -> list[float]:
        """Return the smallest and the largest value of a column; [] if there is none."""
        given = self.columns.get(name, np.empty(0))
        given = given[np.isfinite(given)]
        return [float(given.min()), float(given.max())] if len(given) else []

    def differing(self, **declared: float) -> dict[str, float]:
        """Return the first value of each named column that differs from the declared value, by name."""
        found: dict[str, float] = {}
        for name, value in declared.items():
            given = self.columns.get(name, np.empty(0))
            other = given[np.isfinite(given) & (given != value)]
            found |= {name: float(other[0])} if len(other) else {}
        return found

    def pieces(self) -> Iterator[str]:
        """Yield the text of the file in pieces; a table that is read from this text has the same name."""
        yield ",".join(HEADS[name] for name in self.columns) + "\n"
        columns = [(name == SITE, values) for name, values in self.columns.items()]
        for block in blocks(len(columns[0][1])):
            cells = [_cells(values[block], whole=whole) for whole, values in columns]
            yield "".join(f"{','.join(row)}\n" for row in zip(*cells, strict=True))


def _cells(values: Floats, *, whole: bool) -> list[str]:
    """Return numbers as text that reads back to the last bit; "" for nan."""
    if whole:
        return [str(each) for each in values.astype(np.int64).tolist()]
    return ["" if each != each else repr(each) for each in values.tolist()]


NO_TABLE = SphereTable.of({})
