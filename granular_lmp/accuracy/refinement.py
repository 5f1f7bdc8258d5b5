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

from granular_lmp.accuracy.estimates import estimate_of
from granular_lmp.accuracy.halving import One, begun, continued, halved
from granular_lmp.accuracy.ladder import plan
from granular_lmp.accuracy.recorded import write_answer
from granular_lmp.accuracy.richardson import combined_record
from granular_lmp.accuracy.rounding import check_floor, linear_signals
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.laws import contacts
from granular_lmp.lammps.outputs import writable
from granular_lmp.problem import Problem, prepare
from granular_lmp.rest.scene import Scene
from granular_lmp.runs import launch
from granular_lmp.runs.folder import locked
from granular_lmp.runs.formats import scene_of
from granular_lmp.runs.manifest import wall_seconds
from granular_lmp.runs.options import Options, Progress, options_of
from granular_lmp.runs.readouts import readouts_of
from granular_lmp.runs.record import TRAJECTORY, Record, write_status
from granular_lmp.runs.seal import files_of


def to_tolerance(scene: Scene, folder: Path, options: Options) -> Record:
    """Run a scene with a tolerance; folder, errors and record are those of `granular_lmp.run`."""
    problem = prepare(scene)
    plan(problem)  # raises before anything is written
    if scene.wave is not None:
        check_floor(problem.scene, linear_signals(problem.scene))
    options = replace(options, kernel=library.chosen(options.kernel, "\n".join(contacts(problem))))
    kernel = {"kernel": library.description()} if options.kernel else {}
    with begun(problem.scene, folder, options) as info:
        return refine(problem, folder, one_of(options, problem), options.progress, info | kernel)


def resumed(folder: Path, info: dict[str, Any], progress: Progress | None) -> Record:
    """Continue the runs of a scene with a tolerance, of whose folder `info` is ``run.json``."""
    problem = prepare(scene_of(folder))
    begins = one_of(options_of(folder, info), problem)
    one = continued(begins, lambda place, part: launch.resume(place, progress=part))
    with locked(folder):
        return refine(problem, folder, one, progress, info)


def one_of(options: Options, problem: Problem) -> One:
    """Return what makes a run with a step; forced, because its folder may exist and hold files of the user.

    What is decided of a wave does not depend on the step, and is not decided again.
    """

    def made(scene: Scene, place: Path, progress: Progress | None) -> Record:
        what = scene if problem.mode is None else replace(problem.stepped(scene), declared=scene)
        return launch.launch(what, place, replace(options, force=True, progress=progress))

    return made


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
