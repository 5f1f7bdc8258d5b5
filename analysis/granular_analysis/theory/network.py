"""Packing of spheres with the contact laws of LAMMPS: an independent check for imperfect crystals.

Sphere i has the place r_i, velocity v_i, spin ω_i, mass m_i = (4/3)πR_i³ρ_i and moment of inertia (2/5)m_iR_i². Two
spheres i and j at the distance |r_j − r_i| < R_i + R_j touch, with the overlap δ = R_i + R_j − |r_j − r_i|, the present
normal n from i to j, and

    repulsion      P = A δ^{3/2} − F            A = (4/3) E* √Rc,   F = 2π w Rc,   Rc = R_iR_j/(R_i + R_j)
    shear force    S = B s δ^{1/2}              B = 8 G* √Rc                              [law = "secant"]
    slip           ds/dt = (v_j − v_i)_⊥ − (R_i ω_i + R_j ω_j) × n,     s = 0 where the contact closes
    force on i     S − P n, the opposite on j;  torques (R_i − δ/2) n × S on i and (R_j − δ/2) n × S on j

with (·)_⊥ the part normal to n. These are the laws of `pair_style granular` in LAMMPS with `dmt` (`hertz/material` for
w = 0) and `mindlin`, in the limit of a short time step. With law = "incremental" the state is the force, dS/dt = B
δ^{1/2} ds/dt (`mindlin/force`). Friction limits |S| to μ(A δ^{3/2} + F); a sliding contact keeps the slip at its limit.

**Plane and space.** Places with two components mean spheres that stay in the plane, with the freedoms x, y and the
rotation about z. Spheres in space have six freedoms. Slip is a vector normal to n, and is *transported* with its
contact: it keeps its length and rotates with n, but not about n, even if both spheres turn about n. LAMMPS does the
same: it takes the part normal to the new n and restores the old length. In the plane slip is a number along ẑ × n.

Dashpots add η dδ/dt to P and η ds/dt to S while a contact is closed: `viscosity` is an η for all (`damping velocity`),
and with `restitution` e it is √5 ζ (A m')^{1/2} δ^{1/4}, ζ = −ln e/√(π² + ln² e), 1/m' = 1/m_i + 1/m_j, 0 for 1/m of a
held sphere (`damping coeff_restitution`). A sliding contact keeps the slip at which spring and dashpot together have
the limit. Without adhesion the limit is μ|P| with the dashpot in P, as in LAMMPS.

With adhesion = "jkr" the law is `jkr` of LAMMPS (`granular_analysis.theory.network_laws`): another P, the contact
radius over √Rc in place of δ^{1/2}, and a friction limit μ(P + 2F') with the largest pull F' = (3/4) F. Such a contact
begins at δ = 0 and holds beyond, until the pull is F'; at rest, all spheres within that distance touch.

Mixing. Contacts of two kinds of spheres have 1/E* = Σ(1 − ν²)/E, 1/G* = Σ 2(2 − ν)(1 + ν)/E and w = √(w_i w_j), as
documented for LAMMPS. LAMMPS departs from this in one case: if a pair of types has no pair_coeff of its own and the
shear stiffness is NULL, LAMMPS 22Jul2025 uses the G* of two equal spheres with E = E* and ν = √(ν_i ν_j). This is about
half of G*, also for two types of one material. `shear_mixing = "lammps"` reproduces it.

Walls are planes at rest with their own material. A sphere touches a wall with the same laws, Rc = R, and the arm R in
place of R − δ/2.

Units are any consistent ones: SI, those of a LAMMPS deck, or dimensionless. `granular_analysis.theory.network_state`
holds the motion, as displacements from rest, so that no digits are lost in large crystals, and the present forces.
`granular_analysis.theory.network_outside` has pushes and prescribed motions, `granular_analysis.theory.network_motion`
integrates the motion, and `granular_analysis.theory.network_ledger` balances energy and momentum.

Breaks if contacts are not small compared with the spheres, since the contacts of a sphere are independent of each
other. The attraction of close spheres that do not touch is left out, as in LAMMPS.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network_laws import Adhesion
from granular_analysis.theory.network_outside import Drive

__all__ = ["Material", "Network"]

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
Law = Literal["secant", "incremental"]
LAWS: tuple[Law, ...] = ("secant", "incremental")
ShearMixing = Literal["mindlin", "lammps"]

# Pairs are candidates up to this gap, in radii of the smallest sphere. A wave moves spheres far less, so that the
# candidates are searched once; and second neighbours of a crystal are farther, so that none is computed in vain.
MARGIN = 0.2
_UNIT = 1e-12  # rounding of the square of a unit vector


@dataclass(frozen=True)
class Material:
    """Elastic constants of a kind of spheres: E, ν, and w between two spheres of the kind (0: Hertz contacts)."""

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
    """The same constants, which are not checked and may be complex: a theory is differentiated by them."""

    youngs_modulus: complex
    poisson_ratio: complex
    work_of_adhesion: complex


RIGID = Material(1e300, 0.0)  # 1/E is below the rounding of any other


class Wall(NamedTuple):
    """A plane at rest through a point, with the unit normal that points out of the packing, in its dimensions.

    Without a material it is rigid and does not adhere. `factors` multiply the normal force and the shear force of its
    contacts at a given overlap, as measured stiffnesses ask for: two numbers, or (K, 2) by material of the sphere.
    """

    point: tuple[float, ...]
    normal: tuple[float, ...]
    material: Material | None = None
    factors: Floats | tuple[float, float] = (1.0, 1.0)

    def beyond(self, position: Floats) -> Floats:
        """Return how far places (..., d) are from the plane, (...), negative where inside."""
        return np.asarray((position - np.array(self.point)) @ np.array(self.normal))


class Acting(NamedTuple):
    """Row of the motion that a drive acts on, and whether it moves spheres."""

    component: int
    moves: bool


class Traits(NamedTuple):
    """Properties of a network that a step takes beside arrays, by their names there; of places and walls the number.

    Networks with equal traits share what JAX has traced.
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
    position : (N, 2) or (N, 3) places from which displacements are measured. They need not be in equilibrium.
    radius, density : (N,).
    materials : the kinds of spheres.
    kind : (N,) index into `materials` of each sphere; None if there is one kind.
    held : (N,) whether a sphere ignores forces and keeps its initial velocity and spin. None: no sphere.
    cell : periods in x, y (and z), inf where the network ends; () if it is finite. A period must exceed twice the
        `reach`, so that no two spheres touch twice: three columns of equal spheres are enough.
    law : law of the shear force.
    friction : coefficient μ; inf for contacts that never slide.
    shear_mixing : rule for G* between two kinds.
    shear, rotation : whether contacts resist shear, and whether spheres turn.
    inertia_ratio : moment of inertia over m R²; 2/5 for a sphere, 1/2 if LAMMPS treats spheres as discs.
    viscosity : coefficient η of a dashpot along normal and tangent of every closed contact.
    restitution : coefficient e in (0, 1] that sets the dashpots instead, only without adhesion; None: not used.
    adhesion : law of the normal force.
    factors : factors of normal and shear forces at a given overlap, for measured stiffnesses: two numbers, or (K, K, 2)
        for pairs of K materials.
    walls, drives : external actions (`granular_analysis.theory.network_outside`).
    drag : (N,) decay rates of velocity and spin, per time; None: no decay.
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
        for name, allowed in (
            ("law", get_args(Law)),
            ("shear_mixing", get_args(ShearMixing)),
            ("adhesion", get_args(Adhesion)),
        ):
            if getattr(self, name) not in allowed:
                raise TheoryError(f"{name} = {getattr(self, name)!r} is none of {allowed}")
        if self.adhesion == "jkr" and not all(each.work_of_adhesion > 0 for each in self.materials):
            raise TheoryError("adhesion = 'jkr' needs materials with work_of_adhesion above 0")
        if not self.friction >= 0:
            raise TheoryError(f"friction = {self.friction} must not be negative; inf is without sliding")
        if not 0 <= self.viscosity < np.inf:
            raise TheoryError(f"viscosity = {self.viscosity} must be finite and not negative")
        if self.restitution is not None and (not 0 < self.restitution <= 1 or self.viscosity or self.adheres):
            raise TheoryError(
                f"restitution = {self.restitution} must be in (0, 1], beside no viscosity and no work_of_adhesion"
            )

    def _check_surroundings(self) -> None:
        object.__setattr__(self, "cell", self.cell or (np.inf,) * self.dimension)
        if len(self.cell) != self.dimension or not min(self.cell) > 2 * self.reach:
            number = "two" if self.dimension == 2 else "three"
            raise TheoryError(f"cell = {self.cell} must be {number} periods of more than {2 * self.reach}, or inf")
        for each in self.walls:
            sizes, length = {len(each.point), len(each.normal)}, np.dot(each.normal, each.normal)
            if sizes != {self.dimension} or abs(length - 1) > _UNIT:
                d = self.dimension
                raise TheoryError(f"{each}: point and normal must have {d} components, normal the length 1")

    @cached_property
    def dimension(self) -> int:
        """Return d, the number of components of a place."""
        return self.position.shape[1]

    @cached_property
    def freedoms(self) -> int:
        """Return the number of freedoms: d translations, and one rotation in the plane or three in space."""
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
        """Return accelerations per force and torque, (freedoms, N): 1/m and 1/I, and 0 for held and moved spheres."""
        free = np.ones(len(self.position)) if self.held is None else 1.0 - self.held
        for each in self.drives:
            free[each.spheres] *= not each.moves
        ways, turns = free / self.mass, self.rotation * free / self.inertia
        return np.stack([ways] * self.dimension + [turns] * (self.freedoms - self.dimension))

    @property
    def adheres(self) -> bool:
        """Return whether any of the materials adheres."""
        return any(each.work_of_adhesion > 0 for each in self.materials)

    @property
    def traits(self) -> Traits:
        """Return the options of a step that are not arrays."""
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
        """Return the gap up to which a pair is a candidate for a contact."""
        return MARGIN * float(np.min(self.radius))

    @property
    def reach(self) -> float:
        """Return the largest distance between the centres of a candidate pair."""
        return 2 * float(np.max(self.radius)) + self.margin

    def coefficients(self, first: Integers, second: Integers) -> tuple[Floats, Floats, Floats]:
        """Return A, B and F of the contacts of spheres `first` and `second`, each (M,), by the mixing above."""
        i, j = self.kinds[first], self.kinds[second]
        A, B, F, _ = mixed(self.materials, (i, j), (self.radius[first], self.radius[second]), self.shear_mixing)
        count = len(self.materials)
        pressing, shearing = np.moveaxis(np.broadcast_to(self.factors, (count, count, 2))[i, j], -1, 0)
        return pressing * A, shearing * self.shear * B, pressing * F

    def on_wall(self, wall: Wall, spheres: Integers) -> tuple[Floats, Floats, Floats]:
        """Return A, B and F of the contacts of spheres with a wall, each (n,)."""
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
    """Return A, B, F and Rc of contacts, each (M,), from the materials and radii (M,) of both ends; inf is a plane."""
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
