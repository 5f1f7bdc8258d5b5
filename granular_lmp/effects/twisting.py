"""Twisting resistance: a contact resists the relative rotation of its spheres about the normal.

The law is ``twisting marshall`` of LAMMPS. Spheres that move in a plane turn about its normal and twist no contact, so
the effect does not change a run; it prepares decks for three dimensions.
"""

from granular_lmp.effects.case import Case, Finding
from granular_lmp.effects.effect import Effect, LawPart
from granular_lmp.rest.scene import Scene


def called_for(case: Case) -> Finding:
    if case.scene.space == 3:
        return Finding(False, 0.0, "no twist is resisted: contacts twist freely about their normals")
    return Finding(False, 0.0, "spheres that move in the plane twist no contact")


def loss(case: Case) -> str:
    return "nothing"


def law(scene: Scene, on: bool) -> LawPart:
    return {"twisting": "marshall"} if on else {}


TWISTING = Effect(
    "twisting", called_for, cost="1.03", loss=loss, needs="rotation", law=law, in_all=False, recorded=True
)
