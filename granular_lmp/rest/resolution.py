"""Resolution of the wave of a scene, limited by the rounding of positions in LAMMPS."""

from math import sqrt

import numpy as np

from granular_lmp.rest.scene import Scene


def position_rounding(scene: Scene, lattice_constants: float) -> float:
    """Return the rounding of a position, in D0: ½ eps times its distance from the origin, in lattice constants."""
    distance = lattice_constants * scene.sphere.lattice_constant
    return float(np.finfo(float).eps / 2 * distance / scene.displacement_amplitude)


def gathered_rounding(scene: Scene) -> float:
    """Return the displacement, in D0, that rounding makes during a run where symmetry forbids any.

        r (√(n/6) + 1/Δτ),    r the `farthest_rounding`, n the number of steps

    Each step rounds a position by r/√3 at random, and the lattice keeps half of these kicks: a random walk, r √(n/6). A
    motion with an amplitude below r/Δτ, at frequency 1, moves a sphere by less than r per step and is rounded away, so
    it is wrong by this amplitude, which grows as 1/Δτ. Measured over 1e2 to 1e5 steps: up to 2 times this law for the
    torques of an L wave, 0.01 to 0.9 times for the spread of a row.
    """
    return farthest_rounding(scene) * (sqrt(scene.time.steps / 6) + 1 / scene.time.step)


def farthest_rounding(scene: Scene) -> float:
    """Return the `position_rounding` of the farthest row, in D0."""
    return position_rounding(scene, scene.lattice.row_distance(scene.shape.rows / 2))
