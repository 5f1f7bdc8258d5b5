"""Units of length and time of a scene, from its spheres at rest or from an impact.

Spheres held together by adhesion or compression have an overlap at rest, Δ0, and the time t0 of their linear waves
(`granular_lmp.crystal.sphere`). Spheres that just touch have neither. For an impact, on touching spheres or on a
compressed chain, the velocity v of the fastest striker, the mass m of a sphere and the coefficient A of the Hertz force
A δ^{3/2} give the scale:

    ℓ = (m v²/A)^{2/5},   t0 = ℓ/v = (m²/(A² v))^{1/5},

so that A = m = v = 1. In these units the motion of spheres along a line is the same at every velocity, and so is the
motion of a sheet, up to rotations of its contacts of order ℓ/R. Two equal spheres that meet with the velocity v overlap
by at most 0.829 ℓ and touch for 2.439 t0.
"""

from math import gamma, pi, sqrt
from typing import Self

from granular_lmp.crystal.sphere import Sphere
from granular_lmp.frozen import dataclass

__all__ = ["Scale"]

# Hertz: (4√π/5) Γ(2/5)/Γ(9/10) (5/4)^{2/5} = 3.2181 (Landau & Lifshitz, Theory of Elasticity, section 9)
_COLLISION = 0.8 * sqrt(pi) * gamma(0.4) / gamma(0.9) * 1.25**0.4
# Largest overlap, as a share of the diameter, for LAMMPS's DEM contact laws: they assume rigid spheres
LARGEST_OVERLAP_RATIO = 0.05
DEEPEST = 0.625**0.4  # largest overlap of two equal spheres, in ℓ: (5μ/4m)^{2/5} with μ = m/2


@dataclass(frozen=True)
class Scale:
    """Mass m (kg), overlap Δ0 or ℓ (m) and time t0 (s).

    Examples
    --------
    >>> scale = Scene.load("tr_periodic").scale
    >>> print(f"{10 * scale.time:.2e} s are 10 t0")
    4.98e-09 s are 10 t0
    """

    mass: float
    length: float
    time: float
    of_impact: bool = False  # True: the unit of velocities is the velocity of the initially fastest sphere

    @classmethod
    def of(cls, sphere: Sphere, velocity: float = 0.0) -> Self:
        """Return the scale of spheres at rest, or of spheres that just touch and are struck at a velocity, m/s.

        Raises
        ------
        ValueError
            If there is neither an overlap at rest nor a velocity.
        """
        if sphere.static_overlap > 0:
            return cls(sphere.mass, sphere.static_overlap, sphere.time_scale)
        if not velocity > 0:
            raise ValueError(f"velocity = {velocity!r}: must be above 0 where spheres have no overlap at rest")
        length = (sphere.mass * velocity**2 / sphere.normal_coefficient) ** 0.4
        return cls(sphere.mass, length, length / velocity, of_impact=True)

    @property
    def name(self) -> str:
        """Name of the unit of lengths."""
        return "l" if self.of_impact else "Delta0"

    @property
    def symbol(self) -> str:
        """Symbol of the unit of lengths, for a figure."""
        return r"\ell" if self.of_impact else r"\Delta_0"

    def force(self, length: float, stiffness: float) -> float:
        """Return the unit of force, N, for a unit of length: m ℓ/t0² for an impact, else stiffness (N/m) × length."""
        return self.mass * length / self.time**2 if self.of_impact else stiffness * length

    @property
    def velocity(self) -> float:
        """Velocity of one unit of length per t0, m/s; in an impact the fastest initial velocity."""
        return self.length / self.time


def collision_time(mass: float, stiffness: float = 1.0) -> float:
    """Return the contact time T = 3.218 (μ²/A²)^{1/5} of two spheres that meet with the velocity 1 of an impact.

    Parameters
    ----------
    mass, stiffness : float
        Reduced mass μ = m₁m₂/(m₁ + m₂) and A, in the units of an impact.
    """
    return float(_COLLISION * (mass**2 / stiffness**2) ** 0.2)
