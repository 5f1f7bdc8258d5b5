"""Measured stiffnesses of a run, and the substrate under it, for its network: by its scene, and its deck for the place.

A stiffness is declared in N/m at rest and scales the force of its contact at every overlap. With the law P(δ), k(δ) of
the moduli, and the load F0 on a contact, a normal stiffness K is reached with the factor c = K/k(δ) at the δ where

    c P(δ) = F0

A substrate is a half-space at rest across z, of a material of its own. On which height it is says the deck.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from analysis.theory.bonds import Law, dmt, jkr
from analysis.theory.choice import TheoryError
from analysis.theory.network import Material, Wall, mixed
from analysis.theory.network_laws import Adhesion

Floats = NDArray[np.float64]
_PLANE = re.compile(r"\bzplane +(\S+) +(\S+)")
_WIDE = 1e4  # overlaps at rest under a load are sought up to as many times those without


def factors(
    materials: tuple[Material, Material], radii: tuple[float, float], adhesion: Adhesion, load: float, declared: Any
) -> tuple[float, float]:
    """Return the factors of the normal and the shear force of a contact whose stiffnesses are declared.

    Parameters
    ----------
    materials, radii : of both bodies; a radius of inf is a plane.
    load : force that presses them together at rest.
    declared : with `normal_stiffness` and `shear_stiffness`, None for those that the moduli give.

    Raises TheoryError for bodies that neither adhere nor are pressed together.
    """
    normal, shear = declared.normal_stiffness, declared.shear_stiffness
    if normal is None and shear is None:
        return 1.0, 1.0
    ends = tuple(np.array([size]) for size in radii)
    A, B, F, effective = mixed(materials, (np.array([0]), np.array([1])), (ends[0], ends[1]))
    if not F[0] and not load:
        raise TheoryError("normal_stiffness and shear_stiffness: of a contact at rest, which nothing presses or holds")

    def law(overlap: float) -> Law:
        return dmt([overlap], A, B, F) if adhesion == "dmt" else jkr([overlap], A, B, F, effective)

    def left(overlap: float) -> float:
        found = law(overlap)
        factor = 1.0 if normal is None else normal / found.stiffness[0]
        return float(factor * found.push[0] - load)

    size = float(((F[0] + load) / A[0]) ** (2 / 3))
    at_rest = law(brentq(left, 0.1 * size, _WIDE * size, xtol=1e-15 * size, rtol=1e-14))
    pressing = 1.0 if normal is None else normal / at_rest.stiffness[0]
    return float(pressing), 1.0 if shear is None else float(shear / at_rest.shear[0])


def substrate(folder: Path, material: Material, scaled: tuple[float, float]) -> Iterator[Wall]:
    """Yield the planes across z that the deck of a run has.

    Raises TheoryError for a deck without any.
    """
    deck = next(iter(sorted(folder.glob("in.*")) or sorted(folder.glob("*_per_sample/in.*"))), None)
    found = _PLANE.findall(deck.read_text(encoding="utf-8")) if deck else []
    if not found:
        raise TheoryError("substrate: the deck of the run does not say on which height it is")
    for low, high in dict.fromkeys(found):
        if low != "NULL":
            yield Wall((0.0, 0.0, float(low)), (0.0, 0.0, -1.0), material, scaled)
        if high != "NULL":
            yield Wall((0.0, 0.0, float(high)), (0.0, 0.0, 1.0), material, scaled)
