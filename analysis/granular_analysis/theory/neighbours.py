"""Neighbours in the hexagonal lattice, for a wave of any direction, on the phase torus.

A sphere has three neighbours ahead, at the lattice vectors d of 0°, 60° and 120° from a close-packed row, and three
behind, at −d. A plane wave that starts as a function of the phase k·r alone stays one, so on one period of it, the
phase torus, the neighbour at d is a shift of the phase by

    k·d = (2/√3) ξ cos(k, d),    ξ = (√3/2)|k|

(k in 1/lattice constant, so ξ is in rad per row for a wave along y). That is the infinite lattice without boundaries,
in any direction and at any ξ. The shift is a spectral one, a K×K matrix, and the one back is its transpose.

Components are p, along k, and q, along ẑ × k. Along y the bonds of 60° and 120° are the paper's right and left contacts
to the next row, and the one of 0° stays within the row.

What a contact feels of the two spheres at its ends is linear. With n its direction at rest, t = ẑ × n its tangent and
d = ahead − here of (p, q), it is stretched by n·d along n, displaced by t·d across it, and turned by σ = φ₊ + φ.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BOND_ANGLES = (0.0, 60.0, 120.0)  # directions of the contacts ahead, degrees from a close-packed row


class Torus(NamedTuple):
    """The shifts (K, 3K) of the phase torus, of `torus_shifts`, and the direction of the wave."""

    shifts: Floats
    direction: float


@dataclass(frozen=True)
class Neighbours:
    """The three contacts ahead of each of K spheres, as what they feel of the spheres and do to them.

    Attributes
    ----------
    deform : p, q, φ (..., 3, K) of the spheres → n·d, t·d, σ of their contacts, (..., 3, 3, K), bonds before spheres.
    gather : forces (..., 3, 3, K) of the contacts against each of these → on p, q, φ (..., 3, K). It is the transpose
        of `deform` with the sign turned, so forces do the work that the contacts take.
    torus : where the spheres are the points of a phase torus; else None.
    """

    deform: Callable[[Floats], Floats]
    gather: Callable[[Floats], Floats]
    torus: Torus | None = None


def periodic_kernel(angle: Floats, points: int) -> Floats:
    """Weight with which a sample at distance `angle` enters the trigonometric interpolation through K odd points.

    sin(Kα/2)/(K sin(α/2)), the Dirichlet kernel, summed as cosines to be regular at α=0.
    """
    orders = np.arange(1, (points + 1) // 2)
    return (1 + 2 * np.cos(np.multiply.outer(angle, orders)).sum(axis=-1)) / points


def torus_phases(points: int) -> Floats:
    """K equidistant phases on [0, 2π); ValueError unless K is odd (only then is a shift invertible) and at least 5."""
    if points < 5 or points % 2 == 0:
        raise ValueError(f"points = {points} must be odd and at least 5")
    return 2 * np.pi * np.arange(points) / points


def directions_at_rest(direction: float) -> tuple[Floats, Floats]:
    """(p, q) components, each (3, 1), of the bonds' unit vectors for a wave at `direction` degrees from a row."""
    angles = np.array(BOND_ANGLES)[:, None] - direction
    # The cosine as sin(90° − |angle|): a bond across the wave then gets exactly 0, as that within the row along y.
    return np.sin(np.radians(90 - np.abs(angles))), np.sin(np.radians(angles))


def shifted(direction: float, ahead: Callable[[Floats], Floats], behind: Callable[[Floats], Floats]) -> Neighbours:
    """Neighbours by where they are.

    Parameters
    ----------
    direction : of p, degrees from a close-packed row.
    ahead : values (..., K) of the spheres → those of their neighbours ahead (..., 3, K).
    behind : values (..., 3, K) of the contacts ahead → those of the contacts behind, summed (..., K).
    """
    n_p, n_q = directions_at_rest(direction)
    here = np.array([[-1.0], [-1.0], [1.0]])

    def deform(places: Floats) -> Floats:
        apart = ahead(places)
        apart += (places * here)[..., None, :]
        dp, dq = apart[..., 0, :, :], apart[..., 1, :, :]
        along = n_p * dp + n_q * dq
        apart[..., 1, :, :] = n_p * dq - n_q * dp
        apart[..., 0, :, :] = along
        return apart

    def gather(forces: Floats) -> Floats:
        along, across = forces[..., 0, :, :], forces[..., 1, :, :]
        pull = np.empty(forces.shape, dtype=forces.dtype)
        pull[..., 0, :, :] = n_p * along - n_q * across
        pull[..., 1, :, :] = n_q * along + n_p * across
        pull[..., 2, :, :] = -forces[..., 2, :, :]
        result, back = np.add.reduce(pull, axis=-2), behind(pull)
        result[..., :2, :] -= back[..., :2, :]
        result[..., 2, :] += back[..., 2, :]
        return result

    return Neighbours(deform, gather)


def torus_neighbours(wavenumber: float, points: int, direction: float = 90.0) -> Neighbours:
    """Neighbours on the phase torus of K points: a shift of the phase by k·d for each bond.

    wavenumber : ξ = (√3/2)|k|, in rad per row for a wave along y.
    direction : of k, degrees from a close-packed row; 90 is the paper's y.

    Raises ValueError for a K that is none of `torus_phases`.
    """
    shifts = torus_shifts(wavenumber, points, direction)
    back = np.ascontiguousarray(shifts.T)

    def ahead(values: Floats) -> Floats:
        return (values @ shifts).reshape(*values.shape[:-1], 3, -1)

    def behind(values: Floats) -> Floats:
        return np.asarray(values.reshape(*values.shape[:-2], -1) @ back)

    return replace(shifted(direction, ahead, behind), torus=Torus(shifts, direction))


def torus_shifts(wavenumber: float, points: int, direction: float = 90.0) -> Floats:
    """Return the matrix (K, 3K) of values of the spheres → those of their neighbours ahead; arguments as above."""
    phases = torus_phases(points)
    shifts = 2 / np.sqrt(3) * wavenumber * directions_at_rest(direction)[0][:, :, None]
    # Exactly itself where nothing is shifted: within a row along y, mirror symmetry then holds to the last bit.
    back = np.where(shifts == 0, np.eye(points), periodic_kernel(phases[:, None] + shifts - phases, points))
    return np.ascontiguousarray(back.reshape(-1, points).T)
