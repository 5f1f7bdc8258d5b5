"""Impacts that a measurement holds: strikers on equal spheres that just touch, and what it says that it holds too."""

from typing import Any

from granular_lmp.runs.record import Record


def require(record: Record, *held: str) -> None:
    """Raise ValueError if a scene has more than strikers, by the names below, that is not `held`.

    held : any of "start.state", "start.noise", "packing.contact_force", "effects.friction", "effects.restitution",
        "disorder", "inclusion".
    """
    scene: Any = record.scene  # nothing of it is "auto"
    disorder = scene.disorder
    there = {
        "start.state": bool(scene.start.state),
        "start.noise": scene.start.noise > 0,
        "packing.contact_force": scene.packing.contact_force > 0,
        "effects.friction": float(scene.effects.friction) > 0,
        "effects.restitution": scene.effects.restitution < 1,
        "disorder": max(disorder.radius, disorder.density, disorder.vacancies) > 0,
        "inclusion": bool(scene.inclusion),
    }
    if unknown := {*held} - {*there}:
        raise ValueError(f"held = {sorted(unknown)}: must be among {', '.join(there)}")
    for name, given in there.items():
        if given and name not in held:
            raise ValueError(f"{scene.name}: {name}: must be left out; what is measured or set beside it lacks it")
