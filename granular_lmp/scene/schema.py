"""One declared value: its range, in words and as a check; TOML tables to frozen records and back.

Each field of a record carries its own rule in its metadata, so that this one description serves reading, checking,
writing and the error messages.
"""

import json
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from decimal import Decimal
from difflib import get_close_matches
from math import inf, isfinite
from pathlib import Path
from typing import Any

from granular_lmp.errors import SceneError

AUTO = "auto"
# What tomllib raises: a plain ValueError for whole numbers of more than 4300 digits; and it follows brackets in
# brackets as deep as Python's stack
NOT_TOML = (ValueError, RecursionError)
LONGEST_NAME = 200  # characters; file systems allow 255, and in.NAME.resume.part takes more of them
LARGEST_FILE = 1_000_000  # bytes; a scene with all its comments has 2000


@dataclass(frozen=True)
class Interval:
    """The numbers from `low` to `high`; without `low` itself where it is open, with 0 besides where `or_zero`."""

    low: float
    high: float
    open_low: bool = False
    or_zero: bool = False

    def __contains__(self, value: float) -> bool:
        inside = self.low < value if self.open_low else self.low <= value
        return (inside and value <= self.high) or (self.or_zero and value == 0)

    def __str__(self) -> str:
        return f"{'(' if self.open_low else '['}{short(self.low)}, {short(self.high)}]"


@dataclass(frozen=True)
class Rule:
    """What a key of a scene may hold, and what it means.

    Attributes
    ----------
    kind : type
        float, int, bool or str.
    unit : str
        "" for a number without a unit, and for what is not a number.
    meaning : str
        Half a sentence: the comment behind the key in a scene file, its entry in the reference.
    interval : Interval, optional
        For numbers.
    words : tuple of str
        Words that are allowed: beside numbers and switches, or alone.
    because : str
        Why the interval ends where it does, for the error message.
    """

    kind: type
    unit: str
    meaning: str
    interval: Interval | None = None
    words: tuple[str, ...] = ()
    because: str = ""

    @property
    def note(self) -> str:
        """The comment behind a value in a scene file: its unit and its meaning."""
        return ", ".join(filter(None, (self.unit, self.meaning)))

    @property
    def allowed(self) -> str:
        """The values that are allowed, in words."""
        words = [f'"{word}"' for word in self.words]
        if self.kind is str:
            return "one of " + ", ".join(words)
        return ", or ".join([self._allowed_values + self.because, *words])

    @property
    def _allowed_values(self) -> str:
        if self.interval is None:
            return "true, false" if self.words else "true or false"
        if self.kind is int:
            return f"a whole number from {self.interval.low} to {self.interval.high}"
        unit = f", {self.unit}" if self.unit else ""
        return f"{'0 or ' if self.interval.or_zero else ''}a number in {self.interval}{unit}"

    def value(self, value: Any, key: str) -> Any:
        """Return `value` as this rule's kind.

        Raises
        ------
        SceneError
            With the key, the value and what is allowed, if it is not.
        """
        if isinstance(value, str) and value in self.words:
            return value
        if self.kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value) if abs(value) < 1e300 else inf  # TOML writes 120 for 120.0
        right = isinstance(value, self.kind) and self.kind is not str  # words are dealt with above
        right = right and not (self.kind is int and isinstance(value, bool))
        if right and self.kind is float:
            right = isfinite(value)
        if not right or (self.interval is not None and value not in self.interval):
            raise SceneError(f"{key} = {shown(value)}: must be {self.allowed}")
        return value


Rules = Mapping[str, Rule]  # for a record of another room, whose fields carry no rules of their own


def number(
    unit: str,
    meaning: str,
    low: float,
    high: float,
    *,
    open_low: bool = False,
    or_zero: bool = False,
    words: tuple[str, ...] = (),
    **default: Any,
) -> Any:
    """A dataclass field that holds a number of an interval."""
    interval = Interval(low, high, open_low, or_zero)
    return field(metadata={"rule": Rule(float, unit, meaning, interval, words)}, **default)


def count(meaning: str, low: int, high: int, *, words: tuple[str, ...] = (), because: str = "", **default: Any) -> Any:
    """A dataclass field that holds a whole number."""
    return field(metadata={"rule": Rule(int, "", meaning, Interval(low, high), words, because)}, **default)


def choice(meaning: str, options: tuple[str, ...], **default: Any) -> Any:
    """A dataclass field that is one of some words."""
    return field(metadata={"rule": Rule(str, "", meaning, words=options)}, **default)


def flag(meaning: str, **default: Any) -> Any:
    """A dataclass field that is true or false."""
    return field(metadata={"rule": Rule(bool, "", meaning)}, **default)


def switch(meaning: str) -> Any:
    """A dataclass field that is true, false or "auto", the default."""
    return field(metadata={"rule": Rule(bool, "", meaning, words=(AUTO,))}, default=AUTO)


def short(value: float) -> str:
    """A number as a person writes it: 1e-9, 0.05, 10000000."""
    if isinstance(value, int):
        return str(value)
    mantissa, e, exponent = f"{value:g}".partition("e")
    return mantissa + (f"e{int(exponent)}" if e else "")


def record(kind: type, table: Any, name: str, rules: Rules | None = None) -> Any:
    """The record of type `kind` from the TOML table `name`, each value checked.

    Raises
    ------
    SceneError
        For a missing table or key, an unknown key, and a value out of range, each named.
    """
    items = declared_fields(kind, rules)
    names = [item.name for item, _ in items]
    if table is None:
        if any(item.default is MISSING for item, _ in items):
            raise SceneError(f"{name}: missing table; it holds {', '.join(names)}")
        table = {}
    if not isinstance(table, Mapping):
        raise SceneError(f"{name} = {shown(table)}: must be a table that holds {', '.join(names)}")
    refuse_unknown(table, names, f"{name}.")
    values = {}
    for item, rule in items:
        if item.name in table:
            values[item.name] = rule.value(table[item.name], f"{name}.{item.name}")
        elif item.default is MISSING:
            raise SceneError(f"{name}.{item.name}: missing key; must be {rule.allowed}")
    return kind(**values)


def plain(record: Any, rules: Rules | None = None) -> dict[str, Any]:
    """The declared values of a record by name."""
    return {item.name: getattr(record, item.name) for item, _ in declared_fields(type(record), rules)}


def toml_lines(kind: type, values: Mapping[str, Any], rules: Rules | None = None) -> list[str]:
    """``key = value  # note`` for each of the values, which are some of a record's of type `kind`."""
    notes = {item.name: rule.note for item, rule in declared_fields(kind, rules)}
    lines = ((f"{name} = {toml(value)}", notes[name]) for name, value in values.items())
    return [f"{line:30} # {note}" if note else line for line, note in lines]


def toml(value: str | bool | int | float) -> str:
    """A scalar as TOML: floats in the shortest form that reads back, very large and small ones as 7.3e+10."""
    if isinstance(value, float) and not 1e-4 <= abs(value) < 1e6 and value:
        return f"{Decimal(repr(value)).normalize():e}"
    return json.dumps(value)


def assignment(text: str) -> tuple[str, Any]:
    """``("wave.wavenumber", 1.2)`` from ``"wave.wavenumber=1.2"``; a value that is not TOML is taken as a bare word."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or not value.strip():
        raise SceneError(f"{shown(text)}: must be KEY=VALUE, for instance wave.wavenumber=1.2")
    try:
        (parsed,) = tomllib.loads(f"value = {value}").values()
    except NOT_TOML:  # also where a second line sets another key
        return key.strip(), value.strip()
    return key.strip(), parsed


def first_file(source: object, candidates: Iterable[Path]) -> Path | None:
    """The first of the candidates that is a file; SceneError where no file can be of that name."""
    try:
        return next((path for path in candidates if path.is_file()), None)
    except (OSError, ValueError) as error:
        raise SceneError(f"{shown(source)}: no such scene file: {one_line(error)}") from error


def file_text(path: Path) -> str:
    """The text of a scene file; SceneError when it cannot be read, is not UTF-8, or is far too large for one."""
    try:
        with path.open("rb") as stream:
            raw = stream.read(LARGEST_FILE + 1)
        text = raw.decode("utf-8-sig")  # some editors begin a file with a byte order mark
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path}: cannot be read as UTF-8 text: {one_line(error)}") from error
    if len(raw) > LARGEST_FILE:
        raise SceneError(f"{path}: is no scene file: larger than {LARGEST_FILE} bytes")
    return text


def refuse_unknown(table: Mapping[str, Any], names: Iterable[str], prefix: str) -> None:
    """SceneError for the first key that is none of `names`."""
    for key in table:
        if key not in names:
            raise SceneError(f"{prefix}{cut(key)}: unknown key; {allowed_names(key, names)}")


def checked_name(tables: Mapping[str, Any], default: str, what: str) -> str:
    """Return ``name`` of what was read, or `default`; it becomes that of files on any system, `what` says of which."""
    name = tables.get("name", default)
    plain = isinstance(name, str) and name.isascii() and name.replace("_", "").replace("-", "").isalnum()
    if not plain or len(name) > LONGEST_NAME:
        origin = "" if "name" in tables else ", taken from the file's name as the file declares none"
        raise SceneError(
            f"name = {shown(name)}{origin}: must be a string of at most {LONGEST_NAME} ASCII letters, digits, "
            f"'-' and '_' (it names {what})"
        )
    return name


def default_name(file: Path) -> str:
    """Return the name of a scene whose file declares none: the file's stem, of ``scene.toml`` that of its folder."""
    file = file.absolute()
    return file.parent.name if file.name == "scene.toml" else file.stem


def allowed_names(key: str, names: Iterable[str]) -> str:
    """The name that was meant, if one is close; else all that are allowed."""
    close = get_close_matches(key, list(names), n=1)
    return f"did you mean '{close[0]}'?" if close else f"allowed: {', '.join(names)}"


def shown(value: Any) -> str:
    """A value for an error message, cut to one line of 60 characters."""
    try:
        return cut(repr(value))
    except ValueError:  # Python writes no whole number of more than 4300 digits
        return "(a number of thousands of digits)"


def cut(text: str) -> str:
    """The first 60 characters of a text."""
    return text if len(text) <= 60 else text[:57] + "..."


def one_line(error: Exception) -> str:
    """The text of an error without line breaks."""
    return " ".join(str(error).split())


def declared_fields(kind: type, rules: Rules | None) -> list[tuple["Field[Any]", Rule]]:
    """The fields of a record that a scene file holds, each with its rule."""
    known = [(item, (rules or {}).get(item.name) or item.metadata.get("rule")) for item in fields(kind)]
    return [(item, rule) for item, rule in known if rule is not None]
