"""Linear wave of a scene: the degrees of freedom of its lattice, and the Bloch mode of its wave."""

from dataclasses import replace

from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.mode import Mode, Physics
from granular_lmp.crystal.modes import bloch_mode
from granular_lmp.frozen import dataclass
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.sections import Wave


@dataclass(frozen=True)
class BlochWave:
    """Wave of a scene in its crystal.

    Attributes
    ----------
    declared : Wave
    mode : Mode
        Bloch mode of the wave in the lattice.
    """

    declared: Wave
    mode: Mode


def physics_of(scene: Scene) -> Physics:
    """Return the degrees of freedom of the lattice of a scene; any that is still "auto" counts as present."""
    return scene.physics


def viscosity_of(scene: Scene) -> float:
    """Return the dashpot of a contact at rest, in m/t0."""
    effects, sphere = scene.effects, scene.sphere
    dashpot = effects.viscosity or sphere.restitution_viscosity(effects.restitution)
    return dashpot * sphere.time_scale / sphere.mass


def plane_along_y(scene: Scene) -> bool:
    """Return whether the wave is that of the paper: a running plane wave along y in a perfect lattice."""
    running = scene.form.runs and not scene.envelope.finite and not scene.struck and not scene.source
    along_y = running and scene.vector.axis == "y" and scene.vector.per_row > 0
    paper = scene.space == 2 and scene.lattice.column_period == 1
    return along_y and paper and scene.perfect and scene.shape.infinite


def uniform_rows(scene: Scene) -> bool:
    """Return whether all spheres of a row move alike, so that a few columns stand for any number."""
    if scene.wave is None:
        return False
    whole = all(each.rows for each in (*scene.source, *scene.striker, *scene.start.at()))
    whole = whole and not scene.start.noise
    return scene.layered and scene.vector.axis == "y" and scene.envelope.width == 0 and whole


def unit_contacts(scene: Scene) -> Contacts:
    """Return the contacts of the spheres in one cell of the perfect lattice of a scene, including walls."""
    return unit_lattice(scene.sphere, scene.lattice, scene.wall)


def wave_contacts(scene: Scene) -> Contacts:
    """Return the contacts in one cell of the crystal whose mode starts the wave; its rows may differ in a pattern."""
    return unit_lattice(scene.sphere, scene.wave_lattice, scene.wall)


def usual_frequency(scene: Scene) -> float:
    """Return Ω of the wave of a scene, rad/t0; 0 without a wave, as sources then have their own frequencies."""
    return 0.0 if scene.wave is None else mode_of(scene).frequency


def mode_of(scene: Scene, physics: Physics | None = None) -> Mode:
    """Return the Bloch mode of the wave of a scene, in its lattice or with other degrees of freedom."""
    physics = physics_of(scene) if physics is None else replace(physics, space=scene.space == 3)
    return bloch_mode(wave_contacts(scene), scene.sphere, scene.vector, scene.require_wave().mode, physics)


def bloch_wave(scene: Scene) -> BlochWave:
    """Return the wave of a scene in its lattice."""
    return BlochWave(scene.require_wave(), mode_of(scene))
