"""Record of a run: its recorded motion, read from the run folder.

LAMMPS writes ``dump.*`` and ``log.lammps`` in the units of the deck. For a scene with a wave, ``trajectory.csv`` holds
p, q and φ of the centre sphere over τ: the displacement along the wave vector k and along ẑ × k (v and −u for a wave
along y) and Rθ, in D0. For a scene without a wave, ``dump.particles`` holds the recorded spheres. ``run.json``
describes the run. Post-processing scripts may import this module and little else.
"""

from collections.abc import Mapping
from dataclasses import field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from granular_lmp.card import PAINTERS, HasCard
from granular_lmp.crystal.scale import Scale
from granular_lmp.errors import GranularError as GranularError
from granular_lmp.errors import RunFolderError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.lammps.outputs import DUMP, FOR_VIEWERS, SNAPSHOTS, read_centre, read_dump
from granular_lmp.problem import Problem, prepare
from granular_lmp.rest.scene import Scene as Scene
from granular_lmp.runs import energy, tables
from granular_lmp.runs.formats import is_one_column, scene_of
from granular_lmp.runs.seal import refuse_changed, refuse_other_scene
from granular_lmp.runs.status import STATUS as STATUS
from granular_lmp.runs.status import read_status as read_status
from granular_lmp.runs.status import write_status as write_status
from granular_lmp.runs.tables import optional_package as optional_package

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from granular_lmp.runs.monitors import MonitorRecord
    from granular_lmp.runs.snapshots import Snapshots

__all__ = ["Record", "load"]

Floats = NDArray[np.float64]

TRAJECTORY = "trajectory.csv"
HEADER = ["tau", "p", "q", "phi"]
IN_SPACE = ["ux", "uy", "uz", "phix", "phiy", "phiz"]  # further columns in space


def header_of(scene: Scene) -> list[str]:
    """Return the columns of the ``trajectory.csv`` of a scene."""
    return HEADER if scene.space == 2 else HEADER + IN_SPACE


@dataclass(frozen=True, repr=False)
class Record(HasCard):
    """Motion that a run recorded, with its scene and its run folder.

    Attributes
    ----------
    tau : (T,) array
        Time in units of t0.
    signals : dict of str to array
        Recorded signals by name. For a scene with a wave: ``p``, ``q`` and ``phi`` of the centre sphere, (T,). They are
        its displacement along the wave vector k and along ẑ × k in units of D0 (v/D0 and −u/D0 for a wave along y), and
        its rotation Rθ/D0, which is 0 if spheres do not turn, and nan if they turn but are not tracked. For a scene
        without a wave: ``displacement`` and ``velocity`` of the n recorded spheres, (T, n, 2), columns x and y, in ℓ
        and in v, and ``spin``, (T, n), R ω/v, if they turn; with ``output.forces`` also ``force``, (T, n, 2), in m
        v/t0. In space all of these are (T, n, 3).
    scene : Scene
        Scene of the run with every "auto" decided.
    info : dict
        Contents of ``run.json``.
    folder : Path or None
        Run folder; None for an extrapolated record.

    Notes
    -----
    Two records are equal if their scenes and motions are equal, in any folders. p, q and φ belong to one sphere, and
    are those of the infinite lattice until the echo of the walls arrives (`Scene.echo_time`). ℓ, v and t0 are the units
    of an impact (`granular_lmp.crystal.scale`).

    Examples
    --------
    >>> scene = Scene.load("tr_periodic").with_values({"time.duration": 10.0})
    >>> record = run(scene, "runs/read")
    >>> Record.load("runs/read") == record, list(record.si)
    (True, ['t_s', 'p_m', 'q_m', 'theta_rad'])
    """

    tau: Floats
    signals: Mapping[str, Floats]
    scene: Scene
    info: dict[str, Any] = field(default_factory=dict, compare=False)
    folder: Path | None = field(default=None, compare=False)

    @classmethod
    def load(cls, folder: str | Path, *, unfinished: bool = False) -> Self:
        """Read the record of a run folder.

        Parameters
        ----------
        folder : path
            Run folder.
        unfinished : bool
            True to read also a run that was stopped or failed.

        Raises
        ------
        RunFolderError
            If a file is missing, malformed or changed since the run (`runs.seal`), or if the run is not finished
            (without `unfinished`).
        """
        folder = Path(folder)
        info = read_status(folder)
        if "unnamed" in info:
            raise RunFolderError(
                f"{folder}: holds an unnamed crystal, adopted without the scene that this needs; view, export, front "
                "and granular-analysis branches read it"
            )
        if info.get("status") != "finished" and not unfinished:
            raise RunFolderError(f"{folder}: not a finished run (status '{info.get('status')}': {info.get('message')})")
        refuse_other_scene(folder, info)
        scene = scene_of(folder)
        refuse_changed(folder, info, lazily=scene.wave is not None)
        if scene.wave is None:
            return cls.from_dump(folder, scene, info=info)
        samples = None if unfinished else info.get("samples", 0)
        columns = tables.read_trajectory(folder / TRAJECTORY, header_of(scene), samples)
        return cls(columns.pop("tau"), columns, scene, info, folder)

    @classmethod
    def of_centre(
        cls, tau: Floats, p: Floats, q: Floats, phi: Floats, scene: Scene, info: dict[str, Any] | None = None
    ) -> Self:
        """Make a record of the centre sphere from its signals."""
        return cls(tau, {"p": p, "q": q, "phi": phi}, scene, info or {})

    @classmethod
    def empty(cls, problem: Problem, folder: Path | None = None) -> Self:
        """Make an empty record of a run."""
        scene = problem.scene
        if scene.wave is not None:
            return cls(np.empty(0), dict.fromkeys(header_of(scene)[1:], np.empty(0)), scene, folder=folder)
        still = np.empty((0, len(problem.rest.recorded), scene.space))
        return cls(np.empty(0), {"displacement": still, "velocity": still}, scene, folder=folder)

    @classmethod
    def from_dump(
        cls, folder: str | Path, scene: Scene, dump: str | None = None, info: dict[str, Any] | None = None
    ) -> Self:
        """Make the record of a run folder from its dump: of the centre sphere, or of the recorded spheres."""
        folder = Path(folder)
        if scene.wave is None:
            from granular_lmp.runs.prescribed_motion import at_the_instant, moved_spheres  # kept out of start-up
            from granular_lmp.runs.snapshots import dimensionless, force_on

            needed = ["id", *(f"Displacement.{axis}" for axis in "XYZ"[: scene.space]), "vx", "vy", "vz"]
            table = read_dump(folder / (dump or SNAPSHOTS), None, needed, but=FOR_VIEWERS)
            steps = table["step"].tolist()
            tau = table["step"] * scene.time.clock.between(steps, scene.time.sample)
            moved = moved_spheres(scene, table["id"][0].astype(int) - 1) if len(tau) else []
            displacement, velocity, _, spin = at_the_instant(moved, tau, dimensionless(table, scene))
            spins = {"spin": spin} if "omegaz" in table else {}
            signals = {"velocity": velocity, **spins, "displacement": displacement}
            if "fx" in table:
                signals["force"] = force_on(table, scene)
            return cls(tau, signals, scene, info or {}, folder)
        table = read_centre(folder / (dump or DUMP))
        unit = scene.displacement_amplitude
        metre = scene.units.number(1.0, length=1)
        untracked = np.full(len(table["step"]), np.nan if "omegaz" in table else 0.0)
        first = table["step"][0] if is_one_column(scene) else 0  # LAMMPS could not set the step back
        turn = scene.sphere.radius / unit
        signals = {
            "p": scene.vector.along(table["ux"], table["uy"]) / (metre * unit),
            "q": scene.vector.across(table["ux"], table["uy"]) / (metre * unit) + 0.0,
            "phi": table.get("theta", table.get("thetaz", untracked)) * turn,
        }
        if scene.space == 3:
            signals |= {name: table[name] / (metre * unit) for name in IN_SPACE[:3]}
            signals |= {name: table.get(f"theta{name[-1]}", untracked) * turn for name in IN_SPACE[3:]}
        return cls((table["step"] - first) * scene.time.step, signals, scene, info or {}, folder)

    def with_signals(self, **signals: Floats) -> Self:
        """Return a copy with some signals changed."""
        return replace(self, signals={**self.signals, **signals})

    # --- the centre sphere ---

    @property
    def p(self) -> Floats:
        """Displacement of the centre sphere along the wave vector, (T,), in D0."""
        return self._of_centre("p")

    @property
    def q(self) -> Floats:
        """Displacement of the centre sphere across the wave vector, (T,), in D0."""
        return self._of_centre("q")

    @property
    def phi(self) -> Floats:
        """Rotation Rθ/D0 of the centre sphere, (T,)."""
        return self._of_centre("phi")

    def _of_centre(self, name: str) -> Floats:
        if name not in self.signals:
            raise RunFolderError(
                f"{self!r}: {name} belongs to the centre sphere of a scene with [wave]; this scene has none, and "
                "recorded "
                f"{', '.join(self.signals)}"
            )
        return self.signals[name]

    # --- the recorded spheres ---

    @cached_property
    def problem(self) -> Problem:
        """Prepared scene of the run."""
        return prepare(self.scene)

    @property
    def scale(self) -> Scale:
        """Units of mass, length and time, in SI."""
        return self.scene.scale

    @property
    def spheres(self) -> NDArray[np.int64]:
        """Ascending indices of the recorded spheres, (n,); with a wave, only of the centre sphere."""
        return np.asarray(self.problem.rest.recorded)

    @property
    def row(self) -> NDArray[np.int64]:
        """Row of each recorded sphere, (n,), counted from 0."""
        return np.asarray(self.problem.rest.atoms.arrays["row"][self.spheres])

    @property
    def column(self) -> NDArray[np.int64]:
        """Column of each recorded sphere, (n,), counted from 0."""
        return np.asarray(self.problem.rest.atoms.arrays["column"][self.spheres])

    @property
    def rest(self) -> Floats:
        """Positions of the recorded spheres at rest, (n, 2) or in space (n, 3), in radii."""
        return np.asarray(self.problem.rest.atoms.positions[self.spheres, : self.scene.space])

    @property
    def displacement(self) -> Floats:
        """Displacement of the recorded spheres, (T, n, 2) or in space (T, n, 3), in ℓ, or in D0 with a wave."""
        if "displacement" in self.signals:
            return self.signals["displacement"]
        if self.scene.space == 3:
            return np.stack([self.signals[name] for name in IN_SPACE[:3]], axis=-1)[:, None]
        x, y = self.scene.vector.unit
        return np.stack([x * self.p - y * self.q, y * self.p + x * self.q], axis=-1)[:, None]

    @property
    def velocity(self) -> Floats:
        """Velocity of the recorded spheres, as `displacement`, in v, or in D0/t0 with a wave.

        Raises
        ------
        RunFolderError
            If the run folder holds no dump of the centre sphere, as for a wave with a tolerance.
        """
        return self.signals["velocity"] if "velocity" in self.signals else self._motion_of_centre[1]

    @property
    def spin(self) -> Floats:
        """R ω of the recorded spheres, (T, n) or in space (T, n, 3), in the unit of velocities; 0 if they do not turn.

        Raises RunFolderError as `velocity` does.
        """
        if "velocity" in self.signals:
            return self.signals.get("spin", np.zeros(self.velocity.shape[: self.scene.space]))
        return self._motion_of_centre[3]

    @cached_property
    def _motion_of_centre(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Displacement, velocity, rotation and spin of the centre sphere from its dump."""
        from granular_lmp.runs.prescribed_motion import at_the_instant, moved_spheres  # kept out of start-up
        from granular_lmp.runs.snapshots import dimensionless

        if self.folder is None or not (self.folder / DUMP).is_file():
            raise RunFolderError(f"{self!r}: holds no velocities; a [[monitor]] of the scene records them")
        table = {name: values[:, None] for name, values in read_centre(self.folder / DUMP).items()}
        said = {f"u{axis}": f"Displacement.{axis.upper()}" for axis in "xyz"}
        said |= {name: f"v_{name}" for name in ("theta", "thetax", "thetay", "thetaz")}
        fields = dimensionless({said.get(name, name): values for name, values in table.items()}, self.scene)
        return at_the_instant(moved_spheres(self.scene, self.spheres), self.tau, fields)

    @cached_property
    def kinetic_energy(self) -> Floats:
        """Kinetic energy of each recorded sphere, ½mv² + ½(I/mR²)m(Rω)², in m v², (T, n)."""
        return energy.kinetic_energy(self)

    def energies(self) -> Floats:
        """Return the energy of each sphere above rest, in m v², (T, n): ½ m v² and half of each of its contacts.

        Raises RunFolderError if it is not known (`granular_lmp.runs.energy.energies`).
        """
        return energy.energies(self)

    def energy(self) -> Floats:
        """Return the energy of all spheres and contacts above rest, in m v², (T,); errors as for `energies`.

        With damping it decreases by the loss in the dashpots of the contacts. Without damping it is that of the
        strikers up to the error of the time step.
        """
        return np.asarray(self.energies().sum(axis=1))

    # --- other data in the folder ---

    def snapshots(self) -> "Snapshots":
        """Return the snapshots of all spheres.

        Raises
        ------
        RunFolderError
            If the run has no snapshots (``output.particles``).
        """
        if self.folder is None:
            raise RunFolderError(f"{self!r}: belongs to no run folder, and so has no snapshots")
        from granular_lmp.runs.snapshots import Snapshots  # kept out of start-up

        return Snapshots.load(self.folder)

    def monitor(self, name: str) -> "MonitorRecord":
        """Return the record of a monitor, by its name in the scene.

        Raises
        ------
        RunFolderError
            If the scene has no such monitor, or its files are missing or damaged.
        """
        if self.folder is None:
            raise RunFolderError(f"{self!r}: belongs to no run folder, and so has no monitors")
        from granular_lmp.runs.monitors import MonitorRecord  # kept out of start-up

        return MonitorRecord.load(self.folder, name)

    # --- for other programs ---

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """Dimensionless columns of equal length by name (`granular_lmp.runs.tables`)."""
        return tables.columns(self)

    @property
    def si(self) -> dict[str, NDArray[Any]]:
        """Columns of equal length by name, in SI units (`granular_lmp.runs.tables`)."""
        return tables.si(self)

    def write_csv(self, path: str | Path) -> None:
        """Write `columns`, each number in the shortest form that reads back to the same double."""
        tables.write_csv(self.columns, Path(path))

    def plot(self) -> "Figure":
        """Return a figure of the nonzero signals among p, q and φ over τ; a notebook shows it."""
        figure: Figure = PAINTERS["trajectory_figure"](self.tau, self.signals, self.scene)
        return figure

    def to_pandas(self) -> Any:
        """Return `columns` as a ``pandas.DataFrame``, with tau as the index for the centre sphere.

        Raises
        ------
        PackageMissingError
            If pandas is not installed.
        """
        return tables.to_pandas(self)

    def to_xarray(self) -> Any:
        """Return an ``xarray.Dataset`` of `signals` over tau, each with its unit and meaning.

        Its attributes hold the scales for SI units, the end of the run, and the ``scene`` as TOML.

        Raises
        ------
        PackageMissingError
            If xarray is not installed.
        """
        return tables.to_xarray(self)

    def to_netcdf(self, path: str | Path) -> None:
        """Write `to_xarray` as netCDF, which xarray, MATLAB, Julia and ncview read.

        Raises
        ------
        PackageMissingError
            If xarray is not installed.
        """
        self.to_xarray().to_netcdf(path)

    def __repr__(self) -> str:
        end = f"tau 0..{self.tau[-1]:g}" if len(self.tau) else "empty"
        return f"<Record {self.scene.name}: {self.scene.label}, {end}>"


def load(folder: str | Path, *, unfinished: bool = False) -> Record:
    """Return the record of a finished run: `Record.load`."""
    return Record.load(folder, unfinished=unfinished)
