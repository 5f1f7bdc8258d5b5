"""A LAMMPS instance for tests that give it commands of their own."""

from collections.abc import Iterator
from contextlib import chdir, contextmanager
from pathlib import Path
from typing import Any

from granular_lmp.lammps.installation import lammps_module


@contextmanager
def silent_lammps() -> Iterator[Any]:
    """A LAMMPS instance that writes neither to the screen nor into a log, closed at the end."""
    instance = lammps_module().lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
    try:
        yield instance
    finally:
        instance.close()


def run_deck(folder: Path, deck: str, *variables: str) -> None:
    """Run a deck with -var as ``lmp`` does, in this process: the program takes a fifth of a second to start and end."""
    words = [word for variable in variables for word in ("-var", *variable.split("="))]
    with chdir(folder):
        instance = lammps_module().lammps(cmdargs=["-screen", "none", *words])
        try:
            instance.file(deck)
        finally:
            instance.close()
