"""Lines of a deck that record monitors: the motion of their spheres, and the forces of their contacts.

The motion is a binary dump with the columns of a snapshot of all spheres. Contacts are a text dump, the only form in
which LAMMPS writes ``dump local``; it holds the contacts between all spheres in and around a monitor. The forces of
walls are in the dump of the motion.
"""

from pathlib import Path

from granular_lmp.effects.freedoms import axes
from granular_lmp.effects.on_walls import FACES
from granular_lmp.lammps.binary_dump import CONTINUED, binary_snapshots
from granular_lmp.lammps.blocks import apart
from granular_lmp.lammps.datafile import id_ranges
from granular_lmp.lammps.outputs import MONITOR, MONITOR_CONTACTS, last_step
from granular_lmp.lammps.recording import sphere_columns, sphere_names
from granular_lmp.problem import Problem
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.monitors import PlacedMonitor


def contact_columns(scene: Scene) -> tuple[str, ...]:
    """Return the columns of a contact in a dump.

    They are both spheres; the normal force, repulsive above 0; the tangential force on the first sphere; the vector
    from the second to the first, which needs every digit of a position, as an overlap is the last ones; and where
    contacts resist rolling the force whose moment is the rolling torque, the same for both.
    """
    axes = "xyz"[: scene.space]
    tangential, rolling = (tuple(f"{name}_{axis}" for axis in axes) for name in ("tangential", "rolling"))
    return ("first", "second", "normal", *tangential, *axes, *(rolling if scene.effects.rolling is True else ()))


def wall_columns(face: str, axes: str) -> tuple[str, ...]:
    """Return the columns of a wall in a dump of motion, for each sphere; they are 0 if it does not touch the wall.

    They are 1 if the sphere touches, the place of the wall along its axis, and the force of the wall on the sphere.
    """
    return tuple(f"wall_{face}_{each}" for each in ("touch", "place", *(f"f{axis}" for axis in axes)))


def _wall_lines(problem: Problem) -> list[str]:
    """Return the variables of `wall_columns`, which are sums over the fixes of all materials."""
    if not problem.rest.planes or not any(each.monitor.with_contacts for each in problem.monitors):
        return []
    lines, materials = [], range(1, len(problem.rest.materials) + 1)
    for face in problem.rest.planes:
        kept = (1, FACES[face][0] + 5, 2, 3, 4)  # columns of `fix wall/gran ... contacts`
        for name, column in zip(wall_columns(face, axes(problem)), kept, strict=False):
            lines.append(f"variable     {name} atom {'+'.join(f'f_{face}{m}[{column}]' for m in materials)}")
    return ["# --- walls of monitors: whether a sphere touches, where the wall is, and its force on the sphere", *lines]


def _values(problem: Problem) -> str:
    """Return the LAMMPS names of the columns from the normal force on; a vector begins at p1, p10 and p5."""
    scene = problem.scene
    starts = (1, 10, 5) if scene.effects.rolling is True else (1, 10)
    return " ".join(["force", *(f"p{first + part}" for first in starts for part in range(scene.space))])


def _format(problem: Problem) -> str:
    scene = problem.scene
    vector, rolling = scene.space, scene.effects.rolling is True
    return " ".join(["%.0f"] * 2 + ["%.13g"] * (1 + vector) + ["%.17g"] * vector + ["%.13g"] * vector * rolling)


def monitor_files(problem: Problem) -> list[str]:
    """Return the names of the files of all monitors of a problem."""
    return [
        pattern.format(each.name)
        for each in problem.scene.monitor
        for pattern in (MONITOR, *([MONITOR_CONTACTS] if each.with_contacts else []))
    ]


def is_whole(path: Path, records: int, last: int) -> bool:
    """Return whether a file of a monitor exists and ends with the record of the last step.

    A file of motion must also have this number of records; records of text are not counted, as this takes as long as
    reading them.
    """
    if not path.is_file():
        return False
    if path.suffix == ".bin":
        steps = [each.step for each in binary_snapshots(path)]
        return len(steps) == records and steps[-1] == last
    return last_step(path) == last


def monitors(problem: Problem, checkpoint: str = "") -> list[str]:
    """Return the blocks of all monitors of a problem; after a checkpoint their dumps continue."""
    own = [_monitor(number, each, problem, checkpoint) for number, each in enumerate(problem.monitors, 1)]
    walls = _wall_lines(problem)
    return apart([walls, *own] if walls else own)


def _monitor(number: int, placed: PlacedMonitor, problem: Problem, checkpoint: str) -> list[str]:
    # With the cutoff "type", pairs without a contact in LAMMPS are included; their vector is 0
    cutoff, scene = problem.scene.material.contact_law.cutoff, problem.scene
    name, tag = f"monitor{number}", str(number)
    walls = [each for face in problem.rest.planes for each in wall_columns(face, axes(problem))]
    own = [f"v_{each}" for each in walls if placed.monitor.with_contacts]
    named = [sphere_names(problem), *(f"colname {each} {each[2:]}" for each in own)]
    file = MONITOR.format(placed.monitor.name + (CONTINUED if checkpoint else ""))
    lines = [
        f"# --- {name}: {placed.monitor.name}, {placed.words}",
        f"group        {name} id {id_ranges(placed.spheres)}",
        f"dump         {name} {name} custom ${{every}} {file} {' '.join([sphere_columns(problem), *own])}",
        f"dump_modify  {name} sort id {' '.join(named)}",
    ]
    if placed.monitor.with_contacts:
        titles = contact_columns(scene)
        columns = [f"c_ends{tag}[{k}]" for k in (1, 2)] + [f"c_push{tag}[{k}]" for k in range(1, len(titles) - 1)]
        names = " ".join(f"colname {column} {name}" for column, name in zip(columns, titles, strict=True))
        file = MONITOR_CONTACTS.format(placed.monitor.name)
        lines += [
            "# forces of its contacts; LAMMPS lists pairs, and the group includes the spheres around the monitor",
            f"group        around{tag} id {id_ranges(placed.around)}",
            f"compute      ends{tag} around{tag} property/local patom1 patom2 cutoff {cutoff}",
            f"compute      push{tag} around{tag} pair/local {_values(problem)} cutoff {cutoff}",
            f"dump         contacts{tag} around{tag} local ${{every}} {file} {' '.join(columns)}",
            f'dump_modify  contacts{tag} format line "{_format(problem)}" {names}' + " append yes" * bool(checkpoint),
        ]
    return lines
