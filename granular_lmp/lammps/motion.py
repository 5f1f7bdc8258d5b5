"""The motion of the spheres of a deck that are not held, and what acts on them from outside."""

from granular_lmp.effects import selection
from granular_lmp.lammps import start
from granular_lmp.problem import Problem


def loads(problem: Problem) -> list[str]:
    """Return the block of the constant forces on free ends of a chain that is pressed together, [] without any."""
    units, scale = problem.units, problem.scale
    mass, time = units.number(scale.mass, mass=1), units.number(scale.time, time=1)
    lines = ["# --- constant forces on free ends, which press the chain together"]
    for number, (sphere, force) in enumerate(problem.loads.items(), 1):
        of_deck = units.number(force * scale.length, length=1) * mass / time**2
        lines += [
            f"group        end{number} id {sphere + 1}",
            f"fix          load{number} end{number} addforce 0.0 {of_deck!r} 0.0",
        ]
    return lines if problem.loads else []


def motion(problem: Problem) -> list[str]:
    """Return the block that integrates the motion."""
    turns, tracks = problem.on["rotation"], problem.on["tracking"]
    return [
        "# --- motion of the spheres that are not held",
        *([start.PLANE] if problem.scene.loose else []),
        f"fix          move mobile nve{'/sphere' if turns else ''}{' update dipole' if tracks else ''}",
        *_frozen(problem),
        *selection.lines("motion", problem),
    ]


def _frozen(problem: Problem) -> list[str]:
    """Return the lines that freeze held spheres which other spheres hit with dashpots."""
    if not (problem.scene.loose and problem.on["damping"] and problem.crystal.arrays["fixed"].any()):
        return []
    return [
        "# dashpots then take the mass of a held sphere as infinite; with its own mass too much would come back",
        "group        held subtract all mobile",
        "fix          held held freeze",
    ]
