"""The guards of a deck: when they measure, on which spheres, and their results.

A guard is a number that LAMMPS computes from contacts or spheres at *looks*, and the limit above which it triggers. A
guard is in the deck only if its effect is not. Each look is a line of the thermo table.

Looks are as frequent as the motion needs (`granular_lmp.lammps.pace`), and a look judges only the spheres whose state
can still affect the record (`granular_lmp.lammps.cone`). The guards are defined with their effects
(`granular_lmp.effects`).
"""

from math import pi

from granular_lmp.crystal.modes import Mode, highest_frequency
from granular_lmp.effects.contact_opening import GUARD as OPEN
from granular_lmp.effects.guard import LOOKS, TOP
from granular_lmp.effects.openings import changed_lines, counted_lines
from granular_lmp.effects.reading import Reading, contact_lines, nearly_open, overlap_lines
from granular_lmp.effects.selection import guards as all_guards
from granular_lmp.effects.sliding import GUARD as SLIP
from granular_lmp.effects.sliding import slip_lines
from granular_lmp.lammps import pace
from granular_lmp.lammps.cone import inside_lines, looks_elsewhere
from granular_lmp.lammps.outputs import CONTACTS, UNKNOWN, UNWAVED_CONTACTS
from granular_lmp.problem import Problem
from granular_lmp.scene.at_rest import swiftness
from granular_lmp.scene.linear import physics_of, unit_contacts, usual_frequency
from granular_lmp.scene.scene import Scene

GUARDS = all_guards()
LINE = 10.0  # tau between two lines of the thermo table
LOOKS_IN_COLLISION = 20  # looks of the guards in the shortest collision


# Extremes over all contacts, also those that cannot affect the record: held ends cut a wave off and shear their
# neighbours strongly
NEXT = "v_next"  # column of the step of the next look
ELSEWHERE = ("v_open_all", "v_slip_all", "v_overlap_all")


# --- when a run looks ------------------------------------------------------------------------------------------------


def fastest(scene: Scene, mode: Mode | None = None) -> float:
    """Return the highest frequency that the extremes of contacts depend on, rad/t0; by default of the declared mode.

        max(2Ω, 1·s)

    It is that of the second harmonic, of the fastest source if there are sources, or the top of the branches of
    displacement waves, which bounds free waves. A strike holds every frequency up to the highest. s is
    `granular_lmp.scene.at_rest.swiftness`, 1 in a perfect lattice.
    Each higher harmonic is smaller by the amplitude, and the rotational branch, up to Ω_max, holds a part in a thousand
    of the contacts' motion if no wall cuts the wave off (docs/effects.md).
    """
    usual = mode.frequency if mode else usual_frequency(scene)
    own = [each.top(scene.sphere, usual) for each in scene.drives]
    if scene.form != "none" or not any(own):
        own.append(usual)
    top = highest_frequency(unit_contacts(scene), scene.sphere, physics_of(scene)) if scene.struck else TOP
    return max(2 * max(own), top * swiftness(scene))


def look_interval(problem: Problem) -> int:
    """Return the steps between two looks, a whole number of them in the run: `LOOKS` per period of `fastest`.

    Where spheres meet there are `LOOKS_IN_COLLISION` in the shortest collision, a whole number of them in a sample.
    """
    time = problem.scene.time
    if problem.scene.loose:
        most, whole = int(problem.collisions.shortest_collision / LOOKS_IN_COLLISION / time.step), time.steps_per_sample
    else:
        most, whole = int(_look_time(problem) / time.step + 1e-9), time.steps
    return next(steps for steps in range(max(min(most, whole), 1), 0, -1) if whole % steps == 0)


def line_interval(problem: Problem) -> int:
    """Return the steps between two lines of the thermo table, a whole number of looks; one where spheres meet."""
    if problem.scene.loose:
        return look_interval(problem)
    return look_interval(problem) * _looks_per_line(problem)


def _look_time(problem: Problem) -> float:
    return 2 * pi / (LOOKS * fastest(problem.scene, problem.mode))


def _looks_per_line(problem: Problem) -> int:
    return max(1, int(LINE / (look_interval(problem) * problem.scene.time.step) + 1e-9))


# --- the deck --------------------------------------------------------------------------------------------------------


def guards(problem: Problem, checkpoint: str = "") -> list[str]:
    """Return the block of the guards of a problem, each line once, and the thermo output of all.

    The contacts of a guard whose effect is off are judged one by one, also where the scene calls for the effect.
    """
    if problem.scene.loose:
        return _of_meetings(problem)
    scene, names, how = problem.scene, problem.guards, Reading.of(problem)
    watched = [GUARDS[name] for name in names]
    steps, longest = look_interval(problem), _look_time(problem) * (1 + 1e-9)
    text: list[str] = []
    for guard in watched:
        of_contacts = _of_contacts("inside", "", how) if guard.of_contacts else []
        text += [line for line in (*of_contacts, *guard.lines(problem)) if line not in text]
    if looks_elsewhere(scene):
        *missing, open_all = changed_lines(problem, everywhere=True)
        text += [
            "# for information: the same for all spheres, also those that cannot affect the record; no run fails by it",
            *_of_contacts("all", "_all", how),
            *missing,
            *(slip_lines("_all", how) if SLIP.title in names else []),
            open_all,
        ]
    return [
        "# --- guards: proof that the effects this deck leaves out do not occur",
        "thermo_style custom step",
        "run          0 post no  # so that there are forces when the step of the next look is computed",
        *inside_lines(problem),
        f"# at most {LOOKS} looks in a period of the fastest motion; at every step if -var made steps too long",
        f"variable     look equal $(ternary((v_steps%{steps}==0)*({longest:.6g}>={steps}*v_step/v_t0),{steps},1))",
        *text,
        *counted_lines(problem),
        *pace.lines(problem, fastest(scene, problem.mode)),
        f'fix          looks all print v_next "{_row(problem)}"',
        *_written_out(problem, how, checkpoint),
        f"thermo_style custom step {' '.join(columns(problem))}",
        "thermo_modify flush yes format float %.10g  # the log of a killed run holds them too",
        f"thermo       $(v_look*{_looks_per_line(problem)})",
    ]


def _row(problem: Problem) -> str:
    """Return the text of a look: a line of the thermo table, without what is measured at its own lines only."""
    words = [UNKNOWN if name in ELSEWHERE else f"$({name}:%.10g)" for name in columns(problem)]
    return " ".join(["$(step)", *words])


def _of_meetings(problem: Problem) -> list[str]:
    """Return the block of the guards of spheres that meet: every look is a line of the thermo table."""
    lines = dict.fromkeys(line for name in problem.guards for line in GUARDS[name].lines(problem))
    return [
        "# --- guards: the largest force of a contact; its overlap and frequency are at most those of the softest and",
        "#     the stiffest pair of spheres",
        *lines,
        f"thermo_style custom step {' '.join(columns(problem))}",
        "thermo_modify flush yes",
        f"thermo       {look_interval(problem)}",
    ]


def columns(problem: Problem) -> list[str]:
    """Return the names of the thermo columns behind the step."""
    names = problem.guards
    if problem.scene.loose:
        return ["v_tau", *(GUARDS[name].column for name in names)]
    own = [GUARDS[name].column for name in names]
    others = ELSEWHERE if looks_elsewhere(problem.scene) else ()
    return ["v_tau", *own, "v_overlap", NEXT, *(name for name in (*others, "v_mu") if is_there(name, names))]


def is_there(text: str, names: list[str]) -> bool:
    """Return whether a line or column is in the deck; those of slip need shear."""
    return "largest_slip" in names or ("slip" not in text and "mu" not in text)


def _of_contacts(group: str, tag: str, how: Reading) -> list[str]:
    return [*contact_lines(group, tag, how), *overlap_lines(tag, how)]


def _written_out(problem: Problem, how: Reading, checkpoint: str) -> list[str]:
    """Return the lines that dump each contact while a guard that is an upper bound does not decide, to judge it alone.

    LAMMPS counts contacts before it asks whether to skip. A dump whose interval is a time counts those that the look
    has computed, while one whose interval is in steps has them computed again.
    """
    scene = problem.scene
    names = [name for name in problem.guards if GUARDS[name].per_contact(scene) and name in problem.left_out]
    if not names:
        return []
    columns, numbers, ends = "c_contact[1] c_contact[2]", "%.17g %.9g", []
    if how.whole:
        columns, numbers = f"{columns} c_contact[3]", f"{numbers} %.9g"
    if not how.lengths:
        columns, numbers = f"c_ends[1] c_ends[2] {columns}", f"%.0f %.0f {numbers}"
        ends = [f"compute      ends inside property/local patom1 patom2 cutoff {how.formulas.cutoff}"]
    holds = {
        SLIP.title: f"({SLIP.limit_in(scene)!r}>=v_slip)",
        OPEN.title: f"(v_overlap>={nearly_open(scene):.4f})",
    }
    bound = " or ".join({SLIP.title: "v_slip", OPEN.title: "v_overlap"}[name] for name in names)
    return [
        f"# each contact, distance and shear force, at the looks where the bound {bound} does not decide; the interval",
        "# is a time, as LAMMPS would compute the contacts again for a dump whose interval is in steps",
        *ends,
        f"variable     decided equal {'&&'.join(holds[name] for name in names)}",
        "variable     next_look equal time+dt*(v_next-step)",
        f"dump         contacts all local ${{look}} ${{dump}}.contacts {columns}",
        f'dump_modify  contacts every/time v_next_look first yes skip v_decided format line "{numbers}"'
        + " append yes" * bool(checkpoint),
    ]


def header(problem: Problem) -> list[str]:
    """Return the comment at the top of a deck: the thermo columns and the limits above which the run is invalid."""
    judged = [GUARDS[name] for name in problem.judged]
    if problem.scene.loose:
        top = "# The run is invalid if, in the thermo table,"
        return [top, *(f"#   {each.column}, {each.heading.format(limit=each.limit)}" for each in judged)]
    limits = [
        f"#   {guard.column} is above {guard.limit_in(problem.scene):.4g}: "
        + guard.meaning.rpartition(": ")[2]
        + (
            f"; {UNWAVED_CONTACTS if problem.mode is None else CONTACTS} then holds each contact"
            if guard is SLIP
            else ""
        )
        for guard in judged
    ]
    top = "# A line of the thermo table is a look at all contacts. The run is invalid from the line on in which"
    return [top, *limits] if limits else []
