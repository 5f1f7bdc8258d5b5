"""Scenes without ``[wave]``: how their defaults differ, and which tables and keys only one kind of scene has.

In such a scene adhesion or a load may hold the spheres at rest (`held_at_rest`); otherwise contacts have no stiffness.
Each key is declared once, with its range and its default for a scene with a wave (`granular_lmp.scene.sections`).
"""

from collections.abc import Mapping
from dataclasses import MISSING
from typing import Any

from granular_lmp.crystal.lattices import CHAIN, FREE
from granular_lmp.errors import Because, SceneError
from granular_lmp.scene.records import Variant

# Kinds of scenes
WAVE, HELD, NOT_HELD = "wave", "held at rest", "not held at rest"
MOVING_TABLES = ("striker", "start", "source")  # a scene without [wave] has at least one of these tables
AT_REST = "sphere.work_of_adhesion above 0, or packing.contact_force in a sheet"
NEEDS_ADHESION = {"sphere.adhesion_law": "is only for spheres that adhere; needs sphere.work_of_adhesion above 0, J/m2"}

# --- defaults --------------------------------------------------------------------------------------------------------

_DEFAULTS_WITHOUT_WAVE: dict[str, Any] = {
    "sphere.work_of_adhesion": 0.0,
    "packing.lattice": CHAIN.name,
    "packing.rows": MISSING,
    "packing.columns": 1,
    "packing.first": FREE,
    "packing.last": FREE,
    "packing.sides": FREE,
    "time.timestep": 0.03,
}
_DEFAULTS_NOT_HELD: dict[str, Any] = {
    "effects.rotation": True,
    "effects.shear_law": "incremental",
    "effects.friction": 0.0,
}

# --- tables and keys that only some scenes have, and why -------------------------------------------------------------

_ONLY_BESIDE_WAVE: dict[str, str] = {
    "wave": "must be left out of a scene without it",
    "envelope": "is only for a wave: must be left out without [wave]",
    **dict.fromkeys(
        (f"packing.{name}" for name in ("layers", "depth", "orientation")),
        "is only for a lattice in space: must be left out without [wave], where a crystal has one layer",
    ),
    "packing.space": "must be left out without [wave], where a [substrate] alone lets spheres leave the plane",
    "time.allow_echo": "must be left out without [wave], where every echo belongs to the answer",
    "output.particles": "must be left out without [wave], where all spheres are recorded at each sample",
}
_ONLY_WITHOUT_WAVE: dict[str, str] = dict.fromkeys(
    (f"output.{name}" for name in ("rows", "spheres", "layers", "forces")),
    "must be left out beside [wave], where a [[monitor]] records spheres and their contacts",
)
_ONLY_HELD: dict[str, str] = {
    "source": f"has no unit of time where nothing is at rest; needs {AT_REST}",
    **dict.fromkeys(("contact", "pair", "disorder.stiffness"), f"has stiffnesses at rest under load; needs {AT_REST}"),
    "substrate": f"holds spheres that adhere to it; needs {AT_REST}",
    "absorb": f"absorbs linear waves, and contacts without load have none; needs {AT_REST}",
    **dict.fromkeys(
        ("packing.relax", "packing.relax_friction", "packing.relax_by"),
        f"says how spheres come to rest under load; needs {AT_REST}",
    ),
    "effects.adhesion": "must be left out beside [[striker]] or [start], as contacts of an impact do not adhere",
    **dict.fromkeys(
        (f"effects.{name}" for name in ("shear", "tracking", "sliding", "damping", "contact_opening")),
        "must be left out beside [[striker]] or [start], where friction, viscosity and restitution decide it, and "
        "contacts open and slide as they do",
    ),
    "effects.twisting": "must be left out in the plane, where no contact twists",
}
_ONLY_NOT_HELD: dict[str, str] = {
    "effects.shear_damping": "must be left out where spheres are held at rest, whose viscosity damps both motions"
}
# Missing features; the other refusals are physics, or another key declares the same
_NOT_BUILT = ("packing.layers", "packing.depth", "packing.orientation", "packing.space")
_SAID_ELSEWHERE = ("output.",)

VARIANTS = {
    WAVE: Variant(refused=_ONLY_WITHOUT_WAVE | _ONLY_NOT_HELD),
    HELD: Variant(_DEFAULTS_WITHOUT_WAVE, _ONLY_BESIDE_WAVE | _ONLY_NOT_HELD),
    NOT_HELD: Variant(_DEFAULTS_WITHOUT_WAVE | _DEFAULTS_NOT_HELD, _ONLY_BESIDE_WAVE | _ONLY_HELD),
}


def variant_of(tables: Mapping[str, Any]) -> str:
    """Return the kind of scene that tables declare; `WAVE` if nothing moves, as then ``[wave]`` is missing."""
    if "wave" in tables or tables.keys().isdisjoint(MOVING_TABLES):
        return WAVE
    return HELD if held_at_rest(tables) else NOT_HELD


def holds(adhesion: float, force: float, *, sheet: bool, touching: bool) -> bool:
    """Return whether spheres without a wave are held at rest, by adhesion or by a force on a sheet.

    Spheres that begin `touching` have not reached their overlap at rest, and a compressed chain opens when it is
    struck.
    """
    return not touching and (adhesion > 0 or force > 0 and sheet)


def held_at_rest(tables: Mapping[str, Any]) -> bool:
    """Return whether tables without a wave, checked or not, hold spheres at rest, like `Scene.held_at_rest`."""
    names = ("sphere", "packing", "start")
    sphere, packing, start = (each if isinstance(each := tables.get(key), Mapping) else {} for key in names)
    sheet = packing.get("lattice", CHAIN.name) != CHAIN.name
    adhesion, force = (bool(each) for each in (sphere.get("work_of_adhesion"), packing.get("contact_force")))
    return holds(adhesion, force, sheet=sheet, touching=start.get("touching") is True)


def refuse_tables(tables: Mapping[str, Any]) -> None:
    """Raise SceneError for the first table or key that this kind of scene does not have."""
    variant, sphere = variant_of(tables), tables.get("sphere")
    adheres = variant == WAVE or isinstance(sphere, Mapping) and sphere.get("work_of_adhesion")
    refused = {**VARIANTS[variant].refused, **({} if adheres else NEEDS_ADHESION)}
    for key, why in refused.items():
        table, _, name = key.partition(".")
        inner = tables.get(table)
        if table in tables and (not name or isinstance(inner, Mapping) and name in inner):
            raise SceneError(f"{key}: {why}", because=_because(key))


def _because(key: str) -> Because:
    if key.startswith(_SAID_ELSEWHERE):
        return "exclusive"
    return "not built" if key.startswith(_NOT_BUILT) else "physics"
