"""Which physics a scene calls for: one table, a row an effect.

A row says when a scene calls for the effect (a rule that gives a number and a sentence), what it writes into the deck
when it is on and when it is off, which guard proves its absence harmless, what it costs, and what would be lost without
it. To add an effect, add a row and its test; the deck (`granular_lmp.deck`) has a slot for each line and asks nobody.

The rules judge the linear wave at its amplitude: exact for symmetries (an L wave along y turns no sphere), a prediction
for sliding and opening. What they miss, the guards see.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import exp, inf
from typing import Any, NamedTuple

import numpy as np

from granular_lmp import contact
from granular_lmp.errors import SceneError
from granular_lmp.fields import AUTO
from granular_lmp.modes import (
    Mode,
    Physics,
    contact_stretches,
    decay_rate,
    highest_frequency,
    mode_along_y,
)
from granular_lmp.packing import unit_lattice
from granular_lmp.scene import Scene
from granular_lmp.shape import FEWEST_COLUMNS
from granular_lmp.sphere import INERTIA_RATIO
from granular_lmp.units import Units

# μ = 5a (adhesion) to 10a (compression) keeps F_t under 0.6 of the sliding force for every mode. Much larger is wrong
# too: LAMMPS skips turning the shear history with the contact while its normal part is below 1e-10 of the sliding
# force, which then freezes it.
FRICTION_PER_AMPLITUDE = 10.0
NOTHING = 1e-12  # of a number of order 1 that a symmetry makes zero


@dataclass(frozen=True)
class Effect:
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
        The guard (`granular_lmp.guards`) that watches while it is off; "" if none is needed.
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


class Finding(NamedTuple):
    """What a rule says: is the effect called for, the number behind it, the sentence that goes on from the number."""

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
        return self.mode_with(Physics(self.on.get("shear", True), self.on.get("rotation", True)))

    def mode_with(self, physics: Physics) -> Mode:
        """The mode of the scene's wave in a lattice with other physics."""
        scene = self.scene
        return mode_along_y(unit_lattice(scene.sphere), scene.sphere, scene.wavenumber, scene.wave.mode, physics)

    @cached_property
    def stretches(self) -> tuple[np.ndarray, np.ndarray]:
        """Amplitudes of the normal and the shear displacement of the contacts, in Δ0."""
        normal, shear = contact_stretches(unit_lattice(self.scene.sphere), self.scene.sphere, self.mode)
        return normal * self.scene.wave.amplitude, shear * self.scene.wave.amplitude

    @property
    def no_slip_friction(self) -> float:
        """Friction coefficient per amplitude a at which nothing slides: 10/(1 + s), s the share of adhesion.

        The sliding force at rest is μ(AΔ0^{3/2} + F), and 1 + s that over the force that holds the contact.
        """
        return FRICTION_PER_AMPLITUDE / (1 + self.adhesive_share)

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
        """Largest F_t over the sliding force μ(Aδ^{3/2} + F), of all contacts over a period.

        With δ = Δ0(1−x), F_t = g1 t √(1−x), and in units of the force that holds the contact at rest, (2/3) k1 Δ0:

            1.5 κ |t| (1−x)^{1/2} / (μ [(1−x)^{3/2} + s])

        Infinite where a contact without adhesion opens.
        """
        cosine = np.cos(np.linspace(0, np.pi, 181))[:, None]
        normal, shear = self.stretches
        overlap = np.maximum(1 - normal * cosine, 0.0)
        force = 1.5 * self.scene.sphere.stiffness_ratio * np.abs(shear * cosine) * np.sqrt(overlap)
        limit = self.friction * (overlap**1.5 + self.adhesive_share)
        opened = (overlap == 0) & (limit == 0)
        return float(np.max(np.where(opened, inf, force / np.where(limit > 0, limit, 1.0))))


# --- the rules -------------------------------------------------------------------------------------------------------


def _adhesion(case: Case) -> Finding:
    material, sphere = case.scene.material, case.scene.sphere
    if material.work_of_adhesion == 0:
        return Finding(False, 0.0, "J/m2 of work of adhesion: Hertz contacts that compression holds")
    holding = material.pull_off_force + sphere.contact_force
    return Finding(True, material.pull_off_force / holding, "of the force that holds the contacts at rest is adhesion")


def _shear(case: Case) -> Finding:
    _, shear = contact_stretches(unit_lattice(case.scene.sphere), case.scene.sphere, case.mode)
    largest = float(np.max(np.abs(shear)))
    return Finding(
        largest > NOTHING, largest, f"D0 is the shear displacement of the contact sheared most by {_wave(case)}"
    )


def _rotation(case: Case) -> Finding:
    spin = INERTIA_RATIO * case.mode.f**2
    share = spin / (case.mode.ux**2 + case.mode.uy**2 + spin)
    said = f"of the kinetic energy of {_wave(case)} is rotation"
    if share <= NOTHING and case.mode.name == "TR" and case.scene.shape.ends == "fixed":  # at ξ = π
        return Finding(True, share, said + ", but the held rows turn their neighbours")
    return Finding(share > NOTHING, share, said)


def _tracking(case: Case) -> Finding:
    angle = case.scene.wave.amplitude * case.mode.f * case.scene.sphere.static_overlap / case.scene.sphere.radius
    return Finding(case.on["rotation"], abs(angle), "rad is the largest angle of a sphere")


def _sliding(case: Case) -> Finding:
    ratio = case.largest_slip()
    if case.scene.effects.friction == AUTO:
        return Finding(False, ratio, f"of the sliding force is the largest shear force (friction {case.friction:.3g})")
    return Finding(ratio >= 1, ratio, f"of the sliding force is the largest shear force (friction {case.friction:g})")


def _damping(case: Case) -> Finding:
    if case.viscosity == 0:
        return Finding(False, 0.0, "N s/m of viscosity, and no restitution below 1")
    rate = _decay(case)
    left = exp(-rate * case.scene.time.duration)
    return Finding(True, rate, f"per tau is the decay rate of the wave, of which {left:.3g} is left at the end")


def _contact_opening(case: Case) -> Finding:
    smallest = 1 - float(np.max(np.abs(case.stretches[0])))
    said = (
        "of the static overlap is left at the contact that is pulled most"
        if smallest > 0
        else ("of the static overlap would be left: contacts open, and no closed form holds")
    )
    return Finding(smallest <= 0, smallest, said)


def _walls(case: Case) -> Finding:
    if case.scene.shape.ends == "periodic":
        return Finding(False, float(case.scene.shape.rows), "rows in a periodic cell are the infinite lattice")
    return Finding(True, case.scene.echo_time, "tau is when the held rows are heard at the centre")


def _width(case: Case) -> Finding:
    return Finding(
        False, float(case.scene.shape.columns), f"columns; {FEWEST_COLUMNS} stand for any number in a plane wave"
    )


def _wave(case: Case) -> str:
    return f"{'an' if case.mode.name in ('L', 'RT') else 'a'} {case.mode.name} wave"


def _dashpot(scene: Scene) -> dict[str, float]:
    effects = scene.effects
    kind = {"damping": effects.viscosity} if effects.restitution == 1 else {"restitution": effects.restitution}
    return kind | {"shear_damping": 1.0}


def _decay(case: Case) -> float:
    shear = case.on.get("shear", True)
    return decay_rate(unit_lattice(case.scene.sphere), case.scene.sphere, case.mode, case.viscosity, shear=shear)


# --- what is lost ----------------------------------------------------------------------------------------------------


def _without_adhesion(case: Case) -> str:
    material, sphere = case.scene.material, case.scene.sphere
    force = material.pull_off_force + sphere.contact_force
    left = (sphere.contact_force / force) ** (2 / 3) if force else 0.0
    return f"the static overlap falls to {left:.3g} of its value"


def _without_shear(case: Case) -> str:
    return _frequency_shift(case, Physics(shear=False, rotation=False))


def _without_rotation(case: Case) -> str:
    return _frequency_shift(case, Physics(shear=case.on.get("shear", True), rotation=False))


def _frequency_shift(case: Case, physics: Physics) -> str:
    if case.scene.wave.mode == "RT":
        return "there is no RT wave"
    full, less = case.mode_with(Physics()).frequency, case.mode_with(physics).frequency
    return f"the frequency is {less:.4g} per tau instead of {full:.4g}: {abs(less / full - 1):.2%} off"


def _without_sliding(case: Case) -> str:
    return f"shear forces grow to {case.largest_slip():.3g} of what friction bears"


def _without_damping(case: Case) -> str:
    return f"the wave keeps what should decay to {exp(-_decay(case) * case.scene.time.duration):.3g} of it"


# --- the table -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """One effect: rule, deck lines by slot, its part of the contact law, the effect it needs, guard, cost, loss."""

    name: str
    rule: Callable[[Case], Finding]
    cost: str
    loss: str | Callable[[Case], str]
    on: Mapping[str, str] = field(default_factory=dict)
    off: Mapping[str, str] = field(default_factory=dict)
    law: Callable[[Scene, bool], Mapping[str, Any]] = lambda scene, on: {}  # arguments of `granular_lmp.contact.model`
    needs: str = ""
    guard: str = ""
    switch: str = ""
    declared: Callable[[Scene], bool] | None = None  # where it is no key of [effects]


ROWS = (
    Row(
        "adhesion",
        _adhesion,
        law=lambda scene, on: {"normal": "dmt" if on else "hertz"},
        cost="1.04",
        loss=_without_adhesion,
    ),
    Row(
        "shear",
        _shear,
        on={"friction": "<friction_variable>"},
        law=lambda scene, on: {"shear": scene.effects.shear_law if on else "none"},
        cost="0.97",
        loss=_without_shear,
    ),
    Row(
        "rotation",
        _rotation,
        needs="shear",
        on={
            "motion": "nve/sphere<track>",
            "angle_field": " d_phi",
            "spin_field": " d_vphi",
            "spin_column": " omegaz",
            "preload_spin": "variable     to_th atom v_D0*d_phi/v_R/v_slow\n"
            "variable     zero  atom 0.0\n"
            "set          group all omega v_zero v_zero v_to_th",
            "start_spin": "variable     om atom v_D0*d_vphi/v_R/v_t0\nset          group all omega v_zero v_zero v_om",
        },
        off={"motion": "nve"},
        guard="largest_torque",
        cost="1.01",
        loss=_without_rotation,
    ),
    Row(
        "tracking",
        _tracking,
        needs="rotation",
        on={
            "atom_style": "hybrid sphere dipole",
            "mass": "mass         * 1.0  # asked for by the dipole style, not used: spheres have their own",
            "track": " update dipole",
            "start_angle": "variable     mx atom cos(v_D0*d_phi/v_R)\n"
            "variable     my atom sin(v_D0*d_phi/v_R)\n"
            "set          group all dipole v_mx v_my v_zero",
            "read_angle": "compute      dipole centre property/atom mux muy\n"
            "variable     theta atom atan2(c_dipole[2],c_dipole[1])",
            "angle_column": " v_theta",
            "angle_name": " colname v_theta theta",
        },
        off={"atom_style": "sphere"},
        cost="1.03",
        loss="the angle is not in the record",
    ),
    Row(
        "sliding",
        _sliding,
        needs="shear",
        on={"friction_variable": "variable friction index <friction_given>  # Coulomb friction: contacts may slide"},
        off={
            "friction_variable": "variable friction index $(<no_slip_friction>*v_amplitude:%.17g)"
            "  # no sliding; much more would freeze the shear"
        },
        guard="largest_slip",
        cost="1.00",
        loss=_without_sliding,
    ),
    Row(
        "damping",
        _damping,
        law=lambda scene, on: _dashpot(scene) if on else {},
        cost="1.00",
        loss=_without_damping,
    ),
    Row(
        "contact_opening",
        _contact_opening,
        guard="open_contacts",
        cost="1.00",
        loss="nothing in the deck: LAMMPS parts contacts by itself; the guard falls silent",
    ),
    Row(
        "walls",
        _walls,
        on={"along_y": "f"},
        off={"along_y": "p"},
        cost="rows",
        loss="wave numbers other than 2 pi k/rows",
        switch="packing.ends",
        declared=lambda scene: scene.shape.ends == "fixed",
    ),
    Row(
        "width",
        _width,
        guard="row_spread",
        cost="columns",
        loss="waves that are not plane",
        switch="packing.columns",
        declared=lambda scene: scene.shape.columns > FEWEST_COLUMNS,
    ),
)


# --- the choice ------------------------------------------------------------------------------------------------------


def select(scene: Scene) -> list[Effect]:
    """The effects of a scene, each on or off, in the order in which they build on one another.

    Raises
    ------
    SceneError
        For an effect that is forced on without what it needs: another effect, or a coefficient; for restitution of
        adhesive contacts, which LAMMPS does not have.
    """
    on: dict[str, bool] = {}
    chosen = []
    for row in ROWS:
        case = Case(scene, dict(on))
        finding = row.rule(case)
        on[row.name] = _is_on(row, scene, finding, on)
        guard = row.guard if not on[row.name] and on.get(row.needs, True) else ""
        loss = (row.loss if isinstance(row.loss, str) else row.loss(case)) if finding.called_for else "nothing"
        switch = row.switch or f"effects.{row.name}"
        chosen.append(Effect(row.name, switch, on[row.name], *finding, guard=guard, cost=row.cost, loss=loss))
    _refuse_impossible(scene, on)
    return chosen


def _is_on(row: Row, scene: Scene, finding: Finding, on: Mapping[str, bool]) -> bool:
    wanted = row.declared(scene) if row.declared else getattr(scene.effects, row.name)
    possible = on.get(row.needs, True)
    if wanted is True and not possible:
        raise SceneError(f"effects.{row.name} = true: needs effects.{row.needs}, which is off")
    return possible and finding.called_for if wanted == AUTO else bool(wanted)


def _refuse_impossible(scene: Scene, on: Mapping[str, bool]) -> None:
    effects = scene.effects
    if on["sliding"] and effects.friction == AUTO:
        raise SceneError(
            "effects.sliding = true: needs effects.friction, the Coulomb coefficient, a number in (0, 1e4]"
        )
    if on["damping"] and effects.viscosity == 0 and effects.restitution == 1:
        raise SceneError("effects.damping = true: needs effects.viscosity above 0 or effects.restitution below 1")
    if on["damping"] and effects.restitution < 1 and on["adhesion"]:
        raise SceneError(
            f"effects.restitution = {effects.restitution!r}: LAMMPS has it for contacts without adhesion only; "
            "use effects.viscosity, or effects.adhesion = false with packing.contact_force"
        )


def resolve(scene: Scene) -> tuple[Scene, list[Effect]]:
    """The scene with every "auto" of packing and effects replaced by what it comes to, and its effects.

    Raises
    ------
    SceneError
        As `select`, and for a time step beyond the stability limit of velocity Verlet, 2/Ω_max of the lattice with
        these effects.
    """
    chosen = select(scene)
    shape = scene.shape
    values: dict[str, Any] = {f"packing.{key}": getattr(shape, key) for key in ("rows", "columns", "ends")}
    values |= {effect.switch: effect.on for effect in chosen if effect.switch.startswith("effects.")}
    resolved = scene.with_values(values)
    if scene.time.tolerance is None and scene.time.step >= largest_step(resolved):
        raise SceneError(
            f"time.timestep = {scene.time.timestep!r}: beyond the stability limit of velocity Verlet; "
            f"must be below 2/Omega_max = {largest_step(resolved):.6g}, in tau"
        )
    return resolved, chosen


def largest_step(scene: Scene) -> float:
    """2/Ω_max, τ: the stability limit of velocity Verlet in the scene's lattice."""
    return 2 / highest_frequency(unit_lattice(scene.sphere), scene.sphere, physics(scene))


def with_all(scene: Scene) -> Scene:
    """The scene with every effect on that it has the numbers for, to compare with."""
    effects, material = scene.effects, scene.material
    able = {
        "adhesion": material.work_of_adhesion > 0,
        "sliding": effects.friction != AUTO,
        "damping": effects.viscosity > 0 or effects.restitution < 1,
    }
    names = [row.name for row in ROWS if row.declared is None]
    return scene.with_values({f"effects.{name}": able.get(name, True) for name in names})


def warnings(chosen: list[Effect]) -> list[str]:
    """A sentence for each effect that is forced off although the scene calls for it: what will be wrong."""
    return [
        f"{effect.switch} is off, but {effect.number:.4g} {effect.reason}; without it {effect.loss}"
        for effect in chosen
        if effect.called_for and not effect.on
    ]


def physics(scene: Scene) -> Physics:
    """The degrees of freedom of a scene's lattice; those that are not decided yet are there."""
    return Physics(scene.effects.shear is not False, scene.effects.rotation is not False)


def values(scene: Scene, chosen: list[Effect], units: Units) -> dict[str, str]:
    """What the slots of the deck hold: the lines of the effects, and the numbers in them and in those of the guards."""
    rows = {row.name: row for row in ROWS}
    lines = dict.fromkeys((slot for row in ROWS for slot in (*row.on, *row.off)), "")
    law: dict[str, Any] = {"friction": "${friction}"}
    for effect in chosen:
        row = rows[effect.name]
        lines |= row.on if effect.on else row.off
        law |= row.law(scene, effect.on)
    case, sphere, effects = Case(scene), scene.sphere, scene.effects
    return lines | {
        "contact": contact.pair(contact.model(sphere, units, **law)),
        "friction_given": repr(effects.friction),
        "no_slip_friction": repr(case.no_slip_friction),
        "friction_limit": "v_friction" if effects.friction == AUTO else repr(effects.friction),
        "adhesive_force": repr(units.number(sphere.pull_off_force, mass=1, length=1, time=-2)),
        "holding_force": repr(units.number(sphere.holding_force, mass=1, length=1, time=-2)),
        "shear_stiffness": repr(units.number(sphere.shear_stiffness, mass=1, time=-2)),
        "contacts": str(_contact_count(scene)),
        "centre_row": _centre_row(scene),
    }


def _contact_count(scene: Scene) -> int:
    """Contacts at rest: three a sphere, less the two a column that held ends leave out."""
    shape = scene.shape
    return 3 * shape.spheres - (0 if shape.ends == "periodic" else 2 * shape.columns)


def _centre_row(scene: Scene) -> str:
    """Identifiers of the spheres of the centre row, first:last."""
    first = scene.shape.centre_row * scene.shape.columns + 1
    return f"{first}:{first + scene.shape.columns - 1}"
