"""Resolution of a scene's wave: LAMMPS adds displacements to positions, whose rounding limits them."""

from math import sqrt

import numpy as np

from granular_lmp.rest.scene import Scene


def position_rounding(scene: Scene, lattice_constants: float) -> float:
    """Return the rounding, in D0, of a position at a distance in lattice constants from the origin: ½ eps of it."""
    distance = lattice_constants * scene.sphere.lattice_constant
    return float(np.finfo(float).eps / 2 * distance / scene.displacement_amplitude)


def gathered_rounding(scene: Scene) -> float:
    """Return the displacement, in D0, that rounding makes in a whole run where a symmetry forbids any, as a law.

        r (√(n/6) + 1/Δτ),    r the `farthest_rounding`, n the number of steps

    Each step rounds a position by r/√3 at random, and the lattice keeps half of these kicks: a random walk, r √(n/6).
    A motion of amplitude r/Δτ and frequency 1 is slower than r in a step: shorter ones are rounded away, and what stays
    where it is differs from what should move by as much, which is linear in the number of steps in a time. Measured
    were up to 2 times that (torques of an L wave), and 0.01 to 0.9 (spread of a row), of 1e2 to 1e5 steps.
    """
    return farthest_rounding(scene) * (sqrt(scene.time.steps / 6) + 1 / scene.time.step)


def farthest_rounding(scene: Scene) -> float:
    """Return the `position_rounding` of the farthest row, in D0."""
    return position_rounding(scene, scene.lattice.row_distance(scene.shape.rows / 2))
