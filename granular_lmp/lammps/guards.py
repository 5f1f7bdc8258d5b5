"""Guards of a deck: what it checks, on which spheres, and the limits above which a run is invalid.

A guard is a number that LAMMPS computes from contacts or spheres at regular *looks* (checks), with a limit above which
it triggers. The deck has a guard only if it leaves out the effect. Each look is a line of the thermo table.
`granular_lmp.rest.looks` sets their times, and `granular_lmp.lammps.region_of_influence` selects the spheres that can
still affect the record. The guards are defined with their effects (`granular_lmp.effects`).
"""

from collections.abc import Mapping
from types import MappingProxyType

from granular_lmp.effects.between_looks import nearly_open
from granular_lmp.effects.case import Case
from granular_lmp.effects.contact_opening import GUARD as OPEN
from granular_lmp.effects.guard import Guard
from granular_lmp.effects.openings import counted_lines
from granular_lmp.effects.reading import Reading, contact_lines, overlap_lines
from granular_lmp.effects.selection import guards as all_guards
from granular_lmp.effects.sliding import GUARD as SLIP
from granular_lmp.lammps.outputs import CONTACTS, UNWAVED_CONTACTS
from granular_lmp.lammps.region_of_influence import inside_lines, leaving_lines
from granular_lmp.problem import Problem
from granular_lmp.rest.looks import longest

GUARDS = all_guards()
# The largest shear over the smallest sliding force is at most this times the largest ratio of one contact (make guards)
BOUND = 3.0


def line_interval(problem: Problem) -> int:
    """Return the steps between two lines of the thermo table: between two looks, or of a sample without looks."""
    return problem.rest.steps_between_looks if problem.looks else problem.scene.time.steps_per_sample


def has_looks(problem: Problem) -> bool:
    """Return whether the deck has looks at v_look, as for linear waves; for spheres that meet, every line is one."""
    return problem.scene.holding.has_modes


def guards(problem: Problem, checkpoint: str = "") -> list[str]:
    """Return the block of the guards of a problem, without repeated lines, and their thermo output.

    If an effect is off, its contacts are judged one by one, even if the scene needs the effect.
    """
    if not problem.looks:
        return _none(problem)
    how, text = Reading.of(problem), list[str]()
    for guard in (GUARDS[name] for name in problem.guards):
        of_contacts = [*contact_lines(how), *overlap_lines(how)] if guard.of_contacts else []
        text += [line for line in (*of_contacts, *guard.lines(problem)) if line not in text]
    names = _measured(problem)
    seen = {name: f"f_looks[{place}]" for place, name in enumerate(names, 1)}
    sources = " ".join(_sources(names, text))
    return [
        f"# --- guards: do effects occur that this deck leaves out?{_judges(problem)}",
        *inside_lines(problem),
        *look_lines(problem),
        *text,
        *counted_lines(problem),
        f"fix          looks all ave/time ${{look}} 1 ${{look}} {sources}  # LAMMPS computes them once a look",
        *judged_lines(problem, seen=seen),
        *_written_out(problem, how, seen, checkpoint),
        *thermo_lines(columns(problem), seen),
    ]


def _none(problem: Problem) -> list[str]:
    """Return the block of a run without guards: one line of the thermo table per sample, for the progress."""
    return [
        "# --- guards: none, as a finer run of the same scene has guards",
        *leaving_lines(problem),
        "thermo_style custom step v_tau",
        "thermo       ${every}",
    ]


def look_lines(problem: Problem) -> list[str]:
    """Return the line of v_look, the steps between two looks, as `look_interval`, also for another step by -var."""
    time = repr(longest(problem.scene, problem.rest.frequency))
    return [f"variable     look equal $(1+floor(abs({time}*v_t0/v_step-1)))  # steps between two looks, at least 1"]


def thermo_lines(names: list[str], seen: Mapping[str, str]) -> list[str]:
    """Return the lines of the thermo table; `seen` maps some columns to the places of their numbers."""
    heads = "".join(f" colname {place} {name}" for name, place in seen.items())
    return [
        f"thermo_style custom step {' '.join(seen.get(name, name) for name in names)}",
        f"thermo_modify flush yes format float %.10g{heads}",  # the log of a killed run then has the lines too
        "thermo       ${look}",
    ]


def judged_lines(
    problem: Problem, every: int | str = "${look}", seen: Mapping[str, str] = MappingProxyType({})
) -> list[str]:
    """Return the line that keeps the numbers with which the last lines of the deck judge the run."""
    names = [GUARDS[name].column for name in problem.judged]
    own = " ".join(seen.get(name, name) for name in names)
    return [f"fix          judged all vector {every} {own}  # for the last lines"] if own else []


def verdict(problem: Problem) -> list[str]:
    """Return the last lines of a deck, with which plain LAMMPS also reports that a run is invalid, and why."""
    judged = [GUARDS[name] for name in problem.judged]
    if not judged:
        return []
    columns = [f"f_judged[{number}]" for number in range(1, len(judged) + 1)] if len(judged) > 1 else ["f_judged"]
    says = [f"print 'INVALID: {_trouble(guard, problem)}'" for guard in judged]
    return [
        "echo         none  # so that the log has the word below only if it is true",
        *(
            f'if "$(max({column})) > {guard.limit_in(problem)!r}" then "{said}"'
            for column, guard, said in zip(columns, judged, says, strict=True)
        ),
    ]


def guards_of_meeting(problem: Problem, checkpoint: str = "") -> list[str]:
    """Return the block of the guards for spheres that meet: every line of the thermo table is a look."""
    lines = dict.fromkeys(line for name in problem.guards for line in GUARDS[name].lines(problem))
    return [
        "# --- guards: the largest force of a contact; its overlap and frequency are at most those of the softest and",
        "#     the stiffest pair of spheres",
        *lines,
        f"thermo_style custom step v_tau {' '.join(GUARDS[name].column for name in problem.guards)}",
        "thermo_modify flush yes",
        f"thermo       {line_interval(problem)}",
        *judged_lines(problem, line_interval(problem)),
    ]


def columns(problem: Problem) -> list[str]:
    """Return the names of the thermo columns behind the step."""
    return ["v_tau", *_measured(problem)]


def _measured(problem: Problem) -> list[str]:
    """Return the columns that a look measures."""
    return [*(GUARDS[name].column for name in problem.guards), "v_overlap"]


def _sources(names: list[str], lines: list[str]) -> list[str]:
    """Return the LAMMPS names behind the columns: c_NAME for a compute, v_NAME for a variable."""
    by_computes = {line.split()[1] for line in lines if line.startswith("compute ")}
    return [f"c_{own}" if (own := name.removeprefix("v_")) in by_computes else name for name in names]


def _written_out(problem: Problem, how: Reading, seen: Mapping[str, str], checkpoint: str) -> list[str]:
    """Return the lines that dump single contacts, to be judged one by one while an upper bound does not decide.

    There are none if the expected wave is far below the limit. LAMMPS counts contacts before it decides to skip a dump.
    With an interval in time it counts the contacts that the look has computed; with an interval in steps it computes
    them again.
    """
    names = _of_single_contacts(problem)
    if not names:
        return []
    columns, numbers, ends = "c_contact[1] c_contact[2]", "%.17g %.9g", []
    if how.whole:
        columns, numbers = f"{columns} c_contact[3]", f"{numbers} %.9g"
    if not how.lengths:
        columns, numbers = f"c_ends[1] c_ends[2] {columns}", f"%.0f %.0f {numbers}"
        ends = [f"compute      ends inside property/local patom1 patom2 cutoff {how.law.cutoff}"]
    holds = {
        SLIP.title: f"({SLIP.limit_in(problem):.4f}>={seen['v_slip']})",
        OPEN.title: f"({seen['v_overlap']}>={nearly_open(problem.rest):.4f})",
    }
    return [
        *ends,
        f"variable     decided equal {'&&'.join(holds[name] for name in names)}  # if 0, single contacts are written",
        "variable     next equal time+dt*${look}",
        f"dump         contacts all local ${{look}} ${{dump}}.contacts {columns}",
        f'dump_modify  contacts every/time v_next first yes skip v_decided format line "{numbers}"'
        + " append yes" * bool(checkpoint),
    ]


def _of_single_contacts(problem: Problem) -> list[str]:
    """Return the titles of the guards for which a deck may dump single contacts."""
    scene = problem.scene
    names = [name for name in problem.guards if GUARDS[name].per_contact(scene) and name in problem.left_out]
    if SLIP.title in names and BOUND * Case(scene, problem.on).largest_slip() < SLIP.limit_in(problem):
        names.remove(SLIP.title)
    return names


def _judges(problem: Problem) -> str:
    """Return words for the heading if the last lines of the deck judge its run."""
    return " If so the last lines say INVALID, and why" if problem.judged else ""


def _trouble(guard: Guard, problem: Problem) -> str:
    """Return words, after the name of the column, for a guard above its limit."""
    limit = guard.limit_in(problem)
    if guard.heading:
        return f"{guard.column}, {guard.heading.format(limit=limit)}"
    dump = UNWAVED_CONTACTS if problem.wave is None else CONTACTS
    each = f"; {dump} then holds each contact" if guard is SLIP and SLIP.title in _of_single_contacts(problem) else ""
    return f"{guard.column} is above {limit:.4g}: {guard.meaning.rpartition(': ')[2]}{each}"
