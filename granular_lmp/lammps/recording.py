"""The record of a deck: the centre sphere, snapshots of all spheres, checkpoints, and the run."""

from granular_lmp.crystal.lattices import centre
from granular_lmp.effects import selection
from granular_lmp.lammps.checkpoints import minutes_between
from granular_lmp.lammps.outputs import CHECKPOINTS
from granular_lmp.problem import Problem

# OVITO knows these names
SPHERE_NAMES = "colname c_u[1] Displacement.X colname c_u[2] Displacement.Y"


def sphere_columns(problem: Problem) -> str:
    """Return the columns of spheres in a dump; ASE keeps v_theta."""
    mass = "" if problem.scene.perfect else " mass"
    turns, tracks = problem.on["rotation"], problem.on["tracking"]
    return (
        f"id type x y z radius{mass} c_u[1] c_u[2] vx vy vz{' omegaz' if turns else ''}{' v_theta' if tracks else ''}"
    )


def record(problem: Problem, checkpoint: str = "") -> list[str]:
    """Return the block of the record; from a checkpoint on, its dumps are continued."""
    scene, turns, tracks = problem.scene, problem.on["rotation"], problem.on["tracking"]
    minutes = minutes_between(scene.output.checkpoint, scene.shape.spheres)
    return [
        f"# --- record of the centre sphere, all digits; a checkpoint about every {minutes:.3g} minutes",
        "group        ${marked} empty",
        f"restart      ${{checkpoint}} {' '.join(CHECKPOINTS)}",
        f"group        centre id {centre(problem.crystal) + 1}",
        *selection.lines("record", problem),
        f"dump         centre centre custom ${{every}} ${{dump}} id c_u[1] c_u[2]{' v_theta' if tracks else ''} vx vy"
        f"{' omegaz' if turns else ''}",
        "dump_modify  centre format float %.17g colname c_u[1] ux colname c_u[2] uy"
        + " colname v_theta theta" * tracks,
        *(_snapshots(problem) if scene.output.particles > 0 else []),
        *(["dump_modify  centre append yes"] if checkpoint else []),
        *(["dump_modify  particles append yes"] if checkpoint and scene.output.particles > 0 else []),
    ]


def _snapshots(problem: Problem) -> list[str]:
    return [
        "variable     apart equal v_every*ceil(v_particles/v_sample-1e-9)",
        f"dump         particles all custom ${{apart}} ${{snapshots}} {sphere_columns(problem)}",
        f"dump_modify  particles sort id format float %.17g {SPHERE_NAMES}",
    ]


def run(problem: Problem) -> list[str]:
    """Return the command of the run."""
    return ["run ${steps}"]


def run_on(problem: Problem, checkpoint: str) -> list[str]:
    """Return the command of a run that continues."""
    return ["run ${steps} upto"]
