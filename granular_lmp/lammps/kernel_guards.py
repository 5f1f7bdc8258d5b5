"""Guards of a deck whose contacts the kernel computes: it checks every contact at every step.

The fix of the kernel returns the extremes since the last line of the thermo table, with each contact judged by its own
forces. These guards miss nothing between two looks and need no bound. Guards on spheres are checked at the lines of the
table. The deck ``in.NAME`` still runs with any LAMMPS; the input of the run, ``in.NAME.kernel``, differs only in this
block.
"""

import re

from granular_lmp.effects.contact_opening import GUARD as OPEN
from granular_lmp.effects.reading import Reading
from granular_lmp.effects.sliding import GUARD as SLIP
from granular_lmp.effects.sliding import judged_friction
from granular_lmp.lammps.guards import GUARDS, guards, has_looks, judged_lines, look_lines, thermo_lines
from granular_lmp.lammps.region_of_influence import inside_lines
from granular_lmp.problem import Problem
from granular_lmp.scene.schema import AUTO

# Elements of the fix of the kernel: the step at which a guard first triggered
_STEP = {SLIP.name: 4, OPEN.name: 5}


def watched_text(problem: Problem, text: str, checkpoint: str = "") -> str:
    """Return the input of a deck, or of its continuation, with the guards of the kernel in place of those of LAMMPS.

    The text does not change in a run without looks, and in four cases the guards of LAMMPS stay: for spheres that meet;
    for contacts with walls, which LAMMPS computes; for DMT contacts without shear, which have no memory of an earlier
    touch; and if other lines of an edited deck use a part of the guards.
    """
    sphere, on = problem.scene.sphere, problem.on
    past = problem.looks and has_looks(problem) and (on["shear"] or sphere.contact_law.beyond)
    if not past or Reading.of(problem).walls:
        return text
    theirs, own = guards(problem, checkpoint), _guards(problem)
    changed = text.replace("\n".join(theirs), "\n".join(own))
    gone = _named(theirs) - _named(own)
    return text if gone & set(re.findall(r"\b[cfv]_\w+", changed)) else changed


def _named(lines: list[str]) -> set[str]:
    """Return the names that lines define, as other lines use them: c_NAME, f_NAME, v_NAME."""
    return {"_".join(found) for line in lines for found in re.findall(r"^([cfv])(?:ompute|ix|ariable) +(\w+)", line)}


def columns(problem: Problem) -> list[str]:
    """Return the names of the thermo columns behind the step."""
    names = ["v_tau"]
    for guard in (GUARDS[name] for name in problem.guards):
        names += [guard.column, *([f"{guard.column}_at"] if guard.name in _STEP else [])]
    return [*names, "v_overlap"]


def _guards(problem: Problem) -> list[str]:
    own = [GUARDS[name] for name in problem.guards]
    return [
        "# --- guards: the kernel sees every contact at every step",
        *inside_lines(problem),
        *look_lines(problem),
        *dict.fromkeys(line for guard in own if guard.name not in _STEP for line in guard.lines(problem)),
        *_extremes(problem if SLIP in own else None),
        *(
            f"variable     {guard.name}_at equal f_seen[{_STEP[guard.name]}]*v_step/v_t0"
            for guard in own
            if guard.name in _STEP
        ),
        *thermo_lines(columns(problem), {}),
        *judged_lines(problem),
    ]


def _extremes(sheared: Problem | None) -> list[str]:
    """Return the lines of the extremes; shares of the friction in the deck become shares of the limiting friction.

    sheared : None if nothing is sheared.
    """
    limit, slip = repr(SLIP.limit), "f_seen[2]"
    if sheared is not None and sheared.scene.effects.friction != AUTO:
        judged = judged_friction(sheared)
        limit, slip = f"$({limit}*{judged}/v_friction:%.17g)", f"{slip}*v_friction/{judged}"
    return [
        f"fix          seen inside granular/kernel {1 if sheared is None else limit}",
        "variable     overlap equal f_seen[1]/v_Delta0",
        *([] if sheared is None else [f"variable     {SLIP.name} equal {slip}"]),
        f"variable     {OPEN.name} equal f_seen[3]",
    ]
