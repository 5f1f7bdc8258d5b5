"""A line of the table of refusals: what does not go together, whether that is physics or not built, and the message."""

from collections.abc import Callable, Sequence

from granular_lmp.errors import Because
from granular_lmp.frozen import dataclass
from granular_lmp.rest.derived import Derived
from granular_lmp.scene.without_wave import HELD, NOT_HELD, WAVE

Says = Callable[[Derived], str]
ALL, AT_REST, WITHOUT_WAVE = (WAVE, HELD, NOT_HELD), (WAVE, HELD), (HELD, NOT_HELD)


@dataclass(frozen=True)
class Refusal:
    """A line of the table.

    Attributes
    ----------
    because : "physics", "not built" or "exclusive"
    says : callable
        Scene → what is wrong with it, "" if nothing is.
    of : sequence of str
        Kinds of scenes that the line is about (`granular_lmp.scene.without_wave`).
    """

    because: Because
    says: Says
    of: Sequence[str]


def joining(lines: list[Refusal], of: Sequence[str]) -> Callable[..., Callable[[Says], Says]]:
    """Return the decorator that appends a function to lines, which are about these kinds of scenes by default."""

    def line(because: Because, *, of: Sequence[str] = of) -> Callable[[Says], Says]:
        def joined(says: Says) -> Says:
            lines.append(Refusal(because, says, of))
            return says

        return joined

    return line
