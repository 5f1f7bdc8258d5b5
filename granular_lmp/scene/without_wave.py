"""Tables and keys of a scene without ``[wave]``: which are declared otherwise, and which it cannot have.

Spheres of such a scene are at rest under load, or they just touch (`holds`), where nothing has a stiffness.
"""

from collections.abc import Mapping
from typing import Any

from granular_lmp.crystal.lattices import CHAIN
from granular_lmp.errors import SceneError

# Tables whose keys are declared otherwise in every scene without [wave]
UNWAVED = ("sphere", "packing", "time", "output")
# Tables and keys that a scene has beside a wave only, and why
NEEDS_WAVE: dict[str, str] = {
    "envelope": "is of the scene of a wave: must be left out without [wave]",
    **dict.fromkeys(
        (f"packing.{name}" for name in ("layers", "depth", "orientation")),
        "is of a lattice in space: must be left out without [wave], where a crystal has one layer",
    ),
    "packing.space": "must be left out without [wave], where a [substrate] alone lets spheres leave the plane",
    "time.allow_echo": "must be left out without [wave], where every echo belongs to the answer",
}
AT_REST = "sphere.work_of_adhesion above 0, or packing.contact_force in a sheet"
NEEDS_ADHESION = {"sphere.adhesion_law": "is of spheres that adhere; needs sphere.work_of_adhesion above 0, J/m2"}
# Tables and keys that need spheres at rest under load, and why
NEEDS_REST: dict[str, str] = {
    "source": f"has no unit of time where nothing is at rest; needs {AT_REST}",
    **dict.fromkeys(("contact", "pair", "disorder.stiffness"), f"has stiffnesses at rest under load; needs {AT_REST}"),
    "substrate": f"holds spheres that adhere to it; needs {AT_REST}",
    "absorb": f"absorbs linear waves, and contacts without load have none; needs {AT_REST}",
    "packing.ends": "must be packing.first and packing.last beside [[striker]] or [start]",
    **dict.fromkeys(
        ("packing.relax", "packing.relax_friction", "packing.relax_by"),
        f"is the way to rest under load; needs {AT_REST}",
    ),
    "effects.adhesion": "must be left out beside [[striker]] or [start], as contacts of an impact do not adhere",
}


def holds(adhesion: float, force: float, *, sheet: bool, touching: bool) -> bool:
    """Return whether spheres without a wave are held at rest: they adhere, or a force presses a sheet together.

    Those that begin `touching` are not yet pulled to their overlap, and a chain under a force parts as it is struck.
    """
    return not touching and (adhesion > 0 or force > 0 and sheet)


def held_at_rest(tables: Mapping[str, Any]) -> bool:
    """Return what tables without a wave say of it, checked or not, as `Scene.held_at_rest` of a scene."""
    names = ("sphere", "packing", "start")
    sphere, packing, start = (each if isinstance(each := tables.get(key), Mapping) else {} for key in names)
    sheet = packing.get("lattice", CHAIN.name) != CHAIN.name
    adhesion, force = (bool(each) for each in (sphere.get("work_of_adhesion"), packing.get("contact_force")))
    return holds(adhesion, force, sheet=sheet, touching=start.get("touching") is True)


def refuse_tables(tables: Mapping[str, Any]) -> None:
    """Raise a SceneError for the first table or key that needs a wave, or spheres that are held at rest."""
    sphere = tables.get("sphere")
    adheres = isinstance(sphere, Mapping) and sphere.get("work_of_adhesion")
    for key, why in (
        NEEDS_WAVE | ({} if held_at_rest(tables) else NEEDS_REST) | ({} if adheres else NEEDS_ADHESION)
    ).items():
        table, _, name = key.partition(".")
        inner = tables.get(table)
        if table in tables and (not name or isinstance(inner, Mapping) and name in inner):
            raise SceneError(f"{key}: {why}")
