"""Bins in which LAMMPS sorts spheres to find neighbours, and which determine the order of its sums.

By default bins are half as wide as the cutoff of the neighbour lists, or a little wider, so that a whole number fills
each side of the box. A sphere that rests on the face of a bin may change sides between the start of a run and its
continuation. Forces are then added in another order, and the record changes in its last digits.

https://docs.lammps.org/neigh_modify.html, https://docs.lammps.org/atom_modify.html
"""

import numpy as np

from granular_lmp.lammps.ends import box_of
from granular_lmp.problem import Problem

SKIN = 10  # the cutoff is wider than the contacts by this fraction of the radius: one tenth
_WIDER = np.linspace(1, 1.5, 26)  # sizes to try, over the default
_PULLED = 1.001  # the cutoff of JKR is larger by this factor, so the default bins may have this size


def size(problem: Problem) -> float:
    """Return the size of bins in the unit of the deck: the smallest with no sphere near a face.

    It is 0.0, the default of LAMMPS, if no sphere is near a face of the default bins, or if no size is clear of
    spheres, as with very many unequal spheres.
    """
    half = problem.rest.atoms.arrays["radius"].max() + 0.5 / SKIN
    if _is_clear(problem, half) and _is_clear(problem, _PULLED * half):
        return 0.0
    radius = problem.units.number(problem.scene.sphere.radius, length=1)
    sizes = (float(f"{each * radius:.4g}") for each in half * _WIDER)
    return next((each for each in sizes if _is_clear(problem, each / radius)), 0.0)


def _is_clear(problem: Problem, wanted: float) -> bool:
    """Return whether all spheres rest farther from the faces of such bins, in radii, than a wave moves them."""
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
