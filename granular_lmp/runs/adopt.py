"""Make a run folder from a run of plain ``lmp``: its dump, its log, the deck, and the scene beside it.

The deck prints its variables, so the log has their values after ``-var``. What the files do not contain is never
guessed: an error asks for it by name. The record must fit the scene: the centre sphere must begin where the wave of the
scene puts it.
"""

import re
import shutil
from collections.abc import Mapping
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp.crystal.lattices import centre
from granular_lmp.effects.case import Case
from granular_lmp.errors import RunFolderError, one_line
from granular_lmp.lammps.datafile import differences, read
from granular_lmp.lammps.deck import Deck, data_of, deck_of, written_text
from granular_lmp.lammps.edits import differing_lines
from granular_lmp.lammps.guard_results import seen_every
from granular_lmp.lammps.monitors import monitor_files
from granular_lmp.lammps.outputs import LOG, SCENE, SNAPSHOTS, read_log, writable, write_files
from granular_lmp.lammps.variables import said_variables
from granular_lmp.problem import Problem, prepare
from granular_lmp.rest.initial_fields import initial_fields
from granular_lmp.rest.linear import BlochWave
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.directory import absolute
from granular_lmp.runs.folder import clear, locked
from granular_lmp.runs.loop import execute
from granular_lmp.runs.manifest import description, wall_seconds
from granular_lmp.runs.phases import collected
from granular_lmp.runs.record import Record
from granular_lmp.runs.routes import Job
from granular_lmp.runs.simulation import Simulation, mend
from granular_lmp.scene.places import place_of
from granular_lmp.scene.schema import shown

# Variable of a deck → key of the scene
_KEYS = {
    "amplitude": "wave.amplitude",
    "timestep": "time.timestep",
    "sample": "time.sample",
    "duration": "time.duration",
    "ramp": "envelope.ramp",
    "particles": "output.particles",
}
_FRICTION = "effects.friction"
_GRID = re.compile(r"^ *(\d{1,6}) by (\d{1,6}) by (\d{1,6}) MPI processor grid$", re.MULTILINE)
_DATA = re.compile(r"^read_data +([^\s$]+)", re.MULTILINE)
_SAME = 1e-9  # relative error of a number that was written with 17 digits and read back
_PLACED = 1e-6  # D0: LAMMPS puts a sphere within 1e-10 of its place in the wave; another amplitude differs by far more


def adopt(
    source: str | Path,
    folder: str | Path | None = None,
    *,
    scene: Scene | None = None,
    changes: Mapping[str, Any] | None = None,
    force: bool = False,
) -> Record:
    """Make a run folder from a run of plain ``lmp`` in `source`, which does not change, and return its record.

    Parameters
    ----------
    source : path
        Folder with ``log.lammps``, ``in.NAME``, and the dump of the centre sphere, or of the spheres that the scene
        records.
    folder : path, optional
        Run folder; default ``runs/NAME``.
    scene : Scene, optional
        Scene of the deck, if `source` holds no ``scene.toml``.
    changes : mapping, optional
        Values of the scene that the log does not contain, by dotted keys.
    force : bool
        Replace the files of an earlier run in `folder`.

    Raises
    ------
    RunFolderError
        If a file is missing, if neither the log nor `changes` has the variables, or if the record does not begin like
        the scene.
    SceneError
        If the scene is invalid or has a tolerance.
    LammpsError
        If the record or the log is incomplete.
    EffectError
        If an effect that the deck leaves out occurred.
    """
    source = absolute(source)
    declared = scene or _scene(source, changes)
    place = absolute(folder or f"runs/{declared.name}")
    log = _text(source / LOG)
    said = said_variables(log)
    if said is None and not changes:
        wave, time = declared.wave, declared.time
        one = f"time.duration = {time.duration!r}" if wave is None else f"wave.amplitude = {wave.amplitude!r}"
        raise RunFolderError(
            f"{source / LOG}: does not print its variables, unlike decks of waves; give the values that differ from "
            f"the scene with changes={{KEY: VALUE}}, or one unchanged value, {one}"
        )
    declared.time.clock.refuse_ladder("a deck has one time step; give time.timestep")
    values = said or {}
    problem = prepare(declared.with_values({**_overrides(declared, values), **(changes or {})}))
    other = {key: value for key, value in (changes or {}).items() if key not in (*_KEYS.values(), _FRICTION)}
    deck = _deck(source, prepare(declared.with_values(other)), problem, log)
    simulation = Simulation(deck)
    dump = source / values.get("dump", simulation.dump)
    if dump.parent != source:
        raise RunFolderError(f"{source / LOG}: says dump = {shown(values['dump'])}: must be a file of the same folder")
    if not dump.is_file():
        raise RunFolderError(f"{dump}: missing; the record is made from it")
    for name in monitor_files(problem):
        if not (source / name).is_file():
            raise RunFolderError(f"{source / name}: the file of a monitor of the scene is missing")
    _refuse_other_beginning(source, dump.name, problem)
    info = description(deck.problem, deck.all_edits(), "lmp", _ranks(log)) | {
        "adopted": {"from": str(source), "variables": values}
    }
    found = read_log(source / LOG)
    info["wall_seconds"] = wall_seconds({}, found.sections)  # all of the time that is known
    if "looks" in info:
        info["looks"]["every_tau"] = seen_every(found.table)
    with locked(place, make=True, force=force) as lock:
        clear(place)
        write_files(place, simulation.files())

        def copy(_: Job) -> None:
            with writable(place):
                shutil.copyfile(source / LOG, place / LOG)
                others = {
                    SNAPSHOTS: SNAPSHOTS,
                    f"{simulation.dump}.contacts": f"{dump.name}.contacts",
                    simulation.dump: dump.name,
                }
                for name, there in (others | {name: name for name in monitor_files(problem)}).items():
                    if (source / there).is_file():
                        shutil.copyfile(source / there, place / name)
            mend(place, problem)

        with collected() as seconds:
            job = Job(place, deck.input_name, LOG, lock, lambda _: None)
            return execute(simulation, job, copy, info, seconds)


def _scene(source: Path, changes: Mapping[str, Any] | None) -> Scene:
    if not (source / SCENE).is_file():
        raise RunFolderError(f"{source}: holds no {SCENE}; give the scene of its deck, scene=SCENE")
    return Scene.load(source, changes)


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise RunFolderError(f"{path}: cannot be read: {one_line(error)}") from error


def _overrides(scene: Scene, said: Mapping[str, str]) -> dict[str, Any]:
    """Return the values of the scene that -var changed, by dotted key."""
    try:
        given = {_KEYS[name]: float(value) for name, value in said.items() if name in _KEYS}
        friction = float(said["friction"]) if "friction" in said else None
    except ValueError as error:
        raise RunFolderError(f"{LOG}: says a variable that must be a number: {error}") from error
    declared = scene.to_dict()
    changed = {key: value for key, value in given.items() if not _same(value, _at(declared, key))}
    if friction is not None:
        expected = _friction(scene.with_values(changed))
        if not _same(friction, expected):
            changed[_FRICTION] = friction
    return changed


def _at(tables: Mapping[str, Any], key: str) -> float:
    table, _, name = key.partition(".")
    return float(tables[table][name])


def _friction(scene: Scene) -> float:
    """Return the default friction in the deck of a scene."""
    problem = prepare(scene)
    return Case(problem.scene, problem.on).friction


def _same(value: float, other: float) -> bool:
    return abs(value - other) <= _SAME * abs(other)


def _refuse_other_beginning(source: Path, dump: str, problem: Problem) -> None:
    """Raise RunFolderError unless the recorded spheres begin as in the scene."""
    record = Record.from_dump(source, problem.scene, dump)
    if not len(record.tau) or record.tau[0] != 0:
        raise RunFolderError(f"{source / dump}: does not begin at tau = 0")
    if problem.wave is None:
        _of_strikes(record, source / dump, problem)
    else:
        _of_wave(record, source / dump, problem, problem.wave)


def _of_wave(record: Record, dump: Path, problem: Problem, wave: BlochWave) -> None:
    """Raise RunFolderError unless the centre sphere begins where the wave puts it, or at rest."""
    scene = problem.scene
    expected = np.zeros(2)
    if wave.declared.known.fills:
        crystal = problem.rest.atoms
        ux, uy = initial_fields(scene, crystal, wave).displacement[centre(crystal), :2]
        expected = np.array([scene.vector.along(ux, uy), scene.vector.across(ux, uy)])
    found = np.array([record.p[0], record.q[0]])
    unit = scene.amplitude * scene.sphere.static_overlap
    rounding = 8 * np.finfo(float).eps * scene.sphere.radius / unit  # rounding of a position next to the origin, in D0
    if np.abs(found - expected).max() > _PLACED + rounding:
        raise RunFolderError(
            f"{dump}: begins with p, q = {found[0]:.6g}, {found[1]:.6g} D0, but the wave of the scene with "
            f"{expected[0]:.6g}, {expected[1]:.6g}; give what differs from the scene, for instance wave.amplitude"
        )


def _of_strikes(record: Record, dump: Path, problem: Problem) -> None:
    """Raise RunFolderError unless the recorded spheres begin with the velocities of strikers and state."""
    if record.velocity.shape[1] != len(problem.rest.recorded):
        raise RunFolderError(f"{dump}: holds {record.velocity.shape[1]} spheres, and the scene records other ones")
    velocity = problem.rest.state[:, 3 : 3 + problem.scene.space].copy()
    for striker, spheres in zip(problem.scene.striker, problem.rest.strikers, strict=True):
        velocity[spheres] = striker.components[: problem.scene.space]
    expected = velocity[problem.rest.recorded] / problem.scene.scale.velocity
    off = np.abs(record.velocity[0] - expected).max(axis=1)
    if off.max() > _PLACED:
        worst = int(off.argmax())
        raise RunFolderError(
            f"{dump}: sphere {place_of(problem.rest.atoms, int(problem.rest.recorded[worst]))} begins with "
            f"{record.velocity[0, worst].round(6).tolist()} units of velocity, but in the scene with "
            f"{expected[worst].round(6).tolist()}; give what differs from the scene, for instance striker.1.velocity"
        )


def _deck(source: Path, begun: Problem, problem: Problem, log: str) -> Deck:
    """Return the deck of the run, with the text and spheres of the files if they differ from those of the scene.

    `begun` is the problem before -var, to which the files belong.
    """
    deck = deck_of(problem)
    text = _text(source / f"in.{begun.scene.name}")
    names = _DATA.findall(log) or [deck.data_name]
    data = read(source / names[-1])
    return replace(
        deck,
        input_text=text if differing_lines(written_text(begun), text) else deck.input_text,
        data=deck.data if not differences(data_of(begun), data) else data,
    )


def _ranks(log: str) -> int:
    """Return the number of MPI ranks from "2 by 1 by 1 MPI processor grid"; 1 if the log does not say it."""
    grid = _GRID.search(log)
    return prod(map(int, grid.groups())) if grid else 1
