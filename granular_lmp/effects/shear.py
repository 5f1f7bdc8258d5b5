"""Shear: contacts resist the slip of their spheres with the Mindlin stiffness g = B √δ.

The law, "secant" (as in the paper) or "incremental", determines how a changing overlap affects the shear force
(page Contact laws).
"""

from math import inf

import numpy as np

from granular_lmp.crystal.modes import bears_compression, contact_stretches
from granular_lmp.effects.case import NOTHING, Case, Finding
from granular_lmp.effects.effect import AmongMeeting, Effect, LawPart
from granular_lmp.rest.linear import uniform_rows, wave_contacts
from granular_lmp.rest.scene import Scene


def called_for(case: Case) -> Finding:
    lattice, sphere = wave_contacts(case.scene), case.scene.sphere
    if sphere.contact_force and not bears_compression(lattice, shear=False):
        return Finding(
            True, sphere.contact_force, "{} N press the lattice together, which would buckle without shear forces"
        )
    if case.scene.wave is None:
        return Finding(True, inf, case.every_mode)
    _, shear = contact_stretches(lattice, sphere, case.mode)
    largest = float(np.max(np.abs(shear)))
    if case.every_mode:
        return Finding(True, largest, f"contacts are sheared by {{}} D0, and {case.every_mode}")
    if largest <= NOTHING and not uniform_rows(case.scene):
        return Finding(
            True,
            largest,
            "the wave shears contacts by {} D0, but the spheres of a row do not move alike and shear others",
        )
    return Finding(largest > NOTHING, largest, f"{case.wave_words} shears contacts by up to {{}} D0")


def of_meeting(case: Case) -> Finding:
    effects = case.scene.effects
    if not case.scene.lattice.sheet:
        return Finding(False, inf, "nothing is sheared in a chain")
    rubs = float(effects.friction) > 0
    return Finding(
        rubs, inf, f"contacts are sheared by the {effects.shear_law} law" if rubs else "effects.friction is 0"
    )


def loss(case: Case) -> str:
    return case.frequency_shift(case.physics(shear=False, rotation=False))


def law(scene: Scene, on: bool) -> LawPart:
    return {"shear": scene.effects.shear_law if on else "none"}


def order(scene: Scene) -> int:
    """Return 1 for the incremental law, which sums with the stiffness at one end of a step, else 2."""
    return 1 if scene.effects.shear_law == "incremental" else 2


def order_of_meeting(scene: Scene) -> int:
    """Return the order with friction, or 2 without."""
    return order(scene) if float(scene.effects.friction) > 0 else 2


SHEAR = Effect(
    "shear",
    called_for,
    cost="1.20",
    loss=loss,
    meeting=AmongMeeting(of_meeting, order=order_of_meeting),
    law=law,
    order=order,
    recorded=True,
)
