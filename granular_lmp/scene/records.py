"""Records of the tables of a scene: their keys, read and checked, and written back.

A record remembers which values were given, since a default may depend on the scene.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import MISSING, field, fields
from functools import cache
from typing import Any, ClassVar, Self

from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.schema import Rule, Rules, refuse_unknown, shown, toml

MOST_IN_LINE = 20  # arrays in an array


class GivenValues:
    """A record that knows which of its values were given."""

    __slots__ = ("_given",)
    __match_args__: ClassVar[tuple[str, ...]]  # names of the fields in their order, set by the dataclass
    _given: frozenset[str]

    def __new__(cls, *values: Any, **given: Any) -> Self:
        """Make the record and note the names of the given values; the class sets the fields."""
        new = super().__new__(cls)
        object.__setattr__(new, "_given", frozenset((*cls.__match_args__[: len(values)], *given)))
        return new

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_given": self._given}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)


def without_defaults(table: Any, differing: Collection[str] = ()) -> Any:
    """Return records as plain values without defaults.

    A given value that equals the default is kept if the default depends on the scene.

    Parameters
    ----------
    table : record, sequence of records, or plain value
    differing : collection of str
        Names of the keys whose default depends on the scene.

    Returns
    -------
    dict, list of dict, or the plain value
    """
    if isinstance(table, list | tuple):
        return [without_defaults(each) for each in table]
    if not hasattr(table, "__dataclass_fields__"):
        return table
    given = getattr(table, "_given", ())
    values = ((item, getattr(table, item.name)) for item in fields(table))
    return {
        item.name: value
        for item, value in values
        if value != item.default or (item.name in given and item.name in differing)
    }


def record(kind: type, table: Any, name: str, keys: Sequence["DeclaredKey"]) -> Any:
    """Return a record of type `kind` from the TOML table `name`; every value is checked.

    Raises
    ------
    SceneError
        If the table or a key is missing, a key is unknown, or a value is out of range; the message names it.
    """
    names = [key.name for key in keys]
    if table is None:
        if any(key.default is MISSING for key in keys):
            raise SceneError(f"{name}: missing table; it holds {', '.join(names)}")
        table = {}
    if not isinstance(table, Mapping):
        raise SceneError(f"{name} = {shown(table)}: must be a table that holds {', '.join(names)}")
    refuse_unknown(table, names, f"{name}.")
    values = {}
    for key in keys:
        if key.name not in table and key.default is MISSING:
            raise SceneError(f"{name}.{key.name}: missing key; must be {key.rule.allowed}")
        given = key.name in table
        values[key.name] = key.rule.value(table[key.name], f"{name}.{key.name}") if given else key.default
    return kind(**values)


def plain(record: Any, keys: Sequence["DeclaredKey"]) -> dict[str, Any]:
    """Return the values of the keys of a record by name."""
    return {key.name: getattr(record, key.name) for key in keys}


def toml_lines(values: Mapping[str, Any], keys: Sequence["DeclaredKey"]) -> list[str]:
    """Return a line ``key = value  # note`` for each key that has a value."""
    notes = {key.name: key.rule.note for key in keys}
    lines = ((f"{name} = {_in_lines(value)}", notes[name]) for name, value in values.items())
    return [f"{line:30} # {note}" if note else line for line, note in lines]


def _in_lines(value: Any) -> str:
    """Return a value as TOML; many arrays in an array stand one to a line."""
    if isinstance(value, list | tuple) and len(value) > MOST_IN_LINE and isinstance(value[0], list | tuple):
        return "[\n" + "".join(f"    {toml(each)},\n" for each in value) + "]"
    return toml(value)


@dataclass(frozen=True)
class DeclaredKey:
    """Key of a table: its name, its rule and its default, `MISSING` if the key must be given."""

    name: str
    rule: Rule
    default: Any

    @property
    def required(self) -> bool:
        """True if the key must be given."""
        return self.default is MISSING


@dataclass(frozen=True, eq=False)
class Variant:
    """Kind of scene: its own defaults, and the tables and keys that it cannot have.

    Attributes
    ----------
    defaults : mapping of str to value
        Dotted key → its default, `MISSING` if the key must be given.
    refused : mapping of str to str
        Table or dotted key → the message that refuses it.
    """

    defaults: Mapping[str, Any] = field(default_factory=dict)
    refused: Mapping[str, str] = field(default_factory=dict)


@cache  # a scene asks for these keys dozens of times
def declared_keys(
    kind: type, rules: Rules | None = None, table: str = "", variant: Variant | None = None
) -> Sequence[DeclaredKey]:
    """Return the keys of a record that a scene file can hold, in a `variant` of the scene if one is given."""
    own, other = rules or Rules(), variant or Variant()
    known = ((item, own.get(item.name) or item.metadata.get("rule")) for item in fields(kind))
    return tuple(
        DeclaredKey(item.name, rule, other.defaults.get(f"{table}.{item.name}", item.default))
        for item, rule in known
        if rule is not None and not {table, f"{table}.{item.name}"} & other.refused.keys()
    )
