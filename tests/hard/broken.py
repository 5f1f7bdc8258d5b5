"""A run of a deck in which one piece is broken, in a process of its own; `granular_lmp.studies.executors` runs it."""

import re
import resource
import signal
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path

from granular_lmp import Scene, build, run
from granular_lmp.errors import GranularError
from granular_lmp.lammps.deck import Deck
from granular_lmp.lammps.outputs import DUMP
from granular_lmp.runs.folder import locked
from granular_lmp.runs.record import read_status
from tests.conftest import run_input

MEMORY = 4 * 10**9  # bytes of addresses: a broken deck must not take the machine with it
LIMIT = 60  # s for a run of 10 ms: it hangs
FINISHED, OTHER = "finished", "finished with another record"


@cache
def deck(name: str) -> Deck:
    """The deck of a shipped scene in its smallest cell: 24 spheres, 40 steps."""
    changes = {"packing.rows": 8, "packing.ends": "periodic", "wave.wavenumber": 0.7853981633974483}
    return build(Scene.load(name).with_values(changes | {"time.duration": 2.0, "time.sample": 0.5}))


SAYS = ("if ", "print ")  # lines that refuse a wrong -var, or tell the log what was given: no run depends on them


def tokens(text: str) -> list[tuple[int, int]]:
    """Where the words of a deck's commands start and end; comments and lines that say something have none."""
    found, at = [], 0
    for line in text.splitlines(keepends=True):
        command = "" if line.startswith(SAYS) else line.partition("#")[0]
        found += [(at + word.start(), at + word.end()) for word in re.finditer(r"\S+", command)]
        at += len(line)
    return found


@cache
def whole_dump(name: str) -> bytes:
    """Return the record of the unbroken deck's run."""
    with tempfile.TemporaryDirectory() as folder:
        deck(name).write(folder, force=True)
        with locked(Path(folder)) as lock:
            run_input(Path(folder), deck(name).input_name, lock)
        return (Path(folder) / DUMP).read_bytes()


def outcome(name: str, start: int, end: int, new: str) -> str:
    """How the run of a deck ends in which the characters from `start` to `end` are others.

    Returns
    -------
    str
        The error; `FINISHED` when there was none and the record is the same to the last byte; `OTHER` when it is not.

    Raises
    ------
    AssertionError
        When ``run.json`` says something else.
    """
    signal.alarm(LIMIT)  # ends this process, which the caller hears of
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, resource.RLIM_INFINITY))
    whole = deck(name)
    expected = whole_dump(name)
    text = whole.input_text[:start] + new + whole.input_text[end:]
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        try:
            run(replace(whole, input_text=text), folder)
            said = FINISHED if (folder / DUMP).read_bytes() == expected else OTHER
        except GranularError as error:
            said = f"{type(error).__name__}: {error}"
        status = read_status(folder)["status"]
    signal.alarm(0)
    if status != (FINISHED if said in (FINISHED, OTHER) else "failed"):
        raise AssertionError(f"run.json says '{status}' of a run that ended by {said}")
    return said
