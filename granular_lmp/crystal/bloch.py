"""Bloch modes of a crystal from its contacts: frequencies and shapes for any wave vector and any number of spheres.

In a plane wave, sphere s of the cell, at r, moves by u_s e^{i(k·r − ωt)} and turns by φ_s e^{i(k·r − ωt)}, where
φ = Rθ with the radius R of the sphere. A contact from i to j with the vector d, unit normal n and tangent t (n turned
by +90°) is then stretched by δN, moved sideways by δT and sheared by δS, up to a common phase:

    δN = n·(u_j e^{ik·d/2} − u_i e^{−ik·d/2}),    δT the same with t,    δS = δT − (φ_j e^{ik·d/2} + φ_i e^{−ik·d/2})

The energy is E = ½ Σ_contacts (k |δN|² + g |δS|² − (f/ℓ) |δT|²) with the normal and shear stiffnesses k and g. The last
term belongs to a contact of length ℓ that a force f compresses at rest: as the contact turns it pushes sideways, like a
compressed strut that buckles. Shapes are the eigenvectors of M^{-1/2} (∂²E) M^{-1/2}; ω² of a shape is then the sum of
squares in E. This keeps ω accurate for long waves, where an eigenvalue loses half its digits.

With φ = i f, the rows of a cell of one sphere are real, δN = 2 sin(χ/2) n·u and δS = 2 sin(χ/2) t·u − 2 cos(χ/2) f with
χ = k·d, and so are its shapes (u, f). The waves of a lattice with one sphere per cell have the names L, TR and RT
(`granular_lmp.crystal.modes`). Frequencies are in rad/t0 and wave vectors in 1/R of a reference sphere.

An effect that a scene leaves out removes its terms here: without shear g = 0, without rotation f = 0. Every sphere has
six freedoms and every contact two tangents; in the plane three of the freedoms move (`Physics.coordinates`). A rigid
wall is a contact whose other side is at rest: δN = −n·u_i, δS = −t·u_i − φ_i·(n × t).

**The torque arm.** The shear force at a contact with overlap δ has the arm R in its work on the slip, but in LAMMPS the
arm R − δ/2 in the torque. If all contacts of a sphere have the same overlap, this is equivalent to an inertia larger by
1/(1 − η), η = δ/2R. Otherwise the forces do not derive from an energy. η is then the mean over the contacts of the
sphere, weighted by g, and frequencies are wrong by less than the spread of η, 1e-4 for microspheres. At a wall the
torque has the arm R; for a crystal on a wall the modes are exact, from a matrix that is not symmetric (`_exact`).

This numerical derivation from the geometry is independent of the closed forms in ``granular_analysis.second_harmonic``.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.mode import FULL, F, Physics
from granular_lmp.crystal.sphere import INERTIA_RATIO, Sphere
from granular_lmp.errors import CrystalError

# If −ω² exceeds this share of the largest ω², it is not rounding: the crystal buckles
_BUCKLING = 1e-9
_STIFF = 1e-3  # 1/t0²: the least scale of rounding of ω², for motions that no contact resists
_FED = 1e-5  # largest imaginary part of ω², over the largest ω²; a film without symmetry has 3e-7 for η = 2.5e-4
SPARSE = 12  # number of spheres per cell above which rows are sparse; a contact has 12 numbers
_APART = 1e-9  # a coupling of two subspaces below this share of the largest matrix element is rounding
Floats = NDArray[np.float64]
Springs = list[tuple[NDArray[Any], NDArray[Any]]]


def bloch_modes(
    contacts: Contacts, sphere: Sphere, wavevectors: ArrayLike, physics: Physics = FULL
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return frequencies and shapes of all modes of a crystal at any wave vectors, lowest first.

    Parameters
    ----------
    contacts : Contacts
        Contacts of the spheres of one cell.
    sphere : Sphere
        Reference sphere, whose R and t0 are the units.
    wavevectors : array_like, (..., 2 or 3)
        Wave vectors k, 1/R; without kz if they lie in the plane.
    physics : Physics
        Degrees of freedom.

    Returns
    -------
    frequencies : (..., FN) array
        Frequencies in rad/t0, ascending, for the F freedoms of `Physics.coordinates`: 3 in the plane, 6 in space.
    shapes : (..., FN, 6N) array
        One row per mode: (u, f) of each sphere in turn, normalised to 1; real for one sphere per cell without a wall.
        The phase of a row is arbitrary, and degenerate modes are returned in an arbitrary basis.

    Raises
    ------
    CrystalError
        If a mode has a negative ω², so the crystal is not at a stable equilibrium; if modes grow or decay too much
        because torques have different arms.
    ValueError
        If spheres move in the plane and contacts do not lie in a plane z = const.
    """
    if not physics.space:
        require_plane(contacts)
    columns = [6 * each + column for each in range(len(contacts.mass)) for column in physics.coordinates]
    return solve(contacts, sphere, np.asarray(wavevectors, dtype=float), physics, np.array(columns))


def require_plane(contacts: Contacts) -> None:
    """Raise a ValueError unless all contacts lie in a plane z = const."""
    outside = np.flatnonzero(contacts.vector[:, 2])
    if len(outside):
        raise ValueError(f"contact {outside[0]}: leaves the plane z = const; all contacts must lie in this plane")


def effective_inertia(contacts: Contacts) -> Floats:
    """Return I/R² = Ĩm/(1 − η) of each sphere, (N,), kg: the effective inertia with LAMMPS's torque arm.

    A sphere without shear contacts to other spheres has Ĩm. The module docstring defines η.
    """
    return INERTIA_RATIO * contacts.mass / (1 - _arm_loss(contacts))


def _arm_loss(contacts: Contacts) -> Floats:
    """Return the mean η of each sphere, (N,), over its contacts with other spheres, weighted by g."""
    turned, weighted = np.zeros_like(contacts.mass), np.zeros_like(contacts.mass)
    pairs = ~contacts.on_wall
    stiffness, overlap = contacts.shear_stiffness[pairs], contacts.overlap[pairs]
    for end in (contacts.i[pairs], contacts.j[pairs]):
        np.add.at(turned, end, stiffness)
        np.add.at(weighted, end, stiffness * overlap / (2 * contacts.radius[end]))
    return np.divide(weighted, turned, out=np.zeros_like(turned), where=turned > 0)


def effective_rolling(contacts: Contacts, physics: Physics) -> Floats:
    """Return the rolling stiffness k_r/(1 − η) of each contact for use with `effective_inertia`, (C,), N/m.

    LAMMPS's rolling torque has the arm Rc, which is not reduced by δ/2 as in shear torques. The effective inertia is
    therefore too large for rolling, and the stiffness compensates for this.
    """
    return physics.rolling / (1 - contacts.overlap / contacts.radii)


def stretch_rows(
    contacts: Contacts, wavevectors: Floats, ways: Sequence[int] = (0, 1)
) -> tuple[NDArray[Any], list[NDArray[Any]], list[NDArray[Any]]]:
    """Return rows (..., C, 6N) that give deformations from a shape (u, f), k in 1/m.

    The rows give −i δN; then, for each of the tangents `ways`, −i δT, and −i (δS − δT).
    """
    phase_i, phase_j = _phases(contacts, wavevectors)

    def moves(way: NDArray[Any]) -> NDArray[Any]:
        part = np.hstack([way, np.zeros_like(way)])
        return _rows(contacts, 1j * phase_i * part, -1j * phase_j * part)

    turns = [_turn_rows(contacts, way, -phase_i, -phase_j) for way in ways]
    return moves(contacts.normals), [moves(contacts.tangents[:, way]) for way in ways], turns


def twist_rows(contacts: Contacts, wavevectors: Floats) -> NDArray[Any]:
    """Return the rows (..., C, 6N) that give −i times (φ_i + φ_j)·n from a shape (u, f); k in 1/m."""
    part = np.hstack([np.zeros_like(contacts.normals), contacts.normals])
    phase_i, phase_j = _phases(contacts, wavevectors)
    return _rows(contacts, phase_i * part, phase_j * part)


def _turn_rows(contacts: Contacts, way: int, on_i: NDArray[Any], on_j: NDArray[Any]) -> NDArray[Any]:
    """Return the rows (..., C, 6N) of the rotations about n × t, from factors (..., C, 1) of spheres i and j."""
    about = contacts.turns[:, way]
    part = np.hstack([np.zeros_like(about), about])
    return _rows(contacts, on_i * part, on_j * part)


def _torque_rows(contacts: Contacts, wavevectors: Floats) -> list[NDArray[Any]]:
    """Return, for both tangents, the rows δS − δT of `stretch_rows` times the correction for the true torque arm.

    The arm is (R − δ/2)/R for a pair and 1 for a wall; `effective_inertia` already contains the mean 1 − η of each
    sphere.
    """
    phase_i, phase_j = _phases(contacts, wavevectors)
    mean, pairs = 1 - _arm_loss(contacts), ~contacts.on_wall
    more_i, more_j = (
        (1 - pairs * contacts.overlap / (2 * contacts.radius[end])) / mean[end] - 1 for end in (contacts.i, contacts.j)
    )
    factors = -phase_i * more_i[:, None], -phase_j * more_j[:, None]
    return [_turn_rows(contacts, way, *factors) for way in range(2)]


def _exact(matrix: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the real parts of ω² (..., F), and eigenvectors as columns, for a matrix that is nearly symmetric.

    Torques with different arms do work over a period, in LAMMPS too. In a layer that is symmetric under half a turn
    about z, ω² is real; in a film of close-packed layers, modes grow or decay by some 1e-7 of the highest frequency.

    Raises
    ------
    CrystalError
        If the imaginary part of an ω² exceeds 1e-5 of the largest ω².
    """
    squared, vectors = np.linalg.eig(matrix)
    if np.abs(np.imag(squared)).max() > _FED * np.abs(squared).max():
        raise CrystalError(
            "modes grow or decay because torques have different arms; make the overlaps of the contacts more equal"
        )
    return np.real(squared), vectors


def _phases(contacts: Contacts, wavevectors: Floats) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return e^{−ik·d/2} and e^{ik·d/2} of each contact, (..., C, 1), for spheres i and j."""
    half_phase = wavevectors @ contacts.vector[:, : wavevectors.shape[-1]].T / 2
    return np.exp(-1j * half_phase)[..., None], np.exp(1j * half_phase)[..., None]


def roll_rows(contacts: Contacts, wavevectors: Floats) -> NDArray[Any]:
    """Return the rows (..., C, 6N) that give the roll ρ of a shape in the plane, up to a phase; k in 1/m."""
    phase_i, phase_j = _phases(contacts, wavevectors)
    turn = np.eye(6)[F]
    share_i, share_j = ((contacts.radius[other] / contacts.radii)[:, None] for other in (contacts.j, contacts.i))
    return _rows(contacts, 1j * phase_i * share_i * turn, -1j * phase_j * share_j * turn)


def _rows(contacts: Contacts, on_i: NDArray[Any], on_j: NDArray[Any]) -> NDArray[Any]:
    """Return one row per contact over the freedoms of all spheres, from its parts (..., C, 6) on spheres i and j.

    For one wave vector, the rows are a sparse array if a cell has more than `SPARSE` spheres.
    """
    spheres, pairs = len(contacts.mass), ~contacts.on_wall
    if spheres > SPARSE and on_i.ndim == 2:
        from scipy.sparse import csr_array  # slow to import, and only thick films need it

        number, freedom = np.arange(len(contacts)), np.arange(6)
        own = np.concatenate([number, number[pairs]])
        of = 6 * np.concatenate([contacts.i, contacts.j[pairs]])[:, None] + freedom
        values = np.concatenate([on_i, on_j[pairs]]).astype(complex)
        places = np.repeat(own, 6), of.ravel()
        return csr_array((values.ravel(), places), (len(contacts), 6 * spheres))
    if spheres == 1:
        rows = on_i + pairs[:, None] * on_j
        return rows.real if pairs.all() else rows
    rows = np.zeros((*on_i.shape[:-1], spheres, 6), dtype=complex)
    rows[..., np.arange(len(contacts)), contacts.i, :] = on_i
    rows[..., np.flatnonzero(pairs), contacts.j[pairs], :] += on_j[..., pairs, :]
    return rows.reshape(*on_i.shape[:-1], 6 * spheres)


def _springs(
    contacts: Contacts, sphere: Sphere, wavevectors: Floats, physics: Physics
) -> tuple[Springs, list[NDArray[Any]], NDArray[Any]]:
    """Return springs, torques, and 1/√mass of the freedoms, (6N,).

    Springs are stiffnesses with their rows: the normal spring first, then the slips, then others. Torques are the
    corrections of the rows of the slips for true arms, [] if all arms are equal. All rows are divided by the square
    roots of the masses.
    """
    k = wavevectors / sphere.radius
    ways = range(2 if physics.space else 1)  # in the plane there is no motion along the second tangent
    normal, sideways, turn = stretch_rows(contacts, k, ways)
    mass = np.repeat([contacts.mass, effective_inertia(contacts)], 3, axis=0).T.ravel()
    inverse_root_mass = np.sqrt(sphere.mass / mass)
    per_mass = sphere.time_scale**2 / sphere.mass
    springs = [(contacts.normal_stiffness, normal)]
    springs += [(contacts.shear_stiffness, sideways[way] + turn[way]) for way in ways if physics.shear]
    if physics.rolling and physics.rotation:
        springs.append((effective_rolling(contacts, physics), roll_rows(contacts, k)))
    if contacts.contact_force.any():
        springs += [(-contacts.contact_force / contacts.length, sideways[way]) for way in ways]
    alike = not contacts.on_wall.any() or not physics.shear or not physics.rotation
    torques = [] if alike else [rows * inverse_root_mass for rows in _torque_rows(contacts, k)]
    return [(each[:, None] * per_mass, rows * inverse_root_mass) for each, rows in springs], torques, inverse_root_mass


def solve(
    contacts: Contacts, sphere: Sphere, wavevectors: Floats, physics: Physics, basis: NDArray[Any]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return frequencies, ascending, and shapes of the modes in a subspace of the freedoms.

    basis : indices of freedoms, (F,), or orthonormal columns, (6N, F); each column moves one sphere, and either
        displaces or rotates it.
    """

    def within(rows: Any) -> NDArray[Any]:
        rows = rows if isinstance(rows, np.ndarray) else rows.toarray()
        return np.asarray(rows[..., basis] if basis.ndim == 1 else rows @ basis)

    springs, torques, inverse_root_mass = _springs(contacts, sphere, wavevectors, physics)
    energy = [(weight, within(rows)) for weight, rows in springs]
    matrix = sum(rows.conj().swapaxes(-1, -2) @ (weight * rows) for weight, rows in energy)
    if torques:
        for rows, (weight, slip) in zip(torques, energy[1:3], strict=True):
            matrix = matrix + within(rows).conj().swapaxes(-1, -2) @ (weight * slip)
        squared, vectors = _exact(matrix)
    else:
        _, vectors = np.linalg.eigh(matrix)
        squared = sum(np.sum(weight * np.abs(rows @ vectors) ** 2, axis=-2) for weight, rows in energy)
    if squared.min() < -_BUCKLING * max(squared.max(), _STIFF):
        raise CrystalError(
            f"the crystal is not stable: a mode has the squared frequency {squared.min():.6g} in 1/t0^2, which must "
            "not be negative; press the contacts together less, or hold the crystal sideways"
        )
    vectors = vectors.swapaxes(-1, -2)
    shapes = np.zeros((*vectors.shape[:-1], len(inverse_root_mass)), dtype=vectors.dtype)
    if basis.ndim == 1:
        shapes[..., basis] = vectors
    else:
        shapes = vectors @ basis.T
    shapes = shapes * inverse_root_mass
    shapes /= np.linalg.norm(shapes, axis=-1, keepdims=True)
    order = np.argsort(squared, axis=-1, kind="stable")
    frequencies = np.sqrt(np.maximum(np.take_along_axis(squared, order, axis=-1), 0.0))
    return frequencies, np.take_along_axis(shapes, order[..., None], axis=-2)


def part(
    contacts: Contacts,
    sphere: Sphere,
    wavevector: Floats,
    physics: Physics,
    one: NDArray[Any],
    other: NDArray[Any],
) -> bool:
    """Return whether two subspaces, (6N, F) columns each, are uncoupled at a wave vector (2,)."""
    springs, torques, _ = _springs(contacts, sphere, wavevector, physics)
    parts = [(rows, weight * rows) for weight, rows in springs]
    parts += [(rows, weight * slip) for rows, (weight, slip) in zip(torques, springs[1:], strict=False)]
    matrix: Any = sum(left.conj().T @ right for left, right in parts)
    return all(
        abs(each).max() < _APART * abs(matrix).max() for each in (one.T @ matrix @ other, other.T @ matrix @ one)
    )


def matrix_of(contacts: Contacts, sphere: Sphere, wavevector: Floats, physics: Physics) -> tuple[Any, NDArray[Any]]:
    """Return the sparse matrix (6N, 6N) with the eigenvalues ω², for freedoms times √mass, and 1/√mass (6N,)."""
    springs, torques, inverse_root_mass = _springs(contacts, sphere, wavevector, physics)
    parts: list[tuple[Any, Any]] = [(rows, rows * weight) for weight, rows in springs]
    parts += [(rows, slip) for rows, (_, slip) in zip(torques, parts[1:], strict=False)]
    return sum(left.conj().T.tocsr() @ right for left, right in parts), inverse_root_mass
