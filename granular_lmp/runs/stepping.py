"""Route of another engine: it takes the steps of a deck, and this module writes the files that LAMMPS would write.

They are the dumps of the centre sphere or the recorded spheres, the snapshots, the monitors, the thermo table of the
guards, and checkpoints. A checkpoint is written at intervals of real time, as it changes no number, and when a run is
stopped; a run that continues from it writes the same bytes.
"""

import io
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from math import ceil
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.effects.freedoms import axes, turns
from granular_lmp.errors import SceneError
from granular_lmp.lammps import written
from granular_lmp.lammps.beginning import Beginning, beginning
from granular_lmp.lammps.checkpoints import minutes_between
from granular_lmp.lammps.guards import line_interval
from granular_lmp.lammps.monitors import contact_columns
from granular_lmp.lammps.outputs import CHECKPOINTS, DUMP, LOG, MONITOR, MONITOR_CONTACTS, SNAPSHOTS, whole
from granular_lmp.problem import Problem
from granular_lmp.runs.continuation import END, NETWORK, last_checkpoint, whole_checkpoints
from granular_lmp.runs.engine import Engine, Moment, Motion, Setting
from granular_lmp.runs.manifest import description
from granular_lmp.runs.observed import Observer
from granular_lmp.runs.phases import phase
from granular_lmp.runs.routes import Job, Route

Write = Callable[[Moment], str | bytes]


def route_by(engine: Engine, problem: Problem, info: dict[str, Any]) -> Route:
    """Return the route of an engine; before writing a file it refuses, by name, what the engine does not support."""
    _refuse(problem)
    with phase("start"):
        observer, begun = Observer(problem), beginning(problem)
        motion = engine.begin(Setting.of(problem, info, begun))
    return lambda job: _steps(motion, problem, Recorder(problem, begun, observer), job)


def refuse_unheld(engine: Engine, problem: Problem) -> None:
    """Raise SceneError that names what an engine does not support in a problem with a time step."""
    route_by(engine, problem, description(problem, [], NETWORK, 1))


def _refuse(problem: Problem) -> None:
    """Raise SceneError for data that the files of another engine do not contain."""
    scene = problem.scene
    for monitor in scene.monitor:
        if monitor.with_contacts and problem.rest.planes:
            raise SceneError(
                f'monitor {monitor.name}: what = "{monitor.what}": only LAMMPS records the forces of walls; '
                'what = "motion" is recorded',
                because="not built",
            )
    moved = problem.rest.atoms.arrays["fixed"].any() or any(each.motion for each in scene.source)
    if scene.output.forces and moved:
        raise SceneError(
            "output.forces: only LAMMPS records the forces on spheres that are held or moved", because="not built"
        )


def stops(problem: Problem, after: int = -1) -> list[int]:
    """Return the steps after a given number at which something is recorded or checked."""
    clock = problem.scene.time
    found = {
        *range(0, clock.steps, clock.steps_per_sample),
        *range(0, clock.steps, line_interval(problem)),
        clock.steps,
    }
    return [each for each in sorted(found) if each > after]


class Recorder:
    """Writer of the records of a deck."""

    def __init__(self, problem: Problem, begun: Beginning, observer: Observer) -> None:
        self.problem, self.begun, self.observer = problem, begun, observer
        clock = problem.scene.time
        self.every, self.look, self.last = clock.steps_per_sample, line_interval(problem), clock.steps
        self.files = {name: (self.every, write) for name, write in self._samples().items()}
        if problem.scene.wave is not None and problem.scene.output.particles:
            apart = self.every * ceil(problem.scene.output.particles / clock.sample - 1e-9)
            all_spheres = np.arange(len(problem.rest.atoms))
            self.files[SNAPSHOTS] = apart, partial(self._spheres, spheres=all_spheres)

    def _samples(self) -> dict[str, Write]:
        """Return the text or bytes of each sample, by file."""
        problem, found = self.problem, dict[str, Write]()
        if problem.scene.wave is None:
            forces = problem.scene.output.forces
            found[SNAPSHOTS] = partial(self._spheres, spheres=problem.rest.recorded, forces=forces)
        else:
            found[DUMP] = self._centre
        for placed in problem.monitors:
            name = placed.monitor.name
            found[MONITOR.format(name)] = partial(self._monitor, spheres=placed.spheres)
            if placed.monitor.with_contacts:
                found[MONITOR_CONTACTS.format(name)] = partial(self._contacts, around=placed.around)
        return found

    def write(self, moment: Moment, streams: dict[str, IO[Any]]) -> None:
        """Write the records that are due at a moment."""
        for name, (every, text) in self.files.items():
            if moment.number % every == 0:
                streams[name].write(text(moment))
        if moment.number % self.look == 0 or moment.number == self.last:
            streams[LOG].write(self.observer.line(moment))

    def _columns(self, moment: Moment, spheres: NDArray[np.int64], forces: bool = False) -> written.Columns:
        force = moment.forces(spheres) if forces else None
        return written.columns(spheres, self.begun, moment.fields(spheres), force)

    def _centre(self, moment: Moment) -> str:
        thetas = [f"theta{end}" for end in turns(self.problem) if self.problem.on["tracking"]]
        spins = [f"omega{end or 'z'}" for end in turns(self.problem) if self.problem.on["rotation"]]
        along = axes(self.problem)
        names = ["id", *(f"u{axis}" for axis in along), *thetas, *(f"v{axis}" for axis in along), *spins]
        found = self._columns(moment, self.problem.rest.recorded)
        return written.text(moment.number, self.begun, names, [found[name] for name in names])

    def _spheres(self, moment: Moment, spheres: NDArray[np.int64], forces: bool = False) -> str:
        names = written.renamed(self.problem, "".join(f" f{axis}" for axis in axes(self.problem) if forces))
        found = self._columns(moment, spheres, forces)
        return written.text(moment.number, self.begun, names, [found[name] for name in names])

    def _monitor(self, moment: Moment, spheres: NDArray[np.int64]) -> bytes:
        names, found = written.renamed(self.problem), self._columns(moment, spheres)
        return written.binary(moment.number, self.begun, names, [found[name] for name in names])

    def _contacts(self, moment: Moment, around: NDArray[np.int64]) -> str:
        ends, values = moment.contacts(around)
        table = [*(ends + 1), *values.T]
        return written.text(moment.number, self.begun, contact_columns(self.problem.scene), table, "ENTRIES")


def _steps(motion: Motion, problem: Problem, recorder: Recorder, job: Job) -> None:
    """Run the steps, from the start or a checkpoint, and write the files; a stop leaves a checkpoint."""
    kept = None
    if whole_checkpoints(job.folder):
        kept = _read(last_checkpoint(job.folder, min(recorder.files)))
    patience = 60 * minutes_between(problem.scene.output.checkpoint, problem.scene.shape.spheres)
    began, reached = time.monotonic(), None
    checkpointed = began
    with ExitStack() as stack:
        streams = {
            name: stack.enter_context((job.folder / name).open("ab" if name.endswith(".bin") else "a"))
            for name in (*recorder.files, LOG)
        }
        streams[LOG].write(("" if kept else "\n") + recorder.observer.head)
        try:
            for moment in motion.moments(stops(problem, int(kept["number"]) if kept else -1), kept):
                recorder.write(moment, streams)
                reached = moment
                if time.monotonic() - checkpointed > patience and moment.number < recorder.last:
                    _keep(moment, job.folder, streams)
                    checkpointed = time.monotonic()
                job.report_step(moment.number)
        except BaseException:
            if reached is not None and 0 < reached.number < recorder.last:
                _keep(reached, job.folder, streams)
            raise
        streams[LOG].write(f"Loop time of {time.monotonic() - began:.6g} on 1 procs\n")


def _keep(moment: Moment, folder: Path, streams: dict[str, IO[Any]]) -> None:
    """Write a checkpoint after the records that it continues."""
    for stream in streams.values():
        stream.flush()
    content = io.BytesIO()
    np.savez(content, **{"number": np.array(moment.number), **moment.kept()})  # type: ignore[arg-type]  # arrays by name
    with whole(folder / CHECKPOINTS[0]) as draft:
        draft.write_bytes(content.getvalue() + END)


def _read(path: Path) -> dict[str, Any]:
    with np.load(io.BytesIO(path.read_bytes().removesuffix(END))) as kept:
        return dict(kept)
