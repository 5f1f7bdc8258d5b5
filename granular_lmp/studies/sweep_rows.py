"""Line of the table of a sweep: the results of a run, read only from its folder."""

from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from granular_lmp.accuracy.second_harmonic import second_harmonic
from granular_lmp.errors import GranularError, RunFolderError
from granular_lmp.rest.linear import mode_of
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.readouts import readout_columns
from granular_lmp.runs.record import STATUS, Record, read_status
from granular_lmp.scene.document import rule_of
from granular_lmp.studies import far_sphere
from granular_lmp.studies.sweep_points import GridPoint

Point = dict[str, Any]

RUNS = "runs"
ASKED = "_asked"  # suffix of a swept key: column of the requested values, if other values ran
# Columns and their units
_FIRST = {"run": "", "status": "", "message": "", "seconds": "s", "steps": "", "particles": ""}
# Columns of a wave beside the swept values: from run.json; the largest |p|, |q|, |phi| in the record; the measured
# second harmonic, with the error of the fit, and in metres
_MEASURED = {
    **{"frequency_Hz": "Hz", "largest_p": "D0", "largest_q": "D0", "largest_phi": "D0"},
    **{"second_harmonic": "D0", "second_harmonic_error": "D0", "second_harmonic_m": "m"},
}
# From guards: the smallest overlap, and the largest ratio of shear to sliding force
_OF_WAVE = {
    **{"contacts_per_sphere": "", "wavenumber_used": "rad per row", "direction_used": "degrees", "frequency": "rad/t0"},
    **_MEASURED,
    **{"smallest_overlap": "Delta0", "largest_slip": ""},
}


def units_of(scene: Scene) -> dict[str, str]:
    """Return the columns of a scene in the table, with units; readouts of its monitors follow."""
    return _FIRST | (far_sphere.COLUMNS if scene.wave is None else _OF_WAVE) | {"guards": ""}


def said_of(column: str, scene: Scene) -> dict[str, str]:
    """Return the attributes of a column in a data set: its name in the table, its unit, and the meaning of a key."""
    known, key = units_of(scene), column.removesuffix(ASKED)
    said = {"long_name": column}
    if column in known:
        said["units"] = known[column]
    else:
        try:
            rule = rule_of(key, scene)
            said |= {"units": rule.unit, "comment": rule.meaning}
        except KeyError:  # a readout of a monitor
            said["units"] = "D0"
    return {name: value for name, value in said.items() if value}


def info_of(folder: Path) -> dict[str, Any]:
    """Return the contents of ``run.json``: {} if there is none, and status "failed" if it cannot be read."""
    if not (folder / STATUS).exists():
        return {}
    try:
        return read_status(folder)
    except RunFolderError as error:
        return {"status": "failed", "message": str(error)}


def table_of(grid: list[GridPoint], rows: dict[str, Point]) -> list[Point]:
    """Return a line for each point of the grid: the values that ran, the requested values, and the run.

    Points with the same motion share a run. Only keys with a value that ran differently have columns for requested
    values. A line has None in the columns of monitors that only other lines have.
    """
    empty = dict.fromkeys(key for row in rows.values() for key in row)
    other = {key for point in grid for key, value in point.asked.items() if point.ran[key] != value}

    def values(point: GridPoint) -> Point:
        found: Point = {}
        for key, value in point.ran.items():
            found |= {key: value} | ({f"{key}{ASKED}": point.asked[key]} if key in other else {})
        return found

    return [values(each) | {"run": f"{RUNS}/{each.run}"} | empty | rows[each.run] for each in grid]


def row_of(folder: Path, scene: Scene, device: str | None) -> Point:
    """Return the line of the table for the run folder of a scene, which may be missing.

    A run by LAMMPS, or on another device than that of the engine, does not belong to a sweep by an engine.
    """
    info, record = info_of(folder), None
    if info.get("status") == "finished" and info.get("device") != device:
        info = {}
    if info.get("status") == "finished":
        try:
            record = Record.load(folder)
        except GranularError as error:  # its files are damaged
            info |= {"status": "failed", "message": str(error)}
    return summary_of(scene, info, record)


def summary_of(scene: Scene, info: dict[str, Any], record: Record | None) -> Point:
    """Return the columns of the run of a scene, from ``run.json`` and the record, if there is one."""
    ended = info.get("status") in ("finished", "failed")
    first = {
        "status": info["status"] if ended else "unfinished",
        "message": info.get("message", "") if ended else "",
        "seconds": info.get("wall_seconds", {}).get("total"),
        **{name: info.get(name) for name in ("steps", "particles")},
    }
    own = far_sphere.read_outs(info, record) if scene.wave is None else _of_wave(info, record)
    guards = " ".join(name for name, guard in info.get("guards", {}).items() if not guard["quiet"])
    return first | own | {"guards": guards} | readout_columns(info)


def _of_wave(info: dict[str, Any], record: Record | None) -> Point:
    return {
        "contacts_per_sphere": info.get("crystal", {}).get("contacts_per_sphere"),  # None: the lattice is perfect
        **{name: info.get(name) for name in ("wavenumber_used", "direction_used", "frequency")},
        **_measured(record),
        "smallest_overlap": info.get("smallest_overlap"),
        "largest_slip": info.get("guards", {}).get("largest_slip", {}).get("value"),
    }


def _measured(record: Record | None) -> Point:
    """Return the numbers from a record; each is None without a record, or without a second harmonic in it."""
    if record is None:
        return dict.fromkeys(_MEASURED)
    scene, found = record.scene, second_harmonic(record)
    hertz = mode_of(scene).frequency / scene.sphere.time_scale / (2 * pi)
    largest = [float(np.abs(values).max()) for values in (record.p, record.q, record.phi)]
    size = scene.displacement_amplitude
    harmonic = [None] * 3 if found is None else [found.amplitude, found.error, found.amplitude * size]
    return dict(zip(_MEASURED, [hertz, *largest, *harmonic], strict=True))
