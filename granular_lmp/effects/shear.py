"""Shear: contacts resist a slip of their spheres by Mindlin's stiffness g = B √δ.

The law, "secant" (the paper's) or "incremental", determines the effect of a changing overlap on the shear force
(docs/choosing-a-shear-law.md).
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.modes import Physics, contact_stretches
from granular_lmp.effects.effect import NOTHING, Case, Effect, Finding
from granular_lmp.scene.scene import Scene


def called_for(case: Case) -> Finding:
    _, shear = contact_stretches(unit_lattice(case.scene.sphere), case.scene.sphere, case.mode)
    largest = float(np.max(np.abs(shear)))
    return Finding(
        largest > NOTHING, largest, f"D0 is the shear displacement of the contact sheared most by {case.wave_words}"
    )


def loss(case: Case) -> str:
    return case.frequency_shift(Physics(shear=False, rotation=False))


def law(scene: Scene, on: bool) -> Mapping[str, Any]:
    return {"shear": scene.effects.shear_law if on else "none"}


def first_order(scene: Scene) -> bool:
    """Return whether the law is incremental: LAMMPS then sums the shear force with the stiffness of the step before."""
    return scene.effects.shear_law == "incremental"


SHEAR = Effect("shear", called_for, cost="1.20", loss=loss, law=law, first_order=first_order)
