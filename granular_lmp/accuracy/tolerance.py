"""Run a scene to the accuracy that it asks for: runs of halved steps, until what they show of their error is enough.

The runs go up the ladder h, h/2, h/4, … that `granular_lmp.accuracy.ladder` begins. After each the answer is
extrapolated from the last three, and its error estimated from how much the last run moved it
(`granular_lmp.accuracy.richardson`): no theory of the wave is asked, so this is the same for every wave and every
effect. A run is added until the estimate meets the tolerance, or the ladder ends and the tolerance is refused.

The folder holds a run folder for each step, ``N_per_sample``, and the extrapolated ``trajectory.csv`` beside
``scene.toml`` and ``run.json``.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from shlex import quote
from typing import Any

from granular_lmp.accuracy.budget import error_budget
from granular_lmp.accuracy.ladder import MOST_RUNGS, RUNGS, first_step, with_step
from granular_lmp.accuracy.richardson import answer, estimate
from granular_lmp.accuracy.rounding import check_floor, linear_signals
from granular_lmp.errors import GranularError, RunFolderError, RunInterrupted, ToleranceError
from granular_lmp.lammps.deck import Deck, deck_of
from granular_lmp.lammps.outputs import CHECKPOINTS, PER_SAMPLE, SWEEP, replace_text, writable
from granular_lmp.problem import prepare
from granular_lmp.runs import launch
from granular_lmp.runs.agreement import refuse_other_scene, scene_digest
from granular_lmp.runs.folder import clear, locked
from granular_lmp.runs.record import (
    STATUS,
    TRAJECTORY,
    Record,
    read_status,
    write_status,
)
from granular_lmp.scene.scene import Scene

OneRun = Callable[[Scene, Path, launch.Progress | None], Record]


def run(
    what: Scene | Deck,
    folder: str | Path,
    *,
    launcher: str = "module",
    ranks: int = 1,
    force: bool = False,
    progress: launch.Progress | None = None,
) -> Record:
    """Run a scene, or a deck whose text may have been edited, and return the record of the centre sphere.

    A scene with ``time.tolerance`` is run with smaller and smaller steps until the estimated error meets it.

    Parameters
    ----------
    what : Scene or Deck
        Of a deck that was edited, `resume` does not know the edits.
    folder : path
        The run folder, made here. What it will hold: ``scene.toml``, ``in.NAME``, ``data.NAME``, ``log.lammps``,
        ``dump.centre``, ``trajectory.csv``, ``run.json``, with snapshots of all spheres ``dump.particles``, and of a
        run that was stopped or is long ``checkpoint.*``. With a tolerance: such a folder for each step, and the
        extrapolated ``trajectory.csv``.
    launcher : "module" or "lmp"
        In this process, or the program ``lmp``. More than one rank always means the program.
    ranks : int
        MPI ranks.
    force : bool
        Run again in a folder that is there; what an earlier run wrote is deleted, all else there is kept.
    progress : callable, optional
        Called as ``progress(step, steps)`` about ten times a second; the steps grow when more runs are needed.

    Returns
    -------
    Record
        With a tolerance ``info["error_estimate"]`` holds the relative L2 errors of its p, q, phi (None where symmetry
        makes one zero).

    Raises
    ------
    SceneError
        Before anything is run, when the scene cannot be: effects that do not go together, a step beyond the stability
        limit, a tolerance below what rounding or the walls leave of the linear wave.
    RunFolderError
        When the folder is there (without `force`) or cannot be written.
    LaunchError
        For another launcher, or more ranks than cores.
    LammpsMissingError, LammpsError
    EffectError
        When the run is done but an effect that its deck leaves out was there (`granular_lmp.lammps.guards`).
    ToleranceError
        When the tolerance is below what rounding leaves of the signals that the first run shows, or the shortest step
        misses it.
    RunInterrupted
        On Ctrl-C: LAMMPS stops within a second, ``run.json`` says so, what was recorded is kept; see `resume`.
    """
    options = launch.Options(launcher, ranks, force, progress)
    if isinstance(what, Deck):
        return _with_budget(launch.launch(what, folder, options))
    if what.time.tolerance is None:
        return _with_budget(launch.launch(deck_of(prepare(what)), folder, options))
    return _to_tolerance(what, folder, options)


def _with_budget(record: Record) -> Record:
    """Return the record of one run with what it knows of its errors, which ``run.json`` then holds too."""
    assert record.folder is not None
    info = record.info | {"error_budget": error_budget(record.scene, record.signals)}
    with writable(record.folder):
        write_status(record.folder, info)
    return replace(record, info=info)


def resume(folder: str | Path, *, progress: launch.Progress | None = None) -> Record:
    """Continue an interrupted run, or the runs of an interrupted scene with a tolerance (`launch.resume`)."""
    folder = Path(folder).absolute()
    if (folder / SWEEP).is_file():
        raise RunFolderError(f"{folder}: holds a sweep; the same sweep command again does what is missing")
    info = read_status(folder)
    if "tolerance" not in info:
        return _with_budget(launch.resume(folder, progress=progress))
    if info.get("status") == "finished":
        raise RunFolderError(f"{folder}: the run is finished; there is nothing to resume")
    refuse_other_scene(folder, info)

    if not {"launcher", "ranks"} <= set(info):
        raise RunFolderError(f"{folder}: {STATUS} does not say how the run was started; run it again with force=True")

    started = launch.Options(info["launcher"], info["ranks"], force=True)

    def one(scene: Scene, place: Path, told: launch.Progress | None) -> Record:
        if (place / STATUS).is_file() and read_status(place).get("status") == "finished":
            return Record.load(place)
        if any((place / name).is_file() for name in CHECKPOINTS):
            return launch.resume(place, progress=told)
        return launch.launch(deck_of(prepare(scene)), place, replace(started, progress=told))

    with locked(folder):
        return refine(Scene.load(folder / "scene.toml"), folder, one, progress, info)


def _to_tolerance(scene: Scene, folder: str | Path, options: launch.Options) -> Record:
    scene = prepare(scene).scene
    check_floor(scene, linear_signals(scene))
    folder = Path(folder).absolute()
    digest = scene_digest(scene.to_toml())
    info = {
        "name": scene.name,
        "scene_sha256": digest,
        "tolerance": scene.time.tolerance,
        "launcher": options.launcher,
        "ranks": options.ranks,
    }

    def one(scene: Scene, place: Path, told: launch.Progress | None) -> Record:
        # By force: a folder of the user's own files may have been left there
        return launch.launch(deck_of(prepare(scene)), place, replace(options, force=True, progress=told))

    with locked(folder, make=True, force=options.force):
        clear(folder)
        with writable(folder):
            replace_text(folder / "scene.toml", scene.to_toml())
        return refine(scene, folder, one, options.progress, info)


def refine(scene: Scene, folder: Path, one: OneRun, progress: launch.Progress | None, info: dict[str, Any]) -> Record:
    """Run with smaller and smaller steps until the estimate meets the tolerance; ``run.json`` says how that ended.

    Parameters
    ----------
    scene : Scene
        With ``time.tolerance``.
    folder : Path
        Is there, and gets ``trajectory.csv`` and ``run.json``.
    one : callable
        Makes one run: of a scene with a time step, in a folder, telling its progress.
    progress : callable, optional
    info : dict
        What ``run.json`` is to hold of the whole.
    """
    tolerance = scene.time.tolerance
    assert tolerance is not None
    per_sample = round(scene.time.sample / first_step(scene))
    records: list[Record] = []
    said: list[str] = []
    found: dict[str, float] = {}
    with writable(folder):
        write_status(folder, info | {"status": "running", "message": "started"})
    try:
        for rung in range(MOST_RUNGS):
            count = per_sample << rung
            stepped = with_step(scene, scene.time.sample / count)
            # The runs before this one made count − per_sample steps a sample
            before, all_ = count - per_sample, (per_sample << max(rung + 1, RUNGS)) - per_sample
            told = _offset(progress, before * scene.time.samples, all_ * scene.time.samples)
            records.append(one(stepped, folder / f"{count}{PER_SAMPLE}", told))
            if rung == 0:
                check_floor(scene, records[0].signals, ToleranceError)
                continue
            found = estimate(records)
            if all(error <= tolerance for error in found.values()):  # a nan is not
                break
            if rung + 1 >= RUNGS:
                said.append(f"steps down to {stepped.time.step!r} tau: {_worst(found)}; halved")
        else:
            raise ToleranceError(
                f"time.tolerance = {tolerance!r}: not met with steps down to {records[-1].scene.time.step!r} tau, "
                f"{_worst(found)}; the runs are kept in {folder}"
            )
    except BaseException as error:  # also what the caller's progress raises: the folder must say how the run ended
        if isinstance(error, RunInterrupted | KeyboardInterrupt):
            resumed_by = f"granular-lmp resume {quote(str(folder))}"
            error = RunInterrupted(f"{folder}: interrupted; what was recorded is kept; continue with: {resumed_by}")
        message = str(error) if isinstance(error, GranularError) else type(error).__name__
        status = "interrupted" if isinstance(error, RunInterrupted) else "failed"
        write_status(folder, info | {"status": status, "message": message})
        raise error from None
    record = answer(records)
    runs = [run.info for run in records]
    outcome = {
        "error_estimate": {name: found.get(name) for name in ("p", "q", "phi")},
        "error_budget": error_budget(scene, record.signals, found),
        "extrapolated_from": [run.scene.time.step for run in records[-3:]],
        "refinements": said,
        "steps": sum(run["steps"] for run in runs),
        "wall_seconds": {
            key: sum(run["wall_seconds"][key] or 0.0 for run in runs) for key in ("total", "loop", "other")
        },
        "status": "finished",
        "message": "",
    }
    with writable(folder):
        record.write_csv(folder / TRAJECTORY)
        write_status(folder, record.info | info | outcome)
    return Record.load(folder)


def _worst(found: dict[str, float]) -> str:
    name = max(found, key=lambda key: found[key])
    return f"estimated error {found[name]:.2g} of {name}"


def _offset(progress: launch.Progress | None, before: int, total: int) -> launch.Progress | None:
    """The progress of one run as a part of all of them."""
    return None if progress is None else lambda step, _: progress(before + step, total)
