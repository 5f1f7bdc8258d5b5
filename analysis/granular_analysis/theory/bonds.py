"""Contacts of two spheres, or of a sphere and a wall, to second order in the displacements.

A contact at rest has the unit normal n from its first sphere to its second, the length ℓ between the centres and the
overlap δ. It pushes with the force f(δ) and resists slip with the stiffness k(δ). Sphere i moves by u_i and turns by
θ_i = φ_i/R_i; all vectors are in space. To first order, with P = 1 − n nᵀ,

    w = u_j − u_i,  Φ = φ_i + φ_j,   stretch x = n·w,   sideways P w,   slip s = P w − Φ × n
    force on i     F₁ = f′ x n − (f/ℓ) P w + k s          (the opposite on j)
    torque on both, over R,  (arm/R) n × k s,             arm = R − δ/2 of a pair, R of a wall

**Second order** follows from the law and the geometry alone. The normal turns by ν = P w/ℓ. A sideways shift lengthens
the contact by |P w|²/2ℓ. The slip grows along the present tangent, ds/dt = P(n)(ẇ − Φ̇ × n), and is carried along as n
turns. The arm of a pair grows by x/2:

    n·F₂ = ½(f′/ℓ + f/ℓ²)|P w|² − ½f″ x² − k s·ν
    P F₂ = (f′/ℓ + f/ℓ²) x P w + T,     torque  (arm/R)(n × T + ν × k s) + (x/2R) n × k s
    secant law        T = k ξ − k′ x s                            (LAMMPS mindlin: force k(δ) times slip)
    incremental law   T = k ξ − k′ (x s)₀ − k′ ∫x ds              (LAMMPS mindlin/force: dS = k(δ) ds)
    ξ = −(x ν + Φ·n n × ν)₀ − ∫(ẋ ν + Φ̇·n n × ν) dt

The subscript 0 means the value at τ = 0: LAMMPS loads the springs of a wave in one step, along the tangents of the
displaced lattice. The potential law adds −½k′|s|² to the normal force of the secant law, so that the contact has an
energy (no LAMMPS model).

**Two waves** A e^{−iω₁t} and B e^{−iω₂t} meet in the symmetric bilinear form of these products. With Ω = ω₁ + ω₂ and
[A, B] = ½(A₁B₂ + A₂B₁), the integral ∫Ȧ B dt has three parts: ½[A, B] *runs* with e^{−iΩt}, −½[A, B] *stays*, and
−¼i(ω₁ − ω₂)(A₁B₂ − A₂B₁) *winds up* as ∫e^{−iΩt} dt, without bound where Ω = 0 unless A and B are in phase.

An infinite length ℓ is the paper's contact, with a fixed normal and the arm R. Any consistent units will do.

Source: the laws of the paper (springN, springS) and of LAMMPS's pair style granular; the expansion is not in the paper.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network_laws import Adhesion, Jkr

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Integers = NDArray[np.intp]
ShearLaw = Literal["secant", "incremental", "potential"]
SHEAR_LAWS: tuple[ShearLaw, ...] = ("secant", "incremental", "potential")


class Law(NamedTuple):
    """Forces of contacts at rest and their derivatives with respect to the overlap, each (C,).

    Attributes
    ----------
    push, stiffness, curvature, third : f, f′, f″, f‴ of the normal force.
    shear, shear_growth, shear_curvature : k, k′, k″ of the stiffness against slip.
    reach : stretch that opens the contact.
    friction : largest shear force, divided by the coefficient of friction.
    """

    push: Floats
    stiffness: Floats
    curvature: Floats
    third: Floats
    shear: Floats
    shear_growth: Floats
    shear_curvature: Floats
    reach: Floats
    friction: Floats

    def scaled(self, normal: Floats, shear: Floats) -> "Law":
        """Return the law with normal and shear forces multiplied by factors (C,) at every overlap."""
        larger = [normal] * 4 + [shear] * 3 + [np.ones_like(normal), normal]
        return Law(*(factor * each for factor, each in zip(larger, self, strict=True)))


def dmt(overlap: ArrayLike, hertz: ArrayLike, mindlin: ArrayLike, pull: ArrayLike = 0.0) -> Law:
    """Return the DMT law f = A δ^{3/2} − F, k = B δ^{1/2} at overlaps δ > 0; Hertz's law for a pull F = 0."""
    delta, A, B, F = np.broadcast_arrays(overlap, hertz, mindlin, pull)
    root = np.sqrt(delta)
    cubed = root**3
    push = A * cubed - F
    normal = push, 1.5 * A * root, 0.75 * A / root, -0.375 * A / cubed
    return Law(*normal, B * root, 0.5 * B / root, -0.25 * B / cubed, delta, push + 2 * F)


def jkr(overlap: ArrayLike, hertz: ArrayLike, mindlin: ArrayLike, pull: ArrayLike) -> Law:
    """Return the law of Johnson, Kendall and Roberts at overlaps δ, from the coefficients of `dmt`.

    With the ratio r of the contact radius to that without force (`granular_analysis.theory.network_laws`),

        f = 3F(r³ − r^{3/2}),   δ = d(3r² − 2r^{1/2}),   k = B √(3d) r,   d = (3F/A)^{2/3}/3

    Raises TheoryError for contacts that do not adhere, F ≤ 0.
    """
    delta, A, B, F = np.broadcast_arrays(*np.atleast_1d(overlap, hertz, mindlin, pull))
    if not np.all(F > 0):
        raise TheoryError(f"pull = {np.min(F)}: must be positive, as contacts of the JKR law adhere")
    law = Jkr(A, F)
    depth, widest = law.depth, np.sqrt(3 * law.depth)
    r = law.radius(delta, np.ones(delta.shape, dtype=bool)) / widest
    f, f1, f2 = (3 * F * each for each in (r**3 - r**1.5, 3 * r**2 - 1.5 * r**0.5, 6 * r - 0.75 / r**0.5))
    f3 = 3 * F * (6 + 0.375 / r**1.5)
    d1, d2, d3 = (depth * each for each in (6 * r - 1 / r**0.5, 6 + 0.5 / r**1.5, -0.75 / r**2.5))
    # Derivatives with respect to δ of functions of r; k is proportional to r
    bent, rise = f2 * d1 - f1 * d2, B * widest
    third = (f3 * d1 - f1 * d3) / d1**4 - 3 * d2 * bent / d1**5
    sheared = rise * r, rise / d1, -rise * d2 / d1**3
    return Law(f, f1 / d1, bent / d1**3, third, *sheared, delta - law.end, f + 2 * law.pull * F)


AT_REST: dict[Adhesion, Callable[..., Law]] = {"dmt": dmt, "jkr": jkr}


class Measured(NamedTuple):
    """Measured stiffnesses of contacts at rest; None: that of the law.

    They scale the forces of the law at every overlap, so that overlaps at rest stay.

    Attributes
    ----------
    normal, shear : stiffnesses of contacts of two spheres.
    wall_normal, wall_shear : stiffnesses of contacts with walls.
    pairs : two kinds of spheres with their normal and shear stiffness, for each pair of kinds that has its own.
    """

    normal: float | None = None
    shear: float | None = None
    wall_normal: float | None = None
    wall_shear: float | None = None
    pairs: tuple[tuple[tuple[int, ...], tuple[float | None, float | None]], ...] = ()

    def scale(self, law: Law, walls: NDArray[np.bool_], kinds: Integers) -> Law:
        """Return the law with these stiffnesses.

        Parameters
        ----------
        law : law of C contacts.
        walls : (C,) whether a contact is with a wall.
        kinds : (2, C) kinds of both ends.
        """

        def factor(pair: float | None, wall: float | None, of_kinds: int, computed: Floats) -> Floats:
            known = [(wall, walls), (pair, ~walls)]
            known += [(both[of_kinds], ~walls & _between(kinds, own)) for own, both in self.pairs]
            found = computed
            for stiffness, there in known:
                found = found if stiffness is None else np.where(there, stiffness, found)
            return found / computed

        return law.scaled(
            factor(self.normal, self.wall_normal, 0, law.stiffness), factor(self.shear, self.wall_shear, 1, law.shear)
        )


def _between(kinds: Integers, both: Sequence[int]) -> NDArray[np.bool_]:
    """Return whether each contact (C,), with ends of `kinds` (2, C), joins the two kinds `both`."""
    return np.all(np.sort(kinds, axis=0) == np.sort(both)[:, None], axis=0)


class Strain(NamedTuple):
    """Deformation of contacts in a field: x (..., C), P w (..., C, 3), s (..., C, 3) and Φ·n (..., C).

    The attributes are `stretch`, `sideways`, `slip` and `twist`, in this order.
    """

    stretch: Complexes
    sideways: Complexes
    slip: Complexes
    twist: Complexes


class Quadratic(NamedTuple):
    """Second-order forces of two waves at both ends of the contacts, each (..., C, 2, 6); see `Bonds.quadratic`."""

    running: Complexes
    left: Complexes
    winding: Complexes


@dataclass(frozen=True, eq=False)
class Bonds:
    """C contacts of a crystal.

    Attributes
    ----------
    first, second : (C,) indices of the spheres; `second` is −1 for a wall.
    apart : (C, 3) vector from the centre of the first sphere to that of the second, in the unit of 1/wave vector; 0 for
        a wall.
    normal : (C, 3) unit vectors n.
    curving : (C,) 1/ℓ; 0 for a wall and for the paper's geometry.
    arms : (C, 2) arm/R of both ends; in a `granular_analysis.theory.crystal.Crystal` over the mean of each sphere, by
        which its moment of inertia is divided instead.
    widening : (C, 2) 1/2R of both ends, over the same mean; 0 for a wall and for the paper's geometry.
    law : forces at rest.
    shear_law : "secant", "incremental" or "potential".
    """

    first: Integers
    second: Integers
    apart: Floats
    normal: Floats
    curving: Floats
    arms: Floats
    widening: Floats
    law: Law
    shear_law: ShearLaw = "secant"

    @property
    def has_history(self) -> bool:
        """Return whether the slip of a contact, or its shear force, depends on the history of the motion."""
        return self.shear_law == "incremental" or bool(np.any(self.curving * self.law.shear))

    def strain(self, field: ArrayLike, wavevector: ArrayLike) -> Strain:
        """Return the deformation at the middles of the contacts in a field (..., B, 6) times e^{ik·r}.

        wavevector : k (..., 3); complex for a wave that decays.
        """
        field = np.asarray(field)
        half = self._half(wavevector)
        here = field[..., self.first, :] / half
        there = field[..., self.second, :] * (half * self._pairs)
        return self.deformed((there - here)[..., :3], (there + here)[..., 3:])

    @cached_property
    def _pairs(self) -> Floats:
        """Return 1 for a contact of two spheres and 0 for one with a wall, (C, 1)."""
        return np.where(self.second < 0, 0.0, 1.0)[:, None]

    def deformed(self, w: NDArray[Any], turned: NDArray[Any]) -> Strain:
        """Return the deformation of contacts from w = u_j − u_i and Φ = φ_i + φ_j, (..., C, 3) each."""
        both = np.concatenate([w, turned], axis=-1)[..., None, :] @ self._measures
        return Strain(both[..., 0, 0], both[..., 0, 1:4], both[..., 0, 4:7], both[..., 0, 7])

    @cached_property
    def _measures(self) -> NDArray[Any]:
        """Return the matrices (C, 6, 8) from w and Φ to x, P w, s and Φ·n."""
        n, units = self.normal[:, None], np.eye(3)
        result = np.zeros((len(self.first), 6, 8), dtype=self.normal.dtype)
        result[:, :3, 0] = result[:, 3:, 7] = self.normal
        result[:, :3, 1:4] = result[:, :3, 4:7] = units - np.swapaxes(n, 1, 2) * n
        result[:, 3:, 4:7] = -crossed(units, n)
        return result

    def _about(self, vector: NDArray[Any]) -> NDArray[Any]:
        """Return the cross products n × vector, (..., C, 3)."""
        return np.asarray(np.einsum("...ci,cij->...cj", vector, self._turning))

    @cached_property
    def _turning(self) -> NDArray[Any]:
        """Return the cross products of n with the three unit vectors, (C, 3, 3)."""
        return crossed(self.normal[:, None], np.eye(3))

    @cached_property
    def couplings(self) -> Floats:
        """Return the first-order forces (C, 2, 6, 2, 6) at each end of a contact for unit motions of each end.

        The axes are contact, end and component of the force, end and component of the motion.
        """
        units = np.broadcast_to(np.eye(6)[:, None], (6, len(self.first), 6))
        there = np.where(self.second[:, None] < 0, 0.0, units)
        w, turned = (
            np.stack([first, second])
            for first, second in ((-units[..., :3], there[..., :3]), (units[..., 3:], there[..., 3:]))
        )
        return np.asarray(np.moveaxis(self.linear(self.deformed(w, turned)), (0, 1), (3, 4)))

    def gather(self, ends: Complexes, wavevector: ArrayLike, spheres: int) -> Complexes:
        """Return the forces (..., B, 6) on the spheres from those at both ends of the contacts, (..., C, 2, 6)."""
        half = self._half(wavevector)
        ends = ends * np.stack([half, half.conj()], axis=-2)
        columns = ends.reshape(-1, 2 * len(self.first), 6).swapaxes(0, 1)
        order, begin, acted = self._acting
        summed = np.zeros((spheres, *columns.shape[1:]), dtype=columns.dtype)
        summed[acted] = np.add.reduceat(columns[order], begin, axis=0)
        return summed.swapaxes(0, 1).reshape(*ends.shape[:-3], spheres, 6)

    @cached_property
    def _acting(self) -> tuple[Integers, Integers, Integers]:
        """Return the ends (of 2C) sorted by sphere, without walls, where each sphere begins, and the spheres."""
        sphere = np.stack([self.first, self.second], axis=-1).ravel()
        order = np.argsort(sphere, kind="stable")[np.count_nonzero(sphere < 0) :]
        acted, begin = np.unique(sphere[order], return_index=True)
        return order, begin, acted

    def linear(self, strain: Strain) -> Complexes:
        """Return the first-order forces at both ends, (..., C, 2, 6)."""
        law, n = self.law, self.normal
        sheared = law.shear[:, None] * strain.slip
        force = (law.stiffness * strain.stretch)[..., None] * n + sheared
        force = force - (law.push * self.curving)[:, None] * strain.sideways
        return self.at_ends(force, self.arms[..., None] * self._about(sheared)[..., None, :])

    def energy(self, strain: Strain) -> Floats:
        """Return Σ f′|x|² − (f/ℓ)|P w|² + k|s|² (...): U†D U, but without the cancellation in that product."""
        law = self.law
        total = law.stiffness * np.abs(strain.stretch) ** 2 + law.shear * _square(strain.slip)
        return np.asarray((total - law.push * self.curving * _square(strain.sideways)).sum(axis=-1))

    def quadratic(self, one: Strain, other: Strain, frequencies: tuple[ArrayLike, ArrayLike]) -> Quadratic:
        """Return the second-order forces of two complex waves: those that run with e^{−i(ω₁+ω₂)t}, stay, and wind up.

        frequencies : ω₁ and ω₂ (...), of either sign.

        For real fields Re(A e^{iα}) and Re(B e^{iβ}), each of the orders (A, B) and (B, A) contributes ½Re of the form.
        """
        difference = np.asarray(frequencies[0]) - np.asarray(frequencies[1])
        winding = self.winding(one, other, -0.25j * np.asarray(difference)[..., None, None])
        return Quadratic(self.running(one, other), self.left(one, other), winding)

    def _sliding(self, one: Strain, other: Strain) -> tuple[NDArray[Any], NDArray[Any]]:
        """Return the parts −½k([x, ν] + [Φ·n, n × ν]) and k′[x, s] of the tangential force, (..., C, 3) each."""
        x, y = (each.stretch[..., None] for each in (one, other))
        nu, mu = (each.sideways * self.curving[:, None] for each in (one, other))
        turned = self._about(one.twist[..., None] * mu + other.twist[..., None] * nu)
        together = -0.25 * self.law.shear[:, None] * (x * mu + y * nu + turned)
        return together, 0.5 * self.law.shear_growth[:, None] * (x * other.slip + y * one.slip)

    @property
    def _gathered(self) -> float:
        """Return the share of k′[x, s] that the incremental law remembers: ½, or 0 for other laws."""
        return 0.5 if self.shear_law == "incremental" else 0.0

    def left(self, one: Strain, other: Strain) -> Complexes:
        """Return the second-order forces (..., C, 2, 6) that stay after a start with two fields."""
        together, grown = self._sliding(one, other)
        return self._sheared(together - self._gathered * grown)

    def running(self, one: Strain, other: Strain) -> Complexes:
        """Return the second-order forces (..., C, 2, 6) that run with two fields at their sum frequency."""
        law, n, curving = self.law, self.normal, self.curving
        k = law.shear[:, None]
        x, y = (each.stretch[..., None] for each in (one, other))
        nu, mu = (each.sideways * curving[:, None] for each in (one, other))
        together, grown = self._sliding(one, other)
        tangent = together - (1 - self._gathered) * grown

        bending = law.stiffness * curving + law.push * curving**2
        rolled = bending * np.sum(one.sideways * other.sideways, axis=-1)
        pressed = law.curvature * one.stretch * other.stretch
        slid = law.shear * np.sum(one.slip * mu + other.slip * nu, axis=-1)
        if self.shear_law == "potential":
            slid = slid + law.shear_growth * np.sum(one.slip * other.slip, axis=-1)
        force = (0.5 * (rolled - pressed - slid))[..., None] * n + tangent
        force = force + (0.5 * bending)[:, None] * (x * other.sideways + y * one.sideways)
        twisting = self._about(tangent) + 0.5 * k * (crossed(nu, other.slip) + crossed(mu, one.slip))
        couples = self.arms[..., None] * twisting[..., None, :]
        sheared = self._about(0.5 * k * (x * other.slip + y * one.slip))
        return self.at_ends(force, couples + self.widening[..., None] * sheared[..., None, :])

    def winding(self, one: Strain, other: Strain, rate: ArrayLike) -> Complexes:
        """Return the rate (..., C, 2, 6) of the second-order forces that wind up.

        rate : −¼i(ω₁ − ω₂) for two waves; −½ for a field `one` and its velocity `other`.
        """
        law = self.law
        x, y = (each.stretch[..., None] for each in (one, other))
        nu, mu = (each.sideways * self.curving[:, None] for each in (one, other))
        apart = x * mu - y * nu + self._about(one.twist[..., None] * mu - other.twist[..., None] * nu)
        growth = 2 * self._gathered * law.shear_growth[:, None]
        wound = law.shear[:, None] * apart + growth * (one.slip * y - other.slip * x)
        return self._sheared(-np.asarray(rate) * wound)

    def cubic(self, one: Strain, two: Strain, three: Strain) -> Complexes:
        """Return the third-order forces (..., C, 2, 6) of the law, without those of the geometry, at both ends.

        They are the normal force −f‴x³/6 and the shear force ½k″x²s, as forms symmetric in three waves. For a real
        field Re z, the force that runs with e^{3iα} is ¼ of the form (z, z, z), that with e^{iα} is ¾ of (z, z, z*).
        They do not hold for the incremental law, which has x² inside an integral.
        """
        x, y, z = (each.stretch[..., None] for each in (one, two, three))
        sheared = self.law.shear_curvature[:, None] * (x * y * three.slip + x * z * two.slip + y * z * one.slip) / 6
        force = self.law.third[:, None] * x * y * z * self.normal / 6 + sheared
        return self.at_ends(force, self.arms[..., None] * self._about(sheared)[..., None, :])

    def _sheared(self, tangent: NDArray[Any]) -> Complexes:
        return self.at_ends(tangent, self.arms[..., None] * self._about(tangent)[..., None, :])

    def at_ends(self, force: NDArray[Any], couples: NDArray[Any]) -> Complexes:
        """Return the forces (..., C, 2, 6) at both ends from that on the first sphere and couples (..., C, 2, 3)."""
        result = np.empty((*force.shape[:-1], 2, 6), dtype=np.result_type(force, couples))
        result[..., 0, :3], result[..., 1, :3], result[..., 3:] = force, -force, couples
        return result

    def _half(self, wavevector: ArrayLike) -> NDArray[Any]:
        """Return e^{ik·apart/2} (..., C, 1); at k = 0 a single real 1, which is faster for large cells."""
        if not np.any(wavevector):
            return np.ones((1, 1))
        return np.exp(0.5j * (np.asarray(wavevector) @ self.apart.T))[..., None]


def _square(vector: Complexes) -> Floats:
    return np.asarray((np.abs(vector) ** 2).sum(axis=-1))


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])  # for each of x, y, z: the next axis, and the one before


def crossed(one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
    """Return the cross product of vectors (..., 3); np.cross takes three times as long for a few contacts."""
    return np.asarray(one[..., _NEXT] * other[..., _LAST] - one[..., _LAST] * other[..., _NEXT])
