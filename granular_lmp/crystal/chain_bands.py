"""Bands of a chain of spheres along its line: the frequencies of a periodic order of masses and contacts.

    m_s ω² u_s = K_{s−1} (u_s − u_{s−1}) + K_s (u_s − u_{s+1}),   u_{s+p} = u_s e^{iχ}

for the p spheres of a cell, with the phase χ from cell to cell. Neighbours alone are coupled, so that the edges of all
bands lie at χ = 0 and χ = π; between two bands no wave runs. Two masses m < M in turn with equal contacts have an
acoustic band up to √(2K/M) and an optical one from √(2K/m) to √(2K(1/m + 1/M)).

`granular_lmp.crystal.modes` has the modes in the plane, which a chain that is pressed together lacks: nothing holds it
sideways. Source: L. Brillouin, Wave Propagation in Periodic Structures (1953).
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SAME = 1e-9  # relative; overlaps of one pair of spheres differ by rounding of the places, 1e-11


def cell_of(mass: Floats, stiffness: Floats) -> int:
    """Return the least number of spheres after which masses and contacts of a chain repeat; 0 if they do not.

    Parameters
    ----------
    mass : (n,)
    stiffness : (n − 1,)
        Of the contacts between them. A cell must be there twice.
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
        Of the spheres of one cell.
    stiffness : (p,)
        Of each contact with the next sphere, the last that with the next cell.
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
    """Return the lowest and the highest frequency of each band of a cell, (p, 2), as `frequencies` takes it."""
    found = np.sort(frequencies(mass, stiffness, np.array([0.0, np.pi])).T, axis=1)
    found[0, 0] = 0.0  # the whole chain is shifted; an eigenvalue of 1e-16 would have the root 1e-8
    return np.asarray(found)


def gaps(bands: Floats) -> list[tuple[float, float]]:
    """Return the ranges (from, to) between the bands of `edges` in which no wave runs."""
    between = zip(bands[:-1, 1].tolist(), bands[1:, 0].tolist(), strict=True)
    return [(low, high) for low, high in between if high > low * (1 + SAME)]
