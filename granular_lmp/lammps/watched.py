"""The guards of a deck whose contacts the kernel computes: it sees every contact at every step.

Its fix gives the extremes since the last line of the thermo table, each contact judged by its own forces, so these
guards miss nothing between two looks and need no bound. Guards that read spheres look at the lines of the table, as
often as those of LAMMPS at least do (`granular_lmp.lammps.pace.FEWEST`). The deck itself, ``in.NAME``, stays one for
any LAMMPS; the input that the run takes, ``in.NAME.kernel``, differs from it by this block.
"""

from math import pi

from granular_lmp.effects.contact_opening import GUARD as OPEN
from granular_lmp.effects.reading import Reading
from granular_lmp.effects.sliding import GUARD as SLIP
from granular_lmp.effects.sliding import mu_line
from granular_lmp.lammps.cone import inside_lines, looks_elsewhere
from granular_lmp.lammps.guards import (
    ELSEWHERE,
    GUARDS,
    fastest,
    guards,
    is_there,
    judged_lines,
    line_interval,
    look_interval,
)
from granular_lmp.lammps.pace import FEWEST
from granular_lmp.problem import Problem

# Elements of the kernel's fix: the extreme of a guard, and the step at which it triggered first
_SEEN = {"overlap": "f_seen{}[1]/v_Delta0", SLIP.name: "f_seen{}[2]*v_friction/v_mu", OPEN.name: "f_seen{}[3]"}
_STEP = {SLIP.name: 4, OPEN.name: 5}


def watched_text(problem: Problem, text: str, checkpoint: str = "") -> str:
    """Return the input of a deck, or of its continuation, with the guards of the kernel in place of LAMMPS's.

    The text is returned as it is where LAMMPS's guards stay: of spheres that meet, of contacts with walls, which are
    LAMMPS's own, and of contacts without shear in the DMT law, of which nobody knows whether they touched before.
    """
    sphere, on = problem.scene.sphere, problem.on
    past = not problem.scene.loose and (on["shear"] or sphere.adhesion_law == "jkr")
    if not past or Reading.of(problem).walls:
        return text
    return text.replace("\n".join(guards(problem, checkpoint)), "\n".join(_guards(problem)))


def columns(problem: Problem) -> list[str]:
    """Return the names of the thermo columns behind the step."""
    names = ["v_tau"]
    for guard in (GUARDS[name] for name in problem.guards):
        names += [guard.column, *([f"{guard.column}_at"] if guard.name in _STEP else [])]
    others = ELSEWHERE if looks_elsewhere(problem.scene) else ()
    return [*names, "v_overlap", *(each for each in others if is_there(each, problem.guards))]


def _guards(problem: Problem) -> list[str]:
    own = [GUARDS[name] for name in problem.guards]
    return [
        "# --- guards: the kernel sees every contact at every step",
        f"variable     look equal {look_interval(problem)}  # a stopped run ends at a multiple of it, as with LAMMPS's",
        *inside_lines(problem),
        *dict.fromkeys(line for guard in own if guard.name not in _STEP for line in guard.lines(problem)),
        *([mu_line(problem.scene)] if SLIP in own else []),
        *_extremes(problem, "inside", ""),
        *(
            f"variable     {guard.name}_at equal f_seen[{_STEP[guard.name]}]*v_step/v_t0"
            for guard in own
            if guard.name in _STEP
        ),
        *(_extremes(problem, "all", "_all") if looks_elsewhere(problem.scene) else []),
        f"thermo_style custom step {' '.join(columns(problem))}",
        "thermo_modify flush yes format float %.10g  # the log of a killed run holds them too",
        f"thermo       {_steps_between(problem)}",
        *judged_lines(problem, _steps_between(problem)),
    ]


def _extremes(problem: Problem, group: str, tag: str) -> list[str]:
    """Return the lines of what is seen of a group; shares of the friction of the deck become those of mu."""
    seen, limit = dict(_SEEN), f"$({SLIP.limit_in(problem.scene)!r}*v_mu/v_friction:%.17g)"
    if SLIP.title not in problem.guards:
        del seen[SLIP.name]
        limit = "1"
    return [
        f"fix          seen{tag} {group} granular/kernel {limit}",
        *(f"variable     {name}{tag} equal {element.format(tag)}" for name, element in seen.items()),
    ]


def _steps_between(problem: Problem) -> int:
    """Return the steps between two lines, a divisor of `line_interval`: `FEWEST` in a period of the fastest motion."""
    looks = look_interval(problem)
    longest = 2 * pi / (FEWEST * fastest(problem.scene, problem.mode)) / (looks * problem.scene.time.step)
    whole = line_interval(problem) // looks
    return looks * next(many for many in range(max(min(whole, int(longest)), 1), 0, -1) if whole % many == 0)
