"""The error of a theory that refuses: a caller shows its sentence as a reason, and no other error as one."""

from collections.abc import Sequence
from typing import TypeVar

Name = TypeVar("Name", bound=str)


class TheoryError(ValueError):
    """A theory whose name is unknown, or that leaves out what it is given."""


def one_of(allowed: Sequence[Name], said: str, what: str) -> Name:
    """Return the name that a scene says, or raise TheoryError if a theory knows no such name."""
    for name in allowed:
        if name == said:
            return name
    raise TheoryError(f"{what} = {said!r} is none of {tuple(allowed)}")
