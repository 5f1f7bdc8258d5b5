"""The scene of an impact: spheres that just touch, a sheet of spheres with gaps, or a compressed chain, and what moves.

A TOML file with a table ``[[striker]]`` or ``[start]`` is such a scene. It has the tables ``[sphere]``, ``[packing]``,
``[start]``, ``[disorder]``, ``[time]``, ``[effects]`` and ``[output]``, and any number of ``[[striker]]`` and
``[[inclusion]]``. It holds no wave and no adhesion: velocities are in m/s, times in t0 of the impact
(`granular_lmp.crystal.scale`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from pathlib import Path
from typing import Any, ClassVar, Self

from granular_lmp.card import HasCard
from granular_lmp.crystal.disorder import Disorder, Inclusion
from granular_lmp.crystal.lattices import CHAIN, LATTICES, Lattice, Shape
from granular_lmp.crystal.scale import DEEPEST, Scale
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.errors import SceneError
from granular_lmp.impact.sections import FREE, PERIODIC, Effects, Output, Packing, Time
from granular_lmp.scene.document import Document
from granular_lmp.scene.files import file_text, first_file, toml_tables
from granular_lmp.scene.monitors import Monitor
from granular_lmp.scene.places import place_troubles
from granular_lmp.scene.remarks import on_step, used_step
from granular_lmp.scene.sections import (
    DISORDER_RULES,
    INCLUSION_RULES,
    SPHERE_RULES,
    STEP_OR_TOLERANCE,
    refuse_step_beside_tolerance,
)
from granular_lmp.scene.shipped import SHIPPED
from granular_lmp.scene.sources import Source
from granular_lmp.scene.start import Start, located
from granular_lmp.scene.strikers import Striker, striker_troubles
from granular_lmp.scene.validation import EPSILON, LARGEST_OVERLAP_RATIO, MOST_SPHERES

SHIPPED_IMPACTS = SHIPPED / "impacts"
# ℓ is at least as many roundings of the farthest position; velocities then err by 1e-4 of a striker's
ROUNDINGS_IN_OVERLAP = 1e4
LARGEST_RATIO = 10.0  # Radii of a chain differ by this factor at most
LOOSEST = 0.04  # disorder.radius of a sheet: gaps of neighbours are then below a quarter of the radius
# What a scene of a linear wave has, and why an impact has it not
_LEFT_OUT = "left out beside [[striker]] or [start]"
_NO_ADHESION = f"{_LEFT_OUT}, as contacts of an impact do not adhere"
_NOT_HERE = {
    **dict.fromkeys(("wave", "envelope", "absorb", "source"), f"is of the scene of a wave: must be {_LEFT_OUT}"),
    "monitor": "is of the scene of a wave: [output] says which spheres of an impact are recorded",
    "packing.ends": "must be packing.first and packing.last beside [[striker]] or [start]",
    "time.allow_echo": f"must be {_LEFT_OUT}, where every echo belongs to the answer",
    "effects.adhesion": f"must be {_NO_ADHESION}",
}


@dataclass(frozen=True)
class ImpactScene(HasCard, Document):
    """One impact: spheres, lattice, strikers, time, effects and output.

    Raises
    ------
    SceneError
        If a key belongs to a linear wave, or values contradict each other: adhesive spheres, a place that the lattice
        has not, inclusions of another radius in a sheet, an impact so strong that overlaps are not small or so weak
        that they are lost in the rounding of positions.
    """

    sections = {
        "sphere": Sphere,
        "packing": Packing,
        "start": Start,
        "disorder": Disorder,
        "time": Time,
        "effects": Effects,
        "output": Output,
    }
    repeated = {"striker": Striker, "inclusion": Inclusion}
    optional = ("start", "disorder", "output")
    exclusive = STEP_OR_TOLERANCE
    assumed = {"sphere.work_of_adhesion": 0.0}
    marks = ("striker", "start")
    rules = {"sphere": SPHERE_RULES, "disorder": DISORDER_RULES, "inclusion": INCLUSION_RULES}
    named = "the files of the run"
    wave: ClassVar[None] = None
    source: ClassVar[tuple[Source, ...]] = ()
    monitor: ClassVar[tuple[Monitor, ...]] = ()

    sphere: Sphere
    packing: Packing
    time: Time
    effects: Effects = Effects()
    output: Output = Output()
    start: Start = Start()
    disorder: Disorder = Disorder()
    striker: tuple[Striker, ...] = ()
    inclusion: tuple[Inclusion, ...] = ()

    # --- reading ---

    @classmethod
    def load(cls, source: str | Path) -> Self:
        """Read an impact from a TOML file, a folder with a ``scene.toml``, or by the name of a shipped one.

        Raises
        ------
        SceneError
            If there is no such file, it is not such a scene, or a value is out of range.
        """
        found = _file(source)
        if found is None:
            shipped = sorted(folder.parent.name for folder in SHIPPED_IMPACTS.glob("*/scene.toml"))
            raise SceneError(f"{source}: no such scene file; shipped impacts: {', '.join(shipped) or 'none'}")
        return cls.read(found)

    @classmethod
    def from_dict(cls, tables: Mapping[str, Any], default: str | None = None) -> Self:
        """Return the scene of nested mappings; what only a linear wave has is refused by name."""
        for key, why in _NOT_HERE.items():
            table, _, name = key.partition(".")
            inner = tables.get(table)
            if table in tables and (not name or isinstance(inner, Mapping) and name in inner):
                raise SceneError(f"{key}: {why}")
        return super().from_dict(tables, default)

    @classmethod
    def located(cls, tables: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Return the tables with the name of a file of the state relative to the current folder."""
        return located(tables, folder)

    @classmethod
    def completed(cls, tables: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the tables with spheres without adhesion where it is not declared; a step excludes a tolerance."""
        refuse_step_beside_tolerance(tables)
        if isinstance(tables.get("sphere"), Mapping):
            adhesion = cls.assumed["sphere.work_of_adhesion"]
            return {**tables, "sphere": {"work_of_adhesion": adhesion, **tables["sphere"]}}
        return tables

    def to_dict(self) -> dict[str, Any]:
        """Return nested plain values with every default, without those of [output]; the step or the tolerance."""
        tables = super().to_dict()
        del tables["time"]["tolerance" if self.time.tolerance is None else "timestep"]
        if "output" in tables:
            written = {name: value for name, value in tables["output"].items() if value != getattr(Output(), name)}
            tables["output"] = written
        return tables

    # --- derived values ---

    @property
    def material(self) -> Sphere:
        """Spheres as declared."""
        return self.sphere

    @property
    def struck(self) -> bool:
        """True: strikers or a state move spheres at the beginning."""
        return True

    @property
    def lattice(self) -> Lattice:
        """Lattice of the packing."""
        return LATTICES[self.packing.lattice]

    @property
    def shape(self) -> Shape:
        """Rows and columns of the lattice; its cell ends with its rows."""
        return Shape(self.packing.rows, self.packing.columns, "fixed", self.lattice)

    @cached_property
    def scale(self) -> Scale:
        """Units of the impact: those of the fastest sphere at the beginning, on the spheres of ``[sphere]``.

        Where all are let go from rest, the largest displacement is ℓ, which gives v = √(A/m) ℓ^{5/4}.
        """
        fastest = max(self._fastest_striker, self.start.fastest(self.sphere.radius))
        let_go = sqrt(self.sphere.normal_coefficient / self.sphere.mass) * self.start.farthest**1.25
        return Scale.of(self.sphere, fastest or let_go)

    @property
    def _fastest_striker(self) -> float:
        return max((each.velocity for each in self.striker), default=0.0)

    @property
    def fastest(self) -> str:
        """Where the scene says how fast spheres are at the beginning: "striker", "start.state" or "start.noise"."""
        strikes = self._fastest_striker >= self.start.fastest(self.sphere.radius) and self.striker
        return "striker" if strikes else "start.state" if self.start.state else "start.noise"

    @property
    def rest_overlap(self) -> float:
        """Overlap at rest, m, of two spheres of ``[sphere]``, (F0/A)^{2/3}; 0 where they just touch."""
        return float((self.packing.contact_force / self.sphere.normal_coefficient) ** (2 / 3))

    @property
    def rest_rate(self) -> float:
        """√(K/m), 1/t0, of spheres of ``[sphere]`` at rest, K = (3/2) A √δ."""
        return sqrt(1.5 * sqrt(self.rest_overlap / self.scale.length))

    @property
    def used(self) -> dict[str, Any]:
        """Values that run in place of declared ones, which a sample rounds, by dotted key."""
        return used_step(self.time)

    @property
    def words(self) -> str:
        """Size and strikers in words, for titles."""
        packing = self.packing
        size = (
            f"a chain of {packing.rows} spheres"
            if self.lattice == CHAIN
            else f"a {packing.lattice} sheet of {packing.rows} rows x {packing.columns} columns"
        )
        force, gaps = packing.contact_force, self.lattice != CHAIN and self.disorder.radius
        rest = f"pressed together by {force:.6g} N" if force else "that just touch"
        if gaps:
            rest = f"with gaps (disorder.radius = {gaps:g})"
        struck = [f"struck at {self._fastest_striker:.6g} m/s"] if self.striker else []
        begins = ["which begins in a given state"] if self.start.state else []
        begins += [f"with random velocities of up to {self.start.noise:.6g} m/s"] if self.start.noise else []
        return ", ".join([f"{size} {rest}", *struck, *begins])

    def remarks(self) -> list[str]:
        """Return a sentence for each change that made the scene fit."""
        return on_step(self.time)

    def __repr__(self) -> str:
        return f"<ImpactScene {self.name}: {self.words}, t0 = {self.scale.time:.3g} s>"

    # --- what does not go together ---

    def __post_init__(self) -> None:
        self._check_striker_tables()
        self._check_spheres()
        self._check_packing()
        self._check_places()
        self._check_scale()
        if self.time.sample > self.time.duration:
            raise SceneError(
                f"time.sample = {self.time.sample!r}: must be at most time.duration = {self.time.duration!r}"
            )

    def _check_striker_tables(self) -> None:
        if not self.striker and not self.start.moves:
            raise SceneError(
                "striker: missing; an impact has a table [[striker]], or a [start] in which a sphere moves"
            )
        for trouble in striker_troubles(self.striker, self.shape):
            raise SceneError(trouble)

    def _check_spheres(self) -> None:
        sphere, effects = self.sphere, self.effects
        if sphere.work_of_adhesion:
            raise SceneError(f"sphere.work_of_adhesion = {sphere.work_of_adhesion!r}: must be 0 or {_NO_ADHESION}")
        if self.lattice == CHAIN and effects.friction:
            raise SceneError(f"effects.friction = {effects.friction!r}: must be 0 in a chain, where nothing is sheared")
        if not effects.rotation and not effects.friction:
            raise SceneError(
                "effects.rotation = false: must be left out where effects.friction = 0.0, as nothing turns a sphere"
            )
        for number_, each in enumerate(self.inclusion, 1):
            if each.work_of_adhesion:
                raise SceneError(f"inclusion {number_}: work_of_adhesion = {each.work_of_adhesion!r}: must be left out")
            if each.radius not in (None, sphere.radius) and self.lattice != CHAIN:
                raise SceneError(
                    f"inclusion {number_}: radius = {each.radius!r}: must be that of all spheres in a sheet, whose "
                    "contacts would open or be pressed together; density and moduli may differ"
                )
            if each.radius and not 1 / LARGEST_RATIO <= each.radius / sphere.radius <= LARGEST_RATIO:
                raise SceneError(
                    f"inclusion {number_}: radius = {each.radius!r}: must be from {1 / LARGEST_RATIO:g} to "
                    f"{LARGEST_RATIO:g} times sphere.radius = {sphere.radius!r}"
                )
            if each.vacancy and self.lattice == CHAIN:
                raise SceneError(f"inclusion {number_}: vacancy = true: must be false in a chain, which it would part")
        if self.lattice == CHAIN and self.disorder.vacancies:
            raise SceneError(
                f"disorder.vacancies = {self.disorder.vacancies!r}: must be 0 in a chain, which they would part"
            )
        if self.lattice != CHAIN and self.disorder.radius > LOOSEST:
            raise SceneError(
                f"disorder.radius = {self.disorder.radius!r}: must be at most {LOOSEST} in a sheet, whose neighbours "
                "have gaps of up to six times as many radii; good values are of the order of overlap / radius, "
                f"{self.scale.length / self.sphere.radius:.2g}"
            )

    def _check_packing(self) -> None:
        packing, lattice = self.packing, self.lattice
        if lattice == CHAIN and (packing.columns != 1 or packing.sides != FREE):
            raise SceneError(
                f'packing.columns = {packing.columns} and packing.sides = "{packing.sides}": must be 1 and "{FREE}" in '
                "a chain"
            )
        if packing.contact_force and lattice != CHAIN:
            raise SceneError(
                f"packing.contact_force = {packing.contact_force!r}: must be 0 in a sheet, which a force along y does "
                'not press alike in all contacts; packing.lattice = "chain" has it'
            )
        if packing.contact_force and self.effects.restitution < 1:
            raise SceneError(
                f"effects.restitution = {self.effects.restitution!r}: must be 1 beside packing.contact_force, as it is "
                "that of a collision of spheres that part again"
            )
        if packing.sides == PERIODIC and packing.columns < lattice.fewest_columns:
            raise SceneError(
                f"packing.columns = {packing.columns}: must be at least {lattice.fewest_columns} between periodic "
                "sides, where a sphere would touch two images of one neighbour"
            )
        if packing.rows * packing.columns > MOST_SPHERES:
            raise SceneError(
                f"packing.rows x packing.columns = {packing.rows} x {packing.columns}: must be at most {MOST_SPHERES} "
                "spheres (LAMMPS takes 690 MB for each million)"
            )

    def _check_places(self) -> None:
        """Check that recorded spheres and those of the state have places in the lattice."""
        places = {} if self.output.everyone else {"output": (self.output.rows, self.output.spheres)}
        places |= {"start.state": ((), self.start.places)} if self.start.state else {}
        for name, (rows, spheres) in places.items():
            for trouble in place_troubles(rows, spheres, self.shape):
                raise SceneError(f"{name}: {trouble}")

    def _check_scale(self) -> None:
        length, rest = self.scale.length, self.rest_overlap
        fastest = f"{self.fastest}: velocity = {self.scale.velocity:.6g}"
        deepest = (rest + DEEPEST * length) / (2 * self.sphere.radius)  # the force of both is that of one at most
        if deepest > LARGEST_OVERLAP_RATIO:
            cause = fastest if rest < DEEPEST * length else f"packing.contact_force = {self.packing.contact_force!r}"
            raise SceneError(
                f"{cause}: two spheres would overlap by {deepest:.3g} of the diameter; at most "
                f"{LARGEST_OVERLAP_RATIO} is allowed"
            )
        size = max(self.packing.rows, self.packing.columns) * self.sphere.radius + self.start.farthest
        rounding = EPSILON / 2 * size
        motion = length / max(1.0, self.rest_rate)  # ℓ, or v/ω of spheres that are pressed together
        if motion < ROUNDINGS_IN_OVERLAP * rounding:
            raise SceneError(
                f"{fastest}: its overlap of {motion:.3g} m is less than {ROUNDINGS_IN_OVERLAP:g} roundings of a "
                f"position in {self.packing.rows} rows x {self.packing.columns} columns, displaced by "
                f"{self.start.farthest:.4g} m; must be faster, or these smaller"
            )


def _file(source: str | Path) -> Path | None:
    path = Path(source)
    return first_file(source, (path, path / "scene.toml", SHIPPED_IMPACTS / path / "scene.toml"))


def is_impact(source: str | Path) -> bool:
    """Return whether a file, a folder or a name is the scene of an impact (`marked`)."""
    found = _file(source)
    if found is None:
        return False
    try:
        return marked(toml_tables(file_text(found)))
    except SceneError:
        return False  # the reader of scenes says what is wrong


def marked(tables: Mapping[str, Any]) -> bool:
    """Return whether tables are those of an impact: with ``[[striker]]`` or ``[start]``, and without ``[wave]``."""
    return "wave" not in tables and not tables.keys().isdisjoint(ImpactScene.marks)
