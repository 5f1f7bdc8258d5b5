"""Record of an unnamed crystal: spheres of a foreign LAMMPS run without a known scene.

Its run folder holds ``run.json``, whose entry ``unnamed`` has all that is known of the crystal, and `UNNAMED`, a binary
dump of LAMMPS with unwrapped places and spheres in ascending order of id, which OVITO and ASE read too. Numbers are in
SI units; a dump in units lj keeps its own. A snapshot is read when it is used.
"""

from contextlib import suppress
from itertools import product
from math import pi
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.sphere import INERTIA_RATIO
from granular_lmp.errors import RunFolderError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.lammps.binary_dump import BinarySnapshot, binary_snapshots, snapshot_at
from granular_lmp.lammps.local_dump import ENDS
from granular_lmp.lammps.outputs import UNNAMED, UNNAMED_CONTACTS
from granular_lmp.runs.readouts import FEWEST_PERIODS, HARMONICS, harmonics
from granular_lmp.runs.record import Record
from granular_lmp.runs.seal import refuse_changed
from granular_lmp.runs.status import read_status
from granular_lmp.runs.tables import optional_package

__all__ = ["Unnamed"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

ENTRY = "unnamed"  # its entry in run.json
# Names of contact forces by LAMMPS's words for them
_FORCES = {"force": "normal", "p4": "shear", "fx": "normal_x", "fy": "normal_y", "fz": "normal_z"}
_FORCES |= {"p1": "shear_x", "p2": "shear_y", "p3": "shear_z"}
_COMPONENTS = ("fx", "fy", "fz", "p1", "p2", "p3")
_FLAT = 1e-9  # share of the size of a crystal below which differences of places along an axis are rounding


class Contacts(NamedTuple):
    """Contacts of spheres that overlap: indices of both spheres, (C,) each, and the overlap (C,), m."""

    first: Integers
    second: Integers
    overlap: Floats


@dataclass(frozen=True)
class Moment:
    """All spheres at one moment, in SI units; for a dump in units lj, in lj.

    Attributes
    ----------
    time : float
    place : (N, 3) array
        Unwrapped places.
    velocity : (N, 3) array
        Velocities from the dump; if it has none, from differences of places between snapshots.
    spin, force : (N, 3) arrays or None
        Angular velocities and forces from the dump; None if it has none.
    """

    time: float
    place: Floats
    velocity: Floats
    spin: Floats | None
    force: Floats | None


@dataclass(frozen=True)
class Unnamed:
    """Spheres of a foreign run over time, in SI units; for a dump in units lj, in lj.

    Attributes
    ----------
    folder : Path
        Run folder.
    info : dict
        Contents of ``run.json``.
    time : (T,) array
    steps : (T,) array of int
        Steps of the deck at which snapshots were written.
    begins : (T,) array of int
        Offset of each snapshot in the file, bytes.
    """

    folder: Path
    info: dict[str, Any]
    time: Floats
    steps: Integers
    begins: Integers

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """Return the record of a run folder made by `granular-lmp adopt DUMP`.

        Raises
        ------
        RunFolderError
            If the folder is not such a run folder, or its files were changed later.
        """
        folder = Path(folder)
        info = read_status(folder)
        if ENTRY not in info:
            raise RunFolderError(f"{folder}: is the run of a scene, not of an unnamed crystal")
        refuse_changed(folder, info, lazily=True)
        step, places = info[ENTRY]["timestep"], list(_places(folder / UNNAMED))
        times = [number * step if time is None else time for number, time, _ in places]
        steps, begins = (np.array([each[k] for each in places], dtype=np.int64) for k in (0, 2))
        return cls(folder, info, np.array(times), steps, begins)

    # --- the spheres ---

    @property
    def known(self) -> dict[str, Any]:
        """Return all that is known of the crystal: the entry ``unnamed`` of ``run.json``."""
        said: dict[str, Any] = self.info[ENTRY]
        return said

    @property
    def name(self) -> str:
        """Return the name of the run folder."""
        return self.folder.resolve().name

    @property
    def in_si(self) -> bool:
        """True if numbers are in SI units, False for units lj."""
        return bool(self.known["units"] != "lj")

    @cached_property
    def _first(self) -> BinarySnapshot:
        return self._snapshot(0)

    @cached_property
    def _kept(self) -> NDArray[np.bool_]:
        """Return which spheres of the first snapshot are in all of them."""
        return self._steady(self._first.table[:, 0])

    def _steady(self, ids: Floats) -> NDArray[np.bool_]:
        return ~np.isin(ids, self.known["come_and_go"])

    def _of_first(self, name: str) -> Floats | None:
        names = self._first.names
        return self._first.table[self._kept, names.index(name)] if name in names else None

    @cached_property
    def spheres(self) -> Integers:
        """Numbers (``id``) of the spheres in all snapshots, ascending, (N,)."""
        return self._first.table[self._kept, 0].astype(np.int64)

    @cached_property
    def types(self) -> Integers:
        """Type of each sphere, (N,); 1 if the dump has no types."""
        found = self._of_first("type")
        return np.ones(len(self.spheres), dtype=np.int64) if found is None else found.astype(np.int64)

    @cached_property
    def radius(self) -> Floats:
        """Radius of each sphere at the beginning, (N,)."""
        found = self._of_first("radius")
        assert found is not None  # `adopt_dump` asks for it
        return found

    @property
    def has_mass(self) -> bool:
        """True if the masses of the spheres are known."""
        return "mass" in self._first.names

    @cached_property
    def mass(self) -> Floats:
        """Mass of each sphere at the beginning, (N,).

        Raises
        ------
        RunFolderError
            If neither the dump nor the options of ``adopt`` gave masses or a density.
        """
        found = self._of_first("mass")
        if found is None:
            raise RunFolderError(f"{self.folder}: masses are unknown; adopt the dump again with density=VALUE")
        return found

    @cached_property
    def rest(self) -> Floats:
        """Places in the first snapshot, (N, 3), the origin of displacements."""
        return self[0].place

    @property
    def cell(self) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """Corner (3,), edges (3, 3) as rows, and periodic axes (3,) of the box at the beginning."""
        known = self.known
        return np.array(known["origin"]), np.array(known["cell"]), np.array(known["periodic"])

    @cached_property
    def axes(self) -> list[int]:
        """Axes along which the places of spheres differ: one for a chain along an axis, two for a sheet in a plane."""
        extents = np.ptp(self.rest, axis=0)
        return [axis for axis in range(3) if extents[axis] > _FLAT * extents.max()] or [0]

    # --- the motion ---

    def __len__(self) -> int:
        return len(self.time)

    def _snapshot(self, number: int) -> BinarySnapshot:
        begin = int(self.begins[number])
        return _snapshot_of(self.folder / UNNAMED, begin)

    def __getitem__(self, number: int) -> Moment:
        each = self._first if number == 0 else self._snapshot(number)
        table = each.table[self._steady(each.table[:, 0])]
        vectors = {name: _vector(table, each.names, name) for name in ("xu", "vx", "omegax", "fx")}
        place, velocity = vectors["xu"], vectors["vx"]
        assert place is not None  # `adopt_dump` writes them
        if velocity is None:
            velocity = self._difference(number, place)
        return Moment(float(self.time[number]), place, velocity, vectors["omegax"], vectors["fx"])

    def _difference(self, number: int, place: Floats) -> Floats:
        """Return velocities from places of adjacent snapshots: central differences, one-sided at both ends."""
        ends = max(number - 1, 0), min(number + 1, len(self) - 1)
        if ends[0] == ends[1]:
            return np.zeros_like(place)
        before, after = (place if end == number else self._place(end) for end in ends)
        return np.asarray((after - before) / (self.time[ends[1]] - self.time[ends[0]]))

    def _place(self, number: int) -> Floats:
        each = self._snapshot(number)
        found = _vector(each.table[self._steady(each.table[:, 0])], each.names, "xu")
        assert found is not None
        return found

    def stack(self, name: str) -> Floats:
        """Return "displacement" or an array of `Moment` by its name, over all snapshots, (T, N, 3).

        Raises
        ------
        RunFolderError
            If the dump has no such array.
        """
        moments = map(self.__getitem__, range(len(self)))
        if name == "displacement":
            return np.array([each.place - self.rest for each in moments])
        found = [getattr(each, name) for each in moments]
        if any(each is None for each in found):
            raise RunFolderError(f"{self.folder}: its dump has no {name}")
        return np.array(found)

    def kinetic_energy(self, moment: Moment) -> Floats:
        """Return ½mv² + ½Iω² of each sphere, J, (N,)."""
        turning = 0.0 if moment.spin is None else INERTIA_RATIO * np.sum(moment.spin**2, axis=1) * self.radius**2
        return np.asarray(self.mass * (np.sum(moment.velocity**2, axis=1) + turning) / 2)

    def contacts(self, moment: Moment) -> Contacts:
        """Return the pairs of spheres that overlap at a moment, also across periodic faces of the box.

        Spheres that all lie in one plane z do not touch across z, as in LAMMPS's two dimensions.

        Raises
        ------
        RunFolderError
            If the box deforms.
        """
        from scipy.spatial import cKDTree  # kept out of start-up

        if self.known.get("deforms"):
            raise RunFolderError(f"{self.folder}: its box deforms, and contacts are known only in its first box")
        origin, cell, periodic = self.cell
        periodic = periodic & [True, True, bool(np.ptp(moment.place[:, 2]))]
        inside = (moment.place - origin) @ np.linalg.inv(cell)
        place = np.where(periodic, inside % 1.0, inside) @ cell
        tree, reach, found = cKDTree(place), 2 * float(self.radius.max()), []
        low, high = place.min(axis=0) - reach, place.max(axis=0) + reach
        for shift in product(*((-1, 0, 1) if each else (0,) for each in periodic)):
            if shift < (0, 0, 0):  # the opposite shift finds the same pairs
                continue
            image = place + np.array(shift) @ cell
            near = np.flatnonzero(np.all((image > low) & (image < high), axis=1))
            pairs = cKDTree(image[near]).sparse_distance_matrix(tree, reach, output_type="ndarray")
            first, second = near[pairs["i"]], pairs["j"].astype(np.int64)
            overlap = self.radius[first] + self.radius[second] - pairs["v"]
            touching = (overlap > 0) & ((first < second) | any(shift))
            found.append((first[touching], second[touching], overlap[touching]))
        one, other, overlap = (np.concatenate(each) for each in zip(*found, strict=True))
        order = np.lexsort((np.maximum(one, other), np.minimum(one, other)))
        return Contacts(np.minimum(one, other)[order], np.maximum(one, other)[order], overlap[order])

    def harmonics(self, frequency: float, way: Floats) -> dict[str, dict[str, list[float]]]:
        """Return the harmonics of a frequency (Hz) in the displacements "along" and "across" a unit vector (3,).

        For each direction, ``static``, ``1``, ``2`` and ``3`` are the root mean square over all spheres and its error,
        m (`granular_lmp.runs.readouts`). The direction across is the axis with the largest motion.

        Raises
        ------
        RunFolderError
            If snapshots are too far apart for the third harmonic, or the record is shorter than four periods.
        """
        pulsation, sample = 2 * pi * frequency, float(np.diff(self.time).max(initial=0.0))
        if not 0 < sample < pi / (HARMONICS * pulsation):
            raise RunFolderError(
                f"{self.folder}: snapshots are {sample:.4g} apart; must be below {pi / (HARMONICS * pulsation):.4g}, "
                f"half a period of harmonic {HARMONICS}"
            )
        if (self.time[-1] - self.time[0]) * frequency < FEWEST_PERIODS:
            raise RunFolderError(f"{self.folder}: holds fewer than {FEWEST_PERIODS} periods of {frequency:.6g} Hz")
        moved = self.stack("displacement")
        along = moved @ way
        rest = moved - along[..., None] * way
        across = rest[..., np.argmax(np.linalg.norm(rest, axis=(0, 1)))]  # along the axis with the largest motion
        return {
            name: dict(harmonics(self.time, values, pulsation))
            for name, values in {"along": along, "across": across}.items()
        }

    # --- for other programs ---

    @cached_property
    def _recorded(self) -> dict[int, int]:
        """Offset, by step, of each snapshot of the contacts from local dumps; {} without local dumps."""
        path = self.folder / UNNAMED_CONTACTS
        return {step: begin for step, _, begin in _places(path)} if path.is_file() else {}

    def recorded_contacts(self, number: int) -> dict[str, Floats]:
        """Return the contacts of a snapshot from local dumps, by LAMMPS's words; {} without such contacts.

        ``patom1`` and ``patom2`` are the spheres, (C,); ``dist`` is their distance, ``force`` the normal force and
        ``p4`` the shear force; ``fx``, ``fy``, ``fz`` and ``p1``, ``p2``, ``p3`` are the components of normal and shear
        force on the first sphere.
        """
        begin = self._recorded.get(int(self.steps[number]))
        if begin is None:
            return {}
        each = _snapshot_of(self.folder / UNNAMED_CONTACTS, begin)
        there = np.isin(each.table[:, [each.names.index(name) for name in ENDS]], self.spheres).all(axis=1)
        return dict(zip(each.names, each.table[there].T.copy(), strict=True))

    @property
    def contact_columns(self) -> dict[str, NDArray[Any]]:
        """Columns of equal length, a line for each time and contact: t_s, id_i, id_j, overlap_m.

        Contacts from local dumps, if there are any, also have the forces of these dumps: normal_N, shear_N, and the
        components of both on the sphere id_i.
        """
        if self._recorded:
            return self._recorded_columns()
        found = [self.contacts(self[number]) for number in range(len(self))]
        end = {"t": "_s", "overlap": "_m"} if self.in_si else {"t": "", "overlap": ""}
        return {
            f"t{end['t']}": np.repeat(self.time, [len(each.first) for each in found]),
            "id_i": self.spheres[np.concatenate([each.first for each in found])],
            "id_j": self.spheres[np.concatenate([each.second for each in found])],
            f"overlap{end['overlap']}": np.concatenate([each.overlap for each in found]),
        }

    def _recorded_columns(self) -> dict[str, NDArray[Any]]:
        numbers = [number for number, step in enumerate(self.steps.tolist()) if step in self._recorded]
        every = [self.recorded_contacts(number) for number in numbers]
        if not every:
            raise RunFolderError(f"{self.folder}: its contacts and its spheres have no step in common")
        columns = {name: np.concatenate([each[name] for each in every]) for name in every[0]}
        end = {name: unit if self.in_si else "" for name, unit in (("t", "_s"), ("m", "_m"), ("N", "_N"))}
        counts = [len(each[ENDS[0]]) for each in every]
        one, other = (columns[name].astype(np.int64) for name in ENDS)
        found: dict[str, NDArray[Any]] = {f"t{end['t']}": np.repeat(self.time[numbers], counts)}
        found |= {"id_i": np.minimum(one, other), "id_j": np.maximum(one, other)}
        on_first = np.where(one < other, 1.0, -1.0)  # LAMMPS's components act on the sphere that it names first
        columns |= {word: columns[word] * on_first for word in columns if word in _COMPONENTS}
        if "dist" in columns:
            radius = self.radius[np.searchsorted(self.spheres, one)] + self.radius[np.searchsorted(self.spheres, other)]
            found[f"overlap{end['m']}"] = radius - columns["dist"]
        return found | {f"{name}{end['N']}": columns[word] for word, name in _FORCES.items() if word in columns}

    @property
    def si(self) -> dict[str, NDArray[Any]]:
        """Columns of equal length in SI units, a line for each time and sphere: t_s, id, x_m, …, vx_m_s, …."""
        unit = {"time": "_s", "place": "_m", "velocity": "_m_s", "spin": "_rad_s", "force": "_N"}
        unit = unit if self.in_si else dict.fromkeys(unit, "")
        count = len(self.spheres)
        found: dict[str, NDArray[Any]] = {f"t{unit['time']}": np.repeat(self.time, count)}
        found["id"] = np.tile(self.spheres, len(self))
        moments = [self[number] for number in range(len(self))]
        for name, symbol in (("place", ""), ("velocity", "v"), ("spin", "omega"), ("force", "f")):
            values = [getattr(each, name) for each in moments]
            if values[0] is not None:
                for axis, letter in enumerate("xyz"):
                    found[f"{symbol}{letter}{unit[name]}"] = np.array([each[:, axis] for each in values]).ravel()
        if self.has_mass:
            energies = np.array([self.kinetic_energy(each) for each in moments])
            found["kinetic_energy" + "_J" * self.in_si] = energies.ravel()
        return found

    def to_pandas(self) -> Any:
        """Return `si` as a ``pandas.DataFrame``.

        Raises
        ------
        PackageMissingError
            If pandas is not installed.
        """
        return optional_package("pandas").DataFrame(self.si)

    def to_xarray(self) -> Any:
        """Return an ``xarray.Dataset`` of places and velocities, and of spins and forces if the dump has them.

        Raises
        ------
        PackageMissingError
            If xarray is not installed.
        """
        units = {"place": "m", "velocity": "m/s", "spin": "rad/s", "force": "N"}
        first = self[0]
        variables = {
            name: (("time", "sphere", "axis"), self.stack(name), {"units": unit if self.in_si else "lj"})
            for name, unit in units.items()
            if getattr(first, name) is not None
        }
        which = {"time": self.time, "id": ("sphere", self.spheres), "radius": ("sphere", self.radius), "axis": [*"xyz"]}
        return optional_package("xarray").Dataset(variables, which, {"units": "si" if self.in_si else "lj"})

    def __repr__(self) -> str:
        return f"<Unnamed {self.name}: {len(self.spheres)} spheres, {len(self)} snapshots>"


def is_unnamed(folder: str | Path) -> bool:
    """Return whether a folder is the run folder of an unnamed crystal; False if it cannot be read."""
    with suppress(RunFolderError):
        return ENTRY in read_status(folder, changed=True)
    return False


def load_any(folder: str | Path) -> Record | Unnamed:
    """Return the record of a finished run, or the unnamed crystal of a folder."""
    return Unnamed.load(folder) if is_unnamed(folder) else Record.load(folder)


def _places(path: Path) -> list[tuple[int, float | None, int]]:
    """Return step, time and offset of each snapshot of a binary dump."""
    return [(each.step, each.time, each.begin) for each in binary_snapshots(path)]


def _snapshot_of(path: Path, begin: int) -> BinarySnapshot:
    """Return the snapshot of a binary dump that begins at an offset."""
    with path.open("rb") as stream:
        found = snapshot_at(mmap(stream.fileno(), 0, access=ACCESS_READ), begin)
    if found is None:
        raise RunFolderError(f"{path}: the snapshot at byte {begin} is cut off")
    return found


def _vector(table: Floats, names: list[str], first: str) -> Floats | None:
    """Return the column `first` and the two after it, (N, 3); None if the table lacks it."""
    if first not in names:
        return None
    at = names.index(first)
    return table[:, at : at + 3].copy()
