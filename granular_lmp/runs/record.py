"""The record of a run: the trajectory of the centre sphere, read from its run folder.

LAMMPS writes ``dump.*`` and ``log.lammps`` in the units of the deck. ``trajectory.csv`` holds p, q and φ of the centre
sphere over τ: its displacement along the wave vector k and along ẑ × k (v and −u for a wave along y) and Rθ, in D0.
``run.json`` holds the course of the run. Post-processing scripts may import only this module and
`granular_lmp.crystal.sphere`.
"""

import csv
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from granular_lmp.card import HasCard
from granular_lmp.errors import GranularError as GranularError
from granular_lmp.errors import PackageMissingError, RunFolderError, one_line
from granular_lmp.lammps.outputs import DUMP, csv_text, read_centre, replace_text
from granular_lmp.runs.agreement import (
    refuse_other_extrapolation,
    refuse_other_physics,
    refuse_other_scene,
    refuse_other_trajectory,
)
from granular_lmp.runs.formats import is_one_column, scene_of
from granular_lmp.runs.monitors import MonitorRecord
from granular_lmp.runs.seal import refuse_changed
from granular_lmp.runs.snapshots import Snapshots
from granular_lmp.runs.status import STATUS as STATUS
from granular_lmp.runs.status import read_status as read_status
from granular_lmp.runs.status import write_status as write_status
from granular_lmp.scene.scene import Scene
from granular_lmp.units import units_for

if TYPE_CHECKING:
    from granular_lmp.plot.signals import Picture

TRAJECTORY = "trajectory.csv"
# Name, unit and meaning of each column
_COLUMNS = (
    ("tau", "t0", "time"),
    ("p", "D0", "displacement of the centre sphere along the wave vector"),
    ("q", "D0", "displacement of the centre sphere across the wave vector"),
    ("phi", "D0/R rad", "rotation of the centre sphere, R theta/D0"),
)
HEADER = [name for name, *_ in _COLUMNS]


@dataclass(frozen=True, repr=False)
class Record(HasCard):
    """Trajectory of the centre sphere with its scene and run folder.

    Attributes
    ----------
    tau : (T,) array
        Time in units of t0.
    p, q : (T,) arrays
        Displacement along the wave vector k and along ẑ × k in units of D0: v/D0 and −u/D0 for a wave along y.
    phi : (T,) array
        Rotation Rθ/D0, which is 0 if spheres do not turn and nan if they turn but are not tracked.
    scene : Scene
        Scene of the run with every "auto" decided.
    info : dict
        Contents of ``run.json``.
    folder : Path or None
        Run folder; None for an extrapolated record.

    Notes
    -----
    p, q and φ are those of one sphere. They are those of the infinite lattice until the echo of the walls arrives
    (`Scene.echo_time`).
    """

    tau: NDArray[np.float64]
    p: NDArray[np.float64]
    q: NDArray[np.float64]
    phi: NDArray[np.float64]
    scene: Scene
    info: dict[str, Any] = field(default_factory=dict)
    folder: Path | None = None

    @classmethod
    def load(cls, folder: str | Path, *, unfinished: bool = False) -> Self:
        """Read the record of a run folder.

        Parameters
        ----------
        folder : path
            Run folder.
        unfinished : bool
            Read a run that was stopped or failed too.

        Raises
        ------
        RunFolderError
            If a file is missing or malformed, files disagree with each other (`runs.agreement`), or the run is not
            finished (without `unfinished`).
        """
        folder = Path(folder)
        info = read_status(folder)
        if info.get("status") != "finished" and not unfinished:
            raise RunFolderError(f"{folder}: not a finished run (status '{info.get('status')}': {info.get('message')})")
        refuse_other_scene(folder, info)
        refuse_changed(folder, info, lazily=True)
        scene = scene_of(folder)
        refuse_other_physics(folder, info, scene)
        try:
            text = (folder / TRAJECTORY).read_text(encoding="utf-8")
            if not text.endswith("\n"):
                raise ValueError("its last line is cut off")
            lines = list(csv.reader(text.splitlines()))
            if lines[0] != HEADER:
                raise ValueError(f"header {lines[0]}, expected {HEADER}")
            tau, p, q, phi = np.array(lines[1:], dtype=float).reshape(-1, len(HEADER)).T
            if not (np.isfinite(tau).all() and (tau >= 0).all() and (np.diff(tau) > 0).all()):
                raise ValueError("tau must be finite, not negative, and ascend")
            if not len(tau) and not unfinished:
                raise ValueError("it holds no record")
            if len(tau) != info.get("samples") and not unfinished:
                raise ValueError(f"{len(tau)} records, and {STATUS} says {info.get('samples')}")
        except (OSError, ValueError, IndexError, csv.Error) as error:
            raise RunFolderError(f"{folder / TRAJECTORY}: cannot be read: {one_line(error)}") from error
        refuse_other_extrapolation(folder / TRAJECTORY, text, info)
        record = cls(tau, p, q, phi, scene, info, folder)
        if (folder / DUMP).is_file():
            dumped, whole = cls.from_dump(folder, scene), info["status"] == "finished"
            refuse_other_trajectory(folder / TRAJECTORY, record.columns, dumped.columns, whole=whole)
        return record

    @classmethod
    def from_dump(cls, folder: str | Path, scene: Scene, dump: str = DUMP) -> Self:
        """Make the record of a run folder from its dump, dimensionless with the scene's D0 and R."""
        table = read_centre(Path(folder) / dump)
        displacement = scene.displacement_amplitude
        metre = units_for(scene.sphere.radius).number(1.0, length=1)
        untracked = np.full(len(table["step"]), np.nan if "omegaz" in table else 0.0)
        first = table["step"][0] if is_one_column(scene) else 0  # LAMMPS could not set the step back there
        return cls(
            tau=(table["step"] - first) * scene.time.step,
            p=scene.vector.along(table["ux"], table["uy"]) / (metre * displacement),
            q=scene.vector.across(table["ux"], table["uy"]) / (metre * displacement) + 0.0,
            phi=table.get("theta", untracked) * scene.sphere.radius / displacement,
            scene=scene,
            folder=Path(folder),
        )

    def write_csv(self, path: str | Path) -> None:
        """Write tau, p, q, phi, each number in the shortest form that reads back to the same double."""
        lines = np.column_stack([self.tau, self.p, self.q, self.phi]).tolist()
        replace_text(Path(path), csv_text(HEADER, lines))

    @property
    def signals(self) -> dict[str, NDArray[np.float64]]:
        """Signals p, q, φ by name."""
        return {"p": self.p, "q": self.q, "phi": self.phi}

    @property
    def columns(self) -> dict[str, NDArray[np.float64]]:
        """Columns τ, p, q, φ of ``trajectory.csv`` by name."""
        return {"tau": self.tau} | self.signals

    def snapshots(self) -> Snapshots:
        """Return the snapshots of all spheres.

        Raises
        ------
        RunFolderError
            If the run has no snapshots (``output.particles``).
        """
        if self.folder is None:
            raise RunFolderError(f"{self!r}: is of no run folder, and so without snapshots")
        return Snapshots.load(self.folder)

    def monitor(self, name: str) -> MonitorRecord:
        """Return what a monitor recorded, by its name in the scene.

        Raises
        ------
        RunFolderError
            If the scene has no such monitor, or its files are missing or damaged.
        """
        if self.folder is None:
            raise RunFolderError(f"{self!r}: is of no run folder, and so without monitors")
        return MonitorRecord.load(self.folder, name)

    @property
    def si(self) -> dict[str, NDArray[np.float64]]:
        """The trajectory in SI units by column: ``t_s``, ``p_m``, ``q_m``, ``theta_rad``."""
        unit = self.scene.displacement_amplitude
        return {
            "t_s": self.tau * self.scene.sphere.time_scale,
            "p_m": self.p * unit,
            "q_m": self.q * unit,
            "theta_rad": self.phi * unit / self.scene.sphere.radius,
        }

    def plot(self) -> "Picture":
        """Return a figure of p, q and φ over τ, without signals that stay zero; a notebook shows it."""
        from granular_lmp.plot.signals import trajectory_figure  # matplotlib takes longer to load than most runs

        return trajectory_figure(self.tau, self.signals, self.scene)

    def to_pandas(self) -> Any:
        """Return a ``pandas.DataFrame`` of p, q, phi over tau.

        Raises
        ------
        PackageMissingError
            If pandas is not installed.
        """
        pandas = optional_package("pandas")
        return pandas.DataFrame(self.signals, index=pandas.Index(self.tau, name="tau"))

    def to_xarray(self) -> Any:
        """Return an ``xarray.Dataset`` of p, q, phi over tau, each with its unit and meaning.

        Its attributes hold the scales that turn it into SI units, ``D0_m``, ``t0_s``, ``R_m``, how the run ended, and
        ``scene``, the scene as TOML.

        Raises
        ------
        PackageMissingError
            If xarray is not installed.
        """
        sphere = self.scene.sphere
        tau, *signals = ((name, {"units": unit, "long_name": meaning}) for name, unit, meaning in _COLUMNS)
        scales = {
            "D0_m": self.scene.wave.amplitude * sphere.static_overlap,
            "t0_s": sphere.time_scale,
            "R_m": sphere.radius,
        }
        origin = {"scene": self.scene.to_toml(), "status": str(self.info.get("status", ""))}
        variables = {name: ("tau", getattr(self, name), said) for name, said in signals}
        coordinates = {"tau": ("tau", self.tau, tau[1])}
        return optional_package("xarray").Dataset(variables, coordinates, scales | origin)

    def to_netcdf(self, path: str | Path) -> None:
        """Write `to_xarray` as netCDF, which xarray, MATLAB, Julia and ncview read.

        Raises
        ------
        PackageMissingError
            Without xarray.
        """
        self.to_xarray().to_netcdf(path)

    def __repr__(self) -> str:
        end = f"tau 0..{self.tau[-1]:g}" if len(self.tau) else "empty"
        return f"<Record {self.scene.name}: {self.scene.wave_label}, {end}>"


def optional_package(name: str) -> Any:
    """Return an optional package.

    Raises
    ------
    PackageMissingError
        If it is not installed.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise PackageMissingError(f"{name} is not installed; pip install {name}") from error
