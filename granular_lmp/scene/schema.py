"""Rules of declared values, as text and as a check, and the conversion of TOML tables to frozen records and back.

Each field of a record carries its own rule in its metadata, so that this one description serves reading, checking,
writing and the error messages.
"""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import field, replace
from decimal import Decimal
from math import inf, isfinite
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.unsupported import hint

AUTO: Final = "auto"
Auto = Literal["auto"]
LONGEST_NAME = 200  # characters; file systems allow 255, and in.NAME.resume.part takes more of them
LONGEST_PART = 40  # characters of a name that is a part of file names
NAME_PATTERN = f"[A-Za-z0-9_]{{1,{LONGEST_PART}}}"
LONGEST_DESCRIPTION = 200  # characters: two lines of a terminal
_JSON = json.JSONEncoder(ensure_ascii=False)
_JSON_KINDS = {float: "number", int: "integer", bool: "boolean"}


@dataclass(frozen=True)
class Interval:
    """Numbers from `low` to `high`, without `low` itself if `open_low`, and with 0 in addition if `or_zero`."""

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
    """Allowed values of one key of a scene, and its meaning.

    Attributes
    ----------
    kind : type
        float, int, bool or str.
    unit : str
        Empty for a dimensionless number and for a value that is not a number.
    meaning : str
        Half a sentence: the comment behind the key in a scene file and its entry in the reference.
    interval : Interval, optional
        Allowed range of a number.
    words : tuple of str
        Allowed words, beside numbers and switches or alone.
    """

    kind: type
    unit: str
    meaning: str
    interval: Interval | None = None
    words: tuple[str, ...] = ()

    @property
    def note(self) -> str:
        """Comment behind a value in a scene file: its unit and its meaning."""
        return ", ".join(filter(None, (self.unit, self.meaning)))

    @property
    def allowed(self) -> str:
        """Allowed values in words."""
        words = [f'"{word}"' for word in self.words]
        if self.kind is str:
            return "one of " + ", ".join(words)
        return ", or ".join([self._allowed_values, *words])

    @property
    def _allowed_values(self) -> str:
        if self.interval is None:
            return "true, false" if self.words else "true or false"
        if self.kind is int:
            return f"a whole number from {self.interval.low} to {self.interval.high}"
        unit = f", {self.unit}" if self.unit else ""
        return f"{'0 or ' if self.interval.or_zero else ''}a number in {self.interval}{unit}"

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the allowed values."""
        if self.kind is str:
            return {"enum": list(self.words)}
        numbers: dict[str, Any] = {"type": _JSON_KINDS[self.kind]}
        if self.interval is not None:
            low = "exclusiveMinimum" if self.interval.open_low else "minimum"
            numbers |= {low: self.interval.low, "maximum": self.interval.high}
        others: list[Any] = [{"const": 0}] if self.interval is not None and self.interval.or_zero else []
        others += [{"enum": list(self.words)}] if self.words else []
        return {"anyOf": [numbers, *others]} if others else numbers

    def value(self, value: Any, key: str) -> Any:
        """Return `value` converted to the kind of this rule.

        Raises
        ------
        SceneError
            If the value is not allowed; the message names key, value and allowed values.
        """
        if self.kind is str and type(value) is int:  # the number of a branch
            value = str(value)
        if isinstance(value, str) and value in self.words:
            return value
        if self.kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value) if abs(value) < 1e300 else inf  # TOML writes 120 for 120.0
        right = isinstance(value, self.kind) and self.kind is not str  # words are handled above
        right = right and not (self.kind is int and isinstance(value, bool))
        if right and self.kind is float:
            right = isfinite(value)
        if not right or (self.interval is not None and value not in self.interval):
            raise SceneError(f"{key} = {shown(value)}: must be {self.allowed}")
        return self.kind(value)  # numpy's floats write themselves into a deck with their type


@dataclass(frozen=True)
class ArrayRule(Rule):
    """Allowed values of a key that holds numbers in brackets, one for each entry, or any number of such arrays.

    Attributes
    ----------
    entries : tuple of str
        What the numbers of an array are.
    several : bool
        True if the key holds a list of such arrays.
    """

    entries: tuple[str, ...] = ("row", "column")
    several: bool = False

    @property
    def _allowed_values(self) -> str:
        one = f"[{', '.join(self.entries)}], each {self._number._allowed_values}"
        return f"a list of {one}" if self.several else one

    @property
    def _number(self) -> Rule:
        return Rule(self.kind, self.unit, "", self.interval)

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of the arrays."""
        entries = {"minItems": len(self.entries), "maxItems": len(self.entries)}
        one = {"type": "array", "items": self._number.schema(), **entries}
        return {"type": "array", "items": one} if self.several else one

    def value(self, value: Any, key: str) -> Any:
        """Return `value` as a tuple of numbers, or of such tuples.

        Raises
        ------
        SceneError
            If it is no such array, or a number is not allowed.
        """
        if not isinstance(value, list | tuple):
            raise SceneError(f"{key} = {shown(value)}: must be {self.allowed}")
        if self.several:
            return tuple(replace(self, several=False).value(each, key) for each in value)
        if len(value) != len(self.entries):
            raise SceneError(f"{key} = {shown(list(value))}: must be {self.allowed}")
        named = zip(value, enumerate(self.entries), strict=True)
        return tuple(self._number.value(each, f"{key}[{place}] ({entry})") for each, (place, entry) in named)


@dataclass(frozen=True)
class NameRule(Rule):
    """A name of one's own that becomes part of file names and of names in LAMMPS."""

    @property
    def allowed(self) -> str:
        """Allowed values in words."""
        return f"a name of at most {LONGEST_PART} ASCII letters, digits and '_'"

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a name."""
        return {"type": "string", "pattern": f"^{NAME_PATTERN}$"}

    def value(self, value: Any, key: str) -> str:
        """Return `value`, or raise SceneError if it is no such name."""
        if not (isinstance(value, str) and re.fullmatch(NAME_PATTERN, value)):
            raise SceneError(f"{key} = {shown(value)}: must be {self.allowed}")
        return value


class Rules(dict[str, Rule]):
    """Rules for a record of another room, whose fields carry none; hashed by identity, so that its keys are kept."""

    def __hash__(self) -> int:  # type: ignore[override]  # a dict has none; these are never changed
        return id(self)


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
    """Return a dataclass field for a number in an interval."""
    interval = Interval(low, high, open_low, or_zero)
    return field(metadata={"rule": Rule(float, unit, meaning, interval, words)}, **default)


def count(meaning: str, low: int, high: int, *, words: tuple[str, ...] = (), **default: Any) -> Any:
    """Return a dataclass field for a whole number."""
    return field(metadata={"rule": Rule(int, "", meaning, Interval(low, high), words)}, **default)


def choice(meaning: str, options: tuple[str, ...], **default: Any) -> Any:
    """Return a dataclass field for one of several words."""
    return field(metadata={"rule": Rule(str, "", meaning, words=options)}, **default)


def flag(meaning: str, **default: Any) -> Any:
    """Return a dataclass field that is true or false."""
    return field(metadata={"rule": Rule(bool, "", meaning)}, **default)


def switch(meaning: str) -> Any:
    """Return a dataclass field that is true, false or "auto", the default."""
    return field(metadata={"rule": Rule(bool, "", meaning, words=(AUTO,))}, default=AUTO)


def plain_value(value: Any) -> Any:
    """Return numpy's numbers and arrays as Python's, in mappings and lists too; all else stays as it is.

    A scalar of numpy compares, but writes itself into a deck with its type, and JSON does not know it. Subclasses of
    arrays are left alone: they have units or masks, which a number would lose.
    """
    if isinstance(value, Mapping):
        return {key: plain_value(each) for key, each in value.items()}
    if isinstance(value, list):
        return [plain_value(each) for each in value]
    if isinstance(value, tuple):
        return tuple(plain_value(each) for each in value)
    if isinstance(value, np.generic) or type(value) is np.ndarray:
        value = value.tolist()
    return float(value) if isinstance(value, np.longdouble) else value


def short(value: float) -> str:
    """Return a number in its usual short form: 1e-9, 0.05, 10000000."""
    if isinstance(value, int):
        return str(value)
    mantissa, e, exponent = f"{value:g}".partition("e")
    return mantissa + (f"e{int(exponent)}" if e else "")


def head_lines(name: str, description: str) -> list[str]:
    """Return the lines of a scene file before its first table."""
    return [f"name = {toml(name)}", *([f"description = {toml(description)}"] if description else [])]


def toml(value: Any) -> str:
    """Return a scalar or an array as TOML: floats in the shortest form that reads back, 7.3e+10 for very large ones."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, float) and not 1e-4 <= abs(value) < 1e6 and value:
        return f"{Decimal(repr(value)).normalize():e}"
    return _JSON.encode(value)


def refuse_unknown(table: Mapping[str, Any], names: Iterable[str], prefix: str) -> None:
    """Raise SceneError for the first key that is not in `names`."""
    for key in table:
        if key not in names:
            raise SceneError(unknown_key(f"{prefix}{key}", key, names))


def unknown_key(whole: str, part: str, names: Iterable[str]) -> str:
    """Return what is wrong with a key, a part of which is none of `names`: not supported, misspelt, or not allowed."""
    return f"{cut(whole)}: {hint(part) or f'unknown key; {allowed_names(part, names)}'}"


def checked_description(tables: Mapping[str, Any]) -> str:
    """Return ``description`` of what was read, one line for a list of scenes; "" where there is none."""
    said = tables.get("description", "")
    if not isinstance(said, str) or not said.isprintable() or len(said) > LONGEST_DESCRIPTION:
        raise SceneError(
            f"description = {shown(said)}: must be one line of at most {LONGEST_DESCRIPTION} printable characters"
        )
    return said


def checked_name(tables: Mapping[str, Any], default: str, what: str) -> str:
    """Return the declared ``name``, or `default`, if it is allowed in file names on every system.

    `what` is the kind of file, for the error message.
    """
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
    """Return the name of a scene whose file declares none: the stem of the file, or the folder of ``scene.toml``."""
    file = file.absolute()
    return file.parent.name if file.name == "scene.toml" else file.stem


def allowed_names(key: str, names: Iterable[str], said: str = "allowed") -> str:
    """Return the closest allowed name for an error message, or all allowed names if none is close."""
    names = list(names)
    near = near_name(key, names)
    return f"did you mean '{near}'?" if near else f"{said}: {', '.join(names)}"


def near_name(word: str, names: Iterable[str]) -> str:
    """Return the name that is nearly a word, whatever its case; "" if none is close."""
    from difflib import get_close_matches  # kept out of start-up

    folded = {name.lower(): name for name in names}
    return next((folded[close] for close in get_close_matches(word.lower(), folded, n=1)), "")


def either(names: Iterable[str]) -> str:
    """Return names in words: '"driven" or "none"'."""
    return " or ".join(f'"{name}"' for name in names)


def shown(value: Any) -> str:
    """Return a value for an error message, cut to one line of 60 characters."""
    try:
        return cut(repr(value))
    except ValueError:  # Python writes no whole number of more than 4300 digits
        return "(a number of thousands of digits)"


def cut(text: str) -> str:
    """Return the first 60 characters of a text."""
    return text if len(text) <= 60 else text[:57] + "..."
