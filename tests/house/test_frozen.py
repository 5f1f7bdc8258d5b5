"""Records of the package behave like frozen dataclasses of the standard library, and all of them are ours."""

import copy
import dataclasses
import pickle
from dataclasses import FrozenInstanceError, field, fields, replace
from inspect import signature
from threading import Thread
from typing import Any

import numpy as np
import pytest

from granular_lmp import frozen
from tests.house.test_independence import FOLDERS, imports, sources


def grain(decorator: Any, **options: bool) -> Any:
    @decorator(frozen=True, **options)
    class Grain:
        """A sphere."""

        radius: float
        names: tuple[str, ...] = ()
        marks: list[int] = field(default_factory=list, compare=False, repr=False)

    return Grain


OURS, THEIRS = grain(frozen.dataclass), grain(dataclasses.dataclass)
KINDS = pytest.mark.parametrize("kind", [OURS, THEIRS], ids=["ours", "theirs"])


@frozen.dataclass(frozen=True)
class Alone:
    """A record at the top of a module, where pickle finds it."""

    radius: float


@frozen.dataclass(frozen=True)
class Coated(Alone):
    """A record that has more fields than the one it is made of."""

    coat: float = 0.0


@KINDS
def test_records_of_equal_values_are_equal_and_have_one_hash(kind: Any) -> None:
    assert kind(1.0, marks=[1]) == kind(1.0, marks=[2])
    assert hash(kind(1.0)) == hash(kind(1.0)) == hash((1.0, ()))
    assert kind(1.0) != kind(2.0)
    assert kind(1.0) != (1.0, (), [])


@frozen.dataclass(frozen=True)
class Heap:
    """A record of arrays."""

    radius: np.ndarray
    fields: dict[str, tuple[np.ndarray, ...]]


def heap(last: float = np.nan, size: int = 3) -> Heap:
    return Heap(np.ones(size), {"u": (np.zeros(2), np.array([1.0, last]))})


def test_records_with_arrays_are_equal_if_all_elements_are() -> None:
    assert heap() == heap()
    assert heap(2.0) in [heap(), heap(2.0)]
    assert heap(2.0) not in [heap(), heap(3.0), heap(2.0, size=2), Heap(np.ones(3), {}), Heap(None, heap(2.0).fields)]


def test_records_of_two_kinds_are_never_equal() -> None:
    assert Alone(1.0) != Coated(1.0)
    assert Coated(1.0) != Coated(1.0, 2.0)


@KINDS
def test_a_record_is_not_changed(kind: Any) -> None:
    made = kind(1.0)
    for name in ("radius", "names", "marks", "unknown"):
        with pytest.raises(FrozenInstanceError, match=f"cannot assign to field '{name}'"):
            setattr(made, name, 2.0)
        with pytest.raises(FrozenInstanceError, match=f"cannot delete field '{name}'"):
            delattr(made, name)
    assert (made.radius, replace(made, radius=2.0).radius) == (1.0, 2.0)


def test_a_record_shows_itself_and_its_arguments_as_that_of_the_standard_library() -> None:
    assert repr(OURS(1.0, ("a",))) == repr(THEIRS(1.0, ("a",))) == "grain.<locals>.Grain(radius=1.0, names=('a',))"
    assert str(signature(OURS)) == str(signature(THEIRS))
    assert [item.name for item in fields(OURS)] == [item.name for item in fields(THEIRS)]


@pytest.mark.parametrize(
    ("given", "named"),
    [((), {}), ((1.0,), {"radius": 1.0}), ((1.0,), {"mass": 1.0}), ((), {"names": ()}), ((1.0, (), [], 1), {})],
    ids=["missing", "twice", "unknown", "missing, another given", "too many"],
)
def test_wrong_arguments_are_refused_in_the_words_of_the_standard_library(given: Any, named: Any) -> None:
    with pytest.raises(TypeError) as theirs:
        THEIRS(*given, **named)
    with pytest.raises(TypeError) as ours:
        OURS(*given, **named)
    assert str(theirs.value).endswith(str(ours.value))


@pytest.mark.parametrize("decorator", [frozen.dataclass, dataclasses.dataclass], ids=["ours", "theirs"])
def test_without_comparison_a_record_equals_itself_alone(decorator: Any) -> None:
    kind = grain(decorator, eq=False, repr=False)
    made = kind(1.0)
    assert made == made != kind(1.0)
    assert hash(made) == object.__hash__(made)
    assert repr(made) == object.__repr__(made)


def test_a_record_is_copied_and_pickled() -> None:
    made = Coated(1.0, 2.0)
    assert copy.copy(made) == copy.deepcopy(made) == pickle.loads(pickle.dumps(made)) == made


def test_a_record_that_is_not_frozen_is_refused() -> None:
    with pytest.raises(TypeError, match="frozen"):
        frozen.dataclass(frozen=False)


def test_every_record_of_the_package_is_ours() -> None:
    paths = [path for path in sources(FOLDERS["granular_lmp"]) if path.name != "frozen.py"]
    others = {"dataclasses.dataclass", "functools.cached_property"}
    assert [path for path in paths if others & imports(path.read_text())] == []


def test_a_record_does_not_wait_for_another_whose_property_is_computed() -> None:
    # Else a process that is forked meanwhile waits for ever. Python 3.11's own property fails this test
    class Grain:
        def __init__(self, outer: "Grain | None" = None) -> None:
            self.outer = outer

        @frozen.cached_property
        def known_meanwhile(self) -> bool:
            if self.outer is not None:
                return True
            inner = Grain(self)
            thread = Thread(target=lambda: inner.known_meanwhile)
            thread.start()
            thread.join(10)
            return "known_meanwhile" in vars(inner)

    assert Grain().known_meanwhile
