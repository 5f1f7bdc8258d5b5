"""Bloch modes of a crystal from its contacts: frequencies and shapes for any wave vector and any number of spheres.

In a plane wave sphere s of the cell, at r, moves by u_s e^{i(k·r − ωt)} and turns by φ_s e^{i(k·r − ωt)}, φ = Rθ with
its own R. The contact from i to j with vector d, unit normal n and tangent t (n turned by +90°) is then stretched,
moved sideways and sheared, up to a common phase, by

    δN = n·(u_j e^{ik·d/2} − u_i e^{−ik·d/2}),    δT the same with t,    δS = δT − (φ_j e^{ik·d/2} + φ_i e^{−ik·d/2})

The energy is E = ½ Σ_contacts (k |δN|² + g |δS|² − (f/ℓ) |δT|²) with the normal and the shear stiffness k and g; the
last term is there where a contact of length ℓ is pressed together by a force f at rest: one that turns pushes on, as a
compressed strut does when it buckles. Shapes are the eigenvectors of M^{-1/2} (∂²E) M^{-1/2}; each ω² is then the sum
of squares E gives for its shape. Taken so, ω is accurate for long waves too, where an eigenvalue loses half its digits.

With φ = i f the rows of a cell of one sphere are real: δN = 2 sin(χ/2) n·u, δS = 2 sin(χ/2) t·u − 2 cos(χ/2) f with
χ = k·d, and so are its shapes (u, f). The waves of a lattice of one sphere a cell have the names L, TR and RT
(`bloch_mode`). Frequencies are in rad/t0, wave vectors in 1/R, both of a reference sphere.

An effect that a scene leaves out leaves its part out here: no shear, no g; no rotation, no f. Every sphere has six
freedoms and every contact two tangents; in the plane three of the freedoms move (`Physics.coordinates`). A rigid wall
is a contact whose other side is at rest and drops out: δN = −n·u_i, δS = −t·u_i − φ_i·(n × t).

**The torque arm.** A shear force at a contact with overlap δ has the arm R as it does work on the slip, but in LAMMPS
the arm R − δ/2 in the torque. Where all contacts of a sphere have one overlap that is the same as an inertia larger by
1/(1 − η), η = δ/2R. Where they have not, the contacts are no longer derived from an energy; η is then the mean over the
contacts of the sphere, weighted by g, and frequencies are wrong by less than the spread of η, 1e-4 for microspheres. At
a wall the torque has the arm R. A crystal on one has the exact modes, of a matrix that is not symmetric (`_exact`).

This is a numerical derivation from the geometry, kept apart from the closed forms of ``analysis.second_harmonic``.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.lattices import lattice_constant, lattice_of_contacts
from granular_lmp.crystal.mode import FULL, FX, TURNS, UX, UY, F, Mode, Physics, branch_mode
from granular_lmp.crystal.sphere import INERTIA_RATIO, Sphere
from granular_lmp.crystal.wavevector import WaveVector, zone_path
from granular_lmp.errors import CrystalError, SceneError

MODES = ("L", "TR", "RT")
BRANCHES = tuple(map(str, range(1, 7)))  # of two spheres a cell in the plane, of one in space; lowest first
_MEET = 1e-9  # relative distance of two frequencies below which the shapes of their branches are any
_STILL = 1e-6  # of the highest frequency: one below it is the root of a rounding
# A wave along an axis keeps the mirror of the lattice that holds the axis: L lives in the one displacement, TR and RT
# in the other and the rotation; each sorted by frequency.
_SUBSPACE = {
    "y": {"L": ([UY], 0), "TR": ([UX, F], 0), "RT": ([UX, F], 1)},
    "x": {"L": ([UX], 0), "TR": ([UY, F], 0), "RT": ([UY, F], 1)},
}
# A negative ω², over the largest one, that is not rounding: the crystal buckles.
_BUCKLING = 1e-9


# --- any crystal -----------------------------------------------------------------------------------------------------


def bloch_modes(
    contacts: Contacts, sphere: Sphere, wavevectors: ArrayLike, physics: Physics = FULL
) -> tuple[NDArray, NDArray]:
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
        Frequencies in rad/t0, ascending, of the F freedoms of `Physics.coordinates`: 3 in the plane, 6 in space.
    shapes : (..., FN, 6N) array
        One row per mode: (u, f) of each sphere in turn, normalised to 1; real for one sphere per cell without a wall.
        The phase of a row is arbitrary, and degenerate modes are returned in an arbitrary basis.

    Raises
    ------
    CrystalError
        If a mode has a negative ω², so that the crystal is not at a stable equilibrium.
    ValueError
        If spheres move in the plane and contacts do not lie in a plane z = const.
    """
    if not physics.space:
        require_plane(contacts)
    columns = [6 * each + column for each in range(len(contacts.mass)) for column in physics.coordinates]
    return _solve(contacts, sphere, np.asarray(wavevectors, dtype=float), physics, columns)


def require_plane(contacts: Contacts) -> None:
    """Raise a ValueError unless all contacts lie in a plane z = const."""
    outside = np.flatnonzero(contacts.normals[:, 2])
    if len(outside):
        raise ValueError(f"contact {outside[0]}: leaves the plane z = const, in which all contacts must lie")


def effective_inertia(contacts: Contacts) -> NDArray:
    """Return I/R² = Ĩm/(1 − η) of each sphere, (N,), kg: its inertia as LAMMPS's torque arm makes it.

    A sphere that no contact turns keeps Ĩm. The module docstring defines η.
    """
    return INERTIA_RATIO * contacts.mass / (1 - _arm_loss(contacts))


def _arm_loss(contacts: Contacts) -> NDArray:
    """Return the mean η of each sphere, (N,), over its contacts with others."""
    turned, weighted = np.zeros_like(contacts.mass), np.zeros_like(contacts.mass)
    pairs = ~contacts.on_wall
    stiffness, overlap = contacts.shear_stiffness[pairs], contacts.overlap[pairs]
    for end in (contacts.i[pairs], contacts.j[pairs]):
        np.add.at(turned, end, stiffness)
        np.add.at(weighted, end, stiffness * overlap / (2 * contacts.radius[end]))
    return np.divide(weighted, turned, out=np.zeros_like(turned), where=turned > 0)


def effective_rolling(contacts: Contacts, physics: Physics) -> NDArray:
    """Return the rolling stiffness k_r/(1 − η) of each contact that goes with `effective_inertia`, (C,), N/m.

    LAMMPS's torque of a roll has the arm Rc, without the part δ/2 that shear torques lose: the effective inertia is too
    large for it, which its stiffness makes up for.
    """
    return physics.rolling / (1 - contacts.overlap / contacts.radii)


def _stretch_rows(contacts: Contacts, wavevectors: NDArray) -> tuple[NDArray, list[NDArray], list[NDArray]]:
    """Return rows (..., C, 6N) of a shape (u, f): −i times δN, and of both tangents δT and δS − δT; k in 1/m."""
    phase_i, phase_j = _phases(contacts, wavevectors)

    def moves(way: NDArray) -> NDArray:
        part = np.hstack([way, np.zeros_like(way)])
        return _rows(contacts, 1j * phase_i * part, -1j * phase_j * part)

    tangents = [contacts.tangents[:, way] for way in range(2)]
    turns = [_turn_rows(contacts, way, -phase_i, -phase_j) for way in tangents]
    return moves(contacts.normals), [moves(way) for way in tangents], turns


def _turn_rows(contacts: Contacts, tangent: NDArray, on_i: NDArray, on_j: NDArray) -> NDArray:
    """Return the rows (..., C, 6N) of the rotations about n × t, from factors (..., C, 1) of spheres i and j."""
    part = np.hstack([np.zeros_like(tangent), np.cross(contacts.normals, tangent)])
    return _rows(contacts, on_i * part, on_j * part)


def _torque_rows(contacts: Contacts, wavevectors: NDArray) -> list[NDArray]:
    """Return, for both tangents, the rows of `_stretch_rows` of δS − δT times what the true arm of a torque adds.

    The arm is (R − δ/2)/R of a pair and 1 of a wall; `effective_inertia` stands for the mean 1 − η of each sphere.
    """
    phase_i, phase_j = _phases(contacts, wavevectors)
    mean, pairs = 1 - _arm_loss(contacts), ~contacts.on_wall
    more_i, more_j = (
        (1 - pairs * contacts.overlap / (2 * contacts.radius[end])) / mean[end] - 1 for end in (contacts.i, contacts.j)
    )
    factors = -phase_i * more_i[:, None], -phase_j * more_j[:, None]
    return [_turn_rows(contacts, contacts.tangents[:, way], *factors) for way in range(2)]


def _exact(matrix: NDArray) -> tuple[NDArray, NDArray]:
    """Return ω² (..., F) and eigenvectors as columns of a matrix that is nearly symmetric, with real eigenvalues.

    Raises
    ------
    CrystalError
        If ω² is not real: torques of different arms feed the mode.
    """
    squared, vectors = np.linalg.eig(matrix)
    if np.abs(np.imag(squared)).max() > _BUCKLING * np.abs(squared).max():
        raise CrystalError("two modes of one frequency feed each other by torques of different arms; must be beside it")
    return np.real(squared), vectors


def _phases(contacts: Contacts, wavevectors: NDArray) -> tuple[NDArray, NDArray]:
    """Return e^{−ik·d/2} and e^{ik·d/2} of each contact, (..., C, 1), for spheres i and j."""
    half_phase = wavevectors @ contacts.vector[:, : wavevectors.shape[-1]].T / 2
    return np.exp(-1j * half_phase)[..., None], np.exp(1j * half_phase)[..., None]


def _roll_rows(contacts: Contacts, wavevectors: NDArray) -> NDArray:
    """Return the rows (..., C, 6N) that give the roll ρ of a shape in the plane, up to a phase; k in 1/m."""
    phase_i, phase_j = _phases(contacts, wavevectors)
    turn = np.eye(6)[F]
    share_i, share_j = ((contacts.radius[other] / contacts.radii)[:, None] for other in (contacts.j, contacts.i))
    return _rows(contacts, 1j * phase_i * share_i * turn, -1j * phase_j * share_j * turn)


def _rows(contacts: Contacts, on_i: NDArray, on_j: NDArray) -> NDArray:
    """Return one row a contact over the freedoms of all spheres, from its parts (..., C, 6) on spheres i and j."""
    count, spheres, pairs = len(contacts), len(contacts.mass), np.flatnonzero(~contacts.on_wall)
    rows = np.zeros((*on_i.shape[:-2], count, spheres, 6), dtype=complex)
    rows[..., np.arange(count), contacts.i, :] += on_i
    rows[..., pairs, contacts.j[pairs], :] += on_j[..., pairs, :]
    rows = rows.reshape(*on_i.shape[:-2], count, 6 * spheres)
    return rows.real if spheres == 1 and len(pairs) == count else rows


def _solve(
    contacts: Contacts, sphere: Sphere, wavevectors: NDArray, physics: Physics, columns: list[int]
) -> tuple[NDArray, NDArray]:
    """Return frequencies, ascending, and shapes of the modes in the subspace of some of the columns."""
    normal, sideways, turn = _stretch_rows(contacts, wavevectors / sphere.radius)
    mass = np.repeat([contacts.mass, effective_inertia(contacts)], 3, axis=0).T.ravel()
    inverse_root_mass = np.sqrt(sphere.mass / mass)
    per_mass = sphere.time_scale**2 / sphere.mass
    ways = range(2 if physics.space else 1)  # in the plane nothing moves along the second tangent
    springs = [(contacts.normal_stiffness, normal)]
    if physics.shear:
        springs += [(contacts.shear_stiffness, sideways[way] + turn[way]) for way in ways]
    if physics.rolling and physics.rotation:
        springs.append((effective_rolling(contacts, physics), _roll_rows(contacts, wavevectors / sphere.radius)))
    if contacts.contact_force.any():
        springs += [(-contacts.contact_force / contacts.length, sideways[way]) for way in ways]
    energy = [(stiffness[:, None] * per_mass, (rows * inverse_root_mass)[..., columns]) for stiffness, rows in springs]
    matrix = sum(rows.conj().swapaxes(-1, -2) @ (weight * rows) for weight, rows in energy)
    if contacts.on_wall.any() and physics.shear and physics.rotation:
        torques = [
            (rows * inverse_root_mass)[..., columns] for rows in _torque_rows(contacts, wavevectors / sphere.radius)
        ]
        slips = zip(torques, energy[1:3], strict=True)
        squared, vectors = _exact(
            matrix + sum(turned.conj().swapaxes(-1, -2) @ (k * rows) for turned, (k, rows) in slips)
        )
    else:
        _, vectors = np.linalg.eigh(matrix)
        squared = sum(np.sum(weight * np.abs(rows @ vectors) ** 2, axis=-2) for weight, rows in energy)
    if squared.min() < -_BUCKLING * squared.max():
        raise CrystalError(
            f"the crystal is not stable: a mode has the squared frequency {squared.min():.6g} in 1/t0^2, and none may "
            "have a negative one; press its contacts together less, or hold it sideways"
        )
    shapes = np.zeros((*vectors.shape[:-2], len(columns), len(mass)), dtype=vectors.dtype)
    shapes[..., columns] = vectors.swapaxes(-1, -2) * inverse_root_mass[columns]
    shapes /= np.linalg.norm(shapes, axis=-1, keepdims=True)
    order = np.argsort(squared, axis=-1, kind="stable")
    frequencies = np.sqrt(np.maximum(np.take_along_axis(squared, order, axis=-1), 0.0))
    return frequencies, np.take_along_axis(shapes, order[..., None], axis=-2)


# --- the named waves of a lattice of one sphere a cell ----------------------------------------------------------------


@lru_cache(maxsize=256)  # each mode of a lattice asks
def restored(lattice: Contacts, physics: Physics = FULL) -> tuple[str, ...]:
    """Return the names of the waves along y that the contacts of a lattice restore; of several spheres a cell all.

    TR is left out, as its frequency is 0, where the springs of the contacts are fewer than the freedoms of a transverse
    wave: in a chain, whose spheres roll on each other freely, and in a square lattice without shear. If such a lattice
    is pressed together, motions across y grow, and L is all there is.
    """
    if len(lattice.mass) > 1 or physics.space:
        return tuple(map(str, range(1, len(lattice.mass) * len(physics.coordinates) + 1)))
    freedoms = [column for column in (UX, F) if column in physics.coordinates]
    along_y = np.array([0.0, 1 / lattice.length[0]])  # any but Γ and the edge of the zone
    normal, sideways, turn = _stretch_rows(lattice, along_y)
    rows = [normal] + [sideways[0] + turn[0]] * physics.shear + [_roll_rows(lattice, along_y)] * (physics.rolling > 0)
    floppy = np.linalg.matrix_rank(np.vstack(rows)[:, freedoms]) < len(freedoms)
    if floppy and lattice.contact_force.any():
        return ("L",)
    return ("L", *(("TR",) if not floppy else ()), *(("RT",) if physics.rotation else ()))


def bears_compression(lattice: Contacts, *, shear: bool = True) -> bool:
    """Return True if a lattice stays straight when its contacts are pressed together, False if it buckles.

    It stays straight where a shift of rows along themselves stretches or shears contacts, even if spheres turn with it:
    the stiffness F0/a that a compressed contact loses is far smaller (χ ≪ κ of `Sphere`). A resistance to rolling does
    not hold long waves.
    """
    return "TR" in restored(lattice, Physics(shear, rotation=shear))


@lru_cache(maxsize=256)  # one scene needs its mode many times: effects, guards, deck, accuracy
def bloch_mode(lattice: Contacts, sphere: Sphere, vector: WaveVector, name: str, physics: Physics = FULL) -> Mode:
    """Return the mode L, TR or RT of a lattice at a wave vector, or a branch of one of several spheres a cell.

    L is the mode that moves most along k; TR is the lower and RT the upper of the other two. Along y and along x, where
    the wave has a mirror symmetry, L is purely longitudinal, and TR and RT do not move along k. In other directions all
    three have every component, and modes exchange their names where two frequencies come close.

    At ξ = π along y translation and rotation separate: one of TR and RT is pure u_x, the other pure rotation, with the
    sign that continues ξ < π (f > 0 for TR, f < 0 for RT). The signs are those that `Mode` gives.

    Raises
    ------
    SceneError
        If the name is unknown, is RT and spheres do not turn, or is not `restored` by the contacts; of a branch, if
        its frequency is 0 or that of another.
    ValueError
        If the contacts are not those of a lattice of the sphere (`granular_lmp.crystal.lattices.unit_lattice`). The
        modes of other crystals have no names; `bloch_modes` returns them all.
    """
    kind = lattice_of_contacts(lattice, sphere)
    named = len(lattice.mass) == 1 and not physics.space
    if name not in (known := MODES if named else restored(lattice, physics)):
        raise SceneError(f"wave.mode = {name!r}: must be one of {', '.join(known)} in the {kind.name} lattice")
    if not named:
        return _branch(lattice, sphere, vector, int(name), physics)
    if name == "RT" and not physics.rotation:
        raise SceneError(f"wave.mode = {name!r}: needs effects.rotation, which is off; without it there are L and TR")
    if name not in (there := restored(lattice, physics)):
        cure = "effects.rolling_stiffness above 0" if physics.shear else "effects.shear, which is off"
        raise SceneError(
            f"wave.mode = {name!r}: has the frequency 0 in the {kind.name} lattice, as no contact resists it; must be "
            f"{' or '.join(there)}, or needs {cure}"
        )
    columns, index = _SUBSPACE[vector.axis][name] if vector.axis else (physics.coordinates, None)
    columns = [column for column in columns if column in physics.coordinates]
    frequencies, shapes = _solve(lattice, sphere, _wavevector(sphere, vector), physics, columns)
    if index is None:
        index = branch_names(shapes, np.array(vector.unit)).index(name)
    shape, same = shapes[index], np.abs(frequencies - frequencies[index]) < _MEET * frequencies[-1]
    if same.sum() > 1 and not vector.axis:  # a square lattice along its diagonal, whose spheres do not turn
        x, y = vector.unit
        shape = (np.eye(6)[[UX, UY]].T @ ([x, y] if name == "L" else [-y, x])) @ shapes[same].T @ shapes[same]
        shape = shape / np.linalg.norm(shape)
    shape = shape * _sign(name, vector, shape) + 0.0  # + 0.0: no minus zero
    return Mode(name, vector, float(frequencies[index]), *shape[[UX, UY, F]].tolist())


def modes_at(lattice: Contacts, sphere: Sphere, vector: WaveVector, physics: Physics = FULL) -> list[Mode]:
    """Return all modes of a lattice at a wave vector that contacts restore; branches that meet are any of their sum."""
    if len(lattice.mass) == 1 and not physics.space:
        return [bloch_mode(lattice, sphere, vector, name, physics) for name in restored(lattice, physics)]
    frequencies, shapes = bloch_modes(lattice, sphere, _wavevector(sphere, vector), physics)
    return [branch_mode(n, vector, *each) for n, each in enumerate(zip(frequencies.tolist(), shapes, strict=True), 1)]


def _branch(lattice: Contacts, sphere: Sphere, vector: WaveVector, number: int, physics: Physics) -> Mode:
    frequencies, shapes = bloch_modes(lattice, sphere, _wavevector(sphere, vector), physics)
    own, others = frequencies[number - 1], np.delete(frequencies, number - 1)
    where = f"wave.mode = '{number}': has the frequency"
    if own < _STILL * frequencies[-1]:
        raise SceneError(f"{where} 0 at this wave vector, as no contact resists it; needs effects.rolling_stiffness")
    if np.abs(others - own).min() < _MEET * own:
        raise SceneError(f"{where} of another branch at this wave vector, where its shape is any; must be beside it")
    return branch_mode(number, vector, float(own), shapes[number - 1])


def branch_names(shapes: NDArray, along: NDArray) -> tuple[str, ...]:
    """Return L, TR or RT for each branch of a lattice, (B, 3), ascending in frequency, at a wave vector along (2,)."""
    longitudinal, others = int(np.argmax(np.abs(shapes[:, :2] @ along))), iter(MODES[1:])
    return tuple("L" if branch == longitudinal else next(others) for branch in range(len(shapes)))


def contact_stretches(contacts: Contacts, sphere: Sphere, mode: Mode) -> tuple[NDArray, NDArray]:
    """Return the amplitudes of δN and δS of contacts in a wave of the perfect lattice, (C,) each, in units of D0.

    All are in phase; of several spheres a cell they are the moduli. In a crystal that is not perfect they are those of
    a wave that imperfections leave as it is.
    """
    if mode.cell:
        return _moduli(contacts, sphere, mode)
    half_phase = contacts.vector[:, :2] @ _wavevector(sphere, mode.vector) / sphere.radius / 2
    moved, shape = 2 * np.sin(half_phase), np.array([mode.ux, mode.uy])
    normal = moved * (contacts.normals[:, :2] @ shape)
    shear = moved * (contacts.tangents[:, 0, :2] @ shape) - 2 * np.cos(half_phase) * mode.f
    return normal, shear


def _moduli(contacts: Contacts, sphere: Sphere, mode: Mode) -> tuple[NDArray, NDArray]:
    """Return |δN| and |δS| of the contacts of a cell of several spheres; of another crystal a bound on both."""
    if len(contacts.mass) == len(mode.cell):
        normal, sideways, turn = _stretch_rows(contacts, _wavevector(sphere, mode.vector) / sphere.radius)
        shape = _freedoms(mode)
        slips = [(sideways[way] + turn[way]) @ shape for way in range(2)]
        return np.abs(normal @ shape), np.hypot(*np.abs(slips))
    moved, turned = mode.shape()[:, :FX], np.abs(mode.shape()[:, FX:]).max()
    normal, *across = (
        np.abs(each @ moved.T).max(axis=1) for each in (contacts.normals, *contacts.tangents.swapaxes(0, 1))
    )
    return 2 * normal, 2 * (np.hypot(*across) + turned)


def contact_rolls(lattice: Contacts, sphere: Sphere, mode: Mode) -> NDArray:
    """Return the amplitudes of the rolls ρ of the contacts of a cell, (C,), in units of D0."""
    return _roll_rows(lattice, _wavevector(sphere, mode.vector) / sphere.radius) @ _freedoms(mode)


def _freedoms(mode: Mode) -> NDArray:
    """Return (u, f) of each sphere of a cell in turn, (6P,)."""
    return (mode.shape() / TURNS).ravel()


@lru_cache(maxsize=64)  # the same for all runs of a sweep
def highest_frequency(lattice: Contacts, sphere: Sphere, physics: Physics = FULL) -> float:
    """Return the highest frequency of a lattice, rad/t0: velocity Verlet is stable for Δτ < 2/Ω.

    With rotation it is at Γ, where all spheres turn in phase, Ω² = 2zκ(1−η)/(Ĩ(κ+3)), unless contacts resist rolling;
    z is the number of contacts a sphere: 3, 2, 1 in the hexagonal lattice, the square one and the chain. Otherwise it
    lies on edges of the zone (`Lattice.corners`), in the hexagonal lattice at a place that depends on ν; 120 points
    find it to 1e-4. For other crystals use `granular_lmp.crystal.stability.frequency_bound`.
    """
    kind = lattice_of_contacts(lattice, sphere)
    edges = zone_path(kind.corners, 60) / kind.column_distance(lattice_constant(sphere))
    path = np.zeros((1, 2)) if physics.rotation else edges
    if physics.rolling:
        path = np.vstack([path, edges])
    return float(bloch_modes(lattice, sphere, path, physics)[0].max())


def row_stretches(lattice: Contacts, ux: float, uy: float) -> tuple[NDArray, NDArray]:
    """Return δN and δS of the contacts, (C,) each, between a row shifted by (ux, uy) and the next one at rest."""
    shift = np.array([ux, uy])
    return lattice.normals[:, :2] @ shift, lattice.tangents[:, 0, :2] @ shift


def decay_rate(lattice: Contacts, sphere: Sphere, mode: Mode, viscosity: float, *, shear: bool = True) -> float:
    """Return the decay rate Γ of a mode whose contacts are damped, in 1/t0: its amplitude falls as e^{−Γτ}.

        Γ = ½ c Σ_contacts (δN² + δS²) / (ux² + uy² + Ĩ f²)

    The formula is the power of the dashpots over twice the energy of the mode and holds for weak damping (Γ ≪ Ω).

    Parameters
    ----------
    lattice, sphere, mode
        As in `contact_stretches`.
    viscosity : float
        Dashpot c of a contact, along its normal and along its tangent, in m/t0.
    shear : bool
        True if the tangent has a dashpot.
    """
    normal, tangential = contact_stretches(lattice, sphere, mode)
    squares = np.sum(normal**2) + (np.sum(tangential**2) if shear else 0.0)
    return float(viscosity * squares / (2 * (mode.ux**2 + mode.uy**2 + INERTIA_RATIO * mode.f**2)))


def _wavevector(sphere: Sphere, vector: WaveVector) -> NDArray:
    """Return the components of a wave vector in 1/R."""
    return np.array(vector.components) / lattice_constant(sphere)


def _sign(name: str, vector: WaveVector, shape: NDArray) -> float:
    """Return +1 or −1, which makes the larger of p and q positive.

    If both vanish it makes f negative, except for TR along y.
    """
    larger = max(vector.along(*shape[:2]), vector.across(*shape[:2]), key=abs)
    if abs(larger) > 1e-9:  # along y a vanishing q is proportional to sin ξ, so the else branch is ξ = π to rounding
        return float(np.sign(larger))
    return float(np.sign(shape[F])) * (1 if name == "TR" and vector.axis == "y" else -1)
