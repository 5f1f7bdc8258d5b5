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
    command : where it stands; None if a line is missing.
    what : what the deck does, with numbers.
    size : size of the error, a share of what it falsifies; None where it cannot be computed.
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
    name : by which it is printed.
    why : why it is wrong, in a sentence.
    find : function from what LAMMPS says of the deck to what is wrong.
    """

    name: str
    why: str
    find: Callable[[Reading], Iterator[Finding]]
