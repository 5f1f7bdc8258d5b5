"""A work–precision study: the cost of each setting of a run in seconds, and its accuracy.

Every setting of `granular_lmp.studies.cost_settings` is run in several rounds, so that other load on the machine
affects all settings alike. The time is the median of the rounds; the errors are those against LAMMPS itself,
extrapolated from fine steps (`granular_lmp.studies.cost_table`).

A study folder holds ``runs/NAME/N`` (a run folder for each round N), of a wave ``reference`` (a run folder whose
trajectory is the extrapolated one), and ``cost.json`` and ``cost.csv``, which are made from those. A study that was
stopped, or is started again, runs only what is missing; an interrupted run starts anew, because only a complete run has
a time.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from math import ceil
from pathlib import Path
from time import monotonic
from typing import Any

from granular_lmp.accuracy.ladder import sphere_steps
from granular_lmp.accuracy.tolerance import run as run_scene
from granular_lmp.errors import GranularError, LaunchError, RunFolderError, RunInterrupted, ToleranceError, one_line
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.laws import contacts
from granular_lmp.lammps.outputs import COST, replace_text, writable
from granular_lmp.problem import prepare
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.folder import locked, refuse_long
from granular_lmp.runs.options import core_count
from granular_lmp.studies.cost_settings import Setting, base, settings
from granular_lmp.studies.cost_table import NOT_MET, collect, is_done, place, to_csv
from granular_lmp.studies.forecast import speed
from granular_lmp.studies.sweep_points import scene_hash

COST_TABLE = "cost.csv"

Progress = Callable[[int, int, float], None]


@dataclass(frozen=True)
class Plan:
    """Plan of a study.

    Attributes
    ----------
    folder : Path
        Study folder.
    scene : Scene
        Scene of the study, `granular_lmp.studies.cost_settings.base` of the declared one.
    settings : list of Setting
        Settings to run, the reference first.
    left_out : dict
        Setting → reason why it cannot be run.
    repeats : int
        Number of rounds; the reference is run once. *Good values*: 5 or more, because times scatter.
    budget : float
        Time in seconds for the runs of `measure`. The longest settings, and later rounds, are left for another call if
        they do not fit. A run that has started is not stopped.
    kernel : bool
        True if the kernel computes the contacts of all runs.
    rate, overhead : float
        Spheres times steps per second, and seconds per run beside the time loop, from a short run of the scene.
    """

    folder: Path
    scene: Scene
    settings: list[Setting]
    left_out: dict[str, str]
    repeats: int
    budget: float
    kernel: bool
    rate: float = 1.0
    overhead: float = 0.0

    def todo(self) -> dict[Path, Scene]:
        """Return folder → run of those that are not done: the reference, then each round sorted by length."""
        first, *others = self.settings
        runs = sorted((run for each in others for run in each.runs), key=sphere_steps)
        wanted = [(run, 1) for run in first.runs]
        wanted += [(run, turn) for turn in range(1, self.repeats + 1) for run in runs]
        places = {place(self.folder, run, turn): run for run, turn in wanted}
        return {there: run for there, run in places.items() if not is_done(there)}

    def estimate(self, run: Scene) -> float:
        """Return the time of a run by the short run of the scene, s."""
        return self.overhead + sphere_steps(run) / self.rate

    @property
    def seconds(self) -> float:
        """Expected time of all runs that are not done, s."""
        return sum(map(self.estimate, self.todo().values()))


def plan(
    scene: Scene, folder: str | Path, *, repeats: int = 5, budget: float = float("inf"), kernel: bool | None = None
) -> Plan:
    """Return the plan of a study with its expected time, from a short run of the scene; the folder is not touched.

    Parameters
    ----------
    scene : Scene
        A running plane wave along y, or a scene without a wave.
    folder : path
        Study folder, new or of the same study.
    repeats, budget
        As in `Plan`.
    kernel : bool, optional
        As in `granular_lmp.run`. By default a study continues as it began.

    Raises
    ------
    SceneError
        If the scene cannot be run.
    RunFolderError
        If the folder exists and is not that of a study of this scene.
    LaunchError
        If the budget is too small for the reference, or the kernel does not know a contact.
    LammpsMissingError
        If the kernel is asked for and was not built.
    """
    folder, scene = absolute(folder), base(scene)
    kernel = _check_folder(folder, scene, kernel)
    if kernel:
        library.built()
    made, left_out = settings(scene)
    planned = Plan(folder, scene, made, left_out, repeats, budget, kernel)
    todo = planned.todo().values()
    if todo:
        rate, overhead = speed(scene, kernel)
        planned = replace(planned, rate=rate, overhead=overhead)
    least = sum(planned.estimate(run) for run in made[0].runs if run in todo)
    if least > budget:
        raise LaunchError(f"budget = {budget:g}: must be at least {ceil(least)} s, which the reference takes")
    return planned


def measure(plan: Plan, *, progress: Progress | None = None) -> dict[str, Any]:
    """Run the missing runs of a study and return the contents of ``cost.json``.

    Parameters
    ----------
    plan : Plan
    progress : callable, optional
        Callback ``progress(runs done, runs, seconds left)``.

    Raises
    ------
    RunFolderError
        If another study is at work in the folder.
    RunInterrupted
        On Ctrl-C; complete runs are kept, and the tables are made from them.
    GranularError
        If a run of the reference fails, without which no error is known.

    Notes
    -----
    If another run fails, its message stands in the table and the others continue. The errors are valid if the error of
    a run is of second order in the step, which the extrapolation of the reference assumes. They are not valid with
    sliding or opening contacts, the incremental law or dashpots.
    """
    failures: dict[str, str] = {}
    with locked(plan.folder, make=True, force=True):
        _save(plan, failures)  # marks the folder as that of this study, even if this process is killed
        todo, started, spent, expected = plan.todo(), monotonic(), 0.0, 0.0
        left = plan.seconds
        try:
            for done, (folder, run) in enumerate(todo.items(), 1):
                began, estimate, slower = monotonic(), plan.estimate(run), spent / expected if expected else 1.0
                if began - started + slower * estimate <= plan.budget:
                    _run(run, folder, plan, failures)
                    spent, expected = spent + monotonic() - began, expected + estimate
                left -= estimate
                if progress is not None:
                    progress(done, len(todo), min(slower * left, started + plan.budget - monotonic()))
        except (KeyboardInterrupt, RunInterrupted) as error:
            raise RunInterrupted(
                f"{plan.folder}: interrupted; {len(todo) - len(plan.todo())} of {len(todo)} runs were done and are "
                "kept, the same command again does the rest"
            ) from error
        finally:
            result = _save(plan, failures)
    return result


def _run(run: Scene, folder: Path, plan: Plan, failures: dict[str, str]) -> None:
    """Do one run; if it fails, note its message."""
    try:
        run_scene(run, folder, force=True, kernel=plan.kernel)
    except GranularError as error:
        if isinstance(error, RunInterrupted) or run in plan.settings[0].runs:
            raise
        # A tolerance that no step meets is an answer of the study, not a failure of it
        failures[scene_hash(run)] = NOT_MET * isinstance(error, ToleranceError) + str(error)


def _save(plan: Plan, failures: dict[str, str]) -> dict[str, Any]:
    """Write the tables from the complete runs and return the contents of ``cost.json``."""
    result: dict[str, Any] = {"scene": plan.scene.given(), "cores": core_count(), "left_out": plan.left_out}
    result |= {"kernel": True} if plan.kernel else {}
    result |= collect(plan.folder, plan.settings, plan.repeats, failures)
    with writable(plan.folder):
        replace_text(plan.folder / COST, json.dumps(result, indent=1, allow_nan=False) + "\n")
        replace_text(plan.folder / COST_TABLE, to_csv(result["points"]))
    return result


def _check_folder(folder: Path, scene: Scene, kernel: bool | None) -> bool:
    """Return whether the study of a folder takes the kernel.

    Raises RunFolderError if the folder exists and is not that of such a study of this scene.
    """
    refuse_long(folder)
    if folder.exists() and (not folder.is_dir() or (any(folder.iterdir()) and not (folder / COST).is_file())):
        raise RunFolderError(f"{folder}: is there already; choose another folder")
    if (folder / COST).is_file():
        try:
            said = json.loads((folder / COST).read_text(encoding="utf-8"))
            there = Scene.from_dict(said["scene"])
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise RunFolderError(f"{folder / COST}: cannot be read: {one_line(error)}") from error
        if scene_hash(there) != scene_hash(scene):
            raise RunFolderError(f"{folder}: holds a study of another scene, {there.name}; choose another folder")
        if kernel not in (None, "kernel" in said):
            raise RunFolderError(
                f"{folder}: holds a study {'without' if kernel else 'with'} the kernel; choose another"
            )
        return "kernel" in said
    return library.chosen(kernel, "\n".join(contacts(prepare(scene))))
