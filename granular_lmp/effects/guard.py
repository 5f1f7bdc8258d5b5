"""Guard: a number that LAMMPS measures to detect an effect that a deck leaves out.

Each guard is defined in the file of its effect. `granular_lmp.lammps.guards` writes it into the deck and evaluates it.
"""

from collections.abc import Callable, Mapping
from typing import Protocol

from granular_lmp.effects.between_looks import hidden
from granular_lmp.frozen import dataclass
from granular_lmp.rest.face import Rest
from granular_lmp.rest.resolution import gathered_rounding
from granular_lmp.rest.scene import Scene
from granular_lmp.units import AnyUnits

NEVER = 1e20  # τ of a limit that was not passed; the minimum of an empty set in LAMMPS

# A quantity that a symmetry forbids stays below 2 times the `gathered_rounding` of its run: 1e-10 D0 for a = 0.2, 201
# rows and 2400 steps. A millionth of the wave is far above this, yet harmless.
BROKEN_SYMMETRY = 1e-6
ROUNDINGS = 20.0


class Prepared(Protocol):
    """Part of `granular_lmp.problem.Problem` that the lines of effects and guards use."""

    @property
    def scene(self) -> Scene: ...
    @property
    def on(self) -> Mapping[str, bool]: ...
    @property
    def units(self) -> AnyUnits: ...
    @property
    def rest(self) -> Rest: ...


Lines = Callable[[Prepared], list[str]]


def watches_part(scene: Scene) -> bool:
    """Return whether only some spheres affect the record: with walls or a finite wave, if the centre is recorded."""
    if scene.wave is None:  # recorded spheres may be anywhere
        return False
    return scene.output.particles == 0 and (bool(scene.shape.faces) or scene.envelope.finite)


@dataclass(frozen=True)
class Guard:
    """Guard of a deck.

    Attributes
    ----------
    title : str
        Name in ``run.json``.
    name : str
        Name of the variable in the deck, a column of the thermo table, where every look is a line.
    lines : callable
        Problem → lines of the deck that compute the variable NAME.
    limit : float
        Value above which the guard triggers.
    meaning : str
        Meaning of a larger value, for the message.
    cure : str
        Advice for the user, for the message.
    roundings : float
        Multiple of the `gathered_rounding` of positions to add to the limit.
    hides : bool
        True if the limit is lowered by what two looks may miss (`granular_lmp.effects.between_looks`).
    of_contacts : bool
        True if the lines read `granular_lmp.effects.reading.contact_lines` or `overlap_lines`.
    per_contact : callable
        Scene → True if the measured value does not always decide, so that contacts are dumped while it does not.
    where : callable
        Scene → True if such scenes have the guard.
    heading : str
        Words after the column in the last lines of a deck, with ``{limit}`` for the limit; "" means those of `meaning`.
    """

    title: str
    name: str
    lines: Lines
    limit: float
    meaning: str
    cure: str
    roundings: float = 0.0
    hides: bool = False
    of_contacts: bool = False
    per_contact: Callable[[Scene], bool] = lambda scene: False
    where: Callable[[Scene], bool] = lambda scene: True
    heading: str = ""

    @property
    def column(self) -> str:
        """Name of the thermo column of the extreme."""
        return f"v_{self.name}"

    def limit_in(self, problem: Prepared, every: float | None = None) -> float:
        """Return the limit above which the guard triggers, for `every` τ between looks, by default as in the deck."""
        if self.roundings:
            return self.limit + self.roundings * gathered_rounding(problem.scene)
        return self.limit * (1 - hidden(problem.rest, every)) if self.hides else self.limit
