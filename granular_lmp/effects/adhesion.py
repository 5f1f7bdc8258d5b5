"""Adhesion: the constant attraction F = 2πwRc of contacts that touch (DMT), which holds a crystal of microspheres.

Without it contacts are those of Hertz, and compression has to hold the crystal (``packing.contact_force``).
"""

from collections.abc import Mapping
from typing import Any

from granular_lmp.effects.effect import Case, Effect, Finding
from granular_lmp.scene.scene import Scene


def called_for(case: Case) -> Finding:
    material, sphere = case.scene.material, case.scene.sphere
    if material.work_of_adhesion == 0:
        return Finding(False, 0.0, "J/m2 of work of adhesion: Hertz contacts that compression holds")
    holding = material.pull_off_force + sphere.contact_force
    return Finding(True, material.pull_off_force / holding, "of the force that holds the contacts at rest is adhesion")


def loss(case: Case) -> str:
    material, sphere = case.scene.material, case.scene.sphere
    force = material.pull_off_force + sphere.contact_force
    left = (sphere.contact_force / force) ** (2 / 3) if force else 0.0
    return f"the static overlap falls to {left:.3g} of its value"


def law(scene: Scene, on: bool) -> Mapping[str, Any]:
    return {"normal": "dmt" if on else "hertz"}


ADHESION = Effect("adhesion", called_for, cost="1.00", loss=loss, law=law, in_all=False)
