"""Records of strikes on spheres that just touch: allowed keys of their scenes, recorded spheres, overlap at rest."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.strikes import Sites, hertz, scale_of_strike
from granular_analysis.theory.errors import TheoryError
from granular_lmp.runs.record import Record, Scene

Integers = NDArray[np.intp]


def require(record: Record, *held: str) -> None:
    """Raise ValueError if a scene has one of the following features that is not named in `held`.

    held : any of "start.state", "start.noise", "packing.contact_force", "effects.friction", "effects.restitution",
        "effects.viscosity", "disorder", "inclusion".
    """
    scene: Any = record.scene  # every "auto" is decided
    disorder = scene.disorder
    there = {
        "start.state": bool(scene.start.state),
        "start.noise": scene.start.noise > 0,
        "packing.contact_force": scene.packing.contact_force > 0,
        "effects.friction": float(scene.effects.friction) > 0,
        "effects.restitution": scene.effects.restitution < 1,
        "effects.viscosity": scene.effects.viscosity > 0,
        "disorder": max(disorder.radius, disorder.density, disorder.vacancies) > 0,
        "inclusion": bool(scene.inclusion),
    }
    for name, given in there.items():
        if given and name not in held:
            raise TheoryError(f"{scene.name}: {name}: must be left out, because this measurement does not include it")


def recorded(scene: Scene) -> Integers:
    """Return the indices of the recorded spheres of a lattice; all spheres if the scene names none."""
    sites, named = Sites.of(scene), scene.output.rows or scene.output.spheres
    return sites.chosen(scene.output) if named else np.arange(len(sites.row))


def rest_overlap(scene: Scene) -> float:
    """Return the overlap at rest (F0/A)^{2/3} of two of the declared spheres under the load F0, in ℓ."""
    length, _ = scale_of_strike(scene)
    return float((scene.packing.contact_force / hertz(scene)) ** (2 / 3) / length)
