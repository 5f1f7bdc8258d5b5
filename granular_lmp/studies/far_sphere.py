"""Columns of a sweep for a scene without a wave: arrival at the farthest sphere, and energy.

The *far sphere* is the recorded free sphere whose centre at rest is farthest from the strikers and all other spheres
that move at the beginning, also across periodic sides. Of several it is the first by row and then column. A scene can
select another one with ``[output] spheres``.
"""

from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import PERIODIC
from granular_lmp.errors import RunFolderError
from granular_lmp.runs.record import Record

# Columns and their units: the units of the impact in SI; the far sphere, its largest speed, in the unit v of the
# impact, and the time when its speed first reaches half of this, linear between samples, unless it still rises at the
# end; energies at the end over the initial energy of all spheres: kinetic, of the recorded spheres, and with contacts
# if the record is sufficient; the largest overlap in diameters, as the guard measures it; with a tolerance, the
# estimated error of velocities
COLUMNS = {
    **{"t0_s": "s", "velocity_m_s": "m/s"},
    **{"far_row": "", "far_column": "", "far_speed": "v", "far_tau": "t0"},
    **{"kinetic_kept": "", "energy_kept": "", "largest_overlap": "2R", "velocity_error": "v"},
}
_ALIKE = 1e-9  # distances that differ by less count as equal, so that rounding does not choose the sphere
_STILL = 1e-12  # m v²: a smaller initial energy is rounding
_RISING = 1e-3  # If the speed rises by this share of its maximum in the last sample, the wave has not passed


def read_outs(info: dict[str, Any], record: Record | None) -> dict[str, Any]:
    """Return `COLUMNS` of a run from ``run.json`` and its record; None for unknown values."""
    found: dict[str, Any] = dict.fromkeys(COLUMNS)
    found |= {name: info.get(name) for name in ("t0_s", "velocity_m_s")}
    found["largest_overlap"] = info.get("guards", {}).get("largest_overlap", {}).get("value")
    found["velocity_error"] = info.get("error_estimate", {}).get("velocity")
    if record is None:
        return found
    return found | _of_far_sphere(record) | _of_energy(record)


def far_sphere(record: Record) -> int | None:
    """Return the index of the far sphere among the recorded ones; None if all are held or move at the beginning."""
    problem = record.problem
    period = problem.rest.atoms.cell.lengths()[0] if problem.scene.packing.sides == PERIODIC else inf
    struck = [sphere for spheres in problem.rest.strikers for sphere in spheres.tolist()]
    moves = (record.velocity[0] != 0).any(axis=1) | (record.displacement[0] != 0).any(axis=1)
    origins = problem.rest.atoms.positions[struck + problem.rest.recorded[moves].tolist(), :2]
    if not len(origins):
        return None
    distance = np.array([np.min(_apart(origins - place, period)) for place in record.rest])
    distance[problem.rest.atoms.arrays["fixed"][problem.rest.recorded]] = -1.0
    farthest = float(distance.max())
    return None if farthest <= 0 else int(np.argmax(distance >= farthest * (1 - _ALIKE)))


def _apart(vectors: NDArray[np.float64], period: float) -> NDArray[np.float64]:
    """Return the lengths of vectors (n, 2) to the nearest image along x."""
    across = np.abs(vectors[:, 0])
    return np.hypot(np.minimum(across, np.abs(period - across)), vectors[:, 1])


def arrival(tau: NDArray[np.float64], speed: NDArray[np.float64]) -> float | None:
    """Return the time when a speed (T,) first reaches half of its maximum, linear between samples; None if it is 0."""
    half = float(speed.max()) / 2
    if not half > 0:
        return None
    at = int(np.argmax(speed >= half))
    if at == 0:
        return float(tau[0])
    share = (half - speed[at - 1]) / (speed[at] - speed[at - 1])
    return float(tau[at - 1] + share * (tau[at] - tau[at - 1]))


def _of_far_sphere(record: Record) -> dict[str, Any]:
    far = far_sphere(record)
    if far is None:
        return {}
    arrays, sphere = record.problem.rest.atoms.arrays, record.problem.rest.recorded[far]
    place = {"far_row": int(arrays["row"][sphere]), "far_column": int(arrays["column"][sphere])}
    speed = np.linalg.norm(record.velocity[:, far], axis=1)
    # A later, lower rise does not hide a crest that has passed; a free sphere flies off with its largest speed, to
    # rounding
    if speed[-1] == speed.max() and speed[-1] - speed[-2] > _RISING * speed.max():
        return place
    return place | {"far_speed": float(speed.max()), "far_tau": arrival(record.tau, speed)}


def _of_energy(record: Record) -> dict[str, Any]:
    kept = {"kinetic_kept": float(record.kinetic_energy[-1].sum())}
    try:
        energy = record.energy()
        given, kept["energy_kept"] = float(energy[0]), float(energy[-1])
    except RunFolderError:  # the energy of shear forces, walls or unrecorded spheres is not known
        displaced = record.problem.rest.state[:, :2].any()
        given = 0.0 if displaced else record.problem.rest.given_energy
    return {name: energy / given for name, energy in kept.items()} if given > _STILL else {}
