"""The run of an impact in a folder: launch, guards, ``run.json``."""

import platform
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from granular_lmp import __version__
from granular_lmp.errors import EffectError, LammpsError, RunInterrupted
from granular_lmp.impact.deck import GUARD_COLUMNS, LONGEST_STEP, ImpactDeck, deck_of, look_steps
from granular_lmp.impact.problem import ImpactProblem, prepare
from granular_lmp.impact.record import ImpactRecord
from granular_lmp.impact.scene import ImpactScene
from granular_lmp.lammps.edits import differing_lines
from granular_lmp.lammps.outputs import LOG, SNAPSHOTS, mend_dump, read_log, writable, write_files
from granular_lmp.runs.agreement import scene_digest
from granular_lmp.runs.folder import clear, locked
from granular_lmp.runs.launch import Options
from granular_lmp.runs.record import write_status
from granular_lmp.runs.routes import Job, log_tail, route_of
from granular_lmp.scene.validation import LARGEST_OVERLAP_RATIO

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
        "take a shorter time.timestep",
    ),
}


def run_impact(what: ImpactScene | ImpactDeck, folder: str | Path, options: Options | None = None) -> ImpactRecord:
    """Run an impact in `folder`, which is created, and return its record.

    The folder holds ``scene.toml``, ``in.NAME``, ``data.NAME``, ``dump.particles``, ``log.lammps`` and ``run.json``.

    Raises
    ------
    SceneError
        As `granular_lmp.impact.problem.prepare`.
    RunFolderError
        If the folder exists (without ``options.force``) or cannot be written.
    EffectError
        If a guard triggered; the folder is kept.
    LammpsMissingError, LammpsError, LaunchError, RunInterrupted
        As in `granular_lmp.run`.
    """
    options = options or Options()
    began = perf_counter()
    deck = what if isinstance(what, ImpactDeck) else deck_of(prepare(what))
    info = description(deck.problem, "lmp" if options.program else "module", options.ranks)
    if deck is what and (edits := differing_lines(deck_of(deck.problem).input_text, deck.input_text)):
        info["edited"] = edits
    route = route_of(options.program, options.ranks)
    folder = Path(folder).absolute()
    steps = deck.problem.scene.time.steps

    def report(step: int) -> None:
        if options.progress:
            options.progress(min(step, steps), steps)

    with locked(folder, make=True, force=options.force) as lock:
        clear(folder)
        write_files(folder, deck.files())
        with writable(folder):
            write_status(folder, info | {"status": "running", "message": "started"})
        failure: BaseException | None = None
        record = None
        try:
            route(Job(folder, deck.input_name, LOG, lock, report))
        except KeyboardInterrupt:
            failure = RunInterrupted(f"{folder}: interrupted; run it again with force=True")
        except BaseException as error:  # run.json must hold the end of every run
            failure = error
        try:
            if (folder / SNAPSHOTS).is_file():
                if failure is not None:
                    mend_dump(folder / SNAPSHOTS)
                record = ImpactRecord.from_dump(folder, deck.problem)
            log = read_log(folder / LOG)
            info |= {"guards": judged(deck.problem, log.table), "samples": 0 if record is None else len(record.tau)}
            failure = failure or defect(deck, record, log.table) or _triggered(folder, info["guards"])
            info["wall_seconds"] = {"total": perf_counter() - began, "loop": log.loop if log.loop == log.loop else None}
        except BaseException as error:
            failure = failure or error
        status = "finished" if failure is None else "interrupted" if isinstance(failure, RunInterrupted) else "failed"
        info |= {"status": status, "message": str(failure or "")}
        with writable(folder):
            write_status(folder, info)
        if failure is not None:
            raise failure
    assert record is not None  # `defect` has seen to it
    report(steps)
    return ImpactRecord(record.tau, record.displacement, record.velocity, record.spin, deck.problem, info, folder)


def description(problem: ImpactProblem, launcher: str, ranks: int) -> dict[str, Any]:
    """Return the entries of ``run.json`` that are known before the run."""
    scene = problem.scene
    return {
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


def _triggered(folder: Path, guards: dict[str, Any]) -> EffectError | None:
    loud = [
        f"{title} = {'not finite' if each['value'] is None else format(each['value'], '.4g')}, above "
        f"{each['limit']:g}: {each['meaning']}; {each['cure']}"
        for title, each in guards.items()
        if not each["quiet"]
    ]
    return EffectError(f"{folder}: {'; '.join(loud)}") if loud else None


def defect(deck: ImpactDeck, record: ImpactRecord | None, table: dict[str, Any]) -> LammpsError | None:
    """Return an error if the record or the log is incomplete although LAMMPS reported success, else None."""
    time, tail = deck.problem.scene.time, ""
    if record is None or len(record.tau) != time.samples + 1:
        count = 0 if record is None else len(record.tau)
        return LammpsError(f"{count} records instead of {time.samples + 1}", deck.input_name, tail)
    if not all(np.isfinite(x).all() for x in (record.displacement, record.velocity, record.spin)):
        return LammpsError("the record holds numbers that are not finite", deck.input_name, tail)
    missed = {*range(0, time.steps + 1, look_steps(deck.problem))} - {*map(int, table.get("Step", ()))}
    if missed or not {*GUARD_COLUMNS} <= set(table):
        what = f"step {min(missed)}" if missed else "the guards"
        return LammpsError(f"the log lacks {what}", deck.input_name, log_tail(record.folder) if record.folder else "")
    return None
