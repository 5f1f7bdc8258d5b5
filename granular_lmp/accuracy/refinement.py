"""Run a scene to its tolerance: reduce the time step until the estimated error is small enough.

`granular_lmp.accuracy.ladder` chooses the first step. After each run the answer is extrapolated from the last runs, and
its error is estimated from the change by the last run (`granular_lmp.accuracy.estimates`). The estimate uses no theory
of the wave, so it holds for every wave and every effect. Runs are added until the estimate meets the tolerance, or the
ladder ends and the tolerance is refused.

The folder holds a run folder for each step, ``N_per_sample``, and the extrapolated ``trajectory.csv`` beside
``scene.toml`` and ``run.json``.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from math import inf, isfinite
from pathlib import Path
from typing import Any

from granular_lmp.accuracy.estimates import FINEST, Estimate, combined_record
from granular_lmp.accuracy.extrapolation import Judgement, following
from granular_lmp.accuracy.ladder import plan, planned
from granular_lmp.accuracy.recorded import write_answer
from granular_lmp.accuracy.rounding import check_floor
from granular_lmp.errors import GranularError, RunInterrupted, ToleranceError
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.laws import contacts
from granular_lmp.lammps.outputs import PER_SAMPLE, SCENE, STATUS, replace_text, writable, write_files
from granular_lmp.problem import Problem, prepare
from granular_lmp.runs import launch
from granular_lmp.runs.continuation import read_unfinished, resuming, whole_checkpoints
from granular_lmp.runs.engine import Engine
from granular_lmp.runs.folder import clear, locked
from granular_lmp.runs.formats import FORMAT, scene_of
from granular_lmp.runs.manifest import wall_seconds
from granular_lmp.runs.options import Options, Progress, options_of
from granular_lmp.runs.readouts import readouts_of
from granular_lmp.runs.record import TRAJECTORY, Record, read_status, write_status
from granular_lmp.runs.seal import files_of, scene_digest

MOST_RUNGS = 12  # number of runs before the tolerance is refused
# Only the finest run checks for effects that decks leave out, because a contact may open in coarser runs only.
# The first run cannot be the finest, and one of two steps to a sample is so seldom, as nothing comes between 1 and 2
COARSE = 2


# Function that runs a problem with a step in a folder; the flag says whether the deck has guards
One = Callable[[Problem, Path, Progress | None, bool], Record]


def to_tolerance(problem: Problem, folder: Path, options: Options) -> Record:
    """Run the problem of a scene with a tolerance; folder, errors and record are as in `granular_lmp.run`."""
    plan(problem)  # raises before anything is written
    if problem.wave is not None:
        check_floor(problem)
    kernel = options.engine is None and library.chosen(options.kernel, "\n".join(contacts(problem)))
    options = replace(options, kernel=kernel)
    if options.engine is not None:
        from granular_lmp.runs.stepping import refuse_unheld  # kept out of start-up

        refuse_unheld(options.engine, planned(problem))
    said: dict[str, Any] = {"kernel": library.description()} if options.kernel else {}
    said |= {"device": options.device} if options.engine else {}
    with begun(problem, folder, options) as info:
        return refine(problem, folder, one_of(options, problem), options.progress, info | said)


def resumed(folder: Path, info: dict[str, Any], progress: Progress | None, engine: Engine | None = None) -> Record:
    """Continue the runs of a scene with a tolerance; `info` is ``run.json`` of its folder."""
    problem = prepare(scene_of(folder))
    begins = one_of(options_of(folder, info, engine), problem)
    one = continued(begins, lambda place, part: launch.resume(place, progress=part, engine=engine))
    with locked(folder):
        return refine(problem, folder, one, progress, info)


def one_of(options: Options, problem: Problem) -> One:
    """Return the function that makes a run with a step; it accepts a folder that holds files of the user.

    Decisions on a wave do not depend on the step, and are not repeated.
    """

    def made(stepped: Problem, place: Path, progress: Progress | None, looks: bool) -> Record:
        scene = stepped.scene
        whole = prepare(scene) if problem.wave is None else replace(stepped, declared=scene)
        what = whole if looks else whole.without_looks()
        return launch.launch(what, place, replace(options, force=True, progress=progress))

    return made


@contextmanager
def begun(problem: Problem, folder: Path, options: Options) -> Iterator[dict[str, Any]]:
    """Make a locked folder with ``scene.toml`` for the runs of a scene; yield the first entries of ``run.json``.

    Raises
    ------
    RunFolderError
        If the folder exists (without ``options.force``) or cannot be written.
    """
    scene = problem.scene
    text = scene.to_toml()
    with locked(folder, make=True, force=options.force):
        clear(folder)
        with writable(folder):
            write_files(folder, scene.beside)
            replace_text(folder / SCENE, text)
        yield {
            "format": FORMAT,
            "name": scene.name,
            "scene_sha256": scene_digest(text),
            "tolerance": scene.time.tolerance,
            "launcher": options.launched,
            "ranks": options.ranks,
        }


def continued(one: One, resume: Callable[[Path, Progress | None], Record]) -> One:
    """Return `one` for stopped runs: it reads finished runs, and continues runs from their checkpoint."""

    def rest(stepped: Problem, place: Path, progress: Progress | None, looks: bool) -> Record:
        if (place / STATUS).is_file():
            info = read_status(place)
            if info["status"] != "finished":
                read_unfinished(place)  # raises if the run failed by a guard
            elif not looks or info.get("looks") != {}:
                return Record.load(place)
        return resume(place, progress) if whole_checkpoints(place) else one(stepped, place, progress, looks)

    return rest


def refine(problem: Problem, folder: Path, one: One, progress: Progress | None, info: dict[str, Any]) -> Record:
    """Run with ever smaller steps until the estimate meets the tolerance, and write the common ``run.json``.

    Parameters
    ----------
    problem : Problem
        Problem of a scene with ``time.tolerance``.
    folder : Path
        Existing folder for the answer and ``run.json``.
    one : callable
        Function of problem, folder, progress callback and whether to look that makes one run of a problem with a step.
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
    scene, estimate = problem.scene, Estimate(problem)
    records, judgement, refinements = halved(problem, folder, plan(problem), one, estimate, progress, info)
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


def halved(
    problem: Problem,
    folder: Path,
    plan: Sequence[int],
    one: One,
    estimate: Callable[[Sequence[Record]], Judgement],
    progress: Progress | None,
    info: dict[str, Any],
) -> tuple[list[Record], Judgement, list[str]]:
    """Run with ever smaller steps until the estimate meets the tolerance; ``run.json`` says if this fails.

    Parameters
    ----------
    problem : Problem
        Problem of a scene with ``time.tolerance``.
    folder : Path
        Existing folder for the runs and ``run.json``.
    plan : sequence of int
        Steps per sample of the planned runs; more of them are said in ``run.json``.
    one : callable
        Function of problem, folder, progress callback and whether to look that makes one run of a problem with a step.
        Only a run that is finer than all earlier ones has guards, and in the end the finest has them.
    estimate : callable
        Judgement of some runs, of which all errors count.
    progress : callable, optional
        Callback ``progress(step, steps)``.
    info : dict
        Entries of ``run.json`` that are known before the runs.

    Returns
    -------
    records : list
        The runs, in the order in which they were made.
    judgement : Judgement
        Answer and estimated errors.
    refinements : list of str
        A sentence for each run beyond the plan.

    Raises
    ------
    ToleranceError
        If the shortest step misses the tolerance.
    RunInterrupted
        If a run is stopped.
    """
    time = problem.scene.time
    tolerance, samples = time.clock.tolerance, time.samples
    records: list[Record] = []
    refinements: list[str] = []
    with writable(folder):
        write_status(folder, info | {"status": "running", "message": "started"})
    try:
        counts, count = list[int](), plan[0]
        while True:
            before = sum(counts)
            part = _offset(progress, before * samples, max(before + count, sum(plan)) * samples)
            looks = bool(counts) and count > max(*counts, COARSE)
            stepped = problem.stepped(time.sample / count)
            records.append(one(stepped, folder / f"{count}{PER_SAMPLE}", part, looks))
            counts.append(count)
            judgement = estimate(records)
            # The comparison is false for nan
            if len(counts) > 1 and all(error <= tolerance for error in judgement.errors.values()):
                _look(records, lambda step, place: one(problem.stepped(step), folder / place, None, True))
                break
            worst = max(judgement.errors.values(), default=inf)
            count = following(counts, judgement, worst, tolerance) if isfinite(worst) else 2 * max(counts)
            if len(counts) == MOST_RUNGS or count > FINEST * plan[0]:
                raise ToleranceError(
                    f"time.tolerance = {tolerance!r}: not met with steps down to {time.sample / max(counts)!r} "
                    f"tau, {_worst(judgement.errors)}; the runs are kept in {folder}"
                )
            if len(counts) >= len(plan):
                shortest = time.sample / max(counts)
                refinements.append(f"steps down to {shortest!r} tau: {_worst(judgement.errors)}; one run more")
    except BaseException as error:  # also from the progress callback: run.json must hold the end of every run
        if isinstance(error, RunInterrupted | KeyboardInterrupt):
            resumed_by = resuming(folder, info["launcher"])
            error = RunInterrupted(f"{folder}: interrupted; what was recorded is kept; continue with: {resumed_by}")
        message = str(error) if isinstance(error, GranularError) else type(error).__name__
        status = "interrupted" if isinstance(error, RunInterrupted) else "failed"
        write_status(folder, info | {"status": status, "message": message})
        raise error from None
    return records, judgement, refinements


def _look(records: list[Record], again: Callable[[float, str], Record]) -> None:
    """Repeat the finest run of a ladder if it had no guards; its steps and seconds include both."""
    place, finest = max(enumerate(records), key=lambda each: each[1].scene.time.steps_per_sample)
    if finest.info.get("looks") == {}:
        looked = again(finest.scene.time.timestep, f"{finest.scene.time.steps_per_sample}{PER_SAMPLE}")
        runs = [finest.info, looked.info]
        both = {"steps": sum(run["steps"] for run in runs), "wall_seconds": _all_seconds(runs)}
        records[place] = replace(looked, info=looked.info | both)


def _worst(found: dict[str, float]) -> str:
    name = max(found, key=lambda key: found[key])
    return f"estimated error {found[name]:.2g} of {name}"


def _offset(progress: Progress | None, before: int, total: int) -> Progress | None:
    """Return a progress callback for one run that counts the steps of all runs."""
    return None if progress is None else lambda step, _: progress(before + step, total)
