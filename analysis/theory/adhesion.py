"""Forces of a contact that adheres, in units of its own at rest: k1 Δ0, Δ0 and the contact radius.

With the overlap d = 1 − x at the stretch x, the contact radius r and the share s = F0/(F0 + F) of the outer force F0 in
what holds the spheres together, F the pull that parts them,

    DMT    r = √d,                         f_N = (2/3)(d^{3/2} − 1 + s)
    JKR    r² − (2/3)b √r = (1 − 2b/3) d,  f_N = (2/3)(r³ − b r^{3/2})/(KD)        f_S = κ r (slip) of both

    b = 2√(1−s)/(1 + √(1−s)),    K = (6−3b)/(6−b),    D = 1 − 2b/3

The share b of adhesion in a JKR contact is 1 where nothing presses it and 0 in Hertz's contact. From the derivatives of
its law at rest,

    κ = κ_M/K,    f_N = f0 − x + n x²,    r = 1 − m x,    m = (3−2b)/(6−b),    n = (m/2)[1 + 6b/((2−b)(6−b))],

κ_M = 2(1−ν)/(2−ν) being Mindlin's, and f0 = (2/3)(1−b)/(KD) its load F0/(k1Δ0). At b = 1: κ = (5/3)κ_M, n = 0.22,
m = 0.2; at b = 0, as by the DMT law with any s: κ_M, 1/4, 1/2.

A JKR contact parts where F pulls, r³ = b²/4, at an overlap below 0. It breaks there: LAMMPS lets go of it, and what is
held further here (a pull of F at any distance) is no contact.

Source: Derjaguin, Muller & Toporov, J. Colloid Interface Sci. 53, 314 (1975); Johnson, Kendall & Roberts, Proc. R. Soc.
A 324, 301 (1971).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from analysis.theory.bonds import Law, by_radius, dmt

Floats = NDArray[np.float64]
Adhesion = Literal["dmt", "jkr"]


@dataclass(frozen=True)
class Dmt:
    """Contact by the DMT law; Hertz's at share = 1."""

    share: float
    least_overlap = 0.0  # Δ0, at which it parts
    excess = 1.0  # κ over Mindlin's

    @property
    def load(self) -> float:
        """Return 1.5 F0/(k1Δ0)."""
        return self.share

    def law(self, shear: float) -> Law:
        """Return the law of a contact at rest with the stiffness κ against slip."""
        return dmt(1.0, 2 / 3, shear, 2 / 3 * (1 - self.share))

    def radius(self, overlap: Floats) -> Floats:
        """Return r of overlaps d ≥ 0, of any shape, real or complex."""
        return np.sqrt(overlap)

    def pull(self, overlap: Floats, radius: Floats) -> Floats:
        """Return −f_N of overlaps and their radii."""
        return (1 - self.share - overlap * radius) / 1.5

    def growth(self, radius: Floats) -> Floats:
        """Return dr/dd of radii; 0 of a contact that has opened."""
        return np.divide(0.5, radius, out=np.zeros_like(radius), where=radius > 0)

    def energy(self, overlap: Floats, radius: Floats) -> Floats:
        """Return ∫f_N dd from rest."""
        return ((1 - self.share) * (1 - overlap) + 0.4 * (overlap**2 * radius - 1)) / 1.5


@dataclass(frozen=True)
class Jkr:
    """Contact by the JKR law; share < 1, as something adheres."""

    share: float

    @cached_property
    def adhesive(self) -> float:
        """Share b of adhesion in the contact at rest."""
        root = np.sqrt(1 - self.share)
        return float(2 * root / (1 + root))

    @property
    def excess(self) -> float:
        """Return κ over Mindlin's, 1/K of the module."""
        return (6 - self.adhesive) / (6 - 3 * self.adhesive)

    @cached_property
    def _scale(self) -> float:
        """Factor KD of the module."""
        return (1 - 2 * self.adhesive / 3) / self.excess

    @property
    def load(self) -> float:
        """Return 1.5 F0/(k1Δ0)."""
        return (1 - self.adhesive) / self._scale

    @cached_property
    def least_overlap(self) -> float:
        """Return the overlap at which it parts, −(b/2)^{4/3}/(3D)."""
        return -((self.adhesive / 2) ** (4 / 3)) / (3 - 2 * self.adhesive)

    def law(self, shear: float) -> Law:
        """Return the law of a contact at rest with the stiffness κ against slip."""
        b, size = self.adhesive, 1.5 * self._scale
        push = [(1 - b) / size, (3 - 1.5 * b) / size, (6 - 0.75 * b) / size, (6 + 0.375 * b) / size]
        depth = [each / (1 - 2 * b / 3) for each in (2 - b / 3, 2 + b / 6, -b / 4)]
        pulled = b * b / 4 / size
        values = (shear, shear, 1 - self.least_overlap, push[0] + 2 * pulled)
        return by_radius(np.array(push), np.array(depth), *map(np.asarray, values))

    def radius(self, overlap: Floats) -> Floats:
        """Return r of overlaps d ≥ `least_overlap`, of any shape, real or complex.

        The root of q⁴ = D d + (2/3)b q, r = q², by this rule and then by Newton's. They start above the real root, from
        where both lead down without passing.
        """
        c = 2 / 3 * self.adhesive
        target = (1 - c) * overlap
        q = np.maximum(target.real, 0.0) ** 0.25 + c ** (1 / 3)
        for _ in range(_TURNS):
            q = np.sqrt(np.sqrt(target.real + c * q))
        for _ in range(_STEPS):
            cube = q * q * q
            q = (3 * cube * q + target) / (4 * cube - c)
        return q * q

    def pull(self, overlap: Floats, radius: Floats) -> Floats:
        """Return −f_N of overlaps and their radii."""
        root = radius * np.sqrt(radius)
        return root * (self.adhesive - root) / (1.5 * self._scale)

    def growth(self, radius: Floats) -> Floats:
        """Return dr/dd of radii."""
        return (1 - 2 * self.adhesive / 3) / (2 * radius - self.adhesive / (3 * np.sqrt(radius)))

    def energy(self, overlap: Floats, radius: Floats) -> Floats:
        """Return ∫f_N dd from rest, (2/3)[G(r) − G(1)]/(KD²) with G = (2/5)r⁵ − (2/3)b r^{7/2} + b²r²/6."""
        b = self.adhesive
        at_rest = 0.4 - 2 / 3 * b + b * b / 6
        now = 0.4 * radius**5 - 2 / 3 * b * radius**3.5 + b * b * radius**2 / 6
        return (now - at_rest) / (1.5 * self._scale * (1 - 2 * b / 3))


_TURNS, _STEPS = 2, 4  # to rounding, from each such start
LAWS: dict[Adhesion, type[Dmt] | type[Jkr]] = {"dmt": Dmt, "jkr": Jkr}
