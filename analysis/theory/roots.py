"""Zeros of many functions of one number at once: Chandrupatla's method, a bisection that interpolates where it may."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_CLOSE = 1e-14  # share of a zero
_TURNS = 100  # of which interpolation takes about ten, and bisection alone 47


def crossings(values: Callable[[Floats], Floats], low: Floats, high: Floats) -> Floats:
    """Return where functions cross 0, (N,), each between two numbers at which its signs differ.

    Parameters
    ----------
    values : of the N functions at the numbers (N,).
    low, high : (N,) ends of the brackets.

    Raises ValueError for a bracket at whose ends a function has one sign.

    Source: T. R. Chandrupatla, Advances in Engineering Software 28, 145 (1997).
    """
    one, other = np.array(low, dtype=float), np.array(high, dtype=float)
    at_one, at_other = values(one), values(other)
    if np.any(np.sign(at_one) * np.sign(at_other) > 0):
        raise ValueError("a function has one sign at both ends of its bracket")
    part = np.full(one.shape, 0.5)
    for _ in range(_TURNS):
        middle = one + part * (other - one)
        at_middle = values(middle)
        same = np.sign(at_middle) == np.sign(at_one)
        # The last of three numbers is the one that the bracket has lost
        last, at_last = np.where(same, one, other), np.where(same, at_one, at_other)
        other, at_other = np.where(same, other, one), np.where(same, at_other, at_one)
        one, at_one = middle, at_middle
        nearer = np.abs(at_one) < np.abs(at_other)
        best, least = np.where(nearer, one, other), _CLOSE * np.abs(np.where(nearer, one, other))
        done = (np.abs(other - one) <= 2 * least) | (np.where(nearer, at_one, at_other) == 0)
        if done.all():
            break
        part = np.where(done, 0.0, _interpolated((one, other, last), (at_one, at_other, at_last), least))
    return best


def _interpolated(
    places: tuple[Floats, Floats, Floats], values: tuple[Floats, Floats, Floats], least: Floats
) -> Floats:
    """Return the share of the way from the first place to the second at which the inverse parabola is 0.

    It is a half where that parabola is not to be trusted, and leaves a least distance to both.
    """
    (a, b, c), (f, g, h) = places, values
    with np.errstate(divide="ignore", invalid="ignore"):
        place, value, nearest = (a - b) / (c - b), (f - g) / (h - g), least / np.abs(b - a)
        trusted = (value**2 < place) & ((1 - value) ** 2 < 1 - place)
        part = f / (f - g) * h / (h - g) - (c - a) / (b - a) * f / (h - f) * g / (g - h)
        return np.clip(np.where(trusted, part, 0.5), nearest, 1 - nearest)
