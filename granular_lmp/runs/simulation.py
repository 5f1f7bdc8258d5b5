"""Run of a deck: the files before LAMMPS starts, and how its output is read and judged afterwards.

`granular_lmp.runs.loop` defines the order.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp.errors import LammpsError, RunFolderError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.lammps.binary_dump import mend_binary
from granular_lmp.lammps.checkpoints import checkpoint_steps
from granular_lmp.lammps.deck import Deck, resume_text
from granular_lmp.lammps.guards import has_looks
from granular_lmp.lammps.kernel_guards import watched_text
from granular_lmp.lammps.monitors import is_whole, monitor_files
from granular_lmp.lammps.outputs import DUMP, SCENE, SNAPSHOTS, RunLog, mend_dump
from granular_lmp.problem import Problem
from granular_lmp.rest.scene import Scene
from granular_lmp.runs import manifest
from granular_lmp.runs.readouts import readouts_of
from granular_lmp.runs.record import TRAJECTORY, Record
from granular_lmp.runs.routes import Job, log_tail

Judge = Callable[[Problem, Record], dict[str, Any]]


def nothing_more(_problem: Problem, _record: Record) -> dict[str, Any]:
    """Return no further entries of ``run.json``."""
    return {}


@dataclass(frozen=True)
class Simulation:
    """Run of a deck.

    Attributes
    ----------
    deck : Deck
    edits : list of str
        Lines that differ from the deck of this package.
    judge : callable
        Function that returns further entries of ``run.json`` from the problem and the record of a run that did not
        fail.
    kernel : bool
        True if the kernel computes the contacts; it then also checks them for the guards.
    """

    deck: Deck
    edits: list[str] = field(default_factory=list)
    judge: Judge = nothing_more
    kernel: bool = False

    @property
    def scene(self) -> Scene:
        """Scene with every "auto" decided."""
        return self.deck.problem.scene

    @property
    def input_name(self) -> str:
        """File name of the deck."""
        return self.deck.input_name

    @property
    def begun_name(self) -> str:
        """File name of the input that LAMMPS reads first: the deck, or the deck with the guards of the kernel."""
        return self.input_name if self._watched == self.deck.input_text else f"{self.input_name}.kernel"

    @cached_property
    def _watched(self) -> str:
        return self._with_guards(self.deck.input_text)

    def _with_guards(self, text: str, checkpoint: str = "") -> str:
        return watched_text(self.deck.problem, text, checkpoint) if self.kernel else text

    @property
    def dump(self) -> str:
        """Name of the dump that every run must have."""
        return SNAPSHOTS if self.scene.wave is None else DUMP

    @property
    def steps(self) -> int:
        """Time steps of the run."""
        return self.scene.time.steps

    @property
    def looks(self) -> str:
        """Place of the looks of the guards, for `Job`: the table, the kernel, or "" for spheres that meet."""
        if not has_looks(self.deck.problem):
            return ""
        if not self.deck.problem.looks:
            return "none"
        return "table" if self.begun_name == self.input_name else "kernel"

    def files(self) -> dict[str, Iterable[str]]:
        """Return name → text, in pieces, of the files of the run folder; its scene has every "auto" decided."""
        return {**self.deck.files(), self.begun_name: [self._watched], SCENE: [self.scene.to_toml()]}

    def description(self, launcher: str, ranks: int) -> dict[str, Any]:
        """Return the entries of ``run.json`` that are known before the run."""
        found = manifest.description(self.deck.problem, self.edits, launcher, ranks)
        if self.begun_name != self.input_name:  # the kernel checks every step
            found["looks"] |= {"every_tau": self.scene.time.step}
        return found

    def checkpoint_steps(self, ranks: int) -> int:
        """Return the steps between two checkpoints."""
        return checkpoint_steps(self.deck.problem, ranks)

    def resume_text(self, checkpoint: str) -> str:
        """Return the input that continues from a checkpoint."""
        return self._with_guards(resume_text(self.deck.problem, checkpoint), checkpoint)

    def mend(self, folder: Path) -> None:
        """Cut the dumps of a stopped run back to complete records."""
        mend(folder, self.deck.problem)

    def collect(self, folder: Path, *, stopped: bool) -> Record:
        """Return the record of a run, finished or not, and write ``trajectory.csv`` for a centre sphere.

        Dumps are repaired only if the run was stopped or continued, or lost a sphere, because the check takes longer
        than reading.
        """
        if not (folder / self.dump).exists():
            return Record.empty(self.deck.problem, folder)
        try:
            record = None if stopped else Record.from_dump(folder, self.scene)
        except RunFolderError:
            record = None
        try:
            if record is None:
                self.mend(folder)
                record = Record.from_dump(folder, self.scene)
        except RunFolderError as error:
            raise LammpsError(str(error), self.input_name, log_tail(folder)) from error
        if self.scene.wave is not None:
            record.write_csv(folder / TRAJECTORY)
        return record

    def outcome(self, folder: Path, record: Record, log: RunLog, info: Mapping[str, Any]) -> dict[str, Any]:
        """Return the entries of ``run.json`` after the run, including its guards."""
        return manifest.outcome(folder, self.deck.problem, len(record.tau), log.table, dict(info))

    def defect(self, record: Record, log: RunLog, job: Job, info: Mapping[str, Any]) -> LammpsError | None:
        """Return an error if the record or the log is incomplete or wrong although LAMMPS reported success, else None.

        LAMMPS does not notice a failed write to its log, and a guard without a value is not below its limit.
        """
        expected = self.scene.time.samples + 1
        found = _not_finite(record, tracked=self.deck.problem.on.get("tracking", False))
        found = found or _fewer(record, expected) or self._monitors_lack(job.folder, expected)
        found = found or manifest.lacking(self.deck.problem, log, info)
        return LammpsError(found, job.input_name, log_tail(job.folder)) if found else None

    def _monitors_lack(self, folder: Path, expected: int) -> str:
        """Return the name of a file of a monitor that lacks records; "" if there is none."""
        names = monitor_files(self.deck.problem)
        missing = (name for name in names if not is_whole(folder / name, expected, self.steps))
        return next((f"{name} lacks records" for name in missing), "")

    def judged(self, record: Record) -> dict[str, Any]:
        """Return the entries of ``run.json`` for a run that did not fail: readouts of its record."""
        return readouts_of(record) | self.judge(self.deck.problem, record)


def _not_finite(record: Record, *, tracked: bool) -> str:
    """Return words if the record holds numbers that are not finite, else ""; a rotation may be untracked."""
    known = [values for name, values in record.signals.items() if tracked or not name.startswith("phi")]
    finite = all(np.isfinite(values).all() for values in known)
    return "" if finite else "the record holds numbers that are not finite"


def _fewer(record: Record, expected: int) -> str:
    return "" if len(record.tau) == expected else f"{len(record.tau)} records instead of {expected}"


def mend(folder: Path, problem: Problem) -> None:
    """Repair the dumps in the run folder of a problem: `mend_dump`, `mend_binary`."""
    for path in filter(Path.is_file, map(folder.joinpath, (DUMP, SNAPSHOTS, *monitor_files(problem)))):
        (mend_binary if path.suffix == ".bin" else mend_dump)(path)
