"""One Bloch mode: its wave vector, frequency and shape; and the freedoms of the spheres that it moves."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.wavevector import WaveVector

UX, UY, F = range(3)


@dataclass(frozen=True)
class Physics:
    """Degrees of freedom of a lattice and the stiffnesses of its contacts.

    Attributes
    ----------
    shear : bool
        True if contacts resist a slip.
    rotation : bool
        True if spheres turn.
    rolling : float
        Rolling stiffness k_r of a contact, N/m: the roll ρ = Rc(φ_j/R_j − φ_i/R_i) of two spheres that turn against
        each other, Rc = RiRj/(Ri + Rj), has the energy ½ k_r ρ². It is 0 if spheres roll freely.
    """

    shear: bool = True
    rotation: bool = True
    rolling: float = 0.0

    @property
    def coordinates(self) -> list[int]:
        """Indices of the components of (ux, uy, f) that move."""
        return [UX, UY, F] if self.rotation else [UX, UY]


FULL = Physics()


@dataclass(frozen=True)
class Mode:
    """One Bloch mode: displacement (ux, uy) and rotation φ = Rθ = i f, with ux² + uy² + f² = 1, and frequency in 1/t0.

    p is the displacement along the wave vector k, q that along ẑ × k: along y p = uy, q = −ux, the field's names. The
    larger of the two is positive, so p > 0 for L, and q = Q > 0 for TR and RT along y.

    Attributes
    ----------
    name : str
        L, TR or RT; in a cell of several spheres the number of the branch, "1" for the lowest.
    vector : WaveVector
    frequency : float
    ux, uy, f : float
        Of several spheres the roots of the sums of their squares, all positive.
    cell : tuple of (ux, uy, φ)
        Complex amplitudes of the spheres of a cell of several, each in front of e^{ik·r} at its own place r.
    """

    name: str
    vector: WaveVector
    frequency: float
    ux: float
    uy: float
    f: float
    cell: tuple[tuple[complex, complex, complex], ...] = ()

    @property
    def wavenumber(self) -> float:
        """Wave number ξ, rad per row."""
        return self.vector.wavenumber

    @property
    def p(self) -> float:
        """Displacement along k."""
        return self.vector.along(self.ux, self.uy)

    @property
    def q(self) -> float:
        """Displacement along ẑ × k."""
        return self.vector.across(self.ux, self.uy)

    @property
    def words(self) -> str:
        """The wave with its article: "a TR wave", "a wave of branch 3"."""
        if self.cell:
            return f"a wave of branch {self.name}"
        return f"{'an' if self.name in ('L', 'RT') else 'a'} {self.name} wave"

    @property
    def along_y(self) -> bool:
        """True if the spheres move along y rather than along x."""
        return self.uy > self.ux if self.cell else self.name == "L"

    def shape(self) -> NDArray[np.complex128]:
        """Complex amplitudes (ux, uy, φ) of the spheres of a cell, (P, 3)."""
        return np.array(self.cell or [(self.ux, self.uy, 1j * self.f)])


def branch_mode(number: int, vector: WaveVector, frequency: float, shape: NDArray) -> Mode:
    """Return the mode of a branch, counted from 1, from its shape (ux, uy, f) of each sphere, (3P,), normalised to 1.

    Its phase makes the largest p or q of a sphere real and positive, of equal ones the first, to 1e-6; of spheres that
    only turn, the largest −f.
    """
    each = shape.reshape(-1, 3)
    ways = np.stack([vector.along(each[:, 0], each[:, 1]), vector.across(each[:, 0], each[:, 1])], axis=1).ravel()
    parts = ways if np.abs(ways).max() > 1e-9 else -each[:, 2]
    size = np.abs(parts)
    first = parts[np.argmax(size > size.max() * (1 - 1e-6))]
    amplitudes = each * np.conj(first) / abs(first) * [1, 1, 1j]
    ux, uy, f = np.linalg.norm(amplitudes, axis=0).tolist()
    return Mode(str(number), vector, frequency, ux, uy, f, tuple(map(tuple, amplitudes.tolist())))
