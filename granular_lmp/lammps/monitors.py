"""The lines of a deck that record monitors: the motion of their spheres, and the forces of their contacts.

The motion is a binary dump with the columns of a snapshot of all spheres. Contacts are a text dump, as LAMMPS writes
``dump local`` in no other form; it holds those between all spheres in and around a monitor.
"""

from pathlib import Path

from granular_lmp.effects.law_formulas import FORMULAS
from granular_lmp.lammps.binary_dump import CONTINUED, binary_snapshots
from granular_lmp.lammps.blocks import apart
from granular_lmp.lammps.datafile import id_ranges
from granular_lmp.lammps.outputs import MONITOR, MONITOR_CONTACTS, last_step
from granular_lmp.lammps.recording import SPHERE_NAMES, sphere_columns
from granular_lmp.problem import Problem
from granular_lmp.scene.monitors import PlacedMonitor
from granular_lmp.scene.scene import Scene

# Columns of a contact: both spheres; normal force, repulsive above 0; tangential force on the first sphere; vector from
# the second to the first. The vector needs every digit of a position, of which an overlap is the last ones
CONTACT_COLUMNS = ("first", "second", "normal", "tangential_x", "tangential_y", "x", "y")
_VALUES = "force p1 p2 p10 p11"
_FORMAT = "%.0f %.0f %.13g %.13g %.13g %.17g %.17g"
# Behind them where contacts resist rolling: the force f_r whose moment is the torque of the roll, the same for both
ROLLING_COLUMNS = ("rolling_x", "rolling_y")
_ROLLING_VALUES, _ROLLING_FORMAT = " p5 p6", " %.13g %.13g"


def monitor_files(scene: Scene) -> list[str]:
    """Return the names of the files of all monitors of a scene."""
    return [
        pattern.format(each.name)
        for each in scene.monitor
        for pattern in (MONITOR, *([MONITOR_CONTACTS] if each.with_contacts else []))
    ]


def is_whole(path: Path, records: int, last: int) -> bool:
    """Return whether a file of a monitor is there and ends with the record of the last step.

    A file of motion has this number of records too; text is not counted, as that takes as long as to read it.
    """
    if not path.is_file():
        return False
    if path.suffix == ".bin":
        steps = [each.step for each in binary_snapshots(path)]
        return len(steps) == records and steps[-1] == last
    return last_step(path) == last


def monitors(problem: Problem, checkpoint: str = "") -> list[str]:
    """Return the blocks of all monitors of a problem; from a checkpoint on, their dumps are continued."""
    return apart(_monitor(number, each, problem, checkpoint) for number, each in enumerate(problem.monitors, 1))


def _monitor(number: int, placed: PlacedMonitor, problem: Problem, checkpoint: str) -> list[str]:
    # With the cutoff "type" pairs that LAMMPS has no contact of are among them: their vector is 0
    cutoff, rolling = FORMULAS[problem.scene.sphere.adhesion_law].cutoff, problem.on.get("rolling", False)
    name, tag = f"monitor{number}", str(number)
    file = MONITOR.format(placed.monitor.name + (CONTINUED if checkpoint else ""))
    lines = [
        f"# --- {name}: {placed.monitor.name}, {placed.words}",
        f"group        {name} id {id_ranges(placed.spheres)}",
        f"dump         {name} {name} custom ${{every}} {file} {sphere_columns(problem)}",
        f"dump_modify  {name} sort id {SPHERE_NAMES}",
    ]
    if placed.monitor.with_contacts:
        titles = CONTACT_COLUMNS + ROLLING_COLUMNS * rolling
        columns = [f"c_ends{tag}[{k}]" for k in (1, 2)] + [f"c_push{tag}[{k}]" for k in range(1, len(titles) - 1)]
        names = " ".join(f"colname {column} {name}" for column, name in zip(columns, titles, strict=True))
        file = MONITOR_CONTACTS.format(placed.monitor.name)
        lines += [
            "# forces of its contacts; LAMMPS names pairs of spheres, and the group holds those around too",
            f"group        around{tag} id {id_ranges(placed.around)}",
            f"compute      ends{tag} around{tag} property/local patom1 patom2 cutoff {cutoff}",
            f"compute      push{tag} around{tag} pair/local {_VALUES}{_ROLLING_VALUES * rolling} cutoff {cutoff}",
            f"dump         contacts{tag} around{tag} local ${{every}} {file} {' '.join(columns)}",
            f'dump_modify  contacts{tag} format line "{_FORMAT}{_ROLLING_FORMAT * rolling}" {names}'
            + " append yes" * bool(checkpoint),
        ]
    return lines
