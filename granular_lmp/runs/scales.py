"""Units of displacements and forces in a record: those of the wave, or of the impact if there is no wave.

Times are always in t0 of the scene (`granular_lmp.crystal.scale`).
"""

from math import prod

from granular_lmp.rest.scene import Scene
from granular_lmp.scene.monitor_kinds import Unit


def length_of(scene: Scene) -> float:
    """Return the unit of displacements, m: D0 of a wave, Δ0 of a crystal at rest, or ℓ of an impact."""
    return scene.displacement_amplitude


def force_of(scene: Scene) -> float:
    """Return the unit of forces, N: k1 D0 in a crystal at rest, else m ℓ/t0²."""
    return scene.scale.force(length_of(scene), scene.sphere.normal_stiffness)


def si_of(unit: Unit, scene: Scene) -> float:
    """Return a unit of a record in SI units."""
    powers = [
        (force_of(scene), unit.force),
        (length_of(scene), unit.length),
        (scene.scale.length, unit.overlap),
        (scene.sphere.radius, unit.radius),
        (scene.scale.time, unit.time),
    ]
    below = prod(size**-power for size, power in powers if power < 0)
    return prod(size**power for size, power in powers if power > 0) / below
