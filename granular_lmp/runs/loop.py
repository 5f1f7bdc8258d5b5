"""Loop of every run: write the deck, launch LAMMPS, collect its output, judge it, and write ``run.json``.

A `Simulation` knows the files of its deck, its record and its guards. The loop does the rest: folder, lock, launch,
progress, checkpoints, clock, status and seal.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from math import nan
from pathlib import Path
from typing import Any

from granular_lmp.errors import EffectError, RunFolderError, RunInterrupted
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.outputs import (
    CHECKPOINTS,
    CONTACTS,
    LOG,
    UNWAVED_CONTACTS,
    RunLog,
    mend_log,
    read_log,
    writable,
    write_files,
)
from granular_lmp.runs.continuation import how_to_continue, last_checkpoint, read_start
from granular_lmp.runs.engine import Engine
from granular_lmp.runs.folder import clear, locked
from granular_lmp.runs.manifest import triggered, wall_seconds
from granular_lmp.runs.options import Options, Progress, options_of
from granular_lmp.runs.phases import Seconds, collected, phase, split
from granular_lmp.runs.record import Record
from granular_lmp.runs.routes import Job, Route, route_of
from granular_lmp.runs.seal import files_of
from granular_lmp.runs.simulation import Simulation
from granular_lmp.runs.status import read_status, write_status


def begin(simulation: Simulation, folder: Path, options: Options, seconds: Seconds) -> Record:
    """Run a simulation in a folder, which is created, and return its record.

    Parameters
    ----------
    simulation : Simulation
    folder : Path
        Absolute.
    options : Options
    seconds : dict
        Phases of the run so far (`granular_lmp.runs.phases.collected`).

    Raises
    ------
    RunFolderError, LammpsMissingError, LammpsError, EffectError, RunInterrupted
        As in `granular_lmp.run`.
    """
    with phase("build"):
        info = simulation.description(options.launched, options.ranks)
        info |= {"kernel": library.description()} if options.kernel else {}
    # Missing programs and libraries, and what an engine does not support, are reported before a file is written
    route = _route(simulation, options, info)
    with locked(folder, make=True, force=options.force) as lock:
        with phase("write"):
            clear(folder)
            write_files(folder, simulation.files())
        job = _job(simulation, folder, simulation.begun_name, LOG, lock, options, info)
        return execute(simulation, job, route, info, seconds)


def _route(simulation: Simulation, options: Options, info: dict[str, Any]) -> Route:
    """Return the function that runs a simulation; ``run.json`` names an engine."""
    if options.engine is None:
        return route_of(options)
    from granular_lmp.runs.stepping import route_by  # kept out of start-up

    info |= {"device": options.engine.device, "versions": info["versions"] | dict(options.engine.versions)}
    return route_by(options.engine, simulation.deck.problem, info)


def proceed(
    of: Callable[[Path, bool], Simulation], folder: Path, progress: Progress | None, engine: Engine | None = None
) -> Record:
    """Continue a stopped or killed run from its last checkpoint, on the same route and ranks.

    Parameters
    ----------
    of : callable
        Function that returns the simulation of the run folder, with or without the kernel.
    folder : Path
        Absolute.
    progress : callable, optional
    engine : Engine, optional
        Engine that took the steps, if it was not LAMMPS.

    Raises
    ------
    RunFolderError
        If the run is finished, was changed, or was stopped before its first checkpoint.
    LaunchError, LammpsMissingError, LammpsError, EffectError, RunInterrupted
        As in `granular_lmp.run`.
    """
    read_status(folder)  # raises if the folder holds no run
    with collected() as seconds, locked(folder) as lock:
        info = read_start(folder)
        with phase("build"):
            simulation = of(folder, "kernel" in info)
        _refuse_other_columns(folder, simulation)
        last = last_checkpoint(folder, simulation.dump)
        options = replace(options_of(folder, info, engine), progress=progress)
        route = _route(simulation, options, info)
        name = f"{simulation.input_name}.resume"
        info.pop("files", None)  # files change from here on
        with writable(folder):
            write_status(folder, info | {"status": "running", "message": "continued"})
            if engine is None:
                (folder / name).write_text(simulation.resume_text(last.name), encoding="utf-8")
            simulation.mend(folder)
            mend_log(folder / LOG)
        # The log is "none" because the input opens it for appending
        job = _job(simulation, folder, name, "none", lock, options, info)
        return execute(simulation, job, route, info, seconds)


def _refuse_other_columns(folder: Path, simulation: Simulation) -> None:
    """Raise RunFolderError if a run began with other columns of the thermo table than its continuation has."""
    name = simulation.begun_name
    now = "".join(simulation.files()[name])
    if (folder / name).is_file() and _columns((folder / name).read_text(encoding="utf-8")) != _columns(now):
        raise RunFolderError(f"{folder}: was started by a version with other guards; run it again with force=True")


def _columns(deck: str) -> str:
    return next((line for line in reversed(deck.splitlines()) if line.startswith("thermo_style")), "")


def _job(
    simulation: Simulation, folder: Path, name: str, log: str, lock: int, options: Options, info: dict[str, Any]
) -> Job:
    """Return the job of an input, which sets the interval of checkpoints for the ranks."""
    progress, steps = options.progress, simulation.steps
    report = (lambda step: progress(min(step, steps), steps)) if progress else (lambda _: None)
    variables: tuple[str, ...] = ()
    if info["ranks"] > 1:
        variables = ("-var", "checkpoint", str(simulation.checkpoint_steps(info["ranks"])))
    return Job(folder, name, log, lock, report, simulation.looks, variables)


def execute(simulation: Simulation, job: Job, route: Route, info: dict[str, Any], seconds: Seconds) -> Record:
    """Run an input in its folder, collect its record, and write the outcome to ``run.json``.

    `seconds` collects the phases of the run (`granular_lmp.runs.phases`), including what was collected before.
    """
    folder = job.folder
    failure: BaseException | None = None
    with phase("write"), writable(folder):
        write_status(folder, info | {"status": "running", "message": "started"})
    try:
        with phase("deck"):  # the route times the start of LAMMPS, and the log the loop
            route(job)
    except KeyboardInterrupt:
        failure = RunInterrupted(
            f"{folder}: interrupted; what was recorded is kept; {how_to_continue(folder, info['launcher'])}"
        )
    except BaseException as error:  # also from the progress callback, because run.json must record the end of every run
        failure = error
    try:
        with phase("read"), writable(folder):
            record = simulation.collect(folder, stopped=failure is not None or job.log != LOG)
            log = read_log(folder / LOG) if (folder / LOG).exists() else RunLog({}, nan, {})
            found = simulation.outcome(folder, record, log, info)
            failure = failure or simulation.defect(record, log, job, info | found)
        before = info.get("wall_seconds", {})
        split("deck", {name: spent - before.get("phases", {}).get(name, 0.0) for name, spent in log.sections.items()})
        info = info | found | {"wall_seconds": wall_seconds(before, seconds)}
        if messages := triggered(info):
            if isinstance(failure, RunInterrupted):  # there is nothing to continue
                failure = RunInterrupted(f"{folder}: interrupted; {'; '.join(messages)}")
            failure = failure or EffectError(f"{folder}: {'; '.join(messages)}")
        if failure is None:
            info |= simulation.judged(record) | {"files": files_of(folder)}
    except BaseException as error:  # a full disk, or malformed files of LAMMPS
        failure = failure or error
    # SystemExit: the library of a batch system ends the process, for instance at its time limit
    stopped = isinstance(failure, (RunInterrupted, SystemExit)) and not triggered(info)
    status = "finished" if failure is None else "interrupted" if stopped else "failed"
    info = info | {"status": status, "message": str(failure) if failure is not None else ""}
    if failure is not None:
        with suppress(OSError):
            info |= {"files": files_of(folder, stopped=True)}
    with writable(folder):
        write_status(folder, info)
    if failure is not None:
        raise failure
    job.report_step(simulation.steps)
    for name in (*CHECKPOINTS, CONTACTS, UNWAVED_CONTACTS):  # contacts are kept only if they made the run fail
        (folder / name).unlink(missing_ok=True)
    return replace(record, info=info)
