"""Adhesive contact in units of its state at rest: forces in k1 Δ0, lengths in Δ0, and the contact radius at rest.

F0 is the outer compressive force and F the pull-off force of the contact; s = F0/(F0 + F) is the share of compression.
At the stretch x the overlap is d = 1 − x and the contact radius is r. In these units the constants A and 2πwRc of the
laws in `granular_analysis.theory.network_laws` are

    DMT    A = 2/3,                       2πwRc = (2/3)(1 − s)
    JKR    A = (2/9)(6−b) √D/(2−b),       2πwRc = (2/27) b² (6−b)/((2−b)D)

    b = 2√(1−s)/(1 + √(1−s)),    D = 1 − 2b/3

and the shear force of either law is f_S = κ r × slip. The share b of adhesion in a JKR contact is 1 without
compression and 0 for a Hertz contact. The derivatives of the law at rest give

    κ = κ_M (6−b)/(6−3b),   f_N = f0 − x + n x²,   r = 1 − m x,   m = (3−2b)/(6−b),   n = (m/2)[1 + 6b/((2−b)(6−b))]

with Mindlin's κ_M = 2(1−ν)/(2−ν) and the load f0 = F0/(k1Δ0). At b = 1, κ = (5/3)κ_M, n = 0.22 and m = 0.2. At b = 0,
and for the DMT law at any s, κ = κ_M, n = 1/4 and m = 1/2.

When it breaks: a JKR contact parts at a negative overlap, where the pull reaches F, and LAMMPS releases it there. The
lattice of `granular_analysis.theory.lattice` continues with the pull F at any greater distance, which is unphysical.

Source: Derjaguin, Muller & Toporov, J. Colloid Interface Sci. 53, 314 (1975); Johnson, Kendall & Roberts, Proc. R. Soc.
A 324, 301 (1971).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory import network_laws
from granular_analysis.theory.bonds import AT_REST, Law
from granular_analysis.theory.network_laws import Adhesion as Adhesion

Floats = NDArray[np.float64]
_TOUCHING = np.asarray(True)
_STEPS = 4  # Newton steps from the radius at a real overlap to the radius at a complex overlap


@dataclass(frozen=True)
class AtRest:
    """Contact of one adhesion law at the share s of compression, in [0, 1]; the JKR law requires s < 1."""

    name: Adhesion
    share: float

    @cached_property
    def coefficients(self) -> tuple[float, float]:
        """Return A and 2πwRc."""
        if self.name == "dmt":
            return 2 / 3, 2 / 3 * (1 - self.share)
        root = np.sqrt(1 - self.share)
        b = 2 * root / (1 + root)
        D = 1 - 2 * b / 3
        return 2 / 9 * (6 - b) / (2 - b) * np.sqrt(D), 2 / 27 * b**2 * (6 - b) / ((2 - b) * D)

    @cached_property
    def _law(self) -> network_laws.Dmt | network_laws.Jkr:
        A, F = self.coefficients
        return network_laws.LAWS[self.name](np.asarray(A), np.asarray(F))

    @cached_property
    def _unit(self) -> float:
        """Return the radius at rest in the unit of `network_laws`."""
        return float(self._law.radius(np.ones(1), np.ones(1, dtype=bool))[0])

    @cached_property
    def scales(self) -> tuple[float, float]:
        """Return the JKR scales d of the overlap d(3s⁴ − 2s) and √(3d) of the radius √(3d) s²; (0, 0) for DMT.

        Here s is the root that `network_laws` defines. The scale √(3d) is in units of the radius at rest.
        """
        depth = 0.0 if isinstance(self._law, network_laws.Dmt) else float(self._law.depth)
        return depth, float(np.sqrt(3 * depth)) / self._unit

    @cached_property
    def excess(self) -> float:
        """Return κ/κ_M."""
        return 1.5 * self.coefficients[0] * self._unit

    @cached_property
    def load(self) -> float:
        """Return 1.5 F0/(k1Δ0)."""
        return -1.5 * float(self.pull(np.ones(1), np.ones(1))[0])

    @cached_property
    def least_overlap(self) -> float:
        """Return the overlap in Δ0 at which the contact parts."""
        return float(self._law.end)

    def law(self, shear: float) -> Law:
        """Return the law of a contact at rest whose stiffness against slip is `shear`, in k1."""
        A, F = self.coefficients
        found = AT_REST[self.name](1.0, A, shear / self._unit, F)
        return Law(*(np.reshape(each, ()) for each in found))

    def radius(self, overlap: Floats) -> Floats:
        """Return r at overlaps d ≥ `least_overlap`, of any shape, real or complex."""
        law = self._law
        if isinstance(law, network_laws.Dmt) or not np.iscomplexobj(overlap):
            return np.asarray(law.radius(overlap, _TOUCHING) / self._unit)
        root, place = np.sqrt(law.radius(overlap.real, _TOUCHING) / np.sqrt(3 * law.depth)), overlap / law.depth
        for _ in range(_STEPS):  # Newton's method for 3s⁴ − 2s = δ/d
            cube = root * root * root
            root = (9 * cube * root + place) / (12 * cube - 2)
        return np.asarray(root * root * (np.sqrt(3 * law.depth) / self._unit))

    def pull(self, overlap: Floats, radius: Floats) -> Floats:
        """Return −f_N at overlaps with their contact radii."""
        return -self._law.repulsion(overlap, self._unit * radius, _TOUCHING)

    def growth(self, overlap: Floats, radius: Floats) -> Floats:
        """Return dr/dd at overlaps with their contact radii; 0 for an open contact."""
        spreading = self._law.spreading(overlap, self._unit * radius)
        return np.divide(radius, spreading, out=np.zeros_like(radius), where=spreading > 0)

    def energy(self, overlap: Floats, radius: Floats) -> Floats:
        """Return ∫f_N dd from rest."""
        at_rest = self._law.energy(np.ones(1), np.full(1, self._unit))
        return np.asarray(self._law.energy(overlap, self._unit * radius) - at_rest)
