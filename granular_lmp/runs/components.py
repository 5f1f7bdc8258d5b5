"""Components of the motion of spheres by name: u, v and φ in the plane; u, v, w and φ about each axis in space."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
MOTION = {2: ("u", "v", "phi"), 3: ("u", "v", "w", "phix", "phiy", "phiz")}  # by `Scene.space`
NAMES = (*MOTION[2], *MOTION[3][2:])
RATES = tuple(f"{name}_t" for name in NAMES)
_VECTORS = ("shear", "rolling")
FORCES = ("normal", *(f"{name}{axis}" for name in _VECTORS for axis in ("", "_x", "_y", "_z")))  # axes of contacts


def components(displacement: Floats, rotation: Floats) -> dict[str, Floats]:
    """Return displacement (..., 2) and rotation (...), in space (..., 3) each, as components (...) by name.

    Velocity and spin use the same names.
    """
    moves = np.moveaxis(displacement, -1, 0)
    turns = [rotation] if len(moves) == 2 else np.moveaxis(rotation, -1, 0)
    return dict(zip(MOTION[len(moves)], (*moves, *turns), strict=True))


def rates(velocity: Floats, spin: Floats) -> dict[str, Floats]:
    """Return velocity and spin as `components` does, each named NAME_t."""
    return {f"{name}_t": values for name, values in components(velocity, spin).items()}


def by_axis(name: str, values: Floats) -> dict[str, Floats]:
    """Return a quantity by name: NAME for numbers (T, C); NAME_x, NAME_y, NAME_z for vectors (T, C, 3)."""
    if values.ndim == 2:
        return {name: values}
    return {f"{name}_{axis}": each for axis, each in zip("xyz", np.moveaxis(values, -1, 0), strict=True)}


def in_space(vectors: Floats) -> Floats:
    """Return vectors (N, 2) or (N, 3) with three components, z = 0 in the plane."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))
