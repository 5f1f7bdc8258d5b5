"""Packing of spheres with the contact laws of LAMMPS: an independent check for imperfect crystals.

Sphere i has the position r_i, velocity v_i, spin ω_i, mass m_i = (4/3)πR_i³ρ_i and moment of inertia (2/5)m_iR_i².
Spheres i and j touch where |r_j − r_i| < R_i + R_j. Their contact has the overlap δ = R_i + R_j − |r_j − r_i|, the
present normal n from i to j, and

    repulsion      P = A δ^{3/2} − F            A = (4/3) E* √Rc,   F = 2π w Rc,   Rc = R_iR_j/(R_i + R_j)
    shear force    S = B s δ^{1/2}              B = 8 G* √Rc                              [law = "secant"]
    slip           ds/dt = (v_j − v_i)_⊥ − (R_i ω_i + R_j ω_j) × n,     s = 0 where the contact closes
    force on i     S − P n, the opposite on j;  torques (R_i − δ/2) n × S on i and (R_j − δ/2) n × S on j

with (·)_⊥ the part normal to n. These are the laws of `pair_style granular` in LAMMPS with `dmt` (`hertz/material` for
w = 0) and `mindlin`, in the limit of a short time step. With law = "incremental" the state is the force, dS/dt = B
δ^{1/2} ds/dt (`mindlin/force`). Friction limits |S| to μ(A δ^{3/2} + F); a sliding contact keeps the slip at its limit.

**Plane and space.** Spheres whose positions have two components stay in the plane and have three degrees of freedom: x,
y and the rotation about z. Spheres in space have six. Slip is a vector normal to n and is *transported* with its
contact: it keeps its length and rotates with n, but not about n, even if both spheres turn about n. LAMMPS does the
same: it projects the slip on the plane normal to the new n and restores the old length. In the plane slip is a number
along ẑ × n.

**Dashpots** add η dδ/dt to P and η ds/dt to S while a contact is closed. `viscosity` sets one η for all contacts
(`damping velocity`). `restitution` e sets η = √5 ζ (A m')^{1/2} δ^{1/4} with ζ = −ln e/√(π² + ln² e) and 1/m' = 1/m_i +
1/m_j, where a held sphere has 1/m = 0 (`damping coeff_restitution`). A sliding contact keeps the slip at which spring
and dashpot together equal the limit. Without adhesion the limit is μ|P|, where P includes the dashpot, as in LAMMPS.

**JKR.** With adhesion = "jkr" the law is `jkr` of LAMMPS (`granular_analysis.theory.network_laws`): P is another
function of δ, the contact radius over √Rc replaces δ^{1/2}, and the friction limit is μ(P + 2F') with the largest pull
F' = (3/4) F. Such a contact closes at δ = 0 and stays closed at negative δ until the pull reaches F'. At rest, all
spheres that are closer than the distance at which contacts open are in contact.

**Mixing.** A contact of two kinds of spheres has 1/E* = Σ(1 − ν²)/E, 1/G* = Σ 2(2 − ν)(1 + ν)/E and w = √(w_i w_j), as
documented for LAMMPS. LAMMPS departs from this in one case: if a pair of types has no pair_coeff of its own and the
shear stiffness is NULL, LAMMPS 22Jul2025 uses the G* of two equal spheres with E = E* and ν = √(ν_i ν_j). This is about
half of G*, also for two types of one material. `shear_mixing = "lammps"` reproduces it.

**Walls** are planes at rest with their own material. A sphere touches a wall by the same laws, with Rc = R and with the
lever arm R in place of R − δ/2.

Any consistent units will do: SI, those of a LAMMPS deck, or dimensionless ones.

`granular_analysis.theory.network_state` holds the motion and computes the present forces; it stores displacements from
rest, so that large crystals lose no digits. `granular_analysis.theory.network_outside` defines pushes and prescribed
motions, `granular_analysis.theory.network_motion` integrates the motion, and `granular_analysis.theory.network_ledger`
balances energy.

When it breaks: if contacts are not small compared with the spheres, since the contacts of a sphere are taken to be
independent of each other. The attraction of close spheres that do not touch is left out, as in LAMMPS.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory.errors import TheoryError, one_of
from granular_analysis.theory.network_laws import Adhesion
from granular_analysis.theory.network_outside import Drive

__all__ = ["Material", "Network"]

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
Law = Literal["secant", "incremental"]
LAWS: tuple[Law, ...] = ("secant", "incremental")
ShearMixing = Literal["mindlin", "lammps"]

# A pair is a candidate for a contact if its gap is below this share of the smallest radius. Waves move spheres far
# less, so one search suffices; second neighbours in a crystal are farther apart, so no candidate is computed in vain.
MARGIN = 0.2
_UNIT = 1e-12  # largest error of the squared length of a unit vector


@dataclass(frozen=True)
class Material:
    """Elastic constants of one kind of spheres, in any consistent units.

    Attributes
    ----------
    youngs_modulus : E > 0.
    poisson_ratio : ν in (−1, 0.5].
    work_of_adhesion : w ≥ 0 between two spheres of this kind, energy per area; 0 gives Hertz contacts.

    Raises TheoryError for a constant outside its range.
    """

    youngs_modulus: float
    poisson_ratio: float
    work_of_adhesion: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.youngs_modulus < np.inf:
            raise TheoryError(f"youngs_modulus = {self.youngs_modulus} must be positive and finite")
        if not -1 < self.poisson_ratio <= 0.5:
            raise TheoryError(f"poisson_ratio = {self.poisson_ratio} is outside (-1, 0.5]")
        if not 0 <= self.work_of_adhesion < np.inf:
            raise TheoryError(f"work_of_adhesion = {self.work_of_adhesion} must be finite and not negative")


class Elastic(NamedTuple):
    """Constants of `Material` without checks; they may be complex, for derivatives of a theory with respect to them."""

    youngs_modulus: complex
    poisson_ratio: complex
    work_of_adhesion: complex


RIGID = Material(1e300, 0.0)  # its 1/E is below the rounding error of any other 1/E


class Wall(NamedTuple):
    """A plane at rest.

    Attributes
    ----------
    point : (d,) a point of the plane.
    normal : (d,) unit vector that points out of the packing.
    material : None for a rigid wall that does not adhere.
    factors : factors of the normal and shear forces of its contacts at a given overlap, to match measured stiffnesses:
        two numbers, or (K, 2) for spheres of K materials.
    """

    point: tuple[float, ...]
    normal: tuple[float, ...]
    material: Material | None = None
    factors: Floats | tuple[float, float] = (1.0, 1.0)

    def beyond(self, position: Floats) -> Floats:
        """Return the distances (...) of positions (..., d) from the plane; negative inside the packing."""
        return np.asarray((position - np.array(self.point)) @ np.array(self.normal))


class Acting(NamedTuple):
    """Traits of a drive: the row of the motion on which it acts, and whether it prescribes that motion."""

    component: int
    moves: bool


class Traits(NamedTuple):
    """Properties of a network, other than arrays, that a step needs; the names are those of `Network`.

    `position` and `walls` are ranges, which hold only the numbers of spheres and walls. JAX traces a step once for all
    networks with equal traits and shapes.
    """

    position: range
    walls: range
    drives: tuple[Acting, ...]
    dimension: int
    freedoms: int
    law: Law
    adhesion: Adhesion
    adheres: bool
    shear: bool
    friction: float
    viscosity: float
    restitution: float | None


@dataclass(frozen=True, eq=False)
class Network:
    """N spheres at rest and the laws of their contacts, in any consistent units.

    Parameters
    ----------
    position : (N, 2) or (N, 3) positions from which displacements are measured. They need not be in equilibrium.
    radius, density : (N,) positive.
    materials : the K kinds of spheres.
    kind : (N,) index into `materials` of each sphere; None if there is one kind.
    held : (N,) whether a sphere ignores forces and keeps its initial velocity and spin; None: no sphere is held.
    cell : periods along x, y (and z), inf where the network is finite; (): finite in all directions. A period must
        exceed twice `reach`, so that no two spheres touch twice: three columns of equal spheres are enough.
    law : law of the shear force, "secant" or "incremental".
    friction : coefficient μ; inf for contacts that never slide.
    shear_mixing : rule for G* of two kinds, "mindlin" (as documented) or "lammps" (as computed by LAMMPS).
    shear, rotation : whether contacts resist shear, and whether spheres turn.
    inertia_ratio : moment of inertia over m R²; 2/5 for a sphere, 1/2 if LAMMPS treats spheres as discs.
    viscosity : coefficient η of a dashpot along the normal and the tangent of every closed contact.
    restitution : coefficient e in (0, 1] that sets the dashpots in place of `viscosity`, only without adhesion; None:
        not used.
    adhesion : law of the normal force, "dmt" (Hertz where w = 0) or "jkr".
    factors : factors of normal and shear forces at a given overlap, for measured stiffnesses: two numbers, or (K, K, 2)
        for pairs of K materials.
    walls, drives : external actions (`granular_analysis.theory.network_outside`).
    drag : (N,) decay rates of velocity and spin, per time; None: no decay.

    Raises TheoryError for a value or a shape that is not allowed.
    """

    position: Floats
    radius: Floats
    density: Floats
    materials: tuple[Material, ...]
    kind: Integers | None = None
    held: NDArray[np.bool_] | None = None
    cell: tuple[float, ...] = ()
    law: Law = "secant"
    friction: float = np.inf
    shear_mixing: ShearMixing = "mindlin"
    shear: bool = True
    rotation: bool = True
    inertia_ratio: float = 0.4
    viscosity: float = 0.0
    restitution: float | None = None
    adhesion: Adhesion = "dmt"
    factors: Floats | tuple[float, float] = (1.0, 1.0)
    walls: tuple[Wall, ...] = ()
    drives: tuple[Drive, ...] = ()
    drag: Floats | None = None

    def __post_init__(self) -> None:
        self._check_spheres()
        self._check_contacts()
        self._check_surroundings()

    def _check_spheres(self) -> None:
        for name in ("position", "radius", "density"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=float))
        count = len(self.position)
        if self.position.shape not in ((count, 2), (count, 3)) or not count or not np.all(np.isfinite(self.position)):
            raise TheoryError(f"position must be finite and of shape (N, 2) or (N, 3), not {self.position.shape}")
        for name in ("radius", "density"):
            values = getattr(self, name)
            if values.shape != (count,) or not np.all(np.isfinite(values) & (values > 0)):
                raise TheoryError(f"{name} must be positive, finite and of shape ({count},)")
        for name in ("kind", "held", "drag"):
            if getattr(self, name) is not None and np.shape(getattr(self, name)) != (count,):
                raise TheoryError(f"{name} must be of shape ({count},), not {np.shape(getattr(self, name))}")
        if not np.all((self.kinds >= 0) & (self.kinds < len(self.materials))):
            raise TheoryError(f"kind must be from 0 to {len(self.materials) - 1}, an index into materials")

    def _check_contacts(self) -> None:
        for name, allowed in (("law", Law), ("shear_mixing", ShearMixing), ("adhesion", Adhesion)):
            one_of(get_args(allowed), getattr(self, name), name)
        if self.adhesion == "jkr" and not all(each.work_of_adhesion > 0 for each in self.materials):
            raise TheoryError("adhesion = 'jkr' needs materials with work_of_adhesion above 0")
        if not self.friction >= 0:
            raise TheoryError(f"friction = {self.friction} must not be negative; inf means no sliding")
        if not 0 <= self.viscosity < np.inf:
            raise TheoryError(f"viscosity = {self.viscosity} must be finite and not negative")
        if self.restitution is not None and (not 0 < self.restitution <= 1 or self.viscosity or self.adheres):
            raise TheoryError(
                f"restitution = {self.restitution} must be in (0, 1], without viscosity and without work_of_adhesion"
            )

    def _check_surroundings(self) -> None:
        object.__setattr__(self, "cell", self.cell or (np.inf,) * self.dimension)
        if len(self.cell) != self.dimension or not min(self.cell) > 2 * self.reach:
            number = "two" if self.dimension == 2 else "three"
            raise TheoryError(f"cell = {self.cell} must be {number} periods, each more than {2 * self.reach} or inf")
        for each in self.walls:
            sizes, length = {len(each.point), len(each.normal)}, np.dot(each.normal, each.normal)
            if sizes != {self.dimension} or abs(length - 1) > _UNIT:
                d = self.dimension
                raise TheoryError(f"{each}: point and normal must have {d} components, and normal the length 1")

    @cached_property
    def dimension(self) -> int:
        """Return d, the number of components of a position."""
        return self.position.shape[1]

    @cached_property
    def freedoms(self) -> int:
        """Return f, the degrees of freedom of a sphere: d translations, and one rotation (d = 2) or three (d = 3)."""
        return 3 if self.dimension == 2 else 6

    @cached_property
    def kinds(self) -> Integers:
        """Return the index of the material of each sphere, (N,)."""
        return np.zeros(len(self.position), dtype=np.intp) if self.kind is None else np.asarray(self.kind, np.intp)

    @cached_property
    def mass(self) -> Floats:
        """Return the masses (4/3)πR³ρ, (N,)."""
        return 4 / 3 * np.pi * self.radius**3 * self.density

    @cached_property
    def inertia(self) -> Floats:
        """Return the moments of inertia, (2/5)mR² of spheres, (N,)."""
        return self.inertia_ratio * self.mass * self.radius**2

    @cached_property
    def mobility(self) -> Floats:
        """Return accelerations per force and torque, (f, N): 1/m and 1/I, 0 for held and moved spheres."""
        free = np.ones(len(self.position)) if self.held is None else 1.0 - self.held
        for each in self.drives:
            free[each.spheres] *= not each.moves
        ways, turns = free / self.mass, self.rotation * free / self.inertia
        return np.stack([ways] * self.dimension + [turns] * (self.freedoms - self.dimension))

    @property
    def adheres(self) -> bool:
        """Return whether any material adheres."""
        return any(each.work_of_adhesion > 0 for each in self.materials)

    @property
    def traits(self) -> Traits:
        """Return the properties that a step needs beside arrays."""
        return Traits(
            range(len(self.position)),
            range(len(self.walls)),
            tuple(Acting(each.component, each.moves) for each in self.drives),
            self.dimension,
            self.freedoms,
            self.law,
            self.adhesion,
            self.adheres,
            self.shear,
            self.friction,
            self.viscosity,
            self.restitution,
        )

    @property
    def margin(self) -> float:
        """Return the largest gap of a pair that is a candidate for a contact."""
        return MARGIN * float(np.min(self.radius))

    @property
    def reach(self) -> float:
        """Return the largest distance between the centres of a candidate pair."""
        return 2 * float(np.max(self.radius)) + self.margin

    def coefficients(self, first: Integers, second: Integers) -> tuple[Floats, Floats, Floats]:
        """Return A, B and F, each (M,), for contacts of spheres `first` and `second`, times `factors`."""
        i, j = self.kinds[first], self.kinds[second]
        A, B, F, _ = mixed(self.materials, (i, j), (self.radius[first], self.radius[second]), self.shear_mixing)
        count = len(self.materials)
        pressing, shearing = np.moveaxis(np.broadcast_to(self.factors, (count, count, 2))[i, j], -1, 0)
        return pressing * A, shearing * self.shear * B, pressing * F

    def on_wall(self, wall: Wall, spheres: Integers) -> tuple[Floats, Floats, Floats]:
        """Return A, B and F, each (n,), for contacts of spheres with a wall, times its factors."""
        kinds, radii = self.kinds[spheres], self.radius[spheres]
        both = [*self.materials, wall.material or RIGID]
        A, B, F, _ = mixed(
            both, (kinds, np.full_like(kinds, len(self.materials))), (radii, np.full_like(radii, np.inf))
        )
        pressing, shearing = np.broadcast_to(wall.factors, (len(self.materials), 2))[kinds].T
        return pressing * A, shearing * self.shear * B, pressing * F


def mixed(
    materials: Sequence[Material | Elastic],
    kinds: tuple[Integers, Integers],
    radii: tuple[Floats, Floats],
    rule: ShearMixing = "mindlin",
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return A, B, F and Rc of contacts, each (M,), by the mixing rules at the top of this module.

    Parameters
    ----------
    kinds : two arrays (M,) of indices into `materials`, one for each end.
    radii : two arrays (M,), one for each end; inf is a plane.
    rule : "mindlin" as documented for LAMMPS, "lammps" for the G* that it computes.
    """
    modulus, ratio, adhesion = np.array(
        [(one.youngs_modulus, one.poisson_ratio, one.work_of_adhesion) for one in materials]
    ).T
    i, j = kinds
    stretching, shearing = (1 - ratio**2) / modulus, 2 * (2 - ratio) * (1 + ratio) / modulus
    young, shear = 1 / (stretching[i] + stretching[j]), 1 / (shearing[i] + shearing[j])
    if rule == "lammps":
        mean = np.sqrt(ratio[i] * ratio[j])
        shear = np.where(i == j, shear, young / (4 * (2 - mean) * (1 + mean)))
    radius = 1 / (1 / radii[0] + 1 / radii[1])
    root = np.sqrt(radius)
    return 4 / 3 * young * root, 8 * shear * root, 2 * np.pi * np.sqrt(adhesion[i] * adhesion[j]) * radius, radius
