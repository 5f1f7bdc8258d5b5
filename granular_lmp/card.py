"""Pictures of a scene, a deck, a record or a sweep, whose rooms stand below that of pictures and do not import it."""

from collections.abc import Callable
from typing import Any

# Functions of `granular_lmp.plot` by name. The package's door fills it with functions that import the room when they
# are called: matplotlib takes longer to load than most runs.
PAINTERS: dict[str, Callable[..., Any]] = {}


class HasCard:
    """A thing of which a notebook shows a card in place of its one line."""

    def _repr_html_(self) -> str:
        """Return the card as HTML."""
        return str(PAINTERS["html"](self))
