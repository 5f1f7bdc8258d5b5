"""One declared value: its range, in words and as a check; TOML tables to frozen records and back.

Each field of a record carries its own rule in its metadata, so that this one description serves reading, checking,
writing and the error messages.
"""

import json
import tomllib
from collections.abc import Callable, Iterable, Mapping
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
LARGEST_FILE = 1_000_000  # bytes; a scene with all its comments has 2000


@dataclass(frozen=True)
class Rule:
    """What a key may hold: a value of this kind that passes the check, or one of some words."""

    kind: type
    note: str
    allowed: str
    check: Callable[[Any], bool]
    words: tuple[str, ...] = ()

    def value(self, value: Any, key: str) -> Any:
        """`value` as this rule's kind; SceneError with the key, the value and what is allowed if it is not."""
        if value in self.words:
            return value
        if self.kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value) if abs(value) < 1e300 else inf  # TOML writes 120 for 120.0
        right = isinstance(value, self.kind) and not (self.kind is int and isinstance(value, bool))
        if right and self.kind is float:
            right = isfinite(value)
        if not right or not self.check(value):
            allowed = "".join([self.allowed, *(f', or "{word}"' for word in self.words)])
            raise SceneError(f"{key} = {shown(value)}: must be {allowed}")
        return value


Rules = Mapping[str, Rule]  # for a record of another room, whose fields carry no rules of their own


def declared(
    kind: type, note: str, allowed: str, check: Callable[[Any], bool], words: tuple[str, ...] = (), **default: Any
) -> Any:
    """A dataclass field with its rule."""
    return field(metadata={"rule": Rule(kind, note, allowed, check, words)}, **default)


def choice(note: str, options: tuple[str, ...], **default: Any) -> Any:
    """A dataclass field that is one of some words."""
    allowed = "one of " + ", ".join(f'"{option}"' for option in options)
    return declared(str, note, allowed, options.__contains__, **default)


def switch(note: str) -> Any:
    """A dataclass field that is true, false or "auto", the default."""
    return declared(bool, note, "true, false", lambda value: True, words=(AUTO,), default=AUTO)


def between(low: float, high: float) -> Callable[[float], bool]:
    """The check low ≤ value ≤ high."""
    return lambda value: low <= value <= high


def record(kind: type, table: Any, name: str, rules: Rules | None = None) -> Any:
    """The record of type `kind` from the TOML table `name`, each value checked.

    Raises
    ------
    SceneError
        For a missing table or key, an unknown key, and a value out of range, each named.
    """
    items = _declared_fields(kind, rules)
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
    return {item.name: getattr(record, item.name) for item, _ in _declared_fields(type(record), rules)}


def toml_lines(kind: type, values: Mapping[str, Any], rules: Rules | None = None) -> list[str]:
    """``key = value  # note`` for each of the values, which are some of a record's of type `kind`."""
    notes = {item.name: rule.note for item, rule in _declared_fields(kind, rules)}
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
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except NOT_TOML:
        return key.strip(), value.strip()


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
        text = raw.decode("utf-8")
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
    """``name`` of what was read, which becomes that of files on any system; `what` says what it names."""
    name = tables.get("name", default)
    if not isinstance(name, str) or not name.isascii() or not name.replace("_", "").replace("-", "").isalnum():
        raise SceneError(f"name = {shown(name)}: must be ASCII letters, digits, '-' and '_' (it names {what})")
    return name


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


def _declared_fields(kind: type, rules: Rules | None) -> list[tuple["Field[Any]", Rule]]:
    """The fields of a record that a scene file holds, each with its rule."""
    known = [(item, (rules or {}).get(item.name) or item.metadata.get("rule")) for item in fields(kind)]
    return [(item, rule) for item, rule in known if rule is not None]
