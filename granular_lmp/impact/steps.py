"""The rules for the time step of an impact, which a declared step and the first run to a tolerance both follow."""

from math import inf

STEPS_IN_COLLISION = 10.0  # The shortest collision has at least as many; the velocities then err by 3 %
LONGEST_STEP = 0.5  # A step takes at most this share of 1/ω of the stiffest contact; a collision then has ten


def step_rules(collision: float, rate: float) -> list[tuple[float, str]]:
    """Return the longest step, t0, of each rule, and what is wrong with a longer one.

    Parameters
    ----------
    collision : float
        The shortest collision of two neighbours, t0.
    rate : float
        ω of the stiffest contact at the beginning, 1/t0; 0 if all just touch.
    """
    few, stiff = collision / STEPS_IN_COLLISION, LONGEST_STEP / rate if rate else inf
    return [
        (
            few,
            f"leaves the shortest collision of two neighbours, {collision:.4g} t0, fewer than {STEPS_IN_COLLISION:g} "
            f"steps; must be at most {few:.4g}, and at most {few / 8:.2g} for errors of 1e-4",
        ),
        (
            stiff,
            f"is above {LONGEST_STEP:g}/omega of the stiffest contact at the beginning, omega = {rate:.4g} per t0; "
            f"must be at most {stiff:.4g}",
        ),
    ]
