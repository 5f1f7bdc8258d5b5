"""A work–precision study: the cost of each setting of a run in seconds, and its accuracy.

Every setting of `granular_lmp.studies.cost_settings` is run in several rounds, so that other load on the machine
affects all settings alike. The time is the median of the rounds; the errors are those against LAMMPS itself,
extrapolated from fine steps: of a wave relative L2 errors of p, q, φ, else the largest of velocities and spins over the
velocity of the fastest striker, and of displacements over the largest.

A study folder holds ``runs/HASH/N`` (a run folder for each round N), ``reference`` (a run folder whose trajectory is
the extrapolated one), and ``cost.json`` and ``cost.csv``, which are made from those. A study that was stopped, or is
started again, runs only what is missing; an interrupted run starts anew, because only a complete run has a time.
"""

import json
from collections.abc import Callable, Iterable
from dataclasses import replace
from math import ceil
from operator import attrgetter
from pathlib import Path
from statistics import median
from time import monotonic
from typing import Any

from granular_lmp.accuracy.ladder import build
from granular_lmp.accuracy.tolerance import run as run_scene
from granular_lmp.errors import GranularError, LaunchError, RunFolderError, RunInterrupted, ToleranceError, one_line
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.laws import contacts
from granular_lmp.lammps.outputs import COST, replace_text, writable
from granular_lmp.problem import prepare
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.folder import locked, refuse_long
from granular_lmp.runs.options import core_count
from granular_lmp.runs.record import STATUS, read_status, write_status
from granular_lmp.scene.scene import Scene
from granular_lmp.studies.cost_settings import REFERENCE, Point, Run, base, points, reference
from granular_lmp.studies.forecast import speed
from granular_lmp.studies.output_variants import OUTPUTS, edited, keep_centre
from granular_lmp.studies.sweep_points import scene_hash
from granular_lmp.studies.tally import collect, is_done, place, taken, to_csv

COST_TABLE = "cost.csv"
_PROGRAM = 0.5  # s to start mpiexec and lmp

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
    points : list of Point
        Settings to run, the reference first.
    left_out : dict
        Setting → reason why it is not run.
    repeats : int
        Number of rounds.
    budget : float
        Time for the study, s; infinite if unlimited.
    started : float
        Start of the budget on the clock `time.monotonic`, before the warm-up.
    rate, overhead : float
        Spheres times steps per second, and seconds per run beside the time loop, from a short run of the scene.
    took : dict
        Name of a run → seconds of each of its earlier rounds.
    kernel : bool
        True if the kernel computes the contacts of all runs.
    """

    folder: Path
    scene: Scene
    points: list[Point]
    left_out: dict[str, str]
    repeats: int
    budget: float
    started: float
    rate: float
    overhead: float
    took: dict[str, list[float]]
    kernel: bool = False

    def todo(self) -> list[tuple[Run, Path]]:
        """Return the runs that are not done with their folders, round by round."""
        return _missing(self.folder, self.points, self.repeats)

    def estimate(self, run: Run) -> float:
        """Return the time of a run by the rates of the warm-up, s."""
        return self.overhead + run.work / self.rate + _PROGRAM * (run.ranks > 1)

    def price(self, run: Run, slower: float = 1.0) -> float:
        """Return the expected time of a run, s: that of its earlier rounds, or `slower` times the estimate."""
        own = self.took.get(run.name)
        return median(own) if own else slower * self.estimate(run)

    @property
    def seconds(self) -> float:
        """Expected time of all runs that are not done, s."""
        return sum(self.price(run) for run, _ in self.todo())


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
    repeats : int
        Number of rounds; the reference is run once. *Good values*: 5 or more, because times scatter.
    budget : float
        Time in seconds for this call and its `measure`, without that of earlier calls. If the settings do not fit, the
        longest are left out first. A run that has started is not stopped.
    kernel : bool, optional
        Compute contacts with the kernel (`granular_lmp.run`), whose settings have a study of their own. By default a
        study continues as it began.

    Raises
    ------
    SceneError
        If the scene cannot be run.
    RunFolderError
        If the folder exists and is not that of a study of this scene.
    LaunchError
        If the budget is too small for the reference and one setting, or the kernel does not know a contact.
    LammpsMissingError
        If the kernel is asked for and was not built.
    """
    started = monotonic()
    folder, scene = absolute(folder), base(scene)
    kernel = _check_folder(folder, scene, kernel)
    made, left_out = points(scene)
    if kernel:
        library.built()
    whole = Plan(folder, scene, [reference(scene), *made], left_out, repeats, budget, started, 1.0, 0.0, {}, kernel)
    if not whole.todo():
        return whole
    rate, overhead = speed(scene, kernel)
    took = {run.name: taken(run, folder, repeats) for point in whole.points for run in point.runs}
    return _within_budget(replace(whole, rate=rate, overhead=overhead, took=took))


def _within_budget(whole: Plan) -> Plan:
    """Return the plan without its longest settings, as many as needed for the rest to fit into the budget."""
    fitting, gone = whole, monotonic() - whole.started
    while gone + fitting.seconds > whole.budget:
        alone = {
            point: sum(whole.price(run) for run, _ in _missing(whole.folder, [point], whole.repeats))
            for point in fitting.points[1:]
        }
        dearest = max(alone, key=lambda point: alone[point], default=None)
        if dearest is None or len(alone) == 1:
            raise LaunchError(
                f"budget = {whole.budget:g}: must be at least {ceil(gone + fitting.seconds)} s, which the reference "
                "and one setting take"
            )
        reason = f"about {alone[dearest]:.2g} s, beyond the budget"
        fitting = replace(
            fitting,
            points=[point for point in fitting.points if point is not dearest],
            left_out=fitting.left_out | {str(dearest): reason},
        )
    return fitting


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

    Notes
    -----
    If a run fails, its message stands in the table and the others continue. If runs take longer than planned, those
    that do not fit into the rest of the budget are left out and listed in ``left_out``. The errors are valid if the
    error of a run is of second order in the step, which the extrapolation of the reference assumes. They are not valid
    with sliding or opening contacts, the incremental law or dashpots.
    """
    with locked(plan.folder, make=True, force=True):
        _save(plan)  # marks the folder as that of this study, even if this process is killed
        todo, cut = plan.todo(), set[Path]()
        plan = replace(plan, took={name: list(seconds) for name, seconds in plan.took.items()})
        spent = estimated = 0.0
        try:
            for index, (run, folder) in enumerate(todo):
                began, slower = monotonic(), spent / estimated if estimated else 1.0
                if began - plan.started + plan.price(run, slower) <= plan.budget:
                    _run(run, folder, plan.kernel)
                    seconds = monotonic() - began
                    plan.took.setdefault(run.name, []).append(seconds)
                    spent, estimated = spent + seconds, estimated + plan.estimate(run)
                else:
                    cut.add(folder)
                if progress is not None:
                    left = sum(plan.price(run, slower) for run, _ in todo[index + 1 :])
                    progress(index + 1, len(todo), min(left, plan.started + plan.budget - monotonic()))
        except (KeyboardInterrupt, RunInterrupted) as error:
            raise RunInterrupted(
                f"{plan.folder}: interrupted; {len(todo) - len(plan.todo())} of {len(todo)} runs were done and are "
                "kept, the same command again does the rest"
            ) from error
        finally:
            result = _save(replace(plan, left_out=plan.left_out | _cut_off(plan, cut)))
    return result


def _cut_off(plan: Plan, cut: set[Path]) -> dict[str, str]:
    """Return setting → number of missing rounds, for settings whose runs were left out during the study."""
    reasons = {}
    for point in plan.points:
        rounds = 1 if point.knob == REFERENCE else plan.repeats
        turns = range(1, rounds + 1)
        lacking = sum(any(place(plan.folder, run, turn) in cut for run in point.runs) for turn in turns)
        if lacking:
            reasons[str(point)] = f"{lacking} of {rounds} rounds not run, beyond the budget"
    return reasons


def _save(plan: Plan) -> dict[str, Any]:
    """Write the tables from the complete runs and return the contents of ``cost.json``."""
    result: dict[str, Any] = {"scene": plan.scene.given(), "cores": core_count(), "left_out": plan.left_out}
    result |= {"kernel": True} if plan.kernel else {}
    result |= collect(plan.folder, plan.points, plan.repeats)
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


def _missing(folder: Path, points: Iterable[Point], repeats: int) -> list[tuple[Run, Path]]:
    """Return the runs that are not done and their folders, round by round, sorted by their length."""
    once = {run.name: run for point in points if point.knob == REFERENCE for run in point.runs}
    often = {run.name: run for point in points if point.knob != REFERENCE for run in point.runs}
    by_work = attrgetter("work")
    wanted = [(run, 1) for name, run in once.items() if name not in often]
    wanted += [(run, turn) for turn in range(1, repeats + 1) for run in sorted(often.values(), key=by_work)]
    places = [(run, place(folder, run, turn)) for run, turn in wanted]
    return [(run, there) for run, there in places if not is_done(run, there)]


def _run(run: Run, folder: Path, kernel: bool) -> None:
    """Do one run; if it fails, its folder holds the message."""
    try:
        if run.output == "probe":
            run_scene(run.scene, folder, ranks=run.ranks, force=True, kernel=kernel)
        else:
            deck, output = build(run.scene), OUTPUTS[run.output]
            assert isinstance(deck, Deck)
            record = run_scene(edited(deck, output), folder, ranks=run.ranks, force=True, kernel=kernel)
            keep_centre(deck, record, output)
    except RunInterrupted:
        raise
    except GranularError as error:
        with writable(folder):
            folder.mkdir(parents=True, exist_ok=True)
        there = read_status(folder) if (folder / STATUS).is_file() else {}
        # A tolerance that no step meets is an answer of the study, not a failure of it
        met = {"tolerance_met": False} if isinstance(error, ToleranceError) else {}
        write_status(folder, there | met | {"status": "failed", "message": str(error)})
