"""Drives of a packing of spheres: pushes and prescribed motions.

A drive is a signal over time. It is a force along x, y or z, a torque, or a prescribed displacement or turn of spheres,
which then ignore all forces. The velocity of a prescribed motion is the slope of the signal, by differences with a
relative error of 1e-10.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
Function = Callable[[Floats], Floats]
# Points and weights of the five-point difference; at h/longest = 1e-3, truncation and rounding each leave 1e-10
_STENCIL = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
_SLOPE = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12
_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Drive:
    """A signal that pushes or moves spheres.

    Attributes
    ----------
    spheres : (n,) indices of the spheres.
    component : row of the motion. In the plane 0 and 1 are x and y, 2 the rotation; in space 0 to 2 are x, y and z, 3
        to 5 the rotations about them.
    signal : times (T,) → forces, torques, displacements or angles (T,).
    moves : whether the signal prescribes the motion; otherwise it is a force or torque.
    longest : time over which the signal changes; no step of `network_motion` is longer.
    size : largest absolute value of the signal.
    share : (n,) factor of the signal on each sphere.
    rate : times (T,) → velocities that contacts see in a step of `network_verlet`, those at its end as with ``fix
        move``; None: the mean velocity over the step.
    """

    spheres: Integers
    component: int
    signal: Function
    moves: bool = False
    longest: float = np.inf
    size: float = 0.0
    share: Floats | float = 1.0
    rate: Function | None = None

    def at(self, time: float) -> Floats:
        """Return the values of a prescribed motion, and their slopes, (2, n) or (2, 1)."""
        step = _STEP * self.longest
        values = self.signal(time + step * _STENCIL)
        return np.outer([values[2], _SLOPE @ values / step], self.share)


def pushes(drives: tuple[Drive, ...], time: float, shape: tuple[int, int]) -> Floats:
    """Return the forces and torques of all drives at a time, in the given shape (f, N)."""
    total = np.zeros(shape)
    for each in drives:
        if not each.moves:
            total[each.component, each.spheres] += each.share * each.signal(np.array([time]))[0]
    return total


def imposed(drives: tuple[Drive, ...], time: float, motion: Floats) -> Floats:
    """Return the motion (2f, N) with all prescribed rows set at a time; the same array if nothing is prescribed."""
    moving = [each for each in drives if each.moves]
    if not moving:
        return motion
    motion, freedoms = motion.copy(), len(motion) // 2
    for each in moving:
        motion[each.component, each.spheres], motion[each.component + freedoms, each.spheres] = each.at(time)
    return motion
