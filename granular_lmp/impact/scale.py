"""The units of an impact, which has no overlap at rest to be measured by.

With the mass m of a sphere, the coefficient A of the Hertz force A δ^{3/2} between two of them, and the velocity v of
the fastest striker

    ℓ = (m v²/A)^{2/5},   t0 = ℓ/v = (m²/(A² v))^{1/5},

so that A = m = v = 1. The motion of spheres along a line is then the same at every velocity; that of a sheet too, but
for turns of its contacts of the order of ℓ/R. Two equal spheres that meet with v overlap by 0.829 ℓ at most, and touch
for 2.439 t0.
"""

from dataclasses import dataclass
from math import gamma, pi, sqrt

from granular_lmp.crystal.sphere import Sphere

# Hertz: (4√π/5) Γ(2/5)/Γ(9/10) (5/4)^{2/5} = 3.2181 (Landau & Lifshitz, Theory of Elasticity, section 9)
_COLLISION = 0.8 * sqrt(pi) * gamma(0.4) / gamma(0.9) * 1.25**0.4
DEEPEST = 0.625**0.4  # largest overlap of two equal spheres, in ℓ: (5μ/4m)^{2/5} with μ = m/2


@dataclass(frozen=True)
class Scale:
    """Mass m (kg), overlap ℓ (m) and time t0 (s) of an impact."""

    mass: float
    length: float
    time: float

    @classmethod
    def of(cls, sphere: Sphere, velocity: float) -> "Scale":
        """Return the units of spheres that are struck at a velocity, m/s."""
        length = (sphere.mass * velocity**2 / sphere.normal_coefficient) ** 0.4
        return cls(sphere.mass, length, length / velocity)

    @property
    def velocity(self) -> float:
        """Velocity v = ℓ/t0 of the fastest striker, m/s."""
        return self.length / self.time

    @property
    def energy(self) -> float:
        """Energy m v², J."""
        return self.mass * self.velocity**2


def collision_time(mass: float, stiffness: float = 1.0, velocity: float = 1.0) -> float:
    """Return how long two spheres touch that meet with a velocity, T = 3.218 (μ²/(A² v))^{1/5}.

    Parameters
    ----------
    mass, stiffness, velocity : float
        Reduced mass μ = m₁m₂/(m₁ + m₂), A and v, in the units of a `Scale` or in any consistent ones.
    """
    return float(_COLLISION * (mass**2 / (stiffness**2 * velocity)) ** 0.2)
