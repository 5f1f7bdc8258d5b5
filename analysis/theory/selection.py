"""Selection rules: which waves two waves cannot make of each other, because a mirror of the lattice forbids it.

The hexagonal lattice has six mirrors, along 0°, 30°, … 150° from a close-packed row. A mirror reflects (u, v), and
turns rotations round, φ → −φ. Where it leaves a wave vector where it is (up to a reciprocal lattice vector), each
mode there is even or odd: on a line through Γ, L is even, TR and RT are odd. The quadratic forces have the symmetry of
the lattice, so that what they drive at k1 ± k2 is

    of the parity of the product,   if the mirror leaves both waves where they are:
                                    even + even → even,  odd + odd → even,  even + odd → odd;
    even,                           if it exchanges the two waves of a sum, which are then of one branch;

and modes of the other parity at k1 ± k2 get nothing, at any time and any contact law. So of two collinear waves along
y or x, two L make L only, two shear waves make L only, and L with a shear wave makes shear waves only; of two mirrored
waves of one branch, the sum is L. In the paper's geometry and law, whose drive knows no frequencies, the difference of
two mirrored waves is L too, to second order: for it the second wave is (−k2, (u, v, −f)), and the mirror across
exchanges them.

Rules of whole orders, at any amplitude, follow for a single wave: odd waves along y hold q and φ in odd harmonics only.

When it breaks: where branches touch, a mode has no parity, and nothing is forbidden.
"""

import numpy as np
from numpy.typing import NDArray

from analysis.theory.bloch import BONDS
from analysis.theory.mixing import Pair

Floats = NDArray[np.float64]

MIRRORS = np.radians(np.arange(0.0, 180.0, 30.0))  # directions that a mirror leaves as they are
# Modes and wave vectors are computed to 1e-15, and modes of branches that lie 1e-6 apart to 1e-9. What is no symmetry
# misses by more, unless it lies that near to one.
SAME = 1e-7


def reflection(angle: float) -> Floats:
    """Return the matrix (3, 3) of a mirror along an angle, in rad, on W = (u, v, f)."""
    cosine, sine = np.cos(2.0 * angle), np.sin(2.0 * angle)
    return np.array([[cosine, sine, 0.0], [sine, -cosine, 0.0], [0.0, 0.0, -1.0]])


def same_wavevector(one: Floats, other: Floats) -> bool:
    """Return whether two wave vectors (2,) name one wave: whether they differ by a reciprocal lattice vector."""
    return bool(np.all(np.abs(np.exp(1j * BONDS @ (one - other)) - 1.0) < SAME))


def parity(shape: Floats, mirror: Floats) -> int:
    """Return 1 for a mode W (3,) that is even under a mirror, −1 for an odd one, 0 for one that is neither."""
    reflected = mirror @ shape
    return next((sign for sign in (1, -1) if np.abs(reflected - sign * shape).max() < SAME), 0)


def forbidden(pair: Pair) -> NDArray[np.bool_]:
    """Return for each branch at k1 ± k2 whether symmetry forbids that a pair of waves drives it, (J,).

    Parameters
    ----------
    pair : a single one
    """
    (_, first), (_, second) = pair.tones
    one = np.asarray(pair.first.wavevector, dtype=float)
    other = pair.sign * np.asarray(pair.second.wavevector, dtype=float)
    shapes = pair.targets[1]
    exchangeable = pair.sign == 1 or not pair.contact.has_history  # a history tells which wave is differentiated
    result = np.zeros(len(shapes), dtype=bool)
    for mirror in map(reflection, MIRRORS):
        of_one, of_other = mirror[:2, :2] @ one, mirror[:2, :2] @ other
        driven = 0
        if same_wavevector(of_one, one) and same_wavevector(of_other, other):
            driven = parity(first, mirror) * parity(second, mirror)
        elif exchangeable and same_wavevector(of_one, other) and same_wavevector(of_other, one):
            driven = int(min(np.abs(mirror @ first - sign * second).max() for sign in (1, -1)) < SAME)
        if driven:
            result |= [parity(shape, mirror) == -driven for shape in shapes]
    return result
