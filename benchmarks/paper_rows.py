"""The rows of the paper's set-up, for waves along y: rows on a ring, and 201 rows between held ones."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.second_harmonic import refuse_oblique
from granular_analysis.theory.lattice import initial_state, integrate, longest_step, rhs
from granular_analysis.theory.neighbours import Neighbours, shifted
from granular_analysis.theory.wave import Wave

Floats = NDArray[np.float64]


def ring_neighbours() -> Neighbours:
    """Rows on a ring, for waves along y: the exact infinite lattice for waves with ξN a multiple of 2π."""

    def ahead(values: Floats) -> Floats:
        result = np.empty((*values.shape[:-1], 3, values.shape[-1]), dtype=values.dtype)
        result[..., 0, :] = values
        result[..., 1:, :-1] = values[..., None, 1:]
        result[..., 1:, -1] = values[..., None, 0]
        return result

    def behind(values: Floats) -> Floats:
        result, before = values[..., 0, :].copy(), values[..., 1, :] + values[..., 2, :]
        result[..., 1:] += before[..., :-1]
        result[..., 0] += before[..., -1]
        return result

    return shifted(90.0, ahead, behind)


def rows(wave: Wave, tau: ArrayLike, *, rows: int = 201, rtol: float = 1e-11) -> tuple[Floats, Floats, Floats]:
    """Displacements p, q, φ (T,) of the centre row, (rows−1)//2 counted from 0, in units of D0: the paper's set-up.

    The first and last row are held at zero, so they are one and the same row of a ring of rows−1.

    Raises ValueError for fewer than 5 rows, and for a wave that does not run along y.

    Breaks when echoes arrive: the fastest wave, long L, covers half a row per τ. In 201 rows the centre departs
    from the infinite lattice by 1e-7 at τ=175 and by order 1 of the walls' signal at τ=200.
    """
    if rows < 5:
        raise ValueError(f"rows = {rows} must be at least 5")
    refuse_oblique(wave.mode)
    contact, neighbours = wave.contact, ring_neighbours()
    centre = (rows - 1) // 2
    phases = wave.mode.wavenumber * np.arange(-centre, rows - 1 - centre, dtype=np.float64) + wave.phase
    start = initial_state(wave.mode, wave.amplitude, phases, contact, neighbours)
    start[:, 0] = 0.0

    def held(state: Floats) -> Floats:
        rate = rhs(state, contact, neighbours)
        rate[:, 0] = 0.0
        return rate

    states = integrate(held, start, tau, rtol, wave.amplitude, longest_step(contact))
    p, q, phi = states[:, :3, centre].T / wave.amplitude
    return p, q, phi
