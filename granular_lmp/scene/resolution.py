"""How finely the positions of a scene's spheres resolve its wave: LAMMPS adds displacements to positions."""

import numpy as np

from granular_lmp.crystal.wavevector import ROW_SPACING
from granular_lmp.scene.scene import Scene


def position_rounding(scene: Scene, lattice_constants: float) -> float:
    """Return the rounding of a position so many lattice constants from the origin, in D0: ½ eps of it."""
    distance = lattice_constants * scene.sphere.lattice_constant
    return float(np.finfo(float).eps / 2 * distance / scene.displacement_amplitude)


def farthest_rounding(scene: Scene) -> float:
    """Return `position_rounding` of the farthest row."""
    return position_rounding(scene, scene.shape.rows / 2 * ROW_SPACING)
