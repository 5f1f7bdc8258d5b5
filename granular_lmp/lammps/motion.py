"""Lines of a deck that move the spheres that are not held."""

from granular_lmp.effects import selection
from granular_lmp.effects.freedoms import style
from granular_lmp.lammps import ends, start
from granular_lmp.problem import Problem


def motion(problem: Problem) -> list[str]:
    """Return the block that integrates the motion."""
    return _motion(problem, [])


def motion_of_meeting(problem: Problem) -> list[str]:
    """Return the block that integrates the motion of spheres that meet, in a plane."""
    return _motion(problem, start.plane(problem))


def _motion(problem: Problem, before: list[str]) -> list[str]:
    turns, tracks = problem.on["rotation"], problem.on["tracking"]
    integrator = f"nve{'/sphere' if turns else ''}{' update dipole' if tracks else ''}"
    if "bpm/sphere" in style(problem):
        integrator = "nve/bpm/sphere"
    return [
        "# --- motion of the spheres that are not held",
        *before,
        f"fix          move mobile {integrator}",
        *ends.held(problem),
        *selection.lines("motion", problem),
    ]
