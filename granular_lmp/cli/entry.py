"""Begin and end of a command: its standard streams, its errors in one line, its exit status.

`ended` is also the entry of granular-analysis.
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
    from granular_lmp.cli.parser import (
        parsers,
    )  # imported inside the entry, so that an interrupted import gives one line too

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
    """Run the command of this process, as `ended` does, without garbage collection, which a short process can omit."""
    gc.set_threshold(100_000)  # repeated searches for cycles among all imported objects take 5 % of a short command
    status = ended(name, command)
    gc.freeze()  # at exit the interpreter would search numpy for cycles: 7 % of a short command
    return status


def ended(name: str, command: Callable[[], int | None]) -> int:
    """Run a command of a program and return its exit status; an error is one line after the program's name.

    A SystemExit with a text is bad input, like a `GranularError`; any other, such as that of argparse, is passed on.
    """
    _open_streams()
    # Before numpy is imported: matrices are small here, and threads would take a quarter of the processor time
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ["MPLBACKEND"] = (
        "agg"  # pictures go to files; an unknown backend would make the import of matplotlib fail
    )
    os.environ["MATPLOTLIBRC"] = STYLE  # a figure is the same for every user, whose own settings may need LaTeX
    try:
        status = command() or 0
        sys.stdout.flush()  # printed text may still be in a buffer while the disk is full
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
    except BrokenPipeError:  # the reader of the output, such as `head`, has ended
        return 0
    except OSError as error:  # the system refuses: no permission for a folder, or no descriptors left
        remark(f"{name}: error: {error.filename or 'this machine'}: {error.strerror or error}")
        return 2 if error.filename else 1
    except MemoryError as error:
        remark(f"{name}: error: out of memory: {error}")
        return 1
    finally:
        _drop_unwritten()


def _open_streams() -> None:
    """Open /dev/null in place of a closed stream; otherwise the next file opened would take its descriptor."""
    descriptor = os.open(os.devnull, os.O_RDWR)
    while descriptor <= _STDERR:
        os.set_inheritable(descriptor, True)
        descriptor = os.dup(descriptor)
    os.close(descriptor)
    sys.stdout = sys.stdout or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (as long as the process)
    sys.stderr = sys.stderr or open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a folder's name may not be printable


def _drop_unwritten() -> None:
    """Flush the streams, or drop their text if it cannot be written, so that the interpreter exits without error."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _refuse_deleted_folder() -> None:
    try:
        os.getcwd()
    except FileNotFoundError as error:
        raise RunFolderError("the working directory was deleted; change to one that exists") from error
