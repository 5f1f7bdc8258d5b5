"""Read tables of numbers in CSV, as spreadsheets, digitizers and oscilloscopes write them.

The header names quantities with their units: ``frequency_MHz``, ``frequency [MHz]``, ``Frequency (MHz)``,
``frequency/MHz``, or with the symbol of a quantity, ``f (MHz)``. Commas, semicolons, tabs or spaces separate cells; if
commas do not, decimals may have a comma. The reader skips lines above the header, lines that begin with # or %, empty
lines, and separators at the end of a line. It refuses what has two readings.
"""

import csv
import io
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterator, Mapping, Sequence
from math import isnan, nan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import SceneError, one_line
from granular_lmp.frozen import dataclass
from granular_lmp.scene.files import LARGEST_TABLE, file_bytes
from granular_lmp.scene.schema import near_name, shown

Quantities = Mapping[str, Mapping[str, float]]  # units of each quantity and their sizes in SI; "" for no unit
Words = Mapping[str, str]  # other words and symbols for a quantity
Rows = Sequence[tuple[int, list[str]]]  # number of each line, from 1, and its cells

LENGTHS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
FORCES = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "uN": 1e-6, "nN": 1e-9}

ERROR = "error"  # the only quantity with several columns in a table, each about another quantity
_PARTED_BY = {"\t": "tabs", ";": "semicolons", ",": "commas", " ": "spaces"}
_COMMENT = "#%"
_BREAKS = b"\n\r\v\f\x1c\x1d\x1e"  # characters that end a line of text
_LOWEST_HEAD, _WIDEST_HEAD = 200, 100  # largest number of lines searched for a header, and of their cells
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)  # float() would accept 4_51.3 and ٤ too
_WITH_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII)
_UNIT = re.compile(r"(?:\s*[_/]|\s+in\s|(?=\s*[\[(]))\s*(.+)|\s*")  # what may stand behind the name of a quantity
_PER = re.compile(r"^1/(\w+)$|^(?:rad)?([a-z]+)\^?-1$")  # unit of a wave number only
_SPELLED = str.maketrans({"µ": "u", "μ": "u", "−": "-", "°": "deg", "·": "", " ": "", "\xa0": ""})


class TableError(SceneError):
    """Error of a table that cannot be read; the text names the file, the line and what is allowed."""


@dataclass(frozen=True)
class Column:
    """Column by its head: the quantity and its unit."""

    quantity: str
    unit: str


@dataclass(frozen=True)
class Table:
    """Table and one line that says how it was understood; each row has a cell for each column, "" if empty."""

    columns: Sequence[Column]
    rows: Rows
    understood: str


def value_of(cell: str) -> float:
    """Return the number in a cell, or nan if the cell holds none."""
    cell = cell.replace("\N{MINUS SIGN}", "-")
    return float(cell) if _NUMBER.fullmatch(cell) else nan


def read(file: str | Path, quantities: Quantities, words: Words, said: str = "") -> Table:
    """Return the table in a file.

    Parameters
    ----------
    file : a regular file of at most `LARGEST_TABLE` bytes, in UTF-8, UTF-16 with a byte order mark, or Windows-1252.
    quantities : quantities that a column may hold, with their units.
    words : other words and symbols for a quantity.
    said : the name that the user wrote for the file, if it is not the path.

    Raises
    ------
    SceneError
        If the file cannot be read or has no header, or if a head or a line is not understood.
    """
    said = said or str(file)
    return _of_bytes(file_bytes(Path(file), LARGEST_TABLE, said), Heads(quantities, words), said)


def say_understood(table: Table) -> None:
    """Note how a table was understood; commands print this note."""
    import logging  # kept out of start-up

    logging.getLogger(__name__).info("%s", table.understood)


def _of_bytes(raw: bytes, heads: "Heads", said: str) -> Table:
    try:
        return _table(_decoded(raw), heads, said)
    except (ValueError, csv.Error) as error:
        raise TableError(f"{said}: {one_line(error)}") from None


def numbers(
    file: str | Path, quantities: Quantities, words: Words, said: str, *, largest: int, most: int
) -> tuple[Sequence[int], dict[str, NDArray[np.float64]]]:
    """Return the line numbers of a table, and its columns by quantity in SI units, with nan for empty cells.

    The arguments are those of `read`; every cell must be a number or empty. A header in the first line, above numbers
    separated by commas, takes a tenth of the time and a fifth of the memory.

    Raises
    ------
    SceneError
        As `read` does; also for more than `most` rows, or for a cell that is not a number.
    """
    raw, heads = file_bytes(Path(file), largest, said), Heads(quantities, words)
    if (
        len(raw) - len(raw.translate(None, _BREAKS)) > 2 * most + _LOWEST_HEAD
    ):  # on some systems two characters end a line
        raise TableError(f"{said}: must have at most {most} rows")
    columns: Sequence[Column]
    lines: Sequence[int]
    if plain := _plain(raw, heads):
        columns, values = plain
        lines = range(2, 2 + len(values))
    else:
        table = _of_bytes(raw, heads, said)
        columns, lines = table.columns, [line for line, _ in table.rows]
        values = np.array([_values(columns, line, cells, said) for line, cells in table.rows])
        values = values.reshape(-1, len(columns))
    if len(values) > most:
        raise TableError(f"{said}: {len(values)} rows: must be at most {most}")
    return lines, {
        column.quantity: values[:, place] * quantities[column.quantity][column.unit]
        for place, column in enumerate(columns)
    }


def _plain(raw: bytes, heads: "Heads") -> tuple[list[Column], NDArray[np.float64]] | None:
    """Return the columns and numbers of a table that holds only a head and rows of numbers, else None."""
    first, _, body = raw.partition(b"\n")
    if not (raw.isascii() and body.strip(b"\n")) or body.translate(None, b"0123456789+-.eE,\n"):
        return None
    names = [name.strip() for name in first.decode().split(",")]
    columns = [column for name in names if heads.knows(name) and (column := heads.column(name))]
    for empty, said in ((b",,", b",nan,"), (b",,", b",nan,"), (b"\n,", b"\nnan,"), (b",\n", b",nan\n")):
        body = body.replace(empty, said)
    try:
        values = np.loadtxt(io.TextIOWrapper(io.BytesIO(body)), delimiter=",", comments=None, ndmin=2)
    except ValueError:
        return None
    whole = values.shape == (body.rstrip(b"\n").count(b"\n") + 1, len(names)) and not np.isnan(values).all(axis=1).any()
    return (columns, values) if whole and len({each.quantity for each in columns}) == len(names) else None


def _values(columns: Sequence[Column], line: int, cells: Sequence[str], said: str) -> list[float]:
    """Return the numbers of a line; raise TableError for a cell that is neither a number nor empty."""
    found = [value_of(cell) for cell in cells]
    for column, cell, value in zip(columns, cells, found, strict=True):
        if isnan(value) and cell:
            raise TableError(f"{said}: line {line}: {column.quantity} = {shown(cell)}: must be a number")
    return found


def _decoded(raw: bytes) -> str:
    wide = raw.startswith((BOM_UTF16_LE, BOM_UTF16_BE))
    for encoding in ("utf-16",) if wide else ("utf-8", "cp1252"):
        try:
            text = raw.decode(encoding).lstrip("\ufeff")  # byte order mark
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise ValueError("not a text file; save a spreadsheet as CSV")


class Heads:
    """Heads that a table may have."""

    def __init__(self, quantities: Quantities, words: Words) -> None:
        self.quantities = quantities
        named = {each: each for each in quantities} | dict(words)
        self._patterns = [
            (re.compile(word.replace("_", r"[\s_-]?"), re.IGNORECASE), named[word])
            for word in sorted(named, key=len, reverse=True)
        ]

    @property
    def allowed(self) -> str:
        """Return all quantities in words."""
        return ", ".join(name if "" in units else f"{name}_UNIT" for name, units in sorted(self.quantities.items()))

    def column(self, head: str) -> Column | None:
        """Return the column that a head names, in any unit; None if it names no quantity."""
        for word, quantity in self._patterns:
            found = word.match(head)
            if found and (unit := _UNIT.fullmatch(head, found.end())):
                said = (unit[1] or "").strip("[]() ").translate(_SPELLED).replace("_", "/")
                return Column(quantity, _PER.sub(r"rad/\1\2", said))
        return None

    def knows(self, head: str) -> bool:
        """Return whether a head and its unit are understood."""
        column = self.column(head)
        return column is not None and column.unit in self.quantities[column.quantity]

    def near(self, head: str) -> str:
        """Return the allowed head that is nearly the same, or "" if there is none."""
        every = [f"{name}_{unit}".strip("_") for name, units in self.quantities.items() for unit in units]
        return near_name(re.sub(r"[\s_\[\]()]+", "_", head).strip("_"), every)

    def checked(self, head: str) -> Column:
        """Return the column that a head names; raise ValueError if it is not understood."""
        column = self.column(head)
        if column is None:
            near = self.near(head)
            raise ValueError(
                f"column {head!r} is unknown; {f'did you mean {near}?' if near else f'allowed: {self.allowed}'}"
            )
        units = self.quantities[column.quantity]
        if column.unit not in units:
            allowed = ", ".join(sorted(f"{column.quantity}_{each}".strip("_") for each in units))
            raise ValueError(f"column {head!r}: the unit must be one of {allowed}")
        return column


def _table(text: str, heads: Heads, said: str) -> Table:
    lines = [(count, line) for count, line in enumerate(text.splitlines(), 1) if line.strip()]
    after, separator, names = _head(lines, heads)
    while not names[-1]:
        names.pop()
    rows = list(_rows(lines[after:], separator, len(names)))
    used = [n for n, name in enumerate(names) if name]
    for count, cells in rows:
        if other := [cell for name, cell in zip(names, cells, strict=True) if cell and not name]:
            raise ValueError(f"line {count}: {other[0]!r} stands in a column without a head")
    columns = [heads.checked(names[n]) for n in used]
    for each in {each.quantity for each in columns} - {ERROR}:
        if (held := [column.quantity for column in columns].count(each)) > 1:
            raise ValueError(f"{held} columns hold {each}; must be one, in one unit")
    plain, with_commas = _with_points([(count, [cells[n] for n in used]) for count, cells in rows], separator)
    last = lines[after - 1][0]
    described = [f"{each.quantity} in {each.unit}" if each.unit else each.quantity for each in columns]
    understood = [f"{said}: {len(rows)} row{'s' * (len(rows) != 1)}: {', '.join(described)}"]
    understood += [f"head to line {last}"] if last > 1 else []
    understood += [f"cells parted by {_PARTED_BY[separator]}"] if separator != "," and len(names) > 1 else []
    understood += ["decimals with commas"] if with_commas else []
    return Table(columns, plain, "; ".join(understood))


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return re.split(r"\s+(?![\[(])", line.strip())  # a unit in brackets belongs to the word before it
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]


def _head(lines: Sequence[tuple[int, str]], heads: Heads) -> tuple[int, str, list[str]]:
    """Return where most heads are understood: number of lines up to the header, separator, and cells.

    The first of equal candidates wins. Raises ValueError if nothing is understood; its text holds the nearest head.
    """
    best, found = (0, 0), None
    for after, separator, cells in _may_be_heads(lines):
        known = sum(map(heads.knows, cells[:_WIDEST_HEAD]))
        if known and (known, known - sum(map(bool, cells))) > best:
            best, found = (known, known - sum(map(bool, cells))), (after, separator, cells)
    if found:
        return found
    for _, line in lines[:_LOWEST_HEAD]:
        for cell in map(str.strip, re.split(r"[\t;,]", line.lstrip(_COMMENT))[:_WIDEST_HEAD]):
            if any(map(str.isalpha, cell)) and (heads.column(cell) or heads.near(cell)):
                heads.checked(cell)
    first = f"; line {lines[0][0]} is {shown(lines[0][1])}" if lines else ""
    raise ValueError(f"has no head; must have a line of {heads.allowed}{first}")


def _may_be_heads(lines: Sequence[tuple[int, str]]) -> Iterator[tuple[int, str, list[str]]]:
    """Yield each line as a header, alone or with units in the next line: lines up to it, separator, cells."""
    for after, (_, line) in enumerate(lines[:_LOWEST_HEAD], 1):
        for separator in _PARTED_BY:
            cells = _cells(line.lstrip(_COMMENT), separator)
            yield after, separator, cells
            units = _cells(lines[after][1].lstrip(_COMMENT), separator) if after < len(lines) else []
            if len(units) == len(cells):
                named = zip(cells, units, strict=True)
                yield after + 1, separator, [f"{cell} [{unit.strip('[]()')}]" if unit else cell for cell, unit in named]


def _rows(lines: Sequence[tuple[int, str]], separator: str, width: int) -> Iterator[tuple[int, list[str]]]:
    for count, line in lines:
        cells = [] if line.lstrip()[0] in _COMMENT else _cells(line, separator)
        while len(cells) > width and not cells[-1]:
            cells.pop()
        if any(cells) and len(cells) != width:
            remedy = "" if separator != "," else "; decimals need points where cells are parted by commas"
            raise ValueError(f"line {count}: {len(cells)} cells under {width} heads{remedy}")
        if any(cells):
            yield count, cells


def _with_points(rows: Rows, separator: str) -> tuple[Rows, bool]:
    """Return rows with decimal points, and whether they had decimal commas.

    Raises ValueError for a table with both, and for commas that may separate thousands.
    """
    commas = [(count, cell) for count, cells in rows for cell in cells if _WITH_COMMA.fullmatch(cell)]
    if not commas:
        return rows, False
    for count, cells in rows:
        if point := next((cell for cell in cells if "." in cell and _NUMBER.fullmatch(cell)), None):
            other, comma = commas[0]
            raise ValueError(f"line {count}: {point} has a point, and {comma} in line {other} a comma; write points")
    if separator != ";" and all(_THOUSANDS.fullmatch(cell) for _, cell in commas):
        count, cell = commas[0]
        raise ValueError(
            f"line {count}: {cell} may mean thousands or decimals; write decimals with a point, thousands without"
        )
    return [(n, [c.replace(",", ".") if _WITH_COMMA.fullmatch(c) else c for c in cells]) for n, cells in rows], True
