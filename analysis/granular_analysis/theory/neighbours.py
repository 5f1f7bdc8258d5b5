"""Neighbours in the hexagonal lattice on the phase torus, for a wave of any direction.

A sphere has three neighbours ahead, at the lattice vectors d at 0°, 60° and 120° to a close-packed row, and three
behind, at −d. A plane wave that starts as a function of the phase k·r alone remains one. On one period of the phase,
the phase torus, the neighbour at d is therefore a shift of the phase by

    k·d = (2/√3) ξ cos(k, d),    ξ = (√3/2)|k|

(k in 1/lattice constant, so ξ is in rad per row for a wave along y). This is the infinite lattice without boundaries,
for any direction and any ξ. The shift is spectral: a K×K matrix, whose transpose shifts back.

Displacements have the components p along k and q along ẑ × k. For a wave along y, the bonds at 60° and 120° are the
paper's right and left contacts to the next row, and the bond at 0° stays within the row.

The deformation of a contact is linear in the motion of its two spheres. Let n be its direction at rest, t = ẑ × n its
tangent and d the (p, q) of the sphere ahead minus that of the sphere itself. The contact is stretched by n·d along n,
displaced by t·d across it, and turned by σ = φ₊ + φ.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BOND_ANGLES = (0.0, 60.0, 120.0)  # directions of the contacts ahead, in degrees from a close-packed row


class Torus(NamedTuple):
    """Shifts (K, 3K) on the phase torus, from `torus_shifts`, and the direction of the wave in degrees."""

    shifts: Floats
    direction: float


@dataclass(frozen=True)
class Neighbours:
    """Linear maps between K spheres and the three contacts ahead of each.

    Attributes
    ----------
    deform : p, q, φ (..., 3, K) of the spheres → n·d, t·d, σ (..., 3, 3, K) of their contacts; the axis of bonds is
        before that of spheres.
    gather : forces (..., 3, 3, K) of the contacts against n·d, t·d, σ → forces (..., 3, K) on p, q, φ. It is minus the
        transpose of `deform`, so the spheres lose the energy that the contacts take.
    torus : shifts, if the spheres are the points of a phase torus; else None.
    """

    deform: Callable[[Floats], Floats]
    gather: Callable[[Floats], Floats]
    torus: Torus | None = None


def periodic_kernel(angle: Floats, points: int) -> Floats:
    """Return the weight of a sample at distance `angle` in trigonometric interpolation through K points, K odd.

    It is the Dirichlet kernel sin(Kα/2)/(K sin(α/2)), as a sum of cosines so that it is regular at α=0.
    """
    orders = np.arange(1, (points + 1) // 2)
    return (1 + 2 * np.cos(np.multiply.outer(angle, orders)).sum(axis=-1)) / points


def torus_phases(points: int) -> Floats:
    """Return K equidistant phases on [0, 2π).

    Raises ValueError unless K is at least 5 and odd; a shift is invertible only for odd K.
    """
    if points < 5 or points % 2 == 0:
        raise ValueError(f"points = {points} must be odd and at least 5")
    return 2 * np.pi * np.arange(points) / points


def directions_at_rest(direction: float) -> tuple[Floats, Floats]:
    """Return the components p and q, each (3, 1), of the unit vectors of the bonds.

    direction : of the wave, degrees from a close-packed row.
    """
    angles = np.array(BOND_ANGLES)[:, None] - direction
    # With cos as sin(90° − |angle|), a bond across the wave (within the row, along y) gets exactly 0
    return np.sin(np.radians(90 - np.abs(angles))), np.sin(np.radians(angles))


def shifted(direction: float, ahead: Callable[[Floats], Floats], behind: Callable[[Floats], Floats]) -> Neighbours:
    """Return the maps for neighbours that `ahead` and `behind` define.

    Parameters
    ----------
    direction : of p, degrees from a close-packed row.
    ahead : values (..., K) of the spheres → values (..., 3, K) of their neighbours ahead.
    behind : values (..., 3, K) of the contacts ahead → sum (..., K) over the contacts behind each sphere.
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
    """Return the maps on the phase torus of K points, where a neighbour is a shift of the phase by k·d.

    wavenumber : ξ = (√3/2)|k|, in rad per row for a wave along y.
    points : K.
    direction : of k, degrees from a close-packed row; 90 is the paper's y.

    Raises ValueError unless K is odd and at least 5.
    """
    shifts = torus_shifts(wavenumber, points, direction)
    back = np.ascontiguousarray(shifts.T)

    def ahead(values: Floats) -> Floats:
        return (values @ shifts).reshape(*values.shape[:-1], 3, -1)

    def behind(values: Floats) -> Floats:
        return np.asarray(values.reshape(*values.shape[:-2], -1) @ back)

    return replace(shifted(direction, ahead, behind), torus=Torus(shifts, direction))


def torus_shifts(wavenumber: float, points: int, direction: float = 90.0) -> Floats:
    """Return the matrix (K, 3K) from values of the spheres to values of their neighbours ahead.

    Parameters and errors are those of `torus_neighbours`.
    """
    phases = torus_phases(points)
    shifts = 2 / np.sqrt(3) * wavenumber * directions_at_rest(direction)[0][:, :, None]
    # Exactly the identity for a shift of 0, so that for waves along y mirror symmetry holds to the last bit
    back = np.where(shifts == 0, np.eye(points), periodic_kernel(phases[:, None] + shifts - phases, points))
    return np.ascontiguousarray(back.reshape(-1, points).T)
