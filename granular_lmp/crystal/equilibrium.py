"""Relaxation of a crystal: spheres released at their places in a lattice move until all forces balance.

With adhesion the rest depends on the path to it: two spheres that have separated do not come together again, and all
forces can balance in many arrangements of open and closed contacts. The path is therefore part of the definition of
the crystal:

1. *Let go.* The spheres start at rest at their places in the lattice and move against a drag. In units of the contact
   between two spheres of the first material every sphere has mass 1 and drag coefficient 1, which damps nearly
   critically. The box is heavy, with an inertia of 100 N (2R)², and is damped so that it does not oscillate: it changes
   slowly compared with the spheres, in a crystal of any size.
2. *Balance.* Once the root mean square force is small, damped Newton steps, each of which lowers the energy, lead to
   the rest. Alternatively the spheres around each contact that opens are let go again: large crystals then take a fifth
   to a third of the time, and get different contacts (`granular_lmp.crystal.balance`).

LAMMPS is not faster. For 1e4 spheres with s = 2 and 4 its damped motion (``nve``, ``viscous`` and ``press/berendsen``)
with the necessary Newton steps takes 6.4 and 8.5 s of processor time, the method above 4.7 and 8.5 s, and 4 and 9 % of
the contacts differ. ``min_style fire`` does not support a box that relaxes. In a fixed box it takes 19 s at s = 0.4,
with forces still above `BALANCED`, where the method above takes 0.5 s.

The relaxation has no friction or rotation. With a coefficient of friction the spheres are let go twice: first with
shear springs that slide at the Coulomb limit (`granular_lmp.crystal.friction`), then without, as above, from their new
places. The springs are removed in between because LAMMPS starts every contact without shear, so places where springs
carry a part of the load would not be at rest. The final rest has no torques, since no contact has shear.

A crystal that was compressed, dried or shaken before has different contacts. To start from a compressed crystal, pass a
crystal whose places and cell are scaled by less than 1; to start from the rest in a fixed box, pass the ``crystal`` of
that rest. The case "disorder" compares them.

On one machine a crystal is reproducible to the last bit. Between machines rounding can decide which of two contacts
opens first: of twelve crystals of 1020 spheres with s from 0.8 to 12, one with s = 12 got different contacts with
OpenBLAS kernels for another processor. In the other crystals, spheres with two or more contacts agreed to 4e-8 Δ0;
spheres with a single contact, which roll without force, agreed to 2e-5 Δ0. Twelve crystals with other seeds all kept
their contacts, and the places in one with s = 12 differed by 4e-7 Δ0.
"""

from collections.abc import Sequence
from typing import Any

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.balance import BALANCED, RULES, balance
from granular_lmp.crystal.contacts import Contacts, contacts_between
from granular_lmp.crystal.disorder import BOXES, WAYS, WHOLE, require_places
from granular_lmp.crystal.friction import require_friction
from granular_lmp.crystal.let_go import DRAG, SETTLED, Progress, let_go
from granular_lmp.crystal.potential import Potential, State, displaced, potential_of
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.walls import Face, on_wall
from granular_lmp.errors import CrystalError
from granular_lmp.frozen import dataclass

__all__ = ["relax"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Crystal at rest.

    Attributes
    ----------
    lattice : ase.Atoms
        Spheres at their places X in the lattice, lengths in radii of the first material; its ``info`` has the disorder
        and the seed.
    displacement : (N, 3) array
        Displacement u from these places, radii, to full precision; a sphere is at rest at (1 + e)(X + u).
    strain : (3,) array
        Strain e of the box; 0 along axes along which the box keeps its length.
    contacts : Contacts
        Contacts with overlaps to 12 digits, even if the positions have fewer; contacts with walls come last.
    box_load : (2,) array, in space (3,)
        Σ f d_a²/|d|, N m: the load that the contacts bear; divided by the length of the box, the force on its faces.
    residual : float
        Largest force on a free sphere, in k1 Δ0 of the first material.
    rattlers : int
        Number of free spheres without any contact, which stay where they are.
    lifted : int
        Number of free spheres that touched a wall at their places, but not at rest.
    steps : int
        Number of Newton steps, or of steps by avalanches.
    protocol : str
        Description of the relaxation.
    """

    lattice: ase.Atoms
    displacement: Floats
    strain: Floats
    contacts: Contacts
    box_load: Floats
    residual: float
    rattlers: int
    lifted: int
    steps: int
    protocol: str

    @property
    def crystal(self) -> ase.Atoms:
        """The crystal at rest, with positions rounded to double precision."""
        return displaced(self.lattice, self.displacement, self.strain)

    @property
    def contacts_per_sphere(self) -> float:
        """Mean number Z of contacts per sphere; a contact with a wall counts for its sphere."""
        return float(self.contacts.per_sphere.sum() / len(self.lattice))

    def summary(self) -> dict[str, Any]:
        """Return the properties that identify this rest, as plain numbers and text.

        ``disorder`` (spreads and seed) and ``isolated`` come from `granular_lmp.crystal.disorder.imperfect`, and are
        None for other crystals; ``residual`` is in k1 Δ0, ``box`` in radii, ``box_load`` in N m.
        """
        info, axes = self.lattice.info, len(self.box_load)
        return {
            "protocol": self.protocol,
            "disorder": info.get("disorder"),
            "spheres": len(self.lattice),
            "isolated": info.get("isolated"),
            "rattlers": self.rattlers,
            "contacts_per_sphere": self.contacts_per_sphere,
            "residual": self.residual,
            "newton_steps": self.steps,
            "box": (np.diag(self.lattice.cell.array) * (1 + self.strain))[:axes].tolist(),
            "strain": self.strain[:axes].tolist(),
            "box_load": self.box_load.tolist(),
        }


def relax(
    crystal: ase.Atoms,
    materials: Sequence[Sphere],
    *,
    box: str = "box",
    load: Floats | None = None,
    friction: float = 0.0,
    by: str = WHOLE,
    faces: Sequence[Face] = (),
    space: bool = False,
    progress: Progress | None = None,
) -> Equilibrium:
    """Return the rest that a crystal reaches after its spheres are let go at their places; see the module.

    Parameters
    ----------
    crystal : ase.Atoms
        Spheres in a rectangular cell, as `granular_lmp.crystal.disorder.imperfect` makes them; a sheet, or in space.
    materials : sequence of Sphere
        Materials by index. The contact force of the first is the contact force in the lattice.
    box : "box" or "fixed"
        Whether the box changes its size, along periodic axes and between held spheres, or is fixed.
    load : (2,) or (3,) array, optional
        Load T on the box, N m (`granular_lmp.crystal.potential.box_load`). It is required if the lattice is compressed
        and the box changes its size; otherwise the default is 0.
    friction : float
        Coefficient μ ≥ 0 of Coulomb friction in a first relaxation with the shear springs of
        `granular_lmp.crystal.friction`; 0 omits it. The springs are removed before the final rest, as LAMMPS starts
        every contact without shear: friction changes which contacts exist, but no force law at rest.
    by : "whole" or "avalanches"
        Rule for the last steps: Newton steps of the whole crystal, or steps that release the spheres of each avalanche.
    faces : sequence of Face, optional
        Walls beside the crystal. Spheres that touch a wall at their places start in contact with the wall for any
        radius: the spheres of a layer lie on their substrate.
    space : bool
        True if spheres may leave the plane.
    progress : callable, optional
        Called with the stage ("let go with friction", "let go" or "balance"), the number of steps, the largest force in
        k1 Δ0, without forces of shear springs, and the energy in k1 Δ0².

    Raises
    ------
    CrystalError
        If the crystal cannot be at rest, or is not at rest after the steps of `granular_lmp.crystal.balance`; for
        friction in space or beside walls, which is not supported.

    Notes
    -----
    A crystal at rest, such as a perfect lattice, is returned unchanged. Good values: spreads of 2R up to a few Δ0. With
    larger spreads contacts open and form in long sequences, which take hundreds of Newton steps. From about 40 Δ0 on
    the stored energy throws spheres apart, and crystals depend strongly on the seed. Compressed spheres without
    friction flow into vacancies unless adhesion holds them.
    """
    if box not in BOXES:
        raise CrystalError(f"packing.relax = {box!r}: must be one of {', '.join(BOXES)}")
    if by not in WAYS:
        raise CrystalError(f"packing.relax_by = {by!r}: must be one of {', '.join(WAYS)}")
    require_places(crystal)
    breathes = box == "box"
    if load is None and breathes and materials[0].contact_force:
        raise CrystalError(f"contact_force = {materials[0].contact_force!r}: give the load on the box that causes it")
    if friction and (space or faces):
        raise CrystalError(f"friction = {friction!r}: must be 0 in space and beside walls, where spheres roll freely")
    load = np.zeros(3 if space else 2) if load is None else load
    potential = potential_of(crystal, materials, load, breathes=breathes, faces=faces)
    state = potential.start()
    require_friction(friction, state.pairs)
    steps = 0
    if potential.residual(state) > BALANCED:
        if friction:
            state = let_go(potential, state, progress, friction)
        state = let_go(potential, state, progress, settled=RULES[by].settled)
        state, steps = balance(potential, state, by, progress)
    return _record(potential, state, steps, _in_words(steps, box, friction, by))


def _record(potential: Potential, state: State, steps: int, protocol: str) -> Equilibrium:
    """Return the record of a crystal at rest, in the units of `Equilibrium`."""
    pairs, unit, length, crystal = state.pairs, potential.unit, potential.materials[0].static_overlap, potential.crystal
    touching = pairs.law.closed(state.overlap)
    between = touching[: pairs.between]
    on = slice(pairs.between) if between.all() else np.flatnonzero(between)  # a slice copies nothing
    vector = _in_space(state.vector[:, on].T)
    vector *= length
    contacts = contacts_between(
        crystal, potential.materials, pairs.i[on], pairs.j[on], vector, state.overlap[on] * length
    )
    lifted = np.zeros(len(crystal), dtype=bool)
    for number, face in enumerate(potential.faces):
        on = pairs.between + np.flatnonzero(touching[pairs.between :] & (pairs.face == number))
        spheres = pairs.i[on]
        law = face.wall.law_of(crystal, potential.materials, spheres)
        contacts = on_wall(contacts, face.wall, spheres, state.overlap[on] * length, face.outward, law)
        lifted |= face.touches(crystal) & ~np.isin(np.arange(len(crystal)), spheres)
    free = potential.free[: len(crystal)]
    bearing = free[contacts.i] | ~contacts.on_wall & free[contacts.j]
    push = bearing * contacts.contact_force / contacts.length
    return Equilibrium(
        lattice=crystal,
        displacement=_in_space(state.u[: len(crystal)] * unit),
        strain=np.append(state.e, np.zeros(3 - len(state.e))),
        contacts=contacts,
        box_load=contacts.vector[:, : potential.axes].T ** 2 @ push,
        residual=potential.residual(state),
        rattlers=int((free & (contacts.per_sphere == 0)).sum()),
        lifted=int((free & lifted).sum()),
        steps=steps,
        protocol=protocol,
    )


def _in_space(vectors: Floats) -> Floats:
    """Return vectors (N, D) with three components, (N, 3)."""
    in_space = np.zeros((len(vectors), 3))
    in_space[:, : vectors.shape[1]] = vectors
    return in_space


def _in_words(steps: int, box: str, friction: float, by: str) -> str:
    """Return the protocol as a sentence."""
    if not steps:
        return "at rest as it is"
    settled = "until the root mean square force is below {:g} k1 Delta0"
    way = f"let go at the places in the lattice against a drag of {DRAG:g} sqrt(k1 m), "
    if friction:
        way += (
            f"with rotation and shear springs that slide at a friction of {friction:g}, {settled.format(SETTLED)}, "
            "then let go again "
        )
    return way + (
        f"without friction or rotation, {settled.format(RULES[by].settled)}, then {steps} {RULES[by].in_words}; "
        f"the box {'changes its size' if box == 'box' else 'keeps its size'}"
    )
