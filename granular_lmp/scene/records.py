"""Records of the tables of a scene: their keys, read and checked, and written back.

A record that a script makes remembers which values it was given, since a default may depend on the scene.
"""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields
from functools import cache
from typing import Any, Self

from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.schema import Rule, Rules, refuse_unknown, shown, toml

MOST_IN_LINE = 20  # arrays in an array


class Remembering:
    """A record that remembers which of its values were given."""

    __slots__ = ("_given",)
    _given: frozenset[str]

    def __new__(cls, *values: Any, **given: Any) -> Self:
        """Make the record, whose fields its class sets."""
        made = super().__new__(cls)
        names = [item.name for item in fields(cls)][: len(values)]  # type: ignore[arg-type]  # a dataclass later
        object.__setattr__(made, "_given", frozenset((*names, *given)))
        return made

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_given": self._given}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)


def said(table: Any) -> Any:
    """Return what records say, as plain values: what departs from a default.

    A value that was given is said too if its default depends on the scene.

    Parameters
    ----------
    table : record, sequence of records, or plain value

    Returns
    -------
    dict, list of dict, or the plain value
    """
    if isinstance(table, list | tuple):
        return [said(each) for each in table]
    if not hasattr(table, "__dataclass_fields__"):
        return table
    given = getattr(table, "_given", ())
    values = ((item, getattr(table, item.name)) for item in fields(table))
    return {
        item.name: value for item, value in values if value != item.default or (item.name in given and _depends(item))
    }


def _depends(item: "Field[Any]") -> bool:
    """Return whether a scene without ``[wave]`` has the key of a field with another default."""
    other = item.metadata["rule"].bare if "rule" in item.metadata else None
    return other is not None and other.rule is not None and other.default != item.default


def record(kind: type, table: Any, name: str, rules: Rules | None = None, *, bare: bool = False) -> Any:
    """Return the record of type `kind` from the TOML table `name` with every value checked.

    `bare` is true for a scene without ``[wave]``.

    Raises
    ------
    SceneError
        If the table or a key is missing, a key is unknown, or a value is out of range; the message names it.
    """
    keys = declared_keys(kind, rules, bare=bare)
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


def plain(record: Any, rules: Rules | None = None, *, bare: bool = False) -> dict[str, Any]:
    """Return the declared values of a record by name."""
    return {key.name: getattr(record, key.name) for key in declared_keys(record.__class__, rules, bare=bare)}


def toml_lines(kind: type, values: Mapping[str, Any], rules: Rules | None = None, *, bare: bool = False) -> list[str]:
    """Return a line ``key = value  # note`` for each of the values, which belong to a record of type `kind`."""
    notes = {key.name: key.rule.note for key in declared_keys(kind, rules, bare=bare)}
    lines = ((f"{name} = {_in_lines(value)}", notes[name]) for name, value in values.items())
    return [f"{line:30} # {note}" if note else line for line, note in lines]


def _in_lines(value: Any) -> str:
    """Return a value as TOML, arrays in an array one to a line where there are many."""
    if isinstance(value, list | tuple) and len(value) > MOST_IN_LINE and isinstance(value[0], list | tuple):
        return "[\n" + "".join(f"    {toml(each)},\n" for each in value) + "]"
    return toml(value)


@dataclass(frozen=True)
class DeclaredKey:
    """A key of a table: its name, its rule, and its default, `MISSING` where it must be given."""

    name: str
    rule: Rule
    default: Any

    @property
    def required(self) -> bool:
        """True if it must be given."""
        return self.default is MISSING


@cache  # a scene asks for them dozens of times
def declared_keys(kind: type, rules: Rules | None = None, *, bare: bool = False) -> Sequence[DeclaredKey]:
    """Return the keys of a record that a scene file holds; `bare` is true for a scene without ``[wave]``."""
    own = rules or Rules()
    known = ((item, own.get(item.name) or item.metadata.get("rule")) for item in fields(kind))
    found = (_declared(item, rule, bare) for item, rule in known if rule is not None)
    return tuple(key for key in found if key is not None)


def _declared(item: "Field[Any]", rule: Rule, bare: bool) -> DeclaredKey | None:
    other = rule.bare
    if other is None or not (bare or other.only):
        return DeclaredKey(item.name, rule, item.default)
    if not bare or other.rule is None:
        return None
    return DeclaredKey(item.name, other.rule, other.default)
