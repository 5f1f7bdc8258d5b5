"""Waves along y at rows that differ: reflection and transmission of every mode, exact in the linear lattice.

Rows n = 0 … N−1 of C spheres each, X_n = (u, v, φ) of all spheres of a row, φ = Rθ, move with e^{−iΩt} by

    K_{n,n−1} X_{n−1} + (K_{nn} − Ω² M_n) X_n + K_{n,n+1} X_{n+1} = 0,    K_{n+1,n} = K_{n,n+1}ᵀ

The first two rows are those of a perfect lattice that goes on in front, the last two those of one behind. In each, with
the wave number k_x = 2πm/W across the width W of a row, the solutions are X_n = s λⁿ with

    [K₋ + λ(K₀ − Ω²M) + λ²K₊] s = 0,    J = −Im(λ s†K₊s)

J is the energy flux towards +n but for the factor Ω/2. Waves that leave to +n have |λ| < 1, or |λ| = 1 and J > 0, and
there are as many as freedoms. From the last row backward X_{n+1} = T_n X_n; at the first row the incident wave and
those that leave it solve the rest. No approximation enters, and evanescent waves are among those that leave.

**What comes out** are shares of the incident flux. Without diffraction orders, m = 0, waves have the names L, TR and RT
of the perfect lattice; others are "order +1" and so on. A plane of equal rows is blind to m ≠ 0.

**A heavy row.** L waves of the perfect lattice are those of a chain, and of one row of the mass 1 + ε
T = 1/(1 + ε² tan²(ξ/2)).

The stiffness of a contact is that at rest: k = (3/2)Aδ^{1/2} along the normal, g = Bδ^{1/2} on the slip, and −P/ℓ
across the normal of a contact of length ℓ that is pressed by P. In LAMMPS the torque of a slip has the arm R − δ/2,
which is the same as the moment of inertia over 1 − η, η = δ/2R. Where η is not the same for all contacts of a sphere it
is their mean, weighted by g: then, and then only, what follows is off by the spread of η, 1e-4 for microspheres.

Breaks at the edge of a band, where incident waves stand (refused), and where two waves have one λ. Dashpots are not
held. Not in the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eig
from scipy.sparse import coo_array

from analysis.theory.bloch import BONDS, TANGENTS
from analysis.theory.contact import Contact
from analysis.theory.network import Network
from analysis.theory.network_state import search

Floats = NDArray[np.float64]
Complexes = NDArray[np.complexfloating]
NAMES = ("L", "TR", "RT")
_FINITE = 1e-30  # 1/|λ| of a wave that ends at once
_RUNS = 1e-6  # ||λ| − 1| of a wave that runs; rounding leaves 1e-8 next to the edge of a band
_LEAST_FLUX = 1e-6  # share of the stiffness: waves that carry less stand
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
        """The same rows seen from behind."""
        turned = tuple(block.T for block in self.ahead[::-1])
        return Rows(self.places[::-1], self.mass[::-1], self.on_site[::-1], turned)


@dataclass(frozen=True)
class Scattering:
    """Shares of the incident energy flux by wave, of those that run at this frequency.

    Attributes
    ----------
    wavenumber : of the incident wave, rad per row; negative if its crests run against its energy.
    transmitted, reflected : share by name of the wave.
    """

    wavenumber: float
    transmitted: dict[str, float]
    reflected: dict[str, float]

    @property
    def balance(self) -> float:
        """Sum of all shares; 1 to rounding."""
        return sum(self.transmitted.values()) + sum(self.reflected.values())


def scattering(rows: Rows, frequency: float, name: str) -> Scattering:
    """Return what the rows make of a wave that comes to them from in front.

    Parameters
    ----------
    rows : Rows
        From behind: `rows.reversed`.
    frequency : Ω, in the unit of the rows: rad/t0 for `heavy_rows`.
    name : "L", "TR" or "RT".

    Raises
    ------
    ValueError
        For an unknown name, a frequency that is not positive, one at which no such wave runs in front or two do, and
        one at the edge of a band.
    """
    still, front, behind, incident = _incoming(rows, frequency, name)
    steps = []  # X_{n+1} = T_n X_n, from the last row backward
    for number in range(len(rows.ahead) - 1, -1, -1):
        steps.append(-np.linalg.solve(still[number + 1], rows.ahead[number].T))
        still[number] = still[number] + rows.ahead[number] @ steps[-1]
    first = np.linalg.solve(still[0], front.pull @ incident.here - incident.push)
    last = first
    for step in reversed(steps):
        last = step @ last
    return Scattering(
        incident.wavenumber,
        behind.shares(last, incident.flux),
        front.shares(first - incident.here, incident.flux),
    )


def changes_by_mass(rows: Rows, frequency: float, name: str) -> Floats:
    """Return the derivatives (N,) of the share that passes by the logarithm of the mass of each row.

    Arguments and errors are those of `scattering`. The lattices in front and behind stay what they are, so that the
    first and the last row, which are theirs too, count as rows of their own.
    """
    still, front, behind, incident = _incoming(rows, frequency, name)
    ends = np.cumsum([0, *map(len, rows.mass)])
    whole = np.zeros((ends[-1], ends[-1]), dtype=complex)
    for n, block in enumerate(still):
        whole[ends[n] : ends[n + 1], ends[n] : ends[n + 1]] = block
    for n, onward in enumerate(rows.ahead):
        whole[ends[n] : ends[n + 1], ends[n + 1] : ends[n + 2]] = onward
        whole[ends[n + 1] : ends[n + 2], ends[n] : ends[n + 1]] = onward.T
    source = np.zeros(ends[-1], dtype=complex)
    source[: ends[1]] = front.pull @ incident.here - incident.push
    motion = np.linalg.solve(whole, source)
    result = np.zeros(len(rows.mass))
    for _, flux, amplitude in behind.leaving:
        heard = np.zeros(ends[-1], dtype=complex)
        heard[ends[-2] :] = amplitude
        pushed = np.linalg.solve(whole.T, heard) * frequency**2 * np.concatenate(rows.mass) * motion
        here = (amplitude @ motion[ends[-2] :]).conj()
        result += 2 * flux / incident.flux * np.real(here * np.add.reduceat(pushed, ends[:-1]))
    return result


def _incoming(rows: Rows, frequency: float, name: str) -> tuple[list[Complexes], "_Side", "_Side", "Running"]:
    """Return the diagonal blocks of the rows, the lattices in front and behind, and the wave that comes."""
    if name not in NAMES:
        raise ValueError(f"name = {name!r}: must be one of {', '.join(NAMES)}")
    if not 0 < frequency < np.inf:
        raise ValueError(f"frequency = {frequency!r}: must be positive and finite")
    front, behind = _Side.of(rows, frequency), _Side.of(rows.reversed, frequency)
    named = [wave for wave in front.coming if wave.name == name]
    if len(named) != 1:
        there = ", ".join(wave.name for wave in front.coming) or "none"
        raise ValueError(f"frequency = {frequency:.6g}: must be that of one wave {name} in front; there are: {there}")
    still: list[Complexes] = [
        stiffness - np.diag(frequency**2 * mass) + 0j for stiffness, mass in zip(rows.on_site, rows.mass, strict=True)
    ]
    still[0] = still[0] + front.pull
    still[-1] = still[-1] + behind.pull
    return still, front, behind, named[0]


def running(rows: Rows, frequency: float) -> dict[str, "Running"]:
    """Return the waves L, TR and RT that run to the rows from in front, of those that do at a frequency.

    The waves that run away behind are, by the mirror of a lattice, those of `rows.reversed`.
    """
    return {wave.name: wave for wave in _Side.of(rows, frequency).coming if wave.name in NAMES}


@dataclass(frozen=True, eq=False)
class Running:
    """A wave that runs to row 0 from rows n < 0.

    Attributes
    ----------
    name : of the wave.
    wavenumber : rad per row; negative if its crests run against its energy.
    flux : J.
    here : (3C,) X₀.
    push : (3C,) K₋X₋₁.
    """

    name: str
    wavenumber: float
    flux: float
    here: Complexes
    push: Complexes


@dataclass(frozen=True, eq=False)
class _Side:
    """The perfect lattice in front of row 0, at one frequency.

    Attributes
    ----------
    coming : waves that run to row 0.
    pull : (3C, 3C) K₋T, where X₋₁ = T X₀ in waves that leave.
    leaving : names, fluxes and rows that give the amplitude of each wave that leaves, at row 0.
    """

    coming: tuple[Running, ...]
    pull: Complexes
    leaving: tuple[tuple[str, float, Complexes], ...]

    @classmethod
    def of(cls, rows: Rows, frequency: float) -> "_Side":
        places, mass = rows.places[0], rows.mass[0][:3]
        coming, leaving, pull = [], [], np.zeros(rows.on_site[0].shape, dtype=complex)
        for order in range(-((len(places) - 1) // 2), len(places) // 2 + 1):
            here, next_one = (_plane(each, order) for each in rows.places[:2])
            on_site = here.conj().T @ rows.on_site[0] @ here
            ahead = here.conj().T @ rows.ahead[0] @ next_one
            factor, shape, flux = lattice_waves(mass, on_site, ahead, frequency)
            names = [_name(mass, on_site, ahead, frequency, order, *wave) for wave in zip(factor, shape.T, strict=True)]
            for each in np.flatnonzero(flux[:3]):
                push = here @ (ahead.conj().T @ shape[:, each] / factor[each])
                angle = float(np.angle(factor[each]))
                coming.append(Running(names[each], angle, float(flux[each]), here @ shape[:, each], push))
            amplitudes = np.linalg.inv(shape[:, 3:])
            pull += here @ ahead.conj().T @ (shape[:, 3:] / factor[3:]) @ amplitudes @ here.conj().T
            for each in np.flatnonzero(flux[3:]):
                leaving.append((names[3 + each], float(-flux[3 + each]), amplitudes[each] @ here.conj().T))
        return cls(tuple(coming), pull, tuple(leaving))

    def shares(self, motion: Complexes, incident: float) -> dict[str, float]:
        """Return the flux of each wave in a motion of row 0 of waves that leave, over the incident flux."""
        found: dict[str, float] = {}
        for name, flux, amplitude in self.leaving:
            found[name] = found.get(name, 0.0) + flux * float(np.abs(amplitude @ motion) ** 2) / incident
        return dict(sorted(found.items()))


def _plane(places: Floats, order: int) -> Complexes:
    """Return u, v and φ of a wave e^{2πi m x/W} on the spheres of a row, (3C, 3), of norm 1."""
    phases = np.exp(2j * np.pi * order * places) / np.sqrt(len(places))
    return np.kron(phases[:, None], np.eye(3))


def lattice_waves(
    mass: Floats, on_site: Complexes, ahead: Complexes, frequency: float
) -> tuple[Complexes, Complexes, Floats]:
    """Return λ (2F,), s (F, 2F) and J (2F,) of the waves of a lattice of F freedoms, those that leave to +n first.

    Raises ValueError at the edge of a band.
    """
    count = len(mass)
    still, one, none = on_site - np.diag(frequency**2 * mass), np.eye(count), np.zeros((count, count))
    pencil = np.block([[none, one], [-ahead.conj().T, -still]]), np.block([[one, none], [none, ahead]])
    (above, below), vectors = eig(*pencil, homogeneous_eigvals=True)
    # A contact that leaves a freedom alone, as in a chain, has factors 0 and ∞
    factor = above / np.where(np.abs(below) > _FINITE * np.abs(above), below, _FINITE * np.abs(above))
    grows = np.abs(factor) > 1
    shape = np.where(grows, vectors[count:], vectors[:count])
    shape /= np.linalg.norm(shape, axis=0)
    runs = np.abs(np.abs(factor) - 1) < _RUNS
    flux = np.where(runs, -np.imag(np.sum(shape.conj() * (ahead @ shape), axis=0) * np.where(runs, factor, 0)), 0.0)
    onward = np.where(runs, flux > 0, ~grows)
    if np.any(runs & (np.abs(flux) < _LEAST_FLUX * np.abs(ahead).max())) or np.count_nonzero(onward) != count:
        raise ValueError(f"frequency = {frequency:.6g}: is at the edge of a band, where a wave carries no energy")
    order = np.argsort(~onward, kind="stable")
    return factor[order], shape[:, order], flux[order]


def _name(
    mass: Floats, on_site: Complexes, ahead: Complexes, frequency: float, order: int, factor: complex, shape: Complexes
) -> str:
    """Return the name of a wave: L moves along y; TR is the lower and RT the upper of the others."""
    if order:
        return f"order {order:+d}"
    if abs(shape[1]) ** 2 > 0.5:
        return "L"
    phase = factor / abs(factor)
    matrix = on_site + ahead * phase + ahead.conj().T / phase
    across = np.ix_([0, 2], [0, 2])
    root = np.sqrt(mass[[0, 2]])
    frequencies = np.sqrt(np.abs(np.linalg.eigvalsh(matrix[across] / (root[:, None] * root))))
    return NAMES[1 + int(np.argmin(np.abs(frequencies - frequency)))]


# --- rows ------------------------------------------------------------------------------------------------------------


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
    if contact.viscosity or contact.restitution is not None:
        raise ValueError("contact: must be without dashpots")
    stiffness = np.array([1.0, contact.shear_stiffness, -contact.softening]) / (2 * (contact.kappa + 3))
    on_site, ahead = np.zeros((2, 3, 3))
    for bond, tangent in zip(BONDS, TANGENTS, strict=True):
        on_i, on_j = _rows_of_contact(bond, tangent)
        on_site += (on_i.T * stiffness) @ on_i + (on_j.T * stiffness) @ on_j
        across = (on_i.T * stiffness) @ on_j
        if bond[1] == 0:  # along the row
            on_site += across + across.T
        else:
            ahead += across
    count = len(relative)
    mass = tuple(each * contact.masses for each in relative)
    return Rows((np.zeros(1),) * count, mass, (on_site,) * count, (ahead,) * (count - 1))


def rows_of(network: Network, first: int, last: int) -> Rows:
    """Return rows of a network at rest, counted upwards from 0, with the lattices beyond that their ends have.

    Parameters
    ----------
    network : Network
        Spheres in rows along x, periodic there, of which only neighbours touch.
    first, last : int
        The first two rows, and the last two, must be those of perfect lattices.

    Raises
    ------
    ValueError
        For rows that are not there, that touch others than the next ones, or whose ends are no perfect lattice.
    """
    height = network.position[:, 1]
    order = np.argsort(height, kind="stable")
    number = np.empty(len(order), dtype=np.intp)
    number[order] = np.concatenate([[0], np.cumsum(np.diff(height[order]) > network.radius.min() / 2)])
    if not 1 <= first < last - 2 < number.max() - 2:
        raise ValueError(f"first, last = {first}, {last}: must be rows from 1 to {number.max() - 1}, four at least")
    if not np.isfinite(network.cell[0]):
        raise ValueError(f"cell = {network.cell}: must be periodic in x")
    pairs = search(network, np.zeros((2, len(height))))
    touch = pairs.overlap > 0
    i, j, apart, overlap = pairs.first[touch], pairs.second[touch], pairs.apart[:, touch], pairs.overlap[touch]
    if np.any(np.abs(number[i] - number[j]) > 1):
        raise ValueError("the network has contacts between rows that are not next to each other")
    root = np.sqrt(overlap)
    shear = pairs.B[touch] * root
    push = pairs.A[touch] * overlap * root - pairs.F[touch]
    springs_of = np.stack([1.5 * pairs.A[touch] * root, shear, -push / pairs.length[touch]])
    normal = (apart / pairs.length[touch]).T
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    on_i, on_j = (np.array(each) for each in zip(*map(_rows_of_contact, normal, tangent), strict=True))
    stretch = np.concatenate([on_i, on_j], axis=2)  # (contacts, 3, 6)
    blocks = np.einsum("csa,sc,csb->cab", stretch, springs_of, stretch)
    freedoms = np.concatenate([3 * i[:, None] + np.arange(3), 3 * j[:, None] + np.arange(3)], axis=1)
    size = 3 * len(height)
    where = np.repeat(freedoms, 6, axis=1).ravel(), np.tile(freedoms, 6).ravel()
    whole = coo_array((blocks.ravel(), where), shape=(size, size)).tocsr()
    turned, weighted = np.zeros((2, len(height)))
    for end in (i, j):
        turned += np.bincount(end, shear, len(height))
        weighted += np.bincount(end, shear * overlap / (2 * network.radius[end]), len(height))
    inertia = 0.4 * network.mass / (1 - weighted / np.maximum(turned, np.finfo(float).tiny))
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


def _rows_of_contact(normal: ArrayLike, tangent: ArrayLike) -> tuple[Floats, Floats]:
    """Return δN, δS and δT of a contact by (u, v, φ) of its two spheres, (3, 3) each."""
    n, t = np.append(normal, 0.0), np.append(tangent, 0.0)
    turn = np.array([0.0, 0.0, 1.0])
    return np.stack([-n, -t - turn, -t]), np.stack([n, t - turn, t])


def _require_lattice(rows: Rows, number: int) -> None:
    """Raise a ValueError unless the first two rows are alike, and of equal spheres."""
    (here, then), (first, second) = (_plane(each, 0) for each in rows.places[:2]), rows.on_site[:2]
    after = _plane(rows.places[2], 0)
    scale = np.abs(first).max()
    pairs = (
        (here.T @ first @ here, then.T @ second @ then, scale),
        (here.T @ rows.ahead[0] @ then, then.T @ rows.ahead[1] @ after, scale),
        (rows.mass[0][:3], rows.mass[1][:3], rows.mass[0].max()),
        (rows.mass[0], np.tile(rows.mass[0][:3], len(rows.places[0])), rows.mass[0].max()),
    )
    if len(rows.places[0]) != len(rows.places[1]) or any(np.abs(a - b).max() > _ALIKE * unit for a, b, unit in pairs):
        raise ValueError(f"row {number}: must be of a perfect lattice, as the next one; take rows farther away")
