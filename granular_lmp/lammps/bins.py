"""The bins into which LAMMPS sorts spheres and by which it finds neighbours, and so the order of its sums.

By default they are half as wide as the cutoff of the neighbour lists, or a little wider, as a whole number of them
fills each side of the box. A sphere that rests on the face of a bin is on one side of it when a run begins, and may be
on the other when a stopped run continues: forces are then added in another order, and the record changes in its last
digits.

https://docs.lammps.org/neigh_modify.html, https://docs.lammps.org/atom_modify.html
"""

import numpy as np

from granular_lmp.lammps.ends import box_of
from granular_lmp.problem import Problem

SKIN = 10  # the cutoff is wider than the contacts by this fraction of the radius: one tenth
_WIDER = np.linspace(1, 1.5, 26)  # sizes that are tried, over the default
_PULLED = 1.001  # the cutoff of JKR reaches that much further, so that the default bins may be those of this size


def size(problem: Problem) -> float:
    """Return the size of bins in the unit of the deck: the smallest whose faces no sphere comes near.

    It is 0.0, which LAMMPS takes for its default, where that is clear, and where none is, as among very many unequal
    spheres.
    """
    half = problem.rest.atoms.arrays["radius"].max() + 0.5 / SKIN
    if _is_clear(problem, half) and _is_clear(problem, _PULLED * half):
        return 0.0
    radius = problem.units.number(problem.scene.sphere.radius, length=1)
    sizes = (float(f"{each * radius:.4g}") for each in half * _WIDER)
    return next((each for each in sizes if _is_clear(problem, each / radius)), 0.0)


def _is_clear(problem: Problem, wanted: float) -> bool:
    """Return whether spheres rest further from the faces of bins of this size, in radii, than a wave moves them."""
    scene = problem.scene
    moves = (1 + 2 * (scene.wave.amplitude if scene.wave else 0)) * scene.scale.length / scene.sphere.radius
    box = box_of(problem) / problem.units.number(scene.sphere.radius, length=1)
    for axis, (low, high) in enumerate(box[: scene.space]):
        bins = max(int((high - low) / wanted), 1)
        place = (problem.rest.atoms.positions[:, axis] - low) * bins / (high - low)
        face = np.round(place)
        near = np.abs(place - face) < moves * bins / (high - low)
        if (near & (face > 0) & (face < bins)).any():
            return False
    return True
