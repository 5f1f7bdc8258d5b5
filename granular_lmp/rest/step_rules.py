"""Rules for the time step, which a declared step and the first run to a tolerance both follow."""

from collections.abc import Iterable
from math import inf

from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.sections import Sampled

# A mode at this share of the limit of stability has an amplitude 1/√(1 − share²) = 1.4 times too large; spheres of an
# impact may come to press each other deeper on their way
COARSEST = 0.7
STEPS_IN_COLLISION = 10.0  # The shortest collision has at least as many; the velocities then err by 3 %
LONGEST_STEP = 0.5  # A step takes at most this share of 1/ω of the stiffest contact; a collision then has ten


@dataclass(frozen=True)
class StepRule:
    """A rule for the time step of a scene.

    Attributes
    ----------
    longest : float
        The longest step that it allows, in units of the scene's time.
    first : float
        The longest step with which the runs for a tolerance may begin.
    sentence : str
        What is wrong with a longer step, and what to do.
    """

    longest: float
    first: float
    sentence: str


def refuse_step(time: Sampled, rules: Iterable[StepRule]) -> None:
    """Raise a SceneError if a declared time step breaks a rule."""
    step = time.clock.of_answer
    for rule in rules:
        if step > rule.longest:
            raise SceneError(f"time.timestep = {time.timestep!r}: {rule.sentence}")


def rules_of_collisions(collision: float, rate: float, drag: float = 0.0) -> list[StepRule]:
    """Return the rules for spheres that meet.

    Parameters
    ----------
    collision : float
        The shortest collision of two neighbours, t0.
    rate : float
        ω of the stiffest contact at the beginning, 1/t0; 0 if all just touch.
    drag : float
        Rate at which dashpots slow a motion, 1/t0. A step of 2 would make it grow, as they take its last velocity.
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
