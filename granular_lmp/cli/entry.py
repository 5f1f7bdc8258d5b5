"""How a command begins and ends: its standard streams, its errors in one line, its exit status.

`ended` is the entry of granular-analysis, too.
"""

import argparse
import gc
import io
import os
import signal
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from granular_lmp.cli.output import notes_of_log, remark, say_profile
from granular_lmp.errors import GranularError, RunFolderError
from granular_lmp.runs.phases import collected

STYLE = str(Path(__file__).parents[1] / "plot" / "matplotlibrc")
_STDERR = 2  # its descriptor


def program() -> int:
    """Run the command of this process; returns its exit status."""
    return as_program("granular-lmp", _command)


def main(argv: list[str] | None = None) -> int:
    """Run one command; returns the exit status: 0, 1 for a failed run, 2 for bad input, 130 when interrupted."""
    return ended("granular-lmp", partial(_command, argv))


def _command(argv: list[str] | None = None) -> int:
    from granular_lmp.cli.parser import parsers  # inside the entry: an interrupted import is one line, too

    started = time.perf_counter()
    words = sys.argv[1:] if argv is None else argv
    options = parsers(words)[0].parse_args(words)
    _refuse_deleted_folder()
    command: Callable[[argparse.Namespace], int] = options.command
    with collected() as seconds, notes_of_log():
        try:
            return command(options)
        finally:
            if options.profile:
                say_profile(seconds, time.perf_counter() - started)


def as_program(name: str, command: Callable[[], int | None]) -> int:
    """Run the command of this process, as `ended`, without the searches for garbage that a short process can spare."""
    gc.set_threshold(100_000)  # to search all that is imported for circles, again and again, is 5 % of a short command
    status = ended(name, command)
    gc.freeze()  # the interpreter would search numpy for circles before it ends: 7 % of a short command
    return status


def ended(name: str, command: Callable[[], int | None]) -> int:
    """Run a command of a program; returns its exit status. Its error is one line that begins with the program's name.

    A SystemExit with a text is bad input, as `GranularError` says it; another, that of argparse, is passed on.
    """
    _open_streams()
    # Before numpy is imported: its matrices are small here, and threads would take a quarter of the processor time
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ["MPLBACKEND"] = "agg"  # pictures go to files; matplotlib is not imported where it knows not the backend
    os.environ["MATPLOTLIBRC"] = STYLE  # a figure is the same for every user, whose own settings may need LaTeX
    try:
        status = command() or 0
        sys.stdout.flush()  # what a script printed may stand in a buffer, and the disk be full
        return status
    except GranularError as error:
        remark(f"{name}: error: {error.in_options()}")
        return error.exit_status
    except SystemExit as refusal:
        if not isinstance(refusal.code, str):
            raise
        remark(f"{name}: error: {refusal.code}")
        return 2
    except KeyboardInterrupt:
        remark(f"{name}: interrupted")
        return 128 + signal.SIGINT
    except BrokenPipeError:  # the reader of our output, `head` say, has gone
        return 0
    except OSError as error:  # the machine refuses: a folder that nobody may look into, no descriptors left
        remark(f"{name}: error: {error.filename or 'this machine'}: {error.strerror or error}")
        return 2 if error.filename else 1
    except MemoryError as error:
        remark(f"{name}: error: out of memory: {error}")
        return 1
    finally:
        _drop_unwritten()


def _open_streams() -> None:
    """Send what is said on a closed stream to nowhere; else the next file that is opened would take its place."""
    descriptor = os.open(os.devnull, os.O_RDWR)
    while descriptor <= _STDERR:
        os.set_inheritable(descriptor, True)
        descriptor = os.dup(descriptor)
    os.close(descriptor)
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (as long as the process)
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a folder's name may hold what the terminal cannot show


def _drop_unwritten() -> None:
    """Flush what is said, or drop it where it cannot be written, so that the interpreter does not complain at exit."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _refuse_deleted_folder() -> None:
    try:
        os.getcwd()
    except FileNotFoundError as error:
        raise RunFolderError("the working directory was deleted; change to one that is there") from error
