"""Table of single spheres, ``packing.table``: a CSV file beside the scene, or columns of numbers.

A file is read together with its scene. A run folder holds a copy whose name follows from its values
(`granular_lmp.crystal.sphere_table`).
"""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.sphere_table import HEADS, NO_TABLE, PATTERN, SITE, STIFFNESSES, SphereTable
from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.bodies import SPHERE_RULES
from granular_lmp.scene.schema import Interval, Rule, shown, unknown_key
from granular_lmp.scene.spreadsheets import LENGTHS, Quantities, numbers

Floats = NDArray[np.float64]
MOST = 1_000_000  # rows
LARGEST = 100_000_000  # bytes of a file: a row with all columns at full precision has 90
_QUANTITIES: Quantities = {
    SITE: {"": 1.0},
    "density": {"kg/m3": 1.0, "g/cm3": 1e3},
    "radius": LENGTHS,
    **{name: {"": 1.0} for name in STIFFNESSES},
}
_RULES: Mapping[str, Rule] = {
    SITE: Rule(int, "", "", Interval(0, 10_000_000)),
    "density": SPHERE_RULES["density"],
    "radius": SPHERE_RULES["radius"],
    **{name: Rule(float, "", "", Interval(1e-3, 1e3)) for name in STIFFNESSES},
}


@dataclass(frozen=True)
class TableRule(Rule):
    """Rule for a table of spheres: the name of a CSV file, or columns of numbers."""

    @property
    def allowed(self) -> str:
        """Allowed values in words."""
        return f'a file "NAME.csv" with any of the columns {",".join(HEADS.values())}, or such columns as lists in SI'

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a table."""
        columns = {name: {"type": "array", "items": rule.schema(), "maxItems": MOST} for name, rule in _RULES.items()}
        inline = {"type": "object", "properties": columns, "additionalProperties": False}
        return {"anyOf": [{"type": "string", "pattern": r"\.csv$|^$"}, inline]}

    def value(self, value: Any, key: str) -> SphereTable:
        """Return a file or columns as a table.

        Raises
        ------
        SceneError
            If the file cannot be read, or was changed although its name follows from its values; if there is no column,
            columns have different lengths, a number is not allowed, or a sphere is listed twice.
        """
        if isinstance(value, SphereTable):
            return value
        if value == "":
            return NO_TABLE
        if isinstance(value, str) and value.endswith(".csv"):
            return _read(value, key)
        if isinstance(value, Mapping):
            return _of_lists(value, key)
        raise SceneError(f"{key} = {shown(value)}: must be {self.allowed}")


TABLE_RULE = TableRule(str, "SI units", "values of single spheres, in place of those of [sphere]")


def located(tables: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the tables of a scene; the name of the sphere table becomes relative to the current folder."""
    packing = tables.get("packing")
    name = packing.get("table") if isinstance(packing, dict) else None
    if not isinstance(packing, dict) or not isinstance(name, str) or not name or isinstance(name, SphereTable):
        return tables
    return tables | {"packing": {**packing, "table": str(folder / name)}}


def _read(name: str, key: str) -> SphereTable:
    said = f"{key} = {shown(name)}"
    lines, columns = numbers(Path(name), _QUANTITIES, {}, said, largest=LARGEST, most=MOST)
    found = _checked(columns, said, lambda row: f"line {lines[row]}")
    table = SphereTable.of(found, name)
    if re.fullmatch(PATTERN, Path(name).name) and Path(name).name != table:
        raise SceneError(
            f"{said}: was changed since it was written (its values now have the name {str(table)!r}); give your own "
            "table another name"
        )
    return table


def _of_lists(value: Mapping[str, Any], key: str) -> SphereTable:
    for name in value:
        if name not in HEADS:
            raise SceneError(unknown_key(f"{key}.{name}", str(name), HEADS))
    columns = {}
    for name, given in value.items():
        numbers_alone = isinstance(given, list | tuple | range) and not {*map(type, given)} - {int, float}
        if not numbers_alone:
            raise SceneError(f"{key}.{name} = {shown(given)}: must be a list of numbers, one for each sphere")
        columns[name] = np.array(given, dtype=np.float64)
    if len({len(each) for each in columns.values()}) > 1:
        held = ", ".join(f"{name} has {len(each)}" for name, each in columns.items())
        raise SceneError(f"{key}: {held}; all columns must have a number for each sphere")
    count = max(map(len, columns.values()), default=0)
    if count > MOST:
        raise SceneError(f"{key}: {count} rows: must be at most {MOST}")
    return SphereTable.of(_checked(columns, key, lambda row: f"[{row}]"), key)


def _checked(columns: Mapping[str, Floats], said: str, place: Callable[[int], str]) -> Mapping[str, Floats]:
    """Return the columns after checks; `place` returns the place of a row in words.

    Raises
    ------
    SceneError
        If a sphere has no value, a number is not allowed, or a sphere is listed twice.
    """
    count = max(map(len, columns.values()), default=0)
    if not set(columns) - {SITE} or not count:
        raise SceneError(f"{said}: must have a row and one of the columns {', '.join([*HEADS.values()][1:])}")
    for name, values in columns.items():
        interval = _RULES[name].interval
        assert interval is not None  # each sphere has one
        inside = (values >= interval.low) & (values <= interval.high)
        inside &= values == np.floor(values) if name == SITE else True
        inside |= np.isnan(values) & (name != SITE)
        if not inside.all():
            worst = int(np.argmin(inside))
            raise SceneError(
                f"{said}: {place(worst)}: {HEADS[name]} = {values[worst]:.16g}: must be {_RULES[name].allowed}"
            )
    sites = columns.get(SITE, np.arange(count))
    order = np.argsort(sites, kind="stable")
    twice = np.flatnonzero(np.diff(sites[order]) == 0)
    if len(twice):
        again = order[twice[0] + 1]
        raise SceneError(
            f"{said}: {place(again)}: {SITE} = {sites[again]:.0f}: is there twice, in {place(order[twice[0]])} too; "
            "must be there once"
        )
    return columns
