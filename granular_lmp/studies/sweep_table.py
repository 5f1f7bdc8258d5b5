"""The table of a sweep: a row for each point of the outer product, read from ``sweep.json`` and the run folders."""

import csv
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import GranularError, RunFolderError, SceneError
from granular_lmp.lammps.outputs import SCENE, SWEEP
from granular_lmp.runs.record import Record, optional_package, read_status
from granular_lmp.scene.scene import Scene
from granular_lmp.studies.sweep_points import concrete_hash, points

Point = dict[str, Any]

RUNS = "runs"
# Columns of the table beside the swept values: entries of run.json, and the largest |p|, |q|, |phi| of the record
SWEEP_COLUMNS = (
    *("run", "status", "message", "seconds", "steps", "particles", "wavenumber_used", "direction_used", "frequency"),
    *("largest_p", "largest_q", "largest_phi", "guards"),
)


@dataclass(frozen=True, repr=False)
class Sweep:
    """A sweep, finished or not.

    Attributes
    ----------
    folder : Path
        Sweep folder.
    scene : Scene
        Scene whose values are varied.
    over : dict of str to list
        Dotted key → its values.
    rows : list of dict
        Swept values and `SWEEP_COLUMNS` for each point of the outer product, the last key running fastest. ``status``
        is "finished", "failed" or "unfinished"; unknown values are None. ``frequency`` is in rad/t0, and ``guards``
        names the guards that triggered.
    """

    folder: Path
    scene: Scene
    over: dict[str, list[Any]]
    rows: list[Point]

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Read a sweep from its run folders.

        Raises
        ------
        RunFolderError
            If the folder holds no sweep, or a run folder holds the run of another scene.
        SceneError
            If the scene is not valid in this version.
        """
        folder = Path(folder).absolute()
        request = read_request(folder)
        if request is None:
            raise RunFolderError(f"{folder}: not a sweep folder (there is no {SWEEP})")
        scene, over = Scene.from_dict(request["scene"]), request["over"]
        asked = points(scene, over)
        rows = {name: row_of(folder / RUNS / name) for _, name, _ in asked}
        return cls(folder, scene, over, table_of(asked, rows))

    def column(self, name: str) -> NDArray[Any]:
        """Return one column of the table in the order of `rows`; unknown numbers are nan."""
        values = [row[name] for row in self.rows]
        numbers = all(value is None or isinstance(value, (int, float)) for value in values)
        return np.array(values, dtype=float if numbers else None)

    def record(self, row: Point) -> Record:
        """Return the record of the run of a row.

        Raises
        ------
        RunFolderError
            If the folder holds no finished run, or the run of another scene.
        """
        folder = self.folder / row["run"]
        _refuse_other_point(folder)
        return Record.load(folder)

    def having(self, status: str) -> list[Point]:
        """Return the rows with this status."""
        return [row for row in self.rows if row["status"] == status]

    def to_csv(self) -> str:
        """Return the table as CSV, each number in the shortest form that reads back to the same double."""
        stream = io.StringIO()
        writer = csv.DictWriter(stream, [*self.over, *SWEEP_COLUMNS], lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.rows)
        return stream.getvalue()

    def to_pandas(self) -> Any:
        """Return the table as a ``pandas.DataFrame``.

        Raises
        ------
        PackageMissingError
            If pandas is not installed.
        """
        return optional_package("pandas").DataFrame(self.rows, columns=[*self.over, *SWEEP_COLUMNS])

    def to_xarray(self) -> Any:
        """Return the table as an ``xarray.Dataset`` with a dimension for each swept key.

        Raises
        ------
        PackageMissingError
            If pandas or xarray is not installed.
        """
        optional_package("xarray")
        return self.to_pandas().set_index([*self.over]).to_xarray()

    def __repr__(self) -> str:
        asked = " x ".join(f"{key} ({len(values)})" for key, values in self.over.items())
        counts = (f"{len(self.having(status))} {status}" for status in ("finished", "failed", "unfinished"))
        return f"<Sweep {self.folder}: {asked}; {', '.join(counts)}>"


def read_request(folder: Path) -> dict[str, Any] | None:
    """Return the contents of ``sweep.json``, or None without the file."""
    path = folder / SWEEP
    try:
        request = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(request["over"], dict) or not isinstance(request["scene"], dict):
            raise TypeError("over and scene must be JSON objects")
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise RunFolderError(f"{path}: cannot be read: {error}") from error
    return {"over": request["over"], "scene": request["scene"]}


def status_of(folder: Path) -> dict[str, Any]:
    """Return the contents of ``run.json``, empty if the folder holds none that can be read."""
    try:
        return read_status(folder)
    except RunFolderError:
        return {}


def table_of(asked: list[tuple[Point, str, Scene]], rows: dict[str, Point]) -> list[Point]:
    """Return a row for each point of the asked; points of the same scene share a run."""
    return [point | rows[name] | {"run": f"{RUNS}/{name}"} for point, name, _ in asked]


def _refuse_other_point(folder: Path) -> None:
    """Raise RunFolderError if the hash of the scene in a run folder is not the name of the folder.

    A scene that cannot be read is reported by `Record.load`.
    """
    try:
        scene = Scene.load(folder / SCENE)
    except SceneError:
        return
    name = concrete_hash(scene)
    if name != folder.name:
        raise RunFolderError(
            f"{folder}: holds the run of another scene ({scene.wave_label}), that of {RUNS}/{name}; "
            "move it there, or away, and start the sweep again"
        )


def row_of(folder: Path) -> Point:
    """Return the row of a run folder, also of one that does not exist yet.

    Raises
    ------
    RunFolderError
        If it holds the run of another scene, which a new run would destroy.
    """
    info = status_of(folder)
    if info:
        _refuse_other_point(folder)
    if info.get("status") != "finished":
        return summary(info, None)
    try:
        return summary(info, Record.load(folder))
    except GranularError as error:  # the files of the run are damaged
        return summary(info | {"status": "failed", "message": str(error)}, None)


def summary(info: dict[str, Any], record: Record | None) -> Point:
    """Return the row of a run, but for its swept values, from its ``run.json`` and, if it is finished, its record."""
    ended = info.get("status") in ("finished", "failed")
    return {
        "status": info["status"] if ended else "unfinished",
        "message": info.get("message", "") if ended else "",
        "seconds": info.get("wall_seconds", {}).get("total"),
        **{name: info.get(name) for name in ("steps", "particles", "wavenumber_used", "direction_used", "frequency")},
        **{f"largest_{name}": _largest(record, name) for name in ("p", "q", "phi")},
        "guards": " ".join(name for name, guard in info.get("guards", {}).items() if not guard["quiet"]),
    }


def _largest(record: Record | None, name: str) -> float | None:
    return None if record is None else float(np.abs(getattr(record, name)).max())
