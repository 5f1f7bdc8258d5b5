"""Measured motion of spheres at equally spaced times, from the monitors of a run or from a table of measured points.

A table has the format of `granular_analysis.measure.points`, without errors, as ``granular-lmp export RUN --monitor
NAME`` writes it too. Displacements are read; if there are none, velocities. A table may have gaps, and times before the
start of the run.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure import points
from granular_analysis.measure.outside import sites
from granular_analysis.measure.snapshot import scales_of
from granular_analysis.theory.errors import TheoryError
from granular_lmp.runs.record import Record, Scene
from granular_lmp.scene.spreadsheets import TableError

__all__ = ["Traces"]

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
_TAKEN = [[f"{name}_{axis}" for axis in "xyz"] for name in ("displacement", "velocity")]
_EQUAL = 1e-3  # times that differ by less than this share of the time between two samples are equal
_FEWEST = 4  # fewest samples of a record, and of a spline


@dataclass(frozen=True, eq=False)
class Traces:
    """Motion of n spheres at T equally spaced times, in SI units.

    Attributes
    ----------
    said : file or folder of the traces, for messages.
    time : (T,) s.
    row, column, layer : (n,) place of each sphere; −1 for a column or layer that a table leaves out, and for the layer
        of a monitor.
    motion : name of a trace, as "displacement_x", to its values (T, n) in m or m/s; nan where nothing was measured.
    understood : description of the columns of a table, as they were read; "" for a run.
    """

    said: str
    time: Floats
    row: Integers
    column: Integers
    layer: Integers
    motion: Mapping[str, Floats]
    understood: str = ""

    @classmethod
    def read(cls, path: str | Path) -> "Traces":
        """Return the traces of a run folder or of a table.

        Raises GranularError for a folder or a table that cannot be read, and ValueError for a run without monitors, and
        for fewer than four or unequally spaced times.
        """
        return cls.of_run(Record.load(path)) if Path(path).is_dir() else cls.of_table(path)

    @classmethod
    def of_run(cls, record: Record) -> "Traces":
        """Return the displacements of all monitors of a run."""
        if not record.scene.monitor:
            raise ValueError(f"{record.folder}: has no [[monitor]]; the traces are the motion of monitored spheres")
        scales = scales_of(record)
        found = [record.monitor(each.name) for each in record.scene.monitor]
        times = found[0].tau * scales.time * scales.second
        ways = np.concatenate([each.displacement for each in found], axis=1) * scales.length * scales.metre
        motion = {name: ways[..., axis] for axis, name in zip(range(ways.shape[2]), _TAKEN[0], strict=False)}
        row, column = (np.concatenate([getattr(each, name) for each in found]) for name in ("row", "column"))
        return cls(str(record.folder), times, row, column, np.full_like(row, -1), motion).checked()

    @classmethod
    def of_table(cls, path: str | Path) -> "Traces":
        """Return the traces of a table."""
        measured, table = points.read(path, *_TAKEN, errors=False)
        there = {each.kind for each in measured}
        names = next(names for names in _TAKEN if there.intersection(names))
        own = [each for each in measured if each.kind in names]
        moments = np.array([each.time for each in own])
        gaps = np.array(points.empty_times(table, measured))
        times = np.unique([*moments, *gaps[(gaps > moments.min()) & (gaps < moments.max())]])
        when = np.searchsorted(times, moments)
        places, where = np.unique([(each.row, each.column, each.layer) for each in own], axis=0, return_inverse=True)
        which = [*zip((each.kind for each in own), when.tolist(), where.ravel().tolist(), strict=True)]
        if len({*which}) < len(which):
            raise TableError(f"{path}: two lines have the same sphere and time")
        motion = {name: np.full((len(times), len(places)), np.nan) for name in names if name in there}
        for (name, moment, place), each in zip(which, own, strict=True):
            motion[name][moment, place] = each.value
        row, column, layer = places.astype(np.intp).T
        return cls(str(path), times, row, column, layer, motion, table.understood).checked()

    def checked(self) -> "Traces":
        """Return these traces; raise ValueError for fewer than four or unequally spaced times."""
        apart = np.diff(self.time)
        if len(self.time) < _FEWEST or np.ptp(apart) > _EQUAL * apart.mean():
            raise ValueError(f"{self.said}: must have at least {_FEWEST} times with equal steps between them")
        return self

    def spheres(self, scene: Scene, position: Floats) -> Integers:
        """Return the index of each sphere in a scene, (n,); `position` (N, d) are the places of its spheres at rest.

        Raises TheoryError for a place without a sphere, and for a sphere with two traces.
        """
        places = zip(self.row.tolist(), self.column.tolist(), self.layer.tolist(), strict=True)
        found = spheres_at(((self.said, *place) for place in places), scene, position)
        if len({*found.tolist()}) < len(found):
            raise TheoryError(f"{self.said}: a sphere has two traces, as from two monitors")
        return found

    def at(self, grid: Floats) -> dict[str, Floats]:
        """Return the motion at the times of a grid (G,), by name (G, n); nan in gaps and outside the measured times.

        If all times are measured ones, to 1e-3 of the time between two samples, their values are taken; otherwise cubic
        splines interpolate.
        """
        apart = self.time[1] - self.time[0]
        index = np.rint((grid - self.time[0]) / apart).astype(np.intp)
        inside = (index >= 0) & (index < len(self.time))
        index = index.clip(0, len(self.time) - 1)
        if np.all(np.abs(self.time[index] - grid)[inside] < _EQUAL * apart):
            return {name: np.where(inside[:, None], each[index], np.nan) for name, each in self.motion.items()}
        return {
            name: np.array([_splined(self.time, own, grid) for own in each.T]).T for name, each in self.motion.items()
        }


def rms(motion: Mapping[str, Floats]) -> float:
    """Return the root mean square of all finite values of traces; 0 if there are none."""
    values = np.concatenate([each[np.isfinite(each)] for each in motion.values()])
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _splined(time: Floats, values: Floats, grid: Floats) -> Floats:
    """Return values (T,) at the times of a grid (G,), from a spline through each part of at least four samples."""
    from scipy.interpolate import CubicSpline  # slow to import

    found = np.full(len(grid), np.nan)
    known = np.flatnonzero(np.isfinite(values))
    for part in np.split(known, np.flatnonzero(np.diff(known) > 1) + 1):
        if len(part) >= _FEWEST:
            inside = (grid >= time[part[0]]) & (grid <= time[part[-1]])
            found[inside] = CubicSpline(time[part], values[part])(grid[inside])
    return found


def spheres_at(places: Iterable[tuple[str, int, int, int]], scene: Scene, position: Floats) -> Integers:
    """Return the indices of the spheres at places (label for messages, row, column, layer).

    A column or layer of −1 means the only one. Raises TheoryError if there are several, and for a place without a
    sphere.
    """
    row, column = sites(scene, position)
    layers = len(row) // len({*zip(row.tolist(), column.tolist(), strict=True)})
    known = {(int(r), int(c), n % layers): n for n, (r, c) in enumerate(zip(row, column, strict=True))}
    lasts = {"column": int(column.max()), "layer": layers - 1}
    found = []
    for said, at, *others in places:
        for (name, last), value in zip(lasts.items(), others, strict=True):
            if value < 0 < last:
                raise TheoryError(f"{said}: a trace needs {name}, from 0 to {last}")
        place = at, *(max(value, 0) for value in others)
        if place not in known:
            raise TheoryError(f"{said}: row {place[0]}, column {place[1]}, layer {place[2]}: no sphere")
        found.append(known[place])
    return np.array(found, dtype=np.intp)
