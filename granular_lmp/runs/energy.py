"""Energy of each sphere of a record: kinetic, and stored in contacts above rest.

    E = ½ m v² + ½ (I/mR²) m (Rω)² + ½ Σ V,    V = (2/5) A (δ^{5/2} − d^{5/2}) − A d^{3/2} (δ − d)

with the overlap at rest d. The last term is the share of the loads on a chain, so that the sum over all spheres is
conserved.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import CHAIN, WALL
from granular_lmp.crystal.search import overlapping
from granular_lmp.errors import RunFolderError

Floats = NDArray[np.float64]
_AMONG_NEIGHBOURS = 0.4  # radii: two spheres that move less meet no other spheres, whose gap is at least 2√2 − 2 = 0.83


def kinetic_energy(record: Any) -> Floats:
    """Return the kinetic energy of each recorded sphere, in m v², (T, n)."""
    return np.asarray(record.problem.rest.kinetic_energy(record.velocity, record.spin, record.spheres))


def energies(record: Any) -> Floats:
    """Return the energy of each sphere above rest, in m v², (T, n).

    Contacts are those of neighbours at rest; a contact with a held sphere or a wall counts in full for the moving
    sphere.

    Raises
    ------
    RunFolderError
        If not all spheres are recorded, if contacts adhere or have friction, which also stores energy, if a sheet has
        walls, or if spheres touch that were not neighbours at rest.
    """
    scene = record.scene
    if scene.wave is not None or scene.material.work_of_adhesion:
        raise RunFolderError(f"{record!r}: the stored energy is known only without adhesion and without [wave]")
    problem = record.problem
    sides = scene.lattice != CHAIN and WALL in (scene.packing.first, scene.packing.last, scene.packing.sides)
    if len(problem.rest.recorded) != len(problem.rest.atoms) or scene.effects.friction or sides:
        raise RunFolderError(
            f"{record!r}: the stored energy needs a record of all spheres (no output.rows or output.spheres), "
            "effects.friction = 0 and no walls of a sheet"
        )
    _refuse_new_contacts(record)
    i, j = problem.rest.contacts.i, problem.rest.contacts.j
    vector = problem.rest.contacts.vector[:, :2] / scene.sphere.radius
    radius = problem.rest.atoms.arrays["radius"]
    unit = record.scale.length / scene.sphere.radius
    displacement = record.displacement
    distance = np.linalg.norm(vector + (displacement[:, j] - displacement[:, i]) * unit, axis=-1)
    stored = _stored(problem.rest.coefficients, (radius[i] + radius[j] - distance) / unit, problem.rest.rest_overlap)
    moves = ~problem.rest.atoms.arrays["fixed"]
    shares = stored / np.maximum(1 * moves[i] + moves[j], 1)
    each = kinetic_energy(record).T.copy()
    for contact_end in (i, j):
        np.add.at(each, contact_end, (shares * moves[contact_end]).T)
    for end, (coefficient, rest) in problem.rest.on_walls.items():
        inward = displacement[:, end, 1] * (1 if end else -1)
        each[end] += _stored(coefficient, rest + inward, rest)
    return np.asarray(each.T)


def _refuse_new_contacts(record: Any) -> None:
    """Raise RunFolderError if spheres of a sheet touch that were not neighbours at rest."""
    scene, problem = record.scene, record.problem
    if scene.lattice == CHAIN:
        return
    moved, places, count = problem.rest.atoms.copy(), problem.rest.atoms.positions[:, :2], len(problem.rest.atoms)
    known = np.unique(problem.rest.contacts.i * count + problem.rest.contacts.j)
    displacement = record.displacement * (record.scale.length / scene.sphere.radius)
    for moment in np.flatnonzero(np.linalg.norm(displacement, axis=-1).max(axis=1) > _AMONG_NEIGHBOURS):
        moved.positions[:, :2] = places + displacement[moment]
        i, j, _ = overlapping(moved)
        if not np.isin(i * count + j, known).all():
            raise RunFolderError(
                f"{record!r}: at tau = {record.tau[moment]:g} spheres touch that were not neighbours at rest; the "
                "stored energy is only known for neighbours"
            )


def _stored(stiffness: Floats | float, overlap: Floats, rest: Floats | float) -> Floats:
    """Return the energy of contacts above rest, with the share of the loads on them."""
    change = 0.4 * (np.maximum(overlap, 0.0) ** 2.5 - rest**2.5) - rest**1.5 * (overlap - rest)
    return np.asarray(stiffness * change)
