"""Lines of a deck that strike spheres: velocities that do not scale with the amplitude of a wave."""

from granular_lmp.lammps.datafile import id_ranges
from granular_lmp.problem import Problem


def strikers(problem: Problem) -> list[str]:
    """Return the block that adds the velocities of strikers to those of a wave; [] if there are none.

    Groups are made and deleted one after the other, as LAMMPS allows 32.
    """
    alone = problem.scene.wave is None
    text = ["# --- strikers" + ("" if alone else ": velocities in addition to that of the wave")]
    none, how = ("0.0", "units box") if alone else ("NULL", "sum yes units box")
    for striker, spheres in zip(problem.scene.striker, problem.rest.strikers, strict=True):
        vx, vy, *vz = (
            problem.units.number(each, length=1, time=-1) for each in striker.components[: problem.scene.space]
        )
        text += [
            f"group        striker id {id_ranges(spheres)}",
            f"velocity     striker set {vx!r} {vy!r} {' '.join(map(repr, vz)) or none} {how}",
            "group        striker delete",
        ]
    return text if problem.rest.strikers else []
