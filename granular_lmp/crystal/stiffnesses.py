"""Factors of contact stiffnesses that differ from the law of the materials: measured, by pair of kinds, or spread.

A factor scales the force of a law at every overlap. Unloaded contacts keep their overlap, so spheres at rest in a
lattice stay at rest, and the second derivative of the force scales as the first derivative does.

**Measured.** A measured stiffness K at rest gives the factor c = K/k(δ) of the normal force, at the overlap δ where
c f_N(δ) equals the load F0 of a contact; the shear stiffness is measured at the same δ. Measured stiffnesses can be
given for all contacts of the lattice (``[contact]``), for two kinds (``[[pair]]``) and for contacts with a half-space
(``[substrate]``).

**Kinds.** Kind 0 is the spheres of the lattice, and kind n the spheres of the n-th inclusion. Factors of two kinds
multiply the factors of the lattice.

**Spread.** Each sphere belongs at random to one of eight classes of equal size, because LAMMPS has coefficients by pair
of types. Class c has the deviate g_c, the mean of a Gaussian over its eighth of the probability, scaled to unit
variance:

    factor of a contact of classes c and d = 1 + σ (g_c + g_d)/√2,    of a contact with a wall 1 + σ g_c

Both have the standard deviation σ. Contacts that share a sphere are correlated, as if spheres differed in roughness.
"""

from collections.abc import Sequence
from itertools import product
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.adhesion_laws import ADHESION_LAWS, AdhesionLaw
from granular_lmp.crystal.contacts import mixed
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.frozen import dataclass

Floats = NDArray[np.float64]
CLASSES = 8
WIDEST = 0.3  # with this spread the softest contact has 0.28 of the mean stiffness
_ROUNDS = 60  # each round reduces the error of a factor by at least a third
_ROUNDING = 1e-15


class Measured(Protocol):
    """Contact whose stiffnesses at rest, N/m, may be declared; None: from the law."""

    @property
    def normal_stiffness(self) -> float | None:
        """Stiffness along the line of centres, N/m; None: from the law."""

    @property
    def shear_stiffness(self) -> float | None:
        """Stiffness across the line of centres, N/m; None: from the law."""


@dataclass(frozen=True)
class Pair:
    """Measured stiffnesses, N/m, of the contact at rest between two kinds `of` spheres; None: from the law."""

    of: Sequence[int] = ()
    normal_stiffness: float | None = None
    shear_stiffness: float | None = None


def measured_factors(measured: Measured, law: AdhesionLaw, load: float) -> tuple[float, float]:
    """Return the factors of the normal and shear force for a contact with this law under a load (N)."""
    factor, normal, shear = 1.0, measured.normal_stiffness, measured.shear_stiffness
    if normal is not None:
        for _ in range(_ROUNDS):
            before = factor
            factor = normal / float(law.normal_stiffness(law.overlap_under(load / before)))
            if abs(factor / before - 1) < _ROUNDING:
                break
    if shear is None:
        return factor, 1.0
    return factor, shear / float(law.shear_stiffness(law.overlap_under(load / factor)))


def deviates() -> Floats:
    """Return the deviates of the classes, (8,), ascending, with mean 0 and variance 1."""
    from statistics import NormalDist  # kept out of start-up

    gaussian = NormalDist()
    edges = [gaussian.inv_cdf(number / CLASSES) for number in range(1, CLASSES)]
    density = np.array([0.0, *map(gaussian.pdf, edges), 0.0])
    means = CLASSES * (density[:-1] - density[1:])
    return np.asarray(means / np.sqrt(np.mean(means**2)))


def spread(factors: Floats, deviation: float) -> Floats:
    """Return the factors of materials divided into classes; material m of class c has the index 8m + c."""
    own = deviates()
    both = np.concatenate([(own[:, None] + own) / np.sqrt(2), own[:, None]], axis=1)
    return _divided(factors, 1 + deviation * both[..., None])


def by_level(factors: Floats, levels: Floats) -> Floats:
    """Return the factors of materials divided into L stiffness levels; material m of level l has the index L m + l.

    `levels` are factors of the normal and shear stiffness of spheres, (L, 2) (`granular_lmp.crystal.sphere_table`).
    """
    one, other = levels[:, None], levels[None]
    return _divided(factors, np.concatenate([2 * one * other / (one + other), one], axis=1))


def _divided(factors: Floats, among: Floats) -> Floats:
    """Return the factors (MC, MC + 1, 2) after each of M materials is divided into C kinds.

    `among`, (C, C + 1, 1 or 2), are the factors of contacts between these kinds and, last, with walls.
    """
    count, kinds = len(factors), len(among)
    columns = np.append(np.repeat(np.arange(count), kinds), count)
    of_kind = np.append(np.tile(np.arange(kinds), count), kinds)
    of_materials = np.repeat(factors, kinds, axis=0)[:, columns]
    return np.asarray(of_materials * np.tile(among, (count, 1, 1))[:, of_kind])


def factors_of(
    materials: Sequence[Sphere], kinds: Sequence[int], radii: Sequence[float], pairs: Sequence[Pair]
) -> Floats:
    """Return the factors of contacts between materials and, last, with walls, (M, M + 1, 2).

    Parameters
    ----------
    materials : (M,)
        Materials by index.
    kinds : (M,)
        Kind of each material; −1 for a kind without a pair.
    radii : by kind
        Radii, m.
    pairs : sequence of Pair
        Pairs of kinds with measured stiffnesses; all other contacts have the factor 1.
    """
    found = np.ones((len(materials), len(materials) + 1, 2))
    for pair, (m, n) in product(pairs, np.ndindex(len(materials), len(materials))):
        if sorted(pair.of) == sorted((kinds[m], kinds[n])):
            one, other = radii[kinds[m]], radii[kinds[n]]
            law = _law(materials[m], materials[n], one * other / (one + other))
            found[m, n] = measured_factors(pair, law, materials[0].contact_force)
    return found


def _law(one: Sphere, other: Sphere, radius: float) -> AdhesionLaw:
    modulus, shear_modulus, adhesion = (float(each[0]) for each in mixed(one, other))
    law = ADHESION_LAWS[one.adhesion_law].between(modulus, shear_modulus, radius, adhesion)
    return law.times(*one.factors)
