"""Initial fields of a plane wave on a packing, for unit amplitude: lengths in D0, times in t0."""

from dataclasses import dataclass

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.modes import Mode


@dataclass(frozen=True)
class Fields:
    """Displacement and velocity, one row a sphere: columns (ux, uy, φ), φ = Rθ; in D0 and D0/t0."""

    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]


def plane_wave(packing: ase.Atoms, mode: Mode, phase: float = 0.0) -> Fields:
    """The wave Re[U e^{i(ξn − Ωτ + phase)}] at τ = 0, n = 0 at the centre row; zero on the rows that are held.

    Parameters
    ----------
    packing : ase.Atoms
        From `granular_lmp.packing`.
    mode : Mode
        Gives U = (ux, uy, i f), ξ and Ω.
    phase : float
        rad.

    Notes
    -----
    Held rows cut the wave off: what that does reaches the centre at `Scene.echo_time`.
    """
    rows = packing.arrays["row"]
    angle = mode.wavenumber * (rows - rows.max() // 2) + phase
    wave = np.exp(1j * angle)[:, None] * mode.shape()
    wave[packing.arrays["fixed"]] = 0
    return Fields(displacement=wave.real, velocity=(-1j * mode.frequency * wave).real)
