"""Keys of a scene file, and their JSON Schema, for completion in editors.

Both are generated from the declarations in `granular_lmp.scene.sections`, which the reader checks too. Only `Scene`
checks combinations of values.
"""

from collections.abc import Iterator
from dataclasses import MISSING
from typing import Any

from granular_lmp.crystal.lattices import CHAIN
from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.declaration import Declaration
from granular_lmp.scene.document import note
from granular_lmp.scene.forms import STILL
from granular_lmp.scene.schema import LONGEST_DESCRIPTION, LONGEST_NAME, Rule
from granular_lmp.scene.without_wave import HELD, MOVING_TABLES, NOT_HELD, WAVE

DIALECT = "https://json-schema.org/draft/2020-12/schema"
_NOTHING = (None, (), "")  # defaults of keys that may be left out, or must be given


@dataclass(frozen=True)
class Key:
    """One key of a scene file.

    Attributes
    ----------
    section, name : str
    rule : Rule
    default : Any
        None if the key must be given, or takes the place of another one as ``time.tolerance`` does.
    required : bool
        The key has no default, or one that the reader refuses.
    """

    section: str
    name: str
    rule: Rule
    default: Any
    required: bool


def keys(variant: str = WAVE) -> Iterator[Key]:
    """Yield every key of a scene file of a kind (`granular_lmp.scene.without_wave`), section by section."""
    layout = Declaration.layout
    for section in layout.tables:
        for each in layout.keys_of(section, variant):
            required = each.default is MISSING or (
                each.default not in _NOTHING and not _allowed(each.rule, each.default)
            )
            yield Key(section, each.name, each.rule, None if required else each.default, required)


def _allowed(rule: Rule, value: Any) -> bool:
    try:
        rule.value(value, "")
    except SceneError:
        return False
    return True


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a scene file.

    Scenes with and without ``[wave]`` have different keys: "then" holds the keys beside a wave, "else" the others.
    Within "else", a second "then" is for a crystal at rest under load, and a second "else" for spheres that meet.
    """
    head = {"$schema": DIALECT, "title": "A scene of granular-lmp"}
    held, not_held = (_moving(_tables(variant)) for variant in (HELD, NOT_HELD))
    without = {"if": _AT_REST, "then": held, "else": not_held}
    return head | {
        "if": {"required": ["wave"]},
        "then": _tables(WAVE),
        "else": without,
    }


def _moving(tables: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a scene without a wave; one of its tables must move its spheres."""
    return tables | {"anyOf": [{"required": [table]} for table in MOVING_TABLES if table in tables["properties"]]}


def _having(table: str, **values: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of scenes whose table has these values."""
    inner = {"type": "object", "properties": values, "required": [*values]}
    return {"properties": {table: inner}, "required": [table]}


# The same conditions as in `granular_lmp.scene.without_wave.holds`
_AT_REST = {
    "anyOf": [
        _having("sphere", work_of_adhesion={"exclusiveMinimum": 0}),
        _having("packing", contact_force={"exclusiveMinimum": 0}, lattice={"not": {"const": CHAIN.name}}),
    ]
}


def _tables(variant: str) -> dict[str, Any]:
    layout = Declaration.layout
    properties: dict[str, Any] = {
        "name": {"type": "string", "pattern": f"^[A-Za-z0-9_-]{{1,{LONGEST_NAME}}}$"},
        "description": {"type": "string", "maxLength": LONGEST_DESCRIPTION},
    }
    sections: dict[str, dict[str, Any]] = {}
    needed: dict[str, list[str]] = {}
    for key in keys(variant):
        sections.setdefault(key.section, {})[key.name] = _value(key)
        needed.setdefault(key.section, []).extend([key.name] if key.required else [])
    for section, inner in sections.items():
        table: dict[str, Any] = {"type": "object", "properties": inner, "additionalProperties": False}
        if section == "wave":  # a wave vector replaces wave number and direction
            pair = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
            inner["wavevector"] = pair | {"description": note("wave.wavevector", Declaration)}
            needed["wave"].remove("wavenumber")
            which = [{"required": [name]} for name in ("wavenumber", "wavevector", "frequency")]
            no_wave = {"required": ["form"], "properties": {"form": {"enum": [*STILL]}}, "not": {"anyOf": which}}
            table["oneOf"] = [*which, no_wave]
        table |= {"required": needed[section]} if needed[section] else {}
        fewest = {"minItems": 1} if variant != WAVE and section in MOVING_TABLES else {}
        array = {"type": "array", "items": table} | fewest
        properties[section] = array if section in layout.repeated else table
    return {
        "type": "object",
        "properties": properties,
        "required": [
            section for section in layout.sections if needed.get(section) and section not in layout.none_if_left_out
        ],
        "additionalProperties": False,
    }


def _value(key: Key) -> dict[str, Any]:
    rule, default = key.rule, {} if key.default in _NOTHING else {"default": key.default}
    described = {"description": rule.note} if rule.note else {}
    return rule.schema() | described | default
