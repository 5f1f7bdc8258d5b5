"""The guards of an impact: overlaps so deep, and steps so long, that the model no longer holds."""

from granular_lmp.effects.guard import Guard
from granular_lmp.scene.validation import LARGEST_OVERLAP_RATIO
from granular_lmp.step_rules import LONGEST_STEP


def _measured_together(problem: object) -> list[str]:
    """Return no lines: the deck of an impact measures both by one force (`granular_lmp.impact.deck`)."""
    return []


GUARDS = {
    each.title: each
    for each in (
        Guard(
            "largest_overlap",
            "overlap",
            _measured_together,
            LARGEST_OVERLAP_RATIO,
            "of the diameter is the largest overlap, for which Hertz's law does not hold",
            "take a smaller striker.velocity or packing.contact_force",
        ),
        Guard(
            "step_in_contact",
            "omega_dt",
            _measured_together,
            LONGEST_STEP,
            "is the time step times the frequency of the stiffest contact, which is too long for a collision",
            "take a shorter time.timestep, or a smaller time.tolerance",
        ),
    )
}
