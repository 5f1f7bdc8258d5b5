"""Tables of a scene file in their order; `granular_lmp.rest.scene` checks their combinations."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from granular_lmp.crystal.disorder import Disorder, Inclusion
from granular_lmp.crystal.sphere import Sphere
from granular_lmp.crystal.stiffnesses import Pair
from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.bodies import (
    DISORDER_RULES,
    INCLUSION_RULES,
    LATTICE_SPHERE_RULES,
    PAIR_RULES,
    Contact,
    Substrate,
)
from granular_lmp.scene.document import Document, Layout
from granular_lmp.scene.monitors import Monitor
from granular_lmp.scene.sections import (
    STEP_OR_TOLERANCE,
    Absorb,
    Effects,
    Envelope,
    Output,
    Packing,
    Time,
    Wave,
)
from granular_lmp.scene.sources import Source
from granular_lmp.scene.start import Start
from granular_lmp.scene.strikers import Striker
from granular_lmp.scene.without_wave import VARIANTS, WAVE, refuse_tables, variant_of


@dataclass(frozen=True, repr=False, init=False)
class Declaration(Document):
    """Declared values of a scene file, table by table."""

    layout = Layout(
        sections={
            "sphere": Sphere,
            "packing": Packing,
            "contact": Contact,
            "substrate": Substrate,
            "disorder": Disorder,
            "wave": Wave,
            "envelope": Envelope,
            "time": Time,
            "effects": Effects,
            "output": Output,
            "absorb": Absorb,
            "start": Start,
        },
        repeated={"inclusion": Inclusion, "pair": Pair, "source": Source, "monitor": Monitor, "striker": Striker},
        optional=("contact", "disorder", "absorb", "start"),
        none_if_left_out=("substrate",),
        variants=VARIANTS,
        rules={
            "sphere": LATTICE_SPHERE_RULES,
            "disorder": DISORDER_RULES,
            "inclusion": INCLUSION_RULES,
            "pair": PAIR_RULES,
        },
        attributes={"sphere": "material"},
        exclusive={
            **STEP_OR_TOLERANCE,
            "wave.wavevector": ("wave.wavenumber", "wave.frequency", "wave.direction"),
            "wave.wavenumber": ("wave.frequency",),
            "wave.frequency": ("wave.wavenumber",),
        },
    )

    material: Sphere
    packing: Packing
    time: Time
    wave: Wave | None = None
    envelope: Envelope = Envelope()
    effects: Effects = Effects()
    output: Output = Output()
    absorb: Absorb = Absorb()
    contact: Contact = Contact()
    substrate: Substrate | None = None
    disorder: Disorder = Disorder()
    inclusion: tuple[Inclusion, ...] = ()
    pair: tuple[Pair, ...] = ()
    source: tuple[Source, ...] = ()
    monitor: tuple[Monitor, ...] = ()
    start: Start = Start()
    striker: tuple[Striker, ...] = ()

    @property
    def beside(self) -> dict[str, Iterable[str]]:
        """Name → text, in pieces, of each file that the scene file names: the table of spheres."""
        return {str(self.packing.table): self.packing.table.pieces()} if self.packing.table else {}

    def write(self, path: str | Path) -> None:
        """Write the scene into a file that `load` reads, and the table of its spheres, if any, beside it."""
        for name, pieces in self.beside.items():
            with Path(path).with_name(name).open("w", encoding="utf-8") as stream:
                stream.writelines(pieces)
        Path(path).write_text(self.to_toml(), encoding="utf-8")

    @classmethod
    def _variant_of(cls, tables: Mapping[str, Any]) -> str:
        return variant_of(tables)

    @classmethod
    def _completed(cls, tables: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the tables; raise SceneError for a table or key that such a scene cannot have."""
        refuse_tables(tables)
        return tables

    @classmethod
    def _refuse_part(cls, tables: Mapping[str, Any], changes: Mapping[str, Any]) -> None:
        own = [key for key in changes if key.partition(".")[0] == "wave"]
        if not own or variant_of(tables) == WAVE:
            return
        replaced = {other for key in own for other in cls.layout.exclusive.get(key, ())}
        needed = (f"wave.{each.name}" for each in cls.layout.keys_of("wave", WAVE) if each.required)
        if missing := [key for key in needed if key not in (*own, *replaced)]:
            raise SceneError(f"{own[0]}: the scene has no [wave]; {', '.join(missing)} must be given with it")
