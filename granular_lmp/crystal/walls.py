"""Walls at rest at the faces of a crystal: the contact of a sphere with the plane face of a half-space.

It has the law of two spheres (`granular_lmp.crystal.adhesion_laws`) with the effective radius R in place of R/2, the
moduli 1/E* = (1−ν₁²)/E₁ + (1−ν₂²)/E₂ and 1/G* = (2−ν₁)/G₁ + (2−ν₂)/G₂, and w = √(w₁w₂). Of one material, by the DMT law
and without a load, the overlap is 2^{1/3} times that of two spheres and both stiffnesses are 2^{2/3} times theirs.

Where stiffnesses were measured, the law's force is scaled at the same overlap: f_N by the measured over the computed
normal stiffness at rest, f_S by that of the shear stiffnesses.

A wall is at rest. A half-space that moves with the spheres radiates: a vertical resonance has Q = ρ c_l/(N m ω), about
11 for silica on silica, which a rigid wall does not show.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import inf

import numpy as np

from granular_lmp.crystal.adhesion_laws import ADHESION_LAWS, AdhesionLaw
from granular_lmp.crystal.contacts import Contacts, Floats, Integers, mixed
from granular_lmp.crystal.sphere import Sphere

BELOW, BOTH = "below", "both"


@dataclass(frozen=True)
class Wall:
    """The half-space that spheres of one material touch.

    Attributes
    ----------
    material : Sphere
        The spheres, of the reference radius R.
    substrate : Sphere
        Moduli and work of adhesion of the half-space; its radius does not count.
    normal_stiffness, shear_stiffness : float, optional
        Measured stiffnesses at rest of a sphere of the reference radius, N/m.
    sides : "below" or "both"
        Where the half-spaces are: at −z, or at −z and +z.
    """

    material: Sphere
    substrate: Sphere
    normal_stiffness: float | None = None
    shear_stiffness: float | None = None
    sides: str = BELOW

    def law(self, radius: Floats | float) -> AdhesionLaw:
        """Return the law of the contacts of spheres of these radii, m."""
        bare = self._computed(radius)
        rest = self._computed(self.material.radius)
        overlap = rest.overlap_under(0.0)
        normal, shear = (
            1.0 if measured is None else measured / float(computed)
            for measured, computed in (
                (self.normal_stiffness, rest.normal_stiffness(overlap)),
                (self.shear_stiffness, rest.shear_stiffness(overlap)),
            )
        )
        return replace(
            bare,
            normal_coefficient=bare.normal_coefficient * normal,
            shear_coefficient=bare.shear_coefficient * shear,
            pull_off_force=bare.pull_off_force * normal,
        )

    def _computed(self, radius: Floats | float) -> AdhesionLaw:
        law = ADHESION_LAWS[self.material.adhesion_law]
        modulus, shear_modulus, adhesion = (float(each[0]) for each in mixed(self.material, self.substrate))
        return law.between(modulus, shear_modulus, radius, adhesion)

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


def on_wall(contacts: Contacts, wall: Wall, spheres: Integers, overlap: Floats, normal: Floats) -> Contacts:
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
    """
    radius = contacts.radius[spheres]
    law = wall.law(radius)
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
