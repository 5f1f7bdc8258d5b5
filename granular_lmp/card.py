"""The card of a scene, a deck, a record or a sweep in a notebook, which `granular_lmp.plot.notebook` draws."""


class HasCard:
    """A thing of which a notebook shows a card in place of its one line."""

    def _repr_html_(self) -> str:
        """Return the card as HTML; the room of pictures is imported when it is asked for."""
        from granular_lmp.plot.notebook import html  # matplotlib takes longer to load than most runs

        return html(self)
