"""The run folder: what a run leaves behind, and how to read it.

``dump.*`` and ``log.lammps`` are LAMMPS's, in the units of the deck; ``trajectory.csv`` holds p = v/D0, q = −u/D0
and φ = Rθ/D0 of the centre sphere over τ; ``run.json`` says how the run went. This module and `granular_lmp.sphere` are
what post-processing scripts may import.
"""

import csv
import hashlib
import io
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from granular_lmp.deck import DUMP, SCENE
from granular_lmp.deck import STATUS as STATUS
from granular_lmp.errors import GranularError as GranularError
from granular_lmp.errors import PackageMissingError, RunFolderError
from granular_lmp.scene import Scene
from granular_lmp.units import units_for

if TYPE_CHECKING:
    from granular_lmp.plots import Picture

TRAJECTORY = "trajectory.csv"
# The objects of run.json, and what each of their entries holds at least
_ENTRIES: dict[str, set[str]] = {
    "effects": {"on", "called_for", "guard"},
    "guards": {"effect", "quiet", "value", "meaning"},
    "versions": set(),
    "wall_seconds": set(),
}
_BUDGET = {"name", "of", "p", "q", "phi", "to_halve", "dominates"}
HEADER = ["tau", "p", "q", "phi"]
# Of a deck whose spheres turn and are tracked; whose spheres turn; whose spheres do not turn
DUMP_COLUMNS = (
    ["id", "ux", "uy", "theta", "vx", "vy", "omegaz"],
    ["id", "ux", "uy", "vx", "vy", "omegaz"],
    ["id", "ux", "uy", "vx", "vy"],
)
_LINES_BEFORE_ATOMS = 9  # of one snapshot of a LAMMPS text dump, of which this is the first
_SNAPSHOT = b"ITEM: TIMESTEP\n"


@dataclass(frozen=True, repr=False)
class Record:
    """Trajectory of the centre sphere, and where it comes from.

    Attributes
    ----------
    tau, p, q, phi : (T,) arrays
        Dimensionless time; longitudinal displacement v/D0, transverse displacement −u/D0, rotation Rθ/D0, which is 0
        where spheres do not turn and nan where they turn but are not tracked.
    scene : Scene
    info : dict
        Contents of ``run.json``.
    folder : Path or None
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
        """Read a run folder.

        Raises
        ------
        RunFolderError
            When a file is missing or malformed, or the run did not finish, unless `unfinished` runs are wanted too.
        """
        folder = Path(folder)
        info = read_status(folder)
        if info.get("status") != "finished" and not unfinished:
            raise RunFolderError(f"{folder}: not a finished run (status '{info.get('status')}': {info.get('message')})")
        scene = Scene.load(folder / SCENE)
        refuse_other_scene(folder, info)
        try:
            text = (folder / TRAJECTORY).read_text(encoding="utf-8")
            if not text.endswith("\n"):
                raise ValueError("its last line is cut off")
            lines = list(csv.reader(text.splitlines()))
            if lines[0] != HEADER:
                raise ValueError(f"header {lines[0]}, expected {HEADER}")
            tau, p, q, phi = np.array(lines[1:], dtype=float).reshape(-1, len(HEADER)).T
            if not (np.isfinite(tau).all() and (np.diff(tau) > 0).all()):
                raise ValueError("tau must be finite and ascend")
            if len(tau) != info.get("samples") and not unfinished:
                raise ValueError(f"{len(tau)} records, and {STATUS} says {info.get('samples')}")
        except (OSError, ValueError, IndexError, csv.Error) as error:
            raise RunFolderError(f"{folder / TRAJECTORY}: cannot be read: {error}") from error
        return cls(tau, p, q, phi, scene, info, folder)

    @classmethod
    def from_dump(cls, folder: str | Path, scene: Scene, dump: str = DUMP) -> Self:
        """Trajectory of a run folder from its dump, made dimensionless with the scene's D0 and R."""
        table = read_dump(Path(folder) / dump)
        displacement = scene.wave.amplitude * scene.sphere.static_overlap  # D0, m
        metre = units_for(scene.sphere.radius).number(1.0, length=1)
        untracked = np.full(len(table["step"]), np.nan if "omegaz" in table else 0.0)
        return cls(
            tau=table["step"] * scene.time.step,
            p=table["uy"] / (metre * displacement),
            q=-table["ux"] / (metre * displacement) + 0.0,
            phi=table.get("theta", untracked) * scene.sphere.radius / displacement,
            scene=scene,
            folder=Path(folder),
        )

    def write_csv(self, path: str | Path) -> None:
        """Write tau, p, q, phi, each number in the shortest form that reads back to the same double."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(HEADER)
        writer.writerows(np.column_stack([self.tau, self.p, self.q, self.phi]).tolist())
        replace_text(Path(path), stream.getvalue())

    @property
    def signals(self) -> dict[str, NDArray[np.float64]]:
        """p, q, φ by name."""
        return {"p": self.p, "q": self.q, "phi": self.phi}

    def plot(self) -> "Picture":
        """p, q, φ over τ, those that move; a notebook shows it."""
        from granular_lmp.plots import trajectory_figure  # matplotlib takes longer to load than most runs

        return trajectory_figure(self.tau, self.signals, self.scene)

    def to_pandas(self) -> Any:
        """Table (``pandas.DataFrame``) of p, q, phi over tau.

        Raises
        ------
        PackageMissingError
            Without pandas.
        """
        pandas = optional_package("pandas")
        return pandas.DataFrame(self.signals, index=pandas.Index(self.tau, name="tau"))

    def to_xarray(self) -> Any:
        """``xarray.Dataset`` of p, q, phi over tau; its attribute ``scene`` is the scene as TOML.

        Raises
        ------
        PackageMissingError
            Without xarray.
        """
        variables = {name: ("tau", values) for name, values in self.signals.items()}
        return optional_package("xarray").Dataset(variables, {"tau": self.tau}, {"scene": self.scene.to_toml()})

    def __repr__(self) -> str:
        wave = self.scene.wave
        end = f"tau 0..{self.tau[-1]:g}" if len(self.tau) else "empty"
        return f"<Record {self.scene.name}: {wave.mode} xi={wave.wavenumber:g} a={wave.amplitude:g}, {end}>"


def optional_package(name: str) -> Any:
    """A package that the user may have installed.

    Raises
    ------
    PackageMissingError
        When it is not.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise PackageMissingError(f"{name} is not installed; pip install {name}") from error


def read_status(folder: str | Path) -> dict[str, Any]:
    """Contents of ``run.json``.

    Raises
    ------
    RunFolderError
        When the folder holds none, or it is not of the form that a run writes.
    """
    path = Path(folder) / STATUS
    try:
        info = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise RunFolderError(f"{folder}: not a run folder (there is no {STATUS})") from error
    except (OSError, ValueError, RecursionError) as error:
        raise RunFolderError(f"{path}: cannot be read: {error}") from error
    if not isinstance(info, dict):
        raise RunFolderError(f"{path}: must hold a JSON object")
    for key, needed in _ENTRIES.items():
        table = info.get(key, {})
        if not isinstance(table, dict):
            raise RunFolderError(f"{path}: {key} must be a JSON object")
        for name, entry in table.items():
            if needed and not (isinstance(entry, dict) and needed <= set(entry)):
                raise RunFolderError(f"{path}: {key}.{name} must hold {', '.join(sorted(needed))}")
    budget = info.get("error_budget", [])
    if not (isinstance(budget, list) and all(isinstance(line, dict) and set(line) >= _BUDGET for line in budget)):
        raise RunFolderError(f"{path}: error_budget must be a list of objects with {', '.join(sorted(_BUDGET))}")
    return info


def scene_digest(text: str) -> str:
    """What ``run.json`` keeps of the ``scene.toml`` that was run: the SHA-256 of its text."""
    return hashlib.sha256(text.encode()).hexdigest()


def refuse_other_scene(folder: Path, info: dict[str, Any]) -> None:
    """RunFolderError if the folder's scene is not the one that was run."""
    said = info.get("scene_sha256")
    if said is not None and said != scene_digest((folder / SCENE).read_text(encoding="utf-8")):
        raise RunFolderError(f"{folder}: {SCENE} was changed since the run began; put it back, or run with --force")


def write_status(folder: str | Path, info: dict[str, Any]) -> None:
    """Write ``run.json``."""
    replace_text(Path(folder) / STATUS, json.dumps(info, indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def replace_text(path: Path, text: str) -> None:
    """Write a file in one piece: a reader, and a machine that stops, see the old or the new one, never half of it."""
    draft = _draft(path)
    draft.write_text(text, encoding="utf-8")
    os.replace(draft, path)


def _draft(path: Path) -> Path:
    return path.with_name(path.name + ".part")


def read_dump(path: str | Path) -> dict[str, NDArray[np.float64]]:
    """Columns of a one-particle LAMMPS text dump, by name, with ``step``; a snapshot cut short at the end is left out.

    Raises
    ------
    RunFolderError
        When the file cannot be read or has other columns than a deck of ours writes.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8").split("\n")[:-1]
        size = _LINES_BEFORE_ATOMS + 1
        whole = len(lines) // size * size
        names = lines[_LINES_BEFORE_ATOMS - 1].split()[2:] if whole else DUMP_COLUMNS[0]
        if names not in DUMP_COLUMNS:
            raise ValueError(f"columns {names}, expected {DUMP_COLUMNS[0]} or those without theta and omegaz")
        steps = np.array(lines[1:whole:size], dtype=float)
        rows = np.array([line.split() for line in lines[_LINES_BEFORE_ATOMS:whole:size]], dtype=float)
    except (OSError, ValueError) as error:
        raise RunFolderError(f"{path}: not a dump of one sphere: {error}") from error
    return {"step": steps} | dict(zip(names, rows.reshape(-1, len(names)).T, strict=True))


@dataclass(frozen=True)
class Snapshot:
    """A whole snapshot of a LAMMPS text dump: its step, its number of particles, and where in the file it stands."""

    step: int
    particles: int
    begin: int
    end: int


def snapshots(path: str | Path) -> Iterator[Snapshot]:
    """The whole snapshots of a LAMMPS text dump, in the order of the file, without those of no particles."""
    begin = end = lines = 0
    head: list[bytes] = []
    last = b""
    with Path(path).open("rb") as stream:
        for line in chain(stream, [_SNAPSHOT]):
            cut = line.find(_SNAPSHOT)
            if cut > 0:  # the one before was cut off within its last line
                lines, last = lines + 1, line[:cut]
            if cut >= 0:
                end += cut
                if _is_whole(head, lines - _LINES_BEFORE_ATOMS, last):
                    yield Snapshot(int(head[1]), int(head[3]), begin, end)
                begin, lines, head = end, 0, []
            last = line[max(cut, 0) :]
            if lines < _LINES_BEFORE_ATOMS:
                head.append(last)
            lines += 1
            end += len(last)


def _is_whole(head: list[bytes], particles: int, last: bytes) -> bool:
    numbers = [line.strip() for line in head[1:4:2]]
    return particles > 0 and all(map(bytes.isdigit, numbers)) and int(numbers[1]) == particles and last.endswith(b"\n")


def mend_dump(path: str | Path) -> None:
    """Make a dump that a stopped run wrote, or two runs one after the other, into that of one run.

    A snapshot cut off in the middle goes, and one without particles, which were lost; of those that the continuation
    wrote again, the first. A file that is already that of one run is left alone.
    """
    path = Path(path)
    kept: list[Snapshot] = []
    for snapshot in snapshots(path):
        while kept and kept[-1].step >= snapshot.step:
            kept.pop()
        kept.append(snapshot)
    if sum(each.end - each.begin for each in kept) == path.stat().st_size:
        return
    draft = _draft(path)
    with path.open("rb") as source, draft.open("wb") as target:
        for each in kept:
            source.seek(each.begin)
            target.write(source.read(each.end - each.begin))
    os.replace(draft, path)


def mend_log(path: str | Path) -> None:
    """Take the last line off a log that a killed run wrote if it was cut off, so that the continuation starts a new."""
    text = Path(path).read_bytes()
    os.truncate(path, text.rfind(b"\n") + 1)


def read_log(path: str | Path) -> tuple[dict[str, NDArray[np.float64]], float]:
    """Thermo table of the last run in a LAMMPS log, by column name, and the seconds that its time loop took.

    Runs with the same columns (a run and its continuations) are one table; the seconds are nan while none has ended. A
    last line without its end is left out.
    """
    tables: dict[tuple[str, ...], list[list[float]]] = {}
    seconds: dict[tuple[str, ...], float] = {}
    names: tuple[str, ...] = ()
    try:
        lines = Path(path).read_text(encoding="utf-8", errors="replace").split("\n")[:-1]
    except OSError as error:
        raise RunFolderError(f"{path}: cannot be read: {error}") from error
    inside = False
    for line in lines:
        words = line.split()
        if words[:1] == ["Step"]:
            names, inside = tuple(words), True
            tables.setdefault(names, [])
        elif words[:3] == ["Loop", "time", "of"]:
            seconds[names] = seconds.get(names, 0.0) + float(words[3])
            inside = False
        elif inside and len(words) == len(names):
            try:
                row = [float(word) for word in words]
            except ValueError:
                continue  # a warning between two thermo lines
            while tables[names] and tables[names][-1][0] >= row[0]:
                tables[names].pop()  # a continuation writes again what came after its checkpoint
            tables[names].append(row)
    rows = tables.get(names, [])
    table = np.array(rows, dtype=float).reshape(len(rows), len(names))
    return dict(zip(names, table.T, strict=True)), seconds.get(names, float("nan"))
