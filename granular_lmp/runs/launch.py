"""Run a deck: in this process through the ``lammps`` module, or as the program ``lmp`` on one or more MPI ranks.

On either route LAMMPS reads the same ``in.NAME`` in the run folder, and on one rank the record is the same to the last
bit. LAMMPS runs in a second thread, so that Ctrl-C and the progress display work at once.
"""

import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import chdir, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from granular_lmp.errors import (
    EffectError,
    LammpsError,
    LammpsMissingError,
    LaunchError,
    RunFolderError,
    RunInterrupted,
)
from granular_lmp.lammps.deck import Deck, deck_of, resume_text
from granular_lmp.lammps.guards import GUARDS, columns, line_interval, words_between_runs
from granular_lmp.lammps.installation import lammps_module, lmp_command
from granular_lmp.lammps.outputs import (
    CHECKPOINTS,
    CONTACTS,
    DUMP,
    LOG,
    PARTICLES,
    SCENE,
    STATUS,
    mend_dump,
    mend_log,
    read_log,
    replace_text,
    writable,
)
from granular_lmp.problem import prepare
from granular_lmp.runs.agreement import refuse_other_scene
from granular_lmp.runs.folder import clear, locked
from granular_lmp.runs.manifest import description, outcome, triggered
from granular_lmp.runs.record import TRAJECTORY, Record, read_status, write_status
from granular_lmp.scene.scene import Scene

Progress = Callable[[int, int], None]
LAUNCHERS = ("module", "lmp")
FEWEST_FILES = 64  # open files; a run of one rank needs 24 (measured), and each other run of the process its own
_POLL = 0.1  # s between two progress reports, and the longest wait for a program to stop
_GRACE = 0.5  # s between the request to stop and the kill of a program
_working_directory = threading.Lock()  # LAMMPS opens files relative to it, and a process has only one


@dataclass(frozen=True)
class Job:
    """One input to be run in a folder.

    Attributes
    ----------
    folder : Path
    input_name : str
        File name of the input.
    log : str
        Argument of ``-log``.
    lock : int
        Descriptor of the folder's lock. The program inherits it, so that the folder stays locked if it outlives this
        process.
    report_step : callable
        Callback for progress, called with the time step.
    columns : tuple of str
        Thermo columns of the input.
    """

    folder: Path
    input_name: str
    log: str
    lock: int
    report_step: Callable[[int], None]
    columns: tuple[str, ...] = ()

    @property
    def switches(self) -> list[str]:
        """Command-line switches for the program and the module."""
        return ["-log", self.log, "-screen", "none", "-nocite"]


Route = Callable[[Job], None]


@dataclass(frozen=True)
class Options:
    """Options of a run: the arguments of `granular_lmp.run` apart from scene and folder, documented there.

    Raises
    ------
    LaunchError
        If the launcher is unknown, or there are more ranks than cores.
    """

    launcher: str = "module"
    ranks: int = 1
    force: bool = False
    progress: Progress | None = None

    def __post_init__(self) -> None:
        if self.launcher not in LAUNCHERS:
            raise LaunchError(f"launcher = {self.launcher!r}: must be one of {', '.join(LAUNCHERS)}")
        if not 1 <= self.ranks <= core_count():
            # Ranks wait for each other in busy loops: 3 ranks on 2 cores took 70 times as long as 2 ranks
            raise LaunchError(f"ranks = {self.ranks!r}: must be from 1 to {core_count()}, the cores of this machine")

    @property
    def program(self) -> bool:
        """True if the program ``lmp`` runs the deck instead of this process."""
        return self.launcher == "lmp" or self.ranks > 1


def launch(deck: Deck, folder: str | Path, options: Options) -> Record:
    """Run a deck in `folder`, which is created, and return the record of the centre sphere.

    Raises
    ------
    RunFolderError, LammpsMissingError, LammpsError, EffectError, RunInterrupted
        As in `granular_lmp.run`.
    """
    # Missing programs and libraries are reported before a file is written
    route = _route(options.program, options.ranks)
    info = description(deck, "lmp" if options.program else "module", options.ranks)
    folder = Path(folder).absolute()
    with locked(folder, make=True, force=options.force) as lock:
        clear(folder)
        deck.write(folder, force=True)
        with writable(folder):
            replace_text(folder / SCENE, deck.scene.to_toml())  # the scene of a run has every "auto" decided
        job = Job(folder, deck.input_name, LOG, lock, _step_reporter(options.progress, deck.scene), _columns(deck))
        return execute(deck, job, route, info)


def resume(folder: str | Path, *, progress: Progress | None = None) -> Record:
    """Continue an interrupted or killed run from its last checkpoint on the same route and ranks.

    Raises
    ------
    RunFolderError
        If the run is finished, or was stopped before its first checkpoint.
    LammpsMissingError, LammpsError, EffectError, RunInterrupted
        As in `granular_lmp.run`.

    Notes
    -----
    The dumps have the same bytes as those of an uninterrupted run, with two exceptions. In sheets wider than 3 columns
    between held rows they may differ by 1e-14 D0, because contacts are summed in another order. With damping or sliding
    they differ by up to 1e-6 D0, because LAMMPS sets up a run with other velocities than those between its steps.
    """
    folder = Path(folder).absolute()
    read_status(folder)  # raises if the folder holds no run
    with locked(folder) as lock:
        info = read_status(folder)
        if info.get("status") == "finished":
            raise RunFolderError(f"{folder}: the run is finished; there is nothing to resume")
        ranks = info.get("ranks")
        known = {"effects", "versions"} <= set(info) and info.get("launcher") in LAUNCHERS and isinstance(ranks, int)
        if not known:
            raise RunFolderError(f"{folder}: {STATUS} does not say how the run was started; repeat it with force=True")
        if "edited" in info:
            raise RunFolderError(f"{folder}: its deck was edited, which resume does not know of; run it again")
        refuse_other_scene(folder, info)
        deck = deck_of(prepare(Scene.load(folder / SCENE)))
        checkpoints = _checkpoints(folder)
        if not checkpoints or not (folder / DUMP).is_file():
            raise RunFolderError(f"{folder}: stopped before its first checkpoint; run it again with force=True")
        last = max(checkpoints, key=lambda path: path.stat().st_mtime_ns)
        route = _route(info["launcher"] == "lmp", info["ranks"])
        name = f"{deck.input_name}.resume"
        with writable(folder):
            (folder / name).write_text(resume_text(deck, last.name), encoding="utf-8")
            _mend(folder)
            mend_log(folder / LOG)
        # The log is "none" because the input itself opens it for appending
        job = Job(folder, name, "none", lock, _step_reporter(progress, deck.scene), _columns(deck))
        return execute(deck, job, route, info)


def _how_to_continue(folder: Path) -> str:
    """Return the command that continues a stopped run, or that starts it again if there is no checkpoint."""
    if _checkpoints(folder):
        return f"continue with: granular-lmp resume {quote(str(folder))}"
    return "it has no checkpoint yet, run it again with force=True"


def _checkpoints(folder: Path) -> list[Path]:
    return [path for path in map(folder.joinpath, CHECKPOINTS) if path.is_file() and _is_whole(path)]


def _is_whole(checkpoint: Path) -> bool:
    """Return whether a restart file is complete: LAMMPS writes the same mark at its beginning and its end.

    The mark is defined in ``lmprestart.h``.
    """
    mark = b"LammpS RestartT\0"
    with checkpoint.open("rb") as stream:
        stream.seek(max(0, checkpoint.stat().st_size - len(mark)))
        return stream.read() == mark


def run_input(folder: Path, input_name: str, lock: int) -> None:
    """Run an input in its locked folder in this process; LAMMPS writes ``log.lammps`` there.

    Raises
    ------
    LammpsMissingError, LammpsError
        As in `granular_lmp.run`.
    """
    _route(program=False, ranks=1)(Job(folder, input_name, LOG, lock, lambda step: None))


def check_machine() -> None:
    """Raise LammpsMissingError or LaunchError if LAMMPS cannot run in this process."""
    _route(program=False, ranks=1)


def core_count() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _step_reporter(progress: Progress | None, scene: Scene) -> Callable[[int], None]:
    steps = scene.time.steps
    return (lambda step: None) if progress is None else (lambda step: progress(min(step, steps), steps))


def _columns(deck: Deck) -> tuple[str, ...]:
    return tuple(columns(deck.problem.guards, deck.scene))


def execute(deck: Deck, job: Job, route: Route, info: dict[str, Any]) -> Record:
    """Run an input in its folder, collect its record, and write the outcome to ``run.json``."""
    folder, started = job.folder, time.perf_counter()
    with writable(folder):
        write_status(folder, info | {"status": "running", "message": "started"})
    failure: BaseException | None = None
    try:
        route(job)
    except KeyboardInterrupt:
        failure = RunInterrupted(f"{folder}: interrupted; what was recorded is kept; {_how_to_continue(folder)}")
    except BaseException as error:  # also from the progress callback: run.json must hold the end of every run
        failure = error
    try:
        with writable(folder):
            record = _collect(folder, deck.scene)
        info = info | outcome(folder, record, time.perf_counter() - started, info)
        failure = failure or _defect(record, job, list(info["guards"]))
        messages = triggered(info)
        if messages and failure is None:
            failure = EffectError(f"{folder}: {'; '.join(messages)}")
    except BaseException as error:  # a full disk, or malformed files of LAMMPS
        failure = failure or error
    status = "finished" if failure is None else "interrupted" if isinstance(failure, RunInterrupted) else "failed"
    with writable(folder):
        write_status(folder, info | {"status": status, "message": str(failure or "")})
    if failure is not None:
        raise failure
    job.report_step(deck.scene.time.steps)
    for name in (*CHECKPOINTS, CONTACTS):  # contacts are kept only if they failed the run
        (folder / name).unlink(missing_ok=True)
    return Record.load(folder)


def _collect(folder: Path, scene: Scene) -> Record:
    """Return the record of a run, finished or not, and write it to ``trajectory.csv``."""
    if not (folder / DUMP).exists():
        empty = np.empty(0)
        return Record(empty, empty, empty, empty, scene, folder=folder)
    _mend(folder)
    try:
        record = Record.from_dump(folder, scene)
    except RunFolderError as error:
        raise LammpsError(str(error), f"in.{scene.name}", _log_tail(folder)) from error
    record.write_csv(folder / TRAJECTORY)
    return record


def _mend(folder: Path) -> None:
    for path in filter(Path.is_file, map(folder.joinpath, (DUMP, PARTICLES))):
        mend_dump(path)


def _defect(record: Record, job: Job, guards: list[str]) -> LammpsError | None:
    """Return an error if the record or the log is incomplete although LAMMPS reported success, else None."""
    expected = record.scene.time.samples + 1
    tracked = [record.p, record.q] + ([record.phi] if record.scene.effects.tracking else [])
    if not all(np.isfinite(x).all() for x in tracked):
        return LammpsError("the record holds numbers that are not finite", job.input_name, _log_tail(job.folder))
    if len(record.tau) != expected:
        return LammpsError(f"{len(record.tau)} records instead of {expected}", job.input_name, _log_tail(job.folder))
    # LAMMPS does not notice a failed write to its log, and a guard without a value must not count as below its limit
    table, _ = read_log(job.folder / LOG)
    time_ = record.scene.time
    looks = np.append(np.arange(0, time_.steps, line_interval(record.scene)), time_.steps)
    missed = np.setdiff1d(looks, table.get("Step", []))
    absent = [name for name in guards if not {GUARDS[name].column, f"{GUARDS[name].column}_at"} <= set(table)]
    if len(missed) or absent:
        lack = f"step {missed[0]}" if len(missed) else f"the guard {absent[0]}"
        return LammpsError(f"the log lacks {lack}", job.input_name, _log_tail(job.folder))
    return None


def _log_tail(folder: Path, lines: int = 15) -> str:
    try:
        return "\n".join((folder / LOG).read_text(encoding="utf-8", errors="replace").splitlines()[-lines:])
    except OSError:
        return ""


# --- the two routes --------------------------------------------------------------------------------------------------


def _route(program: bool, ranks: int) -> Route:
    """Return the function that runs a job.

    Raises
    ------
    LammpsMissingError, LaunchError
        If LAMMPS, its MPI library or a program is missing, or too few files may be open.
    """
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if 0 <= files < FEWEST_FILES:  # MPI would end this process without an error message
        raise LaunchError(f"ulimit -n = {files}: must be at least {FEWEST_FILES} open files for LAMMPS and its MPI")
    return partial(_run_program, lmp_command(ranks)) if program else partial(_run_module, lammps_module())


def _run_module(module: Any, job: Job) -> None:
    with _working_directory, chdir(job.folder), ThreadPoolExecutor(1, thread_name_prefix="lammps") as pool:
        try:
            instance = pool.submit(module.lammps, cmdargs=job.switches, comm=_this_rank()).result()
        except RuntimeError as refused:  # without a communicator the module would end in a segmentation fault
            raise LammpsMissingError(
                f"LAMMPS cannot be started beside this mpi4py: {_first_line(refused)}"
            ) from refused
        work = pool.submit(instance.file, job.input_name)
        try:
            _watch(work, lambda: job.report_step(instance.extract_global("ntimestep")))
        except BaseException:
            if not work.done():
                instance.force_timeout()  # the time loop ends at its next step
            error = work.exception()
            if error is not None:  # the module raises plain Exception and MPIAbortException
                raise LammpsError(_first_line(error), _last_command(job.folder), _log_tail(job.folder)) from error
            # Before its first step a run may not hold the wave yet, and a checkpoint would save no time
            if instance.extract_global("ntimestep") > 0:
                with _uninterrupted():
                    for command in _to_next_look(instance):
                        pool.submit(instance.command, command).result()
                    for command in _last_commands(instance, job.columns):
                        pool.submit(instance.command, command).result()
            raise
        finally:
            pool.submit(instance.close).result()


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ignore a second Ctrl-C, which would leave a stopped run without its checkpoint."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _to_next_look(instance: Any) -> list[str]:
    """Commands that take a stopped run on to a step at which guards look: LAMMPS continues their table only there."""
    steps = -instance.extract_global("ntimestep") % int(instance.extract_variable("look"))
    return ["thermo_style custom step", "timer timeout off", f"run {steps} pre no post no"] if steps else []


def _last_commands(instance: Any, columns: tuple[str, ...]) -> list[str]:
    """Return the commands that write a checkpoint and a thermo table of the step at which a run was stopped.

    The continuation begins with no looks. LAMMPS sets the fix that holds them up again before it writes a checkpoint,
    for a run of no steps, which after a continuation it cannot: the fix has to go first.
    """
    rows, width = (instance.extract_fix("looks", 0, kind) for kind in (4, 5))  # LMP_SIZE_ROWS, LMP_SIZE_COLS
    looks = np.array([[instance.extract_fix("looks", 0, 2, i, j) for j in range(width)] for i in range(rows)])
    words = (str(instance.extract_global("ntimestep")), *words_between_runs(list(columns), looks))
    table = [" ".join(("Step", *columns)), " ".join(words)]
    prints = [f'print "{line}"' for line in table]
    return ["thermo_style custom step", "unfix looks", f"write_restart {CHECKPOINTS[0]}", *prints]


def _this_rank() -> Any:
    """Return the communicator of this process alone if mpi4py is loaded; in the world's, LAMMPS waits for all ranks."""
    mpi = sys.modules.get("mpi4py.MPI")
    return mpi.COMM_SELF if mpi else None


def _watch(work: "Future[Any]", look: Callable[[], None]) -> None:
    """Wait for `work` and call `look` every `_POLL` seconds."""
    while True:
        try:
            work.result(timeout=_POLL)
            return
        except TimeoutError:
            if work.done():  # the work itself raised TimeoutError
                raise
            look()


def _run_program(program: list[str], job: Job) -> None:
    command = [*program, "-in", job.input_name, *job.switches, "-nonbuf"]
    with subprocess.Popen(
        command,
        cwd=job.folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,  # this process passes Ctrl-C of the terminal on
        pass_fds=[job.lock],
    ) as process:
        try:
            output = _output(process, job)
        except BaseException:
            _stop(process)
            raise
    if process.returncode != 0:
        lines = [*_log_tail(job.folder).splitlines(), *output.splitlines()]
        errors = [line for line in lines if "ERROR" in line] or [f"exit status {process.returncode}"]
        raise LammpsError(errors[0], _last_command(job.folder) or " ".join(command), _log_tail(job.folder))


def _output(process: "subprocess.Popen[str]", job: Job) -> str:
    """Wait for the program, report its step every `_POLL` seconds, and return its output."""
    while True:
        try:
            return process.communicate(timeout=_POLL)[0]
        except subprocess.TimeoutExpired:
            step = _step_in_log(job.folder)
            if step is not None:
                job.report_step(step)


def _stop(process: "subprocess.Popen[str]") -> None:
    """End the program and all its ranks."""
    os.killpg(process.pid, signal.SIGTERM)
    try:
        process.wait(_GRACE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _step_in_log(folder: Path) -> int | None:
    try:
        table, _ = read_log(folder / LOG)
    except RunFolderError:
        return None
    steps = table.get("Step")
    return int(steps[-1]) if steps is not None and len(steps) else None


def _first_line(error: BaseException) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__


def _last_command(folder: Path) -> str:
    """Return the last input line according to LAMMPS's log, or an empty string."""
    lines = _log_tail(folder, 40).splitlines()
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("Last input line:")]
    return named[-1] if named else ""
