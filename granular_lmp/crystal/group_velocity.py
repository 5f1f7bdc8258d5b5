"""Group velocities of the waves of one frequency in all directions: where the front of a short signal is.

A signal of frequency Ω that starts in a point is, far from it, where energy of that frequency runs:

    r(τ) = v_g(k) τ,    v_g = ∂Ω_j/∂k    for every k with Ω_j(k) = Ω

The curve of v_g over all these k is the group-velocity surface of branch j; at long waves it is a circle. Where the
contour Ω_j(k) = Ω is flat or turns, energy gathers and the curve has corners. Velocities of RT point against k.
"""

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.lattices import lattice_constant
from granular_lmp.crystal.mode import FULL, Physics
from granular_lmp.crystal.modes import MODES, bloch_modes, branch_names
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.wavevector import ROW_SPACING, zone_edge

_DIRECTIONS = 360  # of k, all around, even
_SAMPLES = 160  # points of |k| between Γ and the edge of the zone; a crossing is interpolated linearly between two
_STEP = 1e-4  # 1/R, of central differences


def fronts(
    lattice: Contacts, sphere: Sphere, frequency: float, physics: Physics = FULL
) -> dict[str, NDArray[np.float64]]:
    """Return the group velocities of the waves of a frequency in the hexagonal lattice, by name of their mode.

    Parameters
    ----------
    lattice, sphere : Contacts, Sphere
        Contacts of the hexagonal lattice of one sphere a cell, and its sphere.
    frequency : float
        Ω, rad/t0.
    physics : Physics
        Degrees of freedom.

    Returns
    -------
    dict of str to (n, 2) array
        v_g in R/t0, in the order of the directions of k, for each mode that has the frequency in some: L moves most
        along k, TR is the lower and RT the upper of the others. A direction in which the mode has the frequency at
        several k gives several rows. To about 1e-3: |k| is interpolated.
    """
    # Half of them, as −k has the frequency of k and the opposite velocity; none is along a mirror line
    degrees = np.linspace(-180, 0, _DIRECTIONS // 2, endpoint=False) + 180 / _DIRECTIONS
    along = np.column_stack([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    edge = np.array([zone_edge(each) for each in degrees]) / ROW_SPACING / lattice_constant(sphere)
    share = np.linspace(0.01, 1.0, _SAMPLES)
    size = edge[:, None] * share
    found, shapes = bloch_modes(lattice, sphere, size[..., None] * along[:, None], physics)
    crossed = np.diff(np.sign(found - frequency), axis=1) != 0  # (directions, samples - 1, branches)
    if not crossed.any():
        return {}
    place, at, branch = np.argwhere(crossed).T
    below, above = (found[place, each, branch] - frequency for each in (at, at + 1))
    length = size[place, at] + (size[place, at + 1] - size[place, at]) * below / (below - above)
    k = length[:, None] * along[place]
    nearby = k[:, None] + _STEP * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    values = bloch_modes(lattice, sphere, nearby, physics)[0][np.arange(len(k)), :, branch]
    velocities = (values[:, [0, 2]] - values[:, [1, 3]]) / (2 * _STEP)
    result: dict[str, list[NDArray[np.float64]]] = {}
    for direction, sample, each, velocity in zip(place, at, branch, velocities, strict=True):
        name = branch_names(shapes[direction, sample], along[direction])[each]
        result.setdefault(name, []).append(velocity)
    return {name: np.concatenate([result[name], np.negative(result[name])]) for name in MODES if name in result}
