"""The guard: a number that LAMMPS measures to see whether an effect that a deck leaves out occurs.

Each guard is defined in the file of its effect. `granular_lmp.lammps.guards` writes it into the deck and judges its
result.
"""

from collections.abc import Callable, Mapping
from typing import Protocol

from granular_lmp.effects.between_looks import hidden
from granular_lmp.frozen import dataclass
from granular_lmp.rest.face import Rest
from granular_lmp.rest.resolution import gathered_rounding
from granular_lmp.rest.scene import Scene
from granular_lmp.units import AnyUnits

NEVER = 1e20  # tau of a limit that was not passed; LAMMPS's minimum of an empty set

# A quantity that a symmetry forbids stays at the `gathered_rounding` of its run, up to 2 times that. For a = 0.2, 201
# rows and 2400 steps that is 1e-10 D0. A millionth of the wave is far above it, yet harmless.
BROKEN_SYMMETRY = 1e-6
ROUNDINGS = 20.0


class Prepared(Protocol):
    """A `granular_lmp.problem.Problem`, as the lines of effects and guards see it."""

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
    """Return whether only some spheres affect the record: with walls or a finite wave, recorded at the centre."""
    if scene.wave is None:  # the spheres that are recorded are anywhere
        return False
    return scene.output.particles == 0 and (bool(scene.shape.faces) or scene.envelope.finite)


@dataclass(frozen=True)
class Guard:
    """One guard.

    Attributes
    ----------
    title : str
        Name in ``run.json``.
    name : str
        Name of the variable in the deck; every look is a line of the thermo table that holds it.
    lines : callable
        Lines of a deck that compute the variable NAME, of a problem.
    limit : float
        Value above which the guard triggers.
    meaning : str
        Meaning of a larger value, for the message.
    cure : str
        Advice for the user, for the message.
    roundings : float
        Multiple of the `gathered_rounding` of positions that is added to the limit.
    hides : bool
        True if the limit is lower by what may hide between two looks (`granular_lmp.effects.between_looks`).
    of_contacts : bool
        True if the lines read `granular_lmp.effects.reading.contact_lines` or `overlap_lines`.
    per_contact : callable
        Scene → True if what LAMMPS measures does not always decide, and contacts are dumped while it does not.
    where : callable
        Scene → True if the guard is one of such scenes.
    heading : str
        Words behind the column in the last lines of a deck, with ``{limit}`` for the limit; "" for those of `meaning`.
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
        """Return the limit above which the guard triggers, with `every` τ between two looks, or those of the deck."""
        if self.roundings:
            return self.limit + self.roundings * gathered_rounding(problem.scene)
        return self.limit * (1 - hidden(problem.rest, every)) if self.hides else self.limit
