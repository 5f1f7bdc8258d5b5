"""Processes of this machine that stay warm between calls, as a `concurrent.futures.Executor`.

`concurrent.futures.ProcessPoolExecutor` drops all its calls when one process dies, starts the caller's script again in
each process (hence the ``__main__`` guard), and passes the terminal's Ctrl-C to its processes. Here a process that dies
fails only its own call and is replaced, only the package is imported, and the caller handles Ctrl-C.
"""

import logging
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from types import FrameType, TracebackType
from typing import IO, Any

from granular_lmp.errors import LaunchError, RunInterrupted, WorkerError
from granular_lmp.frozen import dataclass

__all__ = ["Workers"]

_STOP = b""  # message that asks for a stop instead of a call
_served: Connection | None = None  # connection of a worker to the caller
_terminated = False  # SIGTERM came during a call
_LAST_WORDS = 300  # characters of what a process wrote, in the message of its end


@dataclass(frozen=True)
class _Process:
    """A worker, and the file of what it writes to its standard streams."""

    running: subprocess.Popen[bytes]
    words: IO[bytes]

    def ended(self) -> str:
        """Wait for its end, log what it wrote, and return how it ended, with the last line of that."""
        status = self.running.wait()
        with self.words as stream:
            stream.seek(0)
            written = stream.read().decode(errors="replace").strip()
        if written:
            logging.getLogger(__name__).warning("%s", written)
        end = f"signal {-status}" if status < 0 else f"exit status {status}"
        return f"{end}; it wrote: {written.splitlines()[-1][:_LAST_WORDS]}" if written else end


class Workers(Executor):
    """Executor with `count` processes, each a new interpreter that starts at its first call (never a fork).

    A called function must belong to an importable module, not to a script. An exception that leaves a ``with`` block,
    such as Ctrl-C, asks the running calls to stop (see `stop_requested`) and drops the waiting ones.

    Raises
    ------
    LaunchError
        If `count` is not at least 1.
    """

    def __init__(self, count: int):
        if count < 1:
            raise LaunchError(f"workers = {count!r}: must be at least 1")
        self._count = count
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="worker")  # one thread waits for one process
        self._mine = threading.local()
        self._processes: dict[Connection, _Process] = {}
        self._stopping = False

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """Schedule a call and return its future, which raises WorkerError if the process dies."""
        return self._threads.submit(self._call, function, args, kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes after the waiting calls, or with `cancel_futures` without them."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        if wait:
            for line in self._processes:
                line.close()
            for process in self._processes.values():
                process.ended()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        if kind is not None:
            self._stopping = True
            self._threads.shutdown(wait=False, cancel_futures=True)
            for line in list(self._processes):
                _send(line, _STOP)
        return super().__exit__(kind, error, trace)

    def _call(self, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        if not hasattr(self._mine, "line"):
            self._mine.line, process = _start()
            self._processes[self._mine.line] = process
        if self._stopping:
            raise RunInterrupted("stopped before it began")
        line = self._mine.line
        try:
            line.send_bytes(pickle.dumps((function, args, kwargs)))
            result, error = pickle.loads(line.recv_bytes())
        except (EOFError, OSError) as lost:
            del self._mine.line
            line.close()
            raise WorkerError(f"the process of the run ended by {self._processes.pop(line).ended()}") from lost
        if error is not None:
            raise error
        return result


class Here(Executor):
    """Executor that runs each call at once in this thread, so that Ctrl-C stops the caller too."""

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        future.set_result(function(*args, **kwargs))
        return future


def mpi_workers() -> Executor:
    """Return an executor on the ranks of ``mpiexec -n RANKS python -m mpi4py.futures …``; the first rank submits.

    Raises
    ------
    LaunchError
        If mpi4py is missing, or the program was not started in this way.
    """
    try:
        from mpi4py import MPI, futures  # starts MPI
    except (ImportError, RuntimeError) as error:  # mpi4py or its MPI library is missing
        raise LaunchError(f"workers = 'mpi': mpi4py cannot be loaded: {error}") from error
    if MPI.COMM_WORLD.size < 2:
        raise LaunchError("workers = 'mpi': start at least 2 ranks: mpiexec -n RANKS python -m mpi4py.futures ...")
    executor: Executor = futures.MPIPoolExecutor()
    return executor


def stop_requested() -> bool:
    """Return whether the caller asks this worker's call to stop or has ended; False in any other process."""
    return _served is not None and _served.poll()


@contextmanager
def terminable() -> Iterator[None]:
    """Let SIGTERM, as batch systems send it, interrupt a call like Ctrl-C where it would end the process at once.

    It acts in the main thread, where workers of MPI and of executorlib make their calls, unless the program handles
    SIGTERM itself. A process that was asked to end makes no further call.

    Raises
    ------
    RunInterrupted
        If the process was asked to end before.
    """
    if _terminated:
        raise RunInterrupted("stopped before it began")
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGTERM) not in (signal.SIG_DFL, signal.SIG_IGN):
        yield
        return
    before = signal.signal(signal.SIGTERM, _end_after_call)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _end_after_call(_number: int, _frame: FrameType | None) -> None:
    global _terminated
    _terminated = True
    raise KeyboardInterrupt


def _start() -> tuple[Connection, _Process]:
    ours, theirs = Pipe()
    package = str(Path(__file__).parents[2])  # for a package that runs from a checkout without installation
    path = os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH")]))
    words = tempfile.TemporaryFile()  # noqa: SIM115 (as long as the process)
    process = subprocess.Popen(
        # -P: a module of the user's folder, such as signal.py, takes the place of no other
        [sys.executable, "-P", "-c", f"from {__name__} import serve; serve({theirs.fileno()})"],
        stdin=subprocess.DEVNULL,
        stdout=words,
        stderr=words,
        env={"OPENBLAS_NUM_THREADS": "1"} | os.environ | {"PYTHONPATH": path},  # one core each
        pass_fds=[theirs.fileno()],
        start_new_session=True,  # this process passes Ctrl-C of the terminal on
    )
    theirs.close()
    return ours, _Process(process, words)


def _send(line: Connection, message: bytes) -> bool:
    try:
        line.send_bytes(message)
    except OSError:  # the other process has ended
        return False
    return True


def serve(descriptor: int) -> None:
    """Run the calls of the caller until it closes the connection, asks to stop, or ends: the main loop of a worker."""
    global _served
    line = _served = Connection(descriptor)
    while True:
        try:
            call = line.recv_bytes()
        except (EOFError, OSError):
            return
        if call == _STOP or not _send(line, _answer(call)):
            return


def _answer(call: bytes) -> bytes:
    try:
        function, args, kwargs = pickle.loads(call)
        return pickle.dumps((function(*args, **kwargs), None))
    except Exception as error:  # every exception of a call belongs to the caller
        return pickle.dumps((None, error))
