"""The errors of the package, one base class; the exit status that the command line gives to each."""


class GranularError(Exception):
    """Base of every error that the package raises on purpose; its text is one line that a user can act on."""

    exit_status = 1

    def __str__(self) -> str:
        # A key or a folder may hold a line break, an escape sequence of the terminal, or what UTF-8 cannot write
        return "".join(c if c.isprintable() else repr(c)[1:-1] for c in super().__str__())


    def in_options(self) -> str:
        """Return the text for the command line, whose options have other names than the arguments in Python."""
        return str(self).replace("force=True", "--force")


class SceneError(GranularError):
    """A scene says something that cannot be simulated; the text names the key, the value and what is allowed."""

    exit_status = 2


class DeckError(GranularError):
    """A deck is to be edited at a place that it does not have."""

    exit_status = 2


class CrystalError(GranularError):
    """A crystal cannot be at rest as it is: it would buckle or fall apart."""

    exit_status = 2


class RunFolderError(GranularError):
    """A run folder is missing, already there, not writable, or does not hold what a run folder holds."""

    exit_status = 2


class ViewError(GranularError):
    """A picture is asked for that the run or sweep does not hold, or that cannot be drawn on this machine."""

    exit_status = 2


class PackageMissingError(GranularError):
    """A Python package that only a few functions need is not installed."""

    exit_status = 2


class LaunchError(GranularError):
    """A run is asked for by a way, or on a number of ranks, that this machine does not have."""

    exit_status = 2


class LammpsMissingError(GranularError):
    """LAMMPS, its MPI library or one of the packages that a deck needs was not found on this machine."""

    exit_status = 2


class LammpsError(GranularError):
    """LAMMPS stopped with an error.

    Attributes
    ----------
    command : str
        The input line that failed, or the whole command line when LAMMPS ran as a program.
    log_tail : str
        The last lines of ``log.lammps``.
    """

    def __init__(self, message: str, command: str, log_tail: str):
        super().__init__(f"LAMMPS failed at '{command}': {message}")
        self.command = command
        self.log_tail = log_tail


class OutputError(GranularError):
    """What a command answers cannot be written: a full disk, say, behind a redirected standard output."""


class WorkerError(GranularError):
    """The process that a run was in has died: killed for want of memory, or by a fault inside LAMMPS."""


class ToleranceError(GranularError):
    """The runs of a scene with a tolerance do not meet it; the text says what they reached."""


class RunInterrupted(GranularError):
    """The user stopped a run; its folder says so and what was recorded until then is kept."""

    exit_status = 130  # what a shell reports for Ctrl-C


class EffectError(GranularError):
    """An effect that a scene leaves out was there after all; what was recorded is kept and marked as failed."""
