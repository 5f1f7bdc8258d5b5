"""Findings in a deck, and the checks that make them."""

from collections.abc import Callable, Iterator

from granular_lmp.foreign.interpreter import Command
from granular_lmp.foreign.reading import Reading
from granular_lmp.frozen import dataclass


@dataclass(frozen=True)
class Finding:
    """Something that may be wrong with a deck.

    Attributes
    ----------
    command : the command at fault; None if a line is missing.
    what : what the deck does, with numbers.
    size : relative size of the error; None if it cannot be computed.
    mend : what to write instead.
    """

    command: Command | None
    what: str
    size: float | None
    mend: str


@dataclass(frozen=True)
class Check:
    """One thing that can be wrong with a deck.

    Attributes
    ----------
    name : name of the check in the output.
    why : the reason, in a sentence.
    find : function that yields the findings in a deck.
    """

    name: str
    why: str
    find: Callable[[Reading], Iterator[Finding]]
