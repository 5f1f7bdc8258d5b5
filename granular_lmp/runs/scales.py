"""The units of displacements and forces in a record: those of the wave, or of the impact where there is none.

Times are in t0 of the scene (`granular_lmp.crystal.scale`) everywhere.
"""

from granular_lmp.rest.scene import Scene


def length_of(scene: Scene) -> float:
    """Return the unit of displacements, m: D0 of a wave, else Δ0 of a crystal at rest, or ℓ of an impact."""
    return scene.displacement_amplitude


def force_of(scene: Scene) -> float:
    """Return the unit of forces, N: k1 D0 in a crystal at rest, else m ℓ/t0²."""
    return scene.scale.force(length_of(scene), scene.sphere.normal_stiffness)
