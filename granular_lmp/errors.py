"""Errors of the package: one base class, and the exit status of the command line for each."""

from typing import Literal

__all__ = [
    "CrystalError",
    "DeckError",
    "EffectError",
    "GranularError",
    "LammpsError",
    "LammpsMissingError",
    "LaunchError",
    "OutputError",
    "PackageMissingError",
    "ReadoutError",
    "RunFolderError",
    "RunInterrupted",
    "SceneError",
    "ToleranceError",
    "ViewError",
    "WorkerError",
]

# Why parts of a scene cannot be combined; "exclusive" if two keys declare the same
Because = Literal["physics", "not built", "exclusive"]
# Name of an argument in messages → option of the command line
_OPTIONS = {
    "force=True": "--force",
    "scene=SCENE": "--scene SCENE",
    "kernel=True": "--kernel",
    "kernel=False": "--no-kernel",
    "launcher='lmp'": "--lmp",
    "ranks=": "--np ",
    "changes={KEY: VALUE}": "--set KEY=VALUE",
    "units=STYLE": "--units STYLE",
    "timestep=VALUE": "--timestep VALUE",
    "radius=VALUE": "--radius VALUE",
    "density=VALUE": "--density VALUE",
    "columns=WORDS": "--columns WORDS",
    "origin=ID": "--origin ID",
}


class GranularError(Exception):
    """Base class of the errors of this package; the text is one line that tells a user what to do."""

    exit_status = 1

    def __str__(self) -> str:
        # A key or a folder may contain a line break, an escape sequence of the terminal, or surrogates, which UTF-8
        # lacks
        return "".join(c if c.isprintable() else repr(c)[1:-1] for c in super().__str__())

    def in_options(self) -> str:
        """Return the text for the command line, where options replace the names of Python arguments."""
        text = str(self)
        for argument, option in _OPTIONS.items():
            text = text.replace(argument, option)
        return text


class SceneError(GranularError):
    """A scene cannot be simulated; the text names the key, the value and what is allowed.

    `because` says why allowed values cannot be combined; None if a single value is wrong.
    """

    exit_status = 2

    def __init__(self, *said: object, because: Because | None = None) -> None:
        super().__init__(*said)
        self.because = because


class DeckError(GranularError):
    """An edit names a place that the deck does not have, or a foreign deck cannot be read."""

    exit_status = 2


class CrystalError(GranularError):
    """A crystal is not at a stable equilibrium: it would buckle or fall apart."""

    exit_status = 2


class RunFolderError(GranularError):
    """A run folder is missing, exists already, cannot be written, or its contents are not those of a run."""

    exit_status = 2


class ViewError(GranularError):
    """A picture needs data that the run or sweep lacks, or a program that this machine lacks."""

    exit_status = 2


class ReadoutError(GranularError):
    """A monitor of a run does not give a value; the text says why."""


class PackageMissingError(GranularError):
    """A Python package that only a few functions need is not installed."""

    exit_status = 2


class LaunchError(GranularError):
    """A launcher or a number of ranks is not available on this machine."""

    exit_status = 2


class LammpsMissingError(GranularError):
    """LAMMPS, its MPI library or a package that a deck needs is missing on this machine."""

    exit_status = 2


class LammpsError(GranularError):
    """LAMMPS stopped with an error.

    Attributes
    ----------
    command : str
        Input line that failed, or the whole command line if LAMMPS ran as a program.
    log_tail : str
        Last lines of ``log.lammps``.
    """

    def __init__(self, message: str, command: str, log_tail: str):
        super().__init__(f"LAMMPS failed at '{command}': {message}")
        self.command = command
        self.log_tail = log_tail


class OutputError(GranularError):
    """The output of a command cannot be written, for instance because the disk is full."""


class WorkerError(GranularError):
    """The process of a run died, for lack of memory or by a fault inside LAMMPS."""


class ToleranceError(GranularError):
    """The runs of a scene do not meet its tolerance; the text names the error that they reached."""


class RunInterrupted(GranularError):
    """The user stopped a run; the record so far is kept in its folder."""

    exit_status = 130  # exit status that a shell reports for Ctrl-C


class EffectError(GranularError):
    """An effect that a deck leaves out occurred in the run; the record is kept and marked as failed."""


def one_line(error: Exception) -> str:
    """Return the text of an error without line breaks; a system error without its number and the name of the file."""
    system = isinstance(error, OSError) and error.strerror
    return " ".join((system or str(error)).split())
