"""The lines of a deck that strike spheres: velocities that do not scale with the amplitude of a wave."""

from granular_lmp.lammps.datafile import id_ranges
from granular_lmp.problem import Problem


def strikers(problem: Problem) -> list[str]:
    """Return the block that gives strikers their velocities, in addition to that of the wave; [] without any.

    One group after the other is made, as LAMMPS has 32 at most.
    """
    text = ["# --- strikers: velocities in addition to that of the wave"]
    for striker, spheres in zip(problem.scene.striker, problem.strikers, strict=True):
        vx, vy = (problem.units.number(each, length=1, time=-1) for each in striker.components)
        text += [
            f"group        striker id {id_ranges(spheres)}",
            f"velocity     striker set {vx!r} {vy!r} NULL sum yes units box",
            "group        striker delete",
        ]
    return text if problem.strikers else []
