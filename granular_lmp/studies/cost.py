"""Work–precision study: the cost of each setting of a run, in seconds, and its accuracy.

Every setting of `granular_lmp.studies.cost_settings` is run in several rounds, so that other load on the machine
affects all settings alike. The time is the median of the rounds; the reference for errors is LAMMPS, extrapolated from
fine steps (`granular_lmp.studies.cost_table`).

A study folder holds ``runs/NAME/N``, a run folder for each round N, and ``cost.json`` and ``cost.csv``, which are made
from the runs. A study that was stopped, or is started again, runs only what is missing; an interrupted run starts
again, because only a complete run has a time.
"""

import json
from collections.abc import Callable, Mapping
from math import inf
from pathlib import Path
from statistics import median
from time import monotonic
from typing import Any

from granular_lmp.accuracy.estimates import richardson
from granular_lmp.accuracy.tolerance import run
from granular_lmp.effects.selection import order
from granular_lmp.errors import GranularError, RunFolderError, RunInterrupted, one_line
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.laws import contacts
from granular_lmp.lammps.outputs import COST, STATUS, csv_text, replace_text, writable, write_files
from granular_lmp.problem import Problem, prepare
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.folder import locked, refuse_long
from granular_lmp.runs.options import core_count
from granular_lmp.runs.record import Record, read_status
from granular_lmp.studies.cost_settings import Setting, base, references, settings
from granular_lmp.studies.cost_table import NOT_RUN, NUMBERS, Row, errors
from granular_lmp.studies.identity import names_of
from granular_lmp.studies.sweep_points import scene_hash
from granular_lmp.studies.sweep_request import scene_asked

Progress = Callable[[int, int, float], None]


@dataclass(frozen=True)
class Plan:
    """Plan of a study, and the finished part in its folder.

    Attributes
    ----------
    folder : Path
        Study folder.
    scene : Scene
        Scene of the study, `granular_lmp.studies.cost_settings.base` of the declared one.
    references, settings : list of Setting
        Settings to run; the reference begins with the longest step.
    left_out : dict
        Setting → reason why it cannot be run.
    repeats : int
        Number of rounds; the reference is run once. *Good values*: 5 or more, because times scatter.
    kernel : bool
        True if the kernel computes the contacts of all runs.
    """

    folder: Path
    scene: Scene
    references: list[Setting]
    settings: list[Setting]
    left_out: dict[str, str]
    repeats: int
    kernel: bool

    def place(self, setting: Setting, turn: int = 1) -> Path:
        """Return the folder of a setting in one round."""
        name = setting.folder + "-kernel" * self.kernel
        return self.folder / "runs" / name / str(turn)

    def todo(self) -> dict[Path, Setting]:
        """Return folder → setting of missing runs: first the reference, then each round by length."""
        each_round = sorted(self.settings, key=lambda setting: setting.work)
        wanted = {self.place(setting): setting for setting in self.references}
        for turn in range(1, self.repeats + 1):
            wanted |= {self.place(setting, turn): setting for setting in each_round}
        return {there: setting for there, setting in wanted.items() if not _is_done(there)}

    def save(self, failures: Mapping[str, str]) -> dict[str, Any]:
        """Write the tables from the complete runs and return the contents of ``cost.json``.

        `failures` maps settings to reasons of failure. Without the reference there are no rows.
        """
        result: dict[str, Any] = {"scene": self.scene.given(), "cores": core_count(), "kernel": self.kernel}
        result |= {"left_out": self.left_out, "reference": None, "points": []}
        places = list(map(self.place, self.references))
        if all(map(_is_done, places)):
            coarse, middle, fine = map(Record.load, places)
            power = order(fine.scene)
            best = richardson(middle, fine, power)
            # The distance of two extrapolations is the error if it is of first order in the step, or not a series, as
            # at these small steps; otherwise it is an upper bound
            left = errors(richardson(coarse, middle, power), best)
            runs = [str(there.relative_to(self.folder)) for there in places[1:]]
            result["reference"] = self._row(self.references[-1], best, 1) | left | {"runs": runs, "order": power}
            for setting in self.settings:
                row = self._row(setting, best, self.repeats)
                message = failures.get(f"{setting.varied}: {setting.name}", "" if row["repeats"] else NOT_RUN)
                result["points"].append(row | {"options": setting.options, "message": message})
        rows: list[Row] = result["points"]
        write_files(self.folder, self.scene.beside)
        with writable(self.folder):
            replace_text(self.folder / COST, json.dumps(result, indent=1, allow_nan=False) + "\n")
            replace_text(self.folder / "cost.csv", csv_text(rows[0], map(dict.values, rows)) if rows else "")
        return result

    def _row(self, setting: Setting, best: Record, repeats: int) -> Row:
        rounds = [there for turn in range(1, repeats + 1) if _is_done(there := self.place(setting, turn))]
        row = {"varied": setting.varied, "setting": setting.name, "repeats": len(rounds)}
        if not rounds:
            return row | dict.fromkeys((*NUMBERS, *(f"error_{name}" for name in best.signals)))
        infos = [read_status(there) for there in rounds]
        total, loop = ([info["wall_seconds"][part] for info in infos] for part in ("total", "loop"))
        numbers = (median(total), min(total), max(total), median(loop), infos[0]["particles"], infos[0]["steps"])
        # Every round gives the same record
        return row | dict(zip(NUMBERS, numbers, strict=True)) | errors(Record.load(rounds[0]), best)


def _is_done(folder: Path) -> bool:
    return (folder / STATUS).is_file() and read_status(folder).get("status") == "finished"


def plan(scene: Scene, folder: str | Path, *, repeats: int = 5, kernel: bool | None = None) -> Plan:
    """Return the plan of a study, without changes in the folder.

    Parameters
    ----------
    scene : Scene
    folder : path
        Study folder, new or of the same study.
    repeats : int
        As in `Plan`.
    kernel : bool, optional
        As in `granular_lmp.run`. A folder keeps runs with and without the kernel separately.

    Raises
    ------
    SceneError
        If the scene cannot be run.
    RunFolderError
        If the folder exists and holds no study of this scene.
    LaunchError, LammpsMissingError
        If the kernel is required but cannot be used.
    """
    folder, problem = absolute(folder), prepare(base(scene))
    _refuse_other(folder, problem)
    kernel = library.chosen(kernel, "\n".join(contacts(problem)))
    return Plan(folder, problem.declared, references(problem), *settings(problem), repeats, kernel)


def measure(plan: Plan, *, budget: float = inf, progress: Progress | None = None) -> dict[str, Any]:
    """Run the missing runs of a study and return the contents of ``cost.json``.

    Parameters
    ----------
    plan : Plan
    budget : float
        Time in seconds after which no run is started; long settings and later rounds are left for another call.
    progress : callable, optional
        Callback ``progress(runs done, runs, seconds left)``.

    Raises
    ------
    RunFolderError
        If another study is in progress in the folder.
    RunInterrupted
        On Ctrl-C; complete runs are kept, and the tables are made from them.
    GranularError
        If a run of the reference fails, as errors are then unknown.

    Notes
    -----
    If another run fails, the table holds its message and the others continue. The extrapolation of the reference
    assumes an error of second order in the step. The errors are therefore not valid with sliding or opening contacts,
    the incremental law or dashpots.
    """
    failures: dict[str, str] = {}
    with locked(plan.folder, make=True, force=True):
        plan.save(failures)  # marks the folder for this study, even if this process is killed
        todo, started = plan.todo(), monotonic()
        work = [setting.work for setting in todo.values()]
        try:
            for done, (folder, setting) in enumerate(todo.items(), 1):
                if monotonic() - started > budget:
                    break
                try:
                    run(setting.run, folder, force=True, kernel=plan.kernel)
                except GranularError as error:
                    if isinstance(error, RunInterrupted) or setting in plan.references:
                        raise
                    failures[f"{setting.varied}: {setting.name}"] = str(error)
                if progress is not None:
                    left = (monotonic() - started) * sum(work[done:]) / sum(work[:done])
                    progress(done, len(todo), left)
        except (KeyboardInterrupt, RunInterrupted) as error:
            raise RunInterrupted(
                f"{plan.folder}: interrupted; {len(todo) - len(plan.todo())} of {len(todo)} runs are finished and "
                "kept; the same command does the rest"
            ) from error
        finally:
            result = plan.save(failures)
    return result


def _refuse_other(folder: Path, problem: Problem) -> None:
    """Raise RunFolderError if the folder exists and holds no study of the scene of this problem."""
    refuse_long(folder)
    if not (folder / COST).is_file():
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise RunFolderError(f"{folder}: exists already; choose another folder")
        return
    try:
        there = scene_asked(folder, json.loads((folder / COST).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, AttributeError, KeyError) as error:
        raise RunFolderError(f"{folder / COST}: cannot be read: {one_line(error)}") from error
    if scene_hash(there) != names_of(problem.scene)[0]:
        raise RunFolderError(f"{folder}: holds a study of another scene, {there.name}; choose another folder")
