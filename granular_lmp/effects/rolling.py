"""Rolling resistance: a spring, a dashpot and a friction act against the rolling of two spheres on each other.

``rolling sds`` in LAMMPS: with the roll ρ = Rc(φ_j/R_j − φ_i/R_i) of a contact, Rc = RiRj/(Ri + Rj) and φ = Rθ, a force

    f_r = −k_r ρ − γ_r dρ/dt,    |f_r| ≤ μ_r (f_N + 2F)

exerts the torques ±Rc f_r (Luding, Granular Matter 10, 235 (2008)). Below the cap it is a spring of the linear problem
(`granular_lmp.crystal.modes.Physics.rolling`).
"""

import numpy as np

from granular_lmp.crystal.modes import contact_rolls
from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.effect import AmongMeeting, Effect, LawPart
from granular_lmp.rest.linear import wave_contacts
from granular_lmp.rest.scene import Scene


def called_for(case: Case) -> Finding:
    effects, sphere = case.scene.effects, case.scene.sphere
    if effects.rolling_stiffness == 0:
        return Finding(False, 0.0, "the rolling stiffness is 0: spheres roll freely")
    if effects.rolling_friction == 0:  # refused below, if the effect is not forced off
        return Finding(True, np.inf, "no cap on the rolling force is declared")
    if case.scene.wave is None:
        return Finding(True, np.inf, case.every_mode)
    rolls = contact_rolls(wave_contacts(case.scene), sphere, case.mode)
    force = effects.rolling_stiffness / sphere.normal_stiffness * float(np.max(np.abs(rolls)))
    at_rest = sphere.contact_law.sliding_force(sphere.static_overlap)
    cap = effects.rolling_friction * at_rest / (sphere.normal_stiffness * sphere.static_overlap)  # in k1 Δ0
    ratio = force * case.scene.wave.amplitude / cap
    return Finding(True, ratio, "the largest rolling force is {} of the cap of rolling friction")


def of_meeting(case: Case) -> Finding:
    effects = case.scene.effects
    rolls = effects.rolling_stiffness > 0 and effects.rolling is not False
    return Finding(rolls, np.inf, "contacts resist rolling" if rolls else "the rolling stiffness is 0")


def loss(case: Case) -> str:
    return case.frequency_shift(case.physics(case.on.get("shear", True), case.on.get("rotation", True)))


def law(scene: Scene, on: bool) -> LawPart:
    if not on:
        return {}
    effects, units = scene.effects, scene.units
    spring = units.number(effects.rolling_stiffness, mass=1, time=-2)
    dashpot = units.number(effects.rolling_viscosity, mass=1, time=-1)
    return {"rolling": f"sds {spring!r} {dashpot!r} {effects.rolling_friction!r}"}


def refuse(case: Case) -> str:
    effects = case.scene.effects
    if not case.on["rolling"]:
        return ""
    if effects.rolling_stiffness == 0:
        return "effects.rolling = true: needs effects.rolling_stiffness above 0, N/m"
    if effects.rolling_friction == 0:
        return "effects.rolling_friction = 0.0: must be above 0 with effects.rolling on; it caps the rolling force"
    return ""


def order(scene: Scene) -> int:
    """Return 1 with a dashpot, which uses the velocity of half a step earlier, else 2."""
    return 1 if scene.effects.rolling_viscosity else 2


ROLLING = Effect(
    "rolling",
    called_for,
    cost="1.05",
    loss=loss,
    meeting=AmongMeeting(of_meeting),
    needs="rotation",
    law=law,
    refuse=refuse,
    order=order,
    in_all=False,
    recorded=True,
)
