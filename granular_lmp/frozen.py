"""Frozen dataclasses that share their functions, so that modules with records import quickly.

The decorator of the standard library compiles six functions for each class, which takes half a millisecond: with 91
classes a seventh of a short run. Here the functions that make, compare, hash, show and freeze a record are written
once. They do the same, and also compare arrays. A frozen dataclass of the standard library cannot inherit from a
record.
"""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from copy import copy
from dataclasses import MISSING, FrozenInstanceError, fields
from functools import cache
from inspect import Signature, signature
from operator import attrgetter
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any


def _record(*, frozen: bool, eq: bool = True, repr: bool = True, init: bool = True) -> Callable[[type], type]:
    """Return the decorator of a frozen record, as `dataclasses.dataclass` does with these arguments."""
    if not frozen:
        raise TypeError("a record of granular_lmp is frozen")
    shared: dict[str, Any] = {"__setattr__": _set_once, "__delattr__": _refuse_deletion}
    shared |= {"__eq__": _equal, "__hash__": _hashed} if eq else {}
    shared |= {"__repr__": _shown} if repr else {}
    shared |= {"__init__": _filled, "__signature__": _Signature()} if init else {}

    def made(kind: type) -> type:
        for name in shared.keys() - vars(kind).keys():
            setattr(kind, name, shared[name])
        return dataclasses.dataclass(init=False, eq=False, repr=False)(kind)

    return made


if TYPE_CHECKING:  # type checkers read the records as dataclasses of the standard library
    from dataclasses import dataclass as dataclass
    from functools import cached_property as cached_property
else:
    dataclass = _record

    class cached_property(functools.cached_property):  # noqa: N801 (as the one of the standard library)
        """Property that is computed once, without the lock of Python 3.11, which later versions dropped.

        The lock is shared by all records of a class: a process forked while a thread holds it would wait for ever.
        """

        def __init__(self, function):
            super().__init__(function)
            self.lock = nullcontext()


class _Signature:
    """Signature of a kind of record."""

    def __get__(self, _: Any, kind: Any) -> Signature:
        return signature(_standard(kind))


def _standard(kind: Any) -> Any:
    """Return a dataclass of the standard library with the fields of a kind of record."""
    return dataclasses.make_dataclass(kind.__name__, [(item.name, item.type, copy(item)) for item in fields(kind)])


@cache
def _arguments(kind: Any) -> tuple[list[str], dict[str, Any], set[str], dict[str, Callable[[], Any]]]:
    """Return fields of a kind of record: positional, all with their defaults, required, and factories."""
    every = fields(kind)
    factories = {item.name: item.default_factory for item in every if item.default_factory is not MISSING}
    required = {item.name for item in every if item.default is MISSING} - factories.keys()
    return [i.name for i in every if not i.kw_only], {i.name: i.default for i in every}, required, factories


def _filled(self: Any, *given: Any, **named: Any) -> None:
    """Make a record from the values of its fields."""
    kind = self.__class__
    names, defaults, required, factories = _arguments(kind)
    said = dict(zip(names, given, strict=False)) | named
    values = defaults | said
    if len(said) < len(given) + len(named) or len(values) > len(defaults) or not required <= said.keys():
        _standard(kind)(*given, **named)  # raises the TypeError
    for name, make in factories.items():
        if name not in said:
            values[name] = make()
    self.__dict__.update(values)
    if hasattr(self, "__post_init__"):
        self.__post_init__()


def _set_once(self: Any, name: str, value: Any) -> None:
    """Set a field that has no value yet: ``__init__`` does so."""
    values = self.__dict__
    if name in values or name not in self.__dataclass_fields__:
        raise FrozenInstanceError(f"cannot assign to field {name!r}")
    values[name] = value


def _refuse_deletion(_: Any, name: str) -> None:
    raise FrozenInstanceError(f"cannot delete field {name!r}")


@cache
def _reader(kind: Any) -> Callable[[Any], tuple[Any, ...]]:
    """Return the function that reads the compared values of a kind of record."""
    names = [item.name for item in fields(kind) if item.compare]
    if len(names) > 1:
        return attrgetter(*names)
    return lambda record: tuple(getattr(record, name) for name in names)


def _values(record: Any) -> tuple[Any, ...]:
    return _reader(record.__class__)(record)


def _equal(self: Any, other: object) -> Any:
    if self.__class__ is not other.__class__:
        return NotImplemented
    own, others = _values(self), _values(other)
    try:
        return own == others
    except ValueError:  # the comparison of two arrays is an array
        return _alike(own, others)


def _alike(one: Any, other: Any) -> bool:
    """Return whether two values are equal, with arrays of equal shapes and elements; nan equals nan."""
    from numpy import ndarray  # if there are arrays, numpy is loaded

    if isinstance(one, ndarray) and isinstance(other, ndarray):
        return one.shape == other.shape and bool(((one == other) | ((one != one) & (other != other))).all())
    if isinstance(one, ndarray) or isinstance(other, ndarray):
        return False
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_alike(one[key], other[key]) for key in one)
    if isinstance(one, tuple | list) and type(one) is type(other):
        return len(one) == len(other) and all(map(_alike, one, other))
    return bool(one == other)


def _hashed(self: Any) -> int:
    return hash(_values(self))


@recursive_repr()
def _shown(self: Any) -> str:
    shown = [f"{item.name}={getattr(self, item.name)!r}" for item in fields(self) if item.repr]
    return f"{self.__class__.__qualname__}({', '.join(shown)})"
