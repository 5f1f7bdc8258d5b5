"""The effect: one record per effect.

An effect decides by a number whether a scene calls for it. It writes its lines into the deck, adds its term to the
linear problem, and names the guard that looks whether it occurs, its cost, and the loss without it. Each of the
other files here defines one effect; `granular_lmp.effects.selection` lists them and chooses. A theory covers an effect
only if its line in `granular_analysis.theory.catalogue` names it.
"""

from collections.abc import Callable, Mapping
from dataclasses import field, replace
from typing import TypedDict

from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.guard import Guard, Lines
from granular_lmp.frozen import dataclass
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.schema import AUTO, Auto


class LawPart(TypedDict, total=False):
    """Arguments of `granular_lmp.lammps.contact.model` that effects set."""

    normal: str
    shear: str
    friction: float | str
    damping: float
    restitution: float
    shear_damping: float
    late_parting: bool
    rolling: str
    twisting: str


def _nothing_refused(case: Case) -> str:
    return ""


def _nothing_lost(case: Case) -> str:
    return "nothing"


def _not_required(scene: Scene) -> str:
    return ""


def _no_law(scene: Scene, on: bool) -> LawPart:
    return {}


def _second_order(scene: Scene) -> int:
    return 2


def _every(scene: Scene) -> bool:
    return True


@dataclass(frozen=True)
class AmongMeeting:
    """Rule, order and guards of an effect among spheres that meet, which nothing holds at rest.

    Attributes
    ----------
    called_for : callable
        Rule, Case → Finding.
    order : callable
        Scene → order of LAMMPS's error in the time step: 2, or 1.
    guards : tuple of Guard
        Guard that is always in the deck.
    """

    called_for: Callable[[Case], Finding]
    order: Callable[[Scene], int] = _second_order
    guards: tuple[Guard, ...] = ()


@dataclass(frozen=True)
class Effect:
    """One effect.

    Attributes
    ----------
    name : str
        Name, and its key in ``[effects]`` unless `switch` names another.
    called_for : callable, optional
        Rule that decides whether a crystal at rest under load calls for the effect, Case → Finding; None if the effect
        cannot occur there.
    meeting : AmongMeeting, optional
        The effect among spheres that meet, which nothing holds at rest; None if it cannot occur there.
    cost : str
        Cost in time as a factor, measured (page Verification), or the word for a cost that depends on the scene.
    loss : callable
        Description of the loss without the effect, Case → half a sentence.
    needs : str
        Name of another effect without which this one is off.
    lines, lines_off : mapping
        Lines of blocks of the deck (`granular_lmp.lammps.deck`), name of the block → function of the problem, while the
        effect is on, and while it is off but the effect that it needs is on.
    law : callable
        Part of the contact law, (Scene, on) → arguments of `granular_lmp.lammps.contact.model`.
    required : callable
        Reason why the effect is on even where a scene switches it off, Scene → half a sentence, or "".
    refuse : callable
        Reason why the choice is not possible, Case → sentence, or "" if it is possible.
    order : callable
        Scene → order of LAMMPS's error in the time step while the effect is on: 2, 1, or 0 if the error is no series.
    concerns : callable
        Scene → True if the effect is one of such scenes.
    guards : tuple of Guard
        Guards that look whether the effect occurs, of which the first that is of a scene looks there.
    always : bool
        True if the guard also measures, without judging, while the effect is on.
    recorded : bool
        True if the record of contacts holds all forces and torques beside the effect.
    in_all : bool
        True if ``--all-effects`` switches the effect on.
    switch : str
        Key that forces the effect, if it is not a key of ``[effects]``.
    declared : callable, optional
        Scene → True if the effect is on, for an effect with a `switch`.
    forces : bool
        True if a scene may force the effect on; else its true is read as "auto".
    """

    name: str
    called_for: Callable[[Case], Finding] | None
    cost: str
    loss: Callable[[Case], str]
    meeting: AmongMeeting | None = None
    forces: bool = True
    needs: str = ""
    lines: Mapping[str, Lines] = field(default_factory=dict)
    lines_off: Mapping[str, Lines] = field(default_factory=dict)
    law: Callable[[Scene, bool], LawPart] = _no_law
    required: Callable[[Scene], str] = _not_required
    refuse: Callable[[Case], str] = _nothing_refused
    order: Callable[[Scene], int] = _second_order
    concerns: Callable[[Scene], bool] = _every
    guards: tuple[Guard, ...] = ()
    always: bool = False
    recorded: bool = False
    in_all: bool = True
    switch: str = ""
    declared: Callable[[Scene], bool] | None = None

    @property
    def key(self) -> str:
        """Key of the scene that forces the effect."""
        return self.switch or f"effects.{self.name}"

    def among_meeting(self) -> "Effect":
        """Return the effect among spheres that meet: nothing is lost or refused there."""
        assert self.meeting is not None
        return replace(
            self,
            called_for=self.meeting.called_for,
            order=self.meeting.order,
            guards=self.meeting.guards,
            loss=_nothing_lost,
            refuse=_nothing_refused,
            required=_not_required,
            concerns=_every,
            always=True,
            forces=False,
        )

    def wanted(self, scene: Scene) -> bool | Auto:
        """Return whether a scene forces the effect on or off, or "auto"."""
        if self.declared:
            return self.declared(scene)
        wanted: bool | Auto = getattr(scene.effects, self.name)
        return AUTO if wanted is True and not self.forces else wanted

    def guard_name(self, scene: Scene, on: Mapping[str, bool]) -> str:
        """Return the title of the guard in the deck of a scene with these effects on, or "" if no guard is needed."""
        guarded = on.get(self.needs, True) and (self.always or not on[self.name])
        return next((each.title for each in self.guards if guarded and each.where(scene)), "")


@dataclass(frozen=True)
class Chosen:
    """One effect of a scene, decided.

    Attributes
    ----------
    name, switch : str
        Name of the effect, and the key of the scene that forces it.
    on, called_for : bool
        True if the effect is in the deck, and if the scene calls for it.
    number, reason : float, str
        Number behind `called_for`, and a sentence that has the number at {}, if it has one.
    guard : str
        Title of the guard in the deck, or "" without one.
    cost : str
        Cost in time, measured (page Verification).
    lost : callable
        Function that finds `loss`, which takes as long as all else and is seldom asked for.
    """

    name: str
    switch: str
    on: bool
    called_for: bool
    number: float
    reason: str
    guard: str
    cost: str
    lost: Callable[[], str] = field(repr=False, compare=False)

    @property
    def loss(self) -> str:
        """Loss without the effect; "nothing" if the scene does not call for it."""
        return self.lost()

    @property
    def finding(self) -> str:
        """The sentence with the number in it."""
        return self.reason.replace("{}", f"{self.number:.4g}")

    @property
    def judged(self) -> bool:
        """True if the guard fails the run: the effect is off and the scene does not call for it."""
        return not self.on and not self.called_for
