"""Run a scene to its tolerance: halve the time step until the estimated error is small enough.

The steps h, h/2, h/4, … start at the step that `granular_lmp.accuracy.ladder` chooses. After each run the answer is
extrapolated from the last three runs, and its error is estimated from the change that the last run made
(`granular_lmp.accuracy.richardson`). The estimate uses no theory of the wave, so it holds for every wave and every
effect. Runs are added until the estimate meets the tolerance, or the ladder ends and the tolerance is refused.

The folder holds a run folder for each step, ``N_per_sample``, and the extrapolated ``trajectory.csv`` beside
``scene.toml`` and ``run.json``.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

from granular_lmp.accuracy.budget import error_budget
from granular_lmp.accuracy.estimates import estimate_of
from granular_lmp.accuracy.halving import One, begun, continued, halved
from granular_lmp.accuracy.ladder import plan
from granular_lmp.accuracy.recorded import write_answer
from granular_lmp.accuracy.richardson import combined_record
from granular_lmp.accuracy.rounding import check_floor, linear_signals
from granular_lmp.errors import RunFolderError
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.outputs import SWEEP, writable
from granular_lmp.problem import Problem, prepare
from granular_lmp.runs import launch
from granular_lmp.runs.continuation import read_unfinished
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.folder import locked
from granular_lmp.runs.formats import scene_of
from granular_lmp.runs.manifest import wall_seconds
from granular_lmp.runs.options import Options, Progress, options_of
from granular_lmp.runs.readouts import readouts_of
from granular_lmp.runs.record import TRAJECTORY, Record, write_status
from granular_lmp.runs.seal import files_of
from granular_lmp.scene.scene import Scene


def run(
    what: Scene | Deck,
    folder: str | Path,
    *,
    launcher: str = "module",
    ranks: int = 1,
    force: bool = False,
    progress: Progress | None = None,
    kernel: bool = False,
) -> Record:
    """Run a scene, or a deck whose text may have been edited, and return the record of the centre sphere.

    A scene with ``time.tolerance`` is run with smaller and smaller steps until the estimated error meets it.

    Parameters
    ----------
    what : Scene or Deck
        Simulation to run. `resume` rebuilds the deck from the scene and so loses edits of its text.
    folder : path
        Run folder, which is created. It will hold ``scene.toml``, ``in.NAME``, ``data.NAME``, ``log.lammps``,
        ``dump.centre``, ``trajectory.csv`` and ``run.json``; ``dump.particles`` if the scene has snapshots of all
        spheres; ``checkpoint.*`` while a long run lasts and after it is stopped. With a tolerance it holds such a
        folder for each step and the extrapolated ``trajectory.csv``.
    launcher : "module" or "lmp"
        Run LAMMPS in this process, or as the program ``lmp``. More than one rank always uses the program.
    ranks : int
        Number of MPI ranks.
    force : bool
        Run again in an existing folder: the files of the earlier run are deleted, all other files are kept.
    progress : callable, optional
        Callback ``progress(step, steps)``, called about ten times a second; `steps` grows if more runs are needed.
    kernel : bool
        Compute contacts with the library that `granular_lmp.lammps.kernel.library.build` made: the same numbers in less
        time (docs/how-long.md).

    Returns
    -------
    Record
        Record of the centre sphere. With a tolerance ``info["error_estimate"]`` holds the relative L2 errors of p, q
        and phi, None for a signal that vanishes by symmetry.

    Raises
    ------
    SceneError
        Before anything is run, if effects contradict each other, the time step is beyond the stability limit, or the
        tolerance is below the error that rounding or the walls leave in the linear wave.
    RunFolderError
        If the folder exists (without `force`) or cannot be written.
    LaunchError
        If the launcher is unknown, there are more ranks than cores, or the kernel does not know a contact of the deck.
    LammpsMissingError
        If LAMMPS, its MPI library, a package or the kernel is missing.
    LammpsError
        If LAMMPS stops with an error, or its output is incomplete.
    EffectError
        If the run is complete but a guard triggered: an effect that the deck leaves out occurred
        (`granular_lmp.lammps.guards`).
    ToleranceError
        If the tolerance is below the rounding error of the first run's signals, or the shortest step misses it.
    RunInterrupted
        On Ctrl-C. LAMMPS stops within a second, ``run.json`` is updated, and the record so far is kept; see `resume`.

    Notes
    -----
    *Good values*: ``time.tolerance`` from 1e-2 to 1e-4. At 1e-5 some waves take more than 256 steps per sample, and
    below it the rounding of positions dominates (docs/accuracy.md).

    Examples
    --------
    >>> record = run(Scene.load("tr_periodic").with_values({"time.duration": 10.0}), "runs/short")
    >>> record.info["status"], record.tau.shape
    ('finished', (21,))
    """
    folder = absolute(folder)
    options = Options(launcher, ranks, force, progress, kernel)
    if isinstance(what, Deck) or what.time.tolerance is None:
        return launch.launch(what, folder, options, _budget)
    return _to_tolerance(what, folder, options)


def run_impact(what: Scene | Deck, folder: str | Path, options: Options | None = None) -> Record:
    """Run a scene or a deck as `run` does, with options in one object: the name of release 0.1."""
    given = options or Options()
    names = ("launcher", "ranks", "force", "progress", "kernel")
    return run(what, folder, **{name: getattr(given, name) for name in names})


def _budget(record: Record) -> dict[str, Any]:
    return {} if record.scene.wave is None else {"error_budget": error_budget(record.scene, record.signals)}


def resume(folder: str | Path, *, progress: Progress | None = None) -> Record:
    """Continue an interrupted run, or the runs of an interrupted scene with a tolerance.

    Parameters
    ----------
    folder : path
        Run folder.
    progress : callable, optional
        As in `run`.

    Returns
    -------
    Record

    Raises
    ------
    RunFolderError
        If the folder holds no run, a sweep, a finished run, a changed scene, or no checkpoint.
    LammpsMissingError, LammpsError, EffectError, ToleranceError, RunInterrupted
        As in `run`.

    Examples
    --------
    >>> scene = Scene.load("tr_periodic").with_values({"time.duration": 4.0})
    >>> record = run(scene, "runs/whole")
    >>> resume("runs/whole")
    Traceback (most recent call last):
    granular_lmp.errors.RunFolderError: ...the run is finished; there is nothing to resume
    """
    folder = absolute(folder)
    if (folder / SWEEP).is_file():
        raise RunFolderError(f"{folder}: holds a sweep; the same sweep command again does what is missing")
    info = read_unfinished(folder)
    scene = scene_of(folder)
    if scene.time.tolerance is None:
        return launch.resume(folder, progress=progress, judge=_budget)
    one = continued(_one(options_of(folder, info)), lambda place, part: launch.resume(place, progress=part))
    with locked(folder):
        return refine(prepare(scene), folder, one, progress, info)


def _to_tolerance(scene: Scene, folder: Path, options: Options) -> Record:
    problem = prepare(scene)
    plan(problem)  # raises before anything is written
    if scene.wave is not None:
        check_floor(problem.scene, linear_signals(problem.scene))
    kernel = {"kernel": library.description()} if options.kernel else {}
    with begun(problem.scene, folder, options) as info:
        return refine(problem, folder, _one(options), options.progress, info | kernel)


def _one(options: Options) -> One:
    """Return what makes a run with a step; forced, because its folder may exist and hold files of the user."""
    return lambda scene, place, part: launch.launch(scene, place, replace(options, force=True, progress=part))


def refine(problem: Problem, folder: Path, one: One, progress: Progress | None, info: dict[str, Any]) -> Record:
    """Run with smaller and smaller steps until the estimate meets the tolerance, and write ``run.json`` of the whole.

    Parameters
    ----------
    problem : Problem
        Problem of a scene with ``time.tolerance``.
    folder : Path
        Existing folder for the answer and ``run.json``.
    one : callable
        Function of scene, folder and progress callback that makes one run of a scene with a time step.
    progress : callable, optional
        As in `run`.
    info : dict
        Entries of ``run.json`` that are known before the runs.

    Returns
    -------
    Record
        Extrapolated record.

    Raises
    ------
    ToleranceError
        As in `run`.
    """
    scene, estimate = problem.scene, estimate_of(problem)
    records, judgement, refinements = halved(scene, folder, plan(problem), one, estimate, progress, info)
    record, runs = combined_record(records, judgement), [each.info for each in records]
    outcome = {
        **estimate.outcome(judgement, record),
        "extrapolated_from": [
            run.scene.time.step for run, weight in zip(records, judgement.weights, strict=True) if weight
        ],
        "refinements": refinements,
        "steps": sum(run["steps"] for run in runs),
        "wall_seconds": _all_seconds(runs),
        "status": "finished",
        "message": "",
    }
    with writable(folder):
        if scene.wave is not None:
            record.write_csv(folder / TRAJECTORY)
        write_answer(folder, records, judgement.weights)
        outcome |= readouts_of(replace(record, scene=scene, folder=folder))
        found_out = record.info | info | outcome | {"files": files_of(folder)}
        write_status(folder, found_out)
    return replace(record, scene=scene, info=found_out, folder=folder)


def _all_seconds(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return ``wall_seconds`` of all runs together."""
    together: dict[str, Any] = {}
    for run in runs:
        together = wall_seconds(together, run["wall_seconds"].get("phases", {}))
    return together
