"""Adhesion: the attraction of contacts, which holds a crystal of microspheres.

It is the constant F = 2πwRc of touching contacts (DMT), or that of JKR, which also acts beyond overlap 0. Without
adhesion contacts are Hertz contacts, and compression must hold the crystal (``packing.contact_force``).
"""

from dataclasses import replace
from math import inf

from granular_lmp.crystal.adhesion_laws import HERTZ
from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.effect import AmongMeeting, Effect, LawPart
from granular_lmp.rest.scene import Scene


def called_for(case: Case) -> Finding:
    material, sphere = case.scene.material, case.scene.sphere
    if material.work_of_adhesion == 0:
        return Finding(False, 0.0, "the work of adhesion is 0: compression holds Hertz contacts")
    holding = material.pull_off_force + sphere.contact_force
    return Finding(
        True, material.pull_off_force / holding, "adhesion provides {} of the force that holds the contacts at rest"
    )


def of_meeting(case: Case) -> Finding:
    pull = case.scene.material.pull_off_force
    return (
        Finding(True, pull, "a pull of {} N parts two spheres")
        if pull
        else Finding(False, inf, "spheres part without a pull")
    )


def loss(case: Case) -> str:
    material, force = case.scene.material, case.scene.sphere.contact_force
    without, whole = (replace(each, contact_force=force).static_overlap for each in (material.unloaded, material))
    left = without / whole if whole else 0.0
    return f"the static overlap falls to {left:.3g} of its value"


def law(scene: Scene, on: bool) -> LawPart:
    return {"normal": scene.material.adhesion_law if on else HERTZ}


ADHESION = Effect(
    "adhesion",
    called_for,
    cost="1 or 2",
    loss=loss,
    meeting=AmongMeeting(of_meeting),
    law=law,
    recorded=True,
    in_all=False,
)
