"""Names of the branches of any crystal at a wave vector: those that its mirrors give, and numbers from 1.

L moves along k; of TR and RT the former is lower. In space, of one sphere a cell, they are the waves that stay in the
plane, where every wave of this k stays in it or leaves it; that needs no mirror of the crystal, as fcc along [111].
S1, S2, … and H1, H2, … are even and odd across the plane of k and z. In the plane a branch has its number in a cell of
several spheres alone.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.crystal import PLANE, Crystal, padded
from granular_analysis.theory.errors import TheoryError

Complexes = NDArray[np.complex128]
NAMES = ("L", "TR", "RT")
_ROUNDING = 1e-6  # share of the energy of a mode that is none


def named_branch(crystal: Crystal, wavevector: ArrayLike, name: str) -> int:
    """Return which branch has a name.

    Raises ValueError for a name that none of the crystal's branches has there.
    """
    return branch_named(names_of(crystal, wavevector), name)


def branch_named(known: Mapping[str, int], name: str) -> int:
    """Return the branch of a name among those of `names_of`; ValueError if it is none of them."""
    if name in known:
        return known[name]
    raise TheoryError(f"mode = {name!r} is none of this crystal; allowed: {', '.join(known)}")


def names_of(crystal: Crystal, wavevector: ArrayLike, shapes: Complexes | None = None) -> dict[str, int]:
    """Return the branches by name, at a wave vector (2,) or (3,); those that symmetry names before their numbers.

    shapes : of the modes there, if they are known.
    """
    k = np.asarray(wavevector, dtype=float)
    solid, along = 2 in crystal.freedoms, padded(k) / np.linalg.norm(k)
    shapes = crystal.modes(k).shapes if shapes is None else shapes
    found: dict[str, Any] = {}
    parts = np.abs(shapes[:, 0]) ** 2
    level = parts[:, list(PLANE)].sum(axis=1) / parts.sum(axis=1)  # share of a mode that stays in the plane
    if len(crystal) == 1 and np.all((level < _ROUNDING) | (level > 1 - _ROUNDING)):
        inside = np.flatnonzero(level > 0.5)
        longitudinal = inside[np.argmax(np.abs(shapes[inside, 0, :3] @ along))]
        found |= dict(zip(NAMES, [longitudinal, *inside[inside != longitudinal]], strict=False))
    across = np.cross([0.0, 0.0, 1.0], along)
    if solid and (mirror := crystal.mirror(across)) is not None:
        sides = crystal.parity(shapes, k, mirror)
        for letter, side in (("S", 1), ("H", -1)):
            found |= {f"{letter}{n + 1}": branch for n, branch in enumerate(np.flatnonzero(sides == side))}
    if solid or len(crystal) > 1:
        found |= {str(n + 1): n for n in range(len(shapes))}
    return {name: int(branch) for name, branch in found.items()}
