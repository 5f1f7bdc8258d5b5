"""Closed form for one layer of equal spheres on a rigid substrate: its six branches, and its buckling load.

A sphere of mass m touches c neighbours (normal stiffness G_N, shear stiffness G_S) and the substrate (K_N, K_S). It
moves by u and turns by φ = Rθ. At k = 0, with g = G_S/K_S,

    vertical      ω² = K_N/m, whatever the contacts between spheres
    rocking       ω² = (K_S/4m)[7 + 5cg ∓ √((7 + 5cg)² − 40cg)], twice each
    torsion       ω² = 5cG_S/m, about the vertical

On a mirror line of the layer, with e along k and p = z × e, three branches are *sagittal* (u_e, u_z, φ_p) and three
*shear-horizontal* (u_p, φ_e, φ_z).

These formulas leave out two effects that `granular_analysis.theory.crystal` includes: the arm R − δ/2 of the torque
between two spheres, which changes frequencies by η/2 with η = δ/2R, and the rotation of compressed contacts with their
spheres.

**Buckling.** Contacts of length ℓ with a repulsive force f press a sphere out of the layer, with the force f/ℓ per
difference of heights. Without shear stiffness only K_N holds the sphere: a chain buckles at f = ℓK_N/4, a square layer
at ℓK_N/8, a hexagonal one at ℓK_N/9. Shear stiffness helps against the slip that rolling does not cancel.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
INERTIA = 0.4  # I/mR² of a solid sphere


class Resonances(NamedTuple):
    """Frequencies ω at k = 0; each of the two rocking frequencies belongs to two modes."""

    vertical: float
    rocking: tuple[float, float]
    torsion: float


class Layer(NamedTuple):
    """A layer, in any consistent units.

    Attributes
    ----------
    bonds : (c/2, 2) vectors from a sphere to half of its neighbours; the others lie opposite.
    mass : mass of a sphere.
    normal, shear : G_N and G_S between two spheres.
    substrate_normal, substrate_shear : K_N and K_S between a sphere and the substrate.
    """

    bonds: Floats
    mass: float
    normal: float
    shear: float
    substrate_normal: float
    substrate_shear: float

    def resonances(self) -> Resonances:
        """Return the frequencies at k = 0."""
        neighbours = 2 * len(self.bonds)
        shear, substrate = self.shear, self.substrate_shear
        total = 7 * substrate + 5 * neighbours * shear
        root = np.sqrt(total**2 - 40 * neighbours * shear * substrate)
        upper = (total + root) / (4 * self.mass)
        # From the product of both roots, as the difference in the formula would lose digits
        lower = 2.5 * neighbours * shear * substrate / self.mass**2 / upper
        return Resonances(
            vertical=float(np.sqrt(self.substrate_normal / self.mass)),
            rocking=(float(np.sqrt(lower)), float(np.sqrt(upper))),
            torsion=float(np.sqrt(5 * neighbours * shear / self.mass)),
        )

    def sagittal(self, wavevector: ArrayLike) -> Floats:
        """Return the matrix (..., 3, 3) of (u_e, iu_z, φ_p) at wave vectors (..., 2) on a mirror line."""
        waves = self._waves(wavevector)
        K_N, K_S, G = self.substrate_normal, self.substrate_shear, self.shear
        return _symmetric(
            (K_S + waves.sum(waves.bent * (self.normal * waves.n_e**2 + G * waves.n_p**2)), 0.0, -K_S),
            (K_N + waves.sum(G * waves.bent), waves.sum(G * waves.skew * waves.n_e)),
            (K_S + waves.sum(G * waves.even * waves.n_e**2),),
        )

    def shear_horizontal(self, wavevector: ArrayLike) -> Floats:
        """Return the matrix (..., 3, 3) of (u_p, φ_e, −iφ_z) at wave vectors (..., 2) on a mirror line."""
        waves = self._waves(wavevector)
        K_S, G = self.substrate_shear, self.shear
        return _symmetric(
            (K_S + waves.sum(waves.bent * (self.normal * waves.n_p**2 + G * waves.n_e**2)), K_S)
            + (-waves.sum(G * waves.skew * waves.n_e),),
            (K_S + waves.sum(G * waves.even * waves.n_p**2), 0.0),
            (waves.sum(G * waves.even),),
        )

    def frequencies(self, wavevector: ArrayLike) -> tuple[Floats, Floats]:
        """Return ω (..., 3) of the sagittal and of the shear-horizontal branches, ascending, on a mirror line."""
        sagittal = self._solve(self.sagittal(wavevector), np.array([1.0, 1.0, INERTIA]))
        return sagittal, self._solve(self.shear_horizontal(wavevector), np.array([1.0, INERTIA, INERTIA]))

    def _solve(self, matrix: Floats, inertia: Floats) -> Floats:
        root = np.sqrt(self.mass * inertia)
        return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(matrix / (root[:, None] * root)), 0.0)))

    def _waves(self, wavevector: ArrayLike) -> "_Waves":
        k = np.asarray(wavevector, dtype=float)
        size = np.linalg.norm(k, axis=-1, keepdims=True)
        along = np.where(size > 0, k / np.where(size > 0, size, 1.0), [0.0, 1.0])
        across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
        normal = self.bonds / np.linalg.norm(self.bonds, axis=1, keepdims=True)
        phase = k @ self.bonds.T
        bent, even = 4 * np.sin(phase / 2) ** 2, 4 * np.cos(phase / 2) ** 2
        return _Waves(bent, even, 2 * np.sin(phase), along @ normal.T, across @ normal.T)

    def buckling_load(self, wavevector: ArrayLike) -> Floats:
        """Return the repulsive force f (...) of each contact at which a sagittal wave (..., 2) has the frequency 0.

        It is inf if there is none. The distance ℓ of the spheres is the length of `bonds`. To leading order in u_z: a
        force of ℓG_N or more, which would buckle the layer within its plane, is left out.
        """
        waves, matrix = self._waves(wavevector), self.sagittal(wavevector)
        # u_e and φ_p follow a static u_z if shear stiffness couples them
        coupled = matrix[..., 0, 0] * matrix[..., 1, 2] ** 2
        inner = matrix[..., 0, 0] * matrix[..., 2, 2] - matrix[..., 0, 2] ** 2
        follows = np.divide(coupled, inner, out=np.zeros_like(inner), where=coupled > 0)
        held = matrix[..., 1, 1] - follows
        lifted = waves.sum(waves.bent)
        length = np.linalg.norm(self.bonds[0])
        return np.asarray(length * held / np.where(lifted > 0, lifted, np.nan))


class _Waves(NamedTuple):
    """4 sin²(χ/2), 4 cos²(χ/2), 2 sin χ of χ = k·d, and n·e, n·p of the bonds, (..., c/2) each."""

    bent: Floats
    even: Floats
    skew: Floats
    n_e: Floats
    n_p: Floats

    def sum(self, of_bonds: Floats) -> Floats:
        return np.asarray(of_bonds.sum(axis=-1))


def _symmetric(*rows: tuple[ArrayLike, ...]) -> Floats:
    """Return matrices (..., n, n) from their upper triangles, row by row."""
    size = len(rows)
    parts = np.broadcast_arrays(*(np.asarray(each, dtype=float) for row in rows for each in row))
    matrix = np.zeros((*parts[0].shape, size, size))
    for part, (i, j) in zip(parts, zip(*np.triu_indices(size), strict=True), strict=True):
        matrix[..., i, j] = matrix[..., j, i] = part
    return matrix
