"""Selection rules: waves that two waves cannot generate because a mirror symmetry of the crystal forbids it.

A mirror reflects displacements, and also changes the sign of rotations, because φ is an axial vector. If a mirror does
not change a wave vector (up to a reciprocal lattice vector), each mode there is even or odd: in the plane, on a line
through Γ, L is even, TR and RT are odd. The quadratic forces have the symmetry of the crystal, so the driven field at
k1 ± k2 has

    the parity of the product,   if the mirror changes neither wave vector:
                                 even + even → even,  odd + odd → even,  even + odd → odd;
    even parity,                 if the mirror exchanges the two waves of a sum, which then belong to one branch.

Modes of the other parity at k1 ± k2 are not driven, at any time and for any contact law. For collinear waves along y or
x of the hexagonal lattice, two L waves generate only L, two shear waves only L, and L with a shear wave only shear
waves; the sum of two mirrored waves of one branch generates only L. If the drive does not depend on frequencies, as in
the geometry and law of the paper, the difference of two mirrored waves also generates only L, to second order: the
second wave then runs backward in time, and the mirror perpendicular to the first mirror exchanges the two.

For a single wave, the rules hold at all orders and any amplitude: odd waves along y have q and φ only in odd harmonics.

When it breaks: where branches touch, modes have no parity, and nothing is forbidden.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory.crystal import Crystal
from granular_analysis.theory.mirror import Mirror
from granular_analysis.theory.second_order import Mixed, Wave

__all__ = ["forbidden"]

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

# Modes and wave vectors are exact to 1e-15, and modes of branches that are 1e-6 apart to 1e-9. An operation that is not
# a symmetry differs by more, unless it is this close to one. An overlap differs from 1 by the square.
SAME = 1e-7
_WHOLE = 1 - 1e-13


@lru_cache(maxsize=1)  # every pair of waves in one crystal asks for the mirrors again
def mirrors(crystal: Crystal) -> tuple[Mirror, ...]:
    """Return the mirrors of a crystal; a mirror keeps all directions of contacts, or exchanges some two of them."""
    directions = _apart(crystal.bonds.normal)
    sums = (directions[:, None] + directions).reshape(-1, 3), (directions[:, None] - directions).reshape(-1, 3)
    crosses = np.cross(directions[:, None], directions).reshape(-1, 3)
    found = map(crystal.mirror, _apart(np.concatenate([directions, *sums, crosses])))
    return tuple(each for each in found if each is not None)


def forbidden(pair: Mixed) -> NDArray[np.bool_]:
    """Return for each branch at k1 ± k2, (J,), whether symmetry forbids a pair of waves to drive it.

    Parameters
    ----------
    pair : one pair of waves
    """
    crystal, first, second = pair.crystal, pair.first, pair.second
    targets = Wave(pair.wavevector, pair.targets.frequencies, pair.targets.shapes)
    # With a history the force also contains time derivatives, which differ between waves of opposite frequency
    exchangeable = not crystal.bonds.has_history or first.frequency * second.frequency > 0
    result = np.zeros(targets.frequency.shape, dtype=bool)
    for mirror in mirrors(crystal):
        driven = parity(crystal, mirror, first) * parity(crystal, mirror, second)
        if exchangeable and np.abs(_share(crystal, mirror, first, second)) > _WHOLE:
            driven = np.array(1)
        result |= (driven != 0) & (parity(crystal, mirror, targets) == -driven)
    return result


def parity(crystal: Crystal, mirror: Mirror, wave: Wave) -> NDArray[np.intp]:
    """Return the parity (...) of waves under a mirror: 1 for even waves, −1 for odd waves, 0 for all others."""
    share = _share(crystal, mirror, wave, wave).real
    return np.where(np.abs(share) > _WHOLE, np.sign(share), 0).astype(np.intp)


def _share(crystal: Crystal, mirror: Mirror, one: Wave, other: Wave) -> Complexes:
    """Return the overlap (...) of the mirror image of a wave with another wave; 0 if their wave vectors differ."""
    beyond = mirror.reflection @ one.wavevector - other.wavevector
    if np.abs(np.exp(1j * crystal.vectors @ beyond) - 1.0).max() > SAME:
        return np.zeros(one.shape.shape[:-2], dtype=complex)
    turned = np.repeat(np.exp(1j * crystal.position @ beyond), len(crystal.freedoms))
    image, shape = crystal.moving(one.shape) @ mirror.action.T * turned, crystal.moving(other.shape)
    size = np.linalg.norm(image, axis=-1) * np.linalg.norm(shape, axis=-1)
    return np.asarray(np.sum(shape.conj() * image, axis=-1) / size)


def _apart(vectors: Floats) -> Floats:
    """Return the distinct directions of vectors (N, 3), where opposite vectors have the same direction."""
    found: list[Floats] = []
    for vector, size in zip(vectors, np.linalg.norm(vectors, axis=1), strict=True):
        if size > SAME and not any(abs(vector @ other) > (1 - SAME**2) * size for other in found):
            found.append(vector / size)
    return np.array(found)
