"""Walls at rest at the faces of a crystal: the contact of a sphere with the plane face of a half-space.

It has the law of two spheres (`granular_lmp.crystal.adhesion_laws`) with the effective radius R in place of R/2, the
moduli 1/E* = (1−ν₁²)/E₁ + (1−ν₂²)/E₂ and 1/G* = (2−ν₁)/G₁ + (2−ν₂)/G₂, and w = √(w₁w₂). Of one material, by the DMT law
and without a load, the overlap is 2^{1/3} times that of two spheres and both stiffnesses are 2^{2/3} times theirs.

Where stiffnesses were measured, factors scale the forces at every overlap (`granular_lmp.crystal.stiffnesses`).

A wall is at rest. A half-space that moves with the spheres radiates: a vertical resonance has Q = ρ c_l/(N m ω), about
11 for silica on silica, which a rigid wall does not show.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import inf

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.adhesion_laws import ADHESION_LAWS, AdhesionLaw, chosen
from granular_lmp.crystal.contacts import Contacts, Floats, Integers, mixed, times_factors
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.frozen import cached_property, dataclass

BELOW, BOTH = "below", "both"
_OUTERMOST = 1e-6  # radii: spheres of a layer are at one height to rounding


@dataclass(frozen=True)
class Wall:
    """The half-space that spheres of one material touch.

    Attributes
    ----------
    material : Sphere
        The spheres, of the reference radius R.
    substrate : Sphere
        Moduli and work of adhesion of the half-space; its radius does not count.
    factors : (float, float)
        Factors of the normal and the shear force at every overlap.
    sides : "below" or "both"
        Where the half-spaces are: at −z, or at −z and +z.
    """

    material: Sphere
    substrate: Sphere
    factors: tuple[float, float] = (1.0, 1.0)
    sides: str = BELOW

    def law(self, radius: Floats | float) -> AdhesionLaw:
        """Return the law of the contacts of spheres of these radii, m."""
        law = ADHESION_LAWS[self.material.adhesion_law]
        modulus, shear_modulus, adhesion = (float(each[0]) for each in mixed(self.material, self.substrate))
        return law.between(modulus, shear_modulus, radius, adhesion).times(*self.factors)

    def beside(self, materials: Sequence[Sphere]) -> list["Wall"]:
        """Return the wall as spheres of each material of a crystal touch it, of which the first is that of the wall."""
        return [self, *(replace(self, material=each) for each in materials[1:])]

    def law_of(self, crystal: ase.Atoms, materials: Sequence[Sphere], spheres: Integers) -> AdhesionLaw:
        """Return the law of the contacts of spheres of a crystal (W,) with the wall, whether they touch or not."""
        radius = crystal.arrays["radius"][spheres] * materials[0].radius
        material = crystal.arrays.get("material", np.zeros(len(crystal), dtype=int))[spheres]
        law = chosen(material, [each.law(radius) for each in self.beside(materials)])
        return times_factors(law, crystal, spheres, -1)

    @cached_property
    def overlap(self) -> float:
        """Overlap at rest of a sphere of the reference radius, m."""
        return float(self.law(self.material.radius).overlap_under(0.0))

    @classmethod
    def rigid(cls, material: Sphere) -> "Wall":
        """Return the wall of infinite moduli whose work of adhesion is that of the spheres."""
        return cls(material, replace(material, youngs_modulus=inf))

    @property
    def heights(self) -> tuple[float, ...]:
        """Directions along z of the walls as seen from the crystal: −1, or −1 and +1."""
        return (-1.0, 1.0) if self.sides == BOTH else (-1.0,)


@dataclass(frozen=True, eq=False)
class Face:
    """A plane at rest beside a crystal, which its outermost spheres touch at their places in the lattice.

    Attributes
    ----------
    wall : Wall
    outward : (3,) array
        Unit vector out of the crystal, along an axis.
    overlap : float
        Overlap of the outermost spheres of the reference radius at their places, m.
    """

    wall: Wall
    outward: Floats
    overlap: float

    @cached_property
    def axis(self) -> int:
        """Axis across which the plane is."""
        return int(np.argmax(np.abs(self.outward)))

    @property
    def way(self) -> float:
        """Direction of the plane along its axis as seen from the crystal, −1 or 1."""
        return float(self.outward[self.axis])

    def depth(self, crystal: ase.Atoms) -> Floats:
        """Return how far the spheres are behind the outermost ones, (N,), radii."""
        outside = self.way * crystal.positions[:, self.axis]
        return np.asarray(outside.max() - outside)

    def distance(self, crystal: ase.Atoms, radius: float) -> Floats:
        """Return the distances of the spheres at their places from the plane, (N,), radii (m, `radius`)."""
        return self.depth(crystal) + 1 - self.overlap / radius

    def touches(self, crystal: ase.Atoms) -> NDArray[np.bool_]:
        """Return which spheres are the outermost ones, (N,)."""
        return self.depth(crystal) < _OUTERMOST


def on_wall(
    contacts: Contacts,
    wall: Wall,
    spheres: Integers,
    overlap: Floats,
    normal: Floats,
    law: AdhesionLaw | None = None,
) -> Contacts:
    """Return contacts with those of some spheres with a wall added.

    Parameters
    ----------
    contacts : Contacts
    wall : Wall
    spheres : (W,) int array
        Indices of the spheres.
    overlap : (W,) array
        m.
    normal : (3,) array
        Unit vector from the spheres to the wall.
    law : AdhesionLaw, optional
        Of spheres of other materials than that of the wall (`Wall.law_of`).
    """
    radius = contacts.radius[spheres]
    law = wall.law(radius) if law is None else law
    added = {
        "i": spheres,
        "j": np.full(len(spheres), -1),
        "vector": np.outer(radius - overlap, normal),
        "overlap": overlap,
        "normal_stiffness": law.normal_stiffness(overlap),
        "shear_stiffness": law.shear_stiffness(overlap),
        "adhesive_force": law.pull_off_force,
        "contact_force": law.force(overlap),
    }
    return replace(contacts, **{name: np.concatenate([getattr(contacts, name), more]) for name, more in added.items()})
