"""Rows of spheres along x as a chain of blocks, for waves along y (`granular_analysis.theory.transfer`).

The displacement of row n is X_n = (u, v, φ) of all its spheres, φ = Rθ. The motion of row m exerts the force −K_{nm}
X_m on row n, from the stiffness of the contacts at rest (`granular_analysis.theory.bonds`). In LAMMPS the torque of a
slip has the lever arm R − δ/2; the same motion results from the arm R and the moment of inertia over 1 − η, η = δ/2R.
If η differs between the contacts of a sphere, its mean weighted by the shear stiffness is used. Only then the result is
approximate: it errs by the spread of η, 1e-4 for microspheres.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory.bloch import hexagonal
from granular_analysis.theory.cell import Cell
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.crystal import PLANE
from granular_analysis.theory.network import Network

Floats = NDArray[np.float64]
Complexes = NDArray[np.complexfloating]
_ALIKE = 1e-6  # rows of one lattice have a smaller relative difference


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of spheres as a chain of blocks, in any consistent units; made by `heavy_rows` or `rows_of`.

    Attributes
    ----------
    places : for each row, (C_n,) positions x of its spheres over the width W.
    mass : for each row, (3C_n,) masses and moments of inertia over R².
    on_site : for each row, (3C_n, 3C_n) K_{nn}, including the contacts to both neighbouring rows.
    ahead : for each row except the last, (3C_n, 3C_{n+1}) K_{n,n+1}.
    """

    places: tuple[Floats, ...]
    mass: tuple[Floats, ...]
    on_site: tuple[Floats, ...]
    ahead: tuple[Floats, ...]

    @property
    def reversed(self) -> "Rows":
        """Return the same rows seen from behind."""
        turned = tuple(block.T for block in self.ahead[::-1])
        return Rows(self.places[::-1], self.mass[::-1], self.on_site[::-1], turned)


def plane_wave(places: Floats, order: int) -> Complexes:
    """Return u, v and φ of waves e^{2πi m x/W} of order m on a row, (3C, 3); each column has norm 1."""
    phases = np.exp(2j * np.pi * order * places) / np.sqrt(len(places))
    return np.kron(phases[:, None], np.eye(3))


def heavy_rows(contact: Contact, masses: Sequence[float]) -> Rows:
    """Return rows of other density between perfect lattices, in units of t0 and the mass of a sphere of the lattices.

    Parameters
    ----------
    contact : contact of all spheres, without dashpots.
    masses : positive masses of a sphere of each row, in units of the mass of a sphere of the lattices. Two rows of the
        lattices are added at each end.

    Raises
    ------
    ValueError
        For a mass that is not positive, and for a contact with dashpots or whose spheres do not turn.
    """
    relative = np.array([1.0, 1.0, *masses, 1.0, 1.0])
    if not np.all((relative > 0) & np.isfinite(relative)):
        raise ValueError(f"masses = {list(masses)}: must be positive and finite")
    if not contact.turns:
        raise ValueError("contact: must have shear and rotation")
    contact.refuse_dashpots()
    crystal, plane = hexagonal(contact), np.array(PLANE)
    stiffness = -crystal.bonds.couplings[:, :, plane][..., plane] / crystal.mass[0, 0]
    upward = crystal.bonds.normal[:, 1] > 0
    on_site = stiffness[:, 0, :, 0].sum(axis=0) + stiffness[:, 1, :, 1].sum(axis=0)
    along = stiffness[~upward, 0, :, 1].sum(axis=0)  # contacts within a row
    ahead = stiffness[upward, 0, :, 1].sum(axis=0)
    count, mass = len(relative), tuple(each * contact.masses for each in relative)
    return Rows((np.zeros(1),) * count, mass, (on_site + along + along.T,) * count, (ahead,) * (count - 1))


def rows_of(network: Network, first: int, last: int) -> Rows:
    """Return the rows from `first` to `last` of a network at rest, between perfect lattices like those at its ends.

    Parameters
    ----------
    network : Network
        Spheres in rows along x, periodic in x; only neighbouring rows touch. Walls, drives and drag are ignored.
    first, last : int
        Indices of rows, counted upwards from 0. The first two rows, and the last two, must be those of a perfect
        lattice.

    Raises
    ------
    ValueError
        If rows do not exist, touch rows other than the next ones, or do not end in perfect lattices, and for dashpots.
    """
    height = network.position[:, 1]
    order = np.argsort(height, kind="stable")
    number = np.empty(len(order), dtype=np.intp)
    number[order] = np.concatenate([[0], np.cumsum(np.diff(height[order]) > network.radius.min() / 2)])
    if not 1 <= first < last - 2 < number.max() - 2:
        raise ValueError(f"first, last = {first}, {last}: must be rows from 1 to {number.max() - 1}, at least four")
    if not np.isfinite(network.cell[0]):
        raise ValueError(f"cell = {network.cell}: must be periodic in x")
    cell = Cell.of(replace(network, walls=(), drives=(), drag=None))
    bonds = cell.bonds
    if np.any(np.abs(number[bonds.first] - number[bonds.second]) > 1):
        raise ValueError("the network has contacts between rows that are not next to each other")
    whole = replace(
        cell, bonds=replace(bonds, arms=np.ones_like(bonds.arms)), inverse_mass=np.ones_like(cell.inverse_mass)
    ).matrix
    turned, weighted = np.zeros((2, len(height)))
    for end, arms in ((bonds.first, bonds.arms[:, 0]), (bonds.second, bonds.arms[:, 1])):
        turned += np.bincount(end, bonds.law.shear, len(height))
        weighted += np.bincount(end, bonds.law.shear * arms, len(height))
    inertia = 0.4 * network.mass * turned / np.where(weighted > 0, weighted, 1.0)
    spheres = [np.flatnonzero(number == row) for row in range(first, last + 1)]
    of_row = [(3 * each[:, None] + np.arange(3)).ravel() for each in spheres]
    masses = np.stack([network.mass, network.mass, inertia], axis=1).ravel()
    rows = Rows(
        tuple(network.position[each, 0] / network.cell[0] for each in spheres),
        tuple(masses[each] for each in of_row),
        tuple(whole[each][:, each].toarray() for each in of_row),
        tuple(whole[a][:, b].toarray() for a, b in zip(of_row, of_row[1:], strict=False)),
    )
    for side, row in ((rows, first), (rows.reversed, last)):
        _require_lattice(side, row)
    return rows


def _require_lattice(rows: Rows, number: int) -> None:
    """Raise ValueError unless the first two rows are alike and consist of equal spheres."""
    (here, then), (first, second) = (plane_wave(each, 0) for each in rows.places[:2]), rows.on_site[:2]
    after = plane_wave(rows.places[2], 0)
    scale = np.abs(first).max()
    pairs = (
        (here.T @ first @ here, then.T @ second @ then, scale),
        (here.T @ rows.ahead[0] @ then, then.T @ rows.ahead[1] @ after, scale),
        (rows.mass[0][:3], rows.mass[1][:3], rows.mass[0].max()),
        (rows.mass[0], np.tile(rows.mass[0][:3], len(rows.places[0])), rows.mass[0].max()),
    )
    if len(rows.places[0]) != len(rows.places[1]) or any(np.abs(a - b).max() > _ALIKE * unit for a, b, unit in pairs):
        raise ValueError(f"row {number}: must belong to a perfect lattice, like the next row; take rows farther away")
