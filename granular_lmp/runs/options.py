"""Options of a run: launcher, number of ranks, and callback for progress."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from granular_lmp.errors import LaunchError
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.outputs import STATUS
from granular_lmp.runs.continuation import NETWORK, resuming
from granular_lmp.runs.engine import Engine
from granular_lmp.scene.schema import plain_value

Progress = Callable[[int, int], None]

LAUNCHERS = ("module", "lmp")


@dataclass(frozen=True)
class Options:
    """Options of a run: the arguments of `granular_lmp.run` except scene and folder.

    Raises
    ------
    LaunchError
        If the launcher is unknown, or there are more ranks than cores.
    """

    launcher: str = "module"
    ranks: int = 1
    force: bool = False
    progress: Progress | None = None
    kernel: bool | None = None
    engine: Engine | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "ranks", plain_value(self.ranks))
        if self.launcher not in LAUNCHERS:
            raise LaunchError(f"launcher = {self.launcher!r}: must be one of {', '.join(LAUNCHERS)}")
        if not isinstance(self.ranks, int) or not 1 <= self.ranks <= core_count():
            # Ranks wait for each other in busy loops, so 3 ranks on 2 cores took 70 times as long as 2 ranks
            raise LaunchError(f"ranks = {self.ranks!r}: must be from 1 to {core_count()}, the cores of this machine")

    @property
    def launched(self) -> str:
        """Launcher of the run, as ``run.json`` names it."""
        return NETWORK if self.engine else "lmp" if self.program else "module"

    @property
    def device(self) -> str | None:
        """Device of the engine, as ``run.json`` names it; None if LAMMPS takes the steps."""
        return self.engine.device if self.engine else None

    @property
    def program(self) -> bool:
        """True if the program ``lmp`` runs the deck instead of this process."""
        return self.launcher == "lmp" or self.ranks > 1


def options_of(folder: Path, info: dict[str, Any], engine: Engine | None = None) -> Options:
    """Return the options with which a run was started, from its ``run.json``.

    Raises
    ------
    LaunchError
        As for `Options`; also if the run was started by LAMMPS and an engine is given, or by another engine.
    """
    if (engine is not None) != (info["launcher"] == NETWORK):
        raise LaunchError(f"{folder}: was started otherwise; continue with: {resuming(folder, info['launcher'])}")
    if engine is not None:
        if info.get("device") != engine.device:
            raise LaunchError(
                f"{folder}: ran on {info.get('device')}, and can only continue there, not on {engine.device}"
            )
        return Options(engine=engine)
    try:
        return Options(info["launcher"], info["ranks"], kernel="kernel" in info)
    except LaunchError as error:
        raise LaunchError(f"{folder / STATUS}: {error}") from error


def core_count() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
