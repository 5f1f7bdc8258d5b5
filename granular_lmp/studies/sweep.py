"""Sweep: runs of one scene for the outer product of lists of values, on any executor.

A sweep folder holds ``sweep.json`` (the request), ``runs/HASH`` (a run folder for each scene, named by a hash of the
scene) and ``sweep.csv`` (a line for each run). A sweep that was stopped, or is started again, reads the run folders,
runs missing points, and continues interrupted runs.
"""

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import suppress
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy.tolerance import resume, run
from granular_lmp.card import HasCard
from granular_lmp.errors import GranularError, LammpsError, RunFolderError, RunInterrupted
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.outputs import SWEEP, csv_text, replace_text, writable, write_files
from granular_lmp.problem import Problem
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.engine import Engine
from granular_lmp.runs.folder import locked
from granular_lmp.runs.options import Options
from granular_lmp.runs.record import Record, optional_package, write_status
from granular_lmp.scene.schema import plain_value
from granular_lmp.studies.executors import Here, stop_requested, terminable
from granular_lmp.studies.rounding_warnings import remarks
from granular_lmp.studies.sweep_points import points
from granular_lmp.studies.sweep_request import TABLE, claim, read_request, scene_asked
from granular_lmp.studies.sweep_rows import (
    ASKED,
    RUNS,
    Point,
    info_of,
    row_of,
    said_of,
    summary_of,
    table_of,
)

__all__ = ["Sweep", "sweep"]

_log = logging.getLogger(__name__)

Progress = Callable[[int, int, float], None]

_LOOK = 0.02  # s between two checks for finished runs
_SAVE = 5.0  # s between two writes of the table
_OVERHEAD = 1e5  # spheres times steps that take as long as the other 20 ms of a warm run


@dataclass(frozen=True, repr=False)
class Sweep(HasCard):
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
        A row for each point of the outer product, with the last key running fastest. It holds the swept values as they
        ran and the columns of the scene: for a wave p, q, φ and the second harmonic
        (`granular_lmp.accuracy.second_harmonic`), otherwise the arrival at the farthest sphere
        (`granular_lmp.studies.far_sphere`). If other values ran than requested, as in a periodic cell, "KEY_asked"
        holds the requested ones. ``status`` is "finished", "failed" or "unfinished"; unknown values are None.
        ``frequency`` is in rad/t0, and ``guards`` names the guards that triggered. Readouts of monitors of motion
        follow (`granular_lmp.runs.readouts`): "NAME.u1", "NAME.u1_error", …
    notes : list of str
        Sentences on values that coincide in one run, with a remedy.

    Examples
    --------
    >>> scene = Scene.load("tr_periodic").with_values({"time.duration": 4.0})
    >>> found = sweep(scene, {"wave.amplitude": [0.1, 0.2]}, "sweeps/read")
    >>> print([f"{size:.1e}" for size in Sweep.load("sweeps/read").column("largest_p")])
    ['5.6e-04', '1.1e-03']
    """

    folder: Path
    scene: Scene
    over: dict[str, list[Any]]
    rows: list[Point]
    notes: list[str] = field(default_factory=list)

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Read a sweep from its run folders.

        Raises
        ------
        RunFolderError
            If the folder holds no sweep.
        SceneError
            If the scene is not valid in this version.
        """
        folder = absolute(folder)
        request = read_request(folder)
        if request is None:
            raise RunFolderError(f"{folder}: not a sweep folder (there is no {SWEEP})")
        scene, over = scene_asked(folder, request), request["over"]
        grid = points(scene, over, folder / RUNS)
        made, device = {point.run: point.of_run for point in grid}, request.get("device")
        rows = {name: row_of(folder / RUNS / name, each, device) for name, each in made.items()}
        return cls(folder, scene, over, table_of(grid, rows), remarks(each.scene for each in grid))

    @property
    def columns(self) -> list[str]:
        """Names of the columns of the table."""
        return list(self.rows[0])

    @property
    def main_columns(self) -> tuple[str, str]:
        """The two columns to draw and show first."""
        return ("far_speed", "far_tau") if self.scene.wave is None else ("largest_p", "second_harmonic")

    @property
    def axes(self) -> list[str]:
        """Column for the values of each key: the key, or "KEY_asked" if what runs depends on other keys too."""
        return [self._axis(key, f"{key}{ASKED}") for key in self.over]

    def _axis(self, key: str, asked: str) -> str:
        pairs = {(repr(row.get(asked)), repr(row[key])) for row in self.rows if asked in row}
        return key if len(pairs) == len({value for value, _ in pairs}) else asked

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
            If the folder holds no finished run.
        """
        return Record.load(self.folder / row["run"])

    def having(self, status: str) -> list[Point]:
        """Return the rows with this status."""
        return [row for row in self.rows if row["status"] == status]

    def write(self) -> None:
        """Write the table into the folder."""
        with writable(self.folder):
            replace_text(self.folder / TABLE, self.to_csv())

    def to_csv(self) -> str:
        """Return the table as CSV, each number in the shortest form that reads back to the same double."""
        return csv_text(self.columns, ([row[name] for name in self.columns] for row in self.rows))

    def to_pandas(self) -> Any:
        """Return the table as a ``pandas.DataFrame``.

        Raises
        ------
        PackageMissingError
            If pandas is not installed.
        """
        return optional_package("pandas").DataFrame(self.rows, columns=self.columns)

    def to_xarray(self) -> Any:
        """Return the table as an ``xarray.Dataset`` with a dimension for each swept key.

        Names have "_" in place of dots, so that ``data.wave_amplitude`` works; the attributes are ``units`` and
        ``long_name``, the name in the table. Coordinates are the values that ran, or the columns "KEY_asked" of `axes`.

        Raises
        ------
        PackageMissingError
            If pandas or xarray is not installed.
        """
        optional_package("xarray")
        table = self.to_pandas()
        data = table[~table[self.axes].astype(str).duplicated()].set_index(self.axes).to_xarray()
        for name in data.variables:
            data[name].attrs = said_of(name, self.scene)
        return data.rename({name: name.replace(".", "_") for name in data.variables}).assign_attrs(
            scene=self.scene.to_toml()
        )

    def __repr__(self) -> str:
        asked = " x ".join(f"{key} ({len(values)})" for key, values in self.over.items())
        counts = (f"{len(self.having(status))} {status}" for status in ("finished", "failed", "unfinished"))
        return f"<Sweep {self.folder}: {asked}; {', '.join(counts)}>"


# --- the sweep -------------------------------------------------------------------------------------------------------


def sweep(
    scene: Scene,
    over: Mapping[str, Iterable[Any]],
    folder: str | Path,
    *,
    executor: Executor | None = None,
    force: bool = False,
    progress: Progress | None = None,
    kernel: bool | None = None,
    engine: Engine | None = None,
) -> Sweep:
    """Run `scene` with every combination of the values in `over`; finished runs are not repeated.

    `Sweep.notes` are logged at level INFO before the first run.

    The row of a failed run holds the message, and the other runs continue. If the sweep is started again, failed runs
    are repeated and interrupted runs continue from their last checkpoint.

    Parameters
    ----------
    scene : Scene
        Scene whose values are varied.
    over : mapping of str to iterable
        Dotted key → values: ``{"wave.wavenumber": np.linspace(0.05, 3.1, 62), "wave.mode": ["TR", "RT"]}``.
    folder : path
        Sweep folder, which is created. Processes on other machines must see it under the same absolute path.
    executor : concurrent.futures.Executor, optional
        Executor of the runs, one at a time in each process; by default this process. It may be any object with a method
        ``submit(function, *arguments)`` whose results have ``done()``, ``result()`` and ``cancel()``.
    force : bool
        Use an existing folder, even of another sweep: ``sweep.json`` and ``sweep.csv`` are replaced, runs are kept and
        used.
    progress : callable, optional
        Callback ``progress(runs done, runs, seconds left)``.
    kernel : bool, optional
        As in `granular_lmp.run`. Finished runs are kept, with or without the kernel, as their numbers are the same.
    engine : Engine, optional
        As in `granular_lmp.run`. Only the same engine can continue a sweep; with `force`, runs of another engine are
        made again. Processes of an executor get a pickled copy.

    Raises
    ------
    SceneError
        If a key or value is not allowed, or the engine does not support a point; nothing is written before.
    RunFolderError
        If the folder exists and belongs to no such sweep (without `force`), or another sweep is in progress in it.
    LammpsMissingError
        If the kernel is required but was not built.
    RunInterrupted
        On Ctrl-C; finished runs are kept.

    Examples
    --------
    >>> scene = Scene.load("tr_periodic").with_values({"time.duration": 4.0})
    >>> sweep(scene, {"wave.amplitude": [0.05, 0.1]}, "sweeps/amplitude")
    <Sweep ...amplitude: wave.amplitude (2); 2 finished, 0 failed, 0 unfinished>
    """
    folder = absolute(folder)
    if kernel:
        library.built()
    asked = {key: plain_value([*values]) for key, values in over.items()}
    options = Options(kernel=kernel, engine=engine)
    request = {"over": asked, "scene": scene.given(), **({} if engine is None else {"device": engine.device})}
    grid = points(scene, asked, folder / RUNS, _refusal(engine))
    made, notes = {point.run: point.of_run for point in grid}, remarks(each.scene for each in grid)
    with locked(folder, make=True, force=True):
        claim(folder, request, force)
        write_files(folder, scene.beside)
        rows = {name: row_of(folder / RUNS / name, each, options.device) for name, each in made.items()}
        for note in notes:
            _log.info("%s", note)

        def save() -> Sweep:
            done = Sweep(folder, scene, asked, table_of(grid, rows), notes)
            done.write()
            return done

        todo = {name: each for name, each in made.items() if rows[name]["status"] != "finished"}
        if todo and engine is None and kernel is None and library.is_built():
            library.say_taken()  # runs in other processes do not log here
        cost = {point.run: point.work + _OVERHEAD for point in grid if point.run in todo}
        total = left = sum(cost.values())
        started = saved = time.monotonic()
        try:
            for name, row in _results(folder / RUNS, todo, executor or Here(), options):
                rows[name] = row
                left -= cost.pop(name)
                if progress is not None:
                    progress(len(made) - len(cost), len(made), (time.monotonic() - started) * left / (total - left))
                if time.monotonic() > saved + _SAVE:
                    save()
                    saved = time.monotonic()
        except (KeyboardInterrupt, RunInterrupted) as error:
            # some runs may have ended meanwhile
            rows |= {name: row_of(folder / RUNS / name, made[name], options.device) for name in cost}
            finished = sum(row["status"] == "finished" for row in rows.values())
            raise RunInterrupted(
                f"{folder}: interrupted; {finished} of {len(rows)} runs are finished and kept; the same command does "
                "the rest"
            ) from error
        finally:
            done = save()
    return done


def _refusal(engine: Engine | None) -> Callable[[Problem], None] | None:
    """Return a function that refuses problems which the engine does not support."""
    if engine is None:
        return None
    from granular_lmp.runs.stepping import refuse_unheld  # LAMMPS does without

    return partial(refuse_unheld, engine)


def _results(folder: Path, todo: dict[str, Scene], executor: Executor, options: Options) -> Iterator[tuple[str, Point]]:
    """Yield name and row of each run as it ends.

    The futures are polled, because the futures of some executors have no callbacks.
    """
    waiting: dict[Future[Point], str] = {}
    look_at = 0.0

    def done() -> Iterator[tuple[str, Point]]:
        nonlocal look_at
        started = time.monotonic()
        ready = [future for future in waiting if future.done()]
        look_at = started + max(_LOOK, 20 * (time.monotonic() - started))  # polling takes at most 5 % of the time
        for future in ready:
            name = waiting.pop(future)
            yield name, _result(todo[name], folder / name, options, future)

    try:
        for name, scene in todo.items():
            waiting[_submitted(executor, scene, folder / name, options)] = name
            if time.monotonic() > look_at:
                yield from done()
        while waiting:
            time.sleep(max(0.0, look_at - time.monotonic()))
            yield from done()
    finally:
        for future in waiting:
            future.cancel()


def _submitted(executor: Executor, scene: Scene, folder: Path, options: Options) -> "Future[Point]":
    """Return the future of a run; if the run fails at once or is refused, the future holds the error."""
    try:
        return executor.submit(run_point, scene, folder, options)
    except RunInterrupted:
        raise
    except Exception as error:  # also from a batch system that accepts no more jobs
        future: Future[Point] = Future()
        future.set_exception(error)
        return future


def run_point(scene: Scene, folder: Path, options: Options) -> Point:
    """Run or continue one run of a sweep and return its row; the executor calls this function.

    Raises
    ------
    RunInterrupted
        If the run is stopped.
    """

    def heed(step: int, steps: int) -> None:
        if step < steps and stop_requested():  # the last report comes after the end of the run
            raise KeyboardInterrupt

    try:
        with terminable():
            record = _continued(scene, folder, replace(options, progress=heed))
    except RunInterrupted:
        raise
    except (
        GranularError
    ) as error:  # as a row, because an exception with several arguments cannot be sent between processes
        return row_of(folder, scene, options.device) | {"status": "failed", "message": str(error)}
    return summary_of(scene, record.info, record)


def _continued(scene: Scene, folder: Path, options: Options) -> Record:
    """Continue a run from its checkpoint, however it ended, or start it; a run of another engine starts again."""
    info = info_of(folder)
    status = info.get("status", "finished")
    if status != "finished" and info.get("device") == options.device:
        # It has no checkpoint, or a guard failed it; other failures may occur again from the checkpoint
        with suppress(RunFolderError, *([LammpsError] if status == "failed" else [])):
            return resume(folder, progress=options.progress, engine=options.engine)
    return run(scene, folder, force=True, progress=options.progress, kernel=options.kernel, engine=options.engine)


def _result(scene: Scene, folder: Path, options: Options, future: "Future[Point]") -> Point:
    """Return the row of a run; if its process died, write the reason into its folder."""
    try:
        return future.result()
    except RunInterrupted:
        return row_of(folder, scene, options.device)
    except Exception as error:  # the executor or the machine failed for this run; the others continue
        message = str(error) if isinstance(error, GranularError) else f"{type(error).__name__}: {error}"
        message = " ".join(message.split())
    info = info_of(folder)
    if info.get("status") == "finished":  # only its result was lost
        return row_of(folder, scene, options.device)
    if info:
        with suppress(OSError):
            write_status(folder, info | {"status": "failed", "message": message})
    return row_of(folder, scene, options.device) | {"status": "failed", "message": message}
