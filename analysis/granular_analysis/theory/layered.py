"""Stiffness of the surface of layered solids: elastic films on a half-space, or a plate with a free lower face.

The waves in a slab of thickness h are written from the face where each is largest, e^{p(z−h)} and e^{−pz}, so that no
exponential grows. With the displacements U and the tractions T of both faces in these waves, the stiffness of the slab
is K = T U⁻¹. If the surface of the body below has the stiffness S, the top surface (t) of a slab with the bottom face
(b) on that body has the stiffness

    S′ = K_tt − K_tb (K_bb + S)⁻¹ K_bt

*Counting.* With the surface of a stack held, the number of its waves below ω is the number of negative eigenvalues of
all matrices K_bb + S, plus the number of waves of each slab between held faces (Wittrick and Williams). A slab has no
such wave below π c_t/h: a film is halved until the halves have none, and is then assembled again by doubling.

When it breaks: rounding takes the share ε(k c/ω)² of K, where ε is the precision of a double, because both kinds of
waves become one at ω = 0. Bending of a plate is therefore lost where kh is below 1e-2. A leaking wave grows downward:
its relative rounding error grows by as much as the wave does through the films.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.surface_wave import Complexes, HalfSpace, Reaction, complexes, downward

_SAGITTAL = [0, 2, 3, 5]  # the components along k and up of both faces
_STATIC = 1e-4  # in c_t k: the lowest ω at which K is evaluated. There K has 8 digits, and is static to as many


class Slab(NamedTuple):
    """Film of one material with its thickness h."""

    material: HalfSpace
    thickness: float

    def stiffness(self, k: Complexes, omega: Complexes) -> Complexes:
        """Return K (..., 6, 6) at k and ω (...): the lower face, then the upper, each along k, across, and up."""
        solid, h = self.material, self.thickness
        omega = np.where(np.abs(omega) > _STATIC * solid.transverse * k.real, omega, _STATIC * solid.transverse * k)
        shear = solid.density * solid.transverse**2
        plane = solid.density * solid.longitudinal**2
        zero, ik = 0 * k, 1j * k
        p, q = (downward(k, omega / speed) for speed in (solid.longitudinal, solid.transverse))
        moved, pulled = [], []
        for turn, side in ((p, 1), (q, 1), (p, -1), (q, -1)):
            slope = side * turn
            # Displacements: the gradient of e^{ikx + slope z} for p, and the curl of such a field for q
            along, up = (ik, slope) if turn is p else (-slope, ik)
            shears, presses = shear * (slope * along + ik * up), plane * slope * up + (plane - 2 * shear) * ik * along
            low, high = (np.exp(-turn * h), zero + 1) if side > 0 else (zero + 1, np.exp(-turn * h))
            moved.append([along * low, up * low, along * high, up * high])
            pulled.append([-shears * low, -presses * low, shears * high, presses * high])
        U, T = (np.moveaxis(np.array(each), (0, 1), (-1, -2)) for each in (moved, pulled))
        result = np.zeros((*k.shape, 6, 6), dtype=complex)
        rows, columns = np.ix_(_SAGITTAL, _SAGITTAL)
        result[..., rows, columns] = T @ np.linalg.inv(U)
        once, twice = np.exp(-q * h), np.expm1(-2 * q * h)
        result[..., 1, 1] = result[..., 4, 4] = -shear * q * (2 + twice) / twice
        result[..., 1, 4] = result[..., 4, 1] = shear * q * 2 * once / twice
        return result


class Layered(NamedTuple):
    """Films on a half-space, or a plate with a free lower face.

    Attributes
    ----------
    films : slabs, from the lowest upward.
    below : half-space under the films; None: free lower face.
    """

    films: tuple[Slab, ...]
    below: HalfSpace | None = None

    @property
    def cutoff(self) -> float:
        """Return the speed from which waves leak into the half-space; infinite for a plate."""
        return np.inf if self.below is None else self.below.cutoff

    def reaction(self, wavenumber: ArrayLike, frequency: ArrayLike) -> Reaction:
        """Return the reaction of the upper surface at k > 0 (...) and ω (...), which may be complex."""
        k, omega = complexes(wavenumber, frequency)
        below = np.zeros((*k.shape, 3, 3), dtype=complex) if self.below is None else self.below.stiffness(k, omega)
        count: NDArray[Any] = np.zeros(k.shape, dtype=np.intp)
        for material, thickness in self.films:
            waves = thickness * np.abs(omega).max(initial=0) / (np.pi * material.transverse)
            halvings = int(np.ceil(np.log2(1 + waves)))
            stiff, inside = Slab(material, thickness / 2**halvings).stiffness(k, omega), 0 * count
            for _ in range(halvings):
                stiff, inside = _doubled(stiff, inside)
            held = stiff[..., :3, :3] + below
            count = count + inside + _negative(held)
            below = stiff[..., 3:, 3:] - stiff[..., 3:, :3] @ np.linalg.solve(held, stiff[..., :3, 3:])
        return Reaction(below, count)


def _doubled(stiff: Complexes, inside: NDArray[Any]) -> tuple[Complexes, NDArray[Any]]:
    """Return K of two equal slabs from K of one, and the number of waves of both between held faces."""
    lower, upper = stiff[..., :3, :3], stiff[..., 3:, 3:]
    middle, whole = upper + lower, np.zeros_like(stiff)
    whole[..., :3, :3], whole[..., 3:, 3:] = lower, upper
    out = np.concatenate([stiff[..., :3, 3:], stiff[..., 3:, :3]], axis=-2)
    back = np.concatenate([stiff[..., 3:, :3], stiff[..., :3, 3:]], axis=-1)
    return whole - out @ np.linalg.solve(middle, back), 2 * inside + _negative(middle)


def _negative(matrix: Complexes) -> NDArray[Any]:
    return np.asarray(np.sum(np.linalg.eigvalsh(matrix) < 0, axis=-1))
