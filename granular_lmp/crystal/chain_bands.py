"""Frequency bands of a chain of spheres that moves along its line, for a periodic sequence of masses and contacts.

    m_s ω² u_s = K_{s−1} (u_s − u_{s−1}) + K_s (u_s − u_{s+1}),   u_{s+p} = u_s e^{iχ}

for the p spheres of a cell, with the phase χ from cell to cell. Only neighbours are coupled, so the edges of all bands
lie at χ = 0 and χ = π; no wave runs between two bands. A chain of alternating masses m < M with equal contacts has an
acoustic band up to √(2K/M) and an optical band from √(2K/m) to √(2K(1/m + 1/M)).

`granular_lmp.crystal.modes` has the modes in the plane. A compressed chain has no such modes, because nothing holds it
sideways. Source: L. Brillouin, Wave Propagation in Periodic Structures (1953).
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SAME = 1e-9  # relative difference below which values are equal; rounding of positions changes overlaps by 1e-11


def cell_of(mass: Floats, stiffness: Floats) -> int:
    """Return the least number of spheres after which masses and contacts of a chain repeat; 0 if they do not.

    The chain must contain at least two cells.

    Parameters
    ----------
    mass : (n,)
        Masses of the spheres.
    stiffness : (n − 1,)
        Stiffnesses of the contacts between successive spheres.
    """
    for cell in range(1, len(mass) // 2 + 1):
        if all(np.allclose(each[cell:], each[:-cell], rtol=SAME, atol=0) for each in (mass, stiffness)):
            return cell
    return 0


def frequencies(mass: Floats, stiffness: Floats, phases: Floats) -> Floats:
    """Return the frequencies ω (k, p) of an infinite chain, ascending.

    Parameters
    ----------
    mass : (p,)
        Masses of the spheres of one cell.
    stiffness : (p,)
        Stiffness of the contact of each sphere with the next; the last contact joins the next cell.
    phases : (k,)
        χ, rad per cell.
    """
    count, here = len(mass), np.arange(len(mass))
    matrix = np.zeros((len(phases), count, count), dtype=complex)
    turn = np.where(here == count - 1, np.exp(1j * phases)[:, None], 1.0)
    for s, after in zip(here, (here + 1) % count, strict=True):
        matrix[:, s, s] += stiffness[s]
        matrix[:, after, after] += stiffness[s]
        matrix[:, s, after] -= stiffness[s] * turn[:, s]
        matrix[:, after, s] -= stiffness[s] * turn[:, s].conj()
    squares = np.linalg.eigvalsh(matrix / np.sqrt(np.outer(mass, mass)))
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def edges(mass: Floats, stiffness: Floats) -> Floats:
    """Return the lowest and the highest frequency of each band, (p, 2); mass and stiffness as in `frequencies`."""
    found = np.sort(frequencies(mass, stiffness, np.array([0.0, np.pi])).T, axis=1)
    found[0, 0] = 0.0  # shift of the whole chain; rounding of its eigenvalue, 1e-16, would give the frequency 1e-8
    return np.asarray(found)


def gaps(bands: Floats) -> list[tuple[float, float]]:
    """Return the ranges (from, to) between the bands of `edges` in which no wave runs."""
    between = zip(bands[:-1, 1].tolist(), bands[1:, 0].tolist(), strict=True)
    return [(low, high) for low, high in between if high > low * (1 + SAME)]
