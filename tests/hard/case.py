"""One figure of the stability table: what was reached, between which bounds it has to lie, and why those."""

from dataclasses import dataclass
from math import inf


@dataclass(frozen=True)
class Case:
    """A measured figure with its bounds.

    Attributes
    ----------
    name : str
        What was measured.
    hard : str
        Why it could fail.
    figure : float
    reason : str
        Where the bounds come from: physics or arithmetic, never the measurement.
    most, least : float
    """

    name: str
    hard: str
    figure: float
    reason: str
    most: float = inf
    least: float = -inf

    @property
    def holds(self) -> bool:
        """Return whether the figure is within its bounds; a nan is not."""
        return self.least <= self.figure <= self.most

    @property
    def bound(self) -> str:
        """The bounds in words."""
        if self.least == self.most:
            return f"{self.most:.3g}"
        if self.least == -inf:
            return f"≤ {self.most:.3g}"
        return f"≥ {self.least:.3g}" if self.most == inf else f"{self.least:.3g} … {self.most:.3g}"

    def __str__(self) -> str:
        return f"{self.name}: {self.figure:.3g}, must be {self.bound} ({self.reason})"


Cases = list[Case]
Edits = tuple[tuple[str, str], ...]  # pieces of a deck and what replaces them: how a test breaks a deck on purpose
