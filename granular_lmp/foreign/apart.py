"""Read a deck of any origin in a process of its own, with bounds of time and memory, as a deck may crash the process.

This module is also the program of that process: ``python -m granular_lmp.foreign.apart REQUEST ANSWER``.
"""

import os
import pickle
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from granular_lmp.errors import DeckError
from granular_lmp.foreign.reading import Reading, read

SECONDS, MEMORY = 300, 16 * 2**30  # processor time, and bytes: a million spheres take 20 s and 4 GB
PATIENCE = 4  # the wall time may be this many times the processor time
AT = ".at"  # ending of the file that holds the command LAMMPS is executing


def read_apart(deck: str | Path, variables: Mapping[str, str] | None = None) -> Reading:
    """Read a deck as `granular_lmp.foreign.reading.read`, in another process.

    Raises
    ------
    DeckError
        As `read`, and if the process dies or takes too long; the message names the command that was executing.
    """
    with tempfile.TemporaryDirectory(prefix="granular-lmp-") as folder:
        request, answer = Path(folder, "request"), Path(folder, "answer")
        request.write_bytes(pickle.dumps((Path(deck).absolute(), dict(variables or {}))))
        command = [sys.executable, "-P", "-m", "granular_lmp.foreign.apart", str(request), str(answer)]
        code, said = _run(command)
        if not answer.exists():
            at = f"'{answer.with_suffix(AT).read_text()}'" if answer.with_suffix(AT).exists() else "the deck"
            if code in (None, -signal.SIGXCPU):
                raise DeckError(f"{deck}: LAMMPS did not finish {at} in {SECONDS} s")
            name = signal.strsignal(-code) if code < 0 else None
            raise DeckError(f"{deck}: LAMMPS died at {at}: {name or said or code}")
        found = pickle.loads(answer.read_bytes())
    if isinstance(found, Exception):
        raise found
    assert isinstance(found, Reading)
    return found


def _run(command: list[str]) -> tuple[int | None, str]:
    """Return the exit status of a command (None if it took too long) and the last line of its output."""
    try:
        done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=PATIENCE * SECONDS)
    except subprocess.TimeoutExpired:
        return None, ""
    return done.returncode, "".join((done.stdout + done.stderr).strip().splitlines()[-1:])


def _answer(request: Path, answer: Path) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, 2 * SECONDS))
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    deck, variables = pickle.loads(request.read_bytes())
    found: Any
    at = answer.with_suffix(AT)
    try:
        found = read(deck, variables, lambda command: at.write_text(f"{command.place}: {command}"))
    except Exception as error:  # the other process raises it
        found = error
    part = answer.with_suffix(".part")
    part.write_bytes(pickle.dumps(found))
    os.replace(part, answer)


if __name__ == "__main__":
    _answer(*map(Path, sys.argv[1:]))
