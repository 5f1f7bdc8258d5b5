"""Spheres that the guards of a deck check, and spheres that leave the run.

Guards check the spheres whose state can still affect the record. In a plane wave between walls, or in a finite wave,
they lie in a region around the recorded spheres, which shrinks at the speed of signals. Outside the region, walls cut
the wave off and shear contacts strongly, without effect on the record.

Spheres farther out leave the run, which makes it faster. The new face is a disturbance; ahead of its front waves decay
like an Airy function of width d^{1/3} rows after d rows (`granular_lmp.rest.shape.echo_time`). Spheres therefore leave
where

    d > w + WIDTHS (w + WIDTHS^{3/2})^{1/3}

with the distance d from the centre and the distance w that the fastest signal travels before the end, both in rows. If
all spheres of a row move alike, whole rows leave, so that the wave stays plane, which guards of its symmetry check.
With monitors whole rows leave too, and d is the distance from the outermost recorded spheres; spheres between two
monitors stay to the end.
"""

from math import inf

import numpy as np
from numpy.typing import NDArray

from granular_lmp.effects.guard import watches_part
from granular_lmp.effects.openings import by_pairs
from granular_lmp.problem import Problem
from granular_lmp.rest.at_rest import swiftness
from granular_lmp.rest.linear import uniform_rows
from granular_lmp.rest.shape import quiet_rows

_ALL = 2**31 - 1  # number of spheres that may leave at once

# Widths ahead of the front within which spheres stay: the record then changes by less than 1e-9 of its largest value
WIDTHS = 5.0
LOST = 6  # rows by which the region shrinks before spheres leave again; neighbour lists are then made again


def inside_lines(problem: Problem) -> list[str]:
    """Return the lines for the group of spheres that can still affect the record before the run ends.

    The group holds all spheres if snapshots record them, or in a periodic plane wave. Otherwise it is a region around
    the centre. It starts one row inside the strip whose echo arrives after the run (`quiet_rows`) and ends one row from
    the centre; around the rows of each monitor it does the same along y. The group is renewed whenever the region has
    shrunk by a row.
    """
    scene = problem.scene
    if not watches_part(scene):
        return ["group        inside union all  # the spheres that can affect the record"]
    lines, away = _away(problem)
    return [
        *lines,
        _reach(problem),
        f"variable     near atom v_reach>{away}",
        f"group        inside dynamic all var near every {_interval(problem)}"
        "  # the spheres that can still affect the record",
        *_leaving(problem),
    ]


def leaving_lines(problem: Problem) -> list[str]:
    """Return the lines with which spheres leave a run without guards; [] if they stay."""
    return [_reach(problem), *_leaving(problem)] if leave(problem) else []


def _reach(problem: Problem) -> str:
    """Return the line of v_reach, the radius of the region at a step."""
    least, lost = _radius(problem)
    shrinks = f"$({lost!r}*v_step/(v_t0*(v_duration+(v_duration==0))):%.17g)*step"
    return f"variable     reach equal {least + lost!r}-{shrinks}  # shrinking radius of the group inside"


def _radius(problem: Problem) -> tuple[float, float]:
    """Return the radius of the region at the end of a run, and its excess at the start."""
    return 1.5 * _row(problem), (_farthest_row(problem) - 2.5) * _row(problem)


def reach(problem: Problem, step: int) -> float:
    """Return the radius of the region that guards check at a step, in units of the deck; infinite without a region."""
    scene = problem.scene
    if not watches_part(scene):
        return inf
    least, lost = _radius(problem)
    renewed = step - step % _interval(problem)
    return least + lost * (1 - renewed * scene.time.step / scene.time.duration)


def distances(problem: Problem) -> NDArray[np.float64]:
    """Return the distances of spheres at rest from the recorded spheres, (N,), in units of the deck."""
    scene, row = problem.scene, _row(problem)
    x, y = problem.rest.atoms.positions.T[:2] * problem.units.number(scene.sphere.radius, length=1)
    least, half = np.hypot(x, y), scene.shape.rows * row / 2
    for monitor in scene.monitor:
        low, high = ((each - scene.shape.centre_row) * row for each in monitor.span)
        apart = np.abs(y - (low + high) / 2)
        if scene.shape.along_y:
            apart = half - np.abs(half - apart)
        least = np.minimum(least, apart - (high - low) / 2)
    return np.asarray(least)


def leave(problem: Problem) -> bool:
    """Return whether spheres leave the run once they can no longer affect the record."""
    scene = problem.scene
    return watches_part(scene) and not scene.packing.contact_force and not by_pairs(scene)


def mean_count(problem: Problem) -> float:
    """Return the mean number of spheres during a run."""
    scene, crystal = problem.scene, problem.rest.atoms
    if not leave(problem):
        return float(len(crystal))
    row = scene.lattice.row_distance(scene.sphere.lattice_constant) / scene.sphere.radius
    (low, high), (x, y, _) = _recorded(problem), crystal.positions.T
    along = np.maximum(np.maximum(low - y, y - high), 0.0)
    apart = np.sort(along if _by_rows(problem) else np.hypot(x, along)) / row
    every, time = LOST * _interval(problem), scene.time
    steps = np.arange(every, time.steps, every)  # at which spheres leave
    way = _speed(problem) * (time.duration - steps * time.step)
    stay = np.searchsorted(apart, way + WIDTHS * np.cbrt(way + WIDTHS**1.5))
    return float(np.average([len(apart), *stay], weights=np.diff([0, *steps, time.steps])))


def _speed(problem: Problem) -> float:
    """Return the largest speed of signals, rows per τ."""
    return problem.scene.lattice.fastest * swiftness(problem.scene)


def _leaving(problem: Problem) -> list[str]:
    """Return the lines with which spheres leave; [] if they stay."""
    row = _row(problem)
    if not leave(problem):
        return []
    way = f"{_speed(problem)!r}*(v_duration-v_tau)"
    return [
        f"variable     front equal {row!r}*({way}+{WIDTHS}*({way}+{WIDTHS**1.5:.3f})^(1/3))"
        f"+({problem.scene.time.duration!r}>v_duration)*v_reach"
        "  # beyond this radius spheres leave; it is larger if -var made the run shorter",
        *_far(problem),
        f"fix          gone all evaporate {LOST * _interval(problem)} {_ALL} far 1"
        "  # spheres that can no longer affect the record leave; to keep them: unfix gone",
    ]


def _far(problem: Problem) -> list[str]:
    """Return the lines of the region in which spheres leave."""
    if not _by_rows(problem):
        return ["region       far cylinder z 0 0 v_front INF INF side out units box"]
    to_deck = problem.units.number(problem.scene.sphere.radius, length=1)
    low, high = (each * to_deck for each in _recorded(problem))
    if low == high and problem.scene.space == 2:  # only y counts in the distance from the axis x
        return ["region       far cylinder x 0 0 v_front INF INF side out units box"]
    return [
        f"variable     low equal {low!r}-v_front",
        f"variable     high equal {high!r}+v_front",
        "region       far block INF INF v_low v_high INF INF side out units box",
    ]


def _by_rows(problem: Problem) -> bool:
    """Return whether spheres leave in whole rows."""
    return uniform_rows(problem.scene) or bool(problem.scene.monitor)


def _recorded(problem: Problem) -> tuple[float, float]:
    """Return y of the first and the last recorded sphere, in radii of the declared sphere.

    In a cell that is periodic along y, both are set to the larger distance from the centre. A sphere farther out by
    some distance then has at least this distance from all recorded spheres, also across the faces.
    """
    y = np.concatenate([[0.0], *(problem.rest.atoms.positions[each.spheres, 1] for each in problem.monitors)])
    low, high = float(y.min()), float(y.max())
    farther = max(-low, high)
    return (-farther, farther) if problem.scene.shape.along_y else (low, high)


def _row(problem: Problem) -> float:
    """Return the distance between two rows, in units of the deck."""
    scene = problem.scene
    return problem.units.number(scene.lattice.row_distance(scene.sphere.lattice_constant), length=1)


def _away(problem: Problem) -> tuple[list[str], str]:
    """Return lines and a formula for the distance of a sphere from the centre or the nearest rows of a monitor."""
    scene, row, lines, least = problem.scene, _row(problem), list[str](), "sqrt(x*x+y*y)"
    for number, monitor in enumerate(scene.monitor):
        low, high = ((each - scene.shape.centre_row) * row for each in monitor.span)
        apart = f"abs(y-({(low + high) / 2!r}))"
        if scene.shape.along_y:  # the shorter path may cross the faces
            half = scene.shape.rows * row / 2
            apart = f"({half!r}-abs({half!r}-{apart}))"
        own = f"({apart}-{(high - low) / 2!r})"
        lines.append(f"variable     away{number} atom ternary({own}<{least},{own},{least})")
        least = f"v_away{number}"
    return lines, least


def _farthest_row(problem: Problem) -> int:
    scene = problem.scene
    return (quiet_rows(scene.time.duration * swiftness(scene), scene.lattice.fastest) - 1) // 2


def _interval(problem: Problem) -> int:
    """Return the steps in which the region shrinks by a row."""
    time = problem.scene.time
    return max(1, int(time.duration / _farthest_row(problem) / time.step))
