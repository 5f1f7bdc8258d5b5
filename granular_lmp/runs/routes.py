"""The two routes for running an input in LAMMPS: the ``lammps`` module in this process, or the program ``lmp``.

On either route LAMMPS reads the same input in the run folder. It runs in a second thread or in a separate process, so
that Ctrl-C and the progress display work without delay.
"""

import os
import re
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

from granular_lmp.errors import LammpsError, LammpsMissingError, LaunchError
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.installation import environment, lammps_module, lmp_command, use_locale
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.outputs import CHECKPOINTS, LOG
from granular_lmp.runs.directory import working_in
from granular_lmp.runs.options import Options
from granular_lmp.runs.phases import phase

FEWEST_FILES = 64  # open files; a run on one rank needs 24 (measured), and so does each other run of the process
_POLL = 0.1  # s between two progress reports, and the longest wait for a program to stop
_GRACE = 0.5  # s between the request to stop and the kill of a program
_TAIL = 4096  # bytes of a log that contain many lines of its table
_NUMBERS = re.compile(rb" *\d+( +(-|[-+]?(\d[\d.e+-]*|nan|inf)))* *")  # the step and the value of a guard or a clock
_one_at_a_time = threading.Lock()  # for LAMMPS in this process


def _renew() -> None:
    """Renew the lock of LAMMPS in a forked process, as a thread of the parent may hold it."""
    global _one_at_a_time
    _one_at_a_time = threading.Lock()


os.register_at_fork(after_in_child=_renew)


@dataclass(frozen=True)
class Job:
    """Input to run in a folder.

    Attributes
    ----------
    folder : Path
    input_name : str
        File name of the input.
    log : str
        Argument of ``-log``.
    lock : int
        Descriptor of the lock of the folder. The program inherits it, so the folder stays locked if the program
        outlives this process.
    report_step : callable
        Callback for progress, called with the time step.
    looks : "table", "kernel", "none" or ""
        Where the guards of the input have their looks; "" if a stopped run of the input has no checkpoint.
    variables : tuple of str
        Words that override variables of the deck: ``-var``, name, value.
    """

    folder: Path
    input_name: str
    log: str
    lock: int
    report_step: Callable[[int], None]
    looks: str = ""
    variables: tuple[str, ...] = ()

    @property
    def switches(self) -> list[str]:
        """Command-line switches for the program and the module."""
        return ["-log", self.log, "-screen", "none", "-nocite", *self.variables]


Route = Callable[[Job], None]


def check_machine() -> None:
    """Raise LammpsMissingError or LaunchError if LAMMPS cannot run in this process."""
    route_of(Options())


def route_of(options: Options) -> Route:
    """Return the function that runs a job with these options.

    Raises
    ------
    LammpsMissingError, LaunchError
        If LAMMPS, its MPI library, a program or the kernel is missing, or too few files may be open.
    """
    files, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if 0 <= files < FEWEST_FILES:  # otherwise MPI would end this process without an error message
        raise LaunchError(f"ulimit -n = {files}: must be at least {FEWEST_FILES} open files for LAMMPS and its MPI")
    with phase("start"):
        kernel = library.built() if options.kernel else None
        if options.program:
            return partial(_run_program, lmp_command(options.ranks), environment(options.ranks), kernel)
        return partial(_run_module, lammps_module(), kernel)


def _run_module(module: Any, kernel: Path | None, job: Job) -> None:
    with (
        _one_at_a_time,
        ThreadPoolExecutor(1, thread_name_prefix="lammps", initializer=use_locale) as pool,
        working_in(job.folder, pool),
    ):
        try:
            with phase("start"):
                instance = pool.submit(library.start, module, kernel, job.switches, _this_rank()).result()
        except RuntimeError as refused:  # without a communicator the module would crash
            beside = " beside this mpi4py" if _this_rank() else ""
            raise LammpsMissingError(f"LAMMPS cannot be started{beside}: {_first_line(refused)}") from refused
        work = pool.submit(instance.file, job.input_name)
        try:
            _watch(work, lambda: job.report_step(instance.extract_global("ntimestep")))
        except BaseException:
            if not work.done():
                instance.force_timeout()  # the time loop ends at its next step
            error = work.exception()
            if error is not None:  # the module raises plain Exception and MPIAbortException
                raise LammpsError(_first_line(error), _last_command(job.folder), log_tail(job.folder)) from error
            # Before its first step a run may not have the wave yet, and a checkpoint would save no time
            if job.looks and instance.extract_global("ntimestep") > 0:
                with _uninterrupted():
                    for command in _checkpoint(instance, job.looks):
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


def _checkpoint(instance: Any, looks: str) -> list[str]:
    """Return the commands that write the checkpoint of a stopped run.

    The run continues to a step with a look, as some fixes have numbers only there. Extremes that the kernel saw since
    the last line of the table become one more line. LAMMPS sets up its fixes again before it writes, so the fix for the
    last lines of the deck is removed.
    """
    now, end = instance.extract_global("ntimestep"), int(instance.extract_variable("steps"))
    in_kernel = looks == "kernel"
    look = 1 if looks == "none" else int(instance.extract_variable("look"))
    steps = min(-now % look, end - now)
    on = ["timer timeout off", f"run {steps} pre no post no"] if steps or in_kernel else []
    no_table, judged = ["thermo_style custom step"], ["unfix judged"] * instance.has_id("fix", "judged")
    return [*(no_table if on and not in_kernel else []), *on, *no_table, *judged, f"write_restart {CHECKPOINTS[0]}"]


def _this_rank() -> Any:
    """Return the communicator of this process if mpi4py is loaded; in the world's, LAMMPS waits for all ranks."""
    mpi = sys.modules.get("mpi4py.MPI")
    return mpi.COMM_SELF if mpi else None


def _watch(work: "Future[Any]", look: Callable[[], None]) -> None:
    """Wait for `work` and call `look` every `_POLL` seconds."""
    while not wait([work], timeout=_POLL).done:
        look()
    work.result()


def _run_program(program: list[str], variables: dict[str, str], kernel: Path | None, job: Job) -> None:
    command = [*program, "-in", job.input_name, *job.switches, *(library.SWITCHES if kernel else ()), "-nonbuf"]
    with (
        subprocess.Popen(
            command,
            cwd=job.folder,
            env=variables | library.offered(kernel),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,  # this process passes on Ctrl-C from the terminal
            pass_fds=[job.lock],
        ) as process,
        _killed_with_this_process(process.pid),
    ):
        try:
            output = _output(process, job)
        except BaseException:
            _stop(process)
            raise
    lines = [*log_tail(job.folder).splitlines(), *output.splitlines()]
    errors = [line for line in lines if "ERROR" in line] or [f"exit status {process.returncode}"]
    silent = kernel is not None and library.SAID not in log_tail(job.folder, sys.maxsize)
    if kernel is not None and silent and (process.returncode == 0 or library.STYLE in errors[0]):
        raise library.not_loaded(kernel)
    if process.returncode != 0:
        raise LammpsError(errors[0], _last_command(job.folder) or " ".join(command), log_tail(job.folder))


@contextmanager
def _killed_with_this_process(group: int) -> Iterator[None]:
    """Kill a group of processes when this process ends in any way: a shell then reads the end of a pipe."""
    end, ours = os.pipe()
    watch = ["/bin/sh", "-c", 'read -r none; kill -KILL "-$0"', str(group)]
    try:
        with subprocess.Popen(watch, stdin=end, start_new_session=True, stderr=subprocess.DEVNULL) as watcher:
            os.close(end)
            try:
                yield
            finally:
                watcher.kill()
    finally:
        os.close(ours)


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
    """End the program and all its ranks, which hold the lock; ``lmp`` of the wheel starts another process."""
    with suppress(ProcessLookupError):  # none is left
        for request in (signal.SIGTERM, signal.SIGKILL):
            os.killpg(process.pid, request)
            until = time.monotonic() + _GRACE
            while time.monotonic() < until:
                process.poll()
                os.killpg(process.pid, 0)
                time.sleep(0.01)
    process.wait()


def _step_in_log(folder: Path) -> int | None:
    """Return the step in the last complete line of numbers near the end of the log; None if there is none."""
    try:
        with (folder / LOG).open("rb") as stream:
            stream.seek(max(0, stream.seek(0, os.SEEK_END) - _TAIL))
            lines = stream.read().split(b"\n")[
                1:-1
            ]  # the first line may be incomplete, and the last is still being written
    except OSError:
        return None
    return next((int(line.split()[0]) for line in reversed(lines) if _NUMBERS.fullmatch(line)), None)


def _first_line(error: BaseException) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__


def _last_command(folder: Path) -> str:
    """Return the last input line according to the log, or an empty string."""
    lines = log_tail(folder, 40).splitlines()
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("Last input line:")]
    return named[-1] if named else ""


def log_tail(folder: Path, lines: int = 15) -> str:
    """Return the last lines of the log of LAMMPS; "" if it cannot be read."""
    try:
        return "\n".join((folder / LOG).read_text(encoding="utf-8", errors="replace").splitlines()[-lines:])
    except OSError:
        return ""
