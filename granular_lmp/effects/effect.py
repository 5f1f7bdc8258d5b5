"""Record of an effect.

An effect decides by a number whether a scene needs it. It writes its lines into the deck, adds its term to the linear
problem, and has a guard that detects it, a cost, and the loss without it. Each of the other files here defines one
effect; `granular_lmp.effects.selection` lists and chooses them. A theory covers an effect only if its line in
`granular_analysis.theory.catalogue` names the effect.
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
    """Rule, order and guards of an effect for spheres that meet, which nothing holds at rest.

    Attributes
    ----------
    called_for : callable
        Rule, Case → Finding.
    order : callable
        Scene → order in the time step of the error of LAMMPS: 2, or 1.
    guards : tuple of Guard
        Guards that are always in the deck.
    """

    called_for: Callable[[Case], Finding]
    order: Callable[[Scene], int] = _second_order
    guards: tuple[Guard, ...] = ()


@dataclass(frozen=True)
class Effect:
    """Effect of a deck.

    Attributes
    ----------
    name : str
        Name, and its key in ``[effects]`` unless `switch` names another.
    called_for : callable, optional
        Rule that decides whether a crystal at rest under load needs the effect, Case → Finding; None if the effect
        cannot occur there.
    meeting : AmongMeeting, optional
        The effect for spheres that meet, which nothing holds at rest; None if it cannot occur there.
    cost : str
        Measured factor in computing time (page Verification), or a word if it depends on the scene.
    loss : callable
        Description of the loss without the effect, Case → phrase.
    needs : str
        Name of another effect without which this effect is off.
    lines, lines_off : mapping
        Lines for blocks of the deck (`granular_lmp.lammps.deck`), name of the block → function of the problem: if the
        effect is on, and if it is off while the effect that it needs is on.
    law : callable
        Part of the contact law, (Scene, on) → arguments of `granular_lmp.lammps.contact.model`.
    required : callable
        Reason why the effect is on although a scene switches it off, Scene → phrase, or "".
    refuse : callable
        Reason why the choice is not possible, Case → sentence, or "" if it is possible.
    order : callable
        Scene → order in the time step of the error of LAMMPS while the effect is on: 2, 1, or 0 if the error has no
        expansion.
    concerns : callable
        Scene → True if such scenes have the effect.
    guards : tuple of Guard
        Guards that detect the effect; a scene uses the first one that applies to it.
    always : bool
        True if the guard also measures, without a verdict, while the effect is on.
    recorded : bool
        True if the record of contacts holds all forces and torques while the effect is on.
    in_all : bool
        True if ``--all-effects`` switches the effect on.
    switch : str
        Key that forces the effect, if it is not a key of ``[effects]``.
    declared : callable, optional
        Scene → True if the effect is on, for an effect with a `switch`.
    forces : bool
        True if a scene may force the effect on; otherwise true is read as "auto".
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
        """Return the effect for spheres that meet, for which nothing is lost or refused."""
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
        """Return the title of the guard in the deck of a scene with these active effects; "" if it needs no guard."""
        guarded = on.get(self.needs, True) and (self.always or not on[self.name])
        return next((each.title for each in self.guards if guarded and each.where(scene)), "")


@dataclass(frozen=True)
class Chosen:
    """Decided effect of a scene.

    Attributes
    ----------
    name, switch : str
        Name of the effect, and the key of the scene that forces it.
    on, called_for : bool
        True if the effect is in the deck; true if the scene needs it.
    number, reason : float, str
        Number behind `called_for`, and a sentence that may have a place {} for it.
    guard : str
        Title of the guard in the deck, or "" if there is none.
    cost : str
        Cost in time, measured (page Verification).
    lost : callable
        Function that computes `loss`, which is slow and rarely needed.
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
        """Loss without the effect; "nothing" if the scene does not need it."""
        return self.lost()

    @property
    def finding(self) -> str:
        """Sentence with the number filled in."""
        return self.reason.replace("{}", f"{self.number:.4g}")

    @property
    def judged(self) -> bool:
        """True if the guard can fail the run: the effect is off, and the scene does not need it."""
        return not self.on and not self.called_for
