"""A scene with a wave and a scene without one, prepared and written by the functions of its class."""

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.lammps.deck import Deck
from granular_lmp.problem import prepare
from granular_lmp.scene.at_rest import crystal_of
from granular_lmp.scene.scene import Scene


def in_deck(what: Scene | Deck) -> tuple[Scene, Deck | None]:
    """Return the scene to run, and its deck if there is one."""
    return (what.problem.scene, what) if isinstance(what, Deck) else (what, None)


def unit_of(scene: Scene) -> float:
    """Return the unit of displacements, m: D0 of a wave, else the length of the scale."""
    return scene.scale.length if scene.wave is None else scene.displacement_amplitude


def force_of(scene: Scene) -> float:
    """Return the unit of forces, N: k1 D0 of a wave, else m ℓ/t0²."""
    if scene.wave is None:
        return scene.scale.mass * scene.scale.length / scene.scale.time**2
    return scene.sphere.normal_stiffness * scene.displacement_amplitude


def words(scene: Scene) -> str:
    """Return the scene in a few words."""
    return scene.words if scene.wave is None else scene.wave_label


def in_snapshots(scene: Scene) -> tuple[ase.Atoms, NDArray[np.int64]]:
    """Return the spheres of a scene at rest, and the indices of those in its snapshots, ascending."""
    if scene.wave is None:
        problem = prepare(scene)
        return problem.crystal, problem.recorded
    atoms = crystal_of(scene).atoms
    return atoms, np.arange(len(atoms))
