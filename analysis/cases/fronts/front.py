"""Front of an impact in a sheet: its arrival and height at each sphere, and its decay with distance.

The front is the first crest of a sphere's speed. Later crests, from reflections inside the lattice, may be higher.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.measure.arrivals import crest
from granular_analysis.measure.norms import slope

Floats = NDArray[np.float64]
SAME_LINE = 1e-6  # diameters by which a sphere may be off a line or a distance; rounding is far smaller


class Front(NamedTuple):
    """Distances (k,) of spheres from the striker, ascending, with the times (k,) and heights (k,) of their crests."""

    distance: Floats
    time: Floats
    height: Floats

    def between(self, least: float, most: float) -> "Front":
        """Return the part of the front beyond one distance and up to another, within rounding."""
        inside = (self.distance > least + SAME_LINE) & (self.distance <= most + SAME_LINE)
        return Front(self.distance[inside], self.time[inside], self.height[inside])

    @property
    def decay(self) -> float:
        """Return β of height ∝ distance^−β, by least squares on logarithms."""
        return -slope(self.distance, self.height)

    @property
    def scaled_speed(self) -> Floats:
        """Return V/height^{1/5} between successive spheres, (k − 1,), with their mean height.

        In the units of an impact, and distances in diameters, the solitary wave of a chain has 0.907470.
        """
        speed = np.diff(self.distance) / np.diff(self.time)
        return np.asarray(speed / np.sqrt(self.height[1:] * self.height[:-1]) ** 0.2)


def front(times: ArrayLike, velocity: Floats, places: Floats, degrees: float) -> Front:
    """Return the front along a direction from the striker.

    Parameters
    ----------
    times : (T,) equally spaced.
    velocity : (T, n, 2).
    places : (n, 2) places of the spheres, relative to the striker, in the unit of the distances.
    degrees : direction from x towards y. Spheres whose centres lie on it and whose speed has a crest are used.

    Raises ValueError if there is no such sphere.
    """
    along = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    distance, across = places @ along, places @ np.array([-along[1], along[0]])
    found = np.flatnonzero((np.abs(across) < SAME_LINE) & (distance > SAME_LINE))
    found = found[np.argsort(distance[found])]
    crests = np.array([crest(times, np.linalg.norm(velocity[:, each], axis=-1)) for each in found]).reshape(-1, 2)
    there = np.isfinite(crests[:, 0])
    if not there.any():
        raise ValueError(f"no recorded sphere at {degrees:g} degrees from the striker has a crest")
    return Front(distance[found][there], *crests[there].T)
