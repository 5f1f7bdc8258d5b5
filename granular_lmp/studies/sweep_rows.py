"""A line of the table of a sweep: what is known of a run, from its folder alone."""

from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp.accuracy.second_harmonic import second_harmonic
from granular_lmp.errors import GranularError, RunFolderError, SceneError
from granular_lmp.lammps.outputs import SCENE
from granular_lmp.runs.readouts import readout_columns
from granular_lmp.runs.record import Record, read_status
from granular_lmp.scene.linear import mode_of
from granular_lmp.scene.scene import Scene
from granular_lmp.studies.sweep_points import concrete_hash

Point = dict[str, Any]

RUNS = "runs"
# What a line of the table says beside the swept values: of run.json; the largest |p|, |q|, |phi| of the record, in D0;
# the second harmonic as measured, with the error of the fit, in D0, and in metres; of the guards, the smallest overlap
# in Delta0 and the largest shear over sliding force. Read-outs of monitors follow
COLUMNS = (
    *("run", "status", "message", "seconds", "steps", "particles", "contacts_per_sphere"),
    *("wavenumber_used", "direction_used", "frequency"),
    *("frequency_Hz", "largest_p", "largest_q", "largest_phi"),
    *("second_harmonic", "second_harmonic_error", "second_harmonic_m"),
    *("smallest_overlap", "largest_slip", "guards"),
)


def info_of(folder: Path) -> dict[str, Any]:
    """Return the contents of ``run.json``; nothing where it cannot be read."""
    try:
        return read_status(folder)
    except RunFolderError:
        return {}


def table_of(grid: list[tuple[Point, str, Scene]], rows: dict[str, Point]) -> list[Point]:
    """Return a line for each point of the grid; points of the same scene share a run.

    A line has None in the columns of monitors that only other lines have.
    """
    empty = dict.fromkeys(key for row in rows.values() for key in row)
    return [point | empty | rows[name] | {"run": f"{RUNS}/{name}"} for point, name, _ in grid]


def refuse_other_point(folder: Path, scene: Scene | None = None) -> None:
    """Raise RunFolderError if the scene in a run folder is not the one after which the folder is named.

    `scene` is that scene if it has been read. One that cannot be read is left to `Record.load`.
    """
    try:
        scene = scene or Scene.load(folder / SCENE)
    except SceneError:
        return
    name = concrete_hash(scene)
    if name != folder.name:
        raise RunFolderError(
            f"{folder}: holds the run of another scene ({scene.wave_label}), that of {RUNS}/{name}; "
            "move it there, or away, and start the sweep again"
        )


def row_of(folder: Path) -> Point:
    """Return what the table says of a run folder, or of one that is not there.

    Raises
    ------
    RunFolderError
        When it holds the run of another scene: to run it again would destroy that.
    """
    info, record = info_of(folder), None
    if info.get("status") == "finished":
        try:
            record = Record.load(folder)
        except GranularError as error:  # its files are damaged
            info |= {"status": "failed", "message": str(error)}
    if info:
        refuse_other_point(folder, record.scene if record else None)
    return summary_of(info, record)


def summary_of(info: dict[str, Any], record: Record | None) -> Point:
    """Return what the table says of a run, from ``run.json`` and the record, if there is one."""
    ended = info.get("status") in ("finished", "failed")
    return {
        "status": info["status"] if ended else "unfinished",
        "message": info.get("message", "") if ended else "",
        "seconds": info.get("wall_seconds", {}).get("total"),
        **{name: info.get(name) for name in ("steps", "particles", "wavenumber_used", "direction_used", "frequency")},
        "contacts_per_sphere": info.get("crystal", {}).get("contacts_per_sphere"),  # None: the lattice is perfect
        **_measured(record),
        "smallest_overlap": info.get("smallest_overlap"),
        "largest_slip": info.get("guards", {}).get("largest_slip", {}).get("value"),
        "guards": " ".join(name for name, guard in info.get("guards", {}).items() if not guard["quiet"]),
        **readout_columns(info),
    }


def _measured(record: Record | None) -> Point:
    """Return the numbers read off a record; None each where there is no record, or no second harmonic in it."""
    names = COLUMNS[COLUMNS.index("frequency_Hz") : COLUMNS.index("smallest_overlap")]
    if record is None:
        return dict.fromkeys(names)
    scene, found = record.scene, second_harmonic(record)
    hertz = mode_of(scene).frequency / scene.sphere.time_scale / (2 * pi)
    largest = [float(np.abs(values).max()) for values in record.signals.values()]
    size = scene.displacement_amplitude
    harmonic = [None] * 3 if found is None else [found.amplitude, found.error, found.amplitude * size]
    return dict(zip(names, [hertz, *largest, *harmonic], strict=True))
