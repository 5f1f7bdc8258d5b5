"""The record of a deck: the centre sphere or spheres of a struck crystal, snapshots, checkpoints, and the run."""

from granular_lmp.crystal.lattices import centre
from granular_lmp.effects import selection
from granular_lmp.lammps.checkpoints import minutes_between
from granular_lmp.lammps.datafile import id_ranges
from granular_lmp.lammps.ends import boundary
from granular_lmp.lammps.outputs import CHECKPOINTS
from granular_lmp.problem import Problem

# OVITO knows these names
SPHERE_NAMES = "colname c_u[1] Displacement.X colname c_u[2] Displacement.Y"
_EVERY_DIGIT = f"sort id format float %.17g {SPHERE_NAMES}"


def sphere_columns(problem: Problem) -> str:
    """Return the columns of spheres in a dump; ASE keeps v_theta."""
    mass = " mass" if problem.scene.loose or not problem.scene.perfect else ""
    return f"id type x y z radius{mass} c_u[1] c_u[2] vx vy vz" + _turned(problem)


def _turned(problem: Problem) -> str:
    turns, tracks = problem.on["rotation"], problem.on["tracking"]
    return " omegaz" * turns + " v_theta" * tracks


def record(problem: Problem, checkpoint: str = "") -> list[str]:
    """Return the block of the record; from a checkpoint on, its dumps are continued."""
    minutes = minutes_between(problem.scene.output.checkpoint, problem.scene.shape.spheres)
    of, dumps = (" of the centre sphere", _centre(problem)) if problem.mode else ("", _recorded(problem))
    names = [line.split()[1] for line in dumps if line.startswith("dump ")]
    return [
        f"# --- record{of}, all digits; a checkpoint about every {minutes:.3g} minutes",
        "group        ${marked} empty",
        f"restart      ${{checkpoint}} {' '.join(CHECKPOINTS)}",
        *dumps,
        *(f"dump_modify  {name} append yes" for name in names if checkpoint),
    ]


def _centre(problem: Problem) -> list[str]:
    """Return the dump of the centre sphere, and of all spheres where the scene declares snapshots."""
    turns, tracks = problem.on["rotation"], problem.on["tracking"]
    snapshots = [
        "variable     apart equal v_every*ceil(v_particles/v_sample-1e-9)",
        f"dump         particles all custom ${{apart}} ${{snapshots}} {sphere_columns(problem)}",
        f"dump_modify  particles {_EVERY_DIGIT}",
    ]
    return [
        f"group        centre id {centre(problem.crystal) + 1}",
        *selection.lines("record", problem),
        f"dump         centre centre custom ${{every}} ${{dump}} id c_u[1] c_u[2]{' v_theta' * tracks} vx vy"
        + " omegaz" * turns,
        "dump_modify  centre format float %.17g colname c_u[1] ux colname c_u[2] uy"
        + " colname v_theta theta" * tracks,
        *(snapshots if problem.scene.output.particles else []),
    ]


def _recorded(problem: Problem) -> list[str]:
    """Return the dump of the recorded spheres of a struck crystal."""
    seen = "all" if len(problem.recorded) == len(problem.crystal) else "recorded"
    return [
        f"group        recorded id {id_ranges(problem.recorded)}",
        *selection.lines("record", problem),
        f"dump         record {seen} custom ${{every}} ${{dump}} {sphere_columns(problem)}",
        f"dump_modify  record {_EVERY_DIGIT}",
    ]


def run(problem: Problem, checkpoint: str = "") -> list[str]:
    """Return the command of the run, or of the rest of one that continues.

    Where spheres may fly it is set up anew at each checkpoint, as a continuation is: forces that depend on velocities
    are then computed from the same ones in both, and the box is that of the checkpoint.
    """
    upto = " upto" if checkpoint else ""
    if not problem.scene.loose:
        return [f"run ${{steps}}{upto}"]
    comment = ["# --- at a checkpoint the run is set up anew, and its box too, as in a continuation"]
    return [
        *([] if checkpoint else comment),
        f'run          ${{steps}}{upto} every ${{checkpoint}} "change_box all boundary {boundary(problem)}"',
    ]
