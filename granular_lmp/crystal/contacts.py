"""Contacts of a crystal at rest, found from its geometry: pairs of spheres, stiffnesses and forces.

By the DMT law, two elastic spheres at an overlap δ have the normal force f_N = A δ^{3/2} − F and, after a slip ξ, the
shear force f_S = B ξ δ^{1/2},

    A = (4/3) E* √Rc,    B = 8 G* √Rc,    F = 2π w Rc
    1/E* = (1−νi²)/Ei + (1−νj²)/Ej,    1/G* = (2−νi)/Gi + (2−νj)/Gj,    Rc = Ri Rj/(Ri + Rj),    w = √(wi wj)

with G = E/(2(1+ν)). For equal spheres these are the constants of `granular_lmp.crystal.sphere.Sphere`. Between two
materials, E* and G* follow contact mechanics (Johnson, Contact Mechanics (1985), sections 4.2 and 7.2), and the
geometric mean for w is the convention of LAMMPS's ``pair_style granular``. If LAMMPS itself mixes two types, it has the
same E* and w but another G*: the style ``mindlin`` with the stiffness NULL uses the mixed modulus as the modulus of
either sphere (``GranSubModTangentialMindlin::coeffs_to_local``). Two materials therefore need their own ``pair_coeff``
(a test in LAMMPS measures both). The JKR law has the same constants (`granular_lmp.crystal.adhesion_laws`). All
materials of a crystal have the same law.

`Contacts` uses SI units; lengths of the crystal are in radii of its first material.
"""

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.adhesion_laws import ADHESION_LAWS, AdhesionLaw
from granular_lmp.crystal.blocks import blocks
from granular_lmp.crystal.search import overlapping
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.frozen import cached_property, dataclass

__all__ = ["Contacts", "find_contacts"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# Tolerances between overlaps from positions and overlaps from a declared force: relative, and for rounding, in radii
SAME_OVERLAP = 1e-3
ROUNDING = 1e-9
# Key in `ase.Atoms.info` of the factors of normal and shear forces, (M, M + 1, 2), by pair of materials, walls last
FACTORS = "factors"


@dataclass(frozen=True, eq=False)
class Contacts:
    """Contacts of N spheres at rest, each listed once, and the spheres themselves; in SI units.

    Attributes
    ----------
    i, j : (C,) int arrays
        The two spheres of each contact; i = j if a sphere touches its own periodic image, j = −1 if i touches a rigid
        wall at rest.
    vector : (C, 3) array
        Vector from the centre of i to the centre of j across periodic faces, or to the foot point on the wall, m.
    overlap : (C,) array
        Overlap δ, m.
    normal_stiffness, shear_stiffness : (C,) arrays
        Derivatives of f_N by the overlap, (3/2) A √δ in DMT, and of f_S by the slip, B √δ in DMT; N/m.
    adhesive_force : (C,) array
        Pull F that separates the two spheres, N; the adhesive force of the DMT law.
    contact_force : (C,) array
        Prestress f_N, N: the force between the two spheres at rest.
    radius, mass : (N,) arrays
        Radius and mass of the spheres, m and kg.

    Notes
    -----
    The arrays are read-only.
    """

    i: Integers
    j: Integers
    vector: Floats
    overlap: Floats
    normal_stiffness: Floats
    shear_stiffness: Floats
    adhesive_force: Floats
    contact_force: Floats
    radius: Floats
    mass: Floats

    def __post_init__(self) -> None:
        for field in fields(self):
            getattr(self, field.name).setflags(write=False)  # because callers share one cached record

    def __len__(self) -> int:
        return len(self.i)

    def parts(self) -> "Iterator[Contacts]":
        """Yield the contacts in successive parts; each part has all spheres."""
        per_contact = [each.name for each in fields(self) if each.name not in ("radius", "mass")]
        for block in blocks(len(self)):
            yield replace(self, **{name: getattr(self, name)[block] for name in per_contact})

    @cached_property
    def on_wall(self) -> NDArray[np.bool_]:
        """True for the contacts with a wall, (C,)."""
        return self.j < 0

    @cached_property
    def length(self) -> Floats:
        """Distances of the centres, (C,), m."""
        return np.linalg.norm(self.vector, axis=1)

    @cached_property
    def normals(self) -> Floats:
        """Unit vectors from i to j, (C, 3)."""
        return self.vector / self.length[:, None]

    @cached_property
    def tangents(self) -> Floats:
        """Two unit vectors t1, t2 = n × t1 across each contact, (C, 2, 3).

        For contacts in a plane z = const t1 = ẑ × n, the normal turned by +90° in that plane.
        """
        upright = np.abs(self.normals[:, 2:]) > 0.9  # where ẑ × n would lose digits
        first = np.cross(np.where(upright, [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]), self.normals)
        first /= np.linalg.norm(first, axis=1)[:, None]
        return np.stack([first, np.cross(self.normals, first)], axis=1)

    @cached_property
    def turns(self) -> Floats:
        """Axes n × t of the rotations that move a surface along each tangent, (C, 2, 3)."""
        second = self.tangents[:, 1]  # n × t1
        return np.stack([second, np.cross(self.normals, second)], axis=1)

    @cached_property
    def radii(self) -> Floats:
        """Ri + Rj of each contact, (C,), m; Ri at a wall."""
        return self.radius[self.i] + np.where(self.on_wall, 0.0, self.radius[self.j])

    @cached_property
    def per_sphere(self) -> Integers:
        """Number of contacts of each sphere, (N,)."""
        others = self.j[~self.on_wall] if self.on_wall.any() else self.j
        return np.bincount(self.i, minlength=len(self.mass)) + np.bincount(others, minlength=len(self.mass))


def find_contacts(crystal: ase.Atoms, materials: Sequence[Sphere], contact_force: float | None = None) -> Contacts:
    """Find the contacts of a crystal at rest, with any cell, basis, radii and materials, periodic or not.

    Spheres that overlap are in contact. JKR contacts that are stretched beyond overlap 0 cannot be found from
    positions; for a relaxed crystal they are in `granular_lmp.crystal.equilibrium.Equilibrium.contacts`.

    Parameters
    ----------
    crystal : ase.Atoms
        Positions and the array ``radius`` in radii of the first material. Optional arrays: ``material``, the index
        into `materials` (default 0), and ``density``, kg/m³ (default: of the material).
    materials : sequence of Sphere
        Moduli, work of adhesion and density of each material; the radius of the first is the unit of length.
    contact_force : float, optional
        Force f_N of every contact, N, if all are equal, as in a perfect lattice. The overlaps then follow from the
        force to the last digit, and the positions, which resolve an overlap to 12 digits, only determine the pairs.

    Returns
    -------
    Contacts

    Raises
    ------
    ValueError
        If the overlaps of the positions differ from those of `contact_force`, or two materials have different adhesion
        laws.
    """
    unit = materials[0].radius
    i, j, vector = overlapping(crystal)
    vector = vector * unit
    overlap = unit * (crystal.arrays["radius"][i] + crystal.arrays["radius"][j]) - np.linalg.norm(vector, axis=1)
    return contacts_between(crystal, materials, i, j, vector, overlap, contact_force)


def contacts_between(
    crystal: ase.Atoms,
    materials: Sequence[Sphere],
    i: Integers,
    j: Integers,
    vector: Floats,
    overlap: Floats,
    contact_force: float | None = None,
) -> Contacts:
    """Return the contacts of pairs of spheres that are known to overlap, as `find_contacts` does.

    Parameters
    ----------
    crystal, materials, contact_force
        As for `find_contacts`; the positions are not used.
    i, j : (C,) int arrays
    vector : (C, 3) array
        m.
    overlap : (C,) array
        m.

    Raises
    ------
    ValueError
        If the overlaps differ from those of `contact_force`, or two materials have different adhesion laws or factors.
    """
    law = law_between(crystal, materials, i, j)
    if contact_force is None:
        force = law.force(overlap)
    else:
        force = np.full(len(i), float(contact_force))
        overlap = _of_force(law.overlap_under(contact_force), overlap, materials[0].radius, contact_force)
    radius = crystal.arrays["radius"] * materials[0].radius
    density = crystal.arrays.get("density", _each(materials, _material(crystal), "density"))
    return Contacts(
        i=i,
        j=j,
        vector=vector,
        overlap=overlap,
        normal_stiffness=law.normal_stiffness(overlap),
        shear_stiffness=law.shear_stiffness(overlap),
        adhesive_force=law.pull_off_force,
        contact_force=force,
        radius=radius,
        mass=4 / 3 * np.pi * radius**3 * density,
    )


def law_between(crystal: ase.Atoms, materials: Sequence[Sphere], i: Integers, j: Integers) -> AdhesionLaw:
    """Return the law of the contacts of pairs of spheres, (C,), whether they touch or not.

    Raises
    ------
    ValueError
        If two materials have different adhesion laws or different factors.
    """
    first = materials[0]
    for name in ("adhesion_law", "factors"):
        if len(found := {getattr(each, name) for each in materials}) > 1:
            raise ValueError(
                f"{name} = {', '.join(map(str, sorted(found)))}: must be the same for all materials of a crystal"
            )
    radius, material = crystal.arrays["radius"] * first.radius, _material(crystal)
    effective_radius = radius[i] * radius[j] / (radius[i] + radius[j])
    modulus, shear_modulus, adhesion = _mixed(materials, material[i], material[j])
    law = ADHESION_LAWS[first.adhesion_law].between(modulus, shear_modulus, effective_radius, adhesion)
    return times_factors(law.times(*first.factors), crystal, i, j)


def times_factors(law: AdhesionLaw, crystal: ase.Atoms, i: Integers, j: Integers | int) -> AdhesionLaw:
    """Return the law of contacts, scaled by the factors of their materials (`granular_lmp.crystal.stiffnesses`).

    `j` is −1 for walls. Without factors the law is unchanged.
    """
    factors, material = crystal.info.get(FACTORS), _material(crystal)
    if factors is None:
        return law
    other = np.where(np.asarray(j) < 0, -1, material[j])
    return law.times(*np.moveaxis(factors[material[i], other], -1, 0))


def equivalent(one: Sphere, other: Sphere) -> Sphere:
    """Return the sphere whose contact with an equal sphere has E*, G* and w of the contact between two materials.

    E = 2(1−ν²)E* and ν = (2−2κ)/(2−κ) with κ = 4G*/E*. Radius, density and factors are those of `one`.
    """
    if one == other:
        return one
    modulus, shear_modulus, adhesion = (float(each[0]) for each in mixed(one, other))
    kappa = 4 * shear_modulus / modulus
    number = (2 - 2 * kappa) / (2 - kappa)
    return replace(one, youngs_modulus=2 * (1 - number**2) * modulus, poisson_ratio=number, work_of_adhesion=adhesion)


def mixed(one: Sphere, other: Sphere) -> tuple[Floats, Floats, Floats]:
    """Return E*, G* and w of the contact between two materials, each (1,)."""
    return _of_pairs((one, other), np.array([0]), np.array([1]))


def _material(crystal: ase.Atoms) -> Integers:
    """Return the index of the material of each sphere."""
    return crystal.arrays.get("material", np.zeros(len(crystal), dtype=int))


def _each(materials: Sequence[Sphere], material: Integers, name: str) -> Floats:
    """Return an attribute of the material of each sphere."""
    return np.array([getattr(each, name) for each in materials], dtype=float)[material]


def _mixed(materials: Sequence[Sphere], one: Integers, other: Integers) -> tuple[Floats, Floats, Floats]:
    """Return E*, G* and w for pairs of materials, each (C,), or (1,) if there is a single material."""
    of_kinds = _of_pairs(materials, *np.indices((len(materials),) * 2).reshape(2, -1))
    if len(materials) == 1:
        return of_kinds
    kind = one * len(materials) + other
    return of_kinds[0][kind], of_kinds[1][kind], of_kinds[2][kind]


def _of_pairs(materials: Sequence[Sphere], one: Integers, other: Integers) -> tuple[Floats, Floats, Floats]:
    """Return E*, G* and w, each (C,), between the materials `one` (C,) and `other` (C,), by index."""
    (Ei, Ej), (nui, nuj), (wi, wj) = (
        (_each(materials, one, name), _each(materials, other, name))
        for name in ("youngs_modulus", "poisson_ratio", "work_of_adhesion")
    )
    Gi, Gj = Ei / (2 * (1 + nui)), Ej / (2 * (1 + nuj))
    return 1 / ((1 - nui**2) / Ei + (1 - nuj**2) / Ej), 1 / ((2 - nui) / Gi + (2 - nuj) / Gj), np.sqrt(wi * wj)


def _of_force(overlap: Floats, geometric: Floats, unit: float, contact_force: float) -> Floats:
    """Return the overlaps from a force; ValueError if they differ from the overlaps of the positions."""
    wrong = np.abs(overlap - geometric) > SAME_OVERLAP * overlap + ROUNDING * unit
    if wrong.any():
        first = int(np.argmax(wrong))
        raise ValueError(
            f"contact_force = {contact_force!r}: causes an overlap of {overlap[first]:.6g} m, but the positions of "
            f"contact {first} have {geometric[first]:.6g} m; leave contact_force out, or give the force of this crystal"
        )
    return overlap
