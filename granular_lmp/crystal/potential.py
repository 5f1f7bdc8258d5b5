"""Energy of a crystal in the plane as a function of where its spheres are and of the size of its box.

A sphere whose place in the lattice is X and whose displacement is u sits at x = (1 + e)(X + u), with the strains
e = (e_x, e_y) of the box. Without friction the energy of the crystal, less the work of the loads T on the box, is

    E(u, e) = Σ_pairs V(δ) + T·e,    V(δ) = (2/5) A δ^{5/2} − F δ where δ > 0, and else 0

so that a contact pushes with A δ^{3/2} − F, the law of `granular_lmp.crystal.contacts`. The energy of an adhesive
contact has a kink at δ = 0, where the DMT force sets in at −F. It is a ridge and not a valley: at rest no pair is just
about to touch, and which pairs touch depends on the way to the rest.

**Digits.** An overlap is the small rest of a distance, 2.5e-4 of it between microspheres. Displacements are therefore
kept apart from places, and the stretch of a pair is taken from the displacements, |d + w| − |d| = w·(2d + w)/(|d + w| +
|d|). Overlaps then have a relative rounding of 1e-12 in a crystal of any size; positions of 1e5 spheres lose 300 times
that.

Units here: length Δ0, force k1 Δ0 and energy k1 Δ0², each of the contact between two spheres of the first material.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.contacts import force_law
from granular_lmp.crystal.search import overlapping
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.errors import CrystalError

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# Pairs that are this far from touching are looked at too, in radii; a next neighbour in the lattices is 0.8 away.
SKIN = 0.4
# Vectors of the lattice that differ by less are one vector, in radii: coordinates are rounded to 1e-13 of them.
_SAME_VECTOR = 1e-8


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of spheres that touch or are near each other, at their places in the lattice.

    Attributes
    ----------
    i, j : (C,) int arrays
    vector : (C, 2) array
        d, from the place of i to that of j or of its image.
    length, overlap : (C,) arrays
        |d|, and δ at these places.
    stiffness, adhesion : (C,) arrays
        A and F; 0 between two held spheres.
    """

    i: Integers
    j: Integers
    vector: Floats
    length: Floats
    overlap: Floats
    stiffness: Floats
    adhesion: Floats


@dataclass(frozen=True, eq=False)
class State:
    """Energy of each pair and the forces, at displacements u (N, 2) and strains e (2,).

    Attributes
    ----------
    vector : (C, 2) array
        From sphere to sphere.
    length, overlap, contact_force, energy : (C,) arrays
        The overlap is negative where there is a gap.
    force : (N, 2) array
        −∂E/∂u; 0 on held spheres.
    stress : (2,) array
        −∂E/∂e, less the loads; 0 along axes on which the box does not breathe.
    """

    u: Floats
    e: Floats
    vector: Floats
    length: Floats
    overlap: Floats
    contact_force: Floats
    energy: Floats
    force: Floats
    stress: Floats


@dataclass(frozen=True, eq=False)
class Potential:
    """What the energy of a crystal depends on; see the module.

    Attributes
    ----------
    crystal : ase.Atoms
        Spheres at their places in the lattice, lengths in radii of the first material.
    materials : tuple of Sphere
    free : (N,) bool array
        Spheres that move on their own; the others move with the box.
    breathing : (2,) bool array
        Axes along which the box does.
    load : (2,) array
        T.
    """

    crystal: ase.Atoms
    materials: tuple[Sphere, ...]
    free: NDArray[np.bool_]
    breathing: NDArray[np.bool_]
    load: Floats

    @cached_property
    def unit(self) -> float:
        """Δ0 in radii."""
        return self.materials[0].static_overlap / self.materials[0].radius

    @cached_property
    def neighbour(self) -> float:
        """2R in Δ0, about the distance of neighbours: how far a strain of 1 moves them against each other."""
        return 2 / self.unit

    def pairs(self, u: Floats, e: Floats) -> Pairs:
        """Return the pairs that touch or are less than `SKIN` apart; two held spheres, which bear all, do not push."""
        wider = displaced(self.crystal, u * self.unit, e)
        radius = self.crystal.arrays["radius"]
        wider.arrays["radius"] = radius + SKIN / 2
        i, j, now = overlapping(wider)
        vector = _lattice_vectors(now[:, :2] / (1 + e) - (u[j] - u[i]) * self.unit)
        length = np.hypot(*vector.T)
        stiffness, _, adhesion = force_law(self.crystal, self.materials, i, j)
        force = self.materials[0].normal_stiffness * self.materials[0].static_overlap
        bearing = self.free[i] | self.free[j]
        return Pairs(
            i=i,
            j=j,
            vector=vector / self.unit,
            length=length / self.unit,
            # 1 + 1 less the length first: between equal spheres of the lattice this is exact
            overlap=((2 - length) + (radius[i] - 1) + (radius[j] - 1)) / self.unit,
            stiffness=bearing * stiffness * self.materials[0].static_overlap ** 1.5 / force,
            adhesion=bearing * adhesion / force,
        )

    def state(self, pairs: Pairs, u: Floats, e: Floats) -> State:
        """Return energies and forces at a displacement and a strain."""
        i, j = pairs.i, pairs.j
        apart = u[j] - u[i]
        apart += e * (pairs.vector + apart)
        vector = pairs.vector + apart
        length = np.hypot(vector[:, 0], vector[:, 1])
        stretch = np.einsum("ca,ca->c", apart, pairs.vector + vector) / (length + pairs.length)
        overlap = pairs.overlap - stretch
        inside = np.maximum(overlap, 0.0)
        repulsion = pairs.stiffness * inside * np.sqrt(inside)
        push = np.where(overlap > 0, repulsion - pairs.adhesion, 0.0)
        along = (push / length)[:, None] * vector
        count = len(self.free)
        force = np.column_stack([np.bincount(j, part, count) - np.bincount(i, part, count) for part in along.T])
        force *= self.free[:, None] * (1 + e)
        stress = np.where(self.breathing, np.einsum("ca,ca->a", along, vector) / (1 + e) - self.load, 0.0)
        energy = inside * (0.4 * repulsion - pairs.adhesion)
        return State(u, e, vector, length, overlap, push, energy, force, stress)

    def stiffness(self, pairs: Pairs, state: State) -> tuple[Any, Floats, Floats]:
        """Return the second derivatives of the energy: by u (sparse, 2N × 2N), by u and e (2N, 2), and by e (2, 2).

        Rows of held spheres, and of axes along which the box does not breathe, are zero.
        """
        import scipy.sparse as sparse  # slow to import, and only crystals at rest need it

        on = np.flatnonzero(state.overlap > 0)
        i, j, length = pairs.i[on], pairs.j[on], state.length[on]
        normal = state.vector[on] / length[:, None]
        sideways = np.column_stack([-normal[:, 1], normal[:, 0]])
        by_u: Any = 0.0
        by_both, by_e = np.zeros((2 * len(self.free), 2)), np.zeros((2, 2))
        springs = [
            (1.5 * pairs.stiffness[on] * np.sqrt(state.overlap[on]), normal),
            (-state.contact_force[on] / length, sideways),
        ]
        columns = np.column_stack([2 * i, 2 * i + 1, 2 * j, 2 * j + 1])
        for spring, direction in springs:
            scaled = direction * (1 + state.e)
            parts = np.hstack([-scaled * self.free[i, None], scaled * self.free[j, None]])
            shape = (len(on), 2 * len(self.free))
            rows = sparse.csr_matrix((parts.ravel(), columns.ravel(), 4 * np.arange(len(on) + 1)), shape)
            strained = direction * state.vector[on] / (1 + state.e) * self.breathing
            weighted = rows.multiply(spring[:, None]).tocsr()
            by_u = by_u + rows.T @ weighted
            by_both += weighted.T @ strained
            by_e += strained.T @ (spring[:, None] * strained)
        # A strain also turns and stretches the displacements themselves; at rest this term is zero
        for axis in range(2):
            by_both[axis::2, axis] -= self.breathing[axis] * state.force[:, axis] / (1 + state.e[axis])
        return by_u, by_both, by_e


def displaced(lattice: ase.Atoms, displacement: Floats, strain: Floats) -> ase.Atoms:
    """Return a crystal with its spheres displaced (N, 2) in radii from their places and its box strained (2,)."""
    moved = lattice.copy()
    scale = np.append(1 + strain, 1.0)
    moved.positions[:, :2] += displacement
    moved.positions *= scale
    moved.cell = moved.cell.array * scale
    moved.set_celldisp(np.ravel(moved.get_celldisp()) * scale)
    return moved


def _lattice_vectors(vector: Floats) -> Floats:
    """Return the vectors (C, 2) with those that differ by rounding only made the same, each the mean of its like.

    A perfect lattice has then exactly the same contact everywhere. Vectors that are not of a lattice stay as they are.
    """
    key = np.round(vector / _SAME_VECTOR)
    # A vector and its opposite are alike too: few contacts cross a periodic face, all rounded in the same way
    sign = np.sign(np.where(key[:, 1] == 0, key[:, 0], key[:, 1]))[:, None]
    _, first, like = np.unique(key * sign, axis=0, return_index=True, return_inverse=True)
    like, vector = like.ravel(), vector * sign
    away = vector - vector[first][like]  # small: a sum of many whole vectors would be rounded more than they are
    count = np.bincount(like)
    mean = np.column_stack([np.bincount(like, part) / count for part in away.T])
    return (vector[first] + mean)[like] * sign


def box_load(lattice: ase.Atoms, sphere: Sphere) -> Floats:
    """Return the loads T (N m, (2,)) that press a lattice together with the force of its sphere in each contact.

        T_a = Σ_contacts F0 d_a²/|d|,    F0 = `Sphere.contact_force`

    It is the force on a face of the box times its distance from the opposite one; contacts between held spheres, which
    bear all, are left out.
    """
    i, j, vector = overlapping(lattice)
    held = lattice.arrays.get("fixed", np.zeros(len(lattice), dtype=bool))
    vector = vector[~(held[i] & held[j]), :2] * sphere.radius
    return sphere.contact_force * np.sum(vector**2 / np.hypot(*vector.T)[:, None], axis=0)


def potential_of(crystal: ase.Atoms, materials: Sequence[Sphere], load: Floats, *, breathes: bool) -> Potential:
    """Return the energy of a crystal under loads on its box (N m).

    Raises
    ------
    CrystalError
        When the spheres are not in one plane z = const, the cell is skew, nothing presses the spheres together, or
        there is a load and no box that could take it.
    """
    first = materials[0]
    if not first.holding_force > 0:
        raise CrystalError(
            f"sphere.work_of_adhesion = {first.work_of_adhesion!r}, contact_force = {first.contact_force!r}: nothing "
            "presses the spheres together; give one of them above 0"
        )
    cell = crystal.cell.array
    if np.ptp(crystal.positions[:, 2]) or crystal.pbc[2] or (cell - np.diag(np.diag(cell))).any():
        raise CrystalError("the crystal is not a sheet in the plane z = const in a rectangular cell, which is needed")
    held = np.asarray(crystal.arrays.get("fixed", np.zeros(len(crystal), dtype=bool)), dtype=bool)
    spread = np.ptp(crystal.positions[held, :2], axis=0) if held.any() else np.zeros(2)
    breathing = (crystal.pbc[:2] | (spread > 0)) & breathes
    energy = first.normal_stiffness * first.static_overlap**2
    if breathes and load.any() and not breathing.any():
        raise CrystalError(
            f"contact_force = {first.contact_force!r}: needs periodic faces or held spheres, on which the load can act"
        )
    return Potential(crystal, tuple(materials), ~held, breathing, np.where(breathing, load / energy, 0.0))
