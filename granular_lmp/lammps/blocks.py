"""Block of a deck: a group of lines, as a function of the problem.

`granular_lmp.lammps.deck` lists the blocks in order. A block without lines is left out. An input that continues a run
from a checkpoint contains the blocks with `Block.again`.
"""

from collections.abc import Callable, Iterable

from granular_lmp.frozen import dataclass
from granular_lmp.problem import Problem

Lines = Callable[[Problem], list[str]]
Continued = Callable[[Problem, str], list[str]]


@dataclass(frozen=True)
class Block:
    """Block of a deck.

    Attributes
    ----------
    lines : callable
        Lines in the deck of a problem, [] if it has no such block.
    again : bool or callable
        True if an input that continues a run repeats the lines, False if it omits them, or a function of the problem
        and the name of the checkpoint that returns other lines.
    """

    lines: Lines
    again: bool | Continued = True

    def continued(self, problem: Problem, checkpoint: str) -> list[str]:
        """Return the lines in the input that continues from a checkpoint."""
        if callable(self.again):
            return self.again(problem, checkpoint)
        return self.lines(problem) if self.again else []


def apart(blocks: Iterable[list[str]]) -> list[str]:
    """Return the lines of several blocks as one block, with empty lines between them."""
    return [line for lines in blocks for line in ("", *lines)][1:]


def text_of(blocks: Iterable[list[str]]) -> str:
    """Return the text of blocks, with empty lines between them."""
    return "\n\n".join("\n".join(lines) for lines in blocks if lines) + "\n"
