"""Normal force and radius of a contact in the network by the DMT and JKR laws, from A and F.

With the coefficients A = (4/3) E* √Rc and F = 2π w Rc of `granular_analysis.theory.network`, and the contact radius a,

    DMT    P = A δ^{3/2} − F,                    r = a/√Rc = √δ
    JKR    P = 3F (y² − y),  δ = d (3s⁴ − 2s),   r = √(3d) s²,     y = s³,  d = (3F/A)^{2/3}/3

s is the largest root of a quartic equation, found from a root u of its cubic resolvent (Cardano's formula): with
x = δ/d

    s⁴ − (2/3) s − x/3 = 0,   s = ½ [√u + √(4/(3√u) − u)],   u³ + (4x/3) u = 4/9

A contact of either law closes at δ = 0. A DMT contact opens there too. A JKR contact opens where the pull is largest,
(3/4) F at y = ½ and δ = −2^{−4/3} d, as in LAMMPS. The energy of a contact is ∫P dδ from the overlap at which it opens,
so that opening loses no energy; when a JKR contact closes, the energy falls at once by the heat of the snap-in.
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
    """DMT law, which is Hertz's for F = 0, of contacts with the coefficients A = `hertz` and F = `adhesion`, (M,)."""

    pull = 1.0  # largest pull, in units of F
    end = 0.0  # overlap at which a closed contact opens
    lasts = False  # whether a closed contact stays closed at some negative overlaps

    def __init__(self, hertz: Floats, adhesion: Floats) -> None:
        self.A, self.F = hertz, adhesion

    def closed(self, overlap: Floats, begun: Bools | bool) -> Bools:
        """Return whether spheres with this overlap touch; `begun` says whether they touched before."""
        return overlap > 0

    def radius(self, overlap: Floats, closed: Bools) -> Floats:
        """Return r, 0 where open."""
        return root_of(overlap)

    def repulsion(self, overlap: Floats, radius: Floats, closed: Bools) -> Floats:
        """Return P, 0 where open."""
        return self.A * overlap * radius - self.F * closed

    def overlap(self, repulsion: Floats) -> Floats:
        """Return the overlap δ = ((P + F)/A)^{2/3} of a contact with this repulsion P."""
        return ((repulsion + self.F) / self.A) ** (2 / 3)

    def energy(self, overlap: Floats, radius: Floats) -> Floats:
        """Return ∫P dδ, 0 where open."""
        return 0.4 * self.A * overlap**2 * root_of(overlap) - self.F * overlap

    def spreading(self, overlap: Floats, radius: Floats) -> Floats:
        """Return dδ/d(ln r) = 2δ, 0 where open."""
        return 2 * overlap


class Jkr:
    """JKR law of contacts that adhere, F > 0; attributes as for `Dmt`, and depth = d."""

    pull = 0.75
    lasts = True

    def __init__(self, hertz: Floats, adhesion: Floats) -> None:
        self.A, self.F = hertz, adhesion
        self.depth = (3 * adhesion / hertz) ** (2 / 3) / 3
        self.end = -(2 ** (-4 / 3)) * self.depth

    def closed(self, overlap: Floats, begun: Bools | bool) -> Bools:
        """Return whether spheres with this overlap touch; `begun` says whether they touched before."""
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
        s = s - (3 * cube * s - 2 * s - x) / (12 * cube - 2)  # restores the digits that cancel in u at large x
        return closed * xp.sqrt(3 * self.depth) * s**2

    def repulsion(self, overlap: Floats, radius: Floats, closed: Bools) -> Floats:
        """Return P, 0 where open."""
        s = self._s(radius)
        y = s * s * s
        return 3 * self.F * (y * y - y)

    def overlap(self, repulsion: Floats) -> Floats:
        """Return the overlap δ = d (3s⁴ − 2s), s³ = y, of a contact with this repulsion P, on the branch y ≥ ½."""
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
