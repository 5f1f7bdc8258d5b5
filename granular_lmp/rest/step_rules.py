"""Rules for the time step, for a declared step and for the first run to a tolerance."""

from collections.abc import Iterable
from math import inf

from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.sections import Sampled

# A mode at this share of the stability limit has an amplitude 1/√(1 − share²) = 1.4 times too large; the rest is a
# margin for spheres of an impact that later overlap more deeply
COARSEST = 0.7
STEPS_IN_COLLISION = 10.0  # Fewest steps in the shortest collision; the error of velocities is then 3 %
LONGEST_STEP = 0.5  # Longest step over 1/ω of the stiffest contact; a collision then has ten steps


@dataclass(frozen=True)
class StepRule:
    """Rule for the time step of a scene.

    Attributes
    ----------
    longest : float
        Longest allowed step, in units of the time of the scene.
    first : float
        Longest step with which runs to a tolerance may begin.
    sentence : str
        Error of a longer step, and the remedy.
    """

    longest: float
    first: float
    sentence: str


def refuse_step(time: Sampled, rules: Iterable[StepRule]) -> None:
    """Raise SceneError if a declared time step breaks a rule."""
    step = time.clock.of_answer
    for rule in rules:
        if step > rule.longest:
            raise SceneError(f"time.timestep = {time.timestep!r}: {rule.sentence}")


def rules_of_collisions(collision: float, rate: float, drag: float = 0.0) -> list[StepRule]:
    """Return the rules for spheres that meet.

    Parameters
    ----------
    collision : float
        Shortest collision of two neighbours, t0.
    rate : float
        ω of the stiffest contact at the beginning, 1/t0; 0 if all spheres just touch.
    drag : float
        Rate at which dashpots slow a motion, 1/t0. Since dashpots use the last velocity, the motion would grow if rate
        × step is 2 or more.
    """
    few, stiff, slow = collision / STEPS_IN_COLLISION, *(LONGEST_STEP / each if each else inf for each in (rate, drag))
    return [
        StepRule(
            few,
            COARSEST * few,
            f"leaves the shortest collision of two neighbours, {collision:.4g} t0, fewer than {STEPS_IN_COLLISION:g} "
            f"steps; must be at most {few:.4g}, and at most {few / 8:.2g} for errors of 1e-4",
        ),
        StepRule(
            stiff,
            COARSEST * stiff,
            f"is above {LONGEST_STEP:g}/omega of the stiffest contact at the beginning, omega = {rate:.4g} per t0; "
            f"must be at most {stiff:.4g}",
        ),
        StepRule(
            slow,
            COARSEST * slow,
            f"is above {LONGEST_STEP:g} of the time in which effects.viscosity stops a sphere; must be at most "
            f"{slow:.4g}",
        ),
    ]
