"""Mirrors of a crystal: where its spheres go, and how fields change."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_SAME = 1e-9  # share of a vector of the lattice, and of a mass, that is rounding


class Mirror(NamedTuple):
    """A mirror of a crystal: its unit normal (3,), and how it acts on the components that move (F, F)."""

    normal: Floats
    action: Floats

    @property
    def reflection(self) -> Floats:
        """Return the matrix (3, 3) by which it turns vectors round."""
        return np.eye(3) - 2 * np.outer(self.normal, self.normal)


def images(position: Floats, vectors: Floats, mass: Floats, reflection: Floats, to: int) -> NDArray[np.intp] | None:
    """Return where each sphere goes (B,) if the first goes to `to`; None if not all go to equal spheres.

    position, mass : (B, 3) and (B, 6) of a cell that repeats by vectors (d, 3); reflection : (3, 3)
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
