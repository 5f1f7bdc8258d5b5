"""Output of a command: results on standard output; notes, warnings and the progress bar on standard error."""

import json
import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from granular_lmp.errors import GranularError, OutputError
from granular_lmp.progress import ProgressBar


def say(line: str) -> None:
    """Write a line of the result."""
    try:
        print(line, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputError(f"standard output: cannot be written: {error.strerror}") from error


def say_json(answer: Any) -> None:
    """Write the result as JSON, for another program."""
    say(json.dumps(answer, indent=2, ensure_ascii=False, allow_nan=False))


def remark(line: str, end: str = "\n") -> None:
    """Write a line on standard error; drop it if it cannot be written, as this is no reason to stop."""
    with suppress(OSError):
        print(line, end=end, file=sys.stderr, flush=True)


@contextmanager
def notes_of_log() -> Iterator[None]:
    """Print the log messages of the package at level INFO, each sentence once."""
    import logging  # kept out of --help

    said = set[str]()

    class Notes(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            sentence = GranularError(record.getMessage()).in_options()
            if sentence not in said:
                said.add(sentence)
                remark(f"note: {sentence}")

    log, notes = logging.getLogger("granular_lmp"), Notes(logging.INFO)
    before = log.level
    log.addHandler(notes)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(notes)
        log.setLevel(before)


def say_profile(seconds: Mapping[str, float], total: float) -> None:
    """Write the wall time of each phase, in seconds and in order of their start, and the remaining time.

    Processor seconds include this process since its start and the programs that it ran.
    """
    rest = {"rest": total - sum(seconds.values()), "total": total}
    for name, spent in {**seconds, **rest}.items():
        remark(f"{name:13}{spent:9.4f} s")
    used = os.times()
    own, programs = used.user + used.system, used.children_user + used.children_system
    remark(f"processor    {own:9.4f} s, and {programs:.4f} s of programs")


@contextmanager
def interruptible() -> Iterator[ProgressBar | None]:
    """Let SIGTERM from a batch system interrupt like Ctrl-C; yield the progress display if there is a terminal."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    bar = ProgressBar() if sys.stderr.isatty() else None
    try:
        yield bar
    finally:
        signal.signal(signal.SIGTERM, before)
        if bar is not None:
            bar.close()


def progress_of_rest(stage: str, steps: int, force: float, _energy: float) -> None:
    """Show the progress of a relaxation, if there is a terminal."""
    if sys.stderr.isatty():
        remark(f"\r\033[Krelaxing the crystal: {stage}, step {steps}, largest force {force:.1e} k1 Delta0", end="")
