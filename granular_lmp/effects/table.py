"""Which physics a scene calls for: one table, a row an effect.

A row says when a scene calls for the effect (a rule of `granular_lmp.effects.rules` that gives a number and a
sentence), what it writes into the deck when it is on and when it is off, which guard proves its absence harmless, what
it costs, and what would be lost without it. To add an effect, add a row and its test; the deck
(`granular_lmp.lammps.deck`) has a slot for each line and asks nobody. No theory holds it until its line in
`analysis.theory.catalogue` says so.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import hypot, isfinite
from typing import Any

from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.modes import highest_frequency
from granular_lmp.effects import rules
from granular_lmp.effects.rules import Case, Finding
from granular_lmp.errors import SceneError
from granular_lmp.lammps import contact
from granular_lmp.lammps.units import Units
from granular_lmp.scene.linear import physics_of
from granular_lmp.scene.scene import Scene
from granular_lmp.scene.schema import AUTO
from granular_lmp.scene.shape import FEWEST_COLUMNS


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
        The guard (`granular_lmp.effects.guards`) that measures it, and fails the run while it is off; "" if none is
        needed.
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
    # arguments of `granular_lmp.lammps.contact.model`
    law: Callable[[Scene, bool], Mapping[str, Any]] = lambda scene, on: {}
    needs: str = ""
    refuse: Callable[[Case], str] = lambda case: ""  # why it cannot be as it is chosen
    first_order: Callable[[Scene], bool] = lambda scene: False  # is LAMMPS's error then of first order in the step
    guard: str = ""
    always: bool = False  # the guard measures, but does not judge, also while the effect is on
    in_all: bool = True  # does `with_all` switch it on
    switch: str = ""
    declared: Callable[[Scene], bool] | None = None  # where it is no key of [effects]


ROWS = (
    Row(
        "adhesion",
        rules.adhesion,
        law=lambda scene, on: {"normal": "dmt" if on else "hertz"},
        in_all=False,
        cost="1.00",
        loss=rules.without_adhesion,
    ),
    Row(
        "shear",
        rules.shear,
        on={"friction": "<friction_variable>"},
        law=lambda scene, on: {"shear": scene.effects.shear_law if on else "none"},
        first_order=lambda scene: scene.effects.shear_law == "incremental",
        cost="1.20",
        loss=rules.without_shear,
    ),
    Row(
        "rotation",
        rules.rotation,
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
        cost="1.02",
        loss=rules.without_rotation,
    ),
    Row(
        "tracking",
        rules.tracking,
        needs="rotation",
        on={
            "atom_style": "hybrid sphere dipole",
            "mass": "mass         * 1.0  # asked for by the dipole style, not used: spheres have their own",
            "track": " update dipole",
            "start_angle": "variable     mx atom cos(v_D0*d_phi/v_R)\n"
            "variable     my atom sin(v_D0*d_phi/v_R)\n"
            "set          group all dipole v_mx v_my v_zero",
            "read_angle": "compute      dipole <seen> property/atom mux muy\n"
            "variable     theta atom atan2(c_dipole[2],c_dipole[1])",
            "angle_column": " v_theta",
            "angle_name": " colname v_theta theta",
        },
        off={"atom_style": "sphere"},
        cost="1.03",
        loss="the angle is not in the record",
    ),
    Row(
        "damping",
        rules.damping,
        law=lambda scene, on: _dashpot(scene) if on else {},
        refuse=rules.no_dashpot,
        first_order=lambda scene: True,
        in_all=False,
        cost="1.00",
        loss=rules.without_damping,
    ),
    Row(
        "sliding",
        rules.sliding,
        needs="shear",
        on={"friction_variable": "variable friction index <friction_given>  # Coulomb friction: contacts may slide"},
        off={
            "friction_variable": "variable friction index $(<no_slip_friction>*v_amplitude:%.17g)"
            "  # no sliding; much more would freeze the shear"
        },
        refuse=rules.no_friction,
        first_order=lambda scene: True,
        guard="largest_slip",
        always=True,
        in_all=False,
        cost="1.00",
        loss=rules.without_sliding,
    ),
    Row(
        "contact_opening",
        rules.contact_opening,
        first_order=lambda scene: True,
        guard="open_contacts",
        always=True,
        cost="1.00",
        loss="the guard reports it; the deck is the same, as LAMMPS parts contacts by itself",
    ),
    Row(
        "walls",
        rules.walls,
        on={"along_y": "f"},
        off={"along_y": "p"},
        cost="rows",
        loss="wave numbers other than 2 pi k/rows",
        switch="packing.ends",
        declared=lambda scene: scene.shape.ends == "fixed",
    ),
    Row(
        "width",
        rules.width,
        guard="row_spread",
        cost="columns",
        loss="waves whose rows do not move alike",
        switch="packing.columns",
        declared=lambda scene: scene.shape.columns > FEWEST_COLUMNS or not scene.uniform_rows,
    ),
)


def _dashpot(scene: Scene) -> dict[str, float]:
    effects = scene.effects
    kind = {"damping": effects.viscosity} if effects.restitution == 1 else {"restitution": effects.restitution}
    return kind | {"shear_damping": 1.0}


# --- the choice ------------------------------------------------------------------------------------------------------


def select(scene: Scene) -> list[Effect]:
    """The effects of a scene, each on or off, in the order in which they build on one another.

    Raises
    ------
    SceneError
        For an effect that is forced on without what it needs: another effect, or a coefficient; for restitution of
        adhesive contacts, which LAMMPS does not have; for contacts that slide whatever they do.
    """
    on: dict[str, bool] = {}
    chosen = []
    for row in ROWS:
        case, possible = Case(scene, dict(on)), on.get(row.needs, True)
        finding = row.rule(case) if possible else Finding(False, 0.0, f"needs {row.needs}, which is off")
        on[row.name] = _is_on(row, scene, finding.called_for, possible)
        guard = _guard(row, on)
        loss = (row.loss if isinstance(row.loss, str) else row.loss(case)) if finding.called_for else "nothing"
        switch = row.switch or f"effects.{row.name}"
        chosen.append(Effect(row.name, switch, on[row.name], *finding, guard=guard, cost=row.cost, loss=loss))
    for row in ROWS:
        reason = row.refuse(Case(scene, on))
        if reason:
            raise SceneError(reason)
    return chosen


def switches(scene: Scene) -> dict[str, tuple[bool, str]]:
    """Return for each effect whether it is on, and the guard that the deck has for it ("": none).

    The scene is one whose every "auto" is decided (`resolve`): no rule is asked.
    """
    on: dict[str, bool] = {}
    found = {}
    for row in ROWS:
        on[row.name] = row.declared(scene) if row.declared else getattr(scene.effects, row.name) is True
        found[row.name] = on[row.name], _guard(row, on)
    return found


def _guard(row: Row, on: Mapping[str, bool]) -> str:
    """Return the guard that watches an effect, which is on or off as the mapping says; "" where none is needed."""
    return row.guard if on.get(row.needs, True) and (row.always or not on[row.name]) else ""


def _is_on(row: Row, scene: Scene, called_for: bool, possible: bool) -> bool:
    wanted = row.declared(scene) if row.declared else getattr(scene.effects, row.name)
    if wanted is True and not possible:
        raise SceneError(f"effects.{row.name} = true: needs effects.{row.needs}, which is off")
    return possible and called_for if wanted == AUTO else bool(wanted)


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
    limit = largest_step(resolved)
    if scene.time.tolerance is None and scene.time.step >= limit:
        name = "2/Omega_max, less with dashpots," if resolved.effects.damping is True else "2/Omega_max"
        raise SceneError(
            f"time.timestep = {scene.time.timestep!r}: beyond the stability limit of velocity Verlet; "
            f"must be below {name} = {limit:.6g}, in tau"
        )
    return resolved, chosen


def largest_step(scene: Scene) -> float:
    """The stability limit of velocity Verlet in the scene's lattice, τ: 2/Ω_max, less with dashpots.

    LAMMPS's dashpots see the velocity of half a step before, which makes (ΩΔτ)² + 2cλΔτ < 4 of it, with c in m/t0 and
    λ = 2(κ+3)Ω²/min(κ, 1) at the most.
    """
    physics = physics_of(scene)
    top = highest_frequency(unit_lattice(scene.sphere), scene.sphere, physics)
    kappa = scene.sphere.stiffness_ratio
    drag = 0.0
    if scene.effects.damping is not False:
        drag = Case(scene).viscosity * 2 * (kappa + 3) / (min(kappa, 1.0) if physics.shear else 1.0)  # cλ/Ω²
    return 2 / top / (hypot(drag * top / 2, 1) + drag * top / 2)


def order(scene: Scene) -> int:
    """Order of LAMMPS's error in the time step: 2, that of velocity Verlet, or 1 where an effect spoils it.

    Dashpots see the velocity of half a step ago; an incremental shear force is summed with the stiffness of the step
    before; a contact that slides or opens does so inside a step.
    """
    spoilt = (
        row.first_order(scene) for row in ROWS if row.declared is None and getattr(scene.effects, row.name) is True
    )
    return 1 if any(spoilt) else 2


def with_all(scene: Scene) -> Scene:
    """The scene with everything on that does not change its lattice or needs a coefficient, to compare with."""
    return scene.with_values({f"effects.{row.name}": True for row in ROWS if row.declared is None and row.in_all})


def warnings(chosen: list[Effect]) -> list[str]:
    """A sentence for each effect that is forced off although the scene calls for it: what will be wrong."""
    return [
        f"{effect.switch} is off, but {effect.finding}; without it {effect.loss}"
        for effect in chosen
        if effect.called_for and not effect.on
    ]


def values(scene: Scene, chosen: list[Effect], units: Units) -> dict[str, str]:
    """What the slots of the deck hold: the lines of the effects, and the numbers in them and in those of the guards."""
    rows = {row.name: row for row in ROWS}
    lines = dict.fromkeys((slot for row in ROWS for slot in (*row.on, *row.off)), "")
    law: dict[str, Any] = {"friction": "${friction}"}
    for effect in chosen:
        row = rows[effect.name]
        lines |= row.on if effect.on else row.off
        law |= row.law(scene, effect.on)
    on = {effect.name: effect.on for effect in chosen}
    case, sphere, effects = Case(scene, on), scene.sphere, scene.effects
    return lines | {
        "contact": contact.pair(contact.model(sphere, units, **law)),
        "friction_given": repr(effects.friction),
        "no_slip_friction": repr(case.no_slip_friction),
        "friction_limit": "v_friction" if effects.friction == AUTO else repr(effects.friction),
        "adhesive_force": repr(units.number(sphere.pull_off_force, mass=1, length=1, time=-2)),
        "holding_force": repr(units.number(sphere.holding_force, mass=1, length=1, time=-2)),
        "shear_stiffness": repr(units.number(sphere.shear_stiffness, mass=1, time=-2)),
        "centre_row": _centre_row(scene),
    }


def _centre_row(scene: Scene) -> str:
    """Identifiers of the spheres of the centre row, first:last."""
    first = scene.shape.centre_row * scene.shape.columns + 1
    return f"{first}:{first + scene.shape.columns - 1}"
