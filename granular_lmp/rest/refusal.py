"""Line of the table of refusals: what cannot be combined, whether because of physics or not built, and the message."""

from collections.abc import Callable, Sequence

from granular_lmp.errors import Because
from granular_lmp.frozen import dataclass
from granular_lmp.rest.derived import Derived
from granular_lmp.scene.without_wave import HELD, NOT_HELD, WAVE

Says = Callable[[Derived], str]
ALL, AT_REST, WITHOUT_WAVE = (WAVE, HELD, NOT_HELD), (WAVE, HELD), (HELD, NOT_HELD)


@dataclass(frozen=True)
class Refusal:
    """Line of the table.

    Attributes
    ----------
    because : "physics", "not built" or "exclusive"
    says : callable
        Scene → its error, "" if there is none.
    of : sequence of str
        Kinds of scenes to which the line applies (`granular_lmp.scene.without_wave`).
    """

    because: Because
    says: Says
    of: Sequence[str]


def joining(lines: list[Refusal], of: Sequence[str]) -> Callable[..., Callable[[Says], Says]]:
    """Return a decorator that appends a function to the lines; by default they apply to these kinds of scenes."""

    def line(because: Because, *, of: Sequence[str] = of) -> Callable[[Says], Says]:
        def joined(says: Says) -> Says:
            lines.append(Refusal(because, says, of))
            return says

        return joined

    return line
