"""What the user declares: a scene, read from TOML, checked value by value, written back with every default filled in.

A scene has the tables ``[sphere]``, ``[packing]``, ``[wave]`` and ``[time]``; each is a frozen record whose fields
carry their own range, so that this one description serves reading, checking, writing and the error messages. Times are
in units of t0 (τ), wave numbers in rad per row, amplitudes in units of the static overlap Δ0.
"""

import json
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, asdict, dataclass, field, fields
from decimal import Decimal
from difflib import get_close_matches
from math import ceil, floor, inf, isfinite, pi
from pathlib import Path
from typing import Any, Self

from granular_lmp.errors import SceneError
from granular_lmp.sphere import Sphere

SHIPPED = Path(__file__).parent.parent / "lammps_inputs"
MODES = ("L", "TR", "RT")
ENDS = ("fixed", "periodic")

# A long wave of the L mode runs ½ row per τ (Ω = sin(ξ/2)); no branch of the lattice is faster.
FASTEST_ROWS_PER_TAU = 0.5


# --- one field: its range, in words and as a check -------------------------------------------------------------------


def _field(kind: type, note: str, allowed: str, check: Callable[[Any], bool], **default: Any) -> Any:
    return field(metadata={"kind": kind, "note": note, "allowed": allowed, "check": check}, **default)


def _choice(note: str, options: tuple[str, ...], **default: Any) -> Any:
    allowed = "one of " + ", ".join(f'"{option}"' for option in options)
    return _field(str, note, allowed, options.__contains__, **default)


def _between(low: float, high: float) -> Callable[[float], bool]:
    return lambda value: low <= value <= high


@dataclass(frozen=True)
class Packing:
    """Hexagonal packing: rows along y, the direction of propagation, columns along x, where it is periodic."""

    rows: int = _field(
        int, "along y, the direction of propagation", "a whole number from 4 to 10000000", _between(4, 10_000_000)
    )
    columns: int = _field(
        int,
        "along x, periodic",
        "a whole number of at least 3 (with 1 or 2 columns a sphere touches two images of the same neighbour, "
        "which share one shear history in LAMMPS) and at most 1000000",
        _between(3, 1_000_000),
        default=3,
    )
    ends: str = _choice("first and last row held, or a periodic cell", ENDS, default="fixed")

    @property
    def centre_row(self) -> int:
        """Row n = 0 of the wave, counted from 0."""
        return (self.rows - 1) // 2


@dataclass(frozen=True)
class Wave:
    """Plane wave cos(ξn − Ωτ + phase) along +y in one Bloch mode, n = 0 at the centre row, amplitude D0/Δ0."""

    mode: str = _choice("longitudinal, transverse-rotational, rotational-transverse", MODES)
    wavenumber: float = _field(
        float, "xi, rad per row", "a number in (0, pi], rad per row", lambda value: 0 < value <= pi
    )
    amplitude: float = _field(
        float, "D0/Delta0", "a number in (0, 100], D0 in units of the static overlap", lambda value: 0 < value <= 100
    )
    phase: float = _field(
        float, "rad, at the centre row", "a number in [-2 pi, 2 pi], rad", _between(-2 * pi, 2 * pi), default=0.0
    )


# Of each pair a scene holds one; `with_values` of one replaces the other.
EXCLUSIVE = {"time.tolerance": "time.timestep", "time.timestep": "time.tolerance"}


@dataclass(frozen=True)
class Time:
    """Duration, sampling, and step of the run in τ, or instead of the step the accuracy that is asked for.

    With a `tolerance` the step is chosen by `granular_lmp.steplaw`; until then there is none.
    """

    duration: float = _field(float, "tau", "a number in (0, 1e7], in tau", lambda value: 0 < value <= 1e7)
    timestep: float = _field(
        float, "tau, at most", "a number in (0, 2], in tau", lambda value: 0 < value <= 2, default=0.05
    )
    tolerance: float | None = _field(
        float,
        "relative L2 error of p, q and phi each, in place of a timestep",
        "a number in [1e-9, 0.1], the relative error of p, q and phi each",
        _between(1e-9, 0.1),
        default=None,
    )
    sample: float = _field(
        float, "tau between records", "a number in (0, 1e7], in tau", lambda value: 0 < value <= 1e7, default=0.5
    )
    allow_echo: bool = _field(
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


# The ranges of the sphere stand here and not in `Sphere`, which is plain physics and used by `analysis` too. They are
# those in which the numbers of the deck stay far from under- and overflow.
_SPHERE_RULES = {
    name: {"kind": float, "note": note, "allowed": allowed, "check": check}
    for name, note, allowed, check in (
        ("radius", "m", "a number in [1e-9, 1], m", _between(1e-9, 1.0)),
        ("youngs_modulus", "Pa", "a number in [1e3, 1e13], Pa", _between(1e3, 1e13)),
        ("poisson_ratio", "", "a number in (-1, 0.5]", lambda value: -1 < value <= 0.5),
        ("work_of_adhesion", "J/m2", "a number in [1e-6, 100], J/m2", _between(1e-6, 100.0)),
        ("density", "kg/m3", "a number in [1, 1e5], kg/m3", _between(1.0, 1e5)),
    )
}
_TABLES: dict[str, type] = {"sphere": Sphere, "packing": Packing, "wave": Wave, "time": Time}
# Rigid spheres with contact springs: LAMMPS's DEM contact laws are small-overlap laws.
LARGEST_OVERLAP_RATIO = 0.05
MOST_SPHERES = 10_000_000


@dataclass(frozen=True)
class Scene:
    """One simulation: spheres, packing, wave and time.

    Raises
    ------
    SceneError
        When the values do not go together: even rows between fixed ends, odd rows in a periodic cell, a time step
        beyond the stability limit, a duration beyond the echo of the walls (unless ``time.allow_echo``), a static
        overlap that is no longer small, D0 beyond R/10.
    """

    name: str
    sphere: Sphere
    packing: Packing
    wave: Wave
    time: Time

    # --- reading and writing ---

    @classmethod
    def load(cls, source: str | Path) -> Self:
        """Scene from a TOML file, a folder that holds ``scene.toml``, or the name of a folder of ``lammps_inputs``."""
        path = Path(source)
        candidates = [path, path / "scene.toml", SHIPPED / path / "scene.toml"]
        try:
            found = next((candidate for candidate in candidates if candidate.is_file()), None)
        except (OSError, ValueError) as error:
            raise SceneError(f"{_shown(source)}: no such scene file: {_one_line(error)}") from error
        if found is None:
            shipped = sorted(folder.parent.name for folder in SHIPPED.glob("*/scene.toml"))
            raise SceneError(f"{source}: no such scene file; shipped scenes: {', '.join(shipped) or 'none'}")
        try:
            text = found.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise SceneError(f"{found}: cannot be read as UTF-8 text: {_one_line(error)}") from error
        try:
            return cls.loads(text)
        except SceneError as error:
            raise SceneError(f"{found}: {error}") from error

    @classmethod
    def loads(cls, text: str) -> Self:
        """Scene from TOML text."""
        try:
            return cls.from_dict(tomllib.loads(text))
        except (tomllib.TOMLDecodeError, RecursionError) as error:
            raise SceneError(f"not valid TOML: {_one_line(error)}") from error

    @classmethod
    def from_dict(cls, tables: Mapping[str, Any]) -> Self:
        """Scene from nested mappings, as `to_dict` gives them; every key and value is checked."""
        _refuse_unknown(tables, ("name", *_TABLES), "")
        name = tables.get("name", "scene")
        if not isinstance(name, str) or not name.isascii() or not name.replace("_", "").replace("-", "").isalnum():
            raise SceneError(
                f"name = {name!r}: must be ASCII letters, digits, '-' and '_' (it names the files of the run)"
            )
        records = {key: _record(kind, tables.get(key), key) for key, kind in _TABLES.items()}
        if {"timestep", "tolerance"} <= set(tables["time"]):
            raise SceneError(
                f"time.tolerance = {tables['time']['tolerance']!r}: excludes time.timestep = "
                f"{tables['time']['timestep']!r}; give one of the two"
            )
        return cls(name=name, **records)

    def to_dict(self) -> dict[str, Any]:
        """Nested plain values, every default filled in; of the time step and the tolerance the one that is declared."""
        tables = asdict(self)
        del tables["time"]["tolerance" if self.time.tolerance is None else "timestep"]
        return tables

    def to_toml(self) -> str:
        """TOML text that `loads` reads back to an equal scene, a comment behind each value."""
        lines = [f'name = "{self.name}"']
        tables = self.to_dict()
        for table, kind in _TABLES.items():
            lines += ["", f"[{table}]"]
            notes = {item.name: _rule(item)["note"] for item in fields(kind)}
            for name, value in tables[table].items():
                line = f"{name} = {_toml(value)}"
                lines.append(f"{line:30} # {notes[name]}" if notes[name] else line)
        return "\n".join(lines) + "\n"

    def with_values(self, changes: Mapping[str, Any]) -> "Scene":
        """Copy with some values changed, named by dotted keys: ``{"wave.wavenumber": 1.2}``."""
        tables = self.to_dict()
        for key, value in changes.items():
            table, _, name = key.rpartition(".")
            if table and table not in _TABLES:
                raise SceneError(f"{key}: unknown key; {_allowed(table, _TABLES)}")
            if key in EXCLUSIVE and EXCLUSIVE[key] not in changes:
                tables[table].pop(EXCLUSIVE[key].rpartition(".")[2], None)
            (tables[table] if table else tables)[name] = value
        return Scene.from_dict(tables)

    # --- what follows from the values ---

    @property
    def wavenumber(self) -> float:
        """ξ that is used, rad per row: as declared between fixed ends, the nearest 2πk/rows in a periodic cell."""
        if self.packing.ends == "fixed":
            return self.wave.wavenumber
        return 2 * pi * round(self.wave.wavenumber * self.packing.rows / (2 * pi)) / self.packing.rows

    def remarks(self) -> list[str]:
        """What was changed to make the scene fit, a sentence each; nothing when it is used as declared."""
        said = []
        if self.wavenumber != self.wave.wavenumber:
            cycles = round(self.wavenumber * self.packing.rows / (2 * pi))
            said.append(
                f"wave.wavenumber {self.wave.wavenumber!r} is snapped to {self.wavenumber!r} = "
                f"2 pi {cycles}/{self.packing.rows}, which fits the periodic cell"
            )
        if self.time.tolerance is None and self.time.step < self.time.timestep * (1 - 1e-9):
            said.append(
                f"time.timestep {self.time.timestep!r} is rounded down to {self.time.step!r}, "
                f"{self.time.steps_per_sample} to a sample"
            )
        return said

    @property
    def echo_time(self) -> float:
        """τ until which the centre sphere does not hear the walls; infinite in a periodic cell.

        The wall disturbs the wave from τ = 0 on and the disturbance runs at most ½ row per τ. Ahead of that front the
        lattice response falls like an Airy function of width d^{1/3} rows after d rows; 3.5 widths ahead it is
        below 1e-6 of the wave.
        """
        if self.packing.ends == "periodic":
            return inf
        distance = self.packing.centre_row
        return max(0.0, distance - 3.5 * distance ** (1 / 3)) / FASTEST_ROWS_PER_TAU

    def __post_init__(self) -> None:
        rows, ends, time, sphere = self.packing.rows, self.packing.ends, self.time, self.sphere
        if ends == "fixed" and rows % 2 == 0:
            raise SceneError(f"packing.rows = {rows}: must be odd between fixed ends, so that there is a centre row")
        if ends == "periodic" and rows % 2:
            raise SceneError(f"packing.rows = {rows}: must be even in a periodic cell, where rows alternate")
        if rows * self.packing.columns > MOST_SPHERES:
            raise SceneError(
                f"packing.rows x packing.columns = {rows} x {self.packing.columns}: must be at most {MOST_SPHERES} "
                "spheres (LAMMPS takes 690 MB for each million)"
            )
        if sphere.overlap_ratio > LARGEST_OVERLAP_RATIO:
            raise SceneError(
                f"sphere: the static overlap is {sphere.overlap_ratio:.3g} of the diameter with this radius, "
                f"youngs_modulus and work_of_adhesion; at most {LARGEST_OVERLAP_RATIO} is allowed"
            )
        largest = sphere.radius / sphere.static_overlap / 10
        if self.wave.amplitude > largest:
            raise SceneError(f"wave.amplitude = {self.wave.amplitude!r}: must be at most {largest:.3g} (D0 = R/10)")
        if self.wavenumber == 0:
            lowest = 2 * pi / rows
            raise SceneError(
                f"wave.wavenumber = {self.wave.wavenumber!r}: snaps to 0 in a periodic cell of {rows} rows; "
                f"the smallest is 2 pi/{rows} = {lowest:.6g}, rad per row"
            )
        limit = 2 / sphere.highest_frequency
        if time.tolerance is None and time.step >= limit:
            raise SceneError(
                f"time.timestep = {time.timestep!r}: beyond the stability limit of velocity Verlet; "
                f"must be below 2/Omega_max = {limit:.6g}, in tau"
            )
        if time.sample > time.duration:
            raise SceneError(f"time.sample = {time.sample!r}: must be at most time.duration = {time.duration!r}")
        if time.duration > self.echo_time and not time.allow_echo:
            raise SceneError(
                f"time.duration = {time.duration!r}: the walls are heard at the centre of {rows} rows from "
                f"tau = {self.echo_time:.4g} on; must be at most that, or set time.allow_echo = true"
            )


# --- checking --------------------------------------------------------------------------------------------------------


def _toml(value: str | bool | int | float) -> str:
    """A scalar as TOML: floats in the shortest form that reads back, very large and small ones as 7.3e+10."""
    if isinstance(value, float) and not 1e-4 <= abs(value) < 1e6 and value:
        return f"{Decimal(repr(value)).normalize():e}"
    return json.dumps(value)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _allowed(key: str, names: Any) -> str:
    """The name that was meant, if one is close; else all that are allowed."""
    close = get_close_matches(key, list(names), n=1)
    return f"did you mean '{close[0]}'?" if close else f"allowed: {', '.join(names)}"


def _refuse_unknown(table: Mapping[str, Any], names: Any, prefix: str) -> None:
    for key in table:
        if key not in names:
            raise SceneError(f"{prefix}{key}: unknown key; {_allowed(key, names)}")


def _record(kind: type, table: Any, name: str) -> Any:
    """The record of type `kind` from the TOML table `name`, each value checked."""
    names = [item.name for item in fields(kind)]
    if table is None:
        raise SceneError(f"{name}: missing table; it holds {', '.join(names)}")
    if not isinstance(table, Mapping):
        raise SceneError(f"{name} = {table!r}: must be a table that holds {', '.join(names)}")
    _refuse_unknown(table, names, f"{name}.")
    values = {}
    for item in fields(kind):
        rule = _rule(item)
        if item.name in table:
            values[item.name] = _value(table[item.name], rule, f"{name}.{item.name}")
        elif item.default is MISSING:
            raise SceneError(f"{name}.{item.name}: missing key; must be {rule['allowed']}")
    return kind(**values)


def _rule(item: "Field[Any]") -> Mapping[str, Any]:
    return item.metadata or _SPHERE_RULES[item.name]


def _value(value: Any, rule: Mapping[str, Any], key: str) -> Any:
    """`value` as the rule's kind, or the error that says what is allowed."""
    kind = rule["kind"]
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value) if abs(value) < 1e300 else inf  # TOML writes 120 for 120.0
    right = isinstance(value, kind) and not (kind is int and isinstance(value, bool))
    if right and kind is float:
        right = isfinite(value)
    if not right or not rule["check"](value):
        raise SceneError(f"{key} = {_shown(value)}: must be {rule['allowed']}")
    return value


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def assignment(text: str) -> tuple[str, Any]:
    """``("wave.wavenumber", 1.2)`` from ``"wave.wavenumber=1.2"``; a value that is not TOML is taken as a bare word."""
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or not value.strip():
        raise SceneError(f"{text!r}: must be KEY=VALUE, for instance wave.wavenumber=1.2")
    try:
        return key.strip(), tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        return key.strip(), value.strip()
