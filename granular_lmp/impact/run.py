"""The run of an impact in a folder: launch, guards, ``run.json``."""

import platform
from collections.abc import Callable
from dataclasses import replace
from math import isfinite
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from granular_lmp import __version__
from granular_lmp.accuracy.halving import One, begun, continued, halved
from granular_lmp.accuracy.recorded import write_dump
from granular_lmp.errors import EffectError, LammpsError, LaunchError, RunInterrupted
from granular_lmp.impact.deck import (
    GUARD_COLUMNS,
    ImpactDeck,
    checkpoint_steps,
    deck_of,
    look_steps,
    resume_text,
)
from granular_lmp.impact.problem import ImpactProblem, prepare
from granular_lmp.impact.record import ImpactRecord
from granular_lmp.impact.scene import ImpactScene
from granular_lmp.impact.steps import LONGEST_STEP
from granular_lmp.impact.tolerance import answer, estimate, order, plan
from granular_lmp.lammps.edits import differing_lines
from granular_lmp.lammps.outputs import (
    CHECKPOINTS,
    LOG,
    SCENE,
    SNAPSHOTS,
    mend_dump,
    mend_log,
    read_log,
    writable,
    write_files,
)
from granular_lmp.runs.agreement import scene_digest
from granular_lmp.runs.continuation import how_to_continue, last_checkpoint, mark, read_start, read_unfinished
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.folder import clear, locked
from granular_lmp.runs.formats import FORMAT
from granular_lmp.runs.launch import Options, Progress, options_of
from granular_lmp.runs.record import write_status
from granular_lmp.runs.routes import Job, Route, log_tail, route_of
from granular_lmp.runs.seal import files_of
from granular_lmp.scene.validation import LARGEST_OVERLAP_RATIO

# Title of a guard → column of the thermo table, limit, what a larger value means, and what to do
LIMITS = {
    "largest_overlap": (
        "v_overlap",
        LARGEST_OVERLAP_RATIO,
        "of the diameter is the largest overlap, for which Hertz's law does not hold",
        "take a smaller striker.velocity or packing.contact_force",
    ),
    "step_in_contact": (
        "v_omega_dt",
        LONGEST_STEP,
        "is the time step times the frequency of the stiffest contact, which is too long for a collision",
        "take a shorter time.timestep, or a smaller time.tolerance",
    ),
}


def run_impact(what: ImpactScene | ImpactDeck, folder: str | Path, options: Options | None = None) -> ImpactRecord:
    """Run an impact in `folder`, which is created, and return its record.

    The folder holds ``scene.toml``, ``in.NAME``, ``data.NAME``, ``dump.particles``, ``log.lammps`` and ``run.json``;
    ``checkpoint.*`` while a long run lasts and after it is stopped, from which `resume_impact` continues. With
    ``time.tolerance`` it holds such a folder for each step, ``N_per_sample``, and the extrapolated ``dump.particles``;
    ``info["error_estimate"]`` of the record then holds the largest errors of velocities and spins over the velocity of
    the fastest striker (`granular_lmp.impact.tolerance`).

    Raises
    ------
    SceneError
        As `granular_lmp.impact.problem.prepare`.
    RunFolderError
        If the folder exists (without ``options.force``) or cannot be written.
    EffectError
        If a guard triggered; the folder is kept.
    ToleranceError
        If the shortest of eight steps misses the tolerance, or the runs do not converge.
    LammpsMissingError, LammpsError, LaunchError, RunInterrupted
        As in `granular_lmp.run`.

    Notes
    -----
    *Good values*: ``time.tolerance`` from 1e-2 to 1e-5, or a step of 1/70 of the collision time, which leaves errors of
    1e-3 after 12 of them.
    """
    folder, options = absolute(folder), options or Options()
    if options.kernel:
        raise LaunchError("kernel=True: impacts run without it")
    if isinstance(what, ImpactScene) and what.time.tolerance is not None:
        return _to_tolerance(what, folder, options)
    began = perf_counter()
    deck = what if isinstance(what, ImpactDeck) else deck_of(prepare(what))
    info = description(deck.problem, "lmp" if options.program else "module", options.ranks)
    if deck is what and (edits := differing_lines(deck_of(deck.problem).input_text, deck.input_text)):
        info["edited"] = edits
    route = route_of(options.program, options.ranks)
    with locked(folder, make=True, force=options.force) as lock:
        clear(folder)
        write_files(folder, deck.files())
        report = _step_reporter(options.progress, deck.problem)
        job = Job(folder, deck.input_name, LOG, lock, report, variables=_variables(deck.problem, info))
        return _execute(deck.problem, job, route, info, began)


def resume_impact(folder: str | Path, *, progress: Progress | None = None) -> ImpactRecord:
    """Continue a stopped or killed impact from its last checkpoint, on the same route and ranks.

    The record has the same bytes as that of an uninterrupted run, in every scene: also with friction, whose shear of
    contacts is in the checkpoint, and with damping. What came after the last checkpoint is computed again.

    Raises
    ------
    RunFolderError
        If the run is finished, its deck or scene was changed, or it was stopped before its first checkpoint.
    EffectError, LammpsMissingError, LammpsError, RunInterrupted
        As `run_impact`.
    """
    folder = absolute(folder)
    began = perf_counter()
    started = read_unfinished(folder)
    scene = ImpactScene.load(folder / SCENE)
    if scene.time.tolerance is not None:
        return _resumed(scene, folder, started, progress)
    with locked(folder) as lock:
        info = read_start(folder)
        problem = prepare(scene)
        last = last_checkpoint(folder, info, SNAPSHOTS)
        options = options_of(folder, info)
        route = route_of(options.program, options.ranks)
        name = f"in.{problem.scene.name}.resume"
        with writable(folder):
            (folder / name).write_text(resume_text(problem, last.name), encoding="utf-8")
            mend_dump(folder / SNAPSHOTS)
            mend_log(folder / LOG)
        # The log is "none" because the input itself opens it for appending
        report = _step_reporter(progress, problem)
        job = Job(folder, name, "none", lock, report, variables=_variables(problem, info))
        return _execute(problem, job, route, info, began)


def _to_tolerance(scene: ImpactScene, folder: Path, options: Options) -> ImpactRecord:
    problem = prepare(scene)
    plan(problem)  # raises before anything is written
    with begun(scene, folder, options) as info:
        return _refined(problem, folder, _one(options), options.progress, info)


def _resumed(scene: ImpactScene, folder: Path, info: dict[str, Any], progress: Progress | None) -> ImpactRecord:
    """Continue the runs of an impact with a tolerance."""
    one = continued(
        _one(options_of(folder, info)),
        lambda place, part: resume_impact(place, progress=part),
        ImpactRecord.load,
    )
    with locked(folder):
        return _refined(prepare(scene), folder, one, progress, info)


def _one(options: Options) -> One[ImpactScene, ImpactRecord]:
    """Return what makes a run with a step; forced, because its folder may exist and hold files of the user."""
    return lambda scene, place, part: run_impact(scene, place, replace(options, force=True, progress=part))


def _refined(
    problem: ImpactProblem,
    folder: Path,
    one: One[ImpactScene, ImpactRecord],
    progress: Progress | None,
    info: dict[str, Any],
) -> ImpactRecord:
    """Run with smaller and smaller steps to the tolerance; write the dump of the answer and ``run.json`` of all."""
    records, judgement, refinements = halved(problem.scene, folder, plan(problem), one, estimate, progress, info)
    runs = [each.info for each in records]
    folders = [each.folder / SNAPSHOTS for each in records if each.folder is not None]
    outcome = (
        records[-1].info
        | info
        | {
            "error_estimate": judgement.errors,
            "order": order(problem.scene),
            "extrapolated_from": [
                each.scene.time.step for each, weight in zip(records, judgement.weights, strict=True) if weight
            ],
            "refinements": refinements,
            "steps": sum(each["steps"] for each in runs),
            "wall_seconds": {
                name: sum(each["wall_seconds"][name] or 0.0 for each in runs) for name in ("total", "loop")
            },
            "status": "finished",
            "message": "",
        }
    )
    with writable(folder):
        write_dump(folder / SNAPSHOTS, folders, judgement.weights)
        outcome["files"] = files_of(folder)
        write_status(folder, outcome)
    return replace(answer(records), problem=problem, info=outcome, folder=folder)


def _step_reporter(progress: Progress | None, problem: ImpactProblem) -> Callable[[int], None]:
    steps = problem.scene.time.steps
    return lambda step: progress(min(step, steps), steps) if progress else None


def _variables(problem: ImpactProblem, info: dict[str, Any]) -> tuple[str, ...]:
    """Return the words that tell a deck the mark of its checkpoints, and override what it says for one rank."""
    marked = ("-var", "marked", mark(info["scene_sha256"]))
    if info["ranks"] == 1:
        return marked
    return (*marked, "-var", "checkpoint", str(checkpoint_steps(problem, info["ranks"])))


def _execute(problem: ImpactProblem, job: Job, route: Route, info: dict[str, Any], began: float) -> ImpactRecord:
    """Run an input in its folder, collect its record, and write the outcome to ``run.json``."""
    folder = job.folder
    with writable(folder):
        write_status(folder, info | {"status": "running", "message": "started"})
    failure: BaseException | None = None
    record = None
    try:
        route(job)
    except KeyboardInterrupt:
        failure = RunInterrupted(f"{folder}: interrupted; what was recorded is kept; {how_to_continue(folder)}")
    except BaseException as error:  # run.json must hold the end of every run
        failure = error
    try:
        if (folder / SNAPSHOTS).is_file():
            if failure is not None or job.log != LOG:
                mend_dump(folder / SNAPSHOTS)
            record = ImpactRecord.from_dump(folder, problem)
        log = read_log(folder / LOG)
        info |= {"guards": judged(problem, log.table), "samples": 0 if record is None else len(record.tau)}
        failure = failure or defect(problem, job, record, log.table) or _triggered(folder, info["guards"])
        total = info.get("wall_seconds", {}).get("total", 0.0) + perf_counter() - began
        info["wall_seconds"] = {"total": total, "loop": log.loop if isfinite(log.loop) else None}
    except BaseException as error:
        failure = failure or error
    status = "finished" if failure is None else "interrupted" if isinstance(failure, RunInterrupted) else "failed"
    info |= {"files": files_of(folder)} if failure is None else {}
    info |= {"status": status, "message": str(failure or "")}
    with writable(folder):
        write_status(folder, info)
    if failure is not None:
        raise failure
    assert record is not None  # `defect` has seen to it
    job.report_step(problem.scene.time.steps)
    for name in CHECKPOINTS:
        (folder / name).unlink(missing_ok=True)
    return replace(record, info=info)


def description(problem: ImpactProblem, launcher: str, ranks: int) -> dict[str, Any]:
    """Return the entries of ``run.json`` that are known before the run."""
    scene = problem.scene
    return {
        "format": FORMAT,
        "name": scene.name,
        "scene_sha256": scene_digest(scene.to_toml()),
        "versions": {"granular_lmp": __version__, "python": platform.python_version(), "numpy": np.__version__},
        "launcher": launcher,
        "ranks": ranks,
        "particles": len(problem.crystal),
        "recorded": len(problem.recorded),
        "steps": scene.time.steps,
        "timestep_used": scene.time.step,
        "velocity_m_s": scene.scale.velocity,
        "length_m": scene.scale.length,
        "t0_s": scene.scale.time,
        "mass_kg": scene.scale.mass,
        "shortest_collision": problem.shortest_collision,
        "at_rest": problem.at_rest,
        "effects": {
            each.name: {"on": each.on, "called_for": each.called_for, "reason": each.finding, "guard": each.guard}
            for each in problem.effects
        },
    }


def judged(problem: ImpactProblem, table: dict[str, Any]) -> dict[str, Any]:
    """Return the result of each guard; what is not finite, or not there, is not quiet."""
    effects = {effect.guard: effect.name for effect in problem.effects if effect.guard}
    found = {}
    for title, (column, limit, meaning, cure) in LIMITS.items():
        values = np.asarray(table.get(column, [np.nan]), dtype=float)
        largest = float(np.max(values, initial=0.0))
        found[title] = {
            "effect": effects[title],
            "value": largest if np.isfinite(largest) else None,
            "limit": limit,
            "quiet": bool(largest <= limit),
            "judges": True,
            "meaning": meaning,
            "cure": cure,
        }
    return found


def _triggered(folder: Path, guards: dict[str, Any]) -> EffectError | None:
    loud = [
        f"{title} = {'not finite' if each['value'] is None else format(each['value'], '.4g')}, above "
        f"{each['limit']:g}: {each['meaning']}; {each['cure']}"
        for title, each in guards.items()
        if not each["quiet"]
    ]
    return EffectError(f"{folder}: {'; '.join(loud)}") if loud else None


def defect(problem: ImpactProblem, job: Job, record: ImpactRecord | None, table: dict[str, Any]) -> LammpsError | None:
    """Return an error if the record or the log is incomplete although LAMMPS reported success, else None."""
    time = problem.scene.time
    if record is None or len(record.tau) != time.samples + 1:
        count = 0 if record is None else len(record.tau)
        return LammpsError(f"{count} records instead of {time.samples + 1}", job.input_name, "")
    if not all(np.isfinite(x).all() for x in (record.displacement, record.velocity, record.spin)):
        return LammpsError("the record holds numbers that are not finite", job.input_name, "")
    missed = {*range(0, time.steps + 1, look_steps(problem))} - {*map(int, table.get("Step", ()))}
    if missed or not {*GUARD_COLUMNS} <= set(table):
        what = f"step {min(missed)}" if missed else "the guards"
        return LammpsError(f"the log lacks {what}", job.input_name, log_tail(job.folder))
    return None
