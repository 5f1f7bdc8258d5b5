"""Energy of a crystal as a function of the positions of its spheres and of the size of its box.

A sphere with the place X in the lattice and the displacement u is at x = (1 + e)(X + u), where e are the strains of the
box. All have D components: 3 in space, 2 for spheres that stay in their plane. Without friction the energy of the
crystal, minus the work of the loads T on the box, is

    E(u, e) = Σ_pairs V(δ) + T·e,    V(δ) = ∫ f_N dδ from where the contact ends, and 0 beyond

with the force f_N of the contact law (`granular_lmp.crystal.adhesion_laws`), A δ^{3/2} − F by the DMT law. The energy
of an adhesive contact has a kink where the contact ends, at δ = 0 by the DMT law, because the force begins with −F
there. The kink is a ridge, not a valley: at rest no pair is just about to part, and the path to the rest determines
which pairs touch.

A JKR contact begins at δ = 0 and ends beyond. During relaxation it begins where it ends: spheres that come to rest
within the pull-off distance of each other adhere, as if they had been pressed together before. Otherwise the energy
would not be a function of the positions. The deck passes the contacts to LAMMPS in the same way (page Contact laws).

**Digits.** An overlap is a small difference of distances, 2.5e-4 of a distance between microspheres. Displacements are
therefore stored separately from places, and give the stretch of a pair: |d + w| − |d| = w·(2d + w)/(|d + w| + |d|).
Overlaps then have a relative rounding of 1e-12 in a crystal of any size; with positions it would be 300 times as large
for 1e5 spheres.

**Walls** (`Face`) are planes at rest. All walls together are one body after the N spheres, which does not move on its
own. A sphere at a wall is a pair with this body; its vector has only a component normal to the wall. A plane moves with
the box, as held spheres do.

Units here: length Δ0, force k1 Δ0 and energy k1 Δ0², each of the contact between two spheres of the first material.
"""

from collections.abc import Callable, Sequence
from functools import reduce

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.adhesion_laws import AdhesionLaw, joined
from granular_lmp.crystal.contacts import find_contacts, law_between
from granular_lmp.crystal.search import lattice_vectors, overlapping
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.walls import Face, on_wall
from granular_lmp.errors import CrystalError
from granular_lmp.frozen import cached_property, dataclass

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# Largest gap of listed pairs, in radii; the second neighbours in the lattices have a gap of 0.8
SKIN = 0.4


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of spheres that touch or are near each other or a wall, at their places in the lattice.

    Attributes
    ----------
    i, j : (C,) int arrays
        Spheres of each pair; pairs with walls come last and have j = N.
    vector : (D, C) array
        d, from the place of i to the place of j or of its image, or to the foot point on the wall.
    length, overlap : (C,) arrays
        |d|, and δ at these places.
    law : AdhesionLaw
        Law of each contact.
    bearing : (C,) bool array
        False between two held spheres, whose contact has no force here.
    face : (W,) int array
        Index of the wall of each of the last W pairs.
    searched : ((N, D) array, (D,) array)
        u and e at which the pairs were searched.
    """

    i: Integers
    j: Integers
    vector: Floats
    length: Floats
    overlap: Floats
    law: AdhesionLaw
    bearing: NDArray[np.bool_]
    face: Integers
    searched: tuple[Floats, Floats]

    @property
    def between(self) -> int:
        """Number of pairs of two spheres, which come first."""
        return len(self.i) - len(self.face)

    def of(self, which: Integers) -> "Pairs":
        """Return some of the pairs, selected by ascending indices."""
        return Pairs(
            i=self.i[which],
            j=self.j[which],
            vector=np.ascontiguousarray(self.vector[:, which]),
            length=self.length[which],
            overlap=self.overlap[which],
            law=self.law.of(which),
            bearing=self.bearing[which],
            face=self.face[which[which >= self.between] - self.between],
            searched=self.searched,
        )


@dataclass(frozen=True, eq=False)
class State:
    """Forces of pairs and on spheres, at displacements u (N, D) and strains e (D,).

    Attributes
    ----------
    pairs : Pairs
        Pairs of the crystal.
    u, e : (N, D) and (D,) arrays
        Displacements and strains.
    vector : (D, C) array
        Vector from sphere to sphere.
    length, overlap, contact_force : (C,) arrays
        Length of the vector, overlap (negative for a gap) and f_N of each pair.
    force : (N, D) array
        −∂E/∂u; 0 on held spheres.
    stress : (D,) array
        −∂E/∂e, which includes the loads; 0 along axes along which the box keeps its length.
    """

    pairs: Pairs
    u: Floats
    e: Floats
    vector: Floats
    length: Floats
    overlap: Floats
    contact_force: Floats
    force: Floats
    stress: Floats

    @cached_property
    def energy(self) -> Floats:
        """Energy of each pair, (C,); computed on demand, because most steps of a relaxation do not use it."""
        return np.asarray(self.pairs.bearing * self.pairs.law.energy(self.overlap))

    @property
    def normal_stiffness(self) -> Floats:
        """d²V/dδ² of each pair, (C,), 0 for a pair that does not touch."""
        return self._closed(self.pairs.law.normal_stiffness)

    @property
    def shear_stiffness(self) -> Floats:
        """df_S/ds of each pair, (C,), 0 for a pair that does not touch."""
        return self._closed(self.pairs.law.shear_stiffness)

    def _closed(self, stiffness: Callable[[Floats], Floats]) -> Floats:
        law = self.pairs.law
        return np.asarray(self.pairs.bearing & law.closed(self.overlap)) * stiffness(law.nearest(self.overlap))

    @property
    def stiffness_across(self) -> Floats:
        """Stiffness −f_N/|d| of each pair across the contact, (C,); negative for contacts that push."""
        return -self.contact_force / self.length

    @property
    def all_forces(self) -> Floats:
        """Forces on all u, followed by the forces on e, (DN + D,)."""
        return np.append(self.force, self.stress)


@dataclass(frozen=True, eq=False)
class Potential:
    """Energy of a crystal with its parameters; see the module.

    Attributes
    ----------
    crystal : ase.Atoms
        Spheres at their places in the lattice, lengths in radii of the first material.
    materials : tuple of Sphere
        Materials by index.
    free : (N,) bool array
        True for spheres that move on their own; the others move with the box. With walls there is one more body,
        (N + 1,).
    breathing : (D,) bool array
        True for axes along which the box changes its length.
    load : (D,) array
        Loads T, in k1 Δ0².
    faces : tuple of Face
        Walls.
    """

    crystal: ase.Atoms
    materials: tuple[Sphere, ...]
    free: NDArray[np.bool_]
    breathing: NDArray[np.bool_]
    load: Floats
    faces: tuple[Face, ...] = ()

    @property
    def axes(self) -> int:
        """D, the dimensions in which spheres move."""
        return len(self.load)

    @cached_property
    def unit(self) -> float:
        """Δ0 in radii."""
        return self.materials[0].static_overlap / self.materials[0].radius

    @cached_property
    def neighbour(self) -> float:
        """2R in Δ0, approximately the distance of neighbours and thus their relative displacement by a strain of 1."""
        return 2 / self.unit

    @cached_property
    def mass(self) -> Floats:
        """Mass 1 of every u and N (2R)² of each e, so that a strain counts as much as the motion that it causes."""
        return np.append(np.ones(self.axes * len(self.free)), np.full(self.axes, len(self.free) * self.neighbour**2))

    def energy(self, state: State) -> float:
        """Return E, k1 Δ0², which falls on the path to rest."""
        return float(np.sum(state.energy) + self.load @ state.e)

    def energy_change(self, before: State, after: State) -> float:
        """Return the change of E between two states."""
        e = after.e - before.e
        # Pair by pair, because sums over a large crystal lose the last digits of a small change
        change = float(np.sum(after.energy - before.energy) + self.load @ e)
        if abs(change) > 1e-14 * len(before.energy):
            return change
        # Smaller changes, which are still lost to rounding, follow from the work of the forces
        u = after.u - before.u
        return -0.5 * float(np.sum((before.force + after.force) * u) + np.sum((before.stress + after.stress) * e))

    def residual(self, state: State) -> float:
        """Return the largest force on a free sphere, or the force of the box per sphere if this is larger, in k1 Δ0."""
        on_box = state.stress / self.neighbour / len(state.u)
        return float(max(np.abs(state.force).max(), np.abs(on_box).max()))

    def renewed(self, state: State) -> State:
        """Return the state with a new search of pairs if a pair could be missed soon; otherwise the same object."""
        u, e = state.pairs.searched
        # A strain moves neighbours by this share of their distance, which is about two radii
        moved = np.abs(state.u - u).max() * self.unit + np.abs(state.e - e).max() * 2
        return state if moved <= SKIN / 4 else self.at(state.u, state.e)

    def start(self) -> State:
        """Return the state from which spheres are released: at their places, or against the wall that they touch."""
        u, beside = np.zeros((len(self.free), self.axes)), [face.touches(self.crystal) for face in self.faces]
        larger = (self.crystal.arrays["radius"] - 1) / self.unit
        for face, touches in zip(self.faces, beside, strict=True):
            alone = np.flatnonzero(touches & (np.sum(beside, axis=0) == 1))
            u[alone, face.axis] = -face.way * larger[alone]
        return self.at(u, np.zeros(self.axes))

    def at(self, u: Floats, e: Floats) -> State:
        """Return the state at displacements and strains, with the pairs that are near each other there."""
        return self.state(self.pairs(u, e), u, e)

    def pairs(self, u: Floats, e: Floats) -> Pairs:
        """Return the pairs that touch or are less than `SKIN` apart; pairs of two held spheres do not push."""
        wider = displaced(self.crystal, u[: len(self.crystal)] * self.unit, e)
        radius = self.crystal.arrays["radius"]
        wider.arrays["radius"] = radius + SKIN / 2
        i, j, now = overlapping(wider)
        vector = lattice_vectors(now[:, : self.axes] / (1 + e) - (u[j] - u[i]) * self.unit)
        length = reduce(np.hypot, vector.T)
        # 2 − length comes first, because it is exact for equal spheres of the lattice
        overlap = (2 - length) + (radius[i] - 1) + (radius[j] - 1)
        laws, face = [law_between(self.crystal, self.materials, i, j)], np.empty(0, dtype=int)
        for number, each in enumerate(self.faces):
            distance = each.distance(self.crystal, self.materials[0].radius)
            near = np.flatnonzero(radius - distance + each.way * u[:-1, each.axis] * self.unit > -SKIN)
            across = np.zeros((len(near), self.axes))
            across[:, each.axis] = each.way * distance[near]
            i, j = np.append(i, near), np.append(j, np.full(len(near), len(self.crystal)))
            vector, length = np.vstack([vector, across]), np.append(length, distance[near])
            deep = each.overlap / self.materials[0].radius - each.depth(self.crystal) + (radius - 1)
            overlap, face = np.append(overlap, deep[near]), np.append(face, np.full(len(near), number))
            laws.append(each.wall.law_of(self.crystal, self.materials, near))
        unit = self.materials[0].static_overlap
        force = self.materials[0].normal_stiffness * unit
        return Pairs(
            i=i,
            j=j,
            vector=np.ascontiguousarray(vector.T) / self.unit,
            length=length / self.unit,
            overlap=overlap / self.unit,
            law=joined(laws).scaled(unit, force),
            bearing=self.free[i] | self.free[j],
            face=face,
            searched=(u, e),
        )

    def state(self, pairs: Pairs, u: Floats, e: Floats) -> State:
        """Return the state, with its forces, at displacements and strains."""
        # In place, because the many steps of a relaxation spend most time here
        count, scale, place = len(u), (1 + e)[:, None], pairs.vector
        along_axes = np.ascontiguousarray(u.T)
        apart = along_axes.take(pairs.j, axis=1)
        apart -= along_axes.take(pairs.i, axis=1)
        if e.any():
            apart *= scale
            apart += e[:, None] * place
        if len(pairs.face):  # the foot point on a wall follows the sphere along the wall
            apart[:, pairs.between :] *= place[:, pairs.between :] != 0
        vector = place + apart
        apart *= vector + place
        length = np.sqrt(np.add.reduce(vector * vector))
        overlap = np.add.reduce(apart)  # |d + w|² − |d|²
        overlap /= length + pairs.length
        np.subtract(pairs.overlap, overlap, out=overlap)
        push = pairs.law.push(overlap)
        push *= pairs.bearing
        along = push / length * vector
        force, stress = np.empty_like(u), np.zeros(self.axes)
        for axis, part in enumerate(along):
            force[:, axis] = np.bincount(pairs.j, part, count) - np.bincount(pairs.i, part, count)
            if self.breathing[axis]:
                stress[axis] = np.einsum("c,c", part, vector[axis]) / (1 + e[axis]) - self.load[axis]
        force *= self.free[:, None] * scale.T
        return State(pairs, u, e, vector, length, overlap, push, force, stress)


def displaced(lattice: ase.Atoms, displacement: Floats, strain: Floats) -> ase.Atoms:
    """Return a crystal with its spheres displaced (N, D) in radii from their places and its box strained (D,)."""
    moved = lattice.copy()
    scale = np.append(1 + strain, np.ones(3 - len(strain)))
    moved.positions[:, : len(strain)] += displacement
    moved.positions *= scale
    moved.cell = moved.cell.array * scale
    moved.set_celldisp(np.ravel(moved.get_celldisp()) * scale)
    return moved


def box_load(lattice: ase.Atoms, sphere: Sphere, faces: Sequence[Face] = (), axes: int = 2) -> Floats:
    """Return the loads T (D,), N m, that compress a lattice with the contact force of its sphere in each contact.

        T_a = Σ_contacts f d_a²/|d|,    f = `Sphere.contact_force` between spheres

    A load is the force on a face of the box times the distance of the opposite face. Contacts between held spheres are
    left out, because these spheres bear any load.
    """
    held = lattice.arrays.get("fixed", np.zeros(len(lattice), dtype=bool))
    contacts = find_contacts(lattice, [sphere], sphere.contact_force)
    for face in faces:
        spheres = np.flatnonzero(face.touches(lattice))
        contacts = on_wall(contacts, face.wall, spheres, np.full(len(spheres), face.overlap), face.outward)
    bearing = ~(held[contacts.i] & (held[contacts.j] | contacts.on_wall))
    return np.asarray(contacts.vector.T**2 @ (bearing * contacts.contact_force / contacts.length))[:axes]


def potential_of(
    crystal: ase.Atoms,
    materials: Sequence[Sphere],
    load: Floats,
    *,
    breathes: bool,
    faces: Sequence[Face] = (),
) -> Potential:
    """Return the energy of a crystal under loads (D,) on its box (N m).

    Raises
    ------
    CrystalError
        If the cell is not rectangular, spheres that stay in their plane have different z, neither adhesion nor a
        contact force presses the spheres together, or there is a load but no axis along which the box can bear it.
    """
    first = materials[0]
    if not first.holding_force > 0:
        raise CrystalError(
            f"sphere.work_of_adhesion = {first.work_of_adhesion!r}, contact_force = {first.contact_force!r}: nothing "
            "presses the spheres together; give one of them above 0"
        )
    cell, axes = crystal.cell.array, len(load)
    sheet = axes == 3 or not (np.ptp(crystal.positions[:, 2]) or crystal.pbc[2])
    if not sheet or (cell - np.diag(np.diag(cell))).any():
        raise CrystalError("the crystal must be a sheet in a plane z = const, in a rectangular cell")
    held = np.asarray(crystal.arrays.get("fixed", np.zeros(len(crystal), dtype=bool)), dtype=bool)
    breathing = (crystal.pbc[:axes] | _bounded(crystal.positions[held], faces)[:axes]) & breathes
    energy = first.normal_stiffness * first.static_overlap**2
    if breathes and load.any() and not breathing.any():
        raise CrystalError(
            f"contact_force = {first.contact_force!r}: needs periodic faces or held spheres, on which the load can act"
        )
    free = np.append(~held, np.zeros(int(bool(faces)), dtype=bool))
    return Potential(crystal, tuple(materials), free, breathing, np.where(breathing, load / energy, 0.0), tuple(faces))


def _bounded(held: Floats, faces: Sequence[Face]) -> NDArray[np.bool_]:
    """Return the axes along which the box ends on both sides, (3,): by held spheres or walls, along z only by walls."""
    walls = np.bincount([face.axis for face in faces], minlength=3)
    spread = np.ptp(held, axis=0) > 0 if len(held) else np.zeros(3, dtype=bool)
    both = spread | (len(held) > 0) & (walls > 0)
    return np.asarray(np.append(both[:2], False) | (walls > 1))
