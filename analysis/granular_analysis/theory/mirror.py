"""Mirrors of a crystal: the images of its spheres and of fields on them."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_SAME = 1e-9  # rounding, as a share of a lattice vector or of a mass


class Mirror(NamedTuple):
    """Mirror of a crystal: its unit normal (3,), and its action as a matrix (F, F) on the components that move."""

    normal: Floats
    action: Floats

    @property
    def reflection(self) -> Floats:
        """Return the matrix (3, 3) that reflects vectors."""
        return np.eye(3) - 2 * np.outer(self.normal, self.normal)


def images(position: Floats, vectors: Floats, mass: Floats, reflection: Floats, to: int) -> NDArray[np.intp] | None:
    """Return the sphere (B,) onto which each is reflected if the first goes to `to`; None if there is no such mirror.

    Every image must coincide with a sphere of equal mass, up to a lattice vector.

    Parameters
    ----------
    position : (B, 3) centres of the spheres of a cell
    vectors : (d, 3) lattice vectors
    mass : (B, 6) masses
    reflection : (3, 3) matrix of the mirror
    to : image of the first sphere
    """
    shift = position[to] - reflection @ position[0]
    image = position @ reflection.T + shift
    apart = image[:, None] - position
    cells = apart @ np.linalg.pinv(vectors)
    left = np.linalg.norm(apart - np.round(cells) @ vectors, axis=-1)
    same = left < _SAME * np.linalg.norm(vectors[0])
    same &= np.isclose(mass[:, None, 0], mass[:, 0], rtol=_SAME)
    return np.argmax(same, axis=1) if np.all(same.any(axis=1)) else None


def mirrored(field: NDArray[Any], reflection: Floats, places: NDArray[np.intp]) -> NDArray[Any]:
    """Return the mirror image of a field (..., B, 6); a rotation is an axial vector."""
    result = np.empty_like(field)
    result[..., places, :3] = field[..., :3] @ reflection.T
    result[..., places, 3:] = -(field[..., 3:] @ reflection.T)
    return result
