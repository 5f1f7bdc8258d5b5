"""The normal force and the radius of a contact in the network: the laws of DMT and of JKR, each from A, B and F.

With the coefficients A = (4/3) E* √Rc and F = 2π w Rc of `granular_analysis.theory.network`, and the contact radius a,

    DMT    P = A δ^{3/2} − F,                    r = a/√Rc = √δ
    JKR    P = 3F (y² − y),  δ = d (3s⁴ − 2s),   r = √(3d) s²,     y = s³,  d = (3F/A)^{2/3}/3

s is the largest root of a quartic whose resolvent is Cardano's: with x = δ/d

    s⁴ − (2/3) s − x/3 = 0,   s = ½ [√u + √(4/(3√u) − u)],   u³ + (4x/3) u = 4/9

A contact of either law begins where the spheres overlap. By the DMT law it ends there. By the JKR law it ends where the
pull is largest, (3/4) F at y = ½ and δ = −2^{−4/3} d, as in LAMMPS. Its energy is ∫P dδ from where it ends, so that
it loses none when it opens; where a JKR contact begins, the energy falls at once by what the snap-in dissipates.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory.network_tangents import module_of, root_of

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Adhesion = Literal["dmt", "jkr"]
ADHESIONS: tuple[Adhesion, ...] = ("dmt", "jkr")


class Dmt:
    """DMT, and Hertz where F = 0; closed contacts only."""

    pull = 1.0  # the largest, in F
    end = 0.0
    lasts = False  # beyond where it begins

    def __init__(self, hertz: Floats, adhesion: Floats) -> None:
        self.A, self.F = hertz, adhesion

    def closed(self, overlap: Floats, begun: Bools | bool) -> Bools:
        """Return whether spheres touch that overlap so, and had begun to touch or not."""
        return overlap > 0

    def radius(self, overlap: Floats, closed: Bools) -> Floats:
        """Return r, 0 where open."""
        return root_of(overlap)

    def repulsion(self, overlap: Floats, radius: Floats, closed: Bools) -> Floats:
        """Return P, 0 where open."""
        return self.A * overlap * radius - self.F * closed

    def overlap(self, repulsion: Floats) -> Floats:
        """Return the overlap δ = ((P + F)/A)^{2/3} of a contact that repels so."""
        return ((repulsion + self.F) / self.A) ** (2 / 3)

    def energy(self, overlap: Floats, radius: Floats) -> Floats:
        """Return ∫P dδ, 0 where open."""
        return 0.4 * self.A * overlap**2 * root_of(overlap) - self.F * overlap

    def spreading(self, overlap: Floats, radius: Floats) -> Floats:
        """Return dδ/d(ln r) = 2δ, 0 where open."""
        return 2 * overlap


class Jkr:
    """JKR of contacts that adhere, F > 0."""

    pull = 0.75
    lasts = True

    def __init__(self, hertz: Floats, adhesion: Floats) -> None:
        self.A, self.F = hertz, adhesion
        self.depth = (3 * adhesion / hertz) ** (2 / 3) / 3
        self.end = -(2 ** (-4 / 3)) * self.depth

    def closed(self, overlap: Floats, begun: Bools | bool) -> Bools:
        """Return whether spheres touch that overlap so, and had begun to touch or not."""
        return (overlap > 0) | (begun & (overlap > self.end))

    def radius(self, overlap: Floats, closed: Bools) -> Floats:
        """Return r, 0 where open."""
        xp = module_of(overlap)
        x = xp.where(closed, overlap, 0.0) / self.depth
        fourth = 4 * x / 9
        first = xp.cbrt(2 / 9 + xp.sqrt(4 / 81 + fourth * fourth * fourth))
        u = first - fourth / first
        root = xp.sqrt(u)
        s = (root + xp.sqrt(4 / (3 * root) - u)) / 2
        cube = s * s * s
        s = s - (3 * cube * s - 2 * s - x) / (12 * cube - 2)  # digits that cancel in u where x is large
        return closed * xp.sqrt(3 * self.depth) * s**2

    def repulsion(self, overlap: Floats, radius: Floats, closed: Bools) -> Floats:
        """Return P, 0 where open."""
        s = self._s(radius)
        y = s * s * s
        return 3 * self.F * (y * y - y)

    def overlap(self, repulsion: Floats) -> Floats:
        """Return the overlap δ = d (3s⁴ − 2s), s³ = y, of a contact that repels so, if it would hold being pulled."""
        xp = module_of(repulsion)
        s = xp.cbrt((1 + xp.sqrt(1 + 4 * repulsion / (3 * self.F))) / 2)
        return self.depth * (3 * s**4 - 2 * s)

    def energy(self, overlap: Floats, radius: Floats) -> Floats:
        """Return ∫P dδ = 3F d [(6/5)s¹⁰ − 2s⁷ + ½s⁴ + (1/5) 2^{−4/3}], 0 where open."""
        s = self._s(radius)
        return 3 * self.F * self.depth * (1.2 * s**10 - 2 * s**7 + 0.5 * s**4 + 0.2 * 2 ** (-4 / 3)) * (s > 0)

    def spreading(self, overlap: Floats, radius: Floats) -> Floats:
        """Return dδ/d(ln r) = d (6s⁴ − s), 0 where open."""
        s = self._s(radius)
        return self.depth * (6 * s**4 - s)

    def _s(self, radius: Floats) -> Floats:
        return root_of(radius / module_of(self.depth).sqrt(3 * self.depth))


LAWS: dict[Adhesion, type[Dmt] | type[Jkr]] = {"dmt": Dmt, "jkr": Jkr}
