"""Factors of contact forces from measured stiffnesses and their spread.

A stiffness declared in N/m at rest scales the force of its contact at every overlap. The moduli give a law with force
P(δ) and stiffness k(δ). For a normal stiffness K and a load F0 on the contact at rest the factor is c = K/k(δ), at the
overlap δ where c P(δ) = F0. The factor of the shear force is the ratio of declared and computed stiffness at the same
δ.

If stiffnesses have a spread σ, each sphere belongs to one of eight classes. The deviates g of the classes are the means
of a Gaussian over eighths of its probability, scaled to variance 1. A contact between classes c and d has the factor
1 + σ(g_c + g_d)/√2, a contact with a wall 1 + σ g.

If a table gives factors s to spheres, each pair of a normal and a shear factor is a kind; the first kind is (1, 1).
Contacts are springs in series, 2/(1/s_i + 1/s_j); with a wall the factor is s.
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
_FACTORS = "normal_stiffness", "shear_stiffness"  # columns of a table of spheres
_WIDE = 1e4  # an overlap at rest is sought up to this multiple of the overlap from the moduli


class Kind(NamedTuple):
    """Constants of the spheres of a material, in SI units.

    number : 0 for the lattice, n for the n-th inclusion if a [[pair]] names it, −1 for other inclusions.
    radius : None for the radius of the lattice.
    """

    youngs_modulus: float
    poisson_ratio: float
    work_of_adhesion: float
    number: int = 0
    radius: float | None = None


def kinds_of(scene: Scene) -> list[Kind]:
    """Return the materials of a scene in the order of the types in its deck: the lattice, then each new inclusion.

    An inclusion that a [[pair]] names is a material of its own, even if its constants are not new.
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
    """Return the deviates g of the classes, (8,), ascending, with mean 0 and variance 1."""
    from scipy.special import ndtri  # slow to import, and only spreads need it

    edges = ndtri(np.linspace(0, 1, CLASSES + 1))
    means = -np.diff(np.exp(-(edges**2) / 2))  # without the factor 8/√(2π), which cancels in the next line
    return np.asarray(means / np.sqrt(np.mean(means**2)))


def spread(factors: Floats, deviation: float) -> Floats:
    """Return the factors (8K, 8K, 2) of K materials with eight classes each, from factors (K, K, 2) and a spread σ."""
    own = deviates()
    more = 1 + deviation * (own[:, None] + own) / np.sqrt(2)
    return _divided(factors, np.stack([more, more], axis=-1))


def levels_of(scene: Scene) -> Floats:
    """Return the different pairs of factors in a scene's table, (L, 2): (1, 1) first, then ascending."""
    table = scene.packing.table.columns
    given = [np.nan_to_num(table[name], nan=1.0) if name in table else [1.0] for name in _FACTORS]
    pairs = {*zip(*np.broadcast_arrays(*given), strict=True)} - {(1.0, 1.0)}
    return np.array([(1.0, 1.0), *sorted(pairs)])


def in_series(factors: Floats, levels: Floats) -> Floats:
    """Return the factors (LK, LK, 2) of K materials with L levels each, from factors (K, K, 2) and levels (L, 2)."""
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
    """Return the factors of the normal and the shear force of a contact with declared stiffnesses.

    Parameters
    ----------
    materials, radii : materials and radii of both bodies, in any consistent units; a radius of inf is a plane.
    adhesion : law of the normal force.
    load : force that presses the bodies together at rest.
    declared : normal and shear stiffness at rest; None for the stiffness that the moduli give.

    Raises TheoryError for bodies that neither adhere nor are pressed together: their stiffness at rest is 0.
    """
    normal, shear = declared
    if normal is None and shear is None:
        return 1.0, 1.0
    one, other = (np.array([size]) for size in radii)
    A, B, F, _ = mixed(materials, (np.array([0]), np.array([1])), (one, other))
    size = float(((F[0] + load) / A[0]) ** (2 / 3))
    if not size:
        raise TheoryError("normal_stiffness, shear_stiffness: the contact at rest has neither a load nor adhesion")

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
