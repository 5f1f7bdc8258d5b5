"""Records of monitors: motion of spheres, forces of their contacts, and energy flux through rows.

Everything is dimensionless like `granular_lmp.runs.snapshots`: displacements in D0, times in t0, forces in k1 D0,
torques in k1 D0 R, and powers in k1 D0²/t0.

The energy flux through row n, positive along +y, is half of the power from contacts with rows below, minus half of the
power from contacts with rows above,

    J_n = ½ Σ_{i in n} [Σ_{j below} P_ij − Σ_{j above} P_ij],    P_ij = F_ij · v_i + T_ij ω_i

with the force F_ij, normal and shear, and the torque T_ij of the contact on sphere i. This corresponds to a plane that
cuts the spheres of the row, and the contacts between them, in halves. The energy between two rows, with half of the
energy of both, changes by the difference of their fluxes, and by sources, dashpots and the work of the shear law
between them. A source in the row acts half above and half below. Recorded velocities and forces belong to the same
time, but contacts in LAMMPS use the velocity of half a step ago, so the power of a dashpot has an error of first order
in the step.

OVITO reads ``monitor.NAME.bin`` as a binary LAMMPS dump with the columns of a snapshot, and ``monitor.NAME.contacts``
as a ``dump local``.
"""

from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any, Self

import ase
import numpy as np
from numpy.typing import NDArray

from granular_lmp.effects.on_walls import FACES
from granular_lmp.errors import RunFolderError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.lammps.binary_dump import binary_snapshots
from granular_lmp.lammps.monitors import contact_columns, wall_columns
from granular_lmp.lammps.outputs import MONITOR, MONITOR_CONTACTS, read_snapshots
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.components import by_axis, components, rates
from granular_lmp.runs.contact_forces import ContactForces
from granular_lmp.runs.formats import scene_of
from granular_lmp.runs.prescribed_motion import at_the_instant, moved_spheres
from granular_lmp.runs.scales import force_of, si_of
from granular_lmp.runs.seal import refuse_changed_record
from granular_lmp.runs.snapshots import dimensionless, finest
from granular_lmp.runs.tables import HasTables, Many, places_of
from granular_lmp.scene.monitor_kinds import POWER, WITH_CONTACTS
from granular_lmp.scene.monitors import Monitor, row_step
from granular_lmp.scene.places import spheres_at
from granular_lmp.scene.schema import allowed_names

__all__ = ["ContactForces", "MonitorRecord"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, repr=False)
class MonitorRecord(HasTables):
    """Record of a monitor, read at first use.

    Attributes
    ----------
    monitor : Monitor
        Monitor as declared in the scene.
    scene : Scene
        Scene of the run that wrote it.
    folder : Path
        Folder of that run.

    Examples
    --------
    >>> watched = {"monitor": [{"name": "line", "rows": [4, 6]}], "time.duration": 4.0}
    >>> line = run(Scene.load("tr_periodic").with_values(watched), "runs/watched").monitor("line")
    >>> line.displacement.shape, line.row.tolist()
    ((9, 9, 2), [4, 4, 4, 5, 5, 5, 6, 6, 6])
    """

    monitor: Monitor
    scene: Scene
    folder: Path

    @classmethod
    def load(cls, folder: str | Path, name: str) -> Self:
        """Return the record of a monitor in a run folder.

        For a run with a tolerance it belongs to the answer, or to the finest step if an earlier release wrote no other.

        Raises
        ------
        RunFolderError
            If the scene has no such monitor, or the run has no file of it.
        """
        folder = Path(folder)
        known = {each.name: each for each in scene_of(folder).monitor}
        if name not in known:
            there = allowed_names(name, known) if known else "its scene has none"
            raise RunFolderError(f"{folder}: monitor {name!r}: no such monitor; {there}")
        path = finest(folder, MONITOR.format(name))
        if path is None:
            raise RunFolderError(f"{folder / MONITOR.format(name)}: missing; run the scene again with force=True")
        refuse_changed_record(folder, path)
        return cls(known[name], scene_of(path.parent), path.parent)

    # --- motion ---

    @cached_property
    def crystal(self) -> ase.Atoms:
        """All spheres at rest, with lengths in radii."""
        return crystal_of(self.scene).atoms

    @cached_property
    def spheres(self) -> Integers:
        """Indices of the spheres of the monitor in the crystal, (N,), ascending."""
        return spheres_at(self.monitor.rows, self.monitor.spheres, self.crystal, "monitor", self.monitor.layers)

    @property
    def row(self) -> Integers:
        """Row of each sphere, (N,), counted from 0."""
        return np.asarray(self.crystal.arrays["row"][self.spheres])

    @property
    def column(self) -> Integers:
        """Column of each sphere, (N,), counted from 0."""
        return np.asarray(self.crystal.arrays["column"][self.spheres])

    @cached_property
    def _motion(self) -> tuple[Integers, dict[str, Floats]]:
        """Steps, and columns of the dump by name, (T, N) each."""
        path = self.folder / MONITOR.format(self.monitor.name)
        steps, tables, names = [], [], [""]
        for each in binary_snapshots(path):
            if not np.array_equal(each.table[:, 0], self.spheres + 1):
                raise RunFolderError(f"{path}: holds other spheres at step {each.step} than the monitor")
            steps.append(each.step)
            tables.append(each.table)
            names = each.names
        samples = self.scene.time.samples + 1
        if not steps or len(steps) > samples or np.any(np.diff(steps) <= 0):
            raise RunFolderError(f"{path}: holds {len(steps)} records, expected up to {samples} at ascending steps")
        return np.array(steps), dict(zip(names, np.moveaxis(np.array(tables), 2, 0), strict=True))

    @cached_property
    def _fields(self) -> tuple[Floats, Floats, Floats, Floats]:
        moved = moved_spheres(self.scene, self.spheres)
        return at_the_instant(moved, self.tau, dimensionless(self._motion[1], self.scene))

    @property
    def tau(self) -> Floats:
        """Times, (T,), in t0."""
        steps, time = self._motion[0], self.scene.time
        return steps.astype(float) * time.clock.between(steps.tolist(), time.sample)

    @property
    def displacement(self) -> Floats:
        """Displacement u, v from the place at rest, (T, N, 2) or in space (T, N, 3), in D0."""
        return self._fields[0]

    @property
    def velocity(self) -> Floats:
        """Velocity, as `displacement`, in D0/t0."""
        return self._fields[1]

    @property
    def rotation(self) -> Floats:
        """Rθ/D0, (T, N) or in space (T, N, 3); 0 if spheres do not turn, nan if they turn and are not tracked."""
        return self._fields[2]

    @property
    def spin(self) -> Floats:
        """Rω t0/D0, as `rotation`; 0 if spheres do not turn."""
        return self._fields[3]

    # --- contacts ---

    @cached_property
    def contacts(self) -> ContactForces:
        """Contacts of the spheres of the monitor.

        Raises
        ------
        RunFolderError
            If the monitor records only motion, or its file is damaged.
        """
        if not self.monitor.with_contacts:
            raise RunFolderError(
                f'monitor {self.monitor.name}: what = "{self.monitor.what}": holds no contacts; run its scene with '
                f"what = {WITH_CONTACTS}"
            )
        path = self.folder / MONITOR_CONTACTS.format(self.monitor.name)
        refuse_changed_record(self.folder, path)
        when = {step: number for number, step in enumerate(self._motion[0].tolist())}
        unknown = np.ones(len(when), dtype=bool)
        columns = contact_columns(self.scene)
        times, tables = [np.empty(0, dtype=int)], [np.empty((0, len(columns)))]
        for step, names, table in read_snapshots(path):
            if tuple(names) != columns:
                raise RunFolderError(f"{path}: holds {' '.join(names)}, expected {' '.join(columns)}")
            if step in when:  # a killed run may have written only one of the two files
                unknown[when[step]] = False
                times.append(np.full(len(table), when[step]))
                tables.append(table)
        return self._with_walls(self._by_pair(np.concatenate(times), np.concatenate(tables), unknown))

    def _by_pair(self, time: Integers, table: Floats, unknown: NDArray[np.bool_]) -> ContactForces:
        """Return the contacts of the spheres of the monitor from the lines of the dump; nan at unknown times."""
        atoms, units = self.crystal, self.scene.units
        sphere = self.scene.sphere
        first, second = table[:, :2].astype(int).T - 1
        space = self.scene.space
        along, across, roll = slice(3 + space, 3 + 2 * space), slice(3, 3 + space), slice(3 + 2 * space, None)
        own = np.isin(first, self.spheres) | np.isin(second, self.spheres)
        own &= table[:, along].any(axis=1)  # LAMMPS lists pairs within a pull-off distance that do not touch as zeros
        time, table, first, second = time[own], table[own], first[own], second[own]
        i, j = np.minimum(first, second), np.maximum(first, second)
        keys, pair = np.unique(i * len(atoms) + j, return_inverse=True)
        of_i, of_j = keys // len(atoms), keys % len(atoms)
        # the vector leads to the first, and the force is on the first
        sign = np.where(first == i, -1.0, 1.0)[:, None]
        vector = np.full((len(unknown), len(keys), space), np.nan)
        vector[time, pair] = sign * table[:, along] / units.number(sphere.radius, length=1)
        force = units.number(force_of(self.scene), mass=1, length=1, time=-2)
        normal = np.zeros((len(unknown), len(keys)))
        shear, rolling = np.zeros((2, *(normal.shape if space == 2 else vector.shape)))
        normal[unknown] = shear[unknown] = rolling[unknown] = np.nan
        normal[time, pair] = table[:, 2] / force
        n = sign * table[:, along] / np.linalg.norm(table[:, along], axis=1)[:, None]
        side = sign * table[:, across] / force
        shear[time, pair] = _cross(n, side) if space == 2 else side
        radius = atoms.arrays["radius"]
        if table.shape[1] > roll.start:
            arm = radius[i] * radius[j] / (radius[i] + radius[j])
            torque = _cross(n, -sign * table[:, roll] / force)
            rolling[time, pair] = (arm if space == 2 else arm[:, None]) * torque
        length = np.linalg.norm(vector, axis=-1)
        overlap = (radius[of_i] + radius[of_j] - length) * sphere.radius / self.scene.scale.length
        return ContactForces(of_i, of_j, vector, normal, shear, overlap, rolling, np.full(len(of_i), "", dtype="<U3"))

    @property
    def walls(self) -> list[str]:
        """Faces of the walls whose forces are recorded; none in runs of earlier releases."""
        return [face for face in FACES if wall_columns(face, "")[0] in self._motion[1]]

    def _with_walls(self, contacts: ContactForces) -> ContactForces:
        """Return the contacts together with those between the spheres of the monitor and walls."""
        for face in self.walls:
            added = self._on_wall(face)
            parts = {each.name: (getattr(contacts, each.name), getattr(added, each.name)) for each in fields(contacts)}
            contacts = ContactForces(
                **{name: np.concatenate(each, axis=-1 if each[0].ndim == 1 else 1) for name, each in parts.items()}
            )
        return contacts

    def _on_wall(self, face: str) -> ContactForces:
        """Return the contacts of the spheres of the monitor with one wall."""
        space, columns, units = self.scene.space, self._motion[1], self.scene.units
        touch, place, *force = (columns[name] for name in wall_columns(face, "xyz"[:space]))
        ever = touch.any(axis=0)
        index, touches = self.spheres[ever], touch[:, ever] > 0
        axis, inward = FACES[face]
        n = np.zeros(space)
        n[axis] = -inward
        foot = (place - columns["xyz"[axis]])[:, ever] / units.number(self.scene.sphere.radius, length=1)
        vector = np.zeros((*foot.shape, space))
        vector[..., axis] = foot
        vector[~touches] = np.nan
        # the force is on the sphere
        pull = -np.stack(force, axis=-1)[:, ever] / units.number(force_of(self.scene), mass=1, length=1, time=-2)
        normal = pull @ n
        shear = pull - normal[..., None] * n if space == 3 else n[0] * pull[..., 1] - n[1] * pull[..., 0]
        overlap = (self.crystal.arrays["radius"][index] - np.abs(foot)) * self.scene.sphere.radius
        overlap = np.where(touches, overlap / self.scene.scale.length, np.nan)
        return ContactForces(
            index,
            np.full_like(index, -1),
            vector,
            normal,
            shear,
            overlap,
            np.zeros_like(shear),
            np.full(len(index), face),
        )

    def power(self, end: str) -> Floats:
        """Return the power P = F·v + T ω of each contact on the spheres at one end, (T, C), in k1 D0²/t0.

        Parameters
        ----------
        end : "i" or "j"
            The power is 0 for spheres outside the monitor, and for walls, which are at rest.
        """
        contacts, ratio = self.contacts, self.scene.scale.length / self.scene.sphere.radius
        index = getattr(contacts, end)
        place = np.searchsorted(self.spheres, index).clip(max=len(self.spheres) - 1)
        own = self.spheres[place] == index
        force = contacts.force if end == "j" else -contacts.force
        # lever arm in LAMMPS: each sphere has half of the overlap, a wall none
        shared = np.where(contacts.wall == "", np.nan_to_num(contacts.overlap) * ratio / 2, 0.0)
        arm = self.crystal.arrays["radius"][index] - shared
        turning = contacts.torque(end, arm) * self.spin[:, place]
        turning = turning if turning.ndim == 2 else turning.sum(axis=-1)
        return np.where(own, np.sum(force * self.velocity[:, place], axis=-1) + turning, 0.0)

    # --- energy flux ---

    @property
    def rows(self) -> Integers:
        """Rows of a monitor of whole rows, (R,)."""
        first, last = self.monitor.span
        return np.arange(first, last + 1)

    @cached_property
    def of_rows(self) -> dict[str, Floats]:
        """Quantities of a monitor of rows by name, (T, R) each; empty for other kinds."""
        kind = self.monitor.known
        return {name: _OF_ROWS[name](self) for name in kind.quantities} if kind.of == "row" else {}

    @property
    def flux(self) -> Floats:
        """Energy flux through each of `rows`, (T, R), positive along +y, in k1 D0²/t0.

        Raises
        ------
        RunFolderError
            If the monitor is of another kind.
        """
        if "flux" not in self.of_rows:
            raise RunFolderError(
                f'monitor {self.monitor.name}: what = "{self.monitor.what}": holds no flux; run its scene with '
                'what = "flux" for rows'
            )
        return self.of_rows["flux"]

    @property
    def watt(self) -> float:
        """Unit of power k1 D0²/t0, in W."""
        return si_of(POWER, self.scene)

    def columns(self) -> dict[str, NDArray[Any]]:
        """Return the record as dimensionless columns of equal length, time by time.

        Motion has a line for each time and sphere: tau, row, column, u, v, phi, and the rates u_t, v_t, phi_t. Contacts
        have a line for each time and contact: tau, row and column of both spheres, normal, shear, overlap, and rolling
        if contacts resist it; with walls also partner, "sphere" or "wall zlo", and a wall has row and column −1. Flux
        has a line for each time and row: tau, row, flux. In a crystal of several layers, layer follows column.
        """
        return self._many.columns()

    @property
    def _many(self) -> Many:
        kind = self.monitor.known.of
        if kind == "row":
            return Many(self.scene, self.tau, kind, {"row": self.rows}, {**self.of_rows})
        if kind == "contact":
            contacts = self.contacts
            which = places_of(self.crystal, contacts.i, "_i") | places_of(self.crystal, contacts.j, "_j")
            if self.walls:
                which["partner"] = np.array([f"wall {face}" if face else "sphere" for face in contacts.wall])
            rolls = ("rolling",) if self.scene.effects.rolling is True else ()
            values: dict[str, Floats] = {}
            for name in ("normal", "shear", "overlap", *rolls):
                values |= by_axis(name, getattr(contacts, name))
            return Many(self.scene, self.tau, kind, which, values)
        moving = components(self.displacement, self.rotation)
        moving |= rates(self.velocity, self.spin)
        return Many(self.scene, self.tau, kind, places_of(self.crystal, self.spheres), moving)

    def __repr__(self) -> str:
        return f"<MonitorRecord {self.monitor.name}: {self.monitor.what}, {self.monitor.places}, {self.folder}>"


def _flux(monitor: MonitorRecord) -> Floats:
    row, between = monitor.crystal.arrays["row"], monitor.contacts.wall == ""
    flux = np.zeros((len(monitor.tau), len(monitor.rows)))
    for end, other in (("i", "j"), ("j", "i")):
        of, to = (row[getattr(monitor.contacts, name)[between]] for name in (end, other))
        up = row_step(to - of, monitor.scene.shape)  # 1 if the contact leads to the row above
        flux -= monitor.power(end)[:, between] @ (0.5 * up[:, None] * (of[:, None] == monitor.rows))
    return flux


# Functions for the quantities of rows, by name
_OF_ROWS: dict[str, Callable[[MonitorRecord], Floats]] = {"flux": _flux}


def _cross(n: Floats, vectors: Floats) -> Floats:
    """Return n × v for rows of vectors: in the plane its component along z, (C,); in space (C, 3)."""
    if n.shape[1] == 3:
        return np.cross(n, vectors)
    return np.asarray(n[:, 0] * vectors[:, 1] - n[:, 1] * vectors[:, 0])
