"""Bloch modes of a packing from its own contact network: frequencies and shapes for any wave vector.

A plane wave u e^{i(k·r − ωt)}, φ e^{i(k·r − ωt)} (φ = Rθ) stretches the contact with unit normal n, tangent t (n turned
by +90°) and phase difference χ = k·d by

    δN = 2 sin(χ/2) n·u,    δT = 2 sin(χ/2) t·u,    δS = δT − 2 cos(χ/2) f,        φ = i f

up to a common phase factor: normal, sideways and shear displacement. Its energy is

    E = ½ Σ_contacts (k1 δN² + g1 δS² − (F0/ℓ) δT²),

the last term where the contacts are pressed together by a force F0 from outside (`Sphere.prestress`). Shapes are the
eigenvectors of M^{-1/2} (∂²E) M^{-1/2}; each ω² is then the sum of squares E gives for its shape. Taken so, ω is
accurate for long waves too, where an eigenvalue loses half its digits. Frequencies are in rad/t0, wave vectors in 1/R.

An effect that a scene leaves out leaves its part out here: no shear, no g1; no rotation, no f.

This is a numerical derivation from the geometry, kept apart from the closed forms of ``analysis.second_harmonic``.
"""

from dataclasses import dataclass
from typing import Self

import ase
import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_lmp.crystal.lattices import centre, contacts, lattice_constant, unit_lattice
from granular_lmp.crystal.sphere import INERTIA_RATIO, Sphere
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.errors import SceneError
from granular_lmp.scene.scene import MODES, Scene

_UX, _UY, _F = range(3)
# A wave along an axis keeps the mirror of the packing that holds the axis: L lives in the one displacement, TR and RT
# in the other and the rotation; each sorted by frequency.
_SUBSPACE = {
    "y": {"L": ([_UY], 0), "TR": ([_UX, _F], 0), "RT": ([_UX, _F], 1)},
    "x": {"L": ([_UX], 0), "TR": ([_UY, _F], 0), "RT": ([_UY, _F], 1)},
}


@dataclass(frozen=True)
class Mode:
    """One Bloch mode: displacement (ux, uy) and rotation φ = Rθ = i f, with ux² + uy² + f² = 1, and frequency in 1/t0.

    p is the displacement along the wave vector k, q that along ẑ × k: along y p = uy, q = −ux, the field's names. The
    larger of the two is positive, so p > 0 for L, and q = Q > 0 for TR and RT along y.
    """

    name: str
    vector: WaveVector
    frequency: float
    ux: float
    uy: float
    f: float

    @property
    def wavenumber(self) -> float:
        """ξ, rad per row."""
        return self.vector.wavenumber

    @property
    def p(self) -> float:
        """Displacement along k."""
        return self.vector.along(self.ux, self.uy)

    @property
    def q(self) -> float:
        """Displacement along ẑ × k."""
        return self.vector.across(self.ux, self.uy)

    def shape(self) -> NDArray[np.complex128]:
        """Complex amplitudes (ux, uy, φ)."""
        return np.array([self.ux, self.uy, 1j * self.f])


@dataclass(frozen=True)
class Physics:
    """Which degrees of freedom the lattice has: does a contact resist shear, and do spheres turn."""

    shear: bool = True
    rotation: bool = True

    @classmethod
    def of(cls, scene: Scene) -> Self:
        """Those of a scene's lattice; what is not decided yet is there."""
        shear = scene.effects.shear is not False
        return cls(shear, shear and scene.effects.rotation is not False)  # nothing else turns a sphere

    @property
    def modes(self) -> tuple[str, ...]:
        """Names of the modes that there are."""
        return MODES if self.rotation else MODES[:2]

    @property
    def coordinates(self) -> list[int]:
        """Those of (ux, uy, f) that move."""
        return [_UX, _UY, _F] if self.rotation else [_UX, _UY]


FULL = Physics()


def bloch_modes(
    packing: ase.Atoms, sphere: Sphere, wavevectors: ArrayLike, physics: Physics = FULL
) -> tuple[NDArray, NDArray]:
    """Frequencies and shapes of the modes at any wave vectors, lowest first.

    Parameters
    ----------
    packing : ase.Atoms
        Its centre sphere stands for the perfect lattice.
    sphere : Sphere
        Gives the contact stiffnesses and the inertia.
    wavevectors : array_like, (..., 2)
        k, 1/R.
    physics : Physics

    Returns
    -------
    frequencies : (..., 3) array, or (..., 2) without rotation
        In 1/t0, ascending.
    shapes : (..., 3, 3) array, or (..., 2, 3)
        One row a mode: (ux, uy, f), normalised to 1, of either sign. Where modes are degenerate any rotation of them.
    """
    return _solve(packing, sphere, np.asarray(wavevectors, dtype=float), physics, physics.coordinates)


def bloch_mode(packing: ase.Atoms, sphere: Sphere, vector: WaveVector, name: str, physics: Physics = FULL) -> Mode:
    """The mode L, TR or RT at a wave vector, with the signs that `Mode` gives.

    L is the mode that moves most along k; TR is the lower and RT the upper of the other two. Along y and along x, where
    a mirror holds the wave, L is purely longitudinal and these do not move along k; elsewhere all three move in every
    way, and the names pass from mode to mode where two come near each other.

    At ξ = π along y translation and rotation part: of TR and RT one is pure u_x, the other pure rotation, and the sign
    of the latter is the one that continues ξ < π (f > 0 for TR, f < 0 for RT).

    Raises
    ------
    SceneError
        For another name, and for RT where spheres do not turn.
    """
    if name not in MODES:
        raise SceneError(f"wave.mode = {name!r}: must be one of {', '.join(MODES)}")
    if name not in physics.modes:
        raise SceneError(f"wave.mode = {name!r}: needs effects.rotation, which is off; without it there are L and TR")
    columns, index = _SUBSPACE[vector.axis][name] if vector.axis else (physics.coordinates, None)
    columns = [column for column in columns if column in physics.coordinates]
    frequencies, shapes = _solve(packing, sphere, _wavevector(sphere, vector), physics, columns)
    if index is None:
        longitudinal = int(np.argmax(np.abs(vector.along(*shapes[:, :2].T))))
        others = [branch for branch in range(len(shapes)) if branch != longitudinal]
        index = longitudinal if name == "L" else others[MODES.index(name) - 1]
    shape = shapes[index] * _sign(name, vector, shapes[index]) + 0.0  # + 0.0: no minus zero
    return Mode(name, vector, float(frequencies[index]), *map(float, shape))


def mode_of(scene: Scene, physics: Physics | None = None) -> Mode:
    """The mode of a scene's wave in its lattice, or in one with other physics."""
    sphere = scene.sphere
    return bloch_mode(unit_lattice(sphere), sphere, scene.vector, scene.wave.mode, physics or Physics.of(scene))


def contact_stretches(packing: ase.Atoms, sphere: Sphere, mode: Mode) -> tuple[NDArray, NDArray]:
    """Amplitudes of δN and δS of three contacts, (3,) each, in units of D0, in phase; the other three mirror them."""
    normal, sideways, turn = _stretch_rows(packing, _wavevector(sphere, mode.vector))
    shape = np.array([mode.ux, mode.uy, mode.f])
    return normal @ shape, (sideways + turn) @ shape


def highest_frequency(packing: ase.Atoms, sphere: Sphere, physics: Physics = FULL) -> float:
    """Top of the spectrum over the whole zone, rad/t0: velocity Verlet is unstable from Δτ = 2/Ω on.

    With rotation it is at Γ, all spheres turning in phase, Ω² = 6κ(1−η)/(Ĩ(κ+3)). Without, it is somewhere on the edges
    Γ–M and M–K of the zone, by ν; 120 points find it to 1e-4.
    """
    corner = 4 * np.pi / 3 / lattice_constant(sphere)  # |K|
    k, m = corner * np.array([1, 0]), corner * np.array([0.75, np.sqrt(3) / 4])
    points = np.linspace(0, 1, 60)[:, None]
    path = np.zeros((1, 2)) if physics.rotation else np.vstack([points * m, m + points * (k - m)])
    return float(max(bloch_modes(packing, sphere, point, physics)[0][-1] for point in path))


def row_stretches(packing: ase.Atoms, ux: float, uy: float) -> tuple[NDArray, NDArray]:
    """δN and δS of three contacts, (3,) each, between a row that is shifted by (ux, uy) and the next one at rest."""
    n, t, _ = _contact_frames(packing, np.zeros(2))
    shift = np.array([ux, uy])
    return n @ shift, t @ shift


def decay_rate(packing: ase.Atoms, sphere: Sphere, mode: Mode, viscosity: float, *, shear: bool = True) -> float:
    """Rate Γ of a mode whose contacts are damped, in 1/t0: its amplitude falls as e^{−Γτ}.

        Γ = ½ c Σ_contacts (δN² + δS²) / (ux² + uy² + Ĩ f²)

    Half the power that the dashpots take over twice the energy of the mode, for weak damping (Γ ≪ Ω).

    Parameters
    ----------
    packing, sphere, mode
        As above.
    viscosity : float
        c of the dashpot of a contact, along its normal and along its tangent, in m/t0.
    shear : bool
        Whether the tangent has a dashpot.
    """
    normal, tangential = contact_stretches(packing, sphere, mode)
    squares = np.sum(normal**2) + (np.sum(tangential**2) if shear else 0.0)
    return float(viscosity * squares / (2 * (mode.ux**2 + mode.uy**2 + INERTIA_RATIO * mode.f**2)))


def _wavevector(sphere: Sphere, vector: WaveVector) -> NDArray:
    """k in 1/R."""
    return np.array(vector.components) / lattice_constant(sphere)


def _contact_frames(packing: ase.Atoms, wavevectors: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Normals, tangents (3, 2), half the phase differences (..., 3) of three contacts; the other three mirror them."""
    vectors = contacts(packing, centre(packing))
    vectors = vectors[(vectors[:, 0] > 0) | ((vectors[:, 0] == 0) & (vectors[:, 1] > 0))]
    n = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    return n, np.column_stack([-n[:, 1], n[:, 0]]), wavevectors @ vectors.T / 2


def _sign(name: str, vector: WaveVector, shape: NDArray) -> float:
    """+1 or −1: the larger of p and q becomes positive; where both vanish f is negative, but that of TR along y."""
    larger = max(vector.along(*shape[:2]), vector.across(*shape[:2]), key=abs)
    if abs(larger) > 1e-9:  # along y q is proportional to sin ξ where it vanishes, so this is ξ = π to rounding
        return float(np.sign(larger))
    return float(np.sign(shape[_F])) * (1 if name == "TR" and vector.axis == "y" else -1)


def _stretch_rows(packing: ase.Atoms, wavevectors: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Three rows a kind (..., 3, columns ux, uy, f) that give δN, δT and δS − δT of the contacts of a wave."""
    n, t, half_phase = _contact_frames(packing, wavevectors)
    sine, cosine = 2 * np.sin(half_phase)[..., None], 2 * np.cos(half_phase)[..., None]
    none = np.zeros_like(sine)
    normal, sideways = (np.concatenate([sine * direction, none], axis=-1) for direction in (n, t))
    return normal, sideways, np.concatenate([none, none, -cosine], axis=-1)


def _solve(
    packing: ase.Atoms, sphere: Sphere, wavevectors: NDArray, physics: Physics, columns: list[int]
) -> tuple[NDArray, NDArray]:
    """Frequencies, ascending, and shapes (ux, uy, f) of the modes in the subspace of some of these columns."""
    kappa = sphere.stiffness_ratio
    normal, sideways, turn = _stretch_rows(packing, wavevectors)
    # LAMMPS takes R as the arm of the slip but R − Δ0/2 as the arm of the torque: as if the inertia were larger.
    inverse_root_mass = 1 / np.sqrt([1.0, 1.0, INERTIA_RATIO / (1 - sphere.overlap_ratio)])
    springs = [(1.0, normal), (kappa if physics.shear else 0.0, sideways + turn), (-sphere.prestress, sideways)]
    per_mass = 1 / (2 * (kappa + 3))  # k1 t0²/m
    energy = [(weight * per_mass, (rows * inverse_root_mass)[..., columns]) for weight, rows in springs if weight]
    _, vectors = np.linalg.eigh(sum(weight * rows.swapaxes(-1, -2) @ rows for weight, rows in energy))
    squared = sum(weight * np.sum((rows @ vectors) ** 2, axis=-2) for weight, rows in energy)
    shapes = np.zeros((*vectors.shape[:-2], len(columns), 3))
    shapes[..., columns] = vectors.swapaxes(-1, -2) * inverse_root_mass[columns]
    shapes /= np.linalg.norm(shapes, axis=-1, keepdims=True)
    order = np.argsort(squared, axis=-1, kind="stable")
    frequencies = np.sqrt(np.maximum(np.take_along_axis(squared, order, axis=-1), 0.0))
    return frequencies, np.take_along_axis(shapes, order[..., None], axis=-2)
