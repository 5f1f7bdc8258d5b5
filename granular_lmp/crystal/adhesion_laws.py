"""Contact laws of adhesive spheres: DMT, whose attraction ends at zero overlap, and JKR, which acts beyond it.

With E* and G* the effective moduli, Rc the effective radius, w the work of adhesion, δ the overlap and a the radius of
the contact, contacts of both laws push with the force f_N and resist a slip ξ with f_S = 8 G* a ξ (Mindlin 1949),

    DMT    f_N = A δ^{3/2} − F,  a² = Rc δ,  F = 2π w Rc       (Derjaguin, Muller & Toporov, J. Colloid Interface Sci.
                                                               53, 314 (1975); A = (4/3) E* √Rc)
    JKR    f_N = 4E*a³/(3Rc) − √(8π w E* a³),  δ = a²/Rc − √(2π w a/E*),  F = (3/2)π w Rc
                                                               (Johnson, Kendall & Roberts, Proc. R. Soc. A 324, 301
                                                               (1971))

F is the pull that parts two spheres. An unloaded JKR contact has the radius a0, a0³ = 9π w Rc²/(2E*). In terms of
y = (a/a0)^{3/2} the JKR law is Hertz's law with numerical factors:

    f_N = (4E*a³/3Rc)(1 − 1/y),   δ = (a²/Rc)(1 − 2/3y),   ∂f_N/∂δ = 2E*a (6y−3)/(6y−1),   y = (1 + √(1 + f_N/F))/2

Under the pull F a JKR contact has y = 1/2 and the overlap δ = −½ 2^{-1/3} δ0 with δ0 = a0²/(3Rc). Beyond this overlap
it parts, as in LAMMPS's ``jkr``. (In a stiff device it would last until y = 1/6, which neither LAMMPS nor this module
includes.) Approaching spheres touch only at δ = 0, where the contact snaps in. Contacts of both laws thus begin at 0,
and each law defines where its contact ends, `pull_off_overlap`.

Each law is one class below and is listed in `ADHESION_LAWS`. The rest of the package asks the class, so a new law
changes only this file. The last methods of a class return expressions for a LAMMPS deck. A JKR contact lasts beyond an
overlap of 0, where LAMMPS's ``contact/atom`` and the cutoff ``radius`` of its local computes miss it. With the cutoff
``type`` local computes list every pair up to the largest pull-off distance; pairs without contact in LAMMPS have forces
and components ``p`` of 0.

The coefficients A = (4/3) E* √Rc, B = 8 G* √Rc and F determine the law: an unloaded JKR contact has
δ0 = (4F/A)^{2/3}/3 and a0 = √(3Rc δ0). `scaled` therefore returns a law in any consistent units.

https://docs.lammps.org/pair_granular.html
"""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any, ClassVar, Self

import numpy as np

from granular_lmp.frozen import cached_property, dataclass

Numbers = Any  # a number, or an array with one for each contact


@dataclass(frozen=True, eq=False)
class AdhesionLaw:
    """Contact law of a pair of spheres, or of C pairs with arrays (C,).

    Forces are in N, overlaps δ in m, stiffnesses in N/m.

    Attributes
    ----------
    normal_coefficient : A = (4/3) E* √Rc of Hertz's law, N/m^{3/2}.
    shear_coefficient : B = 8 G* √Rc of Mindlin's law for Hertz's contact radius, N/m^{3/2}.
    pull_off_force : F that parts the spheres, N.
    pull : F/(π w Rc).
    closing_work : work of adhesion from first touch to the overlap Δ0 of an unloaded contact, over F Δ0.
    beyond : True if adhesion acts beyond an overlap of 0; such a law needs w > 0.
    said : description of the law in the comments of a scene.
    cutoff : cutoff with which LAMMPS's local computes list all contacts.
    late : the kernel's name for the variant of the law whose contacts end at the largest distance instead of the
        largest pull; "" if both are equal. LAMMPS has no such variant.
    later : distance at which contacts of this variant end, over the distance at which contacts of the law end.
    """

    normal_coefficient: Numbers
    shear_coefficient: Numbers
    pull_off_force: Numbers
    pull: ClassVar[float]
    closing_work: ClassVar[float]
    beyond: ClassVar[bool] = False
    said: ClassVar[str] = ""
    cutoff: ClassVar[str] = "radius"
    late: ClassVar[str] = ""
    later: ClassVar[float] = 1.0

    @classmethod
    def between(cls, modulus: Numbers, shear_modulus: Numbers, radius: Numbers, adhesion: Numbers) -> Self:
        """Return the law of contacts with E* and G* (Pa), Rc (m) and w (J/m²)."""
        root = np.sqrt(radius)
        return cls(4 / 3 * modulus * root, 8 * shear_modulus * root, cls.pull * np.pi * adhesion * radius)

    def scaled(self, length: float, force: float) -> Self:
        """Return the law in other units of length (m) and force (N)."""
        return replace(
            self,
            normal_coefficient=self.normal_coefficient * length**1.5 / force,
            shear_coefficient=self.shear_coefficient * length**1.5 / force,
            pull_off_force=self.pull_off_force / force,
        )

    def times(self, normal: Numbers, shear: Numbers) -> Self:
        """Return the law whose normal and shear forces are larger by factors at every overlap."""
        return replace(
            self,
            normal_coefficient=self.normal_coefficient * normal,
            shear_coefficient=self.shear_coefficient * shear,
            pull_off_force=self.pull_off_force * normal,
        )

    @property
    def arrays(self) -> list[Numbers]:
        """Parameters that differ between contacts, (C,) each."""
        return [value for each in fields(self) if np.ndim(value := getattr(self, each.name))]

    def of(self, which: Any) -> Self:
        """Return the law of some contacts, selected by a slice or by indices."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        return replace(self, **{name: value[which] if np.ndim(value) else value for name, value in values.items()})

    def closed(self, overlap: Numbers) -> Any:
        """Return whether spheres that have touched are still in contact at these overlaps."""
        return overlap > self.pull_off_overlap

    def nearest(self, overlap: Numbers) -> Numbers:
        """Return the overlaps, with values below `pull_off_overlap` replaced by it."""
        return np.maximum(overlap, self.pull_off_overlap)

    @property
    def pull_off_overlap(self) -> Numbers:
        """Overlap at which the pull F parts the spheres, m."""
        raise NotImplementedError

    def overlap_under(self, force: Numbers) -> Numbers:
        """Return the overlap of a contact under the force f_N ≥ −F (compression is positive)."""
        raise NotImplementedError

    def force(self, overlap: Numbers) -> Numbers:
        """Return f_N."""
        raise NotImplementedError

    def push(self, overlap: Numbers) -> Numbers:
        """Return f_N at any overlap; 0 where spheres do not touch."""
        raise NotImplementedError

    def energy(self, overlap: Numbers) -> Numbers:
        """Return the energy V, J, at any overlap; 0 where spheres do not touch."""
        raise NotImplementedError

    def sliding_force(self, overlap: Numbers) -> Numbers:
        """Return the shear force f_N + 2F over the friction coefficient at which the contact slides, as in LAMMPS."""
        return self.force(overlap) + 2 * self.pull_off_force

    def normal_stiffness(self, overlap: Numbers) -> Numbers:
        """Return ∂f_N/∂δ."""
        raise NotImplementedError

    def shear_stiffness(self, overlap: Numbers) -> Numbers:
        """Return ∂f_S/∂ξ."""
        raise NotImplementedError

    def excess(self, overlap: Numbers) -> Numbers:
        """Return the ratio ∂f_S/∂ξ : ∂f_N/∂δ in units of Mindlin's ratio 4G*/E*."""
        raise NotImplementedError

    def softening(self, overlap: Numbers) -> tuple[Numbers, Numbers]:
        """Return n, m of f_N = f − k(x − n x²/δ) and f_S = g(1 − m x/δ)ξ, to second order in a stretch x."""
        raise NotImplementedError

    def above_pull_off(self, x: str, load: float, holding: float) -> str:
        """Return LAMMPS's expression for f_N + F, or for a lower bound of f_N + F, at an overlap.

        Parameters
        ----------
        x : expression for the overlap, over the overlap under the load
        load : N
        holding : F plus the load, in units of the deck, which the result also has
        """
        raise NotImplementedError

    def overlap_of_share(self, u: str, load: float) -> str:
        """Return LAMMPS's expression for the overlap at which f_N + F is the share u of its value under the load (N).

        The overlap is in units of the overlap under the load.
        """
        raise NotImplementedError

    def hertz_force(self, force: str, pull: str) -> str:
        """Return LAMMPS's expression for a Hertz force with the same overlap as a force of this law, or a bound of it.

        force and pull are expressions for the force and for F.
        """
        return f"({force}+{pull})"

    @staticmethod
    def mark(axes: int) -> str:
        """Return columns of a local compute that distinguish contacts from other pairs; "" if it lists no others."""
        return ""


class Dmt(AdhesionLaw):
    """DMT law, which is Hertz's law if w = 0.

    Overlaps must not be negative, except for `push` and `energy`.
    """

    pull, closing_work = 2.0, 3 / 5
    pull_off_overlap = 0.0  # m: the contact parts where it ends

    def overlap_under(self, force: Numbers) -> Numbers:
        """Return the overlap ((F + f_N)/A)^{2/3} of a contact under the force f_N ≥ −F (compression is positive)."""
        return ((self.pull_off_force + force) / self.normal_coefficient) ** (2 / 3)

    def force(self, overlap: Numbers) -> Numbers:
        """Return f_N = A δ^{3/2} − F."""
        return self.normal_coefficient * overlap**1.5 - self.pull_off_force

    def push(self, overlap: Numbers) -> Numbers:
        """Return f_N at any overlap; 0 where spheres do not touch."""
        # In place, because the many steps of a relaxation spend most time here
        inside = np.maximum(overlap, 0.0)
        push = np.sqrt(inside)
        push *= inside
        push *= self.normal_coefficient
        push -= self.pull_off_force * (overlap > 0)
        return push

    def energy(self, overlap: Numbers) -> Numbers:
        """Return V = (2/5) A δ^{5/2} − F δ, J, at any overlap; 0 where spheres do not touch."""
        inside = np.maximum(overlap, 0.0)
        return (0.4 * (self.normal_coefficient * (np.sqrt(inside) * inside)) - self.pull_off_force) * inside

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
        """Return the ratio ∂f_S/∂ξ : ∂f_N/∂δ in units of Mindlin's ratio 4G*/E*: 1."""
        return 1.0

    def softening(self, overlap: Numbers) -> tuple[Numbers, Numbers]:
        """Return n, m of f_N = f − k(x − n x²/δ) and f_S = g(1 − m x/δ)ξ, to second order in a stretch x: ¼ and ½."""
        return 0.25, 0.5

    def above_pull_off(self, x: str, load: float, holding: float) -> str:
        """Return LAMMPS's expression for f_N + F = (F + F0) x^{3/2}."""
        return f"{holding!r}*{x}^1.5"

    def overlap_of_share(self, u: str, load: float) -> str:
        """Return LAMMPS's expression for u^{2/3}."""
        return f"{u}^(2/3)"


class Jkr(AdhesionLaw):
    """JKR law of an adhesive contact, w > 0.

    Overlaps must not be below `pull_off_overlap`, where the contact parts, except for `push` and `energy`.
    """

    pull, closing_work = 1.5, 6 / 5 * (1 - (2 / 3) ** (4 / 3))
    beyond, said, cutoff = True, "also beyond contact", "type"
    late, later = "jkr/distance", 9 * 6 ** (-4 / 3) * 2 ** (4 / 3)  # the variant ends at y = 1/6 instead of y = 1/2

    @cached_property
    def rest_overlap(self) -> Numbers:
        """Overlap δ0 of an unloaded contact, m."""
        return (4 * self.pull_off_force / self.normal_coefficient) ** (2 / 3) / 3

    @cached_property
    def pull_off_overlap(self) -> Numbers:
        """Overlap −½ 2^{-1/3} δ0 < 0 at which the largest pull parts the spheres, m."""
        return self._overlap(0.5)

    def overlap_under(self, force: Numbers) -> Numbers:
        """Return the overlap of a contact under the force f_N ≥ −F (compression is positive)."""
        return self._overlap((1 + np.sqrt(1 + force / self.pull_off_force)) / 2)

    def force(self, overlap: Numbers) -> Numbers:
        """Return f_N = (4E*a³/3Rc)(1 − 1/y) = 4F (y² − y)."""
        y = self._y(overlap)
        return 4 * self.pull_off_force * (y * y - y)

    def push(self, overlap: Numbers) -> Numbers:
        """Return f_N at any overlap; 0 where spheres do not touch."""
        y = self._y(self.nearest(overlap))
        return self.closed(overlap) * 4 * self.pull_off_force * (y * y - y)

    def energy(self, overlap: Numbers) -> Numbers:
        """Return V = 4F δ0 [(6/5)s¹⁰ − 2s⁷ + ½s⁴], J, s³ = y, minus its value where the contact parts; 0 beyond."""
        s = self._s(self.nearest(overlap))
        y = s**3
        energy = s**4 * (1.2 * y * y - 2 * y + 0.5) + 0.2 * 2 ** (-4 / 3)  # at y = ½ the bracket is −1/5
        return self.closed(overlap) * 4 * self.pull_off_force * self.rest_overlap * energy

    def normal_stiffness(self, overlap: Numbers) -> Numbers:
        """Return ∂f_N/∂δ = 2E*a (6y−3)/(6y−1), with 2E*a = (3/2) A √(3δ0) s²."""
        s = self._s(overlap)
        y = s * s * s
        return 1.5 * self.normal_coefficient * self._hertzian(s) * (6 * y - 3) / (6 * y - 1)

    def shear_stiffness(self, overlap: Numbers) -> Numbers:
        """Return ∂f_S/∂ξ = 8 G* a = B √(3δ0) s²."""
        return self.shear_coefficient * self._hertzian(self._s(overlap))

    def excess(self, overlap: Numbers) -> Numbers:
        """Return (6y−1)/(6y−3), the ratio ∂f_S/∂ξ : ∂f_N/∂δ in units of Mindlin's ratio 4G*/E*; 5/3 if unloaded."""
        y = self._y(overlap)
        return (6 * y - 1) / (6 * y - 3)

    def softening(self, overlap: Numbers) -> tuple[Numbers, Numbers]:
        """Return n, m of f_N = f − k(x − n x²/δ) and f_S = g(1 − m x/δ)ξ, to second order in a stretch x.

            m = (3y−2)/(6y−1),   n = (m/2)[1 + 6y/((2y−1)(6y−1))]

        An unloaded contact has m = 1/5 and n = 11/50.
        """
        y = self._y(overlap)
        shear = (3 * y - 2) / (6 * y - 1)
        return shear / 2 * (1 + 6 * y / ((2 * y - 1) * (6 * y - 1))), shear

    def above_pull_off(self, x: str, load: float, holding: float) -> str:
        """Return LAMMPS's expression for a parabola that touches zero where f_N + F does.

        The parabola lies below f_N + F for all overlaps up to the overlap under the load.
        """
        hold = abs(float(self.pull_off_overlap)) / float(self.overlap_under(load))
        return f"{holding!r}*(({x}+{hold!r})/(1+{hold!r}))^2"

    def overlap_of_share(self, u: str, load: float) -> str:
        """Return LAMMPS's expression for this overlap, by way of y."""
        pressed = (float(self.pull_off_force) + load) / float(self.pull_off_force)
        y = f"(0.5+0.5*sqrt({u}*{pressed!r}))"
        return f"{float(self.overlap_under(0.0)) / float(self.overlap_under(load))!r}*{y}^(1/3)*(3*{y}-2)"

    def hertz_force(self, force: str, pull: str) -> str:
        """Return LAMMPS's expression for f + 2F + 2√(F(f + F)), the Hertz force of the contact radius, as δ ≤ a²/Rc."""
        return f"({force}+{pull}+{pull}+2*sqrt({pull}*({force}+{pull})))"

    @staticmethod
    def mark(axes: int) -> str:
        """Return the components of the vector between the centres, which are 0 for a pair without contact."""
        return "".join(f" p{10 + axis}" for axis in range(axes))

    def _hertzian(self, s: Numbers) -> Numbers:
        """Return a/√Rc, the square root of the overlap of a Hertz contact with the same radius."""
        return np.sqrt(3 * self.rest_overlap) * s**2

    def _overlap(self, y: Numbers) -> Numbers:
        return self.rest_overlap * y ** (1 / 3) * (3 * y - 2)

    def _y(self, overlap: Numbers) -> Numbers:
        s = self._s(overlap)
        return s * s * s

    def _s(self, overlap: Numbers) -> Numbers:
        """Return s = y^{1/3} at an overlap, from 3s⁴ − 2s = δ/δ0, by Newton's method.

        The starting value is at most 8 % off and the polynomial is convex, so five steps reach rounding for every
        overlap from `pull_off_overlap` on.
        """
        depth = overlap / self.rest_overlap
        s = np.sqrt(np.sqrt((np.maximum(depth, -0.5) + 2) / 3))
        for _ in range(_STEPS):
            cube = s * s * s  # a power takes ten times as long
            s = s - (3 * cube * s - 2 * s - depth) / (12 * cube - 2)
        return s


_STEPS = 5
SKIN = 0.1  # radii beyond overlap 0, where the neighbour list of a deck ends: adhesive contacts must end before
ADHESION_LAWS: dict[str, type[AdhesionLaw]] = {"dmt": Dmt, "jkr": Jkr}
HERTZ = "hertz"  # LAMMPS's name of the DMT law without adhesion
NORMAL_LAWS = tuple(sorted((*ADHESION_LAWS, HERTZ)))


def words_of_laws() -> str:
    """Return the descriptions of the laws for the comments of a scene."""
    return "; ".join(f"{name}: {law.said}" for name, law in ADHESION_LAWS.items() if law.said)


def joined(laws: Sequence[AdhesionLaw]) -> AdhesionLaw:
    """Return several laws of one name as one law, their contacts in the order of the laws."""
    return _combined(laws, np.concatenate)


def chosen(which: Numbers, laws: Sequence[AdhesionLaw]) -> AdhesionLaw:
    """Return one law for contacts (C,), each with the law that `which` (C,) selects from several laws of one name."""
    return _combined(laws, lambda each: np.choose(which, each))


def _combined(laws: Sequence[AdhesionLaw], how: Callable[[list[Numbers]], Numbers]) -> AdhesionLaw:
    return replace(laws[0], **{each.name: how([getattr(law, each.name) for law in laws]) for each in fields(laws[0])})
