"""Tangents of contacts, and how a slip is carried along as the normal n of its contact turns.

In the plane there is one tangent, ẑ × n, and one turn, about z. In space there are two: with e₁, e₂ and n₀ = e₁ × e₂
of a moment when pairs were searched, the least rotation that takes n₀ to n takes e_a to

    t_a = e_a − α_a (n + n₀)/(1 + c),    α_a = e_a·n,  c = n₀·n

These turn about n, which a slip s = s₁ t₁ + s₂ t₂ does not that is transported with its contact:

    ds₁/dt = rate₁ + ω s₂,   ds₂/dt = rate₂ − ω s₁,    ω = dt₁/dt·t₂ = (ṅ·t₁ α₂ − α₁ ṅ·t₂)/(1 + c)

Contacts in the plane have e₂ = ẑ, so t₁ is the tangent there. When it breaks: for a normal that turns by π from n₀;
pairs are searched again long before.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_ACROSS = np.array([[-1.0], [1.0]])  # ẑ × (x, y) is (−y, x)
_ABOUT_Z = np.ones((1, 1, 1))
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # the axes after x, y, z, in turn, and before them
_STEEP = 0.8  # n_z from which e₂ is made from x̂ in place of ẑ


class Tangents(NamedTuple):
    """Tangents of M contacts in d dimensions.

    Attributes
    ----------
    along : (d, d − 1, M) t_a.
    about : (1 or 3, d − 1, M or 1) n × t_a, in the turns that spheres have.
    lean : (d − 1, M) α_a/(1 + c); None in the plane, where ω is 0.
    """

    along: Floats
    about: Floats
    lean: Floats | None


def frames(normal: Floats) -> Floats:
    """Return e₁, e₂ and n₀ (3, 3, M) of contacts in space by their normals (3, M); none, (0, 2, M), in the plane."""
    if len(normal) == 2:
        return np.zeros((0, *normal.shape))
    steep = np.abs(normal[2]) > _STEEP
    second = np.stack([np.where(steep, 1.0, 0.0), np.zeros_like(normal[2]), np.where(steep, 0.0, 1.0)])
    second = second - dot(second, normal) * normal
    second /= np.sqrt(dot(second, second))
    return np.stack([crossed(second, normal), second, normal])


def tangents(frame: Floats, normal: Floats) -> Tangents:
    """Return the tangents of contacts with the normals (d, M), in the frames of their search."""
    if not len(frame):
        return Tangents((normal[::-1] * _ACROSS)[:, None], _ABOUT_Z, None)
    *both, before = frame
    lean = np.stack([dot(each, normal) for each in both]) / (1 + dot(before, normal))
    along = np.stack(both, axis=1) - lean * (normal + before)[:, None]
    return Tangents(along, np.stack([along[:, 1], -along[:, 0]], axis=1), lean)


def turned(shear: Floats, across: Floats, lean: Floats) -> Floats:
    """Return the rate (2, M) at which tangents that turn about the normal change the parts of a slip (2, M).

    across : (2, M) t_a·ṅ.
    """
    spin = across[0] * lean[1] - lean[0] * across[1]
    return np.stack([spin * shear[1], -spin * shear[0]])


def swerved(rate: Floats, shear: Floats, beyond: Floats) -> Floats:
    """Return what the rate (2, M) of a slip that goes beyond its limit needs more, so that it has the right direction.

    Along a slip the limit takes what is beyond it at the end of a step; across, the slip of the limit turns as many
    times faster as the slip is `beyond` (M,) it, 1 where nothing slides.
    """
    square = dot(shear, shear)
    along = np.divide(dot(rate, shear), square, out=np.zeros_like(square), where=square > 0)
    return (beyond - 1) * (rate - along * shear)


def rebased(shear: Floats, along: Floats, frame: Floats) -> Floats:
    """Return the parts (d − 1, M) of slips, known along tangents (d, d − 1, M), in new frames of the same normals."""
    if not len(frame):
        return shear  # the normal alone says the tangent
    return np.einsum("am,dam,bdm->bm", shear, along, frame[:2])


def dot(one: Floats, other: Floats) -> Floats:
    """Return the scalar products (...) of vectors (d, ...)."""
    total = one[0] * other[0]
    for way in range(1, len(one)):
        total += one[way] * other[way]
    return total


def crossed(one: Floats, other: Floats) -> Floats:
    """Return the vector products (3, ...) of vectors (3, ...); NumPy's take three times as long for a few."""
    return one[_NEXT] * other[_LAST] - one[_LAST] * other[_NEXT]


def combined(parts: Floats, vectors: Floats) -> Floats:
    """Return Σ parts·vectors (d, M) of parts (T, M) along vectors (d, T, M)."""
    return np.array([dot(parts, each) for each in vectors])
