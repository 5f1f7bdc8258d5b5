"""The spheres that the guards of a deck judge, and those that may move them before the next look.

Guards judge the spheres whose state can still affect the record. In a plane wave between walls, or in a finite wave,
these are in a cone around what is recorded, whose rim moves inwards as fast as signals do. Outside, walls cut the wave
off and shear contacts strongly, which no record shows.
"""

from granular_lmp.effects.guard import watches_part
from granular_lmp.problem import Problem
from granular_lmp.scene.at_rest import swiftness
from granular_lmp.scene.scene import Scene
from granular_lmp.scene.shape import quiet_rows

# Rows between the cone and the spheres that cannot move it before the next look: in a quarter of the period of the
# branches that carry displacements, all farther spheres together move a sphere by at most 1 % of v t (tests)
MARGIN = 3


def inside_lines(problem: Problem) -> list[str]:
    """Return the lines for the group of the spheres whose state can still affect the record before the run ends.

    The group holds all spheres if snapshots record them, or in a periodic plane wave. Otherwise it is a cone around the
    centre, which starts one row inside the strip whose echo arrives after the run (`quiet_rows`) and ends one row from
    the centre, and the like along y around the rows of each monitor. The group is renewed whenever the cone has lost a
    row.
    """
    scene = problem.scene
    if not watches_part(scene):
        return ["group        inside union all  # the spheres that what is recorded depends on"]
    where = "the centre or a monitor" if scene.monitor else "the centre"
    least, lost = 1.5 * _row(problem), (_farthest_row(scene) - 2.5) * _row(problem)
    return [
        f"# spheres from where a signal still reaches {where} before the end: outside, a guard would judge walls",
        *_away(problem),
        f"variable     reach equal {least + lost!r}-$({lost!r}*v_step/(v_t0*(v_duration+(v_duration==0))):%.17g)*step",
        "variable     near atom v_reach>f_away",
        f"group        inside dynamic all var near every {_interval(scene)}",
    ]


def around_lines(problem: Problem) -> list[str]:
    """Return the lines for the group `around`: the spheres of the cone and within `MARGIN` rows of it; [] for all.

    The group is renewed whenever the cone has lost as many rows. Until then it holds more spheres than it must.
    """
    if not watches_part(problem.scene):
        return []
    return [
        f"variable     beside atom v_reach+{MARGIN * _row(problem)!r}>f_away",
        f"group        around dynamic all var beside every {MARGIN * _interval(problem.scene)}",
    ]


def _row(problem: Problem) -> float:
    """Return the distance between two rows, in the units of the deck."""
    scene = problem.scene
    return problem.units.number(scene.lattice.row_distance(scene.sphere.lattice_constant), length=1)


def _away(problem: Problem) -> list[str]:
    """Return the lines that keep how far each sphere is from the centre or the nearest rows of a monitor."""
    scene, row = problem.scene, _row(problem)
    lines = ["variable     away0 atom sqrt(x*x+y*y)"]
    for number, monitor in enumerate(scene.monitor):
        low, high = ((each - scene.shape.centre_row) * row for each in monitor.span)
        apart = f"abs(y-({(low + high) / 2!r}))"
        if scene.shape.along_y:  # the shorter way may be across the faces
            half = scene.shape.rows * row / 2
            apart = f"({half!r}-abs({half!r}-{apart}))"
        own, least = f"({apart}-{(high - low) / 2!r})", f"v_away{number}"
        lines.append(f"variable     away{number + 1} atom ternary({own}<{least},{own},{least})")
    return [*lines, f"fix          away all store/state 0 v_away{len(scene.monitor)}"]


def _farthest_row(scene: Scene) -> int:
    return (quiet_rows(scene.time.duration * swiftness(scene), scene.lattice.fastest) - 1) // 2


def _interval(scene: Scene) -> int:
    """Return the steps in which the cone loses a row."""
    return max(1, int(scene.time.duration / _farthest_row(scene) / scene.time.step))
