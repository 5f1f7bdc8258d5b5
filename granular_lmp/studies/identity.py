"""Name of a run in a sweep: a hash of its scene that does not change when the package gets a new key.

``identity.json`` holds the keys of release 0.1.0 for both kinds of scenes. They enter the hash with any value, as in
that release. A younger key enters only if its value differs from the behaviour before the key existed: its default, or
"off" for the switch of an effect. Defaults never change; a test checks those of younger keys too.

A hash of all departures from defaults would not work: finished sweeps would lose their names, and a changed default
would give one name to two different runs.
"""

import hashlib
import json
from collections.abc import Collection, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from granular_lmp.rest.scene import Scene
from granular_lmp.scene.schema import AUTO

# Keys that release 0.1.0 got after its first sweeps, whose names do not include them
_JOINED = frozenset(
    {
        *(f"packing.{name}" for name in ("lattice", "relax", "relax_friction")),
        *(f"effects.{name}" for name in ("rolling", "twisting")),
        *(f"effects.rolling_{name}" for name in ("stiffness", "viscosity", "friction")),
        "output.checkpoint",
    }
)


def names_of(scene: Scene) -> tuple[str, ...]:
    """Return the name of the run of a scene, and the name that folders of earlier releases may have instead.

    A name is 16 hexadecimal digits of the SHA-256 of the sorted JSON of the scene, without name and description. Every
    "auto" of the scene must be decided, as in a run folder.
    """
    known = frozen("ImpactScene" if scene.wave is None else "Scene").keys()
    return tuple(dict.fromkeys(_hash(scene, keys) for keys in (known, known - _JOINED)))


@cache
def frozen(kind: str) -> dict[str, Any]:
    """Return dotted key → default of the keys of release 0.1.0 in a kind of scene."""
    text = (Path(__file__).parent / "identity.json").read_text(encoding="utf-8")
    return dotted(json.loads(text)[kind])


def dotted(tables: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return dotted key → value of tables."""
    return {f"{table}.{key}": value for table, keys in tables.items() for key, value in keys.items()}


def _hash(scene: Scene, keys: Collection[str]) -> str:
    tables: dict[str, Any] = scene.to_dict() | {"name": None}
    del tables["description"]
    for table in scene.layout.sections:
        defaults = {each.name: each.default for each in scene.keys_of(table)}
        held = {
            key: value
            for key, value in tables.pop(table, {}).items()
            if f"{table}.{key}" in keys or not _was_so(value, defaults.get(key))
        }
        tables |= {table: held} if held else {}
    return hashlib.sha256(json.dumps(tables, sort_keys=True).encode()).hexdigest()[:16]


def _was_so(value: Any, default: Any) -> bool:
    """Return whether a value of a key means the behaviour before the key existed."""
    return bool(value == default) or (default == AUTO and value is False)
