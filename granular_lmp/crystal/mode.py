"""One Bloch mode with its wave vector, frequency and shape, and the freedoms of the spheres."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.frozen import dataclass

# A sphere's six freedoms: displacement u, and φ = Rθ for the rotation θ
UX, UY, UZ, FX, FY, F = range(6)
PLANE = (UX, UY, F)  # freedoms that move in a plane z = const
TURNS = np.array([1, 1, 1, 1j, 1j, 1j])  # φ = i f


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
        Rolling stiffness k_r of a contact, N/m; 0 if spheres roll freely. The energy is ½ k_r ρ², with the roll
        ρ = Rc(φ_j/R_j − φ_i/R_i) of two spheres that turn against each other and Rc = RiRj/(Ri + Rj).
    space : bool
        True if spheres may leave the plane z = const.
    """

    shear: bool = True
    rotation: bool = True
    rolling: float = 0.0
    space: bool = False

    @property
    def coordinates(self) -> list[int]:
        """Indices of the freedoms (ux, uy, uz, φx, φy, φz) that move."""
        moving = range(6) if self.space else PLANE
        return [each for each in moving if self.rotation or each <= UZ]


FULL = Physics()


@dataclass(frozen=True)
class Mode:
    """One Bloch mode: displacement u and rotation φ = Rθ = i f, with |u|² + |f|² = 1, and frequency in 1/t0.

    p is the displacement along the wave vector k and q the displacement along ẑ × k; for k along y, p = uy and q = −ux.
    The larger of the two is positive, so p > 0 for L, and q = Q > 0 for TR and RT along y.

    Attributes
    ----------
    name : str
        L, TR or RT; in a cell of several spheres the number of the branch, "1" for the lowest; in space a name of
        `granular_lmp.crystal.modes`.
    vector : WaveVector
        Wave vector k.
    frequency : float
        Frequency, 1/t0.
    ux, uy, f : float
        Amplitudes of one sphere. With a `cell` they are the positive roots of the sums of squares over the cell, for f
        over all axes.
    cell : tuple of (ux, uy, uz, φx, φy, φz)
        Complex amplitudes of the spheres of a cell, as factors of e^{ik·r} at the place r of each sphere; () for L, TR
        or RT of one sphere.
    """

    name: str
    vector: WaveVector
    frequency: float
    ux: float
    uy: float
    f: float
    cell: tuple[tuple[complex, ...], ...] = ()

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
        if self.name.isdecimal():
            return f"a wave of branch {self.name}"
        return f"{'an' if self.name[0] in 'LRSH' else 'a'} {self.name} wave"

    @property
    def along_y(self) -> bool:
        """True if the spheres move more along y than along x."""
        return self.uy > self.ux if self.cell else self.name == "L"

    def shape(self) -> NDArray[np.complex128]:
        """Complex amplitudes (ux, uy, uz, φx, φy, φz) of the spheres of a cell, (P, 6)."""
        return np.array(self.cell or [(self.ux, self.uy, 0, 0, 0, 1j * self.f)])


def branch_mode(name: str, vector: WaveVector, frequency: float, shape: NDArray[Any]) -> Mode:
    """Return the mode of a branch from its shape (u, f) of each sphere, (6P,), normalised to 1.

    The phase makes the largest p or q of a sphere real and positive; of values that are equal to 1e-6 the first counts.
    Without p and q the largest uz is positive, and in a mode that only turns the largest −f.
    """
    each = shape.reshape(-1, 6)
    ways = np.stack([vector.along(each[:, UX], each[:, UY]), vector.across(each[:, UX], each[:, UY])], axis=1).ravel()
    parts = next((way for way in (ways, each[:, UZ]) if np.abs(way).max() > 1e-9), -each[:, FX:].ravel())
    size = np.abs(parts)
    first = parts[np.argmax(size > size.max() * (1 - 1e-6))]
    amplitudes = each * np.conj(first) / abs(first) * TURNS
    ux, uy = np.linalg.norm(amplitudes[:, :UZ], axis=0).tolist()
    f = float(np.linalg.norm(amplitudes[:, FX:]))
    return Mode(name, vector, frequency, ux, uy, f, tuple(map(tuple, amplitudes.tolist())))
