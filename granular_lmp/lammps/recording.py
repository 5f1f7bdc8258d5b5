"""Record of a deck: the centre sphere or the spheres of a struck crystal, snapshots, checkpoints, and the run."""

from granular_lmp.crystal.lattices import centre
from granular_lmp.effects import selection
from granular_lmp.effects.freedoms import axes, turns
from granular_lmp.lammps.checkpoints import minutes_between
from granular_lmp.lammps.datafile import id_ranges
from granular_lmp.lammps.ends import boundary, freezes
from granular_lmp.lammps.guards import verdict
from granular_lmp.lammps.outputs import CHECKPOINTS
from granular_lmp.problem import Problem

_QUATERNION = "wxyz"  # parts of the compute "turned", in order


def sphere_columns(problem: Problem) -> str:
    """Return the columns of spheres in a dump; ASE keeps v_theta."""
    mass = "" if problem.rest.crystal.of_one else " mass"
    return f"id type x y z radius{mass} {_columns('c_u', axes(problem))} vx vy vz" + _turned(problem)


def _turned(problem: Problem) -> str:
    spins = "".join(f" omega{end or 'z'}" for end in turns(problem) if problem.on["rotation"])
    if not problem.on["tracking"]:
        return spins
    return spins + (" v_theta" if problem.scene.space == 2 else f" {_columns('c_turned', _QUATERNION)}")


def _columns(name: str, parts: str) -> str:
    return " ".join(f"{name}[{number}]" for number in range(1, len(parts) + 1))


def every_digit(problem: Problem) -> str:
    """Return the words of ``dump_modify`` for a dump of spheres with all digits and names that OVITO knows."""
    return f"sort id format float %.17g {sphere_names(problem)}"


def sphere_names(problem: Problem) -> str:
    """Return the words that name displacements and orientations as OVITO does."""
    named = {"c_u": ("Displacement", axes(problem))}
    if problem.scene.space == 3 and problem.on["tracking"]:
        named["c_turned"] = ("Orientation", _QUATERNION)
    return " ".join(
        f"colname {name}[{number}] {said}.{part.upper()}"
        for name, (said, parts) in named.items()
        for number, part in enumerate(parts, 1)
    )


def record(problem: Problem, checkpoint: str = "") -> list[str]:
    """Return the block of the record; after a checkpoint its dumps continue."""
    minutes = minutes_between(problem.scene.output.checkpoint, problem.scene.shape.spheres)
    of, dumps = (" of the centre sphere", _centre(problem)) if problem.wave else ("", _recorded(problem))
    names = [line.split()[1] for line in dumps if line.startswith("dump ")]
    return [
        f"# --- record{of}, all digits; a checkpoint about every {minutes:.3g} minutes",
        f"restart      ${{checkpoint}} {' '.join(CHECKPOINTS)}",
        *dumps,
        *(f"dump_modify  {name} append yes" for name in names if checkpoint),
    ]


def _centre(problem: Problem) -> list[str]:
    """Return the dump of the centre sphere, and of all spheres if the scene declares snapshots."""
    thetas = [f"theta{end}" for end in turns(problem) if problem.on["tracking"]]
    named = {f"c_u[{number}]": f"u{axis}" for number, axis in enumerate(axes(problem), 1)}
    named |= {f"v_{theta}": theta for theta in thetas}
    rates = [f"v{axis}" for axis in axes(problem)]
    rates += [f"omega{end or 'z'}" for end in turns(problem) if problem.on["rotation"]]
    snapshots = [
        "variable     apart equal v_every*ceil(v_particles/v_sample-1e-9)",
        f"dump         particles all custom ${{apart}} ${{snapshots}} {sphere_columns(problem)}",
        f"dump_modify  particles {every_digit(problem)}",
    ]
    return [
        f"group        centre id {centre(problem.rest.atoms) + 1}",
        *selection.lines("record", problem),
        f"dump         centre centre custom ${{every}} ${{dump}} {' '.join(['id', *named, *rates])}",
        "dump_modify  centre format float %.17g " + " ".join(f"colname {of} {said}" for of, said in named.items()),
        *(snapshots if problem.scene.output.particles else []),
    ]


def _recorded(problem: Problem) -> list[str]:
    """Return the dump of the recorded spheres of a struck crystal."""
    forces = [f"f{axis}" for axis in axes(problem) if problem.scene.output.forces]
    variables, columns, names = [], forces, ""
    if freezes(problem):  # freezing leaves 0 in fx of a held sphere
        variables = [f"variable     {force} atom {force}+f_borne[{number}]" for number, force in enumerate(forces, 1)]
        columns = [f"v_{force}" for force in forces]
        names = "".join(f" colname v_{force} {force}" for force in forces)
    seen = "all" if len(problem.rest.recorded) == len(problem.rest.atoms) else "recorded"
    return [
        f"group        recorded id {id_ranges(problem.rest.recorded)}",
        *selection.lines("record", problem),
        *variables,
        f"dump         record {seen} custom ${{every}} ${{dump}} {' '.join([sphere_columns(problem), *columns])}",
        f"dump_modify  record {every_digit(problem)}{names}",
    ]


def run(problem: Problem, checkpoint: str = "") -> list[str]:
    """Return the command of the run, or of the rest of a continued run, and the verdict of its guards."""
    return [f"run ${{steps}}{' upto' if checkpoint else ''}", *verdict(problem)]


def run_of_meeting(problem: Problem, checkpoint: str = "") -> list[str]:
    """Return the command and the verdict for spheres that meet and may fly.

    The run is set up again at each checkpoint, like a continuation: both then compute forces from the same velocities,
    and have the box of the checkpoint.
    """
    upto = " upto" if checkpoint else ""
    comment = ["# --- at a checkpoint the run and its box are set up again, as in a continuation"]
    return [
        *([] if checkpoint else comment),
        f'run          ${{steps}}{upto} every ${{checkpoint}} "change_box all boundary {boundary(problem)}"',
        *verdict(problem),
    ]
