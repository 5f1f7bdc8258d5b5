"""What the user declares: a scene, read from TOML, checked value by value, written back with every default filled in.

A scene has the tables ``[sphere]``, ``[packing]``, ``[wave]``, ``[envelope]``, ``[time]``, ``[effects]`` and
``[output]`` (`granular_lmp.tables`). Times are in units of t0 (τ), wave numbers in rad per row, amplitudes in units of
the static overlap Δ0. What is declared "auto" is decided here where it concerns the packing (`Scene.shape`), and in
`granular_lmp.effects` where it concerns the physics.
"""

import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import ceil, hypot, inf, pi
from pathlib import Path
from typing import Any, Self

from granular_lmp.errors import SceneError
from granular_lmp.fields import (
    AUTO,
    NOT_TOML,
    allowed_names,
    checked_name,
    cut,
    file_text,
    first_file,
    one_line,
    plain,
    record,
    refuse_unknown,
    shown,
    toml_lines,
)
from granular_lmp.fields import assignment as assignment
from granular_lmp.shape import LARGEST_CELL, SNAP, Shape, decide, echo_time
from granular_lmp.sphere import Sphere
from granular_lmp.tables import MODES as MODES
from granular_lmp.tables import SPHERE_RULES, Effects, Envelope, Output, Packing, Time, Wave
from granular_lmp.wavevector import ROW_SPACING, WaveVector, zone_edge

SHIPPED = Path(__file__).parent.parent / "lammps_inputs"
_TABLES: dict[str, type] = {
    "sphere": Sphere,
    "packing": Packing,
    "wave": Wave,
    "envelope": Envelope,
    "time": Time,
    "effects": Effects,
    "output": Output,
}
_RULES = {"sphere": SPHERE_RULES}
_ATTRIBUTES = {"sphere": "material"}  # of the tables that a scene holds under another name
# Keys that a scene does not hold beside another; `with_values` of one takes the others out.
EXCLUSIVE = {
    "time.tolerance": ("time.timestep",),
    "time.timestep": ("time.tolerance",),
    "wave.wavevector": ("wave.wavenumber", "wave.direction"),
}
FEWEST_ROOM = 6.0  # standard deviations of the envelope that a packing must have room for
ENVELOPE_ROOM = 10.0  # and those that "auto" gives: what is cut off is then below 4e-6


def note(key: str) -> str:
    """What a value of a scene is, by its dotted key: the comment behind it in a scene file, mostly a unit."""
    table, _, name = key.rpartition(".")
    rule = _RULES.get(table, {}).get(name) or next(
        item.metadata["rule"] for item in fields(_TABLES[table]) if item.name == name
    )
    return str(rule.note)


# Rigid spheres with contact springs: LAMMPS's DEM contact laws are small-overlap laws.
LARGEST_OVERLAP_RATIO = 0.05
MOST_SPHERES = 10_000_000
EPSILON = sys.float_info.epsilon
FEWEST_ROUNDINGS = 100.0  # that the wave is above, or the record is noise, or nothing at all, without a sign of it


@dataclass(frozen=True, repr=False)
class Scene:
    """One simulation: spheres, packing, wave and its envelope, time, effects and output.

    `material` is the table ``[sphere]`` as declared; `sphere` is what the deck is made of: pressed by
    ``packing.contact_force``, and without work of adhesion where ``effects.adhesion`` is off.

    Raises
    ------
    SceneError
        When the values do not go together: nothing holds the lattice, even rows between fixed ends, odd rows in a
        periodic cell, a duration beyond the echo of the walls (unless ``time.allow_echo``), a static overlap that is no
        longer small, D0 beyond R/10, snapshots that fall between two records.
    """

    name: str
    material: Sphere
    packing: Packing
    wave: Wave
    time: Time
    envelope: Envelope = Envelope()
    effects: Effects = Effects()
    output: Output = Output()

    # --- reading and writing ---

    @classmethod
    def load(cls, source: str | Path) -> Self:
        """Scene from a TOML file, a folder that holds ``scene.toml``, or the name of a folder of ``lammps_inputs``."""
        path = Path(source)
        found = first_file(source, (path, path / "scene.toml", SHIPPED / path / "scene.toml"))
        if found is None:
            shipped = sorted(folder.parent.name for folder in SHIPPED.glob("*/scene.toml"))
            raise SceneError(f"{source}: no such scene file; shipped scenes: {', '.join(shipped) or 'none'}")
        text = file_text(found)
        try:
            return cls.loads(text)
        except SceneError as error:
            raise SceneError(f"{found}: {error}") from error

    @classmethod
    def loads(cls, text: str) -> Self:
        """Scene from TOML text."""
        try:
            tables = tomllib.loads(text)
        except NOT_TOML as error:
            raise SceneError(f"not valid TOML: {one_line(error)}") from error
        return cls.from_dict(tables)

    @classmethod
    def from_dict(cls, tables: Mapping[str, Any]) -> Self:
        """Scene from nested mappings, as `to_dict` gives them; every key and value is checked."""
        refuse_unknown(tables, ("name", *_TABLES), "")
        name = checked_name(tables, "scene", "the files of the run")
        tables = _without_wavevector(tables)
        records = {
            _ATTRIBUTES.get(key, key): record(kind, tables.get(key), key, _RULES.get(key))
            for key, kind in _TABLES.items()
        }
        if {"timestep", "tolerance"} <= set(tables["time"]):
            raise SceneError(
                f"time.tolerance = {tables['time']['tolerance']!r}: excludes time.timestep = "
                f"{tables['time']['timestep']!r}; give one of the two"
            )
        return cls(name=name, **records)

    def to_dict(self) -> dict[str, Any]:
        """Nested plain values, every default filled in; of the time step and the tolerance the one that is declared."""
        tables = {key: plain(getattr(self, _ATTRIBUTES.get(key, key)), _RULES.get(key)) for key in _TABLES}
        del tables["time"]["tolerance" if self.time.tolerance is None else "timestep"]
        return {"name": self.name} | tables

    def to_toml(self) -> str:
        """TOML text that `loads` reads back to an equal scene, a comment behind each value."""
        lines = [f'name = "{self.name}"']
        tables = self.to_dict()
        for key, kind in _TABLES.items():
            lines += ["", f"[{key}]", *toml_lines(kind, tables[key], _RULES.get(key))]
        return "\n".join(lines) + "\n"

    def with_values(self, changes: Mapping[str, Any]) -> "Scene":
        """Copy with some values changed, named by dotted keys: ``{"wave.wavenumber": 1.2}``."""
        tables = self.to_dict()
        for key, value in changes.items():
            table, _, name = key.rpartition(".")
            if table and table not in _TABLES:
                raise SceneError(f"{cut(key)}: unknown key; {allowed_names(table, _TABLES)}")
            inner = tables[table] if table else tables
            if not isinstance(inner, dict):
                break  # an earlier change put a value in the table's place, which is what is wrong
            for other in EXCLUSIVE.get(key, ()):
                if other not in changes:
                    inner.pop(other.rpartition(".")[2], None)
            inner[name] = value
        return Scene.from_dict(tables)

    def __repr__(self) -> str:
        shape = self.shape
        return (
            f"<Scene {self.name}: {self.wave_label}, {shape.rows} x {shape.columns} spheres, {shape.ends} ends, "
            f"tau 0..{self.time.duration:g}>"
        )

    # --- what follows from the values ---

    @cached_property
    def sphere(self) -> Sphere:
        """The spheres of the lattice at rest: as declared, pressed together, adhesive or not."""
        adhesion = 0.0 if self.effects.adhesion is False else self.material.work_of_adhesion
        return replace(self.material, work_of_adhesion=adhesion, contact_force=self.packing.contact_force)

    @cached_property
    def shape(self) -> Shape:
        """Rows, columns and ends, every "auto" decided."""
        packing = self.packing
        return decide(
            packing.rows,
            packing.columns,
            packing.ends,
            self.wave.vector,
            self.time.duration,
            room=self._room,
            driven=self.wave.form == "driven",
        )

    @property
    def _room(self) -> tuple[float, float]:
        """Rows and columns that the envelope takes; between walls also with its offset, in a cell it goes round."""
        along_x, along_y = self.wave.vector.unit
        length, width = self.envelope.length, self.envelope.width
        away = 0.0 if self.packing.ends == "periodic" else 2 * abs(self.envelope.offset)
        rows = hypot(length * along_y, width * along_x) * ENVELOPE_ROOM + away
        return rows, hypot(length * along_x, width * along_y) * ENVELOPE_ROOM * ROW_SPACING

    @cached_property
    def vector(self) -> WaveVector:
        """The wave vector that is used: as declared between fixed ends, the nearest one that a periodic cell holds."""
        if self.shape.ends == "fixed":
            return self.wave.vector
        return self.wave.vector.snapped(self.shape.rows, self.shape.columns)

    @property
    def wavenumber(self) -> float:
        """ξ that is used, rad per row."""
        return self.vector.wavenumber

    @property
    def direction(self) -> float:
        """The direction that is used, degrees from x towards y."""
        return self.vector.direction

    @property
    def plane_along_y(self) -> bool:
        """Whether the wave is the paper's: a running plane wave up the rows, to which the error laws apply."""
        running = self.wave.form == "running" and not self.envelope.finite
        return running and self.vector.axis == "y" and self.vector.per_row > 0

    @property
    def uniform_rows(self) -> bool:
        """Whether all spheres of a row move alike, so that 3 columns stand for any number."""
        return self.vector.axis == "y" and self.envelope.width == 0

    @property
    def wave_label(self) -> str:
        """The wave in the fewest words, for a repr: "TR xi=0.802 a=0.2"."""
        form = "" if self.wave.form == "running" else f" {self.wave.form}"
        along = "" if self.direction == 90 else f" at {self.direction:.4g} deg"
        return f"{self.wave.mode}{form} xi={self.wavenumber:g}{along} a={self.wave.amplitude:g}"

    @property
    def wave_words(self) -> str:
        """The wave in a few words, for titles: "TR wave along y, xi = 0.802 rad per row, D0 = 0.2 Delta0"."""
        form = "" if self.wave.form == "running" else f" {self.wave.form}"
        shape = {(True, False): "packet", (False, True): "beam", (True, True): "pulse"}
        kind = shape.get((self.envelope.length > 0, self.envelope.width > 0), "wave")
        along = {0.0: "x", 90.0: "y"}.get(self.direction, f"{self.direction:.6g} degrees")
        return (
            f"{self.wave.mode}{form} {kind} along {along}, xi = {self.wavenumber!r} rad per row, "
            f"D0 = {self.wave.amplitude!r} Delta0"
        )

    def remarks(self) -> list[str]:
        """What was changed to make the scene fit, a sentence each; nothing when it is used as declared."""
        said = []
        if AUTO in (self.packing.rows, self.packing.columns, self.packing.ends):
            said.append(f"the packing is {self.shape.rows} rows x {self.shape.columns} columns, {self.shape.ends} ends")
        if self.vector != self.wave.vector:
            said.append(self._snap_remark())
        if self.time.tolerance is None and self.time.step < self.time.timestep * (1 - 1e-9):
            said.append(
                f"time.timestep {self.time.timestep!r} is rounded down to {self.time.step!r}, "
                f"{self.time.steps_per_sample} to a sample"
            )
        return said

    def _snap_remark(self) -> str:
        rows, columns = self.shape.rows, self.shape.columns
        in_rows = round(self.vector.per_row * rows / (2 * pi))
        in_columns = round(self.vector.per_column * columns / (2 * pi))
        if self.wave.vector.axis == "y":
            return (
                f"wave.wavenumber {self.wave.wavenumber!r} is snapped to {self.wavenumber!r} = "
                f"2 pi {in_rows}/{rows}, which fits the periodic cell"
            )
        return (
            f"wave.wavenumber {self.wave.wavenumber!r} at {self.wave.degrees!r} degrees is snapped to "
            f"{self.wavenumber!r} at {self.direction!r}, which fits the periodic cell: its phase advances by "
            f"2 pi {in_columns}/{columns} per column and 2 pi {in_rows}/{rows} per row"
        )

    @property
    def echo_time(self) -> float:
        """τ until which the centre sphere does not hear the walls (`echo_time`); infinite in a periodic cell."""
        return inf if self.shape.ends == "periodic" else echo_time(self.shape.rows, driven=self.wave.form == "driven")

    def __post_init__(self) -> None:
        self._check_sphere()
        self._check_wave()
        self._check_packing()
        time = self.time
        if time.sample > time.duration:
            raise SceneError(f"time.sample = {time.sample!r}: must be at most time.duration = {time.duration!r}")
        if time.duration > self.echo_time and not time.allow_echo:
            raise SceneError(
                f"time.duration = {time.duration!r}: the walls are heard at the centre of {self.shape.rows} rows from "
                f"tau = {self.echo_time:.4g} on; must be at most that, or set time.allow_echo = true, "
                'or packing.rows = "auto"'
            )
        snapshot = self.output.particles / time.sample
        # The slack is that of the deck, where the spacing of the snapshots is rounded up to whole samples
        if abs(snapshot - round(snapshot)) > 1e-9 or self.output.particles > time.duration:
            raise SceneError(
                f"output.particles = {self.output.particles!r}: must be 0 or a whole multiple of time.sample = "
                f"{time.sample!r}, at most time.duration = {time.duration!r}"
            )

    def _check_sphere(self) -> None:
        if self.sphere.holding_force == 0:
            raise SceneError(
                "packing.contact_force = 0.0: must be above 0 where no adhesion holds the spheres together "
                f"(sphere.work_of_adhesion = {self.material.work_of_adhesion!r}, "
                f"effects.adhesion = {self.effects.adhesion!r})"
            )
        effects = self.effects
        if effects.viscosity > 0 and effects.restitution < 1:
            raise SceneError(
                f"effects.viscosity = {effects.viscosity!r} and effects.restitution = {effects.restitution!r}: "
                "two models of damping; must be one"
            )
        if effects.adhesion is True and self.material.work_of_adhesion == 0:
            raise SceneError("effects.adhesion = true: needs sphere.work_of_adhesion above 0, J/m2")
        if self.sphere.overlap_ratio > LARGEST_OVERLAP_RATIO:
            raise SceneError(
                f"sphere: the static overlap is {self.sphere.overlap_ratio:.3g} of the diameter with this radius, "
                f"youngs_modulus, work_of_adhesion and contact_force; at most {LARGEST_OVERLAP_RATIO} is allowed"
            )
        largest = self.sphere.radius / self.sphere.static_overlap / 10
        if self.wave.amplitude > largest:
            raise SceneError(f"wave.amplitude = {self.wave.amplitude!r}: must be at most {largest:.3g} (D0 = R/10)")

    def _check_wave(self) -> None:
        wave, envelope, edge = self.wave, self.envelope, zone_edge(self.wave.degrees)
        if wave.wavenumber > edge * (1 + EPSILON * 8):
            raise SceneError(
                f"wave.wavenumber = {wave.wavenumber!r}: must be a number in [1e-9, {edge:.6g}], rad per row; the "
                f"Brillouin zone ends there in wave.direction = {wave.direction!r}"
            )
        along_y = wave.vector.axis == "y"
        if not along_y and self.shape.ends == "fixed":
            raise SceneError(
                f'wave.direction = {wave.direction!r}: must be "y" between fixed ends; other directions need '
                'packing.ends = "periodic" or "auto"'
            )
        if wave.vector.axis is None and (envelope.length > 0) != (envelope.width > 0):
            raise SceneError(
                f"envelope.length = {envelope.length!r} and envelope.width = {envelope.width!r}: must be both 0 or "
                f"both above in wave.direction = {wave.direction!r}, along which nothing fits a periodic cell"
            )
        if wave.form == "driven":
            self._check_drive()
        if self.time.tolerance is not None and not self.plane_along_y:
            raise SceneError(
                f"time.tolerance = {self.time.tolerance!r}: must be a time.timestep for this wave; the law by which "
                "the step is chosen holds for a running plane wave along y"
            )

    def _check_drive(self) -> None:
        """A driven row is the first of a strip."""
        needed = {
            "wave.direction": (self.wave.direction, self.wave.degrees == 90, '"y"'),
            "packing.ends": (self.packing.ends, self.shape.ends == "fixed", '"fixed" or "auto"'),
            "envelope.length": (self.envelope.length, self.envelope.length == 0, "0"),
            "envelope.offset": (self.envelope.offset, self.envelope.offset == 0, "0"),
        }
        for key, (value, right, allowed) in needed.items():
            if not right:
                raise SceneError(f'{key} = {shown(value)}: must be {allowed} with wave.form = "driven"')

    def _check_packing(self) -> None:
        rows, columns, ends = self.shape.rows, self.shape.columns, self.shape.ends
        declared, used = self.wave.vector, self.vector
        missed = {
            "rows": abs(used.per_row - declared.per_row) if self.packing.rows == AUTO else 0.0,
            "columns": abs(used.per_column - declared.per_column) if self.packing.columns == AUTO else 0.0,
        }
        for name, miss in missed.items():
            if miss > SNAP:
                raise SceneError(
                    f'packing.{name} = "auto": no periodic cell of at most {LARGEST_CELL} {name} carries '
                    f"wave.wavenumber = {self.wave.wavenumber!r} to {SNAP:g}; must be a number"
                    + ', or packing.ends = "fixed"'
                    * (declared.axis == "y")
                )
        for name, count, room in zip(("rows", "columns"), (rows, columns), self._room, strict=True):
            if count < FEWEST_ROOM / ENVELOPE_ROOM * room:
                raise SceneError(
                    f"packing.{name} = {count}: must be at least {ceil(FEWEST_ROOM / ENVELOPE_ROOM * room)}, "
                    f"{FEWEST_ROOM:g} standard deviations of the envelope"
                )
        if ends == "fixed" and rows % 2 == 0:
            raise SceneError(f"packing.rows = {rows}: must be odd between fixed ends, so that there is a centre row")
        if ends == "periodic" and rows % 2:
            raise SceneError(f"packing.rows = {rows}: must be even in a periodic cell, where rows alternate")
        if rows * columns > MOST_SPHERES:
            raise SceneError(
                f"packing.rows x packing.columns = {rows} x {columns}: must be at most {MOST_SPHERES} "
                "spheres (LAMMPS takes 690 MB for each million)"
            )
        # Half the packing is farther from the origin than a quarter of its length; there the wave has to be seen
        smallest = FEWEST_ROUNDINGS * EPSILON * rows / 4 * self.sphere.lattice_constant / self.sphere.static_overlap
        if self.wave.amplitude < smallest:
            raise SceneError(
                f"wave.amplitude = {self.wave.amplitude!r}: must be at least {smallest:.3g} with this sphere in {rows} "
                f"rows, or D0 is less than {FEWEST_ROUNDINGS:g} roundings of a position"
            )
        if self.wavenumber == 0:
            raise SceneError(
                f"wave.wavenumber = {self.wave.wavenumber!r}: snaps to 0 in a periodic cell of {rows} rows x {columns} "
                f"columns; the smallest is 2 pi/{rows} = {2 * pi / rows:.6g}, rad per row, along y"
            )


def _without_wavevector(tables: Mapping[str, Any]) -> Mapping[str, Any]:
    """The tables with ``wave.wavevector``, [kx, ky] in rad per lattice constant, as wave number and direction.

    Raises
    ------
    SceneError
        For one that is none, or stands beside what it replaces.
    """
    wave = tables.get("wave")
    if not isinstance(wave, Mapping) or "wavevector" not in wave:
        return tables
    pair, rest = wave["wavevector"], {key: value for key, value in wave.items() if key != "wavevector"}
    for key in ("wavenumber", "direction"):
        if key in rest:
            raise SceneError(f"wave.wavevector = {shown(pair)}: excludes wave.{key} = {shown(rest[key])}; give one")
    numbers = isinstance(pair, list | tuple) and [isinstance(x, int | float) and abs(x) < 1e3 for x in pair]
    if numbers != [True, True] or not any(pair):
        raise SceneError(
            f"wave.wavevector = {shown(pair)}: must be two numbers [kx, ky], not both 0, rad per lattice constant"
        )
    vector = WaveVector(float(pair[0]), ROW_SPACING * float(pair[1]))
    return {**tables, "wave": rest | {"wavenumber": vector.wavenumber, "direction": vector.direction}}
