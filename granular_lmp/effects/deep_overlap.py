"""Deep overlaps and long steps: the guards of spheres that meet, whose contacts have no overlap at rest.

The largest force F of a contact makes no overlap above (F/A)^{2/3} of the softest pair of spheres, and no contact is
stiffer than one of the stiffest pair, or with a wall, at that overlap.
"""

from math import inf

from granular_lmp.crystal.scale import LARGEST_OVERLAP_RATIO
from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.effect import AmongMeeting, Effect
from granular_lmp.effects.guard import Guard, Prepared
from granular_lmp.rest.scene import Scene
from granular_lmp.rest.step_rules import LONGEST_STEP


def deepest(problem: Prepared) -> list[str]:
    """Return the lines of v_deepest, the deepest overlap of spheres and walls in units of the scene."""
    softest, walls = float(problem.rest.coefficients.min(initial=1.0)), problem.rest.planes
    pushes = hertz_force("(c_largest>0)*c_largest", problem)
    length = problem.units.number(problem.scene.scale.length, length=1)  # ℓ, and m ℓ/t0² too
    lines = [
        "compute      contact all pair/local force",
        "compute      largest all reduce max c_contact inputs local",
        f"variable     depth equal ({pushes}/{softest * length!r})^(2/3)  # of spheres, in l",
    ]
    for name, place in walls.items():
        beyond = f"{place!r}-{name[0]}+radius" if name.endswith("lo") else f"{name[0]}+radius-({place!r})"
        lines += [
            f"variable     beyond_{name} atom ({beyond})/{length!r}",
            f"compute      in_{name} all reduce max v_beyond_{name}",
        ]
    depth = "v_depth"
    for name in walls:
        depth = f"ternary(c_in_{name}>{depth},c_in_{name},{depth})"
    return [*lines, f"variable     deepest equal {depth}"]


def hertz_force(force: str, problem: Prepared) -> str:
    """Return the force without adhesion whose overlap is that of a force with the strongest adhesion, or a bound."""
    strongest = max(problem.rest.materials, key=lambda each: each.pull_off_force)
    if not (pull := problem.units.number(strongest.pull_off_force, mass=1, length=1, time=-2)):
        return force
    return strongest.contact_law.hertz_force(force, repr(pull))


def overlap(problem: Prepared) -> list[str]:
    """Return the lines of the deepest overlap in diameters."""
    smallest = float(problem.rest.atoms.arrays["radius"].min())
    length = problem.units.number(problem.scene.scale.length, length=1)
    return [
        *deepest(problem),
        f"variable     overlap equal v_deepest*{length / (2 * smallest)!r}  # in diameters of the smallest sphere",
    ]


def omega_dt(problem: Prepared) -> list[str]:
    """Return the lines of the step in units of 1/ω of the stiffest contact."""
    return [
        *deepest(problem),
        f"variable     omega_dt equal v_step*sqrt({problem.rest.square_rate!r}*sqrt(v_deepest))",
    ]


TOO_DEEP = Guard(
    title="largest_overlap",
    name="overlap",
    lines=overlap,
    limit=LARGEST_OVERLAP_RATIO,
    meaning="of the diameter is the largest overlap, for which Hertz's law does not hold",
    cure="set a smaller striker.velocity or packing.contact_force",
    heading="the largest overlap over the smallest diameter, is above {limit}: too deep",
)
TOO_LONG = Guard(
    title="step_in_contact",
    name="omega_dt",
    lines=omega_dt,
    limit=LONGEST_STEP,
    meaning="is the time step times the frequency of the stiffest contact, which is too long for a collision",
    cure="set a shorter time.timestep, or a smaller time.tolerance",
    heading="the step times the frequency of the stiffest contact, is above {limit}: too long",
)


def small_overlaps(case: Case) -> Finding:
    return Finding(False, inf, "Hertz's law is only valid for small overlaps")


def chosen_step(case: Case) -> Finding:
    return Finding(False, *case.scene.time.clock.chosen)


def never(scene: Scene) -> bool:
    return False


def loss(case: Case) -> str:
    return "nothing"


DEEP_OVERLAP = Effect(
    "deep_overlap",
    None,
    meeting=AmongMeeting(small_overlaps, guards=(TOO_DEEP,)),
    cost="1.00",
    loss=loss,
    switch="striker",
    declared=never,
    in_all=False,
)
LONG_STEP = Effect(
    "long_step",
    None,
    meeting=AmongMeeting(chosen_step, guards=(TOO_LONG,)),
    cost="1.00",
    loss=loss,
    switch="time.timestep",
    declared=never,
    in_all=False,
)
