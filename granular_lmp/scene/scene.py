"""What the user declares: a scene, read from TOML, checked value by value, written back with every default filled in.

A scene has the tables ``[sphere]``, ``[packing]``, ``[wave]``, ``[envelope]``, ``[time]``, ``[effects]`` and
``[output]`` (`granular_lmp.scene.sections`). Times are in units of t0 (τ), wave numbers in rad per row, amplitudes in
units of the static overlap Δ0. What is declared "auto" is decided here where it concerns the packing (`Scene.shape`),
and in `granular_lmp.effects` where it concerns the physics.
"""

from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass, replace
from functools import cached_property
from math import hypot, inf, pi
from pathlib import Path
from typing import Any, Self

from granular_lmp.crystal.lattices import Shape
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.wavevector import ROW_SPACING, WaveVector, zone_edge
from granular_lmp.errors import SceneError
from granular_lmp.scene import validation
from granular_lmp.scene.document import Document
from granular_lmp.scene.schema import AUTO, first_file, shown
from granular_lmp.scene.schema import assignment as assignment
from granular_lmp.scene.sections import SPHERE_RULES, Effects, Envelope, Output, Packing, Time, Wave
from granular_lmp.scene.shape import EXACT, FASTEST_ROWS_PER_TAU, Room, decide, echo_time
from granular_lmp.scene.shipped import SHIPPED
from granular_lmp.scene.validation import LARGEST_OVERLAP_RATIO as LARGEST_OVERLAP_RATIO

SECTIONS: dict[str, type] = {
    "sphere": Sphere,
    "packing": Packing,
    "wave": Wave,
    "envelope": Envelope,
    "time": Time,
    "effects": Effects,
    "output": Output,
}
SECTION_RULES = {"sphere": SPHERE_RULES}
EXCLUSIVE = {
    "time.tolerance": ("time.timestep",),
    "time.timestep": ("time.tolerance",),
    "wave.wavevector": ("wave.wavenumber", "wave.direction"),
}
FAR = 0.1  # of the wave vector: what snaps farther is another wave
DEVIATIONS = 10.0  # standard deviations of an envelope for which "auto" has room: what is cut off is below 4e-6


def note(key: str) -> str:
    """What a value of a scene is, by its dotted key: the comment behind it in a scene file, mostly a unit."""
    if key == "wave.wavevector":
        return "kx, ky, rad per lattice constant"
    table, _, name = key.rpartition(".")
    rule = SECTION_RULES.get(table, {}).get(name) or next(
        item.metadata["rule"] for item in fields(SECTIONS[table]) if item.name == name
    )
    return str(rule.note)


@dataclass(frozen=True, repr=False)
class Scene(Document):
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

    sections = SECTIONS
    rules = SECTION_RULES
    attributes = {"sphere": "material"}
    exclusive = EXCLUSIVE
    named = "the files of the run"

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
        """Scene from a TOML file, a folder that holds ``scene.toml``, or the name of a folder of ``lammps_inputs``.

        Its name, if it declares none, is the stem of the file, for ``scene.toml`` that of its folder.
        """
        path = Path(source)
        found = first_file(source, (path, path / "scene.toml", SHIPPED / path / "scene.toml"))
        if found is None:
            shipped = sorted(folder.parent.name for folder in SHIPPED.glob("*/scene.toml"))
            raise SceneError(f"{source}: no such scene file; shipped scenes: {', '.join(shipped) or 'none'}")
        return cls.read(found)

    @classmethod
    def completed(cls, tables: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the tables with a wave vector as wave number and direction; refuse a step beside a tolerance."""
        time = tables.get("time")
        if isinstance(time, Mapping) and {"timestep", "tolerance"} <= set(time):
            raise SceneError(
                f"time.tolerance = {shown(time['tolerance'])}: excludes time.timestep = {shown(time['timestep'])}; "
                "give one of the two"
            )
        return _without_wavevector(tables)

    def to_dict(self) -> dict[str, Any]:
        """Nested plain values, every default filled in; of the time step and the tolerance the one that is declared."""
        tables = super().to_dict()
        del tables["time"]["tolerance" if self.time.tolerance is None else "timestep"]
        return tables

    def departures(self) -> dict[str, Any]:
        """Return every value that is not its key's default, by dotted key; keys without a default are always there."""
        found: dict[str, Any] = {}
        for section in fields(self):
            value = getattr(self, section.name)
            if not is_dataclass(value):
                found |= {section.name: value} if value != _default(section) else {}
                continue
            key = next((name for name, held in self.attributes.items() if held == section.name), section.name)
            for item in fields(value):
                if getattr(value, item.name) != _default(item):
                    found[f"{key}.{item.name}"] = getattr(value, item.name)
        return found

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

    @property
    def displacement_amplitude(self) -> float:
        """D0 = a Δ0, m: the amplitude of the wave's displacement."""
        return self.wave.amplitude * self.sphere.static_overlap

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
    def _room(self) -> Room:
        """What the envelope takes: between walls with its offset, in a periodic cell with the way that it runs."""
        envelope, (x, y) = self.envelope, self.wave.vector.unit
        rows, columns = (DEVIATIONS * deviation for deviation in envelope.spread(self.wave.vector))
        way = FASTEST_ROWS_PER_TAU * self.time.duration if envelope.length else 0.0
        way *= 2 if self.wave.form == "standing" else 1  # its two halves part, and are not to meet again
        return Room(
            strip=rows + 2 * abs(envelope.offset),
            rows=rows + way * abs(y),
            columns=columns + way * abs(x) * ROW_SPACING,
            along=envelope.length > 0,
        )

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
        """Whether the wave is the paper's: a running plane wave up the rows."""
        running = self.wave.form == "running" and not self.envelope.finite
        return running and self.vector.axis == "y" and self.vector.per_row > 0

    @property
    def uniform_rows(self) -> bool:
        """Whether all spheres of a row move alike, so that 3 columns stand for any number."""
        return self.vector.axis == "y" and self.envelope.width == 0

    @property
    def along(self) -> str:
        """Where the wave runs, in words: "y", "x", "-y", or "49.1066 degrees"."""
        return {0.0: "x", 90.0: "y", -90.0: "-y", 180.0: "-x"}.get(self.direction, f"{self.direction:.6g} degrees")

    @property
    def wave_label(self) -> str:
        """The wave in the fewest words, for a repr: "TR xi=0.802 a=0.2"."""
        along = "" if self.along == "y" else f" along {self.along}"
        return f"{self.wave.words} xi={self.wavenumber:g}{along} a={self.wave.amplitude:g}"

    @property
    def wave_words(self) -> str:
        """The wave in a few words, for titles: "TR wave along y, xi = 0.802 rad per row, D0 = 0.2 Delta0"."""
        return (
            f"{self.wave.words} {self.envelope.kind} along {self.along}, xi = {self.wavenumber!r} rad per row, "
            f"D0 = {self.wave.amplitude!r} Delta0"
        )

    def remarks(self) -> list[str]:
        """What was changed to make the scene fit, a sentence each; nothing when it is used as declared."""
        said, shape = [], self.shape
        if AUTO in (self.packing.rows, self.packing.columns, self.packing.ends):
            said.append(f"the packing is {shape.rows} rows x {shape.columns} columns, {shape.ends} ends")
        moved = self.vector.per_column - self.wave.vector.per_column, self.vector.per_row - self.wave.vector.per_row
        if max(map(abs, moved)) > EXACT:
            said.append(self._snap_remark())
        if self.time.tolerance is None and self.time.step < self.time.timestep * (1 - 1e-9):
            said.append(
                f"time.timestep {self.time.timestep!r} is rounded down to {self.time.step!r}, "
                f"{self.time.steps_per_sample} to a sample"
            )
        return said

    def _snap_remark(self) -> str:
        vector, rows, columns = self.vector, self.shape.rows, self.shape.columns
        in_rows = round(vector.per_row * rows / (2 * pi))
        in_columns = round(vector.per_column * columns / (2 * pi))
        if self.wave.vector.axis == "y":
            return (
                f"wave.wavenumber {self.wave.wavenumber!r} is snapped to {self.wavenumber!r} = "
                f"2 pi {abs(in_rows)}/{rows}, which fits the periodic cell{self._how_far}"
            )
        return (
            f"wave.wavenumber {self.wave.wavenumber!r} at {self.wave.degrees!r} degrees is snapped to "
            f"{self.wavenumber!r} at {self.direction!r}, which fits the periodic cell: its phase advances by "
            f"2 pi {in_columns}/{columns} per column and 2 pi {in_rows}/{rows} per row{self._how_far}"
        )

    @property
    def _how_far(self) -> str:
        """A warning where the wave that is used is quite another one than was asked for."""
        (x, y), (declared_x, declared_y) = self.vector.components, self.wave.vector.components
        share = hypot(x - declared_x, y - declared_y) / hypot(declared_x, declared_y)
        return f"; that is {share:.0%} away: take more rows or columns" if share > FAR else ""

    @property
    def echo_time(self) -> float:
        """τ until which the centre sphere does not hear the walls (`echo_time`); infinite in a periodic cell."""
        return inf if self.shape.ends == "periodic" else echo_time(self.shape.rows, driven=self.wave.form == "driven")

    def __post_init__(self) -> None:
        wave, shape = self.wave, self.shape
        validation.check_sphere(self.material, self.sphere, self.effects, wave.amplitude)
        validation.check_wave(wave, self.envelope, self.packing, shape)
        validation.check_packing(self.packing, wave, self.envelope, shape, self.vector)
        validation.check_size(self.sphere, shape, wave.amplitude)
        validation.check_time(self.time, self.output, shape, self.echo_time)


def _default(item: Field[Any]) -> Any:
    """Return what a field holds if it is not given; MISSING if it must be given."""
    return item.default if item.default_factory is MISSING else item.default_factory()


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
    numbers = isinstance(pair, list | tuple) and [
        isinstance(x, int | float) and not isinstance(x, bool) and abs(x) < 1e3 for x in pair
    ]
    if numbers != [True, True] or not any(pair):
        raise SceneError(
            f"wave.wavevector = {shown(pair)}: must be two numbers [kx, ky], not both 0, rad per lattice constant"
        )
    vector = WaveVector(float(pair[0]) + 0.0, ROW_SPACING * float(pair[1]) + 0.0)  # + 0.0: no minus zeros
    edge = zone_edge(vector.direction) / ROW_SPACING
    if hypot(*vector.components) > edge * (1 + 1e-12):
        raise SceneError(
            f"wave.wavevector = {shown(pair)}: must be in the Brillouin zone, which ends at {edge:.6g} in its "
            "direction, rad per lattice constant"
        )
    return {**tables, "wave": rest | {"wavenumber": vector.wavenumber, "direction": vector.direction}}
