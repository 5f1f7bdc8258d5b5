"""Sliding: a contact slides where its shear force reaches the Coulomb limit μ(f_N + 2F).

If the effect is off, the deck has a friction at which no contact slides.
"""

from math import inf, isfinite

from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.effect import AmongMeeting, Effect
from granular_lmp.effects.guard import Guard, Prepared
from granular_lmp.effects.reading import Reading, between
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.schema import AUTO


def variables(problem: Prepared) -> list[str]:
    """Return the variable of the friction; for spheres that meet the law contains the number."""
    if problem.units.own:
        return []
    return [f"variable friction index {problem.scene.effects.friction!r}  # Coulomb friction: contacts may slide"]


def variables_off(problem: Prepared) -> list[str]:
    if problem.units.own:
        return []
    case = Case(problem.scene, problem.on)
    amplitude = f"(v_amplitude+{case.struck_amplitude!r})" if problem.scene.struck else "v_amplitude"
    if problem.scene.wave is None:
        amplitude = repr(case.largest_amplitude)
    return [
        f"variable friction index $({case.no_slip_friction!r}*{amplitude}:%.17g)"
        "  # no sliding; much more would freeze the shear"
    ]


def measured(problem: Prepared) -> list[str]:
    """Return the lines of the variable ``slip``, the largest ratio of shear force to sliding force."""
    how, friction = Reading.of(problem), judged_friction(problem)
    pairs = f"c_extreme[2]/({friction}*{sliding_force(how)})"
    if not how.walls:
        return [
            f"variable     slip equal {pairs}  # largest shear force over the smallest sliding force: an upper bound"
        ]
    lines, largest = [f"variable     rub equal {pairs}"], "v_rub"
    for each in how.walls:
        name = f"rub_{each.name}"
        lines.append(f"variable     {name} equal {each.slip(friction)}")
        largest = f"ternary(v_{name}>{largest},v_{name},{largest})"
    return [*lines, f"variable     slip equal {largest}"]


def judged_friction(problem: Prepared) -> str:
    """Return the friction that limits slips, as an expression of LAMMPS.

    It is the smaller of two: that of the deck, at which contacts slide in the run, and that of the spheres, if
    declared.
    """
    given = problem.scene.effects.friction
    if given == AUTO:
        return "${friction}"
    return repr(given) if problem.on["sliding"] else f"ternary(v_friction<{given!r},v_friction,{given!r})"


GUARD = Guard(
    title="largest_slip",
    name="slip",
    lines=measured,
    limit=1 - 1e-9,  # a sliding contact has exactly the sliding force
    hides=True,
    meaning="of the sliding force: contacts may slide in reality, but not in the model",
    cure="set effects.sliding = true with effects.friction = the coefficient of the spheres, or take a smaller "
    "wave.amplitude or a slower striker",
    of_contacts=True,
    per_contact=lambda scene: not (scene.wall or scene.rigid),  # for contacts with a wall the bound decides
)


def sliding_force(how: Reading) -> str:
    """Return a lower bound of the sliding force of two spheres over μ in LAMMPS syntax; exact for the DMT law.

    It belongs to the smallest overlap, or to the smallest normal force if the `whole` force limits sliding.
    """
    if how.whole:
        return f"(1e-9*{how.holding_force!r}+(c_weakest>0)*c_weakest)"
    above = how.law.above_pull_off(between(how), how.sphere.contact_force, how.holding_force)
    return f"({how.adhesive_force!r}+{above})"


def called_for(case: Case) -> Finding:
    ratio = case.largest_slip()
    if ratio == inf and case.scene.effects.friction != AUTO:
        damped = case.on.get("damping") and not case.on.get("adhesion")
        opened = "dashpots pull contacts, which then have" if damped else "contacts open, and an open contact has"
        return Finding(True, ratio, f"{opened} no shear force (friction {case.friction:g})")
    if case.scene.effects.friction == AUTO:
        return Finding(
            False, ratio, f"the largest shear force is {{}} of the sliding force (friction {case.friction:.3g})"
        )
    return Finding(
        ratio >= 1, ratio, f"the largest shear force is {{}} of the sliding force (friction {case.friction:g})"
    )


def of_meeting(case: Case) -> Finding:
    return Finding(True, float(case.scene.effects.friction), "friction is {}")


def loss(case: Case) -> str:
    ratio = case.largest_slip()
    return (
        f"shear forces grow to {ratio:.3g} of the sliding force" if ratio < inf else "open contacts have shear forces"
    )


def refuse(case: Case) -> str:
    if case.scene.effects.friction != AUTO:
        return ""
    if case.on["sliding"]:
        return "effects.sliding = true: needs effects.friction, the Coulomb coefficient, a number in (0, 1e4]"
    if case.on["shear"] and not isfinite(case.no_slip_friction):
        return (
            'effects.friction = "auto": give a number in (0, 1e4]: no force presses the weakest contact of this '
            "crystal together"
        )
    if case.on["shear"] and case.largest_slip() >= 1:
        motion, weaker = ("wave", "a smaller wave.amplitude") if case.scene.wave else ("strike", "a slower striker")
        cause = (
            f"in a {motion} this strong, contacts slide before they open"
            if not case.scene.imperfections
            else f"unequal or missing spheres ({case.scene.imperfections}) make a contact so weak that it slides in "
            f"this {motion}; {weaker} or less disorder helps too"
        )
        return f'effects.friction = "auto": give a number in (0, 1e4]: {cause}'
    return ""


def order(scene: Scene) -> int:
    """Return 0: a contact begins to slide at any phase of a step."""
    return 0


SLIDING = Effect(
    "sliding",
    called_for,
    cost="1.00",
    loss=loss,
    meeting=AmongMeeting(of_meeting),
    needs="shear",
    lines={"variables": variables},
    lines_off={"variables": variables_off},
    refuse=refuse,
    order=order,
    guards=(GUARD,),
    always=True,
    in_all=False,
    recorded=True,
)
