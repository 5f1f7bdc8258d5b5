"""Measured stiffnesses of contacts: the factors of their forces.

A stiffness that is declared in N/m at rest scales the force of its contact at every overlap. With the law P(δ), k(δ) of
the moduli, and the load F0 on a contact at rest, the normal stiffness K takes the factor c = K/k(δ) at the δ where
c P(δ) = F0; the shear stiffness is declared of the same δ.
"""

import numpy as np

from analysis.theory.bonds import Law, dmt, jkr
from analysis.theory.choice import TheoryError
from analysis.theory.network import Material, mixed
from analysis.theory.network_laws import Adhesion

_WIDE = 1e4  # an overlap at rest is sought up to as many times that of the force that the moduli give


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
        return dmt([overlap], A, B, F) if adhesion == "dmt" else jkr([overlap], A, B, F)

    def factor(found: Law) -> float:
        return 1.0 if normal is None else float(normal / found.stiffness[0])

    def left(overlap: float) -> float:
        found = law(overlap)
        return factor(found) * float(found.push[0]) - load

    from scipy.optimize import brentq  # slow to import, and only declared stiffnesses need it

    rest = law(float(brentq(left, 0.1 * size, _WIDE * size, xtol=1e-15 * size, rtol=1e-14)))
    return factor(rest), 1.0 if shear is None else float(shear / rest.shear[0])
