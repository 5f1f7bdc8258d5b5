"""Snapshots of all spheres of a run: the file ``dump.particles`` of a scene with ``output.particles``.

The file is a text dump of LAMMPS with all digits, in the units of the deck. OVITO knows the names of its columns
(Particle Identifier ← id, Particle Type ← type: 1 moves, 2 is held; Position, Radius, Displacement, Velocity, Angular
Velocity); the angle is the scalar ``v_theta``. ASE reads it as ``lammps-dump-text`` and keeps positions, velocities,
types and ``v_theta``. A snapshot is read when it is used, and is dimensionless as in `granular_lmp.runs.record`.
"""

from math import ceil
from pathlib import Path
from typing import Self

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.card import HasCard
from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.errors import RunFolderError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.lammps.outputs import (
    FOR_VIEWERS,
    PER_SAMPLE,
    SNAPSHOTS,
    SnapshotPlace,
    read_snapshot,
    whole_snapshots,
)
from granular_lmp.rest.at_rest import crystal_of, sphere_count
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.components import components, rates
from granular_lmp.runs.formats import scene_of
from granular_lmp.runs.prescribed_motion import Moved, at_the_instant, moved_spheres
from granular_lmp.runs.scales import length_of
from granular_lmp.runs.seal import refuse_changed_record
from granular_lmp.runs.tables import HasTables, Many, places_of
from granular_lmp.scene.places import spheres_at

__all__ = ["Snapshots"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Spheres:
    """All spheres at one moment, in the order of the data file; lengths in D0, times in t0.

    Attributes
    ----------
    tau : float
        Time in units of t0.
    displacement, velocity : (N, 2) arrays, in space (N, 3)
        Displacement from the lattice at rest and velocity, columns x, y and in space z, in D0 and D0/t0.
    rotation, spin : (N,) arrays, in space (N, 3)
        Rθ/D0 and its rate Rω t0/D0. Both are 0 if spheres do not turn; the rotation is nan if they turn untracked. In
        space θ is the rotation vector.
    """

    tau: float
    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    rotation: NDArray[np.float64]
    spin: NDArray[np.float64]

    @property
    def energy(self) -> NDArray[np.float64]:
        """Kinetic energy of each sphere, ½v² + ½(I/mR²)(Rω)², in m(D0/t0)²; (N,)."""
        turning = np.sum(self.spin.reshape(len(self.spin), -1) ** 2, axis=1)
        return (np.sum(self.velocity**2, axis=1) + INERTIA_RATIO * turning) / 2


def dimensionless(columns: dict[str, Floats], scene: Scene) -> tuple[Floats, Floats, Floats, Floats]:
    """Return displacement (..., 2), velocity (..., 2), rotation and spin (...) from the columns of a dump, (...) each.

    In space all four are (..., 3), as in `Spheres`; the columns are in the units of the deck.
    """
    still, units = np.zeros(columns["id"].shape), scene.units
    moves, turns = ("xy", "z") if scene.space == 2 else ("xyz", "xyz")
    displacement = units.number(length_of(scene), length=1)
    velocity = displacement / units.number(scene.scale.time, time=1)
    radius = units.number(scene.sphere.radius, length=1)
    spin = np.stack([columns.get(f"omega{axis}", still) for axis in turns], axis=-1)
    angle = _angle(columns, turns)
    if angle is None:
        angle = np.full_like(spin, np.nan if "omegaz" in columns else 0.0)
    if scene.space == 2:
        angle, spin = angle[..., 0], spin[..., 0]
    return (
        np.stack([columns[f"Displacement.{axis.upper()}"] for axis in moves], axis=-1) / displacement,
        np.stack([columns[f"v{axis}"] for axis in moves], axis=-1) / velocity,
        angle * radius / displacement,
        spin * radius / velocity,
    )


def force_on(columns: dict[str, Floats], scene: Scene) -> Floats:
    """Return the force on spheres, (..., 2) or (..., 3), in units of the scene, m ℓ/t0², from the columns of a dump."""
    scale = scene.scale
    unit = scene.units.number(scale.mass * scale.length / scale.time**2, mass=1, length=1, time=-2)
    return np.stack([columns[f"f{axis}"] for axis in "xyz"[: scene.space]], axis=-1) / unit


def _angle(columns: dict[str, Floats], turns: str) -> Floats | None:
    """Return the rotation vector from the angles or quaternions in a dump, (..., 1 or 3); None if it has none."""
    if "Orientation.W" in columns:
        return rotation_vector(np.stack([columns[f"Orientation.{part}"] for part in "WXYZ"], axis=-1))
    names = ["v_theta"] if turns == "z" else [f"v_theta{axis}" for axis in turns]
    return np.stack([columns[name] for name in names], axis=-1) if names[0] in columns else None


def rotation_vector(quaternion: Floats) -> Floats:
    """Return the rotation vectors (..., 3), rad, of quaternions (..., 4), the real part first."""
    axis = quaternion[..., 1:]
    size = np.linalg.norm(axis, axis=-1)
    angle = 2 * np.arctan2(size, quaternion[..., 0])
    return np.asarray(axis * np.divide(angle, size, out=np.full_like(size, 2.0), where=size > 0)[..., None])


def finest(folder: Path, name: str) -> Path | None:
    """Return a file of a run folder, or of the finest step of a run with a tolerance; None if there is none."""
    finer = sorted(folder.glob(f"*{PER_SAMPLE}/{name}"), key=lambda path: int(path.parent.name.split("_")[0]))
    return next(filter(Path.is_file, [folder / name, *reversed(finer)]), None)


@dataclass(frozen=True, repr=False)
class Snapshots(HasCard, HasTables):
    """Snapshots of a run: ``snapshots[i]`` reads one, ``snapshots.tau`` holds their times.

    Attributes
    ----------
    path : Path
        Path of the dump.
    scene : Scene
        Scene of the run that wrote it.
    index : list of SnapshotPlace
        Place of each snapshot in the file.

    Examples
    --------
    >>> scene = Scene.load("tr_periodic").with_values({"time.duration": 4.0, "output.particles": 2.0})
    >>> snapshots = run(scene, "runs/seen").snapshots()
    >>> snapshots.tau.tolist(), snapshots[-1].displacement.shape
    ([0.0, 2.0, 4.0], (48, 2))
    """

    path: Path
    scene: Scene
    index: list[SnapshotPlace]

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Return the snapshots of a run folder.

        For a run with a tolerance they belong to its answer, or to its finest step if an earlier release wrote no
        others.

        Raises
        ------
        RunFolderError
            If the run has no snapshots.
        """
        folder = Path(folder)
        path = finest(folder, SNAPSHOTS)
        if path is None:
            raise RunFolderError(
                f"{folder}: holds no snapshots of all spheres; run its scene with output.particles, the time between "
                "them, for instance output.particles = 1.0"
            )
        refuse_changed_record(folder, path)
        scene = scene_of(path.parent)
        whole = list(whole_snapshots(path))
        if scene.wave is not None:
            count = sphere_count(scene)
            whole = [each for each in whole if each.entries == count]
        return cls(path, scene, whole)

    @cached_property
    def spheres(self) -> NDArray[np.int64]:
        """Indices of the spheres in the crystal of the scene: all, or those that a scene without a wave records."""
        output, atoms = self.scene.output, crystal_of(self.scene).atoms
        if self.scene.wave is not None or output.everyone:
            return np.arange(len(atoms))
        return spheres_at(output.rows, output.spheres, atoms, "recorded sphere", output.layers)

    @cached_property
    def crystal(self) -> ase.Atoms:
        """Spheres at rest, with lengths in radii."""
        atoms = crystal_of(self.scene).atoms
        return atoms if len(self.spheres) == len(atoms) else atoms[self.spheres]

    @property
    def rest(self) -> NDArray[np.float64]:
        """Positions at rest, (N, 2) or in space (N, 3), in radii."""
        return self.crystal.positions[:, : self.scene.space]

    @property
    def held(self) -> NDArray[np.bool_]:
        """True for the spheres that are held, (N,)."""
        return np.asarray(self.crystal.arrays["fixed"])

    @property
    def tau(self) -> NDArray[np.float64]:
        """Times of the snapshots, (T,), in units of t0."""
        return np.array([each.step for each in self.index], dtype=float) * self._step

    @property
    def step(self) -> float:
        """Time step of the motion, τ; 0 for a run with a tolerance, which is extrapolated."""
        return self.scene.time.clock.of_answer

    @property
    def _step(self) -> float:
        """Time, τ, of a step that the file counts."""
        time = self.scene.time
        every = time.sample if self.scene.wave is None else self.scene.output.particles
        apart = time.sample * ceil(every / time.sample - 1e-9)  # as in the deck
        return time.clock.between([each.step for each in self.index[:2]], apart)

    def stack(self, name: str) -> NDArray[np.float64]:
        """Return one attribute of `Spheres` over all snapshots: ``stack("displacement")`` is (T, N, 2)."""
        return self.stacks(name)[0]

    def stacks(self, *names: str) -> list[NDArray[np.float64]]:
        """Return several attributes, each as from `stack`, with one slow reading of the file."""
        read = [[getattr(each, name) for name in names] for each in map(self.__getitem__, range(len(self)))]
        return [np.array([values[k] for values in read]) for k in range(len(names))]

    @property
    def _many(self) -> Many:
        displacement, velocity, rotation, spin = self.stacks("displacement", "velocity", "rotation", "spin")
        places = places_of(self.crystal, np.arange(len(self.crystal)))
        moving = components(displacement, rotation) | rates(velocity, spin)
        return Many(self.scene, self.tau, "sphere", places, moving)

    def __len__(self) -> int:
        return len(self.index)

    def __getitem__(self, number: int) -> Spheres:
        where = self.index[number]
        try:
            with self.path.open(encoding="utf-8") as stream:
                stream.seek(where.begin)
                snapshot = read_snapshot(stream, FOR_VIEWERS)
            if snapshot is None:
                raise ValueError(f"the snapshot of step {where.step} is cut off")
            step, names, table = snapshot
            read = [name for name in names if name not in FOR_VIEWERS]
            return self._dimensionless(step, dict(zip(read, table.T, strict=True)))
        except (OSError, ValueError, KeyError) as error:
            raise RunFolderError(f"{self.path}: not a dump of these spheres: {error!r}") from error

    @cached_property
    def _moved(self) -> list[Moved]:
        return moved_spheres(self.scene, self.spheres)

    def _dimensionless(self, step: int, columns: dict[str, NDArray[np.float64]]) -> Spheres:
        tau = step * self._step
        return Spheres(tau, *at_the_instant(self._moved, tau, dimensionless(columns, self.scene)))

    def __repr__(self) -> str:
        count = self.index[0].entries if self.index else 0
        return f"<Snapshots {self.path}: {len(self)} snapshots of {count} spheres>"
