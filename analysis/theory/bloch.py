"""The linear lattice at a wave vector: its modes as a real eigenproblem, D W = Ω² M W in the gauge W = (u, v, f).

D is the sum over the springs of the three bonds of a cell, M = diag(1, 1, Ĩ/(1−η)); see `analysis.theory.springs` for
both, the gauge φ = i f and the units. Where spheres do not turn f is no coordinate, and there are two modes, not three.

When it breaks: where two branches touch, the eigenvectors of the pair are arbitrary.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.springs import Springs, elongations, stiffness

Floats = NDArray[np.float64]


def real_modes(wavevector: ArrayLike, contact: Springs) -> tuple[Floats, Floats]:
    """Return frequencies (..., J) and shapes (..., J, 3), normalised and signed as in `directions.modes`."""
    rows, moving = elongations(wavevector), contact.coordinates
    root = np.sqrt(contact.mass[:moving])
    matrix = stiffness(rows, contact)[..., :moving, :moving]
    _, vectors = np.linalg.eigh(matrix / (root[:, None] * root))
    shapes = np.zeros((*vectors.shape[:-1], 3))
    shapes[..., :moving] = np.swapaxes(vectors, -1, -2) / root
    shapes /= np.linalg.norm(shapes, axis=-1, keepdims=True)
    # The energy of a mode keeps the digits of a low frequency, which eigh rounds to those of the highest, and
    # is never negative (compression, χ, of no more than the springs bear).
    columns = np.swapaxes(shapes, -1, -2)
    normal, sideways, sheared = (
        np.sum((e @ columns) ** 2, axis=-2) for e in (rows.normal, rows.sideways, rows.sheared)
    )
    energy = (normal + contact.shear * sheared - contact.chi * sideways) / (2.0 * (contact.kappa + 3.0))
    squares = energy / (shapes**2 @ contact.mass)
    along = unit(wavevector)
    frame = np.stack([along, np.stack([-along[..., 1], along[..., 0]], axis=-1)], axis=-1)
    translation = shapes[..., :2] @ frame
    leading = np.take_along_axis(translation, np.argmax(np.abs(translation), axis=-1)[..., None], axis=-1)
    # Below the rounding of the eigenvectors a translation has no sign of its own.
    leading = np.where(np.abs(leading) > 1e-12, leading, -shapes[..., 2:])
    return np.sqrt(squares), shapes * np.where(leading < 0.0, -1.0, 1.0)


def select(frequencies: Floats, shapes: Floats, branch: ArrayLike) -> tuple[Floats, Floats]:
    """Return the frequency (...) and shape (..., 3) of one branch per wave vector."""
    index = np.broadcast_to(np.asarray(branch), frequencies.shape[:-1])
    branches = range(frequencies.shape[-1])
    if not np.isin(index, branches).all():
        raise ValueError(f"branch is {branch!r}; allowed: {', '.join(map(str, branches))} in ascending frequency")
    return (
        np.take_along_axis(frequencies, index[..., None], axis=-1)[..., 0],
        np.take_along_axis(shapes, index[..., None, None], axis=-2)[..., 0, :],
    )


def unit(wavevector: ArrayLike) -> Floats:
    """Return k/|k|, and y at k = 0."""
    k = np.asarray(wavevector, dtype=float)
    length = np.linalg.norm(k, axis=-1, keepdims=True)
    return np.where(length > 0.0, k / np.where(length > 0.0, length, 1.0), [0.0, 1.0])


def wavevector_of(wavenumber: float, direction: float) -> Floats:
    """Return k (2,) in 1/lattice constant from ξ = (√3/2)|k| and the direction in degrees from x towards y.

    Raises ValueError unless ξ is positive and both are finite.
    """
    if not 0.0 < wavenumber < np.inf:
        raise ValueError(f"wavenumber is {wavenumber!r}; allowed: above 0, finite")
    if not np.isfinite(direction):
        raise ValueError(f"direction is {direction!r}; allowed: degrees, finite")
    return 2.0 / np.sqrt(3.0) * wavenumber * frame(direction)[0]


def frame(direction: float) -> Floats:
    """Return the unit vectors along k and along ẑ × k as rows: (p, q) = frame @ (u, v)."""
    cosine, sine = np.cos(np.radians(direction)), np.sin(np.radians(direction))
    return np.array([[cosine, sine], [-sine, cosine]])
