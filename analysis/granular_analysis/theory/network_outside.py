"""Drives of a packing of spheres: pushes and prescribed motions.

A drive is a signal over time: a force along x, y or z, a torque, or the displacement or turn of spheres, which then do
nothing else. Their velocity is the slope of the signal, by differences that err by 1e-10 of it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
Function = Callable[[Floats], Floats]
# Steps of the five-point difference, and its weights: truncation and rounding both leave 1e-10 at h/longest = 1e-3
_STENCIL = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
_SLOPE = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12
_STEP = 1e-3


@dataclass(frozen=True, eq=False)
class Drive:
    """A signal that pushes or moves spheres.

    Attributes
    ----------
    spheres : (n,) indices.
    component : 0 and 1 along x and y, 2 turning; in space 0 to 2 along x, y and z, 3 to 5 turning about them.
    signal : of times (T,): a force, a torque, a displacement or an angle.
    moves : whether it prescribes the motion.
    longest : time in which the signal changes; no step of an integration is longer.
    size : largest value of the signal.
    share : (n,) factors of the signal on each sphere.
    rate : velocity that contacts see in a step of `network_verlet`, at its end as of ``fix move``; None: its mean.
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
    """Return the forces and torques of all drives at a time, of a shape (freedoms, N)."""
    total = np.zeros(shape)
    for each in drives:
        if not each.moves:
            total[each.component, each.spheres] += each.share * each.signal(np.array([time]))[0]
    return total


def imposed(drives: tuple[Drive, ...], time: float, motion: Floats) -> Floats:
    """Return a motion (2·freedoms, N) with what drives prescribe at a time; itself if they prescribe nothing."""
    moving = [each for each in drives if each.moves]
    if not moving:
        return motion
    motion, freedoms = motion.copy(), len(motion) // 2
    for each in moving:
        motion[each.component, each.spheres], motion[each.component + freedoms, each.spheres] = each.at(time)
    return motion
