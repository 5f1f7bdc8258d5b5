"""Selection of effects: the list of all effects, and the choice for a scene."""

from collections.abc import Iterable
from functools import partial

from granular_lmp.crystal.mode import Mode, Physics
from granular_lmp.effects.adhesion import ADHESION
from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.contact_opening import CONTACT_OPENING
from granular_lmp.effects.creep import CREEP
from granular_lmp.effects.damping import DAMPING
from granular_lmp.effects.deep_overlap import DEEP_OVERLAP, LONG_STEP
from granular_lmp.effects.effect import Chosen, Effect
from granular_lmp.effects.guard import Guard, Prepared
from granular_lmp.effects.late_parting import LATE_PARTING
from granular_lmp.effects.quiet_ends import QUIET_ENDS
from granular_lmp.effects.rolling import ROLLING
from granular_lmp.effects.rotation import ROTATION
from granular_lmp.effects.shear import SHEAR
from granular_lmp.effects.sliding import SLIDING
from granular_lmp.effects.tracking import TRACKING
from granular_lmp.effects.twisting import TWISTING
from granular_lmp.effects.walls import WALLS
from granular_lmp.effects.width import WIDTH
from granular_lmp.errors import SceneError
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.schema import AUTO

# each effect after those that it needs
EFFECTS: tuple[Effect, ...] = (
    *(ADHESION, SHEAR, ROTATION, TRACKING, DAMPING, SLIDING, CONTACT_OPENING),
    *(ROLLING, TWISTING, LATE_PARTING, WALLS, QUIET_ENDS, WIDTH),
)
# Limits that can fail a run but are not effects of a deck: of the model of spheres that meet, and of the time of a wave
LIMITS: tuple[Effect, ...] = (DEEP_OVERLAP, LONG_STEP, CREEP)


def of(scene: Scene) -> tuple[Effect, ...]:
    """Return the effects and limits that scenes of this kind have."""
    every = (*EFFECTS, *LIMITS)
    if scene.held_at_rest:
        return tuple(each for each in every if each.called_for and each.concerns(scene))
    return tuple(each.among_meeting() for each in every if each.meeting)


def guards() -> dict[str, Guard]:
    """Return the guards of all effects and limits by title."""
    every = (*EFFECTS, *LIMITS)
    of_meeting = (each.meeting.guards for each in every if each.meeting)
    return {guard.title: guard for each in (*(effect.guards for effect in every), *of_meeting) for guard in each}


def select(scene: Scene) -> list[Chosen]:
    """Return the effects of a scene, each on or off, every effect after those that it needs.

    Raises
    ------
    SceneError
        If an effect is forced on without the effect or coefficient that it needs, if adhesive contacts have a
        restitution, which LAMMPS lacks, or if contacts slide at any friction.
    """
    on: dict[str, bool] = {}
    chosen = []
    modes: dict[Physics, Mode] = {}
    slips: dict[tuple[object, ...], float] = {}
    effects = of(scene)
    for effect in effects:
        rule = effect.called_for
        assert rule is not None  # as in `of`
        case, possible = Case(scene, dict(on), modes, slips), on.get(effect.needs, True)
        needed = Finding(False, 0.0, f"{effect.name} needs {effect.needs}, which is off")
        finding = rule(case) if possible else needed
        on[effect.name] = _is_on(effect, scene, finding.called_for, possible)
        lost = partial(effect.loss, case) if finding.called_for else _nothing
        guard = effect.guard_name(scene, on)
        decided = (effect.name, effect.key, on[effect.name], *finding)
        chosen.append(Chosen(*decided, guard=guard, cost=effect.cost, lost=lost))
    complete = Case(scene, on, modes, slips)
    for effect in effects:
        reason = effect.refuse(complete)
        if reason:
            raise SceneError(reason, because="physics")
    return chosen


def _nothing() -> str:
    return "nothing"


def _is_on(effect: Effect, scene: Scene, called_for: bool, possible: bool) -> bool:
    wanted = effect.wanted(scene)
    if wanted is True and not possible:
        raise SceneError(f"effects.{effect.name} = true: needs effects.{effect.needs}, which is off", because="physics")
    if effect.required(scene):
        return possible
    return possible and called_for if wanted == AUTO else bool(wanted)


def lines(block: str, problem: Prepared) -> list[str]:
    """Return the lines of the effects for a block of the deck, in the order of the effects."""
    text: list[str] = []
    for effect in EFFECTS:
        if problem.on.get(effect.needs, True):
            written = effect.lines if problem.on[effect.name] else effect.lines_off
            text += written[block](problem) if block in written else []
    return text


def order(scene: Scene) -> int:
    """Return the order in the time step of the error of LAMMPS: 2 for velocity Verlet, or less with some effects."""
    acting = (each for each in of(scene) if not each.forces or each.wanted(scene) is True)
    return min((each.order(scene) for each in acting), default=2)


def with_all(scene: Scene) -> Scene:
    """Return the scene with every effect on that neither changes its lattice nor needs a coefficient.

    Raises
    ------
    SceneError
        If the scene has no wave, which determines the size of the effects.
    """
    if scene.wave is None:
        raise SceneError("--all-effects: is for the scene of a wave; must be left out, and effects.friction declared")
    return scene.with_values({effect.key: True for effect in EFFECTS if effect.declared is None and effect.in_all})


def remarks(scene: Scene) -> list[str]:
    """Return a sentence for each effect that is on although the scene switches it off."""
    return [
        f"{effect.key} = false is read as true: {reason}"
        for effect in of(scene)
        if effect.wanted(scene) is False and (reason := effect.required(scene))
    ]


def warnings(chosen: Iterable[Chosen]) -> list[str]:
    """Return a warning for each effect that is forced off although the scene needs it, with the error it causes."""
    return [
        f"{effect.switch} is off, but {effect.finding}; without it {effect.loss}"
        for effect in chosen
        if effect.called_for and not effect.on and effect.loss != "nothing"
    ]
