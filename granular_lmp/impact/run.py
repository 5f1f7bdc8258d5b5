"""The run of an impact in a folder: launch, guards, ``run.json``."""

import platform
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp import __version__
from granular_lmp.accuracy.halving import One, begun, continued, halved
from granular_lmp.accuracy.recorded import write_dump
from granular_lmp.errors import LammpsError, LaunchError
from granular_lmp.impact.deck import (
    GUARD_COLUMNS,
    ImpactDeck,
    checkpoint_steps,
    deck_of,
    look_steps,
    resume_text,
)
from granular_lmp.impact.problem import ImpactProblem, prepare
from granular_lmp.impact.record import ImpactRecord
from granular_lmp.impact.scene import ImpactScene
from granular_lmp.impact.tolerance import answer, estimate, order, plan
from granular_lmp.lammps.edits import differing_lines
from granular_lmp.lammps.outputs import (
    SCENE,
    SNAPSHOTS,
    RunLog,
    mend_dump,
    writable,
)
from granular_lmp.runs.agreement import scene_digest
from granular_lmp.runs.continuation import read_unfinished
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.folder import locked
from granular_lmp.runs.formats import FORMAT
from granular_lmp.runs.loop import begin, proceed
from granular_lmp.runs.options import Options, Progress, options_of
from granular_lmp.runs.phases import collected, phase
from granular_lmp.runs.record import write_status
from granular_lmp.runs.routes import Job, log_tail
from granular_lmp.runs.seal import files_of
from granular_lmp.scene.validation import LARGEST_OVERLAP_RATIO
from granular_lmp.step_rules import LONGEST_STEP

# Title of a guard → column of the thermo table, limit, what a larger value means, and what to do
LIMITS = {
    "largest_overlap": (
        "v_overlap",
        LARGEST_OVERLAP_RATIO,
        "of the diameter is the largest overlap, for which Hertz's law does not hold",
        "take a smaller striker.velocity or packing.contact_force",
    ),
    "step_in_contact": (
        "v_omega_dt",
        LONGEST_STEP,
        "is the time step times the frequency of the stiffest contact, which is too long for a collision",
        "take a shorter time.timestep, or a smaller time.tolerance",
    ),
}


@dataclass(frozen=True)
class ImpactRun:
    """The run of a deck of an `ImpactScene` (`granular_lmp.runs.loop.Simulation`).

    Attributes
    ----------
    deck : ImpactDeck
    edits : list of str
        Lines by which its text differs from the one that this package writes.
    """

    deck: ImpactDeck
    edits: list[str] = field(default_factory=list)

    @property
    def input_name(self) -> str:
        """File name of the input."""
        return self.deck.input_name

    @property
    def dump(self) -> str:
        """Name of the dump of the recorded spheres."""
        return SNAPSHOTS

    @property
    def steps(self) -> int:
        """Time steps of the run."""
        return self.deck.problem.scene.time.steps

    @property
    def columns(self) -> tuple[str, ...]:
        """No thermo columns: a stop leaves the last checkpoint."""
        return ()

    def files(self) -> dict[str, Iterable[str]]:
        """Return the files of the deck."""
        return self.deck.files()

    def description(self, launcher: str, ranks: int) -> dict[str, Any]:
        """Return the entries of ``run.json`` that are known before the run."""
        return description(self.deck.problem, launcher, ranks) | ({"edited": self.edits} if self.edits else {})

    def checkpoint_steps(self, ranks: int) -> int:
        """Return the steps between two checkpoints."""
        return checkpoint_steps(self.deck.problem, ranks)

    def resume_text(self, checkpoint: str) -> str:
        """Return the input that continues from a checkpoint."""
        return resume_text(self.deck.problem, checkpoint)

    def mend(self, folder: Path) -> None:
        """Cut the dump back to whole records."""
        mend_dump(folder / SNAPSHOTS)

    def collect(self, folder: Path, *, stopped: bool) -> ImpactRecord:
        """Return the record of a run, finished or not."""
        if not (folder / SNAPSHOTS).is_file():
            return ImpactRecord.empty(self.deck.problem, folder)
        if stopped:
            self.mend(folder)
        return ImpactRecord.from_dump(folder, self.deck.problem)

    def outcome(self, folder: Path, record: ImpactRecord, log: RunLog, info: Mapping[str, Any]) -> dict[str, Any]:
        """Return the guards and the number of records."""
        return {"guards": judged(self.deck.problem, log.table), "samples": len(record.tau)}

    def defect(self, record: ImpactRecord, log: RunLog, job: Job, info: Mapping[str, Any]) -> LammpsError | None:
        """Return an error if the record or the log is incomplete although LAMMPS reported success, else None."""
        time, table = self.deck.problem.scene.time, log.table
        if len(record.tau) != time.samples + 1:
            return LammpsError(f"{len(record.tau)} records instead of {time.samples + 1}", job.input_name, "")
        if not all(np.isfinite(x).all() for x in (record.displacement, record.velocity, record.spin)):
            return LammpsError("the record holds numbers that are not finite", job.input_name, "")
        missed = {*range(0, time.steps + 1, look_steps(self.deck.problem))} - {*map(int, table.get("Step", ()))}
        if missed or not {*GUARD_COLUMNS} <= set(table):
            what = f"step {min(missed)}" if missed else "the guards"
            return LammpsError(f"the log lacks {what}", job.input_name, log_tail(job.folder))
        return None

    def triggered(self, info: dict[str, Any]) -> list[str]:
        """Return a sentence for each guard that is not quiet."""
        return [
            f"{title} = {'not finite' if each['value'] is None else format(each['value'], '.4g')}, above "
            f"{each['limit']:g}: {each['meaning']}; {each['cure']}"
            for title, each in info["guards"].items()
            if not each["quiet"]
        ]

    def judged(self, record: ImpactRecord) -> dict[str, Any]:
        """Return nothing: an impact has no read-outs."""
        return {}


def run_impact(what: ImpactScene | ImpactDeck, folder: str | Path, options: Options | None = None) -> ImpactRecord:
    """Run an impact in `folder`, which is created, and return its record.

    The folder holds ``scene.toml``, ``in.NAME``, ``data.NAME``, ``dump.particles``, ``log.lammps`` and ``run.json``;
    ``checkpoint.*`` while a long run lasts and after it is stopped, from which `resume_impact` continues. With
    ``time.tolerance`` it holds such a folder for each step, ``N_per_sample``, and the extrapolated ``dump.particles``;
    ``info["error_estimate"]`` of the record then holds the largest errors of velocities and spins over the velocity of
    the fastest striker (`granular_lmp.impact.tolerance`).

    Raises
    ------
    SceneError
        As `granular_lmp.impact.problem.prepare`.
    RunFolderError
        If the folder exists (without ``options.force``) or cannot be written.
    EffectError
        If a guard triggered; the folder is kept.
    ToleranceError
        If the shortest of eight steps misses the tolerance, or the runs do not converge.
    LammpsMissingError, LammpsError, LaunchError, RunInterrupted
        As in `granular_lmp.run`.

    Notes
    -----
    *Good values*: ``time.tolerance`` from 1e-2 to 1e-5, or a step of 1/70 of the collision time, which leaves errors of
    1e-3 after 12 of them.
    """
    folder, options = absolute(folder), options or Options()
    if options.kernel:
        raise LaunchError("kernel=True: impacts run without it")
    if isinstance(what, ImpactScene) and what.time.tolerance is not None:
        return _to_tolerance(what, folder, options)
    with collected() as seconds:
        with phase("build"):
            deck = what if isinstance(what, ImpactDeck) else deck_of(prepare(what))
            edits = differing_lines(deck_of(deck.problem).input_text, deck.input_text) if deck is what else []
        return begin(ImpactRun(deck, edits), folder, options, seconds)


def resume_impact(folder: str | Path, *, progress: Progress | None = None) -> ImpactRecord:
    """Continue a stopped or killed impact from its last checkpoint, on the same route and ranks.

    The record has the same bytes as that of an uninterrupted run, in every scene: also with friction, whose shear of
    contacts is in the checkpoint, and with damping. What came after the last checkpoint is computed again.

    Raises
    ------
    RunFolderError
        If the run is finished, its deck or scene was changed, or it was stopped before its first checkpoint.
    EffectError, LammpsMissingError, LammpsError, RunInterrupted
        As `run_impact`.
    """
    folder = absolute(folder)
    started = read_unfinished(folder)
    scene = ImpactScene.load(folder / SCENE)
    if scene.time.tolerance is not None:
        return _resumed(scene, folder, started, progress)
    return proceed(lambda place: ImpactRun(deck_of(prepare(scene))), folder, progress)


def _to_tolerance(scene: ImpactScene, folder: Path, options: Options) -> ImpactRecord:
    problem = prepare(scene)
    plan(problem)  # raises before anything is written
    with begun(scene, folder, options) as info:
        return _refined(problem, folder, _one(options), options.progress, info)


def _resumed(scene: ImpactScene, folder: Path, info: dict[str, Any], progress: Progress | None) -> ImpactRecord:
    """Continue the runs of an impact with a tolerance."""
    one = continued(
        _one(options_of(folder, info)),
        lambda place, part: resume_impact(place, progress=part),
        ImpactRecord.load,
    )
    with locked(folder):
        return _refined(prepare(scene), folder, one, progress, info)


def _one(options: Options) -> One[ImpactScene, ImpactRecord]:
    """Return what makes a run with a step; forced, because its folder may exist and hold files of the user."""
    return lambda scene, place, part: run_impact(scene, place, replace(options, force=True, progress=part))


def _refined(
    problem: ImpactProblem,
    folder: Path,
    one: One[ImpactScene, ImpactRecord],
    progress: Progress | None,
    info: dict[str, Any],
) -> ImpactRecord:
    """Run with smaller and smaller steps to the tolerance; write the dump of the answer and ``run.json`` of all."""
    records, judgement, refinements = halved(problem.scene, folder, plan(problem), one, estimate, progress, info)
    runs = [each.info for each in records]
    folders = [each.folder / SNAPSHOTS for each in records if each.folder is not None]
    outcome = (
        records[-1].info
        | info
        | {
            "error_estimate": judgement.errors,
            "order": order(problem.scene),
            "extrapolated_from": [
                each.scene.time.step for each, weight in zip(records, judgement.weights, strict=True) if weight
            ],
            "refinements": refinements,
            "steps": sum(each["steps"] for each in runs),
            "wall_seconds": {
                name: sum(each["wall_seconds"][name] or 0.0 for each in runs) for name in ("total", "loop")
            },
            "status": "finished",
            "message": "",
        }
    )
    with writable(folder):
        write_dump(folder / SNAPSHOTS, folders, judgement.weights)
        outcome["files"] = files_of(folder)
        write_status(folder, outcome)
    return replace(answer(records), problem=problem, info=outcome, folder=folder)


def description(problem: ImpactProblem, launcher: str, ranks: int) -> dict[str, Any]:
    """Return the entries of ``run.json`` that are known before the run."""
    scene = problem.scene
    return {
        "format": FORMAT,
        "name": scene.name,
        "scene_sha256": scene_digest(scene.to_toml()),
        "versions": {"granular_lmp": __version__, "python": platform.python_version(), "numpy": np.__version__},
        "launcher": launcher,
        "ranks": ranks,
        "particles": len(problem.crystal),
        "recorded": len(problem.recorded),
        "steps": scene.time.steps,
        "timestep_used": scene.time.step,
        "velocity_m_s": scene.scale.velocity,
        "length_m": scene.scale.length,
        "t0_s": scene.scale.time,
        "mass_kg": scene.scale.mass,
        "shortest_collision": problem.shortest_collision,
        "at_rest": problem.at_rest,
        "effects": {
            each.name: {"on": each.on, "called_for": each.called_for, "reason": each.finding, "guard": each.guard}
            for each in problem.effects
        },
    }


def judged(problem: ImpactProblem, table: dict[str, Any]) -> dict[str, Any]:
    """Return the result of each guard; what is not finite, or not there, is not quiet."""
    effects = {effect.guard: effect.name for effect in problem.effects if effect.guard}
    found = {}
    for title, (column, limit, meaning, cure) in LIMITS.items():
        values = np.asarray(table.get(column, [np.nan]), dtype=float)
        largest = float(np.max(values, initial=0.0))
        found[title] = {
            "effect": effects[title],
            "value": largest if np.isfinite(largest) else None,
            "limit": limit,
            "quiet": bool(largest <= limit),
            "judges": True,
            "meaning": meaning,
            "cure": cure,
        }
    return found
