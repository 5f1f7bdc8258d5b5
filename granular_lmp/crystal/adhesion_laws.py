"""Laws of the contact of two adhesive spheres: DMT, whose attraction ends with contact, and JKR, whose acts beyond it.

With E* and G* the effective moduli, Rc the effective radius, w the work of adhesion, δ the overlap and a the radius of
the contact, both push with the force f_N and resist a slip ξ with f_S = 8 G* a ξ (Mindlin 1949),

    DMT    f_N = A δ^{3/2} − F,  a² = Rc δ,  F = 2π w Rc       (Derjaguin, Muller & Toporov, J. Colloid Interface Sci.
                                                               53, 314 (1975); A = (4/3) E* √Rc)
    JKR    f_N = 4E*a³/(3Rc) − √(8π w E* a³),  δ = a²/Rc − √(2π w a/E*),  F = (3/2)π w Rc
                                                               (Johnson, Kendall & Roberts, Proc. R. Soc. A 324, 301
                                                               (1971))

F is the pull that parts two spheres. A JKR contact that nothing presses has the radius a0, a0³ = 9π w Rc²/(2E*). In
y = (a/a0)^{3/2} the law is that of Hertz, times numbers:

    f_N = (4E*a³/3Rc)(1 − 1/y),   δ = (a²/Rc)(1 − 2/3y),   ∂f_N/∂δ = 2E*a (6y−3)/(6y−1),   y = (1 + √(1 + f_N/F))/2

Pulled by F it has y = 1/2 and the overlap δ = −½ 2^{-1/3} δ0 with δ0 = a0²/(3Rc): it parts beyond, as LAMMPS's ``jkr``
does. (Held by a stiff device it would hang on to y = 1/6, which neither LAMMPS nor this module has.) Spheres that come
together touch at δ = 0 only, where the contact snaps in.

https://docs.lammps.org/pair_granular.html
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

Numbers = Any  # a number, or an array with one for each contact


@dataclass(frozen=True, eq=False)
class _Contact:
    """Contact of two spheres, or of C pairs of spheres with (C,) arrays.

    Attributes
    ----------
    modulus, shear_modulus : E* and G*, Pa.
    radius : Rc, m.
    adhesion : w, J/m².
    """

    modulus: Numbers
    shear_modulus: Numbers
    radius: Numbers
    adhesion: Numbers

    @property
    def normal_coefficient(self) -> Numbers:
        """Coefficient A = (4/3) E* √Rc of Hertz's law, N/m^{3/2}."""
        return 4 / 3 * self.modulus * np.sqrt(self.radius)

    @property
    def shear_coefficient(self) -> Numbers:
        """Coefficient B = 8 G* √Rc of Mindlin's law for Hertz's contact radius, N/m^{3/2}."""
        return 8 * self.shear_modulus * np.sqrt(self.radius)


class Dmt(_Contact):
    """DMT law, and Hertz's where w = 0; forces in N, overlaps δ in m, stiffnesses in N/m.

    An overlap must not be negative.
    """

    pull_off_overlap = 0.0  # m: the contact parts where it ends

    @property
    def pull_off_force(self) -> Numbers:
        """Pull F = 2π w Rc that parts the spheres."""
        return 2 * np.pi * self.adhesion * self.radius

    def overlap_under(self, force: Numbers) -> Numbers:
        """Return the overlap ((F + f_N)/A)^{2/3} of a contact that is pressed with the force f_N ≥ −F."""
        return ((self.pull_off_force + force) / self.normal_coefficient) ** (2 / 3)

    def force(self, overlap: Numbers) -> Numbers:
        """Return f_N = A δ^{3/2} − F."""
        return self.normal_coefficient * overlap**1.5 - self.pull_off_force

    def sliding_force(self, overlap: Numbers) -> Numbers:
        """Return the shear force f_N + 2F over the friction coefficient at which the contact slides, as in LAMMPS."""
        return self.pull_off_force + self.normal_coefficient * overlap**1.5

    def normal_stiffness(self, overlap: Numbers) -> Numbers:
        """Return ∂f_N/∂δ = (3/2) A √δ."""
        return 1.5 * self.normal_coefficient * np.sqrt(overlap)

    def shear_stiffness(self, overlap: Numbers) -> Numbers:
        """Return ∂f_S/∂ξ = B √δ."""
        return self.shear_coefficient * np.sqrt(overlap)

    def excess(self, overlap: Numbers) -> Numbers:
        """Return ∂f_S/∂ξ : ∂f_N/∂δ over 4G*/E*, Mindlin's ratio: 1."""
        return 1.0

    def softening(self, overlap: Numbers) -> tuple[Numbers, Numbers]:
        """Return n, m of f_N = f − k(x − n x²/δ) and f_S = g(1 − m x/δ)ξ, to second order in a stretch x: ¼ and ½."""
        return 0.25, 0.5


class Jkr(_Contact):
    """JKR law of a contact that adheres, w > 0; forces in N, overlaps δ in m, stiffnesses in N/m.

    An overlap must not be below `pull_off_overlap`, where the contact parts.
    """

    @property
    def _at_rest(self) -> Numbers:
        """Radius a0 of a contact that nothing presses, m."""
        return (9 * np.pi * self.adhesion * self.radius**2 / (2 * self.modulus)) ** (1 / 3)

    @property
    def pull_off_force(self) -> Numbers:
        """Pull F = (3/2)π w Rc that parts the spheres."""
        return 1.5 * np.pi * self.adhesion * self.radius

    @property
    def pull_off_overlap(self) -> Numbers:
        """Overlap −½ 2^{-1/3} δ0 < 0 at which that pull parts them."""
        return self._overlap(0.5)

    def overlap_under(self, force: Numbers) -> Numbers:
        """Return the overlap of a contact that is pressed with the force f_N ≥ −F."""
        return self._overlap((1 + np.sqrt(1 + force / self.pull_off_force)) / 2)

    def force(self, overlap: Numbers) -> Numbers:
        """Return f_N = (4E*a³/3Rc)(1 − 1/y) = 4F (y² − y)."""
        y = self._y(overlap)
        return 4 * self.pull_off_force * (y * y - y)

    def sliding_force(self, overlap: Numbers) -> Numbers:
        """Return the shear force f_N + 2F over the friction coefficient at which the contact slides, as in LAMMPS."""
        return self.force(overlap) + 2 * self.pull_off_force

    def normal_stiffness(self, overlap: Numbers) -> Numbers:
        """Return ∂f_N/∂δ = 2E*a (6y−3)/(6y−1)."""
        y = self._y(overlap)
        return 2 * self.modulus * self._radius(y) * (6 * y - 3) / (6 * y - 1)

    def shear_stiffness(self, overlap: Numbers) -> Numbers:
        """Return ∂f_S/∂ξ = 8 G* a."""
        return 8 * self.shear_modulus * self._radius(self._y(overlap))

    def excess(self, overlap: Numbers) -> Numbers:
        """Return ∂f_S/∂ξ : ∂f_N/∂δ over 4G*/E*, Mindlin's ratio: (6y−1)/(6y−3), 5/3 if nothing presses the contact."""
        y = self._y(overlap)
        return (6 * y - 1) / (6 * y - 3)

    def softening(self, overlap: Numbers) -> tuple[Numbers, Numbers]:
        """Return n, m of f_N = f − k(x − n x²/δ) and f_S = g(1 − m x/δ)ξ, to second order in a stretch x.

        m = (3y−2)/(6y−1),   n = (m/2)[1 + 6y/((2y−1)(6y−1))];   1/5 and 11/50 if nothing presses the contact
        """
        y = self._y(overlap)
        shear = (3 * y - 2) / (6 * y - 1)
        return shear / 2 * (1 + 6 * y / ((2 * y - 1) * (6 * y - 1))), shear

    def _radius(self, y: Numbers) -> Numbers:
        return self._at_rest * y ** (2 / 3)

    def _overlap(self, y: Numbers) -> Numbers:
        return self._radius(y) ** 2 / self.radius * (1 - 2 / (3 * y))

    def _y(self, overlap: Numbers) -> Numbers:
        """Return y of an overlap, from 3s⁴ − 2s = δ/δ0 with s = y^{1/3}, by Newton's rule.

        s starts above the root, from where the convex polynomial leads it down without passing; eight steps reach
        rounding for every overlap from `pull_off_overlap` on.
        """
        depth = overlap * 3 * self.radius / self._at_rest**2
        s = (np.maximum(depth, 0.0) / 3) ** 0.25 + (2 / 3) ** (1 / 3)
        for _ in range(_STEPS):
            s = s - (3 * s**4 - 2 * s - depth) / (12 * s**3 - 2)
        return s**3


_STEPS = 8
AdhesionLaw = Dmt | Jkr
ADHESION_LAWS: dict[str, type[Dmt] | type[Jkr]] = {"dmt": Dmt, "jkr": Jkr}
