"""The guards of a deck: when they measure, on which spheres, and their results.

A guard is a number that LAMMPS computes from contacts or spheres at regular *looks*, and the limit above which it
triggers. A guard is in the deck only if its effect is not. A line of the thermo table holds the extremes over all looks
since the line before, and the first time among them at which a limit was passed.

Looks are frequent enough for the motion (`fastest`), and a look judges only the spheres whose state can still affect
the record (`_inside`). The guards are defined with their effects (`granular_lmp.effects`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import law_between
from granular_lmp.crystal.modes import highest_frequency
from granular_lmp.effects.contact_opening import CHANGED
from granular_lmp.effects.contact_opening import GUARD as OPEN
from granular_lmp.effects.guard import (
    BETWEEN,
    LOOKS,
    NEVER,
    TOP,
    Reading,
    contact_lines,
    kept_at_looks,
    overlap_lines,
)
from granular_lmp.effects.selection import guards
from granular_lmp.effects.sliding import GUARD as SLIP
from granular_lmp.effects.sliding import sliding_force
from granular_lmp.lammps.openings import changed_lines, counted_lines
from granular_lmp.lammps.outputs import CONTACTS, read_snapshots
from granular_lmp.scene.at_rest import crystal_of, swiftness
from granular_lmp.scene.linear import mode_of, physics_of, unit_contacts
from granular_lmp.scene.scene import Scene
from granular_lmp.scene.shape import quiet_rows
from granular_lmp.units import units_for

GUARDS = guards()
LINE = 10.0  # tau between two lines of the thermo table


@dataclass(frozen=True)
class Measured:
    """Result of a guard in a run.

    Attributes
    ----------
    value : float
        Extreme over all looks; for contacts judged one by one, over the looks where the bound is above the limit.
    passed_at : float or None
        Time τ at which the guard first triggered; None if it did not.
    bound : float
        Extreme of the thermo column, an upper bound of the value.
    """

    value: float
    passed_at: float | None
    bound: float


# Extremes over all contacts, also those that cannot affect the record: held ends cut a wave off and shear their
# neighbours strongly
ELSEWHERE = ("v_open_all", "v_slip_all", "v_overlap_all")
_SLIP_ALL = "variable     slip_all equal c_extreme_all[2]/<sliding_force_all>"


# --- when a run looks ------------------------------------------------------------------------------------------------


def fastest(scene: Scene) -> float:
    """Return the highest frequency that the extremes of contacts depend on, rad/t0.

        max(2Ω, 1·s)

    It is that of the second harmonic, of the fastest source if there are sources, or the top of the branches of
    displacement waves, which bounds free waves. A strike holds every frequency up to the highest. s is
    `granular_lmp.scene.at_rest.swiftness`, 1 in a perfect lattice.
    Each higher harmonic is smaller by the amplitude, and the rotational branch, up to Ω_max, holds a part in a thousand
    of the contacts' motion if no wall cuts the wave off (docs/effects.md).
    """
    usual = mode_of(scene).frequency
    own = [each.top(scene.sphere, usual) for each in scene.source]
    if scene.wave.form != "none" or not any(own):
        own.append(usual)
    top = highest_frequency(unit_contacts(scene), scene.sphere, physics_of(scene)) if scene.struck else TOP
    return max(2 * max(own), top * swiftness(scene))


def look_interval(scene: Scene) -> int:
    """Return the steps between two looks: `LOOKS` looks per period of `fastest`, a whole number of them in the run."""
    most = min(int(_look_time(scene) / scene.time.step + 1e-9), scene.time.steps)
    return next(steps for steps in range(max(most, 1), 0, -1) if scene.time.steps % steps == 0)


def line_interval(scene: Scene) -> int:
    """Return the steps between two lines of the thermo table, a whole number of looks."""
    return look_interval(scene) * _looks_per_line(scene)


def _look_time(scene: Scene) -> float:
    return 2 * pi / (LOOKS * fastest(scene))


def _looks_per_line(scene: Scene) -> int:
    return max(1, int(LINE / (look_interval(scene) * scene.time.step) + 1e-9))


# --- the spheres it looks at -----------------------------------------------------------------------------------------


def watches_part(scene: Scene) -> bool:
    """Return whether only some spheres affect the record: with walls or a finite wave, recorded at the centre."""
    return scene.output.particles == 0 and (bool(scene.shape.faces) or scene.envelope.finite)


def _inside(scene: Scene) -> list[str]:
    """Return the lines for the group of the spheres whose state can still affect the record before the run ends.

    The group holds all spheres if snapshots record them, or in a periodic plane wave. Otherwise it is a cone around the
    centre, which starts one row inside the strip whose echo arrives after the run (`quiet_rows`) and ends one row from
    the centre, and the like along y around the rows of each monitor. The group is renewed whenever the cone has lost a
    row.
    """
    if not watches_part(scene):
        return ["group        inside union all  # the spheres that what is recorded depends on"]
    far = _farthest_row(scene)
    row = units_for(scene.sphere.radius).number(scene.lattice.row_distance(scene.sphere.lattice_constant), length=1)
    near = ["v_reach^2>x*x+y*y"]
    for monitor in scene.monitor:
        low, high = ((each - scene.shape.centre_row) * row for each in monitor.span)
        apart = f"abs(y-({(low + high) / 2!r}))"
        if scene.shape.along_y:  # the shorter way may be across the faces
            half = scene.shape.rows * row / 2
            apart = f"({half!r}-abs({half!r}-{apart}))"
        near.append(f"v_reach>{apart}-{(high - low) / 2!r}")
    where = "the centre or a monitor" if scene.monitor else "the centre"
    return [
        f"# spheres from where a signal still reaches {where} before the end: outside, a guard would judge walls",
        f"variable     reach equal {row!r}*(1.5+{far - 2.5}*(1-v_tau/(v_duration+(v_duration==0))))",
        f"variable     near atom {'||'.join(near)}",
        f"group        inside dynamic all var near every {_group_interval(scene)}",
    ]


def _farthest_row(scene: Scene) -> int:
    return (quiet_rows(scene.time.duration * swiftness(scene)) - 1) // 2


def _group_interval(scene: Scene) -> int:
    """Return the steps in which the cone loses a row."""
    return max(1, int(scene.time.duration / _farthest_row(scene) / scene.time.step))


# --- the deck --------------------------------------------------------------------------------------------------------


def lines(names: list[str], scene: Scene, exact: list[str]) -> list[str]:
    """Return the lines of some guards, each line once, and the thermo output of all.

    Parameters
    ----------
    names : list of str
        Keys of `GUARDS`.
    scene : Scene
        Scene with every "auto" decided.
    exact : list of str
        Keys of the guards whose effects are off, also where the scene calls for them: contacts are judged one by one.
    """
    part = watches_part(scene)
    steps, longest, watched = look_interval(scene), _look_time(scene) * (1 + 1e-9), [GUARDS[name] for name in names]
    text: list[str] = []
    for guard in watched:
        of_contacts = _of_contacts("inside", "looks", scene) if guard.of_contacts else []
        own = changed_lines(scene, part=part) if CHANGED in guard.lines else guard.lines
        text += [line for line in (*of_contacts, *own) if line not in text]
    for guard in watched:
        name = guard.name
        text.append(
            f"variable     {name}_when vector look(v_tau)+{NEVER:g}*({guard.limit_in(scene)!r}>=v_{name}_looks)"
        )
    text += _extremes(names)
    text = _with_sliding_force(text, "looks", scene)
    kept, text = kept_at_looks(text, "v_tau")
    text += [
        f"# {LOOKS} looks in a period of the fastest motion that matters; at every step if -var made steps too long",
        f"variable     look equal $(ternary((v_steps%{steps}==0)*({longest:.6g}>={steps}*v_step/v_t0),{steps},1))",
        *counted_lines(scene, part=part),
        # Unlimited, it would fill the memory in a long run
        f"fix          looks all vector ${{look}} {' '.join(kept)} nmax {_looks_per_line(scene) + 1}",
    ]
    if part:
        *missing, open_all = changed_lines(scene, everywhere=True)
        text += [
            "# for information: the same for all spheres, also those that cannot affect the record; no run fails by it",
            *_of_contacts("all", "all", scene),
            *missing,
            *(_with_sliding_force([_SLIP_ALL], "all", scene) if "largest_slip" in names else []),
            open_all,
        ]
    if undecided := [name for name in names if GUARDS[name].per_contact(scene) and name in exact]:
        text += _written_out(undecided, scene)
    return [
        *_inside(scene),
        *text,
        f"thermo_style custom step {' '.join(columns(names, scene))}",
        "thermo_modify flush yes  # the log of a killed run holds them too",
        f"thermo       $(v_look*{_looks_per_line(scene)})",
    ]


def _extremes(names: list[str]) -> list[str]:
    """Return the lines of the thermo columns of some guards: extremes over the looks since the line before."""
    text = []
    for name in (GUARDS[name].name for name in names):
        text += [f"variable     {name} equal max(v_{name}_looks)", f"variable     {name}_at equal min(v_{name}_when)"]
    return [*text, "variable     overlap equal min(v_overlap_looks)"]


def columns(names: list[str], scene: Scene) -> list[str]:
    """Return the names of the thermo columns behind the step."""
    own = [column for name in names for column in (GUARDS[name].column, f"{GUARDS[name].column}_at")]
    others = ELSEWHERE if watches_part(scene) else ()
    return ["v_tau", *own, "v_overlap", *(name for name in (*others, "v_mu") if _is_there(name, names))]


def _is_there(text: str, names: list[str]) -> bool:
    """Return whether a line or column is in the deck; those of slip need shear."""
    return "largest_slip" in names or ("slip" not in text and "mu" not in text)


def _of_contacts(group: str, of: str, scene: Scene) -> list[str]:
    tag, how = "_all" if of == "all" else "", Reading.of(scene)
    return [*contact_lines(group, tag, how), *overlap_lines(of, how)]


def _with_sliding_force(text: list[str], of: str, scene: Scene) -> list[str]:
    force = sliding_force(scene.sphere.adhesion_law, of, Reading.of(scene))
    return [line.replace(f"<sliding_force_{of}>", force) for line in text]


def _written_out(names: list[str], scene: Scene) -> list[str]:
    """Return the lines that dump each contact while a guard that is an upper bound does not decide, to judge it alone.

    LAMMPS counts contacts before it asks whether to skip. A dump whose interval is a time counts those that the look
    has computed, while one whose interval is in steps has them computed again.
    """
    columns, numbers, ends, how = "c_contact[1] c_contact[2]", "%.17g %.9g", [], Reading.of(scene)
    if how.whole:
        columns, numbers = f"{columns} c_contact[3]", f"{numbers} %.9g"
    if not how.lengths:
        columns, numbers = f"c_ends[1] c_ends[2] {columns}", f"%.0f %.0f {numbers}"
        ends = [f"compute      ends inside property/local patom1 patom2 cutoff {how.formulas.cutoff}"]
    force = sliding_force(scene.sphere.adhesion_law, "now", how).replace(
        "v_mu", "$(v_mu:%.17g)"
    )  # parsed at every look
    slip, opens = f"{SLIP.limit_in(scene)!r}>=c_extreme[2]/{force}", "v_overlap_now>=<nearly_open>"
    holds = {SLIP.title: f"({slip})", OPEN.title: f"({opens})"}
    decided, skip = (
        (slip, "slip_holds") if names == [SLIP.title] else ("&&".join(holds[name] for name in names), "decided")
    )
    bound = " or ".join({SLIP.title: "v_slip", OPEN.title: "v_overlap"}[name] for name in names)
    return [
        f"# each contact, distance and shear force, at the looks where the bound {bound} does not decide; the interval",
        "# is a time, as LAMMPS would compute the contacts again for a dump whose interval is in steps",
        *ends,
        *overlap_lines("now", how),
        f"variable     {skip} equal {decided}",
        "variable     next_look equal time+dt*(${look}-step%${look})",
        f"dump         contacts all local ${{look}} ${{dump}}.contacts {columns}",
        f'dump_modify  contacts every/time v_next_look first yes skip v_{skip} format line "{numbers}"<append>',
    ]


def header(names: list[str], scene: Scene) -> str:
    """Return the comment at the top of a deck: the thermo columns and the limits above which the run is invalid."""
    limits = [
        f"#   {GUARDS[name].column} is above {GUARDS[name].limit_in(scene):.4g}: "
        + GUARDS[name].meaning.rpartition(": ")[2]
        + (f"; {CONTACTS} then holds each contact" if GUARDS[name] is SLIP else "")
        for name in names
    ]
    top = "# A line of the thermo table holds extremes since the one before. The run is invalid, from v_NAME_at on, if"
    return "\n".join([top, *limits]) if limits else ""


def first_decks(table: Mapping[str, object]) -> bool:
    """Return whether a thermo table is of a first deck of release 0.1.0, which looked only when it wrote a line."""
    return bool(table) and not any(column.endswith("_at") for column in table)


# --- results of a run ------------------------------------------------------------------------------------------------


def measured(name: str, table: dict[str, NDArray[np.float64]], scene: Scene, folder: Path) -> Measured:
    """Return the result of a guard in a run.

    Parameters
    ----------
    name : str
        Key of `GUARDS`.
    table : dict
        Thermo table of the run by column.
    scene : Scene
        Scene with every "auto" decided.
    folder : Path
        Run folder, which may hold single contacts if the table only bounds the value.
    """
    guard = GUARDS[name]
    limit = guard.limit_in(scene)
    # A run whose log lacks a column fails by that, or has not come so far
    value = np.abs(table.get(guard.column, np.empty(0)))
    at = table.get(f"{guard.column}_at", np.full(len(value), NEVER))
    if len(at) != len(value):
        value = at = np.empty(0)
    bound = float(np.max(value, initial=0.0)) if np.isfinite(value).all() else float("nan")
    triggered = ~((value <= limit) & (at >= NEVER))  # a nan triggers the guard too
    first = None
    if triggered.any():
        first = float(np.min(at[triggered]))
        first = first if first < NEVER else float(table["v_tau"][np.argmax(triggered)])
    if not (guard.per_contact(scene) and (folder / CONTACTS).is_file()):
        return Measured(bound, first, bound)
    looks = judged_contacts(folder / CONTACTS, scene, float(table.get("v_mu", [np.nan])[0]))
    if guard is SLIP:
        ratios = [(step, look.slip) for step, look in looks] if first is not None else []
        worst = max((ratio for _, ratio in ratios), default=bound if first is None else 0.0)
        return Measured(
            worst, next((step * scene.time.step for step, ratio in ratios if not ratio <= limit), None), bound
        )
    nearly = next((step * scene.time.step for step, look in looks if look.overlap < nearly_open(scene)), None)
    known = [tau for tau in (first, nearly) if tau is not None]
    return Measured(max(bound, float(nearly is not None)), min(known, default=None), bound)


class Look(NamedTuple):
    """The contacts at one look: the largest ratio of shear to sliding force of one, and the smallest overlap, in Δ0."""

    slip: float
    overlap: float


def nearly_open(scene: Scene) -> float:
    """Return the overlap, in Δ0, below which a contact may open between two looks; in JKR's law it is negative."""
    hold = scene.sphere.pull_off_distance / scene.sphere.static_overlap
    return BETWEEN - hold * (1 - BETWEEN)


def judged_contacts(path: Path, scene: Scene, friction: float) -> Iterator[tuple[int, Look]]:
    """Yield step and the contacts, each judged by its own radii and materials, look by look.

        slip F_t / (μ (F + (F + F0) (δ/Δ0)^{3/2})),    in the JKR law F_t / (μ (f_N(δ) + 2F))

    With dashpots, LAMMPS's Hertz contacts slide at μ times the normal force with its dashpot. The ratio is infinite if
    a contact without adhesion has just opened, or its dashpot pulls.
    """
    sphere, units, at_rest = scene.sphere, units_for(scene.sphere.radius), crystal_of(scene)
    radius = at_rest.atoms.arrays["radius"] * sphere.radius
    how = Reading.of(scene)
    for step, _, contacts in read_snapshots(path):
        *others, distance, shear = (contacts[:, :-1] if how.whole else contacts).T
        # The contacts of equal spheres are all alike, and only those of others are written with their spheres
        i, j = (end.astype(int) - 1 for end in others) if others else np.zeros((2, len(shear)), dtype=int)
        law = law_between(at_rest.atoms, at_rest.materials, i, j)
        overlap = np.maximum(radius[i] + radius[j] - distance / units.number(1.0, length=1), law.pull_off_overlap)
        force = contacts[:, -1] if how.whole else units.number(law.sliding_force(overlap), mass=1, length=1, time=-2)
        sliding = friction * np.maximum(force, 0.0)
        ratio = np.divide(shear, sliding, out=np.full(len(shear), np.inf), where=sliding > 0)
        least = float(np.min(overlap, initial=np.inf)) / sphere.static_overlap
        yield step, Look(float(np.max(ratio, initial=0.0)), least)
