"""The linear wave of a scene: the degrees of freedom of its lattice, and the Bloch mode of its wave."""

from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.modes import Mode, Physics, bloch_mode
from granular_lmp.scene.scene import Scene


def physics_of(scene: Scene) -> Physics:
    """Return the degrees of freedom of a scene's lattice; those that are still "auto" are there."""
    return scene.effects.physics


def unit_contacts(scene: Scene) -> Contacts:
    """Return the contacts of one sphere of a scene's lattice when that is perfect."""
    return unit_lattice(scene.sphere, scene.lattice)


def mode_of(scene: Scene, physics: Physics | None = None) -> Mode:
    """Return the Bloch mode of a scene's wave in its lattice, or in a lattice with the given physics."""
    return bloch_mode(unit_contacts(scene), scene.sphere, scene.vector, scene.wave.mode, physics or physics_of(scene))
