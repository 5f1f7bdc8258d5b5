"""Law of Johnson, Kendall and Roberts, whose adhesion reaches beyond overlap 0, and the energy lost in a collision.

Two spheres with effective radius R, effective modulus E* and work of adhesion w that touch in a circle of radius a
repel each other with the force f at the overlap δ:

    f = 4E*a³/3R − √(8π w E* a³),   δ = a²/R − √(2π w a/E*)

Without an outer force a0³ = 9π w R²/2E* and δ0 = a0²/3R. In x = a/a0 and y = x^{3/2} the law has no parameter,

    f = 6π w R (y² − y),   δ = δ0 (3x² − 2√x),   U = ∫ f dδ = 6π w R δ0 x² (6y²/5 − 2y + 1/2)

where U is 0 for bodies that do not touch. Approaching bodies touch at δ = 0, where y = 2/3, and attract each other with
(4/3) π w R. They separate where the contact is no longer stable:

| y | force | overlap | the contact ends |
|---|---|---|---|
| 1/2 | −(3/2) π w R, the pull-off force | −2^{−4/3} δ0 | under a given load; in LAMMPS always |
| 1/6 | −(5/6) π w R | −9·6^{−4/3} δ0 | at a given distance, as for two bodies that fly apart |

A collision at any speed loses the difference of U between separation and touch, so that e = √(1 − v_s²/v²):

    W = c (w⁵R⁴/E*²)^{1/3},   c = 7.0922 at a given distance, 3.5026 in LAMMPS

Sources: K. L. Johnson, K. Kendall & A. D. Roberts, Proc. R. Soc. Lond. A 324, 301 (1971). C. Thornton & Z. Ning, Powder
Technology 99, 154 (1998) give W with 7.09.
"""

from dataclasses import dataclass
from math import pi, sqrt
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.errors import TheoryError

Floats = NDArray[np.float64]
Parting = Literal["load", "distance"]
TOUCH = 2 / 3  # y where δ = 0
PARTS: dict[Parting, float] = {"load": 1 / 2, "distance": 1 / 6}  # y where df/dy = 0, and where dδ/dx = 0


@dataclass(frozen=True)
class Contact:
    """A JKR contact; any consistent units.

    Attributes
    ----------
    radius : R, 1/R = 1/R1 + 1/R2; the radius of a sphere on a plane.
    modulus : E*, 1/E* = Σ (1 − ν²)/E; a rigid plane has no term.
    work : work of adhesion w.

    Raises ValueError for values that are not positive.

    When it breaks: the law needs a small contact, a ≪ R, motion that is slow against sound, and attraction of short
    range z0: a Tabor parameter (R w²/E*² z0³)^{1/3} well above 1. Below 0.1 DMT's law holds.
    """

    radius: float
    modulus: float
    work: float

    def __post_init__(self) -> None:
        if not (min(self.radius, self.modulus, self.work) > 0 and np.isfinite(self.radius * self.modulus * self.work)):
            raise TheoryError(
                f"radius = {self.radius}, modulus = {self.modulus} and work = {self.work} must be positive and finite"
            )

    # --- constants ---

    @property
    def rest_radius(self) -> float:
        """Return a0, the radius of the circle of contact without an outer force."""
        return float((4.5 * pi * self.work * self.radius**2 / self.modulus) ** (1 / 3))

    @property
    def rest_overlap(self) -> float:
        """Return δ0."""
        return self.rest_radius**2 / (3 * self.radius)

    @property
    def pull_off_force(self) -> float:
        """Return the pull-off force, the largest attraction, (3/2) π w R."""
        return 1.5 * pi * self.work * self.radius

    # --- the law ---

    def force(self, contact_radius: ArrayLike) -> Floats:
        """Return f at contact radii a ≥ 0; positive if the bodies repel each other."""
        y = self._y(contact_radius)
        return 4 * self.pull_off_force * (y**2 - y)

    def overlap(self, contact_radius: ArrayLike) -> Floats:
        """Return δ at contact radii a ≥ 0."""
        y = self._y(contact_radius)
        return self.rest_overlap * (3 * y ** (4 / 3) - 2 * y ** (1 / 3))

    def energy(self, contact_radius: ArrayLike) -> Floats:
        """Return U at contact radii a ≥ 0, the elastic energy minus w π a²."""
        y = self._y(contact_radius)
        return 4 * self.pull_off_force * self.rest_overlap * y ** (4 / 3) * (1.2 * y**2 - 2 * y + 0.5)

    def contact_radius(self, overlap: ArrayLike) -> Floats:
        """Return the contact radius a at overlaps δ, on the branch that is stable at a given distance.

        Newton's method solves 3s⁴ − 2s = δ/δ0 for s = √(a/a0), starting above the larger root and descending to it.

        Raises ValueError below −9·6^{−4/3} δ0, where there is no contact.
        """
        wanted = np.asarray(overlap, dtype=float)
        ratio = wanted / self.rest_overlap
        least = 3 * PARTS["distance"] ** (4 / 3) - 2 * PARTS["distance"] ** (1 / 3)
        if not np.all(ratio >= least):
            end = least * self.rest_overlap
            raise TheoryError(f"overlap must be at least {end}, where the contact ends, not {wanted}")
        s = np.maximum(np.sqrt(np.sqrt(np.maximum(ratio, 0.0))), 1.0) + 0.5
        for _ in range(60):  # near the end, a double root, each step halves the distance to it
            s = s - (3 * s**4 - 2 * s - ratio) / np.maximum(12 * s**3 - 2, 1e-12)
        return np.asarray(self.rest_radius * s**2)

    # --- touching and parting ---

    def pull_off_distance(self, parting: Parting = "distance") -> float:
        """Return the distance beyond overlap 0 at which the contact ends."""
        return -float(self.overlap(self._radius_at(_known(parting))))

    def loss(self, parting: Parting = "distance") -> float:
        """Return the energy W that a collision loses."""
        end, start = (self.energy(self._radius_at(y)) for y in (_known(parting), TOUCH))
        return float(end - start)

    def sticking_speed(self, mass: float, parting: Parting = "distance") -> float:
        """Return the relative velocity v_s = √(2W/m) below which bodies of reduced mass m stick."""
        if not mass > 0:
            raise TheoryError(f"mass must be positive, not {mass}")
        return sqrt(2 * self.loss(parting) / mass)

    def restitution(self, speed: ArrayLike, mass: float, parting: Parting = "distance") -> Floats:
        """Return e = √(1 − v_s²/v²) at relative velocities v > 0; 0 below v_s."""
        v = np.asarray(speed, dtype=float)
        if not np.all(v > 0):
            raise TheoryError(f"speed must be positive, not {v}")
        return np.sqrt(np.maximum(1 - (self.sticking_speed(mass, parting) / v) ** 2, 0.0))

    def _y(self, contact_radius: ArrayLike) -> Floats:
        a = np.asarray(contact_radius, dtype=float)
        if not np.all(a >= 0):
            raise TheoryError(f"contact_radius must not be negative, not {a}")
        return np.asarray((a / self.rest_radius) ** 1.5)

    def _radius_at(self, y: float) -> float:
        return self.rest_radius * y ** (2 / 3)


def _known(parting: Parting) -> float:
    if parting not in PARTS:
        raise TheoryError(f"parting must be one of {', '.join(get_args(Parting))}, not {parting!r}")
    return PARTS[parting]
