"""Run a deck: in this process through the ``lammps`` module, or as the program ``lmp`` on one or more MPI ranks.

Whatever the route, LAMMPS reads the same ``in.NAME`` in the run folder and the record is the same to the last bit (on
one rank). LAMMPS works in a second thread, so that Ctrl-C and the progress display are served at once.
"""

import fcntl
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import chdir, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp.deck import CHECKPOINTS, DUMP, LOG, Deck, build, resume_text, writable
from granular_lmp.errors import GranularError, LammpsError, RunFolderError, RunInterrupted
from granular_lmp.locate import lammps_module, lmp_command
from granular_lmp.record import TRAJECTORY, Record, mend_dump, read_log, read_status, write_status
from granular_lmp.scene import Scene
from granular_lmp.status import description, outcome

Progress = Callable[[int, int], None]
Report = Callable[[int | None], None]
Route = Callable[[Path, str, Report], None]  # runs an input in a folder
LAUNCHERS = ("module", "lmp")
_POLL = 0.1  # s between two looks at a run: progress, and the longest wait for a program to stop
_GRACE = 0.5  # s that a stopped program gets before it is killed
_working_directory = threading.Lock()  # LAMMPS opens files relative to it, and a process has only one


def run(
    scene: Scene,
    folder: str | Path,
    *,
    launcher: str = "module",
    ranks: int = 1,
    force: bool = False,
    progress: Progress | None = None,
) -> Record:
    """Build the deck of `scene` in `folder`, run it, and return the record of the centre sphere.

    Parameters
    ----------
    scene : Scene
    folder : path
        The run folder, made here. What it will hold: ``scene.toml``, ``in.NAME``, ``data.NAME``, ``log.lammps``,
        ``dump.centre``, ``trajectory.csv``, ``run.json``, and of a run that was stopped or is long ``checkpoint.*``.
    launcher : "module" or "lmp"
        In this process, or the program ``lmp``. More than one rank always means the program.
    ranks : int
        MPI ranks.
    force : bool
        Run again in a folder that is there; only the files named above are replaced.
    progress : callable, optional
        Called as ``progress(step, steps)`` about ten times a second.

    Raises
    ------
    RunFolderError
        When the folder is there (without `force`) or cannot be written.
    LammpsMissingError, LammpsError
    RunInterrupted
        On Ctrl-C: LAMMPS stops within a second, ``run.json`` says so, what was recorded is kept; see `resume`.
    """
    if launcher not in LAUNCHERS:
        raise ValueError(f"launcher = {launcher!r}: must be one of {', '.join(LAUNCHERS)}")
    if ranks < 1:
        raise ValueError(f"ranks = {ranks!r}: must be at least 1")
    deck = build(scene)
    program = launcher == "lmp" or ranks > 1
    route = _route(program, ranks)  # everything that can be missing is asked for before a file is written
    folder = Path(folder)
    with _locked(folder, make=True, force=force) as lock:
        deck.write(folder, force=True)
        for name in (LOG, DUMP, TRAJECTORY, *CHECKPOINTS):
            (folder / name).unlink(missing_ok=True)  # of an earlier run: it must not pass for this one's
        info = description(deck, "lmp" if program else "module", ranks)
        return _execute(deck, deck.input_name, folder, partial(route, lock), info, progress)


def resume(folder: str | Path, *, progress: Progress | None = None) -> Record:
    """Continue an interrupted or killed run from its last checkpoint, by the route and on the ranks that it had.

    The dump ends up with the same bytes as if the run had not been stopped.

    Raises
    ------
    RunFolderError
        When the run is finished, or stopped before its first checkpoint.
    LammpsMissingError, LammpsError, RunInterrupted
        As in `run`.
    """
    folder = Path(folder)
    info = read_status(folder)
    if info.get("status") == "finished":
        raise RunFolderError(f"{folder}: the run is finished; there is nothing to resume")
    deck = build(Scene.load(folder / "scene.toml"))
    checkpoints = [path for path in map(folder.joinpath, CHECKPOINTS) if path.is_file() and path.stat().st_size]
    if not checkpoints:
        raise RunFolderError(f"{folder}: stopped before its first checkpoint; run it again with --force")
    last = max(checkpoints, key=lambda path: path.stat().st_mtime_ns)
    route = _route(info["launcher"] == "lmp", info["ranks"], log="none")  # the input opens the log to append to it
    name = f"{deck.input_name}.resume"
    with _locked(folder) as lock:
        (folder / name).write_text(resume_text(deck, last.name), encoding="utf-8")
        mend_dump(folder / DUMP)
        return _execute(deck, name, folder, partial(route, lock), info, progress)


def _execute(
    deck: Deck, input_name: str, folder: Path, route: Route, info: dict[str, Any], progress: Progress | None
) -> Record:
    """Run an input in the folder, collect what it recorded, and say in ``run.json`` how it ended."""
    scene, started = deck.scene, time.perf_counter()
    write_status(folder, info | {"status": "running", "message": "started"})
    report = _reporter(progress, scene.time.steps)
    failure: GranularError | None = None
    try:
        route(folder, input_name, report)
    except KeyboardInterrupt:
        failure = RunInterrupted(f"{folder}: interrupted; what was recorded is kept")
    except GranularError as error:
        failure = error
    record = _collect(folder, scene)
    if failure is None:
        failure = _defect(record, input_name, folder)
    status = "finished" if failure is None else "interrupted" if isinstance(failure, RunInterrupted) else "failed"
    info |= outcome(folder, record, time.perf_counter() - started)
    write_status(folder, info | {"status": status, "message": str(failure or "")})
    if failure is not None:
        raise failure
    report(scene.time.steps)
    for name in CHECKPOINTS:
        (folder / name).unlink(missing_ok=True)
    return Record.load(folder)


@contextmanager
def _locked(folder: Path, *, make: bool = False, force: bool = False) -> Iterator[int]:
    """Hold the folder for one run; gives the descriptor of the lock, which a program that works there inherits.

    The lock lives as long as any of its holders: a program that outlives us, when we are killed, keeps it.
    """
    with writable(folder):
        if make:
            folder.mkdir(parents=True, exist_ok=force)
        lock = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield lock
        except BlockingIOError as error:
            raise RunFolderError(f"{folder}: another run is at work there") from error
        finally:
            os.close(lock)


def _collect(folder: Path, scene: Scene) -> Record:
    """What the run recorded, finished or not; written to ``trajectory.csv``."""
    if not (folder / DUMP).exists():
        empty = np.empty(0)
        return Record(empty, empty, empty, empty, scene, folder=folder)
    mend_dump(folder / DUMP)
    record = Record.from_dump(folder, scene)
    record.write_csv(folder / TRAJECTORY)
    return record


def _defect(record: Record, input_name: str, folder: Path) -> LammpsError | None:
    """What is wrong with a record of which LAMMPS did not complain."""
    expected = record.scene.time.samples + 1
    if not all(np.isfinite(x).all() for x in (record.p, record.q, record.phi)):
        return LammpsError("the record holds numbers that are not finite", input_name, _log_tail(folder))
    if len(record.tau) != expected:
        return LammpsError(f"{len(record.tau)} records instead of {expected}", input_name, _log_tail(folder))
    return None


def _log_tail(folder: Path, lines: int = 15) -> str:
    try:
        return "\n".join((folder / LOG).read_text(encoding="utf-8", errors="replace").splitlines()[-lines:])
    except OSError:
        return ""


# --- the two routes --------------------------------------------------------------------------------------------------


def _reporter(progress: Progress | None, steps: int) -> Report:
    def report(step: int | None) -> None:
        if progress is not None and step is not None:
            progress(min(step, steps), steps)

    return report


def _route(program: bool, ranks: int, log: str = LOG) -> Callable[[int, Path, str, Report], None]:
    """A `Route` that still wants the lock of the folder; raises LammpsMissingError when what it needs is not there."""
    switches = ["-log", log, "-screen", "none", "-nocite"]
    if program:
        return partial(_run_program, lmp_command(ranks), [*switches, "-nonbuf"])
    return partial(_run_module, lammps_module(), switches)


def _run_module(module: Any, switches: list[str], lock: int, folder: Path, input_name: str, report: Report) -> None:
    with _working_directory, chdir(folder), ThreadPoolExecutor(1, thread_name_prefix="lammps") as pool:
        instance = pool.submit(module.lammps, cmdargs=switches).result()
        try:
            job = pool.submit(instance.file, input_name)
            try:
                _watch(job, lambda: report(instance.extract_global("ntimestep")))
            except KeyboardInterrupt:
                instance.force_timeout()  # the time loop ends at its next step
                # Before its first step a run holds nothing that is worth a checkpoint, and maybe not yet the wave
                if job.exception() is None and instance.extract_global("ntimestep") > 0:
                    pool.submit(instance.command, f"write_restart {CHECKPOINTS[0]}").result()
                raise
            except Exception as error:  # the module raises plain Exception and MPIAbortException
                raise LammpsError(_first_line(error), _last_command(folder), _log_tail(folder)) from error
        finally:
            pool.submit(instance.close).result()


def _watch(job: "Future[Any]", look: Callable[[], None]) -> None:
    """Wait for `job`, calling `look` now and then."""
    while True:
        try:
            job.result(timeout=_POLL)
            return
        except TimeoutError:
            if job.done():  # the job itself raised it
                raise
            look()


def _run_program(
    program: list[str], switches: list[str], lock: int, folder: Path, input_name: str, report: Report
) -> None:
    command = [*program, "-in", input_name, *switches]
    process = subprocess.Popen(
        command,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,  # Ctrl-C of the terminal is ours to pass on
        pass_fds=[lock],
    )
    try:
        while True:
            try:
                output, _ = process.communicate(timeout=_POLL)
                break
            except subprocess.TimeoutExpired:
                report(_step_in_log(folder))
    except KeyboardInterrupt:
        _stop(process)
        raise
    if process.returncode != 0:
        said = [*_log_tail(folder).splitlines(), *output.splitlines()]
        errors = [line for line in said if "ERROR" in line] or [f"exit status {process.returncode}"]
        raise LammpsError(errors[0], _last_command(folder) or " ".join(command), _log_tail(folder))


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
