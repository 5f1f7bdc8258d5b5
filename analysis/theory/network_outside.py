"""Loads on a packing of spheres from outside: rigid walls, pushes and prescribed motions.

A wall is a plane at rest. A sphere that reaches it touches it by the contact laws of `analysis.theory.network`, with

    1/E* = (1 − ν²)/E,   1/G* = 2(2 − ν)(1 + ν)/E,   Rc = R,   n = −(the normal of the plane into the packing)

which is a contact with a held sphere whose radius has no bound. `analysis.theory.network_state` makes it one: the
normal of a sphere of 1e9 radii turns by 1e-9 of the way of the other one, relative to R.

A drive is a signal over time: a force along x or y, a torque, or the displacement along x or y or the angle of spheres,
which then do nothing else. Their velocity is the slope of the signal, by differences that err by 1e-10 of it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
Function = Callable[[Floats], Floats]
# Steps of the five-point difference, and its weights: truncation and rounding both leave 1e-10 at h/longest = 1e-3
_STENCIL = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
_SLOPE = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12
_STEP = 1e-3


@dataclass(frozen=True)
class Wall:
    """A rigid plane at rest, across x (axis 0) or y (1), with the packing beyond it (side 1) or before it (−1)."""

    axis: Literal[0, 1]
    place: float
    side: Literal[-1, 1]

    @property
    def normal(self) -> Floats:
        """Return the unit vector from the packing into the wall, (2,)."""
        vector = np.zeros(2)
        vector[self.axis] = -self.side
        return vector


@dataclass(frozen=True, eq=False)
class Drive:
    """A signal that pushes or moves spheres.

    Attributes
    ----------
    spheres : (n,) indices.
    component : 0 and 1 along x and y, 2 turning.
    signal : of times (T,): a force, a torque, a displacement or an angle.
    moves : whether it prescribes the motion.
    longest : time in which the signal changes; no step of an integration is longer.
    size : largest value of the signal.
    share : (n,) factors of the signal on each sphere.
    """

    spheres: Integers
    component: Literal[0, 1, 2]
    signal: Function
    moves: bool = False
    longest: float = np.inf
    size: float = 0.0
    share: Floats | float = 1.0

    def at(self, time: float) -> Floats:
        """Return the values of a prescribed motion, and their slopes, (2, n) or (2, 1)."""
        step = _STEP * self.longest
        values = self.signal(time + step * _STENCIL)
        return np.outer([values[2], _SLOPE @ values / step], self.share)


def pushes(drives: tuple[Drive, ...], time: float, spheres: int) -> Floats:
    """Return the forces in x and y and torques of all drives at a time, (3, N)."""
    total = np.zeros((3, spheres))
    for each in drives:
        if not each.moves:
            total[each.component, each.spheres] += each.share * each.signal(np.array([time]))[0]
    return total


def imposed(drives: tuple[Drive, ...], time: float, motion: Floats) -> Floats:
    """Return a motion (6, N) with what drives prescribe at a time; itself if they prescribe nothing."""
    moving = [each for each in drives if each.moves]
    if not moving:
        return motion
    motion = motion.copy()
    for each in moving:
        motion[each.component, each.spheres], motion[each.component + 3, each.spheres] = each.at(time)
    return motion
