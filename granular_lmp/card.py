"""Pictures of a scene, a deck, a record or a sweep, for rooms that must not import the room of pictures."""

from collections.abc import Callable
from typing import Any

# Functions of `granular_lmp.plot` by name. The package fills it with functions that import the room when they are
# called, because matplotlib takes longer to load than most runs.
PAINTERS: dict[str, Callable[..., Any]] = {}


class HasCard:
    """Object that a notebook shows as a card in place of one line of text."""

    def _repr_html_(self) -> str:
        """Return the card as HTML."""
        return str(PAINTERS["html"](self))
