"""A LAMMPS instance for tests that give it commands of their own."""

from collections.abc import Iterator
from contextlib import contextmanager
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
