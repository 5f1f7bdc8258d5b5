"""Measured stiffnesses of contacts, and their spread: the factors of their forces.

A stiffness that is declared in N/m at rest scales the force of its contact at every overlap. With the law P(δ), k(δ) of
the moduli, and the load F0 on a contact at rest, the normal stiffness K takes the factor c = K/k(δ) at the δ where
c P(δ) = F0; the shear stiffness is declared of the same δ.

Spheres of stiffnesses with a spread σ are in eight classes, whose deviates g are the means of a Gaussian over eighths
of the probability, of variance 1: contacts of classes c and d have the factor 1 + σ(g_c + g_d)/√2, with a wall 1 + σ g.

Spheres to which a table gives factors s are of as many kinds as there are pairs of a normal and a shear factor, the
first 1 and 1. Their contacts are springs in series, 2/(1/s_i + 1/s_j), and s with a wall.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory.bonds import AT_REST, Law
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network import Material, mixed
from granular_analysis.theory.network_laws import Adhesion
from granular_lmp.runs.record import Scene

Floats = NDArray[np.float64]
CLASSES = 8
_FACTORS = "normal_stiffness", "shear_stiffness"  # of a table of spheres
_WIDE = 1e4  # an overlap at rest is sought up to as many times that of the force that the moduli give


class Kind(NamedTuple):
    """Constants of the spheres of a material, SI; the radius is None for that of the lattice.

    number : 0 of the lattice, n of the n-th inclusion if a pair names it, −1 of any other.
    """

    youngs_modulus: float
    poisson_ratio: float
    work_of_adhesion: float
    number: int = 0
    radius: float | None = None


def kinds_of(scene: Scene) -> list[Kind]:
    """Return the materials of a scene, by number of the types in its deck: the lattice's, then each that is new.

    An inclusion that a pair names has a material of its own.
    """
    sphere, adheres = scene.material, scene.effects.adhesion is not False
    own = Kind(sphere.youngs_modulus, sphere.poisson_ratio, sphere.work_of_adhesion * adheres)
    found, named = [own], {kind for pair in scene.pair for kind in pair.of}
    for number, each in enumerate(scene.inclusion, 1):
        given = {name: getattr(each, name) for name in Kind._fields[:3] if getattr(each, name) is not None}
        kind = own._replace(**given, radius=each.radius)
        kind = kind._replace(number=number if number in named else -(kind[:3] != own[:3]))
        if kind[:4] not in [other[:4] for other in found]:
            found.append(kind)
    return found


def deviates() -> Floats:
    """Return the deviates of the classes, (8,)."""
    from scipy.special import ndtri  # slow to import, and only spreads need it

    edges = ndtri(np.linspace(0, 1, CLASSES + 1))
    means = -np.diff(np.exp(-(edges**2) / 2))  # over √(2π)/8, which the variance takes out
    return np.asarray(means / np.sqrt(np.mean(means**2)))


def spread(factors: Floats, deviation: float) -> Floats:
    """Return the factors (8K, 8K, 2) of classes of K materials, in turn, from those of the materials (K, K, 2)."""
    own = deviates()
    more = 1 + deviation * (own[:, None] + own) / np.sqrt(2)
    return _divided(factors, np.stack([more, more], axis=-1))


def levels_of(scene: Scene) -> Floats:
    """Return the pairs of factors that a table gives to spheres, (L, 2), the first 1 and 1, the others ascending."""
    table = scene.packing.table.columns
    given = [np.nan_to_num(table[name], nan=1.0) if name in table else [1.0] for name in _FACTORS]
    pairs = {*zip(*np.broadcast_arrays(*given), strict=True)} - {(1.0, 1.0)}
    return np.array([(1.0, 1.0), *sorted(pairs)])


def in_series(factors: Floats, levels: Floats) -> Floats:
    """Return the factors (LK, LK, 2) of L kinds of spheres of K materials, in turn, from those of the materials."""
    return _divided(factors, 2 / (1 / levels[:, None] + 1 / levels))


def _divided(factors: Floats, among: Floats) -> Floats:
    return np.stack([np.kron(factors[..., part], among[..., part]) for part in range(2)], axis=-1)


def scaled(
    materials: tuple[Material, Material],
    radii: tuple[float, float],
    adhesion: Adhesion,
    load: float,
    declared: tuple[float | None, float | None],
) -> tuple[float, float]:
    """Return the factors of the normal and the shear force of a contact whose stiffnesses are declared.

    Parameters
    ----------
    materials, radii : of both bodies; a radius of inf is a plane.
    load : force that presses them together at rest.
    declared : normal and shear stiffness at rest, None for those that the moduli give.

    Raises TheoryError for bodies that neither adhere nor are pressed together.
    """
    normal, shear = declared
    if normal is None and shear is None:
        return 1.0, 1.0
    one, other = (np.array([size]) for size in radii)
    A, B, F, _ = mixed(materials, (np.array([0]), np.array([1])), (one, other))
    size = float(((F[0] + load) / A[0]) ** (2 / 3))
    if not size:
        raise TheoryError("normal_stiffness, shear_stiffness: of a contact at rest that nothing presses or holds")

    def law(overlap: float) -> Law:
        return AT_REST[adhesion]([overlap], A, B, F)

    def factor(found: Law) -> float:
        return 1.0 if normal is None else float(normal / found.stiffness[0])

    def left(overlap: float) -> float:
        found = law(overlap)
        return factor(found) * float(found.push[0]) - load

    from scipy.optimize import brentq  # slow to import, and only declared stiffnesses need it

    rest = law(float(brentq(left, 0.1 * size, _WIDE * size, xtol=1e-15 * size, rtol=1e-14)))
    return factor(rest), 1.0 if shear is None else float(shear / rest.shear[0])
