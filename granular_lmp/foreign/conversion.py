"""Conversion of the snapshots of a foreign dump to SI units, and the facts collected from them."""

from collections.abc import Mapping, Sequence
from dataclasses import field
from math import inf, isfinite, pi
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import RunFolderError
from granular_lmp.foreign.laws import Law
from granular_lmp.foreign.outside import Outside
from granular_lmp.foreign.stages import Spheres
from granular_lmp.frozen import dataclass
from granular_lmp.lammps.binary_dump import binary_head
from granular_lmp.lammps.custom_dump import Frame, enclosing
from granular_lmp.scene.schema import allowed_names
from granular_lmp.units import STYLES

Floats = NDArray[np.float64]

# Columns of the folder's dump behind the places, and their dimension in mass, length and time
_VECTORS = {"v": (0, 1, -1), "omega": (0, 0, -1), "f": (1, 1, -2)}
_PLACE = ("xu", "yu", "zu")
_COARSE = 1e-3  # share of the largest displacement: with fewer than three digits a second harmonic is noise
_FAR = 0.25  # share of a period; at 0.5 two opposite displacements lead to the same image
_DIGITS = 3e-5  # relative difference of two densities that have the same masses and radii, printed by %g
_PRINTED = 5.1e-6  # relative difference of a number and its six digits
_STILL = 1e-12  # times the box: displacements below are rounding
_NAMED = 5  # a sentence names at most this many spheres


@dataclass(frozen=True)
class Known:
    """Quantities of a foreign run that are known without its dumps, in their units; the dumps must hold the others.

    Attributes
    ----------
    units : str, optional
        Style of LAMMPS: si, cgs, micro, nano or lj.
    timestep : float, optional
        Time of one step.
    radius, density : sequence of float, optional
        One number, or one for each type of spheres.
    laws : mapping of (int, int) to Law
        Law of each pair of types that is known; the witness uses it.
    spheres : Spheres, optional
        Spheres of the deck. Their radii, masses and types, by ``id``, replace those that the dump and `radius` and
        `density` lack.
    outside : Outside
        Actions on the spheres beside their contacts.
    """

    units: str | None = None
    timestep: float | None = None
    radius: Sequence[float] | None = None
    density: Sequence[float] | None = None
    laws: Mapping[tuple[int, int], Law] = field(default_factory=dict)
    spheres: Spheres | None = None
    outside: Outside = field(default_factory=Outside)

    def __post_init__(self) -> None:
        if self.units is not None and self.units not in STYLES:
            raise RunFolderError(f"units = {self.units!r}: {allowed_names(self.units, STYLES)}")
        for name in ("timestep", "radius", "density"):
            values = getattr(self, name)
            for value in () if values is None else np.atleast_1d(values):
                if not (value > 0 and isfinite(value)):
                    raise RunFolderError(f"{name} = {float(value)!r}: must be a number above 0")


class Conversion:
    """Snapshots that are read one after another, and the facts collected from them."""

    def __init__(self, known: Known) -> None:
        self.known = known
        self.remarks: list[str] = []
        self.first: Frame | None = None
        self.units = STYLES["si"]
        self.names: list[str] = []  # columns of the folder's dump
        self.ids = self.before = np.empty(0)  # spheres of the previous snapshot, and their places
        self.resolution = inf
        self.come_and_go: set[int] = set()
        self.begun = np.empty((0, 3))  # places in the first snapshot
        self.far = False
        self.largest = np.zeros(3)  # largest displacements from there along each axis
        self.deforms = False  # whether the box changes along a periodic axis

    def say(self, sentence: str) -> None:
        """Keep a remark."""
        self.remarks.append(sentence)

    def write(self, frame: Frame, stream: IO[bytes]) -> None:
        """Write a snapshot into the dump of the folder, in SI units (of units lj in these)."""
        units, table = self.units, self._table(frame)
        assert self.first is not None
        edges, first = frame.cell[frame.periodic], self.first.cell[frame.periodic]
        if not self.deforms and not np.allclose(edges, first, rtol=1e-9, atol=0.0):
            self.deforms = True
            self.say(f"step {frame.step}: the box has changed; contacts and their forces are refused")
        lacking = [name for name in self.names if name not in table]
        if lacking:
            raise RunFolderError(f"step {frame.step}: lacks the column {lacking[0]}, which earlier snapshots have")
        numbers = np.stack([table[name] for name in self.names], axis=1)
        bounds, tilt = enclosing(frame.origin, frame.cell)
        time = None if frame.time is None else float(units.si(frame.time, time=1))
        faces = [0 if each else 1 for each in frame.periodic]
        style = "lj" if units.style == "lj" else "si"
        box, tilts = units.si(bounds, length=1), units.si(tilt, length=1) if tilt.any() else None
        head = binary_head(frame.step, self.names, len(numbers), faces, box, tilt=tilts, units=style, time=time)
        stream.write(head)
        stream.write(numbers.data)

    def begin(self, frame: Frame) -> None:
        """Take units and columns from the first snapshot."""
        self.first = frame
        style = self.known.units or frame.units
        if style is None:
            raise RunFolderError(f"the dump does not state its units; give units=STYLE, one of {', '.join(STYLES)}")
        if frame.units not in (None, style):
            raise RunFolderError(f"units = {style!r}: the dump says units {frame.units}")
        if style not in STYLES:
            raise RunFolderError(f"the dump says units {style}: must be one of {', '.join(STYLES)}")
        if self.known.timestep is None and frame.time is None:
            raise RunFolderError("the dump does not state its times; give timestep=VALUE in its units")
        self.units = STYLES[style]
        if "vx" not in frame.columns:
            self.say("the dump holds no velocities; differences of places between its snapshots replace them")
        self._refuse_lacking(frame)
        self.names = [*self._table(frame)]

    def _refuse_lacking(self, frame: Frame) -> None:
        """Raise RunFolderError if the dump lacks places along an axis on which spheres of the deck differ."""
        known, names = self.known.spheres, frame.way[0]
        for axis, name in enumerate(names):
            if known is not None and name not in frame.columns and np.ptp(known.position[:, axis]) > known.radius.max():
                raise RunFolderError(f"the dump holds no {name}, and the spheres of the deck differ in it")

    def _table(self, frame: Frame) -> dict[str, Floats]:
        """Return the columns of a snapshot as the folder has them, in SI units."""
        columns, units = frame.columns, self.units
        ids = columns["id"]
        for name, values in columns.items():
            if not np.isfinite(values).all():
                where = ids[~np.isfinite(values)][0]
                raise RunFolderError(f"step {frame.step}: {name} of sphere {where:.0f} is not finite")
        if len(np.unique(ids)) < len(ids):
            raise RunFolderError(f"step {frame.step}: several spheres have the same id")
        table, known = {"id": ids, "type": self._types(columns, ids)}, self.known.spheres
        radius = _unrounded(columns.get("radius"), None if known is None else known.radius, known, ids)
        if self.known.radius is not None or (radius is None and known is None):
            radius = self._by_type("radius", self.known.radius, table["type"])
        elif radius is None and known is not None:
            radius = _by_id(known.radius, known, ids)
        assert radius is not None
        _refuse_another(frame.step, "radius", columns.get("radius"), radius)
        table["radius"] = units.si(radius, length=1)
        weight = _unrounded(columns.get("mass"), None if known is None else known.mass, known, ids)
        if weight is None and self.known.density is None and known is not None:
            weight = _by_id(known.mass, known, ids)
        if self.known.density is not None:
            density = self._by_type("density", self.known.density, table["type"])
            volume = 4 / 3 * pi * radius**3
            _refuse_another(frame.step, "density", None if weight is None else weight / volume, density)
            weight = volume * density if weight is None else weight
        if weight is not None:
            table["mass"] = units.si(weight, mass=1)
        places = self._followed(frame)
        table |= {name: units.si(places[:, axis], length=1) for axis, name in enumerate(_PLACE)}
        for name, (mass, length, time) in _VECTORS.items():
            there = [f"{name}{axis}" for axis in "xyz"]
            if not {*there} & columns.keys():
                continue
            for each in there:  # a sheet may have no vz
                table[each] = units.si(columns.get(each, np.zeros(len(ids))), mass=mass, length=length, time=time)
        return table

    def _types(self, columns: Mapping[str, Floats], ids: Floats) -> Floats:
        """Return the type of each sphere, by the dump or else by the deck; without both all spheres have type 1."""
        known = self.known.spheres
        if "type" in columns:
            return columns["type"]
        if known is not None and np.ptp(known.type):
            return _by_id(known.type.astype(float), known, ids)
        for name in ("radius", "density") if known is None else ():
            if len(getattr(self.known, name) or ()) > 1:
                raise RunFolderError(f"{name}: several numbers, but the dump holds no type; give one number")
        return np.ones(len(ids))

    def _by_type(self, name: str, values: Sequence[float] | None, types: Floats) -> Floats:
        if values is None:
            raise RunFolderError(f"the dump holds no {name} of the spheres; give {name}=VALUE in its units")
        kinds = int(types.max(initial=1))
        if len(values) not in (1, kinds) and len(values) < kinds:
            raise RunFolderError(f"{name}: {len(values)} numbers, but the spheres have {kinds} types")
        return np.asarray(values, dtype=float)[types.astype(int) - 1 if len(values) > 1 else np.zeros(len(types), int)]

    def _followed(self, frame: Frame) -> Floats:
        """Return unwrapped places; without image flags, each sphere takes the image nearest to its previous place."""
        places, wrapped = frame.places()
        ids = frame.columns["id"]
        if frame is not self.first:
            both, here, there = np.intersect1d(ids, self.ids, assume_unique=True, return_indices=True)
            self._say_changes(frame.step, ids, both)
            if wrapped:
                way = frame.nearest_image(places[here] - self.before[there])
                self._say_far(frame, way)
                places[here] = self.before[there] + way
        else:
            self.begun = places
        if len(places) == len(self.begun):
            self.largest = np.maximum(self.largest, np.abs(places - self.begun).max(axis=0, initial=0.0))
        self.ids, self.before = ids, places
        self.resolution = min(self.resolution, frame.resolution)
        return places

    def _say_far(self, frame: Frame, way: Floats) -> None:
        """Say once that spheres move so far between two snapshots that the nearest image may be the wrong one."""
        periods = np.abs(way @ np.linalg.inv(frame.cell)) * frame.periodic
        if periods.max(initial=0.0) > _FAR and not self.far:
            self.far = True
            self.say(
                f"step {frame.step}: spheres move by {periods.max():.2g} of a period between two snapshots, so "
                "that the nearest image may be the wrong one; write the dump with ix iy iz, or with xu yu zu"
            )

    def _say_changes(self, step: int, ids: Floats, both: Floats) -> None:
        changes = ("appears", "appear", np.setdiff1d(ids, both)), ("vanishes", "vanish", np.setdiff1d(self.ids, both))
        for one, several, others in changes:
            if len(others):
                said = ", ".join(f"{each:.0f}" for each in others[:_NAMED]) + ", …" * (len(others) > _NAMED)
                many = f"{len(others)} spheres {several}" if len(others) > 1 else f"1 sphere {one}"
                self.say(f"step {step}: {many} (id {said}); spheres that come or go are left out")
                self.come_and_go |= {int(each) for each in others}

    def _refuse_half(self, first: Frame) -> None:
        """Raise RunFolderError if the dump lacks the velocities along one of the axes along which spheres move."""
        lacking = [axis for axis in range(3) if f"v{'xyz'[axis]}" not in first.columns]
        for axis in lacking if len(lacking) < 3 else ():
            if self.largest[axis] > max(self.resolution, _STILL * float(np.ptp(first.cell))):
                raise RunFolderError(
                    f"the dump holds no v{'xyz'[axis]}, and spheres move along {'xyz'[axis]}; a dump must hold the "
                    "velocities along all of these axes, or none"
                )

    @property
    def _unlike_deck(self) -> dict[str, list[int]]:
        """Some spheres of the deck that the first snapshot lacks, and some of the snapshot that the deck lacks."""
        known, first = self.known.spheres, self.first
        assert first is not None
        there = first.columns["id"].astype(np.int64)
        ids = there if known is None else known.id
        either = {"absent": np.setdiff1d(ids, there), "strangers": np.setdiff1d(there, ids)}
        return {name: found[:_NAMED].tolist() for name, found in either.items()}

    def described(self, paths: Sequence[Path]) -> dict[str, Any]:
        """Return the entry of the crystal in ``run.json``."""
        first, units = self.first, self.units
        assert first is not None
        if {int(each) for each in self.ids} <= self.come_and_go:
            raise RunFolderError(f"{paths[0]}: no sphere is in all snapshots")
        self._refuse_half(first)
        largest = float(self.largest.max())
        if self.resolution > _COARSE * largest:
            unit = "units of length" if units.style == "lj" else "m"
            self.say(
                f"places are printed to {units.si(self.resolution, length=1):.1e} {unit}, and no sphere moves by more "
                f"than {units.si(largest, length=1):.1e} {unit}: displacements and overlaps are rounded; write it with "
                "dump_modify format float %.15g"
            )
        step = 0.0 if self.known.timestep is None else float(units.si(self.known.timestep, time=1))
        return {
            "units": units.style,
            "timestep": step,
            "dumps": [str(path) for path in paths],
            "origin": units.si(first.origin, length=1).tolist(),
            "cell": units.si(first.cell, length=1).tolist(),
            "periodic": first.periodic.tolist(),
            "deforms": self.deforms,
            "resolution": float(units.si(self.resolution, length=1)),
            "come_and_go": sorted(self.come_and_go),
            **self._unlike_deck,
            "laws": [{"types": [*types], **law.in_si(units)} for types, law in self.known.laws.items()],
            "outside": self.known.outside.in_si(units),
        }


def _refuse_another(step: int, name: str, said: Floats | None, given: Floats) -> None:
    """Raise RunFolderError if a dump holds another value of a quantity than the user gave."""
    if said is not None and not np.allclose(said, given, rtol=_DIGITS, atol=0.0):
        worst = int(np.argmax(np.abs(said / given - 1)))
        raise RunFolderError(
            f"{name} = {given[worst]:g}: the dump says {said[worst]:g} at step {step}; leave out {name}"
        )


def _unrounded(said: Floats | None, values: Floats | None, known: Spheres | None, ids: Floats) -> Floats | None:
    """Return values of a dump; the value of the deck replaces each that is equal to six digits, as %g prints them."""
    if said is None or values is None or known is None or not np.isin(ids, known.id).all():
        return said
    exact = _by_id(values, known, ids)
    return np.where(np.isclose(exact, said, rtol=_PRINTED, atol=0.0), exact, said)


def _by_id(values: Floats, known: Spheres, ids: Floats) -> Floats:
    """Return the values of those spheres of a deck that have these ``id``."""
    order = np.argsort(known.id)
    place = np.minimum(np.searchsorted(known.id[order], ids), len(order) - 1)
    if not np.array_equal(known.id[order][place], ids):
        missing = int(ids[known.id[order][place] != ids][0])
        raise RunFolderError(f"id {missing}: is in the dump, but not among the spheres of the deck when its run begins")
    return np.asarray(values[order][place])
