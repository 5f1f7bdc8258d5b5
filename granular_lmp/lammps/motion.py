"""The motion of the spheres of a deck that are not held."""

from granular_lmp.effects import selection
from granular_lmp.lammps import ends, start
from granular_lmp.problem import Problem


def motion(problem: Problem) -> list[str]:
    """Return the block that integrates the motion."""
    turns, tracks = problem.on["rotation"], problem.on["tracking"]
    return [
        "# --- motion of the spheres that are not held",
        *([start.PLANE] if problem.scene.loose else []),
        f"fix          move mobile nve{'/sphere' if turns else ''}{' update dipole' if tracks else ''}",
        *ends.held(problem),
        *selection.lines("motion", problem),
    ]
