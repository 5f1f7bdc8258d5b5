"""What the user declares: a scene, read from TOML, checked value by value, written back with every default filled in.

A scene has the tables ``[sphere]``, ``[packing]``, ``[wave]``, ``[time]``, ``[effects]`` and ``[output]``; each is a
frozen record whose fields carry their own range (`granular_lmp.fields`). Times are in units of t0 (τ), wave numbers in
rad per row, amplitudes in units of the static overlap Δ0. What is declared "auto" is decided here where it concerns
the packing (`Scene.shape`), and in `granular_lmp.effects` where it concerns the physics.
"""

import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import ceil, floor, inf, pi
from pathlib import Path
from typing import Any, Self

from granular_lmp.errors import SceneError
from granular_lmp.fields import (
    AUTO,
    NOT_TOML,
    Rule,
    allowed_names,
    between,
    checked_name,
    choice,
    cut,
    declared,
    file_text,
    first_file,
    one_line,
    plain,
    record,
    refuse_unknown,
    switch,
    toml_lines,
)
from granular_lmp.fields import assignment as assignment
from granular_lmp.shape import FEWEST_COLUMNS, LARGEST_CELL, SNAP, Auto, Shape, decide, echo_time, snapped
from granular_lmp.sphere import Sphere

SHIPPED = Path(__file__).parent.parent / "lammps_inputs"
MODES = ("L", "TR", "RT")
ENDS = ("fixed", "periodic", AUTO)
SHEAR_LAWS = ("secant", "incremental")


@dataclass(frozen=True)
class Packing:
    """Hexagonal packing: rows along y, the direction of propagation, columns along x, where it is periodic."""

    rows: int | Auto = declared(
        int,
        "along y, the direction of propagation",
        "a whole number from 4 to 10000000",
        between(4, 10_000_000),
        auto=True,
        default=AUTO,
    )
    columns: int | Auto = declared(
        int,
        "along x, periodic",
        "a whole number of at least 3 (with 1 or 2 columns a sphere touches two images of the same neighbour, "
        "which share one shear history in LAMMPS) and at most 1000000",
        between(FEWEST_COLUMNS, 1_000_000),
        auto=True,
        default=FEWEST_COLUMNS,
    )
    ends: str = choice("first and last row held, or a periodic cell", ENDS, default="fixed")
    contact_force: float = declared(
        float,
        "N, presses the contacts at rest together from outside",
        "a number in [0, 1e12], N",
        between(0, 1e12),
        default=0.0,
    )


@dataclass(frozen=True)
class Wave:
    """Plane wave cos(ξn − Ωτ + phase) along +y in one Bloch mode, n = 0 at the centre row, amplitude D0/Δ0."""

    mode: str = choice("longitudinal, transverse-rotational, rotational-transverse", MODES)
    wavenumber: float = declared(float, "xi, rad per row", "a number in [1e-9, pi], rad per row", between(1e-9, pi))
    amplitude: float = declared(
        float, "D0/Delta0", "a number in (0, 100], D0 in units of the static overlap", lambda value: 0 < value <= 100
    )
    phase: float = declared(
        float, "rad, at the centre row", "a number in [-2 pi, 2 pi], rad", between(-2 * pi, 2 * pi), default=0.0
    )


FINEST = 1e-9  # τ of a step and between records: 1e7 τ are 1e16 of them, and LAMMPS counts to 9e18
# Of each pair a scene holds one; `with_values` of one replaces the other.
EXCLUSIVE = {"time.tolerance": "time.timestep", "time.timestep": "time.tolerance"}


@dataclass(frozen=True)
class Time:
    """Duration, sampling, and step of the run in τ, or instead of the step the accuracy that is asked for.

    With a `tolerance` the step is chosen by `granular_lmp.steplaw`; until then there is none.
    """

    duration: float = declared(float, "tau", "a number in [1e-3, 1e7], in tau", between(1e-3, 1e7))
    timestep: float = declared(
        float, "tau, at most", f"a number in [{FINEST:g}, 2], in tau", between(FINEST, 2), default=0.05
    )
    tolerance: float | None = declared(
        float,
        "relative L2 error of p, q and phi each, in place of a timestep",
        "a number in [1e-9, 0.1], the relative error of p, q and phi each",
        between(1e-9, 0.1),
        default=None,
    )
    sample: float = declared(
        float, "tau between records", f"a number in [{FINEST:g}, 1e7], in tau", between(FINEST, 1e7), default=0.5
    )
    allow_echo: bool = declared(
        bool, "run on when the walls are heard at the centre", "true or false", lambda value: True, default=False
    )

    @property
    def steps_per_sample(self) -> int:
        """Whole steps between two records; the step is rounded down so that they fit.

        Raises
        ------
        SceneError
            With a tolerance: `granular_lmp.steplaw.with_step` gives the scene that has a step.
        """
        if self.tolerance is not None:
            raise SceneError(f"time.tolerance = {self.tolerance!r}: the scene has no time step until one is chosen")
        return ceil(self.sample / self.timestep - 1e-9)  # the same rule, with the same slack, is written in the deck

    @property
    def step(self) -> float:
        """Step that is used, in τ: ``sample / steps_per_sample``, at most ``timestep``."""
        return self.sample / self.steps_per_sample

    @property
    def samples(self) -> int:
        """Records after the one at τ = 0."""
        return floor(self.duration / self.sample + 1e-9)

    @property
    def steps(self) -> int:
        """Time steps of the whole run."""
        return self.samples * self.steps_per_sample


@dataclass(frozen=True)
class Effects:
    """Which physics the deck carries, each true, false or "auto", and the numbers that some of it needs.

    What "auto" comes to, and why, is the business of `granular_lmp.effects`. Walls and width of the packing are effects
    too; their switches are ``packing.ends`` and ``packing.columns``.
    """

    adhesion: bool | Auto = switch("DMT adhesion; without it the Hertz contact")
    shear: bool | Auto = switch("Mindlin shear force")
    rotation: bool | Auto = switch("spheres turn")
    tracking: bool | Auto = switch("the angle is recorded")
    sliding: bool | Auto = switch("contacts slide at the Coulomb limit of friction")
    damping: bool | Auto = switch("contacts dissipate by viscosity or restitution")
    contact_opening: bool | Auto = switch("contacts part and meet again")
    shear_law: str = choice("of the shear force", SHEAR_LAWS, default="secant")
    friction: float | Auto = declared(
        float,
        "coefficient; auto: none slides",
        "a number in (0, 1e4]",
        lambda value: 0 < value <= 1e4,
        auto=True,
        default=AUTO,
    )
    viscosity: float = declared(
        float, "N s/m, dashpot of a contact", "a number in [0, 1e12], N s/m", between(0, 1e12), default=0.0
    )
    restitution: float = declared(
        float, "of a Hertz contact; 1: none lost", "a number in (0, 1]", lambda value: 0 < value <= 1, default=1.0
    )


@dataclass(frozen=True)
class Output:
    """What a run records beside the centre sphere."""

    particles: float = declared(
        float,
        "tau between snapshots of all spheres; 0: none",
        "a number in [0, 1e7], in tau",
        between(0, 1e7),
        default=0.0,
    )


# The ranges of the sphere stand here and not in `Sphere`, which is plain physics and used by `analysis` too. They are
# those in which the numbers of the deck stay far from under- and overflow.
SPHERE_RULES = {
    name: Rule(float, note, allowed, check)
    for name, note, allowed, check in (
        ("radius", "m", "a number in [1e-9, 1], m", between(1e-9, 1.0)),
        ("youngs_modulus", "Pa", "a number in [1e3, 1e13], Pa", between(1e3, 1e13)),
        ("poisson_ratio", "", "a number in (-1, 0.5]", lambda value: -1 < value <= 0.5),
        (
            "work_of_adhesion",
            "J/m2",
            "0 or a number in [1e-6, 100], J/m2",
            lambda value: value == 0 or 1e-6 <= value <= 100,
        ),
        ("density", "kg/m3", "a number in [1, 1e5], kg/m3", between(1.0, 1e5)),
    )
}
_TABLES: dict[str, type] = {
    "sphere": Sphere,
    "packing": Packing,
    "wave": Wave,
    "time": Time,
    "effects": Effects,
    "output": Output,
}
_RULES = {"sphere": SPHERE_RULES}
_ATTRIBUTES = {"sphere": "material"}  # of the tables that a scene holds under another name


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
    """One simulation: spheres, packing, wave, time, effects and output.

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
            if key in EXCLUSIVE and EXCLUSIVE[key] not in changes:
                inner.pop(EXCLUSIVE[key].rpartition(".")[2], None)
            inner[name] = value
        return Scene.from_dict(tables)

    def __repr__(self) -> str:
        wave, shape = self.wave, self.shape
        return (
            f"<Scene {self.name}: {wave.mode} xi={self.wavenumber:g} a={wave.amplitude:g}, "
            f"{shape.rows} x {shape.columns} spheres, {shape.ends} ends, tau 0..{self.time.duration:g}>"
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
        return decide(packing.rows, packing.columns, packing.ends, self.wave.wavenumber, self.time.duration)

    @property
    def wavenumber(self) -> float:
        """ξ that is used, rad per row: as declared between fixed ends, the nearest 2πk/rows in a periodic cell."""
        if self.shape.ends == "fixed":
            return self.wave.wavenumber
        return snapped(self.wave.wavenumber, self.shape.rows)

    def remarks(self) -> list[str]:
        """What was changed to make the scene fit, a sentence each; nothing when it is used as declared."""
        said = []
        if AUTO in (self.packing.rows, self.packing.columns, self.packing.ends):
            said.append(f"the packing is {self.shape.rows} rows x {self.shape.columns} columns, {self.shape.ends} ends")
        if self.wavenumber != self.wave.wavenumber:
            cycles = round(self.wavenumber * self.shape.rows / (2 * pi))
            said.append(
                f"wave.wavenumber {self.wave.wavenumber!r} is snapped to {self.wavenumber!r} = "
                f"2 pi {cycles}/{self.shape.rows}, which fits the periodic cell"
            )
        if self.time.tolerance is None and self.time.step < self.time.timestep * (1 - 1e-9):
            said.append(
                f"time.timestep {self.time.timestep!r} is rounded down to {self.time.step!r}, "
                f"{self.time.steps_per_sample} to a sample"
            )
        return said

    @property
    def echo_time(self) -> float:
        """τ until which the centre sphere does not hear the walls (`echo_time`); infinite in a periodic cell."""
        return inf if self.shape.ends == "periodic" else echo_time(self.shape.rows)

    def __post_init__(self) -> None:
        self._check_sphere()
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

    def _check_packing(self) -> None:
        rows, columns, ends = self.shape.rows, self.shape.columns, self.shape.ends
        if self.packing.rows == AUTO and abs(self.wavenumber - self.wave.wavenumber) > SNAP:
            raise SceneError(
                f'packing.rows = "auto": no periodic cell of at most {LARGEST_CELL} rows carries wave.wavenumber = '
                f'{self.wave.wavenumber!r} to {SNAP:g}; must be a number, or packing.ends = "fixed"'
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
                f"wave.wavenumber = {self.wave.wavenumber!r}: snaps to 0 in a periodic cell of {rows} rows; "
                f"the smallest is 2 pi/{rows} = {2 * pi / rows:.6g}, rad per row"
            )
