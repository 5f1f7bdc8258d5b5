"""Crystal of the paper at a wave vector: bonds, directions and modes, in the gauge W = (u, v, f) with φ = i f.

`hexagonal` makes this crystal for the theory of general crystals. Inversion combined with time reversal maps a wave
exp i(k·r − Ωτ) to itself, so a mode has real (u, v) and an imaginary φ = i f: W is real. Displacements and φ are in Δ0,
time in t0, wave vectors in 1/lattice constant; x runs along a close-packed row. There are three modes, or two if
spheres do not turn.

Along x and y, where a mirror plane contains k, the names L, TR and RT are exact. Elsewhere each mode moves in u, v and
φ, and the names are labels that jump where two branches exchange character.

When it breaks: where two branches touch, the eigenvectors of the pair are arbitrary.
"""

from functools import lru_cache
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.second_harmonic import Mode, ModeName
from granular_analysis.theory.bonds import Bonds, Law
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.crystal import PLANE, Crystal, padded
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.second_order import Mixed, branch_of

__all__ = ["in_plane", "pair_of", "wavevector_of"]

Floats = NDArray[np.float64]
Field = TypeVar("Field", bound=NDArray[Any])

# One bond of each ± pair, in lattice constants
BONDS = np.array([[1.0, 0.0], [0.5, np.sqrt(0.75)], [-0.5, np.sqrt(0.75)]])
RECIPROCAL = 2 * np.pi * np.array([[1.0, -1 / np.sqrt(3)], [0.0, 2 / np.sqrt(3)]])  # basis of the reciprocal lattice
_ROUNDING = 1e-14  # share of a mode
GAUGE: NDArray[np.complex128] = np.array([1.0, 1.0, 1j])  # (u, v, φ) = GAUGE · (u, v, f)


@lru_cache(maxsize=16)
def hexagonal(contact: Contact) -> Crystal:
    """Return the paper's crystal with a given contact and a close-packed row along x.

    Lengths are in Δ0, forces in k1Δ0, time in t0, and wave vectors in 1/lattice constant. Dashpots are left out.
    """
    normal = padded(BONDS)
    ratio = contact.overlap_ratio
    law = Law(*(np.full(3, float(each)) for each in contact.adhesion.law(contact.shear_stiffness)))
    bonds = Bonds(
        *(np.zeros(3, dtype=np.intp), np.zeros(3, dtype=np.intp), normal, normal),
        curving=np.full(3, ratio / (1 - ratio)),
        arms=np.ones((3, 2)),
        widening=np.full((3, 2), ratio / (1 - ratio)),
        law=law,
        shear_law=contact.law,
    )
    mass = 2 * (contact.kappa + 3) * np.array([1.0, 1, 1, *3 * [contact.inertia / (1 - ratio)]])
    return Crystal(bonds, mass[None], np.zeros((1, 3)), normal[:2], PLANE if contact.turns else PLANE[:2])


def in_plane(field: Field) -> Field:
    """Return (u, v, φ) (..., 3) of a field (..., 1, 6) in a crystal with one sphere per cell."""
    return cast(Field, field[..., 0, list(PLANE)])


def pair_of(
    first: tuple[ArrayLike, ArrayLike], second: tuple[ArrayLike, ArrayLike], sign: int, contact: Contact
) -> Mixed:
    """Return two waves in the paper's crystal together with the field that they generate at second order.

    Parameters
    ----------
    first, second : wave vector (..., 2) in 1/lattice constant and branch (...) of each wave
    sign : 1 for the sum of the two waves, −1 for the difference
    contact : without dashpots

    Raises ValueError for another sign, an unknown branch, and dashpots. Amplitudes of the field are in Δ0 per product
    of the two amplitudes.
    """
    if sign not in (1, -1):
        raise TheoryError(f"sign is {sign!r}; allowed: 1 (sum), -1 (difference)")
    contact.refuse_dashpots()
    one, other = (branch_of(hexagonal(contact), *each) for each in (first, second))
    return Mixed(hexagonal(contact), one, other if sign == 1 else other.reversed)


def real_modes(wavevector: ArrayLike, contact: Contact) -> tuple[Floats, Floats]:
    """Return frequencies (..., J), ascending, and shapes W (..., J, 3), |W| = 1; the larger of p and q is positive.

    J is 3, or 2 if spheres do not turn. A mode that only rotates has f < 0.
    """
    modes = hexagonal(contact).modes(wavevector)
    return modes.frequencies, np.real(in_plane(modes.shapes) / GAUGE)


def branch_index(name: str, wavevector: ArrayLike, contact: Contact) -> NDArray[np.intp]:
    """Return the index (...) of branch L, TR or RT: L moves most along k; TR is the lower of the others, RT the upper.

    Raises ValueError for another name, and for RT if spheres do not turn.
    """
    return branch_among(name, real_modes(wavevector, contact)[1], wavevector)


def branch_among(name: str, shapes: NDArray[Any], wavevector: ArrayLike) -> NDArray[np.intp]:
    """Return the index (...) of L, TR or RT among in-plane modes (..., J, 3); see `branch_index`."""
    names = ("L", "TR", "RT")[: shapes.shape[-2]]
    if name not in names:
        raise TheoryError(f"name is {name!r}; allowed: {', '.join(names)}")
    along = np.einsum("...jc,...c->...j", shapes[..., :2], unit(np.asarray(wavevector)[..., :2]))
    longitudinal = np.argmax(np.abs(along), axis=-1)
    lower, upper = np.where(longitudinal == 0, 1, 0), np.where(longitudinal == 2, 1, 2)
    return (longitudinal, lower, upper)[names.index(name)]


def mode(name: ModeName, wavenumber: float, direction: float, contact: Contact) -> Mode:
    """Return one mode in the paper's variables, p = P cos ϑ, q = Q cos ϑ, φ = −f sin ϑ, with ϑ = k·r − Ωτ + phase.

    Along y this equals `second_harmonic.mode` to rounding, except for the sign of a mode that only rotates.

    Parameters
    ----------
    name : "L", "TR" or "RT", in the sense of `branch_index`
    wavenumber : ξ = (√3/2)|k| > 0, rad per row for a wave along y
    direction : direction of k, in degrees from x (a close-packed row) towards y; 90 is the paper's
    contact : any contact; all shear laws have the same modes

    Raises ValueError for a value out of range, and for RT if spheres do not turn.
    """
    k = wavevector_of(wavenumber, direction)
    frequencies, shapes = real_modes(k, contact)
    branch = int(branch_among(name, shapes, k))
    parts = np.append(frame(direction) @ shapes[branch, :2], shapes[branch, 2])
    p, q, f = np.where(np.abs(parts) < _ROUNDING, 0.0, parts)  # components that a mirror forbids are exactly 0
    return Mode(name, *map(float, (wavenumber, frequencies[branch], p, q, f, direction)))


def unit(wavevector: ArrayLike) -> Floats:
    """Return k/|k|, and y at k = 0."""
    k = np.asarray(wavevector, dtype=float)
    length = np.linalg.norm(k, axis=-1, keepdims=True)
    return np.where(length > 0.0, k / np.where(length > 0.0, length, 1.0), [0.0, 1.0])


def wavevector_of(wavenumber: float, direction: float) -> Floats:
    """Return k (2,) in 1/lattice constant from ξ = (√3/2)|k| and the direction in degrees from x towards y.

    Raises ValueError unless ξ is positive and both are finite.
    """
    if not 0.0 < wavenumber < np.inf:
        raise TheoryError(f"wavenumber is {wavenumber!r}; allowed: above 0, finite")
    if not np.isfinite(direction):
        raise TheoryError(f"direction is {direction!r}; allowed: degrees, finite")
    return 2.0 / np.sqrt(3.0) * wavenumber * frame(direction)[0]


def frame(direction: float) -> Floats:
    """Return the unit vectors along k and along ẑ × k as rows: (p, q) = frame @ (u, v)."""
    cosine, sine = np.cos(np.radians(direction)), np.sin(np.radians(direction))
    return np.array([[cosine, sine], [-sine, cosine]])
