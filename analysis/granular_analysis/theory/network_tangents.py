"""Tangents of contacts, and transport of a slip as the normal n of its contact turns.

In the plane a contact has one tangent, ẑ × n, and spheres turn about z. In space it has two. Let e₁, e₂ and n₀ =
e₁ × e₂ be a frame from the last search of pairs. The smallest rotation that takes n₀ to n takes e_a to the tangent

    t_a = e_a − α_a (n + n₀)/(1 + c),    α_a = e_a·n,  c = n₀·n

The tangents turn about n; a slip s = s₁ t₁ + s₂ t₂ carried with its contact does not turn with them:

    ds₁/dt = rate₁ + ω s₂,   ds₂/dt = rate₂ − ω s₁,    ω = dt₁/dt·t₂ = (ṅ·t₁ α₂ − α₁ ṅ·t₂)/(1 + c)

A contact in space whose frame has e₂ = ẑ and whose normal stays in the plane has the tangent t₁ = ẑ × n, as in the
plane. When it breaks: if a normal turns by π from n₀; pairs are searched again long before.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Vector = Sequence[Any] | NDArray[np.float64]  # components of a vector, each an array of NumPy or JAX
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # for each of x, y, z: the next axis, and the one before
_STEEP = 0.8  # above this |n_z|, e₂ is made from x̂ in place of ẑ


def module_of(array: Any) -> Any:
    """Return the array module, NumPy or JAX, of an array: one code then serves both."""
    return np if isinstance(array, np.ndarray) else array.__array_namespace__()


class Tangents(NamedTuple):
    """Tangents of M contacts in d dimensions; each component of a vector is an array (M,).

    Attributes
    ----------
    along : the d − 1 vectors t_a, of d components.
    about : the d − 1 vectors n × t_a, in the components of a rotation: one in the plane, three in space.
    lean : α_a/(1 + c) of both tangents in space; empty in the plane, where ω is 0.
    """

    along: tuple[Vector, ...]
    about: tuple[Vector, ...]
    lean: Vector


def frames(normal: Floats) -> Floats:
    """Return the frames e₁, e₂ and n₀, (3, 3, M), of normals (3, M) in space; (0, 2, M) of normals in the plane."""
    if len(normal) == 2:
        return np.zeros((0, *normal.shape))
    steep = np.abs(normal[2]) > _STEEP
    second = np.stack([np.where(steep, 1.0, 0.0), np.zeros_like(normal[2]), np.where(steep, 0.0, 1.0)])
    second = second - dot(second, normal) * normal
    second /= np.sqrt(dot(second, second))
    return np.stack([crossed(second, normal), second, normal])


def tangents(frame: Floats, normal: Vector) -> Tangents:
    """Return the tangents of contacts from their present normals and the frames of the last search."""
    if not len(frame):
        return Tangents(((-normal[1], normal[0]),), ((1.0,),), ())
    *both, before = frame
    under = 1 + dot(before, normal)
    lean = tuple(dot(each, normal) / under for each in both)
    between = plus(normal, before)
    one, other = (less(each, scaled(by, between)) for each, by in zip(both, lean, strict=True))
    return Tangents((one, other), (other, scaled(-1.0, one)), lean)


def turned(shear: Vector, across: Vector, lean: Vector) -> Vector:
    """Return the rates (ω s₂, −ω s₁) of the two parts of a slip as the tangents turn about the normal.

    across : ṅ·t_a of both tangents.
    """
    spin = across[0] * lean[1] - lean[0] * across[1]
    return spin * shear[1], -spin * shear[0]


def swerved(rate: Vector, shear: Vector, beyond: Floats) -> Vector:
    """Return the correction to the slip rate beyond the limit that keeps the direction of the slip.

    A sliding contact is cut back to its limit only at the end of a step; until then its slip is `beyond` (M,) times the
    limit, 1 where nothing slides. The cut removes the excess along the slip. Across the slip, the rate must be `beyond`
    times as large, since the shorter slip at the limit turns that much faster.
    """
    square = dot(shear, shear)
    along = quotient(dot(rate, shear), square, square > 0, 0.0)
    return scaled(beyond - 1, less(rate, scaled(along, shear)))


def rebased(shear: Floats, along: Sequence[Vector], frame: Floats) -> Floats:
    """Return the parts (d − 1, M) of slips in new frames of the same normals, from those along the old tangents."""
    if not len(frame):
        return shear  # in the plane the normal alone fixes the tangent
    return np.array([dot(combined(shear, along), each) for each in frame[:2]])


def plus(one: Vector, other: Vector) -> Vector:
    """Return the sum of two vectors."""
    return tuple(a + b for a, b in zip(one, other, strict=True))


def less(one: Vector, other: Vector) -> Vector:
    """Return the difference of two vectors."""
    return tuple(a - b for a, b in zip(one, other, strict=True))


def times(one: Vector, other: Vector) -> Vector:
    """Return the products of the components of two vectors, one for each component."""
    return tuple(a * b for a, b in zip(one, other, strict=True))


def scaled(factor: Any, vector: Vector) -> Vector:
    """Return a vector times a number."""
    return tuple(factor * each for each in vector)


def dot(one: Vector, other: Vector) -> Any:
    """Return the scalar products (M,) of vectors."""
    total = one[0] * other[0]
    for way in range(1, len(one)):
        total = total + one[way] * other[way]
    return total


def quotient(over: Floats, under: Floats, where: NDArray[np.bool_], otherwise: float) -> Floats:
    """Return over/under where `where` is True, and the number `otherwise`, with gradient 0, elsewhere."""
    xp = module_of(under)
    return xp.where(where, over / xp.where(where, under, 1.0), otherwise)


def root_of(square: Floats) -> Floats:
    """Return the square root of numbers ≥ 0; its gradient at 0 is taken to be 0."""
    xp = module_of(square)
    return xp.where(square > 0, xp.sqrt(xp.where(square > 0, square, 1.0)), 0.0)


def length(vector: Vector) -> Floats:
    """Return the lengths (M,) of vectors."""
    return root_of(dot(vector, vector))


def crossed(one: Floats, other: Floats) -> Floats:
    """Return the cross products (3, ...) of vectors (3, ...); np.cross takes three times as long for a few vectors."""
    return one[_NEXT] * other[_LAST] - one[_LAST] * other[_NEXT]


def combined(parts: Vector, vectors: Sequence[Vector]) -> Vector:
    """Return the vector Σ_a parts_a vectors_a."""
    return tuple(dot(parts, each) for each in zip(*vectors, strict=True))
