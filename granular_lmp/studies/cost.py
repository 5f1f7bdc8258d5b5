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
from dataclasses import field, replace
from math import ceil
from pathlib import Path
from statistics import median
from time import monotonic
from typing import Any

from granular_lmp.accuracy.estimates import richardson
from granular_lmp.accuracy.ladder import sphere_steps
from granular_lmp.accuracy.tolerance import run as run_scene
from granular_lmp.effects.selection import order
from granular_lmp.errors import GranularError, LaunchError, RunFolderError, RunInterrupted, ToleranceError, one_line
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.laws import contacts
from granular_lmp.lammps.outputs import COST, SCENE, STATUS, replace_text, writable
from granular_lmp.problem import prepare
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.folder import locked, refuse_long
from granular_lmp.runs.options import core_count
from granular_lmp.runs.record import TRAJECTORY, Record, read_status, write_status
from granular_lmp.runs.seal import files_of
from granular_lmp.studies.cost_settings import REFERENCE, Setting, base, settings
from granular_lmp.studies.cost_table import COLUMNS, NOT_MET, NOT_RUN, Row, components, errors, to_csv
from granular_lmp.studies.forecast import speed
from granular_lmp.studies.sweep_points import scene_hash

COST_TABLE = "cost.csv"

Progress = Callable[[int, int, float], None]


@dataclass(frozen=True)
class Plan:
    """Plan of a study, and what its folder holds of it.

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
    failures : dict
        Name of a run → why it failed.
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
    failures: dict[str, str] = field(default_factory=dict)

    def place(self, run: Scene, turn: int) -> Path:
        """Return the folder of a run in one round."""
        return self.folder / "runs" / scene_hash(run) / str(turn)

    def todo(self) -> dict[Path, Scene]:
        """Return folder → run of those that are not done: the reference, then each round sorted by length."""
        first, *others = self.settings
        runs = sorted((run for each in others for run in each.runs), key=sphere_steps)
        wanted = [(run, 1) for run in first.runs]
        wanted += [(run, turn) for turn in range(1, self.repeats + 1) for run in runs]
        places = {self.place(run, turn): run for run, turn in wanted}
        return {there: run for there, run in places.items() if not _is_done(there)}

    def estimate(self, run: Scene) -> float:
        """Return the time of a run by the short run of the scene, s."""
        return self.overhead + sphere_steps(run) / self.rate

    @property
    def seconds(self) -> float:
        """Expected time of all runs that are not done, s."""
        return sum(map(self.estimate, self.todo().values()))

    def run(self, run: Scene, folder: Path) -> None:
        """Do one run; if it fails, note its message."""
        try:
            run_scene(run, folder, force=True, kernel=self.kernel)
        except GranularError as error:
            if isinstance(error, RunInterrupted) or run in self.settings[0].runs:
                raise
            # A tolerance that no step meets is an answer of the study, not a failure of it
            self.failures[scene_hash(run)] = NOT_MET * isinstance(error, ToleranceError) + str(error)

    def save(self) -> dict[str, Any]:
        """Write the tables from the complete runs and return the contents of ``cost.json``.

        Of a wave the record of the reference is written beside them. Without the reference there are no rows.
        """
        result: dict[str, Any] = {"scene": self.scene.given(), "cores": core_count(), "left_out": self.left_out}
        result |= {"kernel": True} if self.kernel else {}
        result |= self._rows()
        with writable(self.folder):
            replace_text(self.folder / COST, json.dumps(result, indent=1, allow_nan=False) + "\n")
            replace_text(self.folder / COST_TABLE, to_csv(result["points"]))
        return result

    def _rows(self) -> dict[str, Any]:
        reference, *others = self.settings
        places = [self.place(run, 1) for run in reference.runs]
        if not all(map(_is_done, places)):
            return {"reference": None, "points": []}
        best = _record(places)
        # The distance of two extrapolations is the error itself if that is no series in the step or of first order, as
        # at these small steps, and an upper bound otherwise
        left = errors(_record(places[:-1]), best)
        if best.scene.wave is not None:
            _write_reference(self.folder / REFERENCE, best, left)
        rows = [self._row(each, best, self.repeats) for each in others]
        return {"reference": self._row(reference, best, 1) | left, "points": rows}

    def _row(self, setting: Setting, best: Record, repeats: int) -> Row:
        turns = ([self.place(run, turn) for run in setting.runs] for turn in range(1, repeats + 1))
        rounds = [places for places in turns if all(map(_is_done, places))]
        failed = [self.failures[name] for name in map(scene_hash, setting.runs) if name in self.failures]
        names = (*COLUMNS, *(f"error_{name}" for name in components(best.scene)), "options", "message")
        row: Row = dict.fromkeys(names) | {"knob": setting.knob, "setting": setting.name, "repeats": len(rounds)}
        row |= {"options": setting.options, "message": failed[0] if failed else "" if rounds else NOT_RUN}
        if not rounds:
            return row
        infos = [[read_status(there) for there in places] for places in rounds]
        seconds = [sum(info["wall_seconds"]["total"] for info in together) for together in infos]
        loop = median(sum(info["wall_seconds"]["loop"] for info in together) for together in infos)
        work = sum(info["particles"] * info["steps"] for info in infos[0])
        return row | {
            "seconds": median(seconds),
            "seconds_min": min(seconds),
            "seconds_max": max(seconds),
            "loop_seconds": loop,
            "particles": infos[0][0]["particles"],
            "steps": sum(info["steps"] for info in infos[0]),
            "particle_steps": work,
            "particle_steps_per_second": work / loop,
            **errors(_record(rounds[0]), best),  # every round gives the same record
        }


def _is_done(folder: Path) -> bool:
    return (folder / STATUS).is_file() and read_status(folder).get("status") == "finished"


def _record(places: list[Path]) -> Record:
    """Return the record of a setting: that of its single run, or the extrapolation of its last two.

    The finer of the two is returned where the error is no series in the step, as with contacts that open or slide.
    """
    *coarser, fine = [Record.load(there) for there in places[-2:]]
    return richardson(coarser[0], fine, order(fine.scene)) if coarser else fine


def _write_reference(folder: Path, record: Record, left: dict[str, float | None]) -> None:
    folder.mkdir(exist_ok=True)
    replace_text(folder / SCENE, record.scene.to_toml())
    record.write_csv(folder / TRAJECTORY)
    estimate = {name.removeprefix("error_"): error for name, error in left.items()}
    write_status(folder, record.info | {"error_estimate": estimate, "files": files_of(folder)})


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
    with locked(plan.folder, make=True, force=True):
        plan.save()  # marks the folder as that of this study, even if this process is killed
        todo, started, spent, expected = plan.todo(), monotonic(), 0.0, 0.0
        left = plan.seconds
        try:
            for done, (folder, run) in enumerate(todo.items(), 1):
                began, estimate, slower = monotonic(), plan.estimate(run), spent / expected if expected else 1.0
                if began - started + slower * estimate <= plan.budget:
                    plan.run(run, folder)
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
            result = plan.save()
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
