"""Recorded signals of a run, and the files of the answer to which several runs are extrapolated.

Beside p, q and φ of the centre sphere there are, for each monitor NAME, the signals NAME.u, NAME.v, NAME.phi and their
rates NAME.u_t, NAME.v_t, NAME.phi_t, (T, N) each; with contacts NAME.normal, NAME.shear and, where contacts resist it,
NAME.rolling, (T, C), 0 where a contact is open; and NAME.flux, (T, R). Snapshots of all spheres are named like a
monitor "output.particles".
"""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy.extrapolation import combined
from granular_lmp.effects.on_walls import FACES
from granular_lmp.lammps.binary_dump import BinarySnapshot, binary_snapshots, write_binary
from granular_lmp.lammps.monitors import wall_columns
from granular_lmp.lammps.outputs import MONITOR, MONITOR_CONTACTS, SNAPSHOTS
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.components import by_axis, components, rates
from granular_lmp.runs.record import Record

if TYPE_CHECKING:
    from granular_lmp.runs.contact_forces import ContactForces
    from granular_lmp.runs.monitors import MonitorRecord

Floats = NDArray[np.float64]
Signals = dict[str, Floats]
PARTICLES = "output.particles"
_FIELDS = ("displacement", "rotation", "velocity", "spin")
# Columns of dumps that depend on the step; for contacts, those behind the two spheres
_MOVED = {
    *("normal", "v_theta"),
    *(f"{name}{axis}" for name in ("", "v", "omega", "tangential_", "rolling_") for axis in "xyz"),
    *(f"{name}.{axis}" for name in ("Displacement", "Orientation") for axis in "WXYZ"),
    *(name for face in FACES for name in wall_columns(face, "xyz")[2:]),
}
_HEAD = 9  # lines of a snapshot before its spheres


class Recorded:
    """Signals of the runs of a ladder: `add` a run; `signals` returns those of all runs so far in equal shapes."""

    def __init__(self) -> None:
        self._own: list[Signals] = []
        self._monitors: list[list[MonitorRecord]] = []

    def add(self, record: Record) -> None:
        """Read the record of a run."""
        monitors = [record.monitor(each.name) for each in record.scene.monitor]
        own, everyone = dict(record.signals), _everyone(record.scene)
        for each in monitors:
            own |= _moving_parts(each.monitor.name, *(getattr(each, name) for name in _FIELDS))
            own |= {f"{each.monitor.name}.{name}": values for name, values in each.of_rows.items()}
        if everyone:
            snapshots = record.snapshots()
            own |= _moving_parts(PARTICLES, *snapshots.stacks(*_FIELDS))
        self._own.append(own)
        self._monitors.append(monitors)

    @property
    def signals(self) -> list[Signals]:
        """Signals of each run by name."""
        found = [dict(own) for own in self._own]
        for of_runs in zip(*self._monitors, strict=True):
            if of_runs[0].monitor.with_contacts:
                pairs = [each.contacts for each in of_runs]
                rolls = of_runs[0].scene.effects.rolling is True
                for name in ("normal", "shear", *(["rolling"] if rolls else [])):
                    for signals, values in zip(found, _aligned(pairs, name), strict=True):
                        parts = by_axis(name, values)
                        signals |= {f"{of_runs[0].monitor.name}.{part}": each for part, each in parts.items()}
        return found


def _everyone(scene: Scene) -> bool:
    """Return whether a run of a scene has snapshots of all spheres in addition to its record."""
    return scene.wave is not None and scene.output.particles > 0


def _moving_parts(name: str, displacement: Floats, rotation: Floats, velocity: Floats, spin: Floats) -> Signals:
    parts = components(displacement, rotation) | rates(velocity, spin)
    return {f"{name}.{column}": values for column, values in parts.items()}


def _aligned(pairs: Sequence["ContactForces"], name: str) -> Iterator[Floats]:
    """Yield the forces of several runs, (T, C) each, on the contacts that occurred in any run."""
    every = sorted({pair for each in pairs for pair in each.pairs})
    place = {pair: column for column, pair in enumerate(every)}
    for each in pairs:
        values = getattr(each, name)
        whole = np.zeros((len(values), len(every), *values.shape[2:]))
        whole[:, [place[pair] for pair in each.pairs]] = values
        yield whole


# --- the files of the answer -----------------------------------------------------------------------------------------


def write_answer(folder: Path, records: Sequence[Record], weights: Sequence[float]) -> None:
    """Write the dumps of monitors and snapshots of an answer into a folder, from the dumps of its runs.

    Constant values and steps are those of the last run, which also determines a contact that is open in any run.
    """
    places = [each.folder for each in records]
    scene, folders = records[-1].scene, [place for place in places if place is not None]
    has_snapshots = scene.wave is None or _everyone(scene)
    assert len(folders) == len(places) or not (scene.monitor or has_snapshots)
    for monitor in scene.monitor:
        name = MONITOR.format(monitor.name)
        _write_motion(folder / name, [each / name for each in folders], weights)
        if monitor.with_contacts:
            name = MONITOR_CONTACTS.format(monitor.name)
            write_dump(folder / name, [each / name for each in folders], weights)
    if has_snapshots:
        write_dump(folder / SNAPSHOTS, [each / SNAPSHOTS for each in folders], weights)


def _write_motion(path: Path, paths: Sequence[Path], weights: Sequence[float]) -> None:
    """Write a binary dump of an answer."""

    def tables() -> Iterator[tuple[BinarySnapshot, Floats]]:
        for each in zip(*map(binary_snapshots, paths), strict=True):
            ascending = [one.table[np.argsort(one.table[:, 0])] for one in each]  # each rank writes its own
            moved = np.array([name in _MOVED for name in each[-1].names])
            yield each[-1], np.where(moved, combined(ascending, weights), ascending[-1])

    write_binary(path, paths[-1], tables())


def write_dump(path: Path, paths: Sequence[Path], weights: Sequence[float]) -> None:
    """Write a text dump of an answer, for spheres or contacts, from the dumps of its runs, moment by moment."""
    with ExitStack() as files:
        streams = [files.enter_context(each.open(encoding="utf-8")) for each in paths]
        out = files.enter_context(path.open("w", encoding="utf-8"))
        for snapshots in zip(*map(_snapshots, streams), strict=True):
            head, _, words = snapshots[-1]
            out.writelines(head)
            names = head[-1].split()[2:]
            keys = 2 if names[0] == "first" else 1
            numbers = [_by_key(each[1], _of_first(names) if keys == 2 else None) for each in snapshots]
            moved = [at for at, name in enumerate(names) if name in _MOVED]
            for key, line in zip(numbers[-1], words, strict=True):
                whole = [each[key] for each in numbers if key in each]
                if len(whole) == len(numbers):
                    values = combined(whole, weights)
                    if keys == 2 and int(line[0]) > int(line[1]):  # LAMMPS may list the two spheres in the other order
                        values[_of_first(names)] *= -1
                    for at in moved:
                        line[at] = repr(float(values[at]))
                out.write(" ".join(line) + "\n")


def _snapshots(stream: TextIO) -> Iterator[tuple[list[str], Floats, list[list[str]]]]:
    """Yield the head, the numbers and the words of each line of the snapshots of a text dump."""
    while head := list(islice(stream, _HEAD)):
        words = [line.split() for line in islice(stream, int(head[3]))]
        columns = len(head[-1].split()) - 2  # a moment may have no contacts
        yield head, np.array(words, dtype=float).reshape(len(words), columns), words


def _of_first(names: Sequence[str]) -> slice:
    """Return the columns of a contact whose sign depends on the sphere: the shear force and the vector."""
    return slice(3, 9 if "z" in names else 7)


def _by_key(table: Floats, of_first: slice | None) -> dict[tuple[int, ...], Floats]:
    """Return the lines of a table by sphere, or by pair of spheres with the lower one first.

    `of_first` are the columns of a pair that belong to its first sphere.
    """
    found, keys = {}, 1 if of_first is None else 2
    for row in table:
        key = tuple(map(int, row[:keys]))
        if of_first is not None and key[0] > key[1]:
            row = row.copy()
            row[of_first] *= -1  # the vector and the force then belong to the other sphere
            key = key[::-1]
        found[key] = row
    return found
