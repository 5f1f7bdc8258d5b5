"""A deck of any origin, read in a process of its own with bounds of time and memory, which the deck may bring down.

As a program, ``python -m granular_lmp.foreign.apart REQUEST ANSWER``, this module is that process.
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

SECONDS, MEMORY = 300, 16 * 2**30  # of processor time, and bytes: a million spheres take 20 s and 4 GB


def read_apart(deck: str | Path, variables: Mapping[str, str] | None = None) -> Reading:
    """Read a deck as `granular_lmp.foreign.reading.read`, in another process.

    Raises
    ------
    DeckError
        As `read`, and if the process dies.
    """
    with tempfile.TemporaryDirectory(prefix="granular-lmp-") as folder:
        request, answer = Path(folder, "request"), Path(folder, "answer")
        request.write_bytes(pickle.dumps((Path(deck).absolute(), dict(variables or {}))))
        command = [sys.executable, "-P", "-m", "granular_lmp.foreign.apart", str(request), str(answer)]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        if not answer.exists():
            if done.returncode == -signal.SIGXCPU:
                raise DeckError(f"{deck}: LAMMPS did not come to the end of the deck in {SECONDS} s")
            last = (done.stdout + done.stderr).strip().splitlines()[-1:]
            raise DeckError(f"{deck}: LAMMPS died while it read the deck: {''.join(last) or done.returncode}")
        found = pickle.loads(answer.read_bytes())
    if isinstance(found, Exception):
        raise found
    assert isinstance(found, Reading)
    return found


def _answer(request: Path, answer: Path) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    deck, variables = pickle.loads(request.read_bytes())
    found: Any
    try:
        found = read(deck, variables)
    except Exception as error:  # the other process raises it
        found = error
    part = answer.with_suffix(".part")
    part.write_bytes(pickle.dumps(found))
    os.replace(part, answer)


if __name__ == "__main__":
    _answer(*map(Path, sys.argv[1:]))
