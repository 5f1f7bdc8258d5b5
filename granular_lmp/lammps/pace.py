"""When the guards of a deck look next: as late as a bound on the motion of the spheres proves that nothing happens.

At a look let v be the speed of the fastest sphere in and around the cone that guards judge
(`granular_lmp.lammps.cone`), and a its largest acceleration, both with those of the surface of the sphere that turns
fastest. In a time t no sphere moves, and none turns at its surface, by more than

    G (v t + a t²/2)

In a linear crystal G is the sum over the responses of all spheres to one that is pushed. Up to a quarter of the period
of the branches that carry displacements it is at most 1.60 in a plane (hexagonal; chain 1.24, square 1.45) and 2.16 in
space (fcc), and in crystals of unequal masses, radii and materials, with vacancies, 1.61 and 2.15 (300 random ones,
whose time is that of the stiffest contact and the lightest sphere); `GROWTH` stands for all. It is the G of stiffnesses
at rest: a wave that presses contacts far beyond is outside. The next look is due when the distance reaches the smallest
s by which

    s = x²/2(x + 0.3), x = δ − δ_open   the contact that touches least may be pulled by 2s < x
    s = d/2                             the nearest spheres, a gap d apart, may approach
    s = (1 − r) S/(3g + (3/2 + r) S/δ)  the bound r of slip may grow to 1

with the smallest overlap δ, the stiffness g in shear and the smallest sliding force S. In the latter the hardest
sheared contact gains 3gs of shear and a share s/δ of stiffness, while the one that touches least loses up to 3sS/2δ of
what it bears. Near to opening 2s is a small part of x: there it matters how small the overlap became, which only looks
tell.

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
GROWTH = {2: 1.7, 3: 2.2}  # by dimensions in which spheres move
STIFFER = 1.5  # times the shear stiffness at rest: that of a contact pressed to 2.25 Δ0
RESOLVED = 0.3  # Δ0: contacts that keep less are looked at more often than the bound asks for
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
    free, parts, growth = [*free, "$(v_Delta0:%.17g)"], range(len(free) + 1), GROWTH[problem.scene.space]
    return [
        f"# the next look is due when a sphere may have moved, or turned, by v_room: at most {growth}(v t + a t^2/2)",
        *_rates(problem),
        *(_farthest(columns, len(axes(problem))) if any("v_farthest" in each for each in free) else []),
        *_kept(problem),
        *(f"variable     part{part} vector [{','.join(str(int(part == other)) for other in parts)}]" for part in parts),
        f"variable     free vector {'+'.join(f'v_part{part}*{each}' for part, each in enumerate(free))}",
        "variable     room equal (min(v_free)>0)*min(v_free)",
        f"variable     grows equal {growth!r}*v_swift",
        f"variable     due vector v_one*2*v_room/(v_grows+sqrt(v_grows^2+{2 * growth!r}*v_gain*v_room)+{_SMALL!r})"
        "/$(v_look*v_step:%.17g)",
        "variable     looks equal 1+floor(ternary(v_due[1]>$(v_longest),$(v_longest),ternary(v_due[1]>0,v_due[1],0)))"
        "  # 1 also where spheres blew up",
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
    strengths = [each.largest * max(rate, each.top(scene.sphere, usual) ** 2) for each in scene.drives]
    if scene.form == "driven":
        strengths.append(rate)
    return f"+{sum(strengths)!r}*v_D0/v_t0^2" if strengths else ""


def _free(problem: Problem) -> list[str]:
    """Return the formulas of the distances by which no sphere may move before the next look."""
    scene, length, free = problem.scene, f"$({_softest(problem)!r}*v_Delta0:%.17g)", []
    if OPEN.title in problem.left_out:
        left = f"(v_touch[1]-{nearly_open(scene):.4f})"
        free.append(f"{left}*abs({left})/(abs({left})+{RESOLVED})*{length}/2")
        if gap := nearest_gap(problem):
            free.append(f"({problem.units.number(gap, length=1)!r}/2-v_farthest)")
    if SLIP.title in problem.left_out:
        stiffness = problem.units.number(float(problem.contacts.shear_stiffness.max()), mass=1, time=-2)
        harder = f"{2 * STIFFER!r}*{stiffness!r}*v_touch[1]*{length}+(1.5+v_rubs[1])*v_bears[1]+{_SMALL!r}"
        free.append(f"({SLIP.limit_in(scene)!r}-v_rubs[1])*v_bears[1]*v_touch[1]*{length}/({harder})")
    return free


def _kept(problem: Problem) -> list[str]:
    """Return the lines of what the bound reads more than once: LAMMPS computes a vector once a step."""
    kept = {"touch": "v_overlap"}
    if SLIP.title in problem.left_out:
        kept |= {"rubs": "v_slip", "bears": sliding_force("", Reading.of(problem))}
    return [
        "# formulas that are read more than once, as vectors, which LAMMPS computes once a step",
        "variable     one vector [1]",
        *(f"variable     {name} vector v_one*{formula}" for name, formula in kept.items()),
    ]


def _softest(problem: Problem) -> float:
    """Return the overlap of the stiffest contact over that of two spheres of the lattice, under the same force."""
    contacts, sphere = problem.contacts, problem.scene.sphere
    touching = contacts.overlap > 0
    stiffest = float((contacts.normal_stiffness[touching] / np.sqrt(contacts.overlap[touching])).max())
    return min(1.0, (stiffest / (sphere.normal_stiffness / sphere.static_overlap**0.5)) ** (-2 / 3))
