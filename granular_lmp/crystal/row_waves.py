"""Rows of a lattice as a chain, and all its waves along y at one frequency, running and evanescent.

In a wave along y all spheres of a row move alike. With X_n = (u, v, φ) of row n and time e^{−iΩτ},

    K₋ X_{n−1} + (K₀ − Ω²M) X_n + K₊ X_{n+1} = 0,    X_n = s λⁿ

where K₀ + K₊e^{iξ} + K₋e^{−iξ} is the Bloch matrix. At one frequency there are twice as many waves s λⁿ as freedoms.
Half of the waves leave to +n: these have |λ| < 1, or |λ| = 1 and an energy flux to +n.
"""

from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.mode import FULL, TURNS, Physics
from granular_lmp.crystal.modes import MODES, bloch_modes, effective_inertia
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.errors import CrystalError
from granular_lmp.frozen import dataclass

Complexes = NDArray[np.complexfloating]
_RUNS = 1e-6  # largest ||λ| − 1| of a running wave; rounding leaves 1e-8 next to the edge of a band
_LEAST_FLUX = 1e-6  # least flux of a running wave, in units of the stiffness; a wave with less stands


@dataclass(frozen=True, eq=False)
class Line:
    """Rows of the lattice as a chain: K₀, K₊, K₋ in m t0⁻² of the reference sphere, and M in m."""

    on_site: Complexes
    ahead: Complexes
    behind: Complexes
    mass: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RowWaves:
    """All waves along y of one frequency.

    Attributes
    ----------
    factor : (2J,) array
        λ; J is the number of freedoms. The first J waves leave to +n, the others to −n.
    shape : (J, 2J) array
        s as columns. All running waves carry the same energy flux, 1 in units of the line.
    names : tuple of str
        L, TR or RT for running waves, "" for the others.
    """

    factor: Complexes
    shape: Complexes
    names: tuple[str, ...]

    def running(self, *, onward: bool) -> dict[str, int]:
        """Return the index of each wave that runs to +n, or to −n, by name."""
        half = len(self.factor) // 2
        return {self.names[k]: k for k in range(2 * half) if self.names[k] and (k < half) == onward}


def line_of(lattice: Contacts, sphere: Sphere, physics: Physics = FULL) -> Line:
    """Return the rows of a lattice with one sphere per cell as a chain, from Bloch modes at three wave numbers along y.

    Parameters
    ----------
    lattice : Contacts
        Contacts of one sphere.
    sphere : Sphere
        Reference sphere, whose m, R and t0 are the units.
    physics : Physics
    """
    relative = float(lattice.mass[0]) / sphere.mass
    mass = np.repeat([relative, float(effective_inertia(lattice)[0]) / sphere.mass], 3)[physics.coordinates]
    turn = np.diag(TURNS[physics.coordinates])
    row = float(lattice.vector[:, 1].max()) / sphere.radius
    phases = 2 * np.pi * np.arange(3) / 3
    frequencies, shapes = bloch_modes(lattice, sphere, np.column_stack([0 * phases, phases / row]), physics)
    matrices = []
    for frequency, shape in zip(frequencies, shapes[..., physics.coordinates], strict=True):
        modal = frequency**2 / np.sum(shape**2 * mass, axis=-1)
        matrices.append(turn @ (mass[:, None] * ((shape.T * modal) @ shape) * mass) @ turn.conj())
    behind, on_site, ahead = (
        sum(np.exp(-1j * step * phase) * matrix for phase, matrix in zip(phases, matrices, strict=True)) / 3
        for step in (-1, 0, 1)
    )
    return Line(on_site, ahead, behind, mass)


def waves(line: Line, still: Complexes) -> tuple[Complexes, Complexes]:
    """Return λ and s (one column each) of the solutions s λⁿ of the perfect lattice; `still` is K₀ − Ω²M.

    If a row does not resist every motion of the next row, as in the square lattice and the chain, some solutions end
    after one row: λ is 0 or infinite. With λ = (z + 1)/(z − 1) these have z = ∓1, and all solutions are eigenvectors of

        z² (K₊ + K₀ + K₋) + 2z (K₊ − K₋) + (K₊ − K₀ + K₋)

    with K₀ replaced by `still`. The first matrix is regular unless a wave of this frequency is infinitely long.
    """
    count, sides = len(still), line.ahead + line.behind
    step = np.linalg.solve(sides + still, np.hstack([still - sides, 2 * (line.behind - line.ahead)]))
    companion = np.vstack([np.hstack([np.zeros((count, count)), np.eye(count)]), step])
    z, vector = np.linalg.eig(companion)
    factor = np.divide(z + 1, z - 1, out=np.full(z.shape, np.inf, dtype=complex), where=z != 1)
    shape = vector[:count]
    return factor, shape / np.linalg.norm(shape, axis=0)


def flux(line: Line, before: Complexes, here: Complexes) -> NDArray[np.float64]:
    """Return the energy flux (...) from a row to the row before, up to a factor: Im(X₋₁† K₊ X₀), for rows (..., D)."""
    return np.sum(before.conj() * (here @ line.ahead.T), axis=-1).imag


def row_waves(line: Line, frequency: float, physics: Physics = FULL) -> RowWaves:
    """Return the waves along y at a frequency in rad/t0.

    Raises
    ------
    CrystalError
        At the edge of a band, where a wave stands, and in a lattice whose rows do not resist every motion of the next
        row, such as a chain.
    """
    still = line.on_site - frequency**2 * np.diag(line.mass)
    if np.linalg.cond(line.ahead) > 1 / _RUNS**2:
        raise CrystalError(
            "packing.lattice: each row must resist every motion of the next row, as in the hexagonal lattice"
        )
    factor, shape = waves(line, still)
    runs = np.abs(np.abs(factor) - 1) < _RUNS
    carried = np.array([-flux(line, s, s * step) for s, step in zip(shape.T, factor, strict=True)])
    onward = np.where(runs, carried > 0, np.abs(factor) < 1)
    if np.any(np.abs(carried[runs]) < _LEAST_FLUX * np.abs(line.ahead).max()) or 2 * onward.sum() != len(factor):
        raise CrystalError(f"frequency = {frequency:.6g} rad per t0 is at the edge of a band, where a wave stands")
    shape = shape / np.where(runs, np.sqrt(np.abs(carried)), 1.0)
    order = np.argsort(~onward, kind="stable")
    names = tuple(_name(line, physics, frequency, factor[k], shape[:, k]) if runs[k] else "" for k in order)
    return RowWaves(factor[order], shape[:, order], names)


def _name(line: Line, physics: Physics, frequency: float, factor: complex, shape: Complexes) -> str:
    """Return the name of a wave: L moves along y; TR is the lower and RT the upper of the others."""
    if abs(shape[1]) ** 2 > 0.5 * np.sum(np.abs(shape) ** 2):
        return "L"
    across = [k for k, column in enumerate(physics.coordinates) if column != 1]
    matrix = (line.on_site + line.ahead * factor + line.behind / factor)[np.ix_(across, across)]
    root = np.sqrt(line.mass[across])
    frequencies = np.sqrt(np.abs(np.linalg.eigvalsh(matrix / (root[:, None] * root))))
    return MODES[1 + int(np.argmin(np.abs(frequencies - frequency)))]


def lattice_at(contacts: Contacts, sphere: int) -> Contacts:
    """Return the contacts of the perfect lattice around a sphere of a crystal, as the contacts of a cell of one sphere.

    The contacts of the sphere along +x and to the row above represent all contacts of the lattice, so its neighbours
    must be equal to it.
    """
    first, second = contacts.i == sphere, contacts.j == sphere
    vector = np.concatenate([contacts.vector[first], -contacts.vector[second]])
    upward = (vector[:, 1] > 0.1 * contacts.radius[sphere]) | (vector[:, 0] > 1.9 * contacts.radius[sphere])
    upward &= vector[:, 1] > -0.1 * contacts.radius[sphere]
    which = np.concatenate([np.flatnonzero(first), np.flatnonzero(second)])[upward]
    of_sphere = ("radius", "mass")
    own = {
        field.name: getattr(contacts, field.name)[which]
        for field in fields(contacts)
        if field.name not in ("i", "j", "vector", *of_sphere)
    }
    none = np.zeros(len(which), dtype=np.int64)
    one = {name: getattr(contacts, name)[[sphere]] for name in of_sphere}
    return replace(contacts, i=none, j=none.copy(), vector=vector[upward], **own, **one)
