"""Measured points of a table: their kind, their place, their value with its error, in SI units.

A table is CSV with a head. A column is a quantity and its unit, ``frequency_MHz`` or ``frequency [MHz]``; lines that
begin with # are comments. Each row has a value in one of

    frequency_Hz          of a wave: with wavenumber_rad/row or wavelength_m, direction_deg, and branch
    second_harmonic_m     of a wave of amplitude_m, time_s after its start: with wavenumber or wavelength
    arrival_s             of the front of an impact at a row, and in a sheet a column
    speed_m/s             of that front from a row (and column) to to_row (and to_column)

and, if it has one, its standard error: in ``error_…`` with a unit of that quantity, or in ``error_%``. A branch is a
name (L, TR, RT) or a number from 1, the lowest; an empty one is that with the nearest frequency. An empty wave number
is 0, an empty direction that of the scene. Every other cell that a row needs must be filled.
"""

import csv
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import NamedTuple

import numpy as np

_PREFIXES = {"": 1.0, "k": 1e3, "M": 1e6, "G": 1e9, "m": 1e-3, "u": 1e-6, "n": 1e-9}
_LENGTHS = {f"{prefix}m": size for prefix, size in _PREFIXES.items() if size <= 1}
_TIMES = {f"{prefix}s": size for prefix, size in _PREFIXES.items() if size <= 1}
_NUMBERS = {"": 1.0}
UNITS: Mapping[str, Mapping[str, float]] = {  # each quantity has these, in SI units
    "frequency": {f"{prefix}Hz": size for prefix, size in _PREFIXES.items() if size >= 1},
    "second_harmonic": _LENGTHS,
    "arrival": _TIMES,
    "speed": {"m/s": 1.0, "km/s": 1e3},
    "wavenumber": {"rad/row": 1.0, "rad/m": 1.0, "rad/um": 1e6},
    "wavelength": _LENGTHS,
    "direction": {"deg": 1.0},
    "amplitude": _LENGTHS,
    "time": _TIMES,
    "row": _NUMBERS,
    "column": _NUMBERS,
    "to_row": _NUMBERS,
    "to_column": _NUMBERS,
}
# What each kind of point needs, and what it may have
KINDS: Mapping[str, tuple[frozenset[str], frozenset[str]]] = {
    "frequency": (frozenset(), frozenset({"branch", "wavenumber", "wavelength", "direction"})),
    "second_harmonic": (frozenset({"amplitude", "time"}), frozenset({"wavenumber", "wavelength"})),
    "arrival": (frozenset({"row"}), frozenset({"column"})),
    "speed": (frozenset({"row", "to_row"}), frozenset({"column", "to_column"})),
}


COUNTED = {"row", "column", "to_row", "to_column"}


class DataError(ValueError):
    """A table that is no table of measured points: the message names the line, the column and what is allowed."""


@dataclass(frozen=True)
class Point:
    """A measured value.

    Attributes
    ----------
    kind : a quantity of `KINDS`.
    value, error : in SI units; error None if it was not given.
    line : of the table, from 1.
    branch : "" for the nearest.
    wavenumber : with its `unit`, "rad/row" or "rad/m".
    direction : degrees, None for that of the scene.
    amplitude, time : m and s, of a second harmonic.
    row, column, to_row, to_column : of an impact, counted from 0; a column of −1 is that of the striker.
    """

    kind: str
    value: float
    error: float | None
    line: int
    branch: str = ""
    wavenumber: float = 0.0
    unit: str = "rad/row"
    direction: float | None = None
    amplitude: float = np.nan
    time: float = np.nan
    row: int = -1
    column: int = -1
    to_row: int = -1
    to_column: int = -1


class _Column(NamedTuple):
    """A column by its head: what it holds, and its unit."""

    quantity: str
    unit: str


def read(file: str | Path) -> list[Point]:
    """Return the points of a table.

    Raises DataError for what is not understood, OSError for a file that cannot be read.
    """
    try:
        text = Path(file).read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{file}: not a text file") from error
    try:
        return list(_points(text))
    except DataError as error:
        raise DataError(f"{file}: {error}") from None


def _points(text: str) -> Iterator[Point]:
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if line.strip() and line[0] != "#"]
    if not lines:
        raise DataError(f"has no head; it needs a column {_or(KINDS, '_UNIT')}")
    if ";" in lines[0][1] or "\t" in lines[0][1]:
        raise DataError("line of heads: cells must be parted by commas, and decimals by points")
    columns = [_column(head) for head in next(csv.reader([lines[0][1]]))]
    names = [each.quantity for each in columns]
    if twice := {name for name in names if name != "error" and names.count(name) > 1}:
        raise DataError(f"two columns hold {_or(twice)}; each quantity has one unit")
    if not any(name in KINDS for name in names):
        raise DataError(f"has no measured column; it needs {_or(KINDS, '_UNIT')}")
    if len(lines) == 1:
        raise DataError("has a head and no points")
    for number, line in lines[1:]:
        cells = [cell.strip() for cell in next(csv.reader([line]))]
        if len(cells) != len(columns):
            raise DataError(f"line {number}: {len(cells)} cells under {len(columns)} heads; decimals need points")
        yield _point(number, [(column, cell) for column, cell in zip(columns, cells, strict=True) if cell])


def _column(head: str) -> _Column:
    """Return what a head says; DataError for one that is unknown."""
    text = head.strip()
    if text == "branch":
        return _Column(text, "")
    found = re.fullmatch(r"(?P<name>[a-z_]+?)(?:_(?P<unit>[^_\[\]]+)|\s*\[(?P<bracketed>.+)\])?", text)
    name, unit = (found["name"], found["unit"] or found["bracketed"] or "") if found else (text, "")
    if text in UNITS:
        name, unit = text, ""
    if name == "error" and (unit == "%" or any(unit in UNITS[kind] for kind in KINDS)):
        return _Column(name, unit)
    if name not in UNITS:
        units = {f"{each}_UNIT" for each in UNITS if UNITS[each] != _NUMBERS} | {"branch", "error_UNIT"} | COUNTED
        near = get_close_matches(name, UNITS, n=1)
        raise DataError(
            f"column {text!r} is unknown; {f'did you mean {near[0]}?' if near else f'allowed: {_or(units)}'}"
        )
    if unit not in UNITS[name]:
        allowed = _or(f"{name}_{each}" if each else name for each in UNITS[name])
        raise DataError(f"column {text!r}: the unit must be one of {allowed}")
    return _Column(name, unit)


def _point(line: int, cells: list[tuple[_Column, str]]) -> Point:
    there = {column.quantity: (column.unit, cell) for column, cell in cells if column.quantity != "error"}
    kinds = [name for name in there if name in KINDS]
    if len(kinds) != 1:
        raise DataError(f"line {line}: must have one value of {_or(KINDS)}, and has {_or(kinds) or 'none'}")
    kind = kinds[0]
    needed, allowed = KINDS[kind]
    if lacking := needed - there.keys():
        raise DataError(f"line {line}: a {kind} needs {_or(lacking)}")
    if other := there.keys() - needed - allowed - {kind}:
        raise DataError(f"line {line}: a {kind} takes no {_or(other)}")
    if {"wavenumber", "wavelength"} <= there.keys():
        raise DataError(f"line {line}: has a wavenumber and a wavelength; give one of the two")
    numbers = {name: _number(line, name, *each) for name, each in there.items() if name != "branch"}
    value = numbers.pop(kind)
    if value <= 0:
        raise DataError(f"line {line}: {kind} = {there[kind][1]}: must be above 0")
    place = {name: int(number) if name in COUNTED else number for name, number in numbers.items()}
    unit = there["wavenumber"][0] if "wavenumber" in there else "rad/row"
    if "wavelength" in place:
        place, unit = place | {"wavenumber": 2 * np.pi / place.pop("wavelength")}, "rad/m"
    return Point(
        kind,
        value,
        _error(line, kind, value, cells),
        line,
        there.get("branch", ("", ""))[1],
        unit="rad/m" if unit.startswith("rad/u") else unit,
        **place,  # type: ignore[arg-type]  # numbers by their names
    )


def _number(line: int, name: str, unit: str, cell: str) -> float:
    """Return a cell in SI units."""
    try:
        value = float(cell)
    except ValueError:
        value = np.nan
    whole = name not in COUNTED or (value >= 0 and value == int(value))
    if not np.isfinite(value) or not whole or (name in ("wavelength", "amplitude", "time") and value <= 0):
        kind = f"a {name.removeprefix('to_')}, counted from 0" if name in COUNTED else "a finite number"
        above = " above 0" if name in ("wavelength", "amplitude", "time") else ""
        raise DataError(f"line {line}: {name} = {cell!r}: must be {kind}{above}")
    return value * UNITS[name][unit]


def _error(line: int, kind: str, value: float, cells: list[tuple[_Column, str]]) -> float | None:
    """Return the standard error of a value of a kind, None without one."""
    given = [(column.unit, cell) for column, cell in cells if column.quantity == "error"]
    fitting = [(unit, cell) for unit, cell in given if unit == "%" or unit in UNITS[kind]]
    if len(given) != len(fitting) or len(given) > 1:
        allowed = _or([*(f"error_{unit}" for unit in UNITS[kind]), "error_%"])
        raise DataError(f"line {line}: the error of a {kind} must be in one of {allowed}")
    for unit, cell in fitting:
        try:
            size = float(cell) * (value / 100 if unit == "%" else UNITS[kind][unit])
        except ValueError:
            size = np.nan
        if not 0 < size < np.inf:
            raise DataError(f"line {line}: error = {cell!r}: must be a finite number above 0")
        return size
    return None


def _or(names: object, tail: str = "") -> str:
    return ", ".join(f"{name}{tail}" for name in sorted(map(str, names)))  # type: ignore[call-overload]
