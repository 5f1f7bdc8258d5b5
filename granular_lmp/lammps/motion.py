"""The motion of the spheres of a deck that are not held, and the ends that damp it."""

from granular_lmp.effects import selection
from granular_lmp.problem import Problem


def motion(problem: Problem) -> list[str]:
    """Return the lines that integrate the motion."""
    turns, tracks = problem.on["rotation"], problem.on["tracking"]
    return [
        "# --- motion of the spheres that are not held",
        f"fix          move mobile nve{'/sphere' if turns else ''}{' update dipole' if tracks else ''}",
        *selection.lines("motion", problem),
    ]
