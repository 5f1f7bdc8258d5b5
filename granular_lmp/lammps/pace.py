"""When the guards of a deck look next: as late as a bound on the motion of the spheres proves that nothing happens.

At a look let v be the speed of the fastest sphere in and around the cone that guards judge
(`granular_lmp.lammps.cone`), and a its largest acceleration, both with those of the surface of the sphere that turns
fastest. In a time t no sphere moves, and none turns at its surface, by more than

    G (v t + a t²/2)

In the linear lattice G is the sum over the responses of all spheres to one that is pushed. Up to a quarter of the
period of the branches that carry displacements it is at most 1.4 in a chain or a square lattice, 1.6 in a hexagonal and
2.1 in an fcc crystal; `GROWTH` stands for all. The next look is due when this reaches the smallest distance s by which

    s = (δ − δ_open)/2                  the contact that touches least may be pulled, or the nearest spheres approach
    s = (1 − r) S/(3g + (3/2 + r) S/δ)  the bound r of slip may grow to 1

with the smallest overlap δ, the stiffness g in shear and the smallest sliding force S. In the latter the hardest
sheared contact gains 3gs of shear and a share s/δ of stiffness, while the one that touches least loses up to 3sS/2δ of
what it bears.

Looks are at least `FEWEST` in a period of the fastest motion, and at most `granular_lmp.effects.guard.LOOKS`. Where
dashpots act, or LAMMPS counts contacts at fixed steps, all looks are at the shortest distance.
"""

from math import pi

import numpy as np

from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.effects.contact_opening import GUARD as OPEN
from granular_lmp.effects.freedoms import axes, turns
from granular_lmp.effects.openings import counted_lines, nearest_gap
from granular_lmp.effects.reading import Reading, nearly_open
from granular_lmp.effects.sliding import GUARD as SLIP
from granular_lmp.effects.sliding import sliding_force
from granular_lmp.lammps.cone import around_lines
from granular_lmp.problem import Problem

FEWEST = 4  # looks in a period of the fastest motion that matters
GROWTH = 2.2
STIFFER = 1.5  # times the shear stiffness at rest: that of a contact pressed to 2.25 Δ0
_SMALL = 1e-30  # so that no formula divides by 0


def lines(problem: Problem, fastest: float) -> list[str]:
    """Return the lines of v_next, the step of the next look, from the frequency `fastest`, rad/t0.

    Looks are at multiples of v_look. The first one in a run is after v_look steps: before, LAMMPS has no forces.
    """
    if problem.scene.effects.damping is True or counted_lines(problem):
        return ["variable     next equal step-step%${look}+${look}"]
    apart, free = f"{2 * pi / (FEWEST * fastest)!r}*v_t0/(v_look*v_step)", _free(problem)
    bound = _bound(problem, free) if free else ["variable     looks equal 1+v_longest"]
    return [
        f"variable     longest equal $(floor(ternary({apart}>1,{apart},1))-1)",
        *bound,
        "variable     next equal step-step%${look}+${look}*ternary(step==$(step),1,v_looks)",
    ]


def _bound(problem: Problem, free: list[str]) -> list[str]:
    """Return the lines of v_looks: the time to the next look over the shortest one, 1 + v_longest at most."""
    columns = " ".join(f"c_u[{part}]" for part in range(1, len(axes(problem)) + 1))
    names = [f"free{number}" for number in range(len(free) + 1)]
    smallest = "c_free[1]"
    for number in range(2, len(names) + 1):
        smallest = f"ternary({smallest}>c_free[{number}],c_free[{number}],{smallest})"
    return [
        f"# the next look is due when a sphere may have moved, or turned, by v_room: at most {GROWTH}(v t + a t^2/2)",
        *_rates(problem),
        *(_farthest(columns, len(axes(problem))) if any("v_farthest" in each for each in free) else []),
        "# computes keep numbers, the same of all spheres, that formulas read more than once",
        *(f"variable     {name} atom {each}" for name, each in zip(names, [*free, "v_Delta0"], strict=True)),
        f"compute      free mobile reduce max {' '.join(f'v_{name}' for name in names)}",
        f"variable     smallest equal {smallest}",
        "variable     room atom (v_smallest>0)*v_smallest",
        "compute      room mobile reduce max v_room",
        f"variable     due equal c_room/({GROWTH!r}*v_swift+sqrt({GROWTH / 2!r}*v_gain*c_room)+{_SMALL!r})/(v_look*dt)",
        "variable     pause atom 1+floor((v_due+v_longest-abs(v_due-v_longest))/2)",
        "compute      pause mobile reduce max v_pause",
        "variable     looks equal ternary(c_pause>1,c_pause,1)  # also where spheres blew up",
    ]


def _farthest(columns: str, count: int) -> list[str]:
    """Return the lines of v_farthest, beyond which no sphere has gone: formulas of atoms take it, and no c_far[1]."""
    return [f"compute      far all reduce maxabs {columns}", f"variable     farthest equal {_length('far', 0, count)}"]


def _rates(problem: Problem) -> list[str]:
    """Return the lines of v_swift and v_gain: the largest speed and acceleration of a sphere and its surface.

    Forces on held spheres near the cone only make looks more frequent.
    """
    ways, ends = axes(problem), turns(problem) if problem.on["rotation"] else ()
    around, contacts, number = around_lines(problem), problem.contacts, problem.units.number
    moving, pushed = ("around", "around") if around else ("all", "mobile")
    lightest, radius = number(float(contacts.mass.min()), mass=1), number(float(contacts.radius.max()), length=1)
    # The largest R/I, which is that of a small sphere, times the square of the largest R
    levers = contacts.radius / contacts.mass * (contacts.radius.max() / contacts.radius) ** 2
    lever = float(levers.max()) / INERTIA_RATIO
    both = [f"{name}{end or 'z'}" for name in ("omega", "tq") for end in ends]
    spins, torques = (
        "".join(f" c_spin[{part}]" for part in range(first, first + len(ends))) for first in (1, 1 + len(ends))
    )
    swift, gain = _length("rate", 0, len(ways)), f"{_length('push', 0, len(ways))}/{lightest!r}"
    if ends:
        swift += f"+{radius!r}*{_length('rate', len(ways), len(ends))}"
        gain += f"+{number(lever, length=1, mass=-1) / radius**2!r}*{_length('push', len(ways), len(ends))}"
    return [
        *([f"compute      spin all property/atom {' '.join(both)}"] if ends else []),
        *around,
        f"compute      rate {moving} reduce maxabs {' '.join(f'v{way}' for way in ways)}{spins}",
        f"compute      push {pushed} reduce maxabs {' '.join(f'f{way}' for way in ways)}{torques}",
        f"variable     swift equal {swift}",
        f"variable     gain equal {gain}{_driven(problem)}",
    ]


def _length(compute: str, before: int, count: int) -> str:
    return f"sqrt({'+'.join(f'c_{compute}[{before + part}]^2' for part in range(1, count + 1))})"


def _driven(problem: Problem) -> str:
    """Return the term of the acceleration that sources may add after a look; "" without any."""
    scene, contacts = problem.scene, problem.contacts
    rate = float(contacts.normal_stiffness.max() / contacts.mass.min()) / INERTIA_RATIO * scene.sphere.time_scale**2
    usual = problem.mode.frequency if problem.mode else 0.0
    strengths = [each.largest * max(rate, each.top(scene.sphere, usual) ** 2) for each in scene.source]
    if scene.form == "driven":
        strengths.append(rate)
    return f"+{sum(strengths)!r}*v_D0/v_t0^2" if strengths else ""


def _free(problem: Problem) -> list[str]:
    """Return the formulas of the distances by which no sphere may move before the next look."""
    scene, how, length, free = problem.scene, Reading.of(problem), f"{_softest(problem)!r}*v_Delta0", []
    if OPEN.title in problem.left_out:
        free.append(f"(v_overlap-{nearly_open(scene):.4f})*{length}/2")
        if gap := nearest_gap(problem):
            free.append(f"{problem.units.number(gap, length=1)!r}/2-v_farthest")
    if SLIP.title in problem.left_out:
        stiffness = problem.units.number(float(problem.contacts.shear_stiffness.max()), mass=1, time=-2)
        bears, touch = sliding_force("", how), f"v_overlap*{length}"
        harder = f"{2 * STIFFER!r}*{stiffness!r}*{touch}+(1.5+v_slip)*{bears}+{_SMALL!r}"
        free.append(f"({SLIP.limit_in(scene)!r}-v_slip)*{bears}*{touch}/({harder})")
    return free


def _softest(problem: Problem) -> float:
    """Return the overlap of the stiffest contact over that of two spheres of the lattice, under the same force."""
    contacts, sphere = problem.contacts, problem.scene.sphere
    touching = contacts.overlap > 0
    stiffest = float((contacts.normal_stiffness[touching] / np.sqrt(contacts.overlap[touching])).max())
    return min(1.0, (stiffest / (sphere.normal_stiffness / sphere.static_overlap**0.5)) ** (-2 / 3))
