"""Measured points of a table: kind, place, value and error, in SI units.

A table is CSV with a head (`granular_lmp.scene.spreadsheets`). The head of a column is a quantity with its unit,
``frequency_MHz`` or ``f [MHz]``. Each row has a value in one of these columns, and its place in the others:

    frequency_Hz          frequency of a wave: wavenumber_rad/row or wavelength_m, direction_deg, branch
    second_harmonic_m     |C| of a wave: amplitude_m, time_s after its start, wavenumber or wavelength
    arrival_s             arrival of the front of an impact: row, in a sheet column
    speed_m/s             speed of the front: from row (column) to to_row (to_column)
    displacement_x_m      motion of a sphere: time_s after the start, row, column, layer; also velocity_x_m/s,
                          rotation_x_rad and spin_x_rad/s, each along or about x, y or z

An optional standard error stands in ``error_…`` with a unit of the quantity, or in ``error_%``. A branch is a name (L,
TR, RT) or a number, from 1 for the lowest; an empty cell means the branch with the nearest frequency. An empty wave
number means 0, an empty direction that of the scene. Every other cell that a row needs must be filled. A row may have
several traces (motions of a sphere), as in the tables that ``granular-lmp export`` writes of monitors and recorded
spheres. Gaps of a trace are empty or nan. Times before the start of the run are left out.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp.scene import spreadsheets
from granular_lmp.scene.spreadsheets import ERROR, LENGTHS, TIMES, Column, Table, TableError, value_of

_NUMBERS = {"": 1.0}
_SPEEDS = {"m/s": 1.0, "km/s": 1e3, "mm/s": 1e-3, "um/s": 1e-6}
# Motions of a sphere, each along or about three axes, with their units and their symbols in exported tables
_MOTIONS = {
    "displacement": (LENGTHS, ("u{axis}", "{along}")),
    "velocity": (_SPEEDS, ("v{axis}", "{along}_t")),
    "rotation": ({"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": np.pi / 180}, ("theta{axis}",)),
    "spin": ({"rad/s": 1.0}, ("spin{axis}", "theta{axis}_t")),
}
TRACES = {f"{name}_{axis}": units for name, (units, _) in _MOTIONS.items() for axis in "xyz"}
UNITS: Mapping[str, Mapping[str, float]] = {  # units of each quantity, in SI units
    "frequency": {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9},
    "second_harmonic": LENGTHS,
    "arrival": TIMES,
    "speed": {"m/s": 1.0, "km/s": 1e3},
    "wavenumber": {"rad/row": 1.0, "rad/m": 1.0, "rad/mm": 1e3, "rad/um": 1e6},
    "wavelength": LENGTHS,
    "direction": {"deg": 1.0},
    "amplitude": LENGTHS,
    "time": TIMES,
    "row": _NUMBERS,
    "column": _NUMBERS,
    "to_row": _NUMBERS,
    "to_column": _NUMBERS,
    "layer": _NUMBERS,
    **TRACES,
}
# Columns that each kind of point needs, and columns that it may have
KINDS: Mapping[str, tuple[frozenset[str], frozenset[str]]] = {
    "frequency": (frozenset(), frozenset({"branch", "wavenumber", "wavelength", "direction"})),
    "second_harmonic": (frozenset({"amplitude", "time"}), frozenset({"wavenumber", "wavelength"})),
    "arrival": (frozenset({"row"}), frozenset({"column"})),
    "speed": (frozenset({"row", "to_row"}), frozenset({"column", "to_column"})),
    **{name: (frozenset({"time", "row"}), frozenset({"column", "layer"})) for name in TRACES},
}


COUNTED = {"row", "column", "to_row", "to_column", "layer"}
_ERRORS = {unit: 1.0 for kind in KINDS for unit in [*UNITS[kind], "%"]}  # all 1; the kind gives the size of the unit
_HEADS = {**UNITS, "branch": _NUMBERS, ERROR: _ERRORS}
_SYMBOLS = {"f": "frequency", "k": "wavenumber", "wave_number": "wavenumber", "λ": "wavelength", "t": "time"} | {
    word.format(axis=axis, along=along): f"{name}_{axis}"
    for name, (_, words) in _MOTIONS.items()
    for axis, along in zip("xyz", "uvw", strict=True)
    for word in words
}
# In the plane a sphere turns only about z, and tables omit the axis
_SYMBOLS |= {"rotation": "rotation_z", "theta": "rotation_z", "spin": "spin_z", "theta_t": "spin_z"}


@dataclass(frozen=True)
class Point:
    """A measured value.

    Attributes
    ----------
    kind : a quantity of `KINDS`.
    value, error : in SI units; the error is None if it was not given.
    line : line of the table, from 1.
    branch : branch of a frequency; "" for the nearest.
    wavenumber : wave number in `unit`, "rad/row" or "rad/m".
    direction : degrees; None for the direction of the scene.
    amplitude : amplitude of the wave of a second harmonic, m.
    time : time of a second harmonic or of a trace, s.
    row, column, to_row, to_column : place of an arrival or a trace, and ends of a speed, counted from 0. A column of
        −1 is that of the striker, for a trace the only one.
    layer : layer of a trace; −1 for the only one.
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
    layer: int = -1

    @property
    def of_trace(self) -> bool:
        """True for the motion of a sphere at a time."""
        return self.kind in TRACES


def read(
    file: str | Path, only: Collection[str] = (), otherwise: Collection[str] = (), *, errors: bool = True
) -> tuple[list[Point], Table]:
    """Return the points of a table, and the table as it was understood.

    Parameters
    ----------
    file : str or Path
    only : kinds to read; () for all.
    otherwise : kinds to read if the table has no point of `only`.
    errors : whether the table may have errors.

    Raises GranularError for a file that cannot be read, or whose columns or cells are not understood.
    """
    table = spreadsheets.read(file, _HEADS, _SYMBOLS)
    try:
        if not any(each.quantity in KINDS for each in table.columns):
            raise ValueError(f"has no measured column; it needs {_or(KINDS, '_UNIT')}")
        if not table.rows:
            raise ValueError("has a head and no points")
        if not errors and (refused := [each.unit for each in table.columns if each.quantity == ERROR]):
            raise ValueError(f"column error_{refused[0]}: is not used here; remove it, and give --noise SHARE")
        points = [*_points_of(table, only)]
        if otherwise and not points:
            points = [*_points_of(table, otherwise)]
        if not points:
            raise ValueError(f"holds no {_or({*only, *otherwise}) or 'value'}")
    except ValueError as error:
        raise TableError(f"{file}: {error}") from None
    return points, table


def _points_of(table: Table, only: Collection[str]) -> Iterator[Point]:
    """Yield the points of all rows."""
    kinds = {each.quantity for each in table.columns} & KINDS.keys()
    if only and not kinds.intersection(only):
        return
    for line, cells in table.rows:
        yield from _points(line, [*_filled(table.columns, cells)], only, kinds)


def empty_times(table: Table, points: Iterable[Point]) -> list[float]:
    """Return the times (s) of the rows of a table without a value; `points` are the points of the table."""
    place = next((n for n, each in enumerate(table.columns) if each.quantity == "time"), None)
    lines, found = {each.line for each in points}, []
    for line, cells in table.rows:
        if place is None or line in lines or not cells[place]:
            continue
        if not any(column.quantity in KINDS for column, _ in _filled(table.columns, cells)):
            found.append(value_of(cells[place]) * TIMES[table.columns[place].unit])
    return found


def _filled(columns: Sequence[Column], cells: Sequence[str]) -> Iterator[tuple[Column, str]]:
    """Yield the filled cells of a row with their columns; nan in a column of a trace counts as empty."""
    for column, cell in zip(columns, cells, strict=True):
        if cell and not (column.quantity in TRACES and cell.lower() == "nan"):
            yield column, cell


def _points(
    line: int, cells: list[tuple[Column, str]], only: Collection[str], columns: Collection[str]
) -> Iterator[Point]:
    """Yield the points of a row: one, several for traces, none in a gap. `columns` are the kinds in the table."""
    there = {column.quantity: (column.unit, cell) for column, cell in cells if column.quantity != ERROR}
    kinds = [name for name in there if name in KINDS]
    if not kinds and _is_gap(there.keys(), columns):
        return
    if not kinds or (len(kinds) > 1 and not set(kinds) <= TRACES.keys()):
        raise ValueError(f"line {line}: must have one value of {_or(KINDS)}, and has {_or(kinds) or 'none'}")
    taken = [kind for kind in kinds if not only or kind in only]
    if not taken:
        return
    place = _place(line, taken[0], {name: each for name, each in there.items() if name not in kinds})
    errors = [(column.unit, cell) for column, cell in cells if column.quantity == ERROR]
    every = {unit for kind in columns if kind in TRACES for unit in UNITS[kind]} if errors else set()
    for kind in taken:
        value = _number(line, kind, *there[kind], False)
        if value <= 0 and kind not in TRACES:
            raise ValueError(f"line {line}: {kind} = {there[kind][1]}: must be above 0")
        # An error in the unit of another trace of the table belongs to that trace
        own = [each for each in errors if kind not in TRACES or each[0] in UNITS[kind] or each[0] not in every]
        yield Point(kind, value, _error(line, kind, value, own), line, **place)


def _is_gap(there: Collection[str], columns: Collection[str]) -> bool:
    """Return whether a row without a value is a gap: all columns are traces, or the row has only sphere and time."""
    needed, allowed = next(KINDS[name] for name in TRACES)
    traces = TRACES.keys() & columns
    return len(traces) == len(columns) or (bool(traces) and needed <= {*there} <= needed | allowed)


def _place(line: int, kind: str, there: dict[str, tuple[str, str]]) -> dict[str, Any]:
    """Return the attributes of a point other than kind, value and error, from a row."""
    needed, allowed = KINDS[kind]
    if lacking := needed - there.keys():
        raise ValueError(f"line {line}: a {kind} needs {_or(lacking)}")
    if other := there.keys() - needed - allowed:
        raise ValueError(f"line {line}: a {kind} takes no {_or(other)}")
    if {"wavenumber", "wavelength"} <= there.keys():
        raise ValueError(f"line {line}: has both a wavenumber and a wavelength; give one of the two")
    positive = {"wavelength", "amplitude"} if kind in TRACES else {"wavelength", "amplitude", "time"}
    numbers = {name: _number(line, name, *each, name in positive) for name, each in there.items() if name != "branch"}
    place: dict[str, Any] = {name: int(each) if name in COUNTED else each for name, each in numbers.items()}
    rows = "wavelength" not in place and there.get("wavenumber", ("rad/row",))[0] == "rad/row"
    if "wavelength" in place:
        place["wavenumber"] = 2 * np.pi / place.pop("wavelength")
    return place | {"branch": there.get("branch", ("", ""))[1], "unit": "rad/row" if rows else "rad/m"}


def _number(line: int, name: str, unit: str, cell: str, positive: bool) -> float:
    """Return a cell in SI units."""
    value = value_of(cell)
    whole = name not in COUNTED or (value >= 0 and value.is_integer())
    if not isfinite(value) or not whole or (positive and value <= 0):
        kind = f"a {name.removeprefix('to_')}, counted from 0" if name in COUNTED else "a finite number"
        above = " above 0" if positive else ""
        raise ValueError(f"line {line}: {name} = {cell!r}: must be {kind}{above}")
    return value * UNITS[name][unit]


def _error(line: int, kind: str, value: float, given: list[tuple[str, str]]) -> float | None:
    """Return the standard error of a value of a kind, from units and cells; None without one."""
    fitting = [(unit, cell) for unit, cell in given if unit == "%" or unit in UNITS[kind]]
    if len(given) != len(fitting) or len(given) > 1:
        allowed = _or([*(f"error_{unit}" for unit in UNITS[kind]), "error_%"])
        raise ValueError(f"line {line}: the error of a {kind} must be in one of {allowed}")
    if kind in TRACES and [unit for unit, _ in fitting] == ["%"]:
        raise ValueError(f"line {line}: error_%: a {kind} passes through 0; give its error in a unit")
    for unit, cell in fitting:
        size = value_of(cell) * (value / 100 if unit == "%" else UNITS[kind][unit])
        if not 0 < size < np.inf:
            raise ValueError(f"line {line}: error = {cell!r}: must be a finite number above 0")
        return size
    return None


def _or(names: Iterable[str], tail: str = "") -> str:
    return ", ".join(f"{name}{tail}" for name in sorted(names))
