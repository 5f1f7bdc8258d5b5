"""The errors of the package: one base class, and the exit status of the command line for each."""

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

# Why parts of a scene do not go together: "exclusive" if two keys say one thing
Because = Literal["physics", "not built", "exclusive"]
# Arguments as messages name them → the options of the command line
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
    """Base class of the errors of this package; the text is one line that a user can act on."""

    exit_status = 1

    def __str__(self) -> str:
        # A key or a folder may hold a line break, an escape sequence of the terminal, or surrogates, which UTF-8 lacks
        return "".join(c if c.isprintable() else repr(c)[1:-1] for c in super().__str__())

    def in_options(self) -> str:
        """Return the text for the command line, whose options have other names than the arguments in Python."""
        text = str(self)
        for argument, option in _OPTIONS.items():
            text = text.replace(argument, option)
        return text


class SceneError(GranularError):
    """A scene cannot be simulated; the text names the key, the value and what is allowed.

    `because` says why values that are each allowed do not go together; None if a value by itself is wrong.
    """

    exit_status = 2

    def __init__(self, *said: object, because: Because | None = None) -> None:
        super().__init__(*said)
        self.because = because


class DeckError(GranularError):
    """A deck is to be edited at a place that it does not have, or one of somebody else cannot be read."""

    exit_status = 2


class CrystalError(GranularError):
    """A crystal is not at a stable equilibrium: it would buckle or fall apart."""

    exit_status = 2


class RunFolderError(GranularError):
    """A run folder is missing, exists already, cannot be written, or its contents are not those of a run."""

    exit_status = 2


class ViewError(GranularError):
    """A picture needs data that the run or sweep does not hold, or a program that this machine does not have."""

    exit_status = 2


class ReadoutError(GranularError):
    """Nothing can be read off a monitor of a run; the text says why."""


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
    """The process of a run has died, for want of memory or by a fault inside LAMMPS."""


class ToleranceError(GranularError):
    """The runs of a scene do not meet its tolerance; the text names the error that they reached."""


class RunInterrupted(GranularError):
    """The user stopped a run; the record so far is kept in its folder."""

    exit_status = 130  # the exit status that a shell reports for Ctrl-C


class EffectError(GranularError):
    """An effect that a deck leaves out occurred in the run; the record is kept and marked as failed."""


def one_line(error: Exception) -> str:
    """Return the text of an error without line breaks; that of the system without its number and the file's name."""
    system = isinstance(error, OSError) and error.strerror
    return " ".join((system or str(error)).split())
