"""Chain of spheres with Hertz contacts along one line, without LAMMPS.

    m_i u_i'' = f_i − f_{i+1} + P_i,   f_j = A_j δ_j^{3/2} + η_j δ_j^{1/4} δ_j',   δ_j = (d_j + u_{j−1} − u_j)₊

Sphere i lies between the contacts i and i + 1. The contacts 0 and n are with walls at rest, u_{−1} = u_n = 0; an end
without a wall has A = 0. A held sphere has infinite mass. The overlap at rest d_j is negative for a gap. P_i is the
constant load that keeps the chain at rest at u = 0: the force F0 on free ends, zero on spheres that just touch. There
is no adhesion, friction or rotation. States have the shape (…, n), so many chains move in parallel.

The dashpots η_j = √5 ζ √(μ_j A_j), ζ = −ln e/√(π² + ln² e), 1/μ = 1/m + 1/m', make two spheres that collide at any
relative velocity separate with e times that velocity (LAMMPS's ``coeff_restitution``). A contact attracts before it
ends: at δ → 0 the dashpot exceeds the repulsion.

Forces are computed as differences from those at rest: motions of 1e-10 of the overlap have six digits, weaker ones
fewer.

Units are any consistent ones; with A = m = 1 a velocity v gives overlaps of v^{4/5} and times of v^{−1/5}.
`cases.solitary.chain_motion` integrates the motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Array = NDArray[Any]  # floats, or complex numbers where a derivative is taken by a complex step
End = Literal["free", "held", "wall"]


@dataclass(frozen=True, eq=False)
class Chain:
    """Spheres in a row and their contacts.

    Attributes
    ----------
    mass : (n,), positive; infinite for a held sphere.
    stiffness : (n + 1,) A_j, not negative; 0 without a contact.
    overlap : (n + 1,) d_j at rest (u = 0); negative for a gap.
    restitution : e of a collision at each contact, in (0, 1]; 1 means no dashpots.

    Raises ValueError for shapes that do not fit and for values out of range.
    """

    mass: Floats
    stiffness: Floats
    overlap: Floats
    restitution: float = 1.0

    def __post_init__(self) -> None:
        count = self.mass.size
        shapes = {"mass": count, "stiffness": count + 1, "overlap": count + 1}
        for name, size in shapes.items():
            value = getattr(self, name)
            if value.shape != (size,) or np.isnan(value).any():
                raise ValueError(f"{name} must hold {size} numbers for {count} spheres, has shape {value.shape}")
        if count == 0 or not np.all(self.mass > 0):
            raise ValueError(f"mass must be positive, or infinite for a held sphere, not {self.mass}")
        if not np.all((self.stiffness >= 0) & np.isfinite(self.stiffness)):
            raise ValueError(f"stiffness must be finite and not negative, not {self.stiffness}")
        if not np.isfinite(self.overlap).all():
            raise ValueError(f"overlap must be finite, not {self.overlap}")
        if not 0 < self.restitution <= 1:
            raise ValueError(f"restitution must be above 0 and at most 1, not {self.restitution}")

    def __len__(self) -> int:
        """Return the number of spheres."""
        return self.mass.size

    @property
    def damped(self) -> bool:
        """Return whether the contacts have dashpots."""
        return self.restitution < 1

    @cached_property
    def dashpot(self) -> Floats:
        """Return η_j (n + 1,); the contact of two held spheres has none."""
        loss = -np.log(self.restitution)
        inverse = np.append(1 / self.mass, 0.0) + np.append(0.0, 1 / self.mass)  # 1/μ
        light = np.divide(1.0, inverse, out=np.zeros_like(inverse), where=inverse > 0)
        result: Floats = np.sqrt(5 * light * self.stiffness) * (loss / np.hypot(np.pi, loss))
        return result

    @cached_property
    def load(self) -> Floats:
        """Return the constant force (n,) on each sphere that balances its contacts at rest."""
        force = forces(self, np.zeros(len(self)))
        result: Floats = force[1:] - force[:-1]
        return result


def compressed(mass: ArrayLike, stiffness: ArrayLike, force: float = 0.0) -> Chain:
    """Return a chain at rest in which every contact carries the same force, d_j = (F0/A_j)^{2/3}.

    Parameters
    ----------
    mass : (n,), infinite for a held sphere.
    stiffness : (n + 1,); an end with A = 0 is free, and its sphere carries the load F0.
    force : F0 ≥ 0; 0 for spheres that just touch.
    """
    mass, stiffness = np.array(mass, dtype=float), np.array(stiffness, dtype=float)
    if not (np.isfinite(force) and force >= 0):
        raise ValueError(f"force must be finite and not negative, not {force}")
    if stiffness.size > 2 and not np.all(stiffness[1:-1] > 0):
        raise ValueError(f"stiffness must be positive between two spheres, not {stiffness[1:-1]}")
    touching = stiffness > 0
    overlap = np.where(touching, (force / np.where(touching, stiffness, 1.0)) ** (2 / 3), 0.0)
    return Chain(mass, stiffness, overlap)


def uniform(count: int, force: float = 0.0) -> Chain:
    """Return equal spheres with A = m = 1 and free ends."""
    stiffness = np.ones(count + 1)
    stiffness[[0, -1]] = 0.0
    return compressed(np.ones(count), stiffness, force)


def spheres(
    radius: ArrayLike,
    density: ArrayLike,
    youngs_modulus: ArrayLike,
    poisson_ratio: ArrayLike,
    *,
    ends: Sequence[End] = ("free", "free"),
    force: float = 0.0,
) -> Chain:
    """Return a chain of elastic spheres: A = (4/3) E* √R*, 1/R* = Σ 1/R, 1/E* = Σ (1 − ν²)/E, m = (4/3) π ϱ R³.

    Parameters
    ----------
    radius, density, youngs_modulus, poisson_ratio : (n,), or one number for all.
    ends : of the left and the right end: "free"; "held", the end sphere does not move; "wall", a rigid plane that
        touches the end sphere: 1/E* = (1 − ν²)/E, R* = R.
    force : F0, which compresses the chain.

    Source: Hertz's law, e.g. K. L. Johnson, Contact Mechanics, equations 4.22 to 4.24.
    """
    values = np.broadcast_arrays(*np.atleast_1d(radius, density, youngs_modulus, poisson_ratio))
    R, rho, E, nu = (np.array(value, dtype=float) for value in values)
    for name, value in (("radius", R), ("density", rho), ("youngs_modulus", E)):
        if not np.all((value > 0) & np.isfinite(value)):
            raise ValueError(f"{name} must be positive and finite, not {value}")
    if not np.all((nu > -1) & (nu <= 0.5)):
        raise ValueError(f"poisson_ratio must be above -1 and at most 0.5, not {nu}")
    if len(ends) != 2 or not set(ends) <= set(get_args(End)):
        raise ValueError(f"ends must be two of {', '.join(get_args(End))}, not {ends!r}")
    compliance, curvature = (1 - nu**2) / E, 1 / R
    stiffness = np.zeros(R.size + 1)
    stiffness[1:-1] = 4 / 3 / (compliance[:-1] + compliance[1:]) / np.sqrt(curvature[:-1] + curvature[1:])
    mass = 4 / 3 * np.pi * rho * R**3
    for contact, sphere, end in ((0, 0, ends[0]), (-1, -1, ends[1])):
        if end == "wall":
            stiffness[contact] = 4 / 3 / compliance[sphere] * np.sqrt(R[sphere])
        elif end == "held":
            mass[sphere] = np.inf
    return compressed(mass, stiffness, force)


def overlaps(chain: Chain, u: Array) -> Array:
    """Return the overlaps δ_j (…, n + 1), negative for gaps; the value at an end without a wall has no meaning."""
    result = rates(u)
    result += chain.overlap
    return result


def rates(u: Array) -> Array:
    """Return u_{j−1} − u_j (…, n + 1): for velocities the rates δ_j', for displacements the changes δ_j − d_j."""
    result = np.empty((*u.shape[:-1], u.shape[-1] + 1), dtype=u.dtype)
    result[..., 0] = -u[..., 0]
    np.subtract(u[..., :-1], u[..., 1:], out=result[..., 1:-1])
    result[..., -1] = u[..., -1]
    return result


def forces(chain: Chain, u: Array) -> Array:
    """Return the forces of the springs A_j δ_j^{3/2} (…, n + 1)."""
    pressed = overlaps(chain, u)
    np.maximum(pressed, 0.0, out=pressed)
    root = np.sqrt(pressed)
    pressed *= root
    pressed *= chain.stiffness
    return pressed


def dashpot_forces(chain: Chain, u: Array, v: Array) -> Array:
    """Return the forces of the dashpots η_j δ_j^{1/4} δ_j' (…, n + 1); negative forces attract."""
    result: Array = chain.dashpot * np.sqrt(np.sqrt(np.maximum(overlaps(chain, u), 0.0))) * rates(v)
    return result


def acceleration(chain: Chain, u: Array, v: Array | None = None) -> Array:
    """Return the accelerations (…, n).

    Raises ValueError for a chain with dashpots without velocities.
    """
    force = forces(chain, u)
    if chain.damped:
        if v is None:
            raise ValueError(f"restitution = {chain.restitution}: the acceleration needs the velocities")
        force += dashpot_forces(chain, u, v)
    result = force[..., :-1] - force[..., 1:]
    result += chain.load
    result /= chain.mass
    return result


def energies(chain: Chain, u: Floats, v: Floats) -> Floats:
    """Return the energy of each sphere (…, n) above rest: m v²/2 plus half of the energy V_j of each of its contacts.

        V_j = (2/5) A (δ₊^{5/2} − d₊^{5/2}) − A d₊^{3/2} (δ − d)
            = A (y − z)² (2y³ + 4y²z + 6yz² + 3z³)/5 + A z³ (−δ)₊,   y = √δ₊, z = √d₊

    The term in δ − d is the work of the loads, so the sum over all spheres is the energy of the chain, which is
    conserved without dashpots. The second line keeps all digits of small motions. A contact with a wall or a held
    sphere counts in full for the sphere that moves.
    """
    now, rest = overlaps(chain, u), np.maximum(chain.overlap, 0.0)
    pressed = np.maximum(now, 0.0)
    y, z = np.sqrt(pressed), np.sqrt(rest)
    both = (pressed > 0) & (rest > 0)
    stretch = rates(u)  # δ − d
    change = np.divide(stretch, y + z, out=y - z, where=both)
    stored = change**2 * (2 * y**3 + 4 * y**2 * z + 6 * y * z**2 + 3 * z**3) / 5 + z**3 * (pressed - now)
    stored *= chain.stiffness
    moves = np.isfinite(chain.mass).astype(float)
    left, right = np.append(moves, 0.0), np.append(0.0, moves)  # the sphere to the right of a contact, to its left
    shares = left + right
    stored /= np.where(shares > 0, shares, 1.0)
    kinetic = 0.5 * np.where(np.isfinite(chain.mass), chain.mass, 0.0) * v**2
    result: Floats = kinetic + moves * (stored[..., :-1] + stored[..., 1:])
    return result


def bands(masses: tuple[float, float], stiffness: float) -> tuple[float, float, float]:
    """Return the band edges of an infinite diatomic chain: top of the acoustic, bottom and top of the optical branch.

        ω₁ = √(2K/M),  ω₂ = √(2K/m),  ω₃ = √(2K(1/m + 1/M)),  M ≥ m

    Parameters
    ----------
    masses : masses of the two spheres of a cell, in either order.
    stiffness : K = (3/2) A^{2/3} F0^{1/3} of every contact; `linear_stiffness` gives it.

    Between ω₁ and ω₂ no wave propagates. Source: L. Brillouin, Wave Propagation in Periodic Structures.
    """
    light, heavy = sorted(masses)
    if not (light > 0 and stiffness > 0):
        raise ValueError(f"masses and stiffness must be positive, not {masses} and {stiffness}")
    squares = 2 * stiffness / heavy, 2 * stiffness / light, 2 * stiffness * (1 / light + 1 / heavy)
    first, second, third = (float(np.sqrt(square)) for square in squares)
    return first, second, third


def linear_stiffness(chain: Chain) -> Floats:
    """Return the stiffness K_j = (3/2) A_j √d_j (n + 1,) of each contact at rest; 0 if the spheres only touch."""
    result: Floats = 1.5 * chain.stiffness * np.sqrt(np.maximum(chain.overlap, 0.0))
    return result


def normal_modes(chain: Chain) -> tuple[Floats, Floats]:
    """Return the frequencies (k,) and shapes (k, n) of small vibrations about rest, for k spheres that are not held.

    The shapes are normalised to Σ m u² = 1. Contacts that only touch have no stiffness, and give frequencies of 0.

    Raises ValueError for a chain with dashpots.
    """
    if chain.damped:
        raise ValueError(f"restitution = {chain.restitution}: must be 1, damped vibrations have no normal modes here")
    stiffness, free = linear_stiffness(chain), np.isfinite(chain.mass)
    matrix = np.diag(stiffness[:-1] + stiffness[1:]) - np.diag(stiffness[1:-1], 1) - np.diag(stiffness[1:-1], -1)
    root = np.sqrt(chain.mass[free])
    squares, vectors = np.linalg.eigh(matrix[np.ix_(free, free)] / np.outer(root, root))
    shapes = np.zeros((len(squares), len(chain)))
    shapes[:, free] = (vectors / root[:, None]).T
    return np.sqrt(np.maximum(squares, 0.0)), shapes
