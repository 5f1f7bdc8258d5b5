"""Run a scene, or continue its run: one run with its time step, or runs to its tolerance.

`granular_lmp.accuracy.refinement` makes the runs to a tolerance.
"""

from pathlib import Path
from typing import Any

from granular_lmp.accuracy.budget import error_budget
from granular_lmp.errors import RunFolderError
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.outputs import SWEEP
from granular_lmp.problem import Problem, prepare
from granular_lmp.rest.scene import Scene
from granular_lmp.runs import launch
from granular_lmp.runs.continuation import read_unfinished
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.engine import Engine
from granular_lmp.runs.formats import scene_of
from granular_lmp.runs.options import Options, Progress
from granular_lmp.runs.record import Record
from granular_lmp.scene.clock import Step

__all__ = ["resume", "run"]


def run(
    what: Scene | Deck,
    folder: str | Path,
    *,
    launcher: str = "module",
    ranks: int = 1,
    force: bool = False,
    progress: Progress | None = None,
    kernel: bool | None = None,
    engine: Engine | None = None,
) -> Record:
    """Run a scene, or a deck, whose text may be edited, and return the record of the centre sphere.

    A scene with ``time.tolerance`` is run with ever smaller steps until the estimated error meets the tolerance.

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
    kernel : bool, optional
        Compute contacts with the library that `granular_lmp.lammps.kernel.library.build` made: the same numbers in less
        time. By default it is used if it was built and supports the contacts. True requires it, False turns it off;
        ``info["kernel"]`` says that it was used.
    engine : Engine, optional
        Engine that takes the steps in place of LAMMPS (`granular_lmp.runs.engine`).

    Returns
    -------
    Record
        Record of the centre sphere. With a tolerance ``info["error_estimate"]`` holds the relative L2 errors of p, q
        and phi, None for a signal that vanishes by symmetry.

    Raises
    ------
    SceneError
        Before any run, if effects contradict each other, the time step is beyond the stability limit, or the tolerance
        is below the error of rounding or walls in the linear wave.
    RunFolderError
        If the folder exists (without `force`) or cannot be written.
    LaunchError
        If the launcher is unknown, there are more ranks than cores, or a required kernel does not support a contact.
    LammpsMissingError
        If LAMMPS, its MPI library, a package or the kernel is missing.
    LammpsError
        If LAMMPS stops with an error, or its output is incomplete.
    EffectError
        If the run is complete but a guard triggered: an effect that the deck leaves out occurred
        (`granular_lmp.lammps.guards`).
    ToleranceError
        If the tolerance is below the rounding error of the signals in the first run, or the shortest step misses it.
    RunInterrupted
        On Ctrl-C. LAMMPS stops within a second, ``run.json`` is updated, and the record so far is kept; see `resume`.

    Notes
    -----
    *Good values*: ``time.tolerance`` from 1e-2 to 1e-4. At 1e-5 some waves take more than 256 steps per sample, and
    below it the rounding of positions dominates.

    Examples
    --------
    >>> record = run(Scene.load("tr_periodic").with_values({"time.duration": 10.0}), "runs/short")
    >>> record.info["status"], record.tau.shape
    ('finished', (21,))
    """
    folder = absolute(folder)
    options = Options(launcher, ranks, force, progress, kernel, engine)
    if isinstance(what, Deck) or isinstance(what.time.clock, Step):
        return launch.launch(what, folder, options, _budget)
    from granular_lmp.accuracy.refinement import to_tolerance  # kept out of start-up

    return to_tolerance(prepare(what), folder, options)


def run_impact(what: Scene | Deck, folder: str | Path, options: Options | None = None) -> Record:
    """Run a scene or a deck as `run` does, with options in one object: the name of release 0.1."""
    given = options or Options()
    names = ("launcher", "ranks", "force", "progress", "kernel")
    return run(what, folder, **{name: getattr(given, name) for name in names})


def _budget(problem: Problem, record: Record) -> dict[str, Any]:
    return {} if problem.wave is None else {"error_budget": error_budget(problem, record.signals)}


def resume(folder: str | Path, *, progress: Progress | None = None, engine: Engine | None = None) -> Record:
    """Continue an interrupted run, or the runs of an interrupted scene with a tolerance.

    Parameters
    ----------
    folder : path
        Run folder.
    progress, engine : optional
        As in `run`; the same engine must continue a run.

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
        raise RunFolderError(f"{folder}: holds a sweep; repeat its sweep command to run what is missing")
    info = read_unfinished(folder)
    if isinstance(scene_of(folder).time.clock, Step):
        return launch.resume(folder, progress=progress, judge=_budget, engine=engine)
    from granular_lmp.accuracy.refinement import resumed  # kept out of start-up

    return resumed(folder, info, progress, engine)
