"""What an effect is: one record, made once in a file of its own, and the case that its functions judge.

An effect says with a number whether a scene calls for it, writes its lines into the deck, adds its term to the linear
problem, names the guard that proves its absence harmless, and says what it costs and what is lost without it. The
effects are the other files of this room, a file each; `granular_lmp.effects.selection` lists them and chooses. No
theory holds an effect until its line in `analysis.theory.catalogue` says so.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import exp, hypot, inf, isfinite
from typing import Any, NamedTuple

import numpy as np

from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.modes import Mode, Physics, contact_stretches, decay_rate, row_stretches
from granular_lmp.effects.guard import Guard
from granular_lmp.scene.linear import mode_of
from granular_lmp.scene.scene import Scene
from granular_lmp.scene.schema import AUTO

# μ = 5a (adhesion) to 10a (compression) keeps F_t under 0.6 of the sliding force for every mode. Much larger is wrong
# too: LAMMPS skips turning the shear history with the contact while its normal part is below 1e-10 of the sliding
# force, which then freezes it.
FRICTION_PER_AMPLITUDE = 10.0
NOTHING = 1e-12  # of a number of order 1 that a symmetry makes zero


class Finding(NamedTuple):
    """The verdict of a rule: is the effect called for, the number behind it, the sentence that follows the number."""

    called_for: bool
    number: float
    reason: str


@dataclass(frozen=True)
class Case:
    """A scene with the effects that have been decided so far."""

    scene: Scene
    on: Mapping[str, bool] = field(default_factory=dict)

    @cached_property
    def mode(self) -> Mode:
        """The mode of the lattice with these effects; those that are not decided yet are on."""
        shear = self.on.get("shear", True)
        return self.mode_with(Physics(shear, self.on.get("rotation", shear), self.rolling))

    @property
    def rolling(self) -> float:
        """Stiffness of the contacts against rolling, N/m; 0 where they roll freely."""
        declared = self.scene.effects.rolling is not False
        return self.scene.effects.rolling_stiffness if self.on.get("rolling", declared) else 0.0

    def mode_with(self, physics: Physics) -> Mode:
        """The mode of the scene's wave in a lattice with other physics."""
        return mode_of(self.scene, physics)

    @cached_property
    def stretches(self) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes of the normal and the shear displacement of the contacts, in Δ0.

        Of a driven row also those to the next row, as if that stood still: more than the waves that it sends out do.
        """
        lattice, sphere = unit_lattice(self.scene.sphere), self.scene.sphere
        parts = [contact_stretches(lattice, sphere, self.mode)]
        if self.scene.wave.form == "driven":
            along = self.mode.name == "L"
            parts.append(row_stretches(lattice, 0.0 if along else 1.0, 1.0 if along else 0.0))
        normal, shear = (np.concatenate(each) * self.scene.wave.amplitude for each in zip(*parts, strict=True))
        return normal, shear

    @property
    def no_slip_friction(self) -> float:
        """Friction coefficient per amplitude a at which nothing slides: 10/(1 + s), s the share of adhesion.

        The sliding force at rest is μ(AΔ0^{3/2} + F), and 1 + s that over the force that holds the contact. Dashpots
        push along with the springs: as much more friction as `shear_stiffness` is above κ.
        """
        return (
            FRICTION_PER_AMPLITUDE
            / (1 + self.adhesive_share)
            * self.shear_stiffness
            / self.scene.sphere.stiffness_ratio
        )

    @property
    def shear_stiffness(self) -> float:
        """|κ + 2(κ+3) i c Ω|, spring and dashpot c of a sheared contact, in k1 (k1 t0²/m = 1/(2(κ+3)))."""
        return hypot(self.scene.sphere.stiffness_ratio, self.dashpot)

    @property
    def dashpot(self) -> float:
        """D = 2(κ+3) c Ω: what the dashpot c of a sheared contact pushes with, in k1."""
        viscosity = self.viscosity if self.on.get("damping", True) else 0.0
        return 2 * (self.scene.sphere.stiffness_ratio + 3) * viscosity * self.mode.frequency

    @property
    def adhesive_share(self) -> float:
        """s = F/(F + F0): how much of the force that holds the contacts at rest is adhesion."""
        return self.scene.sphere.pull_off_force / self.scene.sphere.holding_force

    @property
    def friction(self) -> float:
        """The scene's friction coefficient, or that at which nothing slides."""
        given = self.scene.effects.friction
        return self.no_slip_friction * self.scene.wave.amplitude if given == AUTO else float(given)

    @property
    def viscosity(self) -> float:
        """Dashpot of a contact at rest, in m/t0."""
        effects, sphere = self.scene.effects, self.scene.sphere
        dashpot = effects.viscosity or sphere.restitution_viscosity(effects.restitution)
        return dashpot * sphere.time_scale / sphere.mass

    def largest_slip(self) -> float:
        """Largest shear force of the wave over the sliding force of the same contact at the same time.

        With δ = Δ0(1−x), x = n cos ϑ, and a dashpot D that pushes t D sin ϑ along with the spring, in units of the
        force that holds a contact at rest, (2/3) k1 Δ0:

            max over contacts and phases ϑ of 1.5 |t| |κ (1−x)^{1/2} cos ϑ − D sin ϑ| / (μ [(1−x)^{3/2} + s])

        Infinite where contacts without adhesion open: they slide before.
        """
        phase = np.linspace(0, 2 * np.pi, 721)[:, None]
        normal, shear = self.stretches
        overlap = np.maximum(1 - normal * np.cos(phase), 0.0)
        kappa = self.scene.sphere.stiffness_ratio
        push = kappa * np.sqrt(overlap) * np.cos(phase) - self.dashpot * np.sin(phase)
        force = np.where(overlap > 0, 1.5 * np.abs(shear * push), 0.0)
        limit = self.friction * (overlap**1.5 + self.adhesive_share)
        if np.any((limit == 0) & (np.abs(shear * np.cos(phase)) > NOTHING)):
            return inf
        return float(np.max(np.divide(force, limit, out=np.zeros_like(force), where=limit > 0)))

    @property
    def wave_words(self) -> str:
        """The wave with its article: "a TR wave"."""
        return f"{'an' if self.mode.name in ('L', 'RT') else 'a'} {self.mode.name} wave"

    @property
    def decay_rate(self) -> float:
        """Rate of the wave's amplitude by the dashpots of the contacts, per τ."""
        lattice, sphere = unit_lattice(self.scene.sphere), self.scene.sphere
        return decay_rate(lattice, sphere, self.mode, self.viscosity, shear=self.on.get("shear", True))

    @property
    def amplitude_left(self) -> float:
        """Part of the wave's amplitude that the dashpots leave at the end of the run."""
        return exp(-self.decay_rate * self.scene.time.duration)

    def frequency_shift(self, physics: Physics) -> str:
        """Return in words what happens to the frequency of the wave in a lattice with less physics."""
        if self.scene.wave.mode == "RT":
            return "there is no RT wave"
        full, less = self.mode_with(Physics(rolling=self.rolling)).frequency, self.mode_with(physics).frequency
        return f"the frequency is {less:.4g} per tau instead of {full:.4g}: {abs(less / full - 1):.2%} off"


def _nothing_refused(case: Case) -> str:
    return ""


def _no_law(scene: Scene, on: bool) -> Mapping[str, Any]:
    return {}


def _second_order(scene: Scene) -> bool:
    return False


@dataclass(frozen=True)
class Effect:
    """One effect.

    Attributes
    ----------
    name : str
        Its key in ``[effects]``, unless `switch` says otherwise.
    called_for : callable
        The rule: Case → Finding.
    cost : str
        What it costs in time, measured (docs/effects.md).
    loss : callable
        Case → what is lost without it, half a sentence.
    needs : str
        The effect without which it is not there.
    lines, lines_off : mapping
        What it writes into the slots of the deck (`granular_lmp.lammps.deck`) when it is on, and when it is off though
        what it needs is on. ``<name>`` stands for a number of the scene.
    law : callable
        (Scene, on) → arguments of `granular_lmp.lammps.contact.model`: its part of the contact law.
    refuse : callable
        Case → why it cannot be as it is chosen; "" if it can.
    first_order : callable
        Scene → is LAMMPS's error of first order in the time step while it is on.
    guard : Guard, optional
        What proves that it stayed silent.
    always : bool
        Whether the guard measures, without judging, also while the effect is on.
    in_all : bool
        Whether ``--all-effects`` switches it on.
    switch : str
        The key that forces it; where it is no key of ``[effects]``, `declared` says whether the scene has it on.
    declared : callable, optional
        Scene → bool.
    """

    name: str
    called_for: Callable[[Case], Finding]
    cost: str
    loss: Callable[[Case], str]
    needs: str = ""
    lines: Mapping[str, str] = field(default_factory=dict)
    lines_off: Mapping[str, str] = field(default_factory=dict)
    law: Callable[[Scene, bool], Mapping[str, Any]] = _no_law
    refuse: Callable[[Case], str] = _nothing_refused
    first_order: Callable[[Scene], bool] = _second_order
    guard: Guard | None = None
    always: bool = False
    in_all: bool = True
    switch: str = ""
    declared: Callable[[Scene], bool] | None = None

    @property
    def key(self) -> str:
        """The key of the scene that forces it."""
        return self.switch or f"effects.{self.name}"

    def guard_name(self, on: Mapping[str, bool]) -> str:
        """Return the name of the guard in a deck with these effects on; "" where none is needed."""
        watched = on.get(self.needs, True) and (self.always or not on[self.name])
        return self.guard.title if self.guard and watched else ""


@dataclass(frozen=True)
class Chosen:
    """One effect of a scene, decided.

    Attributes
    ----------
    name, switch : str
        And the key of the scene that forces it.
    on, called_for : bool
        Is it in the deck; does the scene call for it.
    number, reason : float, str
        The number behind that, and the sentence that goes with it.
    guard : str
        The guard that measures it, and fails the run while it is off; "" if none is needed.
    cost : str
        What it costs in time, measured (docs/effects.md).
    loss : str
        What is lost without it; "nothing" where the scene does not call for it.
    """

    name: str
    switch: str
    on: bool
    called_for: bool
    number: float
    reason: str
    guard: str
    cost: str
    loss: str

    @property
    def finding(self) -> str:
        """The number and its sentence; the sentence alone where the number is infinite."""
        return f"{self.number:.4g} {self.reason}" if isfinite(self.number) else self.reason

    @property
    def judged(self) -> bool:
        """Whether its guard fails the run: only that of an effect that is off and that the scene does not call for."""
        return not self.on and not self.called_for
