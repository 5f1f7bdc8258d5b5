"""Scene: the declaration of the user, read from TOML, checked value by value, and written back with every default.

A scene has the tables ``[sphere]``, ``[packing]``, ``[contact]``, ``[substrate]``, ``[disorder]``, ``[wave]``,
``[envelope]``, ``[time]``,
``[effects]``, ``[output]``, ``[absorb]`` and ``[start]`` (`granular_lmp.scene.sections`), and any number of
``[[inclusion]]``, ``[[pair]]``, ``[[source]]`` (`granular_lmp.scene.sources`), ``[[monitor]]``
(`granular_lmp.scene.monitors`) and
``[[striker]]`` (`granular_lmp.scene.strikers`). Times are in units of t0 (τ), wave numbers in rad per row, amplitudes
in units of the static overlap Δ0. An "auto" of the packing is decided here (`Scene.shape`), an "auto" of the physics
in `granular_lmp.effects`.

A scene without ``[wave]`` has strikers, a state or sources. Spheres that adhere, or a sheet that is pressed together,
are held at rest, and the units are those of a wave. Spheres that just touch, a sheet with gaps, and a compressed chain
are not held (`granular_lmp.rest.holding`); their times are in t0 of the impact (`granular_lmp.crystal.scale`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Self

from granular_lmp.card import HasCard
from granular_lmp.crystal.disorder import Disorder, Inclusion
from granular_lmp.crystal.lattices import QUIET
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.stiffnesses import Pair
from granular_lmp.errors import SceneError
from granular_lmp.frozen import cached_property, dataclass
from granular_lmp.rest.derived import Derived
from granular_lmp.rest.frequency import with_placeholder, without_wavevector
from granular_lmp.rest.refusals import refuse
from granular_lmp.rest.refusals_of_values import adhesion_law, spheres_at_rest
from granular_lmp.scene.bodies import (
    Contact,
    Substrate,
)
from granular_lmp.scene.files import assignment as assignment
from granular_lmp.scene.files import first_file
from granular_lmp.scene.monitors import Monitor
from granular_lmp.scene.records import without_defaults
from granular_lmp.scene.samples import located
from granular_lmp.scene.schema import AUTO, allowed_names, default_name
from granular_lmp.scene.sections import (
    Absorb,
    Effects,
    Envelope,
    Output,
    Packing,
    Time,
    Wave,
    refuse_step_beside_tolerance,
)
from granular_lmp.scene.shipped import SHIPPED
from granular_lmp.scene.sources import Source
from granular_lmp.scene.sphere_table import located as located_table
from granular_lmp.scene.start import Start
from granular_lmp.scene.start import located as located_state
from granular_lmp.scene.strikers import Striker
from granular_lmp.scene.without_wave import WAVE

__all__ = ["Scene"]


@dataclass(frozen=True, repr=False, init=False)
class Scene(HasCard, Derived):
    """Simulation: spheres, packing and its imperfections, wave and its envelope, time, effects and output.

    `material` is the table ``[sphere]`` as declared. `sphere` is the sphere of the deck, which includes
    ``packing.contact_force`` and has no work of adhesion if ``effects.adhesion`` is off.

    Raises
    ------
    SceneError
        If the values contradict each other: nothing holds the lattice together, even rows between fixed ends, odd
        rows in a periodic cell, a duration beyond the echo of the walls (unless ``time.allow_echo``), a static overlap
        that is not small, D0 beyond R/10, or snapshots between two records. `granular_lmp.rest.refusals` lists all
        cases.

    Notes
    -----
    A scene is frozen: `with_values` returns a copy with other values, and `replace` one with other tables.
    `dataclasses.replace` takes records without checks of their ranges, and does not solve for a frequency again::

        Scene(
            sphere=Sphere(5e-7, 73e9, 0.17, 0.063, 2200.0),
            packing=Packing(rows=201),
            wave=Wave(mode="TR", wavenumber=0.802, amplitude=0.2),
            time=Time(duration=120.0),
        )

    Examples
    --------
    >>> scene = Scene.load("tr_periodic").with_values({"wave.amplitude": 0.1, "time.duration": 4.0})
    >>> scene.wave.amplitude, scene.shape.rows
    (0.1, 16)
    >>> Scene.loads(scene.to_toml()) == Scene.from_dict(scene.to_dict()) == scene
    True
    """

    # --- reading and writing ---

    def __init__(
        self,
        *,
        packing: Packing,
        time: Time,
        sphere: Sphere | None = None,
        material: Sphere | None = None,
        name: str = "scene",
        description: str = "",
        wave: Wave | None = None,
        envelope: Envelope | None = None,
        effects: Effects | None = None,
        output: Output | None = None,
        absorb: Absorb | None = None,
        contact: Contact | None = None,
        substrate: Substrate | None = None,
        disorder: Disorder | None = None,
        start: Start | None = None,
        inclusion: Sequence[Inclusion] = (),
        pair: Sequence[Pair] = (),
        source: Sequence[Source] = (),
        monitor: Sequence[Monitor] = (),
        striker: Sequence[Striker] = (),
    ) -> None:
        tables: dict[str, Any] = {
            "name": name,
            "description": description,
            "packing": packing,
            "time": time,
            "sphere": sphere,
            "wave": wave,
            "envelope": envelope,
            "effects": effects,
            "output": output,
            "absorb": absorb,
            "contact": contact,
            "substrate": substrate,
            "disorder": disorder,
            "start": start,
            "inclusion": inclusion,
            "pair": pair,
            "source": source,
            "monitor": monitor,
            "striker": striker,
        }
        if material is None:
            made = self.from_dict(self._plain_tables(tables))
        else:  # all fields of a scene, some of which are changed
            made = self._of_fields(tables | {"material": tables.pop("sphere") or material})
        self.__dict__.update(made.__dict__)

    @classmethod
    def _of_fields(cls, values: Mapping[str, Any]) -> Self:
        """Return the scene with these fields, after a check of their combination."""
        scene = cls._unchecked(values)
        refuse(scene, scene._variant)
        return scene

    @classmethod
    def _unchecked(cls, values: Mapping[str, Any]) -> Self:
        scene = object.__new__(cls)
        scene.__dict__.update({item.name: _default(item) for item in fields(cls)} | dict(values))
        return scene

    @classmethod
    def load(cls, source: str | Path, changes: Mapping[str, Any] | None = None) -> Self:
        """Read a scene from a TOML file, a folder with a ``scene.toml``, or by the name of a shipped scene.

        Parameters
        ----------
        source : path
            File, folder, or name of a folder or a collision of ``lammps_inputs``. A scene that declares no name is
            named after the stem of the file, or after the folder of its ``scene.toml``.
        changes : mapping, optional
            Values of dotted keys, as for `with_values`, that replace values in the file before any check. Keys of a
            collision change the collision.

        Raises
        ------
        SceneError
            If there is no such file, it is not a scene, or a value is out of range.
        """
        path = Path(source)
        folders = (path, SHIPPED / path, SHIPPED / "impacts" / path)
        places = (path, *(folder / "scene.toml" for folder in folders), SHIPPED / "collisions" / f"{source}.toml")
        found = first_file(source, places)
        if found is None:
            kinds = ("*/scene.toml", "impacts/*/scene.toml", "collisions/*.toml")
            known = [default_name(file) for kind in kinds for file in sorted(SHIPPED.glob(kind))]
            raise SceneError(f"{source}: no such scene file; {allowed_names(str(source), known, 'shipped scenes')}")
        return cls.read(found, changes)

    @classmethod
    def from_dict(cls, tables: Mapping[str, Any], default: str | None = None) -> Self:
        """Return the scene that nested mappings declare (see `to_dict`); they may be those of a `Collision`."""
        if "collision" in tables:
            from granular_lmp.scene.collision import Collision  # kept out of start-up

            return super().from_dict(Collision.from_dict(tables, default).scene_tables())
        return super().from_dict(tables, default)

    @classmethod
    def _located(cls, tables: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Return the tables with names of files (signals, a state, spheres) relative to the current folder."""
        tables, sources = located_table(located_state(tables, folder), folder), tables.get("source")
        return tables | {"source": [located(each, folder) for each in sources]} if isinstance(sources, list) else tables

    @classmethod
    def changed(cls, tables: dict[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return tables, checked or not, with the values of dotted keys replaced; keys of a collision come first."""
        if "collision" in tables:
            from granular_lmp.scene.collision import Collision  # kept out of start-up

            own = {key: value for key, value in changes.items() if Collision.has(key)}
            made = Collision.from_dict(Collision.changed(tables, own)).scene_tables()
            tables = {key: table for key, table in made.items() if key != "name" or key in tables}
            changes = {key: value for key, value in changes.items() if key not in own}
        part = [key for key in changes if key in cls.layout.exclusive["wave.wavevector"]]
        if part and "wave.wavevector" not in changes:  # parts of the vector that are not changed remain
            tables = dict(without_wavevector(tables))
        return super().changed(tables, changes)

    @classmethod
    def _completed(cls, tables: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the tables with a wave vector as number and direction; refuse a step together with a tolerance."""
        refuse_step_beside_tolerance(tables)
        return with_placeholder(without_wavevector(super()._completed(_with_quiet_rows(tables))))

    @cached_property
    def _variant(self) -> str:
        return WAVE if self.wave is not None else self.holding.without_wave

    @classmethod
    def _solved(cls, records: dict[str, Any]) -> dict[str, Any]:
        """Return the records with the smallest wave number at a declared frequency."""
        wave = records.get("wave")
        if wave is None or wave.frequency is None:
            return records
        unsolved = cls._unchecked({"name": ""} | records)
        for line in (adhesion_law, spheres_at_rest):
            if trouble := line(unsolved):
                raise SceneError(trouble, because="physics")
        return records | {"wave": replace(wave, wavenumber=unsolved.wavenumbers[0])}

    def to_dict(self) -> dict[str, Any]:
        """Return nested plain values with every default; either the time step or the tolerance, as declared.

        The adhesion law, and ``[output]`` without a wave, are left out if they are the default, so that scene files of
        earlier versions do not change.
        """
        tables = super().to_dict()
        if self.material.adhesion_law == Sphere.adhesion_law:
            tables["sphere"].pop("adhesion_law", None)
        tables["time"] = _without_replaced(tables["time"])
        if self.wave is None:
            output = {key: value for key, value in tables.pop("output").items() if value != getattr(Output(), key)}
            return tables | ({"output": output} if output else {})
        return tables | {"wave": _without_replaced(tables["wave"])}

    @classmethod
    def _plain_tables(cls, tables: Mapping[str, Any]) -> dict[str, Any]:
        """Return tables of records as plain values, without the keys that a tolerance or a frequency replaces."""
        pairs = {
            key: _without_replaced(without_defaults(tables[key], cls.layout.differing(key)))
            for key in ("time", "wave")
            if is_dataclass(tables.get(key))
        }
        return super()._plain_tables({**tables, **pairs})

    def departures(self) -> dict[str, Any]:
        """Return every value that differs from the default, by dotted key; keys without a default are always included.

        The description, which has no effect on a run, is not included.
        """
        found: dict[str, Any] = {}
        for section in (each for each in fields(self) if each.name != "description"):
            value = getattr(self, section.name)
            if not is_dataclass(value):
                found |= {section.name: value} if value != _default(section) else {}
                continue
            key = next((name for name, held in self.layout.attributes.items() if held == section.name), section.name)
            for item in fields(value):
                if getattr(value, item.name) != _default(item):
                    found[f"{key}.{item.name}"] = getattr(value, item.name)
        return found

    def __repr__(self) -> str:
        if self.wave is None:
            return f"<Scene {self.name}: {self.words}, t0 = {self.scale.time:.3g} s>"
        shape = self.shape
        return (
            f"<Scene {self.name}: {self.label}, {shape.rows} x {shape.columns} spheres, {shape.cut}, "
            f"tau 0..{self.time.duration:g}>"
        )


def _with_quiet_rows(tables: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return tables of a scene in which quiet ends have "auto" rows unless rows are declared."""
    packing, absorb = tables.get("packing"), tables.get("absorb", {})
    if not isinstance(packing, Mapping) or QUIET not in (packing.get("first"), packing.get("last")):
        return tables
    return {**tables, "absorb": {"rows": AUTO, **absorb}} if isinstance(absorb, Mapping) else tables


def _without_replaced(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``[time]`` or ``[wave]`` without the step that a tolerance, or the number that a frequency, replaces."""
    kept = dict(table)
    for key, other in (("tolerance", "timestep"), ("frequency", "wavenumber")):
        kept.pop(key if kept.get(key) is None else other, None)
    return kept


def _default(item: Field[Any]) -> Any:
    """Return the default of a field; MISSING if the field must be given."""
    return item.default if item.default_factory is MISSING else item.default_factory()
