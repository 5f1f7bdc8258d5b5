"""Run a deck: in this process through the ``lammps`` module, or as the program ``lmp`` on one or more MPI ranks.

Whatever the route, LAMMPS reads the same ``in.NAME`` in the run folder and the record is the same to the last bit (on
one rank). LAMMPS works in a second thread, so that Ctrl-C and the progress display are served at once.
"""

import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import chdir
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
FEWEST_FILES = 64  # a run of one rank was seen to need 24; others of the same process need their own
_POLL = 0.1  # s between two looks at a run: progress, and the longest wait for a program to stop
_GRACE = 0.5  # s that a stopped program gets before it is killed
_working_directory = threading.Lock()  # LAMMPS opens files relative to it, and a process has only one


@dataclass(frozen=True)
class Job:
    """One input to be run in a folder: the log to write, the lock to hold, whom to tell the step, its thermo columns.

    The lock is a descriptor that a program inherits, so that the folder stays locked if it outlives us.
    """

    folder: Path
    input_name: str
    log: str
    lock: int
    tell: Callable[[int], None]
    columns: tuple[str, ...] = ()

    @property
    def switches(self) -> list[str]:
        """What follows the name of the program, and is given to the module."""
        return ["-log", self.log, "-screen", "none", "-nocite"]


Route = Callable[[Job], None]


@dataclass(frozen=True)
class Options:
    """How a run is done: what `granular_lmp.run` is told beside the scene and the folder, and documents."""

    launcher: str = "module"
    ranks: int = 1
    force: bool = False
    progress: Progress | None = None

    def __post_init__(self) -> None:
        if self.launcher not in LAUNCHERS:
            raise LaunchError(f"launcher = {self.launcher!r}: must be one of {', '.join(LAUNCHERS)}")
        if not 1 <= self.ranks <= core_count():
            # More ranks than cores wait for each other in busy loops: 3 on 2 cores took 70 times as long as 2
            raise LaunchError(f"ranks = {self.ranks!r}: must be from 1 to {core_count()}, the cores of this machine")

    @property
    def program(self) -> bool:
        """Whether the program ``lmp`` runs the deck, and not this process."""
        return self.launcher == "lmp" or self.ranks > 1


def launch(deck: Deck, folder: str | Path, options: Options) -> Record:
    """Run a deck in `folder`, which is made, and return the record of the centre sphere.

    Raises
    ------
    RunFolderError, LammpsMissingError, LammpsError, EffectError, RunInterrupted
        As `granular_lmp.run`.
    """
    # Everything that can be missing is asked for before a file is written
    route = _route(options.program, options.ranks)
    info = description(deck, "lmp" if options.program else "module", options.ranks)
    folder = Path(folder).absolute()
    with locked(folder, make=True, force=options.force) as lock:
        clear(folder)
        deck.write(folder, force=True)
        with writable(folder):
            replace_text(folder / SCENE, deck.scene.to_toml())  # of a run: with every choice written out
        job = Job(folder, deck.input_name, LOG, lock, _teller(options.progress, deck.scene), _columns(deck))
        return execute(deck, job, route, info)


def resume(folder: str | Path, *, progress: Progress | None = None) -> Record:
    """Continue an interrupted or killed run from its last checkpoint, by the route and on the ranks that it had.

    The dumps end up with the same bytes as if the run had not been stopped. In sheets wider than 3 columns between held
    rows they may differ by 1e-14 D0, as contacts are summed in another order; with damping or sliding they are up to
    1e-6 D0 off, as LAMMPS sets a run up with other velocities than those between its steps.

    Raises
    ------
    RunFolderError
        When the run is finished, or stopped before its first checkpoint.
    LammpsMissingError, LammpsError, RunInterrupted
        As in `run`.
    """
    folder = Path(folder).absolute()
    read_status(folder)  # there is a run
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
        # The input opens the log itself, to append to it
        job = Job(folder, name, "none", lock, _teller(progress, deck.scene), _columns(deck))
        return execute(deck, job, route, info)


def _how_to_continue(folder: Path) -> str:
    """Return the command that continues a stopped run, or starts it again where there is no checkpoint."""
    if _checkpoints(folder):
        return f"continue with: granular-lmp resume {quote(str(folder))}"
    return "it has no checkpoint yet, run it again with force=True"


def _checkpoints(folder: Path) -> list[Path]:
    return [path for path in map(folder.joinpath, CHECKPOINTS) if path.is_file() and _is_whole(path)]


def _is_whole(checkpoint: Path) -> bool:
    """Whether LAMMPS wrote a restart file to its end, which is marked as its beginning is (``lmprestart.h``)."""
    mark = b"LammpS RestartT\0"
    with checkpoint.open("rb") as stream:
        stream.seek(max(0, checkpoint.stat().st_size - len(mark)))
        return stream.read() == mark


def run_input(folder: Path, input_name: str, lock: int) -> None:
    """Run an input in its locked folder, in this process, to its end; ``log.lammps`` is written there.

    Raises
    ------
    LammpsMissingError, LammpsError
    """
    _route(program=False, ranks=1)(Job(folder, input_name, LOG, lock, lambda step: None))


def check_machine() -> None:
    """Raise LammpsMissingError or LaunchError, before a file is written, if LAMMPS cannot run in this process."""
    _route(program=False, ranks=1)


def core_count() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _teller(progress: Progress | None, scene: Scene) -> Callable[[int], None]:
    steps = scene.time.steps
    return (lambda step: None) if progress is None else (lambda step: progress(min(step, steps), steps))


def _columns(deck: Deck) -> tuple[str, ...]:
    return tuple(columns(deck.problem.guards, deck.scene))


def execute(deck: Deck, job: Job, route: Route, info: dict[str, Any]) -> Record:
    """Run an input in its folder, collect what it recorded, and say in ``run.json`` how it ended."""
    folder, started = job.folder, time.perf_counter()
    with writable(folder):
        write_status(folder, info | {"status": "running", "message": "started"})
    failure: BaseException | None = None
    try:
        route(job)
    except KeyboardInterrupt:
        failure = RunInterrupted(f"{folder}: interrupted; what was recorded is kept; {_how_to_continue(folder)}")
    except BaseException as error:  # also what the caller's progress raises: the folder must say how the run ended
        failure = error
    try:
        with writable(folder):
            record = _collect(folder, deck.scene)
        info = info | outcome(folder, record, time.perf_counter() - started, info)
        failure = failure or _defect(record, job, list(info["guards"]))
        awake = triggered(info)
        if awake and failure is None:
            failure = EffectError(f"{folder}: {'; '.join(awake)}")
    except BaseException as error:  # a full disk, or what LAMMPS left is not what it writes
        failure = failure or error
    status = "finished" if failure is None else "interrupted" if isinstance(failure, RunInterrupted) else "failed"
    with writable(folder):
        write_status(folder, info | {"status": status, "message": str(failure or "")})
    if failure is not None:
        raise failure
    job.tell(deck.scene.time.steps)
    for name in (*CHECKPOINTS, CONTACTS):  # contacts only where they failed the run
        (folder / name).unlink(missing_ok=True)
    return Record.load(folder)


def _collect(folder: Path, scene: Scene) -> Record:
    """What the run recorded, finished or not; written to ``trajectory.csv``."""
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
    """What is wrong with a record of which LAMMPS did not complain."""
    expected = record.scene.time.samples + 1
    tracked = [record.p, record.q] + ([record.phi] if record.scene.effects.tracking else [])
    if not all(np.isfinite(x).all() for x in tracked):
        return LammpsError("the record holds numbers that are not finite", job.input_name, _log_tail(job.folder))
    if len(record.tau) != expected:
        return LammpsError(f"{len(record.tau)} records instead of {expected}", job.input_name, _log_tail(job.folder))
    # LAMMPS does not notice when its log cannot be written; a guard that was not heard must not pass for a silent one
    table, _ = read_log(job.folder / LOG)
    time_ = record.scene.time
    looks = np.append(np.arange(0, time_.steps, line_interval(record.scene)), time_.steps)
    missed = np.setdiff1d(looks, table.get("Step", []))
    unheard = [name for name in guards if not {GUARDS[name].column, f"{GUARDS[name].column}_at"} <= set(table)]
    if len(missed) or unheard:
        lack = f"step {missed[0]}" if len(missed) else f"the guard {unheard[0]}"
        return LammpsError(f"the log lacks {lack}", job.input_name, _log_tail(job.folder))
    return None


def _log_tail(folder: Path, lines: int = 15) -> str:
    try:
        return "\n".join((folder / LOG).read_text(encoding="utf-8", errors="replace").splitlines()[-lines:])
    except OSError:
        return ""


# --- the two routes --------------------------------------------------------------------------------------------------


def _route(program: bool, ranks: int) -> Route:
    """Return the function that runs a job; raises LammpsMissingError or LaunchError when what it needs is not there."""
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if 0 <= files < FEWEST_FILES:  # MPI would end this process without a word to us
        raise LaunchError(f"ulimit -n = {files}: must be at least {FEWEST_FILES} open files for LAMMPS and its MPI")
    return partial(_run_program, lmp_command(ranks)) if program else partial(_run_module, lammps_module())


def _run_module(module: Any, job: Job) -> None:
    with _working_directory, chdir(job.folder), ThreadPoolExecutor(1, thread_name_prefix="lammps") as pool:
        try:
            instance = pool.submit(module.lammps, cmdargs=job.switches, comm=_this_rank()).result()
        except RuntimeError as refused:  # without the communicator it would be a segmentation fault
            raise LammpsMissingError(
                f"LAMMPS cannot be started beside this mpi4py: {_first_line(refused)}"
            ) from refused
        work = pool.submit(instance.file, job.input_name)
        try:
            _watch(work, lambda: job.tell(instance.extract_global("ntimestep")))
        except BaseException:
            if not work.done():
                instance.force_timeout()  # the time loop ends at its next step
            error = work.exception()
            if error is not None:  # the module raises plain Exception and MPIAbortException
                raise LammpsError(_first_line(error), _last_command(job.folder), _log_tail(job.folder)) from error
            # Before its first step a run holds nothing that is worth a checkpoint, and maybe not yet the wave
            if instance.extract_global("ntimestep") > 0:
                pool.submit(instance.command, f"write_restart {CHECKPOINTS[0]}").result()
                for line in _last_line(instance, job.columns):
                    pool.submit(instance.command, f'print "{line}"').result()
            raise
        finally:
            pool.submit(instance.close).result()


def _last_line(instance: Any, columns: tuple[str, ...]) -> tuple[str, str]:
    """A thermo table of the step at which a run was stopped: the continuation begins with no looks."""
    rows, width = (instance.extract_fix("looks", 0, kind) for kind in (4, 5))  # LMP_SIZE_ROWS, LMP_SIZE_COLS
    looks = np.array([[instance.extract_fix("looks", 0, 2, i, j) for j in range(width)] for i in range(rows)])
    words = (str(instance.extract_global("ntimestep")), *words_between_runs(list(columns), looks))
    return " ".join(("Step", *columns)), " ".join(words)


def _this_rank() -> Any:
    """The communicator of this process alone, where the caller has MPI ranks; in the world's, LAMMPS waits for all."""
    mpi = sys.modules.get("mpi4py.MPI")
    return mpi.COMM_SELF if mpi else None


def _watch(work: "Future[Any]", look: Callable[[], None]) -> None:
    """Wait for `work`, calling `look` now and then."""
    while True:
        try:
            work.result(timeout=_POLL)
            return
        except TimeoutError:
            if work.done():  # the work itself raised it
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
        start_new_session=True,  # Ctrl-C of the terminal is ours to pass on
        pass_fds=[job.lock],
    ) as process:
        try:
            output = _output(process, job)
        except BaseException:
            _stop(process)
            raise
    if process.returncode != 0:
        said = [*_log_tail(job.folder).splitlines(), *output.splitlines()]
        errors = [line for line in said if "ERROR" in line] or [f"exit status {process.returncode}"]
        raise LammpsError(errors[0], _last_command(job.folder) or " ".join(command), _log_tail(job.folder))


def _output(process: "subprocess.Popen[str]", job: Job) -> str:
    """Wait for the program, telling the step now and then; what it printed."""
    while True:
        try:
            return process.communicate(timeout=_POLL)[0]
        except subprocess.TimeoutExpired:
            step = _step_in_log(job.folder)
            if step is not None:
                job.tell(step)


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
    """The input line that LAMMPS names in its log as the last one."""
    lines = _log_tail(folder, 40).splitlines()
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("Last input line:")]
    return named[-1] if named else ""
