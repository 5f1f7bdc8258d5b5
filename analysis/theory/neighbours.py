"""Who touches whom in the hexagonal lattice, for a wave of any direction: on the phase torus, and on a ring of rows.

A sphere has three neighbours ahead, at the lattice vectors d of 0°, 60° and 120° from a close-packed row, and three
behind, at −d. A plane wave that starts as a function of the phase k·r alone stays one, so on one period of it, the
phase torus, the neighbour at d is a shift of the phase by

    k·d = (2/√3) ξ cos(k, d),    ξ = (√3/2)|k|

(k in 1/lattice constant, so ξ is in rad per row for a wave along y). That is the infinite lattice without boundaries,
in any direction and at any ξ. The shift is a spectral one, a K×K matrix, and the one back is its transpose.

Components are p, along k, and q, along ẑ × k. Along y the bonds of 60° and 120° are the paper's right and left contacts
to the next row, and the one of 0° stays within the row.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BOND_ANGLES = (0.0, 60.0, 120.0)  # directions of the contacts ahead, degrees from a close-packed row


@dataclass(frozen=True)
class Neighbours:
    """Directions of the three contacts ahead of a sphere, and the spheres at their other ends.

    Attributes
    ----------
    normal : (p, q) components of the three contacts' directions at rest, each (3, 1).
    ahead : values (C, K) of K spheres → those of their neighbours ahead (3, C, K).
    behind : values (3, C, K) of the contacts ahead → those of the contacts behind, summed (C, K).
    """

    normal: tuple[Floats, Floats]
    ahead: Callable[[Floats], Floats]
    behind: Callable[[Floats], Floats]


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


def torus_neighbours(wavenumber: float, points: int, direction: float = 90.0) -> Neighbours:
    """Neighbours on the phase torus of K points: a shift of the phase by k·d for each bond.

    wavenumber : ξ = (√3/2)|k|, in rad per row for a wave along y.
    direction : of k, degrees from a close-packed row; 90 is the paper's y.

    Raises ValueError for a K that is none of `torus_phases`.
    """
    phases, normal = torus_phases(points), directions_at_rest(direction)
    shifts = 2 / np.sqrt(3) * wavenumber * normal[0][:, :, None]
    # Exactly itself where nothing is shifted: within a row along y, mirror symmetry then holds to the last bit.
    back = np.where(shifts == 0, np.eye(points), periodic_kernel(phases[:, None] + shifts - phases, points))
    forward = np.ascontiguousarray(back.swapaxes(1, 2))

    def ahead(values: Floats) -> Floats:
        return (values.reshape(-1, points) @ forward).reshape(3, *values.shape)

    def behind(values: Floats) -> Floats:
        total: Floats = np.add.reduce(values.reshape(3, -1, points) @ back, axis=0).reshape(values.shape[1:])
        return total

    return Neighbours(normal, ahead, behind)


def ring_neighbours() -> Neighbours:
    """Rows on a ring, for waves along y: the exact infinite lattice for waves with ξN a multiple of 2π."""

    def ahead(values: Floats) -> Floats:
        result = np.empty((3, *values.shape), dtype=values.dtype)
        result[0] = values
        result[1:, ..., :-1] = values[..., 1:]
        result[1:, ..., -1] = values[..., 0]
        return result

    def behind(values: Floats) -> Floats:
        result, before = values[0].copy(), values[1] + values[2]
        result[..., 1:] += before[..., :-1]
        result[..., 0] += before[..., -1]
        return result

    return Neighbours(directions_at_rest(90.0), ahead, behind)
