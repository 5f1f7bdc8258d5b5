"""Initial state of the spheres of a deck as numbers: what LAMMPS makes of ``data.NAME`` before its first step.

All values are in the units of the deck. Spheres with a prescribed motion begin at rest, as in LAMMPS.
"""

import numpy as np
from numpy.typing import NDArray

from granular_lmp.effects.freedoms import turns
from granular_lmp.frozen import dataclass
from granular_lmp.lammps import spheres
from granular_lmp.lammps.ends import boundary
from granular_lmp.problem import Problem

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Beginning:
    """N spheres in d dimensions at the first moment of a run.

    Attributes
    ----------
    types : (N,) int array
        Types in LAMMPS: for material m, counted from 0, they are 2m + 1 (free) and 2m + 2 (held).
    place : (N, d) array
        Places at rest.
    radius, density : (N,) arrays
    displacement, velocity : (N, d) arrays
        Displacement from rest, and velocity.
    rotation, spin : (N, 1) arrays, in space (N, 3)
        Angle (in space the rotation vector) and spin.
    box : (3, 2) array
    boundary : str
        Words of LAMMPS for the faces of the box.
    """

    types: NDArray[np.int64]
    place: Floats
    radius: Floats
    density: Floats
    displacement: Floats
    velocity: Floats
    rotation: Floats
    spin: Floats
    box: Floats
    boundary: str

    @property
    def cell(self) -> tuple[float, ...]:
        """Periods along the axes, (d,); infinite where the box is not periodic."""
        periodic = [face == "p" for face in self.boundary.split()]
        sizes = np.where(periodic, self.box[:, 1] - self.box[:, 0], np.inf)
        return tuple(map(float, sizes[: self.place.shape[1]]))


def beginning(problem: Problem) -> Beginning:
    """Return the initial state of the spheres of a problem, by the formulas of `granular_lmp.lammps.start`."""
    data, scene, units, count = spheres.data_of(problem), problem.scene, problem.units, len(problem.rest.atoms)
    space, turning = scene.space, len(turns(problem)) if problem.on["rotation"] else 0
    turned = len(turns(problem))
    ways, rates = np.zeros((2, count, space + turned))
    if scene.wave is not None and scene.form.fills:
        length = scene.displacement_amplitude
        moved, moving = np.split(data.wave[:, : 2 * (space + turning)], 2, axis=1)
        shift, angle = units.number(length, length=1), length / scene.sphere.radius
        sizes, time = [shift] * space + [angle] * turning, units.number(scene.scale.time, time=1)
        ways[:, : space + turning], rates[:, : space + turning] = moved * sizes, moving * sizes / time
    if scene.start.moves:
        state = data.state if data.state.size else data.wave[:, data.wave.shape[1] - (2 * space + turning) :]
        ways[:, :space] += state[:, :space]
        rates[:, : space + turning] += state[:, space:]
    for striker, struck in zip(scene.striker, problem.rest.strikers, strict=True):
        velocity = np.array([units.number(each, length=1, time=-1) for each in striker.components[:space]])
        rates[struck, :space] = velocity + (rates[struck, :space] if scene.wave is not None else 0.0)
    return Beginning(
        data.kind,
        data.position[:, :space],
        data.diameter / 2,
        data.density,
        ways[:, :space],
        rates[:, :space],
        ways[:, space:],
        rates[:, space:],
        data.box,
        boundary(problem),
    )
