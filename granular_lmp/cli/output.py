"""Output of a command: its answer on standard output; notes, warnings and the progress bar on standard error."""

import json
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

from granular_lmp.errors import OutputError

_BAR = 30  # characters of the progress bar


def say(line: str) -> None:
    """Write a line of the answer."""
    try:
        print(line, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise OutputError(f"standard output: cannot be written: {error.strerror}") from error


def say_json(answer: Any) -> None:
    """Write the answer as JSON, for another program."""
    say(json.dumps(answer, indent=2, ensure_ascii=False, allow_nan=False))


def remark(line: str, end: str = "\n") -> None:
    """Write a line beside the answer; it is dropped where it cannot be written, for it is no reason to stop."""
    with suppress(OSError):
        print(line, end=end, file=sys.stderr, flush=True)


def say_profile(seconds: Mapping[str, float], total: float) -> None:
    """Write the wall seconds of each phase beside the answer, in the order in which they began, and what is left.

    The processor seconds are those of this process since the system started it, and of programs that it ran.
    """
    rest = {"rest": total - sum(seconds.values()), "total": total}
    for name, spent in {**seconds, **rest}.items():
        remark(f"{name:13}{spent:9.4f} s")
    used = os.times()
    own, programs = used.user + used.system, used.children_user + used.children_system
    remark(f"processor    {own:9.4f} s, and {programs:.4f} s of programs")


@contextmanager
def interruptible() -> Iterator[Callable[[int, int], None] | None]:
    """Let a batch system's SIGTERM interrupt like Ctrl-C; gives the progress display, if there is a terminal."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    terminal = sys.stderr.isatty()
    try:
        yield progress_of_steps if terminal else None
    finally:
        signal.signal(signal.SIGTERM, before)
        if terminal:
            remark("\r\033[K", end="")  # wipe the bar


def progress_of_steps(done: int, total: int) -> None:
    """Draw the bar of a run."""
    _draw(done, total, f"step {done} of {total}")


def progress_of_rest(stage: str, steps: int, force: float, energy: float) -> None:
    """Say how far a crystal is from rest, where there is a terminal."""
    if sys.stderr.isatty():
        remark(f"\r\033[Kthe crystal comes to rest: {stage}, step {steps}, largest force {force:.1e} k1 Delta0", end="")


def progress_of_runs(done: int, total: int, left: float) -> None:
    """Draw the bar of a study, `left` seconds before its end."""
    _draw(done, total, f"run {done} of {total}, {left:.0f} s left")


def _draw(done: int, total: int, words: str) -> None:
    """Draw the bar again on the same line of the terminal."""
    filled = _BAR * done // max(total, 1)
    remark(f"\r\033[K{'#' * filled + '.' * (_BAR - filled)} {words}", end="")
