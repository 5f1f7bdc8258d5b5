"""Tangents of contacts, and how a slip is carried along as the normal n of its contact turns.

In the plane there is one tangent, ẑ × n, and one turn, about z. In space there are two: with e₁, e₂ and n₀ = e₁ × e₂
of a moment when pairs were searched, the least rotation that takes n₀ to n takes e_a to

    t_a = e_a − α_a (n + n₀)/(1 + c),    α_a = e_a·n,  c = n₀·n

These turn about n, which a slip s = s₁ t₁ + s₂ t₂ does not that is transported with its contact:

    ds₁/dt = rate₁ + ω s₂,   ds₂/dt = rate₂ − ω s₁,    ω = dt₁/dt·t₂ = (ṅ·t₁ α₂ − α₁ ṅ·t₂)/(1 + c)

Contacts in the plane have e₂ = ẑ, so t₁ is the tangent there. When it breaks: for a normal that turns by π from n₀;
pairs are searched again long before.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Vector = Sequence[Any] | NDArray[np.float64]  # its components, arrays of NumPy or of JAX
_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # the axes after x, y, z, in turn, and before them
_STEEP = 0.8  # n_z from which e₂ is made from x̂ in place of ẑ


def module_of(array: Any) -> Any:
    """Return the module of an array: NumPy, or that of JAX, which traces the same lines."""
    return np if isinstance(array, np.ndarray) else array.__array_namespace__()


class Tangents(NamedTuple):
    """Tangents of M contacts in d dimensions; vectors are their components, (M,) each.

    Attributes
    ----------
    along : d − 1 vectors t_a of d components.
    about : d − 1 vectors n × t_a, in the turns that spheres have: of one component, or three.
    lean : d − 1 numbers α_a/(1 + c); none in the plane, where ω is 0.
    """

    along: tuple[Vector, ...]
    about: tuple[Vector, ...]
    lean: Vector


def frames(normal: Floats) -> Floats:
    """Return e₁, e₂ and n₀ (3, 3, M) of contacts in space by their normals (3, M); none, (0, 2, M), in the plane."""
    if len(normal) == 2:
        return np.zeros((0, *normal.shape))
    steep = np.abs(normal[2]) > _STEEP
    second = np.stack([np.where(steep, 1.0, 0.0), np.zeros_like(normal[2]), np.where(steep, 0.0, 1.0)])
    second = second - dot(second, normal) * normal
    second /= np.sqrt(dot(second, second))
    return np.stack([crossed(second, normal), second, normal])


def tangents(frame: Floats, normal: Vector) -> Tangents:
    """Return the tangents of contacts with some normals, in the frames of their search."""
    if not len(frame):
        return Tangents(((-normal[1], normal[0]),), ((1.0,),), ())
    *both, before = frame
    under = 1 + dot(before, normal)
    lean = tuple(dot(each, normal) / under for each in both)
    between = plus(normal, before)
    one, other = (less(each, scaled(by, between)) for each, by in zip(both, lean, strict=True))
    return Tangents((one, other), (other, scaled(-1.0, one)), lean)


def turned(shear: Vector, across: Vector, lean: Vector) -> Vector:
    """Return the rate at which tangents that turn about the normal change the two parts of a slip.

    across : t_a·ṅ.
    """
    spin = across[0] * lean[1] - lean[0] * across[1]
    return spin * shear[1], -spin * shear[0]


def swerved(rate: Vector, shear: Vector, beyond: Floats) -> Vector:
    """Return what the rate of a slip that goes beyond its limit needs more, so that it has the right direction.

    Along a slip the limit takes what is beyond it at the end of a step; across, the slip of the limit turns as many
    times faster as the slip is `beyond` (M,) it, 1 where nothing slides.
    """
    square = dot(shear, shear)
    along = quotient(dot(rate, shear), square, square > 0, 0.0)
    return scaled(beyond - 1, less(rate, scaled(along, shear)))


def rebased(shear: Floats, along: Sequence[Vector], frame: Floats) -> Floats:
    """Return the parts (d − 1, M) of slips, known along tangents, in new frames of the same normals."""
    if not len(frame):
        return shear  # the normal alone says the tangent
    return np.array([dot(combined(shear, along), each) for each in frame[:2]])


def plus(one: Vector, other: Vector) -> Vector:
    """Return the sum of two vectors."""
    return tuple(a + b for a, b in zip(one, other, strict=True))


def less(one: Vector, other: Vector) -> Vector:
    """Return the difference of two vectors."""
    return tuple(a - b for a, b in zip(one, other, strict=True))


def times(one: Vector, other: Vector) -> Vector:
    """Return the products of the components of two vectors."""
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
    """Return quotients where they are asked for, and a number elsewhere, whose gradient is 0."""
    xp = module_of(under)
    return xp.where(where, over / xp.where(where, under, 1.0), otherwise)


def root_of(square: Floats) -> Floats:
    """Return √ of numbers that are not negative; the gradient is 0 at 0."""
    xp = module_of(square)
    return xp.where(square > 0, xp.sqrt(xp.where(square > 0, square, 1.0)), 0.0)


def length(vector: Vector) -> Floats:
    """Return the lengths (M,) of vectors."""
    return root_of(dot(vector, vector))


def crossed(one: Floats, other: Floats) -> Floats:
    """Return the vector products (3, ...) of vectors (3, ...); NumPy's take three times as long for a few."""
    return one[_NEXT] * other[_LAST] - one[_LAST] * other[_NEXT]


def combined(parts: Vector, vectors: Sequence[Vector]) -> Vector:
    """Return Σ parts·vectors, a vector."""
    return tuple(dot(parts, each) for each in zip(*vectors, strict=True))
