"""Bloch modes of a packing from its own contact network: frequencies and shapes for any wave vector.

A plane wave u e^{i(k·r − ωt)}, φ e^{i(k·r − ωt)} (φ = Rθ) stretches the contact with unit normal n, tangent t (n turned
by +90°) and phase difference χ = k·d by

    δN = 2 sin(χ/2) n·u,        δS = 2 sin(χ/2) t·u − 2 cos(χ/2) f,        φ = i f

up to a common phase factor. With one row √k1 δN and one row √g1 δS for each contact, the rows form a real matrix S and
ω² are the eigenvalues of M^{-1/2} SᵀS M^{-1/2}, hence ω the singular values of S M^{-1/2}: accurate for long waves too,
where the eigenvalues of the dynamical matrix lose half their digits. Frequencies are in rad/t0, wave vectors in 1/R.

This is a numerical derivation from the geometry, kept apart from the closed forms of ``analysis.second_harmonic``.
"""

from dataclasses import dataclass

import ase
import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_lmp.errors import SceneError
from granular_lmp.packing import ROW_SPACING, centre, contacts, lattice_constant
from granular_lmp.sphere import INERTIA_RATIO, Sphere

_UX, _UY, _F = range(3)
# A wave along y keeps the mirror x → −x of the packing: L lives in u_y, TR and RT in (u_x, f); sorted by frequency.
_SUBSPACE = {"L": ([_UY], 0), "TR": ([_UX, _F], 0), "RT": ([_UX, _F], 1)}


@dataclass(frozen=True)
class Mode:
    """One Bloch mode: displacement (ux, uy) and rotation φ = Rθ = i f, with ux² + uy² + f² = 1, and frequency in 1/t0.

    Along y the field's names hold: p = uy, q = −ux, Q = −ux > 0 for TR and RT, p > 0 for L.
    """

    name: str
    wavenumber: float
    frequency: float
    ux: float
    uy: float
    f: float

    def shape(self) -> NDArray[np.complex128]:
        """Complex amplitudes (ux, uy, φ)."""
        return np.array([self.ux, self.uy, 1j * self.f])


def bloch_modes(packing: ase.Atoms, sphere: Sphere, wavevector: ArrayLike) -> tuple[NDArray, NDArray]:
    """Frequencies and shapes of the three modes at any wave vector, lowest first.

    Parameters
    ----------
    packing : ase.Atoms
        Its centre sphere stands for the perfect lattice.
    sphere : Sphere
        Gives the contact stiffnesses and the inertia.
    wavevector : array_like, (2,)
        k, 1/R.

    Returns
    -------
    frequencies : (3,) array
        In 1/t0, ascending.
    shapes : (3, 3) array
        One row a mode: (ux, uy, f), normalised to 1, of either sign. Where modes are degenerate any rotation of them.
    """
    stretch, inverse_root_mass = _stretch_matrix(packing, sphere, np.asarray(wavevector, dtype=float))
    return _singular(stretch * inverse_root_mass, inverse_root_mass)


def mode_along_y(packing: ase.Atoms, sphere: Sphere, wavenumber: float, name: str) -> Mode:
    """The mode L, TR or RT at ξ (rad per row) along y, with the signs that `Mode` gives.

    At ξ = π translation and rotation part: of TR and RT one is pure u_x, the other pure rotation, and the sign of the
    latter is the one that continues ξ < π (f > 0 for TR, f < 0 for RT).

    Raises
    ------
    SceneError
        For another name.
    """
    if name not in _SUBSPACE:
        raise SceneError(f"wave.mode = {name!r}: must be one of {', '.join(_SUBSPACE)}")
    columns, index = _SUBSPACE[name]
    stretch, inverse_root_mass = _stretch_matrix(packing, sphere, _along_y(sphere, wavenumber))
    frequencies, shapes = _singular((stretch * inverse_root_mass)[:, columns], inverse_root_mass[columns])
    shape = np.zeros(3)
    shape[columns] = shapes[index] * _sign(name, shapes[index]) + 0.0  # + 0.0: no minus zero
    return Mode(name, wavenumber, float(frequencies[index]), *map(float, shape))


def largest_stretch(packing: ase.Atoms, sphere: Sphere, mode: Mode) -> tuple[float, float]:
    """Amplitudes of δN and δS, the largest over the contacts, in units of D0: how hard the wave works a contact."""
    n, t, half_phase = _contact_frames(packing, _along_y(sphere, mode.wavenumber))
    u = np.array([mode.ux, mode.uy])
    normal = 2 * np.sin(half_phase) * (n @ u)
    shear = 2 * np.sin(half_phase) * (t @ u) - 2 * np.cos(half_phase) * mode.f
    return float(np.abs(normal).max()), float(np.abs(shear).max())


def _along_y(sphere: Sphere, wavenumber: float) -> NDArray:
    return np.array([0.0, wavenumber / (ROW_SPACING * lattice_constant(sphere))])


def _contact_frames(packing: ase.Atoms, wavevector: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Normals, tangents (contacts, 2) and half the phase differences of three contacts; the other three mirror them."""
    vectors = contacts(packing, centre(packing))
    vectors = vectors[(vectors[:, 0] > 0) | ((vectors[:, 0] == 0) & (vectors[:, 1] > 0))]
    n = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    return n, np.column_stack([-n[:, 1], n[:, 0]]), vectors @ wavevector / 2


def _sign(name: str, shape: NDArray) -> float:
    """+1 or −1: p > 0 for L; ux < 0, or where ux vanishes (ξ = π) the sign of f next to it, for TR and RT."""
    if name == "L":
        return float(np.sign(shape[0]))
    ux, f = shape
    if abs(ux) > 1e-9:  # ux is proportional to sin ξ where it vanishes, so this is ξ = π to rounding
        return -float(np.sign(ux))
    return float(np.sign(f)) * (1 if name == "TR" else -1)


def _stretch_matrix(packing: ase.Atoms, sphere: Sphere, wavevector: NDArray) -> tuple[NDArray, NDArray]:
    """S (two rows a contact; columns ux, uy, f) and M^{-1/2}, in units of t0, m and R."""
    n, t, half_phase = _contact_frames(packing, wavevector)
    sine, cosine = 2 * np.sin(half_phase)[:, None], 2 * np.cos(half_phase)[:, None]
    kappa = sphere.stiffness_ratio
    per_mass = 1 / (2 * (kappa + 3))  # k1 t0²/m
    normal = np.hstack([sine * n, np.zeros_like(sine)]) * np.sqrt(per_mass)
    shear = np.hstack([sine * t, -cosine]) * np.sqrt(kappa * per_mass)
    # LAMMPS takes R as the arm of the slip but R − Δ0/2 as the arm of the torque: as if the inertia were larger.
    inertia = INERTIA_RATIO / (1 - sphere.overlap_ratio)
    return np.vstack([normal, shear]), 1 / np.sqrt([1.0, 1.0, inertia])


def _singular(matrix: NDArray, inverse_root_mass: NDArray) -> tuple[NDArray, NDArray]:
    _, frequencies, vectors = np.linalg.svd(matrix, full_matrices=False)
    shapes = vectors * inverse_root_mass
    return frequencies[::-1], (shapes / np.linalg.norm(shapes, axis=1)[:, None])[::-1]
