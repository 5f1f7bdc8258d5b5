"""Rows of spheres along x as a chain of blocks, for waves along y (`granular_analysis.theory.transfer`).

Row n moves by X_n = (u, v, φ) of all its spheres, φ = Rθ, and K_{nm} is what the motion of row m does to it, with the
stiffness of the contacts at rest (`granular_analysis.theory.bonds`). In LAMMPS the torque of a slip has the arm R −
δ/2, which is the same as the moment of inertia over 1 − η, η = δ/2R. Where η is not the same for all contacts of a
sphere it is their mean, weighted by the stiffness against slip: then, and then only, what follows is off by the spread
of η, 1e-4 for microspheres.
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
_ALIKE = 1e-6  # relative difference of rows that are those of one lattice


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of spheres as a chain of blocks, in any consistent units; made by `heavy_rows` or `rows_of`.

    Attributes
    ----------
    places : (C_n,) x of the spheres of each row, over the width.
    mass : (3C_n,) M of each row.
    on_site : (3C_n, 3C_n) K_{nn}, with the contacts to both next rows.
    ahead : (3C_n, 3C_{n+1}) K_{n,n+1} of each row but the last.
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
    """Return u, v and φ of a wave e^{2πi m x/W} on the spheres of a row, (3C, 3), of norm 1."""
    phases = np.exp(2j * np.pi * order * places) / np.sqrt(len(places))
    return np.kron(phases[:, None], np.eye(3))


def heavy_rows(contact: Contact, masses: Sequence[float]) -> Rows:
    """Return rows of equal spheres but for their density, between perfect lattices; in t0 and the mass of a sphere.

    Parameters
    ----------
    contact : of all spheres; without dashpots.
    masses : of the spheres of the rows, in those of the others; positive. Two rows of the others are added at each end.

    Raises
    ------
    ValueError
        For a mass that is not positive, and a contact with dashpots or whose spheres do not turn.
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
    """Return rows of a network at rest, counted upwards from 0, with the lattices beyond that their ends have.

    Parameters
    ----------
    network : Network
        Spheres in rows along x, periodic there, of which only neighbours touch. What acts from outside is left out.
    first, last : int
        The first two rows, and the last two, must be those of perfect lattices.

    Raises
    ------
    ValueError
        For rows that are not there, that touch others than the next ones, or whose ends are no perfect lattice, and for
        dashpots.
    """
    height = network.position[:, 1]
    order = np.argsort(height, kind="stable")
    number = np.empty(len(order), dtype=np.intp)
    number[order] = np.concatenate([[0], np.cumsum(np.diff(height[order]) > network.radius.min() / 2)])
    if not 1 <= first < last - 2 < number.max() - 2:
        raise ValueError(f"first, last = {first}, {last}: must be rows from 1 to {number.max() - 1}, four at least")
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
    """Raise a ValueError unless the first two rows are alike, and of equal spheres."""
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
        raise ValueError(f"row {number}: must be of a perfect lattice, as the next one; take rows farther away")
