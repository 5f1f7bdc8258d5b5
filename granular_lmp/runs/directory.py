"""Working directory of the thread in which LAMMPS runs; LAMMPS opens files relative to it.

The threads of a process share its working directory. Linux can give a thread its own, so other threads do not see that
of LAMMPS. Where the system refuses (macOS, some containers), the working directory of the process changes while LAMMPS
runs, and `absolute` resolves a relative folder as if it did not. Every function that makes or continues a run calls
`absolute` first.
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
_changing = threading.Lock()  # held while the directory of the process changes or is read
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
    """Give this thread its own working directory, the folder; return whether this succeeded."""
    if sys.platform != "linux" or ctypes.CDLL(None).unshare(_CLONE_FS) != 0:
        return False
    os.chdir(folder)
    return True
