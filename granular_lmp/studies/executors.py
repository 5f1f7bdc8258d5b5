"""Processes of this machine that stay warm between calls, as a `concurrent.futures.Executor`.

`concurrent.futures.ProcessPoolExecutor` gives up all its calls when one process dies, starts the caller's script again
in each process (hence the ``__main__`` guard), and its processes hear the Ctrl-C of the terminal. Here a process that
dies fails its own call alone and is replaced, only the package is imported, and Ctrl-C is the caller's to pass on.
"""

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from types import TracebackType
from typing import Any

from granular_lmp.errors import LaunchError, RunInterrupted, WorkerError

_STOP = b""  # said instead of a call
_served: Connection | None = None  # in a worker: the line to the caller


class Workers(Executor):
    """Runs calls in `count` processes, each started at its first call by a new interpreter (never by a fork).

    What is called must be importable, a function of a module and not of a script. Leaving a ``with`` block by an
    exception, Ctrl-C for one, asks the calls under way to stop (see `stop_requested`) and drops those that wait.

    Raises
    ------
    LaunchError
        When `count` is not at least 1.
    """

    def __init__(self, count: int):
        if count < 1:
            raise LaunchError(f"workers = {count!r}: must be at least 1")
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="worker")  # one thread waits for one process
        self._mine = threading.local()
        self._processes: dict[Connection, subprocess.Popen[bytes]] = {}
        self._stopping = False

    def submit(self, function: Callable[..., Any], /, *args: Any, **kwargs: Any) -> "Future[Any]":
        """Schedule a call; its future raises WorkerError when the process dies."""
        return self._threads.submit(self._call, function, args, kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Let the calls that wait be done, or drop them; then the processes end."""
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        if wait:
            for line in self._processes:
                line.close()
            for process in self._processes.values():
                process.wait()

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
            raise WorkerError(f"the process of the run ended by {_end(self._processes.pop(line).wait())}") from lost
        if error is not None:
            raise error
        return result


def mpi_workers() -> Executor:
    """The ranks of ``mpiexec -n RANKS python -m mpi4py.futures …``; the first one gives out the calls.

    Raises
    ------
    LaunchError
        When there is no mpi4py, or the program was not started so.
    """
    try:
        from mpi4py import MPI, futures  # noqa: PLC0415 (starts MPI)
    except (ImportError, RuntimeError) as error:  # no such module; no MPI library
        raise LaunchError(f"workers = 'mpi': mpi4py cannot be loaded: {error}") from error
    if MPI.COMM_WORLD.size < 2:
        raise LaunchError("workers = 'mpi': start at least 2 ranks: mpiexec -n RANKS python -m mpi4py.futures ...")
    executor: Executor = futures.MPIPoolExecutor()
    return executor


def stop_requested() -> bool:
    """Whether the caller wants this worker's call to stop, or is gone; False in any other process."""
    return _served is not None and _served.poll()


def _start() -> "tuple[Connection, subprocess.Popen[bytes]]":
    ours, theirs = Pipe()
    package = str(Path(__file__).parents[2])  # also where the package is not installed but run from a checkout
    path = os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH")]))
    process = subprocess.Popen(
        [sys.executable, "-c", f"from {__name__} import serve; serve({theirs.fileno()})"],
        stdin=subprocess.DEVNULL,
        env={"OPENBLAS_NUM_THREADS": "1"} | os.environ | {"PYTHONPATH": path},  # one core each
        pass_fds=[theirs.fileno()],
        start_new_session=True,  # Ctrl-C of the terminal is ours to pass on
    )
    theirs.close()
    return ours, process


def _send(line: Connection, message: bytes) -> bool:
    try:
        line.send_bytes(message)
    except OSError:  # the other side has gone
        return False
    return True


def _end(status: int) -> str:
    return f"signal {-status}" if status < 0 else f"exit status {status}"


def serve(descriptor: int) -> None:
    """Answer calls until the caller closes the line, asks to stop, or is gone: the whole life of a worker."""
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
    except Exception as error:  # whatever it is, it is the caller's
        return pickle.dumps((None, error))
