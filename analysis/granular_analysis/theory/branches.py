"""Names of the branches of any crystal at a wave vector: L, TR, RT, names from a mirror (S1, H1, …), and numbers.

With one sphere per cell, L moves along k, TR is the lower and RT the upper of the other in-plane branches. In space
these names exist where every mode at this k moves either only in the plane (u_x, u_y, φ_z) or only out of it; no mirror
of the crystal is needed, for example for fcc along [111]. S1, S2, … are even and H1, H2, … odd under the mirror whose
plane contains k and z, if the crystal has that mirror. Numbers count from 1 by frequency; planar crystals have them
only with several spheres per cell.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.crystal import PLANE, Crystal, padded
from granular_analysis.theory.errors import TheoryError

Complexes = NDArray[np.complex128]
NAMES = ("L", "TR", "RT")
_ROUNDING = 1e-6  # share of the squared motion of a mode that is rounding


def named_branch(crystal: Crystal, wavevector: ArrayLike, name: str) -> int:
    """Return the index, from 0 by frequency, of the branch with a name at a wave vector (2,) or (3,).

    Raises ValueError for a name that no branch of the crystal has there.
    """
    return branch_named(names_of(crystal, wavevector), name)


def branch_named(known: Mapping[str, int], name: str) -> int:
    """Return the index of a named branch from the result of `names_of`; ValueError if the name is unknown there."""
    if name in known:
        return known[name]
    raise TheoryError(f"mode = {name!r} is not a branch of this crystal; allowed: {', '.join(known)}")


def names_of(crystal: Crystal, wavevector: ArrayLike, shapes: Complexes | None = None) -> dict[str, int]:
    """Return branch indices by name at a wave vector (2,) or (3,): names from symmetry first, then numbers.

    shapes : (J, B, 6) modes at the wave vector; None: they are computed.
    """
    k = np.asarray(wavevector, dtype=float)
    solid, along = 2 in crystal.freedoms, padded(k) / np.linalg.norm(k)
    shapes = crystal.modes(k).shapes if shapes is None else shapes
    found: dict[str, Any] = {}
    parts = np.abs(shapes[:, 0]) ** 2
    level = parts[:, list(PLANE)].sum(axis=1) / parts.sum(axis=1)  # share of the motion of a mode in the plane
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
