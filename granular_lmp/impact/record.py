"""The record of an impact: displacements and velocities of the recorded spheres, read from its run folder."""

import csv
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from granular_lmp.card import HasCard
from granular_lmp.crystal.lattices import CHAIN, WALL
from granular_lmp.crystal.scale import Scale
from granular_lmp.crystal.search import overlapping
from granular_lmp.errors import RunFolderError
from granular_lmp.impact.deck import dump_columns
from granular_lmp.impact.problem import ImpactProblem, prepare
from granular_lmp.impact.scene import ImpactScene
from granular_lmp.lammps.outputs import SCENE, SNAPSHOTS, read_dump, writable
from granular_lmp.runs.agreement import refuse_other_scene
from granular_lmp.runs.record import read_status
from granular_lmp.runs.seal import refuse_changed

Floats = NDArray[np.float64]
_AMONG_NEIGHBOURS = 0.4  # radii: two spheres that move less meet no others, which are 2√2 − 2 = 0.83 apart or more


@dataclass(frozen=True, repr=False)
class ImpactRecord(HasCard):
    """Motion of the n recorded spheres at T times, in the units of the impact (`granular_lmp.crystal.scale`).

    Attributes
    ----------
    tau : (T,) array
        Time in t0.
    displacement, velocity : (T, n, 2) arrays
        Columns x and y, in ℓ and in v, as a rule the velocity of the fastest striker (`ImpactScene.scale`).
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
        refuse_changed(folder, info)
        record = cls.from_dump(folder, prepare(ImpactScene.load(folder / SCENE)), info)
        if len(record.tau) != info.get("samples") and not unfinished:
            raise RunFolderError(f"{folder}: {len(record.tau)} records, and run.json says {info.get('samples')}")
        return record

    @classmethod
    def empty(cls, problem: ImpactProblem, folder: Path) -> Self:
        """Make the record of a run that has recorded nothing."""
        still = np.empty((0, len(problem.recorded), 2))
        return cls(np.empty(0), still, still.copy(), still[..., 0], problem=problem, folder=folder)

    @classmethod
    def from_dump(cls, folder: Path, problem: ImpactProblem, info: dict[str, Any] | None = None) -> Self:
        """Make the record of a run folder from its dump."""
        table = read_dump(folder / SNAPSHOTS, len(problem.recorded), dump_columns(problem))
        scene = problem.scene
        length = problem.units.number(scene.scale.length, length=1)
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
        return self.problem.kinetic_energy(self.velocity, self.spin, self.problem.recorded)

    def energies(self) -> Floats:
        """Return the energy of each sphere above rest, in m v², (T, n): ½ m v² and half of each of its contacts.

            V = (2/5) A (δ^{5/2} − d^{5/2}) − A d^{3/2} (δ − d)

        with the overlap at rest d. The last term is the share of the loads that press a chain together, so that the sum
        over all spheres is conserved. Contacts are those of the neighbours at rest; one with a held sphere or a
        wall counts in full for the one that moves.

        Raises
        ------
        RunFolderError
            If not all spheres are recorded, contacts have friction, whose shear forces store energy too, a sheet has
            walls, or spheres of a sheet touch that were no neighbours at rest.
        """
        problem, scene = self.problem, self.scene
        sides = scene.lattice != CHAIN and WALL in (scene.packing.first, scene.packing.last, scene.packing.sides)
        if len(problem.recorded) != len(problem.crystal) or scene.effects.friction or sides:
            raise RunFolderError(
                f"{self!r}: the stored energy needs a record of all spheres (no output.rows or output.spheres), "
                "effects.friction = 0 and no walls of a sheet"
            )
        self._refuse_new_contacts()
        i, j = problem.contacts.i, problem.contacts.j
        vector = problem.contacts.vector[:, :2] / scene.sphere.radius
        radius = problem.crystal.arrays["radius"]
        unit = self.scale.length / scene.sphere.radius
        distance = np.linalg.norm(vector + (self.displacement[:, j] - self.displacement[:, i]) * unit, axis=-1)
        stored = _stored(problem.coefficients, (radius[i] + radius[j] - distance) / unit, problem.rest_overlap)
        moves = ~problem.crystal.arrays["fixed"]
        shares = stored / np.maximum(1 * moves[i] + moves[j], 1)
        each = self.kinetic_energy.T.copy()
        for contact_end in (i, j):
            np.add.at(each, contact_end, (shares * moves[contact_end]).T)
        for end, (coefficient, rest) in problem.on_walls.items():
            inward = self.displacement[:, end, 1] * (1 if end else -1)
            each[end] += _stored(coefficient, rest + inward, rest)
        return np.asarray(each.T)

    def _refuse_new_contacts(self) -> None:
        """Raise RunFolderError if spheres of a sheet touch that were no neighbours at rest."""
        if self.scene.lattice == CHAIN:
            return
        crystal = self.problem.crystal
        moved, places, count = crystal.copy(), crystal.positions[:, :2], len(crystal)
        known = np.unique(self.problem.contacts.i * count + self.problem.contacts.j)
        displacement = self.displacement * (self.scale.length / self.scene.sphere.radius)
        for moment in np.flatnonzero(np.linalg.norm(displacement, axis=-1).max(axis=1) > _AMONG_NEIGHBOURS):
            moved.positions[:, :2] = places + displacement[moment]
            i, j, _ = overlapping(moved)
            if not np.isin(i * count + j, known).all():
                raise RunFolderError(
                    f"{self!r}: at tau = {self.tau[moment]:g} spheres touch that were no neighbours at rest; the "
                    "stored energy is known of neighbours alone"
                )

    def energy(self) -> Floats:
        """Return the energy of all spheres and contacts above rest, in m v², (T,); raises as `energies`.

        With a restitution below 1 it falls, by what the dashpots of the contacts take. Without, it is that of the
        strikers but for the error of the step.
        """
        return np.asarray(self.energies().sum(axis=1))

    @property
    def si(self) -> dict[str, NDArray[Any]]:
        """The motion in SI units by column, a line for each sphere and time, time by time.

        The columns are ``t_s``, ``row``, ``column``, ``ux_m``, ``uy_m``, ``vx_m_s``, ``vy_m_s``, and where spheres turn
        ``spin_rad_s``.
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
        return columns

    def write_si(self, path: str | Path) -> None:
        """Write `si` as a CSV file with every digit.

        Raises
        ------
        RunFolderError
            If the file cannot be written.
        """
        columns = self.si
        path = Path(path)
        with writable(path), path.open("w", encoding="utf-8", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))

    def __repr__(self) -> str:
        end = f"tau 0..{self.tau[-1]:g}" if len(self.tau) else "empty"
        return f"<ImpactRecord {self.scene.name}: {len(self.problem.recorded)} spheres, {end}>"


def _stored(stiffness: Floats | float, overlap: Floats, rest: Floats | float) -> Floats:
    """Return the energy of contacts above rest, with the share of the loads that press them together."""
    change = 0.4 * (np.maximum(overlap, 0.0) ** 2.5 - rest**2.5) - rest**1.5 * (overlap - rest)
    return np.asarray(stiffness * change)
