"""The working directory of the thread in which LAMMPS runs: LAMMPS opens files relative to it.

A process has one working directory, which its threads share. Linux gives a thread its own when it asks, so that no
other thread sees LAMMPS's. Where the system refuses (macOS, some containers) the working directory of the process
changes while LAMMPS runs, and `absolute` resolves a relative folder as if it did not. Every function that makes or
continues a run calls it before all else.
"""

import ctypes
import os
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path

_CLONE_FS = 0x200  # linux/sched.h: share the working directory with other threads
_changing = threading.Lock()  # held while the directory of the process changes, or is looked at
os.register_at_fork(before=_changing.acquire, after_in_parent=_changing.release, after_in_child=_changing.release)
_usual: Path | None = None  # directory of the process before it changed to that of a run


def absolute(folder: str | Path) -> Path:
    """Return a folder as an absolute path, relative to the working directory of the user."""
    with _changing:
        return (_usual or Path()).joinpath(folder).absolute()


@contextmanager
def working_in(folder: Path, thread: Executor) -> Iterator[None]:
    """Let the only thread of an executor work in a folder; the caller holds the lock of LAMMPS."""
    global _usual
    if thread.submit(_moved_alone, folder).result():
        yield
        return
    with _changing:
        _usual = Path.cwd()
        os.chdir(folder)
    try:
        yield
    finally:
        with _changing:
            os.chdir(_usual)
            _usual = None


def _moved_alone(folder: Path) -> bool:
    """Return whether this thread has now a working directory of its own, and works in the folder."""
    if sys.platform != "linux" or ctypes.CDLL(None).unshare(_CLONE_FS) != 0:
        return False
    os.chdir(folder)
    return True
