"""Upper bounds of the highest frequency of any crystal from its contacts, which limit the time step.

The bound needs no matrix (`granular_lmp.crystal.lanczos`). Velocity Verlet is stable below Δt = 2/Ω_max.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import Contacts
from granular_lmp.crystal.lanczos import top_bound
from granular_lmp.crystal.mode import FULL, Physics
from granular_lmp.crystal.modes import effective_inertia, effective_rolling, require_plane
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.frozen import dataclass

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
_Components = Sequence[Floats | float]


@lru_cache(maxsize=2)  # a run with a tolerance asks four times
def frequency_bound(contacts: Contacts, sphere: Sphere, physics: Physics = FULL) -> float:
    """Return an upper bound of the frequencies of a crystal, rad/t0.

    Parameters
    ----------
    contacts : Contacts
        Contacts of all spheres of the crystal. The bound is valid for the waves that the periodic cell contains; a unit
        cell contains only Γ, so pass the whole crystal.
    sphere : Sphere
        Reference sphere, whose t0 is the unit of time.
    physics : Physics
        Degrees of freedom.

    Raises
    ------
    ValueError
        If spheres move in the plane and contacts do not lie in a plane z = const.

    Notes
    -----
    The bound is at most 2e-3 too high for large crystals; held spheres only lower the spectrum. The start vector is
    random, but always the same. A start orthogonal to the highest mode would miss it, which has not been observed.
    """
    if not physics.space:
        require_plane(contacts)
    mass = np.repeat([contacts.mass, effective_inertia(contacts)], 3, axis=0)
    inverse_root_mass = np.sqrt(sphere.mass / mass)
    inverse_root_mass[np.setdiff1d(range(6), physics.coordinates)] = 0.0
    per_mass, springs = sphere.time_scale**2 / sphere.mass, list(_springs(contacts, physics))

    def apply(motion: Floats) -> Floats:
        return inverse_root_mass * _restoring(springs, inverse_root_mass * motion) * per_mass

    # Random numbers are drawn sphere by sphere
    start = np.random.default_rng(0).standard_normal(mass.T.shape).T * (inverse_root_mass > 0)
    return float(np.sqrt(top_bound(apply, start, int(np.count_nonzero(inverse_root_mass)))))


def crude_bound(contacts: Contacts, sphere: Sphere, physics: Physics = FULL) -> float:
    """Return an upper bound of the frequencies of a crystal, rad/t0, in a hundredth of the time of `frequency_bound`.

    The energy of a spring between two moving bodies is at most twice the sum of its energies if only one body moves.
    With the normal stiffness k, shear stiffness k_s, rolling stiffness k_r and prestress f, and sums over the contacts
    of a sphere,

        Ω² ≤ 2 max over spheres of { Σ [max(k, 2k_s) + max(−f, 0)/|d|]/m  and  Σ [2k_s + k_r]/(I/R²) }

    Good values: a step below 2/Ω needs no other bound. The bound is about 1.5 times too high if shear turns equal
    spheres.
    """
    shear = 2 * contacts.shear_stiffness * physics.shear
    pulled = np.maximum(-contacts.contact_force, 0.0) / contacts.length
    highest = 0.0
    bodies = [(np.maximum(contacts.normal_stiffness, shear) + pulled, contacts.mass)]
    if physics.rotation:
        rolling = effective_rolling(contacts, physics) if physics.rolling else 0.0
        bodies.append((shear + rolling, effective_inertia(contacts)))
    ends, count = (contacts.i, np.where(contacts.on_wall, len(contacts.mass), contacts.j)), len(contacts.mass) + 1
    for stiffness, mass in bodies:
        held = sum(np.bincount(end, stiffness, count)[:-1] for end in ends)
        highest = max(highest, float((held / mass).max()))
    return float(np.sqrt(2 * highest) * sphere.time_scale)


@dataclass(frozen=True, eq=False)
class _Springs:
    """Springs of some contacts, with vectors by component; a component that is always 0 is a number.

    Attributes
    ----------
    i, j : spheres
    normal : components of n
    stiffness, shear, turning : k, k_s and −f/|d|
    rolling : k_r with the arms Rc/Ri and Rc/Rj, or None
    coordinates : freedoms that move
    """

    i: Integers
    j: Integers
    normal: _Components
    stiffness: Floats
    shear: Floats
    turning: Floats
    rolling: tuple[Floats, ...] | None
    coordinates: Sequence[int]

    def of(self, motion: Floats, first: int, end: Integers) -> _Components:
        """Return three components, from index `first`, of the motion (6, N + 1) of the spheres at one end."""
        return [motion[each][end] if each in self.coordinates else 0.0 for each in range(first, first + 3)]


def _springs(contacts: Contacts, physics: Physics) -> Iterator[_Springs]:
    """Yield the springs of the contacts in blocks."""
    for part in contacts.parts():
        normal = [part.normals[:, axis].copy() if axis in physics.coordinates else 0.0 for axis in range(3)]
        arms = (part.radius[end] / part.radii for end in (part.j, part.i))
        rolling = (effective_rolling(part, physics), *arms) if physics.rolling else None
        shear = part.shear_stiffness * physics.shear
        turning = -part.contact_force / part.length
        yield _Springs(part.i, part.j, normal, part.normal_stiffness, shear, turning, rolling, physics.coordinates)


def _restoring(springs: Sequence[_Springs], motion: Floats) -> Floats:
    """Return minus the contact forces and torques/R (6, N) on spheres that move by (u, φ), (6, N)."""
    moving = np.column_stack([motion, np.zeros(6)])  # a wall, whose index is −1, does not move
    back = np.zeros_like(moving)
    for each in springs:
        ends, n = (each.i, each.j), each.normal
        (u_i, turn_i), (u_j, turn_j) = ([each.of(moving, first, end) for first in (0, 3)] for end in ends)
        apart = [b - a for a, b in zip(u_i, u_j, strict=True)]
        along = sum(a * b for a, b in zip(n, apart, strict=True))
        sideways = [a - along * b for a, b in zip(apart, n, strict=True)]
        slip = _cross([a + b for a, b in zip(turn_i, turn_j, strict=True)], n)
        shear = [each.shear * (a - b) for a, b in zip(sideways, slip, strict=True)]
        normal = each.stiffness * along
        pull = [normal * a + b + each.turning * c for a, b, c in zip(n, shear, sideways, strict=True)]
        stiffness, arm_i, arm_j = each.rolling or (0.0, 0.0, 0.0)
        roll = [stiffness * (arm_j * b - arm_i * a) for a, b in zip(turn_i, turn_j, strict=True)]
        wrench = _cross(n, shear)
        on_i = [*(-a for a in pull), *(-a - arm_i * b for a, b in zip(wrench, roll, strict=True))]
        on_j = [*pull, *(arm_j * b - a for a, b in zip(wrench, roll, strict=True))]
        for end, on in zip(ends, (on_i, on_j), strict=True):
            for column in each.coordinates:
                np.add.at(back[column], end, on[column])
    return back[:, :-1]


def _cross(a: _Components, b: _Components) -> _Components:
    """Return a × b by components."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
