"""Frozen dataclasses whose functions are shared, so that a module with records is imported quickly.

The decorator of the standard library compiles six functions for each class: half a millisecond, and with 84 classes a
tenth of a short run. Here nothing is compiled. What makes, compares, hashes, shows and freezes a record is written
once, below, and does the same. A frozen dataclass of the standard library cannot inherit from a record.
"""

import dataclasses
import inspect
from collections.abc import Callable
from dataclasses import MISSING, FrozenInstanceError, fields
from functools import cache
from itertools import repeat
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any


class _Arguments:
    """The signature of a record, made when it is asked for."""

    def __get__(self, record: Any, kind: Any) -> inspect.Signature | None:
        """Return that of the standard library; None for a class with its own ``__init__``."""
        items = [(item.name, item.type, item) for item in fields(kind)]
        return inspect.signature(dataclasses.make_dataclass(kind.__name__, items)) if kind.__init__ is _begin else None


def _record(*, frozen: bool, eq: bool = True, repr: bool = True, init: bool = True) -> Callable[[type], type]:
    """Return the decorator of a frozen record, as `dataclasses.dataclass` does with these arguments."""
    if not frozen:
        raise TypeError("a record of granular_lmp is frozen")
    shared: dict[str, Any] = {"__setattr__": _refuse_change, "__delattr__": _refuse_deletion}
    shared |= {"__init__": _begin, "__signature__": _Arguments()} if init else {}
    shared |= {"__eq__": _equal, "__hash__": _hashed} if eq else {}
    shared |= {"__repr__": _shown} if repr else {}

    def made(kind: type) -> type:
        for name in shared.keys() - vars(kind).keys():
            setattr(kind, name, shared[name])
        return dataclasses.dataclass(init=False, eq=False, repr=False)(kind)

    return made


if TYPE_CHECKING:  # a checker of types reads the records as those of the standard library
    from dataclasses import dataclass as dataclass
else:
    dataclass = _record


@cache
def _arguments(kind: Any) -> tuple[list[str], frozenset[str], dict[str, Any], dict[str, Callable[[], Any]]]:
    """Return the fields that may be given in turn, all fields, the defaults, and the functions that make defaults."""
    items = fields(kind)
    defaults = {item.name: item.default for item in items if item.default is not MISSING}
    makers: dict[str, Any] = {item.name: item.default_factory for item in items if item.default_factory is not MISSING}
    return [item.name for item in items if not item.kw_only], frozenset(item.name for item in items), defaults, makers


def _begin(self: Any, /, *values: Any, **named: Any) -> None:
    """Set the fields of a new record."""
    kind = self.__class__
    in_turn, names, defaults, makers = _arguments(kind)
    given = dict(zip(in_turn, values, strict=False)) | named
    made = {name: maker() for name, maker in makers.items() if name not in given}
    found = vars(self)
    found.update(defaults, **made, **given)
    if len(given) < len(values) + len(named) or found.keys() != names:
        inspect.signature(kind).bind(*values, **named)  # raises a TypeError that names the argument
    if hasattr(kind, "__post_init__"):
        self.__post_init__()


def _refuse_change(self: Any, name: str, value: Any) -> None:
    raise FrozenInstanceError(f"cannot assign to field {name!r}")


def _refuse_deletion(self: Any, name: str) -> None:
    raise FrozenInstanceError(f"cannot delete field {name!r}")


@cache
def _compared(kind: Any) -> tuple[str, ...]:
    return tuple(item.name for item in fields(kind) if item.compare)


def _values(record: Any) -> tuple[Any, ...]:
    return tuple(map(getattr, repeat(record), _compared(record.__class__)))


def _equal(self: Any, other: object) -> Any:
    return _values(self) == _values(other) if self.__class__ is other.__class__ else NotImplemented


def _hashed(self: Any) -> int:
    return hash(_values(self))


@recursive_repr()
def _shown(self: Any) -> str:
    shown = [f"{item.name}={getattr(self, item.name)!r}" for item in fields(self) if item.repr]
    return f"{self.__class__.__qualname__}({', '.join(shown)})"
