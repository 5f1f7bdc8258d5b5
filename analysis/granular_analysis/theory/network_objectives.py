"""Objectives: numbers of the record of a run, for its gradient (`granular_analysis.theory.network_gradient`).

Each objective is a function of a `Record`, written in ``jax.numpy``. Set its other arguments by ``functools.partial``:

    gradient(run, partial(amplitude, row=0, places=places, wavevector=(0.0, 0.8), frequency=1.2), factors)

A partial function is compiled once for all runs with equal traits and shapes, so make it once and reuse it.
"""

from typing import Any

import numpy as np
from jax import numpy as jnp
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.network import Network
from granular_analysis.theory.network_gradient import Record
from granular_analysis.theory.network_state import Pairs

__all__ = ["amplitude", "across", "energy", "largest", "misfit"]

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
_LATE = 4  # `second_harmonic` reads the last of this many equal parts of a record


def amplitude(found: Record, row: int, places: ArrayLike, wavevector: ArrayLike, frequency: float) -> Any:
    """Return the amplitude A of a wave A cos(k·r − Ωt + φ) in a row of the motion.

        A = 2 |Σ_t w(t) ⟨u e^{−i(k·r − Ωt)}⟩| / Σ_t w(t),   w(t) = 1 − cos(2πt/T)

    with the mean ⟨⟩ over the recorded spheres and the duration T of the record.

    Parameters
    ----------
    found : Record
    row : row of the motion that holds u.
    places : (n, d) positions of the recorded spheres at rest.
    wavevector : (d,) k in rad per unit of length.
    frequency : Ω in rad per unit of time.

    Good values: a record of two or more whole periods, and spheres at all phases of the wave. When it breaks: A has no
    slope where it is 0.
    """
    turns = jnp.asarray(places) @ jnp.asarray(wavevector) - frequency * found.times[:, None]
    weights = 1 - jnp.cos(2 * jnp.pi * found.times / found.times[-1])
    mean = jnp.mean(found.motion[:, row] * jnp.exp(-1j * turns), axis=1)
    return 2 * jnp.abs(weights @ mean) / jnp.sum(weights)


def second_harmonic(found: Record, places: ArrayLike, wavevector: ArrayLike, unit: Any = 1.0) -> Any:
    """Return the second harmonic in the last quarter of a run, (T',) complex, one number for each time.

    At these times the displacements along k, divided by `unit`, have a part Re[C e^{2ik·r}]. The vector is C/√T', so
    its length is the root mean square of |C|.

    Parameters
    ----------
    found : Record
    places : (n, d) positions of the recorded spheres at rest.
    wavevector : (d,) k of the fundamental, in rad per unit of length.
    unit : length in which C is given.

    A crystal that is not its own mirror image turns part of a transverse wave into a longitudinal one at first order.
    To remove it, take the mean over two runs whose starts have opposite signs: it keeps only even orders.
    """
    late = found.motion[len(found.times) - len(found.times) // _LATE :]
    k = jnp.asarray(wavevector)
    along = jnp.einsum("d,tdn->tn", k / jnp.linalg.norm(k), late[:, : len(k)])
    each = 2 * jnp.mean(along * jnp.exp(-2j * (jnp.asarray(places) @ k)), axis=1)
    return each / (unit * jnp.sqrt(len(along)))


def farthest(found: Record, unit: Any = 1.0) -> Any:
    """Return the largest displacement of the recorded spheres, over a unit; it has the kinks of `largest`."""
    return jnp.sqrt(jnp.max(jnp.sum(found.motion[:, : _dimension(found)] ** 2, axis=1))) / unit


def _dimension(found: Record) -> int:
    return 2 if found.motion.shape[1] == 6 else 3  # 2f rows: f is 3 in the plane, 6 in space


def motion(found: Record, near: ArrayLike, far: ArrayLike, unit: Any = 1.0) -> Any:
    """Return the mean squared velocity of spheres `near` over the run, which is twice their kinetic energy per mass.

    near, far : indices into the recorded spheres. If `far` is not empty, the mean of `near` is divided by that of
        `far`; otherwise by the square of `unit`, a length.
    """
    half = found.motion.shape[1] // 2
    square = jnp.sum(found.motion[:, half : half + _dimension(found)] ** 2, axis=1)
    here = jnp.trapezoid(jnp.mean(square[:, jnp.asarray(near)], axis=1), found.times)
    if not jnp.size(jnp.asarray(far)):
        return here / found.times[-1] / unit**2
    return here / jnp.trapezoid(jnp.mean(square[:, jnp.asarray(far)], axis=1), found.times)


def misfit(found: Record, measured: ArrayLike, errors: ArrayLike = 1.0) -> Any:
    """Return Σ ((motion − measured)/errors)², the sum of squares of `granular_analysis.theory.estimation`.

    measured, errors : (T + 1, 2f, n), or broadcast to it; an error is inf where nothing was measured.
    """
    return jnp.sum(((found.motion - jnp.asarray(measured)) / jnp.asarray(errors)) ** 2)


def largest(found: Record, row: int, first: float = 0.0, last: float = np.inf) -> Any:
    """Return max |u| of a row of the motion, over the recorded spheres and the times from `first` to `last`.

    When it breaks: it has a kink where the maximum passes to another sphere or time.
    """
    inside = (found.times >= first) & (found.times <= last)
    return jnp.max(jnp.abs(found.motion[:, row]) * inside[:, None])


def energy(found: Record, signs: ArrayLike) -> Any:
    """Return the energy that the recorded contacts carry, ∫ Σ_c s_c P_c dt by the trapezoidal rule.

    signs : (C,) s_c, from `across`.
    """
    return jnp.trapezoid(found.power @ jnp.asarray(signs, dtype=float), found.times)


def across(network: Network, pairs: Pairs, point: ArrayLike, normal: ArrayLike) -> tuple[Integers, Floats]:
    """Return the pairs (C,) that a plane separates, and signs (C,): 1 if the second sphere is beyond it, else −1.

    point, normal : (d,) a point of the plane and its normal; beyond is along the normal, as is a positive energy.
    """
    ways = np.asarray(normal, dtype=float)
    begin = (network.position[pairs.first] - np.asarray(point)) @ ways
    end = begin + ways @ pairs.apart
    found = np.flatnonzero(((begin < 0) != (end < 0)) & (pairs.second < len(network.position)))
    return found, np.where(end[found] < 0, -1.0, 1.0)
