"""The one wave that every theory of this folder takes: a linear mode of an amplitude, in the lattice of a contact."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from analysis.second_harmonic import Mode, ModeName, Ratios
from analysis.second_harmonic import mode as mode_along_y
from analysis.theory.bloch import frame, hexagonal, wavevector_of
from analysis.theory.contact import Contact

# Forces that may be left, in units of the largest stiffness at the wave vector. Rounding leaves 1e-15; a contact of
# another ν, inertia or geometry leaves as much as it differs by.
RESIDUAL = 1e-9


@dataclass(frozen=True)
class Wave:
    """A plane wave at τ = 0: u = Re U exp(i(k·r + phase)), moving as the linear mode does.

    Attributes
    ----------
    mode : `second_harmonic.mode` along y, `directions.mode` in any direction; it holds the wave vector.
    amplitude : a = D0/Δ0.
    contact : the physics of every contact of the lattice.
    phase : rad, at row 0.
    others : what else a run has that a theory must hold, in the words of `analysis.theory.catalogue`.

    Raises
    ------
    ValueError
        For a mode that is none of the contact's lattice: another ν, inertia, geometry or compression, or a rotation
        where the spheres do not turn. Good: 1e-9 of the stiffness, so that a long wave is judged less sharply.
    """

    mode: Mode
    amplitude: float
    contact: Contact
    phase: float = 0.0
    others: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        left = residual(self.mode, self.contact)
        if not left < RESIDUAL:
            raise ValueError(
                f"mode {self.mode.name} at wavenumber = {self.mode.wavenumber} is no wave of this contact: it leaves "
                f"{left:.1e} of the forces, allowed is {RESIDUAL:.0e}; make the mode with the constants of the contact"
            )

    @property
    def ratios(self) -> Ratios:
        """Constants of the closed forms, for this mode under the law of the contact."""
        return self.contact.ratios_of(self.mode)

    @classmethod
    def of_mode(cls, name: ModeName, wavenumber: float, amplitude: float, contact: Contact, phase: float = 0.0) -> Self:
        """Return the wave along y of the mode of a name at ξ = wavenumber, rad per row."""
        return cls(mode_along_y(name, wavenumber, contact.secant_ratios), amplitude, contact, phase)


def residual(mode: Mode, contact: Contact) -> float:
    """Return |D W − Ω² M W|/|D| of a mode W = (u, v, f), 0 for a mode of the contact's lattice.

    A rotation counts in full where the spheres do not turn.
    """
    crystal = hexagonal(contact)
    shape = np.array([*(np.array([mode.p, mode.q]) @ frame(mode.direction)), 1j * mode.f])[: len(crystal.freedoms)]
    matrix = crystal.stiffness(wavevector_of(mode.wavenumber, mode.direction))
    left = matrix @ shape - mode.frequency**2 * crystal.moving(crystal.mass) * shape
    forces = float(np.linalg.norm(left) / np.linalg.norm(matrix))
    return forces if contact.turns else float(np.hypot(forces, mode.f))
