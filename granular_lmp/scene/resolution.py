"""Resolution of a scene's wave: LAMMPS adds displacements to positions, whose rounding limits them."""

import numpy as np

from granular_lmp.scene.scene import Scene


def position_rounding(scene: Scene, lattice_constants: float) -> float:
    """Return the rounding, in D0, of a position at a distance in lattice constants from the origin: ½ eps of it."""
    distance = lattice_constants * scene.sphere.lattice_constant
    return float(np.finfo(float).eps / 2 * distance / scene.displacement_amplitude)


def farthest_rounding(scene: Scene) -> float:
    """Return the `position_rounding` of the farthest row, in D0."""
    return position_rounding(scene, scene.shape.rows / 2 * scene.lattice.row_spacing)
