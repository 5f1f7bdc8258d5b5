"""Rules of declared values, as text and as a check; conversion of TOML tables to frozen records and back.

Each field of a record carries its rule in its metadata; the rule serves reading, checking, writing and error messages.
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
LONGEST_NAME = 200  # characters; file systems allow 255, and in.NAME.resume.part needs some of them
LONGEST_PART = 40  # characters, for a name that is part of file names
NAME_PATTERN = f"[A-Za-z0-9_]{{1,{LONGEST_PART}}}"
LONGEST_DESCRIPTION = 200  # characters: two lines of a terminal
_JSON = json.JSONEncoder(ensure_ascii=False)
_JSON_KINDS = {float: "number", int: "integer", bool: "boolean"}


@dataclass(frozen=True)
class Interval:
    """Interval from `low` to `high`; `open_low` excludes `low`, and `or_zero` allows 0 as well."""

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
    """Rule of one key of a scene: its allowed values and its meaning.

    Attributes
    ----------
    kind : type
        float, int, bool or str.
    unit : str
        Empty for a dimensionless number or a value that is not a number.
    meaning : str
        A phrase: the comment behind the key in a scene file and its entry in the reference.
    interval : Interval, optional
        Allowed range of a number.
    words : tuple of str
        Allowed words, alone or beside numbers and switches.
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
        """Return the value converted to the kind of this rule.

        Raises
        ------
        SceneError
            If the value is not allowed; the message names key, value and allowed values.
        """
        if self.kind is str and type(value) is int:  # a bare number names a branch
            value = str(value)
        if isinstance(value, str) and value in self.words:
            return value
        if self.kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value) if abs(value) < 1e300 else inf  # TOML writes 120 for 120.0
        right = isinstance(value, self.kind) and self.kind is not str  # words were handled above
        right = right and not (self.kind is int and isinstance(value, bool))
        if right and self.kind is float:
            right = isfinite(value)
        if not right or (self.interval is not None and value not in self.interval):
            raise SceneError(f"{key} = {shown(value)}: must be {self.allowed}")
        return self.kind(value)  # the text of a numpy float in a deck would include its type


@dataclass(frozen=True)
class ArrayRule(Rule):
    """Rule for a key that holds an array with one number for each entry, or any number of such arrays.

    Attributes
    ----------
    entries : tuple of str
        Names of the numbers in an array.
    several : bool
        True if the key holds a list of arrays.
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
        """Return the value as a tuple of numbers, or as a tuple of such tuples.

        Raises
        ------
        SceneError
            If the value is not such an array, or a number is not allowed.
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
    """Rule for a name that the user chooses and that becomes part of names of files and in LAMMPS."""

    @property
    def allowed(self) -> str:
        """Allowed values in words."""
        return f"a name of at most {LONGEST_PART} ASCII letters, digits and '_'"

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a name."""
        return {"type": "string", "pattern": f"^{NAME_PATTERN}$"}

    def value(self, value: Any, key: str) -> str:
        """Return the value; raise SceneError if it is not such a name."""
        if not (isinstance(value, str) and re.fullmatch(NAME_PATTERN, value)):
            raise SceneError(f"{key} = {shown(value)}: must be {self.allowed}")
        return value


class Rules(dict[str, Rule]):
    """Rules for a record of another room, whose fields carry none; hashed by identity, as keys of caches."""

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
    """Return numbers and arrays of numpy as those of Python, also inside mappings and lists.

    The text of a numpy scalar in a deck would include its type, and JSON does not know it. Subclasses of arrays do not
    change, because a plain number would lose their units or masks.
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
    """Return the usual short form of a number: 1e-9, 0.05, 10000000."""
    if isinstance(value, int):
        return str(value)
    mantissa, e, exponent = f"{value:g}".partition("e")
    return mantissa + (f"e{int(exponent)}" if e else "")


def head_lines(name: str, description: str) -> list[str]:
    """Return the lines of a scene file before its first table."""
    return [f"name = {toml(name)}", *([f"description = {toml(description)}"] if description else [])]


def toml(value: Any) -> str:
    """Return a scalar or an array as TOML; floats have the shortest form that reads back, such as 7.3e+10."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, float) and not 1e-4 <= abs(value) < 1e6 and value:
        return f"{Decimal(repr(value)).normalize():e}"
    return _JSON.encode(value)


def refuse_unknown(table: Mapping[str, Any], names: Iterable[str], prefix: str) -> None:
    """Raise SceneError for the first key that is not among the names."""
    for key in table:
        if key not in names:
            raise SceneError(unknown_key(f"{prefix}{key}", key, names))


def unknown_key(whole: str, part: str, names: Iterable[str]) -> str:
    """Return the error of an unknown key: not supported, misspelt, or not allowed."""
    return f"{cut(whole)}: {hint(part) or f'unknown key; {allowed_names(part, names)}'}"


def checked_description(tables: Mapping[str, Any]) -> str:
    """Return the ``description`` in a table, one line for a list of scenes; "" if there is none."""
    said = tables.get("description", "")
    if not isinstance(said, str) or not said.isprintable() or len(said) > LONGEST_DESCRIPTION:
        raise SceneError(
            f"description = {shown(said)}: must be one line of at most {LONGEST_DESCRIPTION} printable characters"
        )
    return said


def checked_name(tables: Mapping[str, Any], default: str, what: str) -> str:
    """Return the declared ``name``, or the default; raise SceneError if file names cannot hold it on every system.

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
    """Return the default name of a scene: the stem of its file, or the folder of a file ``scene.toml``."""
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
    except ValueError:  # Python refuses to write whole numbers of more than 4300 digits
        return "(a number of thousands of digits)"


def cut(text: str) -> str:
    """Return the first 60 characters of a text."""
    return text if len(text) <= 60 else text[:57] + "..."
