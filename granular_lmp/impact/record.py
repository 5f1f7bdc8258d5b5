"""The record of an impact: displacements and velocities of the recorded spheres, read from its run folder."""

import csv
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.scale import Scale
from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.errors import RunFolderError
from granular_lmp.impact.deck import dump_columns, units_of
from granular_lmp.impact.problem import ImpactProblem, prepare
from granular_lmp.impact.scene import WALL, ImpactScene
from granular_lmp.lammps.outputs import SCENE, SNAPSHOTS, read_dump, writable
from granular_lmp.runs.agreement import refuse_other_scene
from granular_lmp.runs.record import read_status

Floats = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class ImpactRecord:
    """Motion of the n recorded spheres at T times, in the units of the impact (`granular_lmp.crystal.scale`).

    Attributes
    ----------
    tau : (T,) array
        Time in t0.
    displacement, velocity : (T, n, 2) arrays
        Columns x and y, in ℓ and in v, the velocity of the fastest striker.
    spin : (T, n) array
        R ω/v; 0 where spheres do not turn.
    problem : ImpactProblem
        Its `recorded` holds the indices of the spheres, its `scene` the scene.
    info : dict
        Contents of ``run.json``.
    folder : Path or None

    Notes
    -----
    Times `scale.time`, `scale.length` and `scale.velocity` these are SI units.
    """

    tau: Floats
    displacement: Floats
    velocity: Floats
    spin: Floats
    problem: ImpactProblem
    info: dict[str, Any] = field(default_factory=dict)
    folder: Path | None = None

    @classmethod
    def load(cls, folder: str | Path, *, unfinished: bool = False) -> Self:
        """Read the record of a run folder.

        Raises
        ------
        RunFolderError
            If a file is missing or malformed, the scene is not that of the run, or the run is not finished (without
            `unfinished`).
        """
        folder = Path(folder)
        info = read_status(folder)
        if info.get("status") != "finished" and not unfinished:
            raise RunFolderError(f"{folder}: not a finished run (status '{info.get('status')}': {info.get('message')})")
        refuse_other_scene(folder, info)
        record = cls.from_dump(folder, prepare(ImpactScene.load(folder / SCENE)), info)
        if len(record.tau) != info.get("samples") and not unfinished:
            raise RunFolderError(f"{folder}: {len(record.tau)} records, and run.json says {info.get('samples')}")
        return record

    @classmethod
    def from_dump(cls, folder: Path, problem: ImpactProblem, info: dict[str, Any] | None = None) -> Self:
        """Make the record of a run folder from its dump."""
        table = read_dump(folder / SNAPSHOTS, len(problem.recorded), dump_columns(problem))
        scene = problem.scene
        length = units_of(problem).number(scene.scale.length, length=1)
        still = np.zeros_like(table["vx"])
        if scene.time.tolerance is None:
            step = scene.time.step
        elif len(table["step"]) > 1:  # the steps are those of the shortest run, of which it made these in a sample
            step = scene.time.sample / table["step"][1]
        else:
            raise RunFolderError(f"{folder / SNAPSHOTS}: lacks records")
        return cls(
            tau=table["step"] * step,
            displacement=np.stack([table["Displacement.X"], table["Displacement.Y"]], axis=-1) / length,
            velocity=np.stack([table["vx"], table["vy"]], axis=-1) / length,
            spin=table.get("omegaz", still) / length,
            problem=problem,
            info=info or {},
            folder=folder,
        )

    @property
    def scene(self) -> ImpactScene:
        """Scene of the run."""
        return self.problem.scene

    @property
    def scale(self) -> Scale:
        """Units of the record, in SI."""
        return self.scene.scale

    @property
    def rest(self) -> Floats:
        """Positions of the recorded spheres at the beginning, (n, 2), in radii."""
        return np.asarray(self.problem.crystal.positions[self.problem.recorded, :2])

    @cached_property
    def kinetic_energy(self) -> Floats:
        """Kinetic energy of each recorded sphere, ½mv² + ½(I/mR²)m(Rω)², in m v², (T, n)."""
        mass = self.problem.mass[self.problem.recorded]
        radius = self.problem.crystal.arrays["radius"][self.problem.recorded]
        spin = INERTIA_RATIO * (radius * self.spin) ** 2
        return np.asarray(mass * (np.sum(self.velocity**2, axis=-1) + spin) / 2)

    def stored_energy(self) -> Floats:
        """Return the energy of the contacts Σ (2/5) A δ^{5/2}, in m v², (T,): of the neighbours at the beginning.

        Raises
        ------
        RunFolderError
            If not all spheres are recorded, or contacts have friction, whose shear forces store energy too, or a wall.
        """
        problem, scene = self.problem, self.scene
        ends = (scene.packing.first, scene.packing.last, scene.packing.sides)
        if len(problem.recorded) != len(problem.crystal) or scene.effects.friction or WALL in ends:
            raise RunFolderError(
                f"{self!r}: the stored energy needs a record of all spheres (no output.rows or output.spheres), "
                "effects.friction = 0 and no walls"
            )
        i, j, vector, stiffness = problem.contacts
        radius = problem.crystal.arrays["radius"]
        unit = self.scale.length / scene.sphere.radius
        distance = np.linalg.norm(vector + (self.displacement[:, j] - self.displacement[:, i]) * unit, axis=-1)
        overlap = np.maximum(radius[i] + radius[j] - distance, 0.0) / unit
        return np.asarray(np.sum(0.4 * stiffness * overlap**2.5, axis=-1))

    def energy(self) -> Floats:
        """Return the energy of all spheres and contacts, in m v², (T,); raises as `stored_energy`."""
        stored = self.stored_energy()
        return np.asarray(self.kinetic_energy.sum(axis=1) + stored)

    def write_si(self, path: str | Path) -> None:
        """Write a CSV file in SI units, a line for each sphere and time, with every digit.

        Its columns are ``t_s``, ``row``, ``column``, ``ux_m``, ``uy_m``, ``vx_m_s``, ``vy_m_s``, and where spheres
        turn ``spin_rad_s``.

        Raises
        ------
        RunFolderError
            If the file cannot be written.
        """
        arrays, scale, each = self.problem.crystal.arrays, self.scale, self.problem.recorded
        count, moments = len(each), len(self.tau)
        columns = {
            "t_s": np.repeat(self.tau * scale.time, count),
            "row": np.tile(arrays["row"][each], moments),
            "column": np.tile(arrays["column"][each], moments),
            "ux_m": self.displacement[..., 0].ravel() * scale.length,
            "uy_m": self.displacement[..., 1].ravel() * scale.length,
            "vx_m_s": self.velocity[..., 0].ravel() * scale.velocity,
            "vy_m_s": self.velocity[..., 1].ravel() * scale.velocity,
        }
        if self.problem.on["rotation"]:
            columns["spin_rad_s"] = self.spin.ravel() * scale.velocity / self.scene.sphere.radius
        path = Path(path)
        with writable(path), path.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))

    def __repr__(self) -> str:
        end = f"tau 0..{self.tau[-1]:g}" if len(self.tau) else "empty"
        return f"<ImpactRecord {self.scene.name}: {len(self.problem.recorded)} spheres, {end}>"
