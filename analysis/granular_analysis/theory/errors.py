"""Error by which a theory refuses a run; callers show its message as the reason, and pass on all other errors."""

from collections.abc import Sequence
from typing import TypeVar

Name = TypeVar("Name", bound=str)


class TheoryError(ValueError):
    """The theory is unknown, or excludes a property of its input."""


def one_of(allowed: Sequence[Name], said: str, what: str) -> Name:
    """Return the allowed name that equals `said`; TheoryError naming the key `what` if there is none."""
    for name in allowed:
        if name == said:
            return name
    raise TheoryError(f"{what} = {said!r}: must be one of {', '.join(allowed)}")
