"""Damping: contacts dissipate energy, by a viscosity or by the restitution of a Hertz contact."""

from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.effect import AmongMeeting, Effect, LawPart
from granular_lmp.rest.scene import Scene


def called_for(case: Case) -> Finding:
    if case.viscosity == 0:
        return Finding(False, 0.0, "the viscosity is 0, and the restitution 1")
    if case.scene.wave is None:
        return Finding(True, case.viscosity, "the dashpot of a contact at rest is {} m/t0")
    rate = case.decay_rate
    if case.scene.form.driven:
        return Finding(True, rate, "the wave decays by {} per tau as it leaves the driven row")
    if case.scene.source:
        return Finding(True, rate, "the wave that is the unit of the sources decays by {} per tau")
    left = case.amplitude_left
    return Finding(True, rate, f"the wave decays by {{}} per tau, and {left:.3g} of it remains at the end")


def of_meeting(case: Case) -> Finding:
    effects, scale = case.scene.effects, case.scene.scale
    if effects.viscosity:
        return Finding(True, effects.viscosity * scale.time / scale.mass, "the dashpot of a contact is {} m/t0")
    return Finding(effects.restitution < 1, effects.restitution, "the restitution of a collision is {}")


def loss(case: Case) -> str:
    if case.scene.wave is None:
        return "nothing decays"
    return f"nothing decays, but only {case.amplitude_left:.3g} of the wave should remain"


def law(scene: Scene, on: bool) -> LawPart:
    if not on:
        return {}
    effects = scene.effects
    if effects.restitution == 1:
        return {"damping": effects.viscosity, "shear_damping": effects.shear_damping}
    return {"restitution": effects.restitution, "shear_damping": effects.shear_damping}


def refuse(case: Case) -> str:
    effects = case.scene.effects
    if not case.on["damping"]:
        return ""
    if case.viscosity == 0:
        return "effects.damping = true: needs effects.viscosity above 0 or effects.restitution below 1"
    if effects.restitution < 1 and case.on["adhesion"]:
        return (
            f"effects.restitution = {effects.restitution!r}: LAMMPS has it only for contacts without adhesion; use "
            "effects.viscosity, or effects.adhesion = false with packing.contact_force"
        )
    return ""


def order(scene: Scene) -> int:
    """Return 1: dashpots in LAMMPS use the velocity of half a step earlier."""
    return 1


def order_of_meeting(scene: Scene) -> int:
    """Return 1 with dashpots or a restitution, else 2."""
    return 1 if scene.effects.restitution < 1 or scene.effects.viscosity > 0 else 2


DAMPING = Effect(
    "damping",
    called_for,
    cost="1.00",
    loss=loss,
    meeting=AmongMeeting(of_meeting, order=order_of_meeting),
    law=law,
    refuse=refuse,
    order=order,
    in_all=False,
    recorded=True,
)
