"""Walls at rest at the faces of a crystal: contacts of spheres with the plane face of a half-space.

The contact has the law of two spheres (`granular_lmp.crystal.adhesion_laws`) with the effective radius R instead of
R/2, the moduli 1/E* = (1−ν₁²)/E₁ + (1−ν₂²)/E₂ and 1/G* = (2−ν₁)/G₁ + (2−ν₂)/G₂, and w = √(w₁w₂). If both bodies have
the same material, then by the DMT law and without a load, the overlap is 2^{1/3} times and both stiffnesses are 2^{2/3}
times the values of two spheres.

If stiffnesses were measured, factors scale the forces at every overlap (`granular_lmp.crystal.stiffnesses`).

When it breaks: a wall is at rest, but a real half-space moves with the spheres and radiates. A vertical resonance then
has the quality factor Q = ρ c_l/(N m ω), about 11 for silica on silica, which a rigid wall does not show.
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
_OUTERMOST = 1e-6  # radii: tolerance of the height of a layer, far above rounding


@dataclass(frozen=True)
class Wall:
    """Half-space that spheres of one material touch.

    Attributes
    ----------
    material : Sphere
        Spheres with the reference radius R.
    substrate : Sphere
        Moduli and work of adhesion of the half-space; its radius is not used.
    factors : (float, float)
        Factors of the normal and the shear force at every overlap.
    sides : "below" or "both"
        Half-spaces at −z, or at −z and +z.
    """

    material: Sphere
    substrate: Sphere
    factors: tuple[float, float] = (1.0, 1.0)
    sides: str = BELOW

    def law(self, radius: Floats | float) -> AdhesionLaw:
        """Return the law of contacts with the wall for spheres of these radii, m."""
        law = ADHESION_LAWS[self.material.adhesion_law]
        modulus, shear_modulus, adhesion = (float(each[0]) for each in mixed(self.material, self.substrate))
        return law.between(modulus, shear_modulus, radius, adhesion).times(*self.factors)

    def beside(self, materials: Sequence[Sphere]) -> list["Wall"]:
        """Return one wall for each material of a crystal; the first material must be `material`."""
        return [self, *(replace(self, material=each) for each in materials[1:])]

    def law_of(self, crystal: ase.Atoms, materials: Sequence[Sphere], spheres: Integers) -> AdhesionLaw:
        """Return the law of contacts with the wall for spheres (W,) of a crystal, touching or not."""
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
        """Return the wall with infinite moduli and the work of adhesion of the spheres."""
        return cls(material, replace(material, youngs_modulus=inf))

    @property
    def heights(self) -> tuple[float, ...]:
        """Directions from the crystal to the walls along z: −1, or −1 and +1."""
        return (-1.0, 1.0) if self.sides == BOTH else (-1.0,)


@dataclass(frozen=True, eq=False)
class Face:
    """Plane at rest beside a crystal, in contact with its outermost spheres at their places in the lattice.

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
        """Axis normal to the plane, 0 to 2."""
        return int(np.argmax(np.abs(self.outward)))

    @property
    def way(self) -> float:
        """Direction from the crystal to the plane along its axis, −1 or 1."""
        return float(self.outward[self.axis])

    def depth(self, crystal: ase.Atoms) -> Floats:
        """Return the depth of each sphere behind the outermost spheres, (N,), radii."""
        outside = self.way * crystal.positions[:, self.axis]
        return np.asarray(outside.max() - outside)

    def distance(self, crystal: ase.Atoms, radius: float) -> Floats:
        """Return the distances of the spheres at their places from the plane, (N,), in radii; `radius` is R in m."""
        return self.depth(crystal) + 1 - self.overlap / radius

    def touches(self, crystal: ase.Atoms) -> NDArray[np.bool_]:
        """Return which spheres are outermost, (N,)."""
        return self.depth(crystal) < _OUTERMOST


def on_wall(
    contacts: Contacts,
    wall: Wall,
    spheres: Integers,
    overlap: Floats,
    normal: Floats,
    law: AdhesionLaw | None = None,
) -> Contacts:
    """Return contacts followed by the contacts of some spheres with a wall.

    Parameters
    ----------
    contacts : Contacts
        Contacts of the crystal so far.
    wall : Wall
        The wall.
    spheres : (W,) int array
        Indices of the spheres that touch the wall.
    overlap : (W,) array
        Overlaps with the wall, m.
    normal : (3,) array
        Unit vector from the spheres to the wall.
    law : AdhesionLaw, optional
        Law of the contacts (`Wall.law_of`), if spheres have other materials than `Wall.material`.
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
