"""The JSON Schema of a scene file says the same as the reader."""

import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from granular_lmp.errors import SceneError
from granular_lmp.rest.scene import Scene
from granular_lmp.scene.json_schema import Key, json_schema, keys
from granular_lmp.scene.schema import ArrayRule
from granular_lmp.scene.sections import ModeRule
from granular_lmp.scene.without_wave import NOT_HELD

WHOLE = json_schema()
SCHEMA, AT_REST, IMPACT = WHOLE["then"], WHOLE["else"]["then"], WHOLE["else"]["else"]  # with [wave], and without
INPUTS = Path(__file__).parents[2] / "lammps_inputs"
SCENES = sorted(INPUTS.glob("*/scene.toml"))
IMPACTS = sorted(INPUTS.glob("impacts/*/scene.toml"))
STRUCK = INPUTS / "impacts" / "solitary_chain" / "scene.toml"
KEYS = list(keys())
IMPACT_KEYS = list(keys(NOT_HELD))


def fits(key: Key, value: Any, schema: dict[str, Any] = SCHEMA) -> bool:
    """Return whether the schema allows a value of a key."""
    table = schema["properties"][key.section]
    part = table.get("items", table)["properties"][key.name]
    return bool(jsonschema.Draft202012Validator(part).is_valid(value))


def validate(scene: dict[str, Any], schema: dict[str, Any]) -> None:
    """Raise ValidationError unless the schema, which is checked once, allows a scene."""
    jsonschema.Draft202012Validator(schema).validate(scene)


def is_read(key: Key, value: Any) -> bool:
    try:
        key.rule.value(value, key.name)
    except SceneError:
        return False
    return True


@pytest.mark.parametrize("schema", [WHOLE, SCHEMA, AT_REST, IMPACT], ids=["whole", "wave", "at rest", "impact"])
def test_the_schema_is_one(schema: dict[str, Any]) -> None:
    jsonschema.Draft202012Validator.check_schema(schema)


@pytest.mark.parametrize("path", IMPACTS, ids=lambda path: path.parent.name)
def test_a_shipped_impact_fits_its_schema_and_not_that_of_waves(path: Path) -> None:
    scene = tomllib.loads(path.read_text(encoding="utf-8"))
    validate(scene, IMPACT)
    with pytest.raises(jsonschema.ValidationError):
        validate(scene, SCHEMA)


def test_defaults_are_allowed_and_a_key_without_one_must_be_given() -> None:
    for key in [*KEYS, *IMPACT_KEYS]:
        assert key.default in (None, (), "") or is_read(key, key.default)
    must = {f"{key.section}.{key.name}" for key in IMPACT_KEYS if key.required}
    assert {"striker.velocity", "packing.rows", "sphere.density"} <= must
    assert "sphere.work_of_adhesion" not in must  # spheres of an impact do not adhere


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.parent.name)
def test_a_shipped_scene_fits_the_schema(path: Path) -> None:
    scene = tomllib.loads(path.read_text(encoding="utf-8"))
    validate(scene, WHOLE)
    validate(scene, SCHEMA if "wave" in scene else AT_REST)


def test_a_crystal_at_rest_has_effects_and_sources_that_an_impact_has_not() -> None:
    scene = tomllib.loads((INPUTS / "struck_crystal" / "scene.toml").read_text(encoding="utf-8"))
    more = {"effects": {"contact_opening": True}, "source": [{"rows": [3, 3], "force": "y", "frequency": 1.0}]}
    validate(scene | more, WHOLE)
    impact = scene | {"sphere": scene["sphere"] | {"work_of_adhesion": 0.0}}
    validate(impact, WHOLE)
    for each in more:
        with pytest.raises(jsonschema.ValidationError):
            validate(impact | {each: more[each]}, WHOLE)


def test_a_scene_of_a_frequency_fits() -> None:
    scene = tomllib.loads(SCENES[0].read_text(encoding="utf-8"))
    wave = {key: value for key, value in scene["wave"].items() if key != "wavenumber"} | {"frequency": 8e7}
    validate(scene | {"wave": wave}, SCHEMA)
    del wave["frequency"]
    validate(scene | {"wave": wave | {"form": "none"}}, SCHEMA)


# Of a wave, and of a striker, which the reader refuses too
REFUSED: list[dict[str, Any]] = [
    {"wave": {"mode": "TR", "amplitude": 0.1, "form": "driven"}},
    {"wave": {"wavenumber": 1.0, "amplitude": 0.1}},
    {"wave": {"mode": "TR", "wavenumber": 1.0, "wavevector": [1.0, 0.0], "amplitude": 0.1}},
    {"wave": {"mode": "TR", "wavenumber": 1.0, "frequency": 8e7, "amplitude": 0.1}},
    {"description": 3},
    {"packing": {"rows": 0}},
    {"vacancies": 0.1},
    {"disorder": {"vacancies": 1.5}},
    {"inclusion": [{"rows": [3], "density": 5000.0}]},
    {"time": {"duration": 120.0, "tau": 3.0}},
    {"source": [{"signal": []}]},
    {"source": [{"signal": [[0.0, 0.0], [1.0, 1.0]]}]},
]
REFUSED_IMPACTS: list[dict[str, Any]] = [
    {"striker": []},
    {"striker": [{"rows": [0, 0]}]},
    {"striker": [{"rows": [0, 0], "velocity": 0.0}]},
    {"striker": [{"rows": [0, 0], "velocity": 1.0, "direction": "up"}]},
    {"wave": {"mode": "TR"}},
    {"time": {"duration": 3.0, "tau": 1.0}},
    {"packing": {"lattice": "chain"}},
    {"output": {"particles": 1.0}},
]


@pytest.mark.parametrize("change", [*REFUSED, *REFUSED_IMPACTS], ids=str)
def test_a_scene_that_is_refused_does_not_fit(change: dict[str, Any]) -> None:
    path, schema = (SCENES[0], SCHEMA) if change in REFUSED else (STRUCK, IMPACT)
    scene = tomllib.loads(path.read_text(encoding="utf-8")) | change
    with pytest.raises(SceneError):
        Scene.from_dict(scene)
    with pytest.raises(jsonschema.ValidationError):
        validate(scene, schema)


VALUES = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False),
    st.integers(-(10**9), 10**9),
    st.booleans(),
    st.sampled_from(["auto", "x", "y", "TR", "secant", "fixed", "other", ""]),
    st.lists(st.integers(-3, 10**8), max_size=4),
    st.lists(st.lists(st.integers(-3, 10**8), max_size=3), max_size=2),
)


@pytest.mark.parametrize(("every", "schema"), [(KEYS, SCHEMA), (IMPACT_KEYS, IMPACT)], ids=["wave", "impact"])
@given(data=st.data(), value=VALUES)
def test_the_schema_lets_pass_what_the_reader_takes(
    every: list[Key], schema: dict[str, Any], data: st.DataObject, value: Any
) -> None:
    key = data.draw(st.sampled_from(every))
    # JSON knows 3.0 as an integer, TOML does not; the reader follows TOML. The number of a branch is one too
    if isinstance(value, float) and (key.rule.kind is int or isinstance(key.rule, ModeRule)):
        return
    assert fits(key, value, schema) == is_read(key, value)


@pytest.mark.parametrize("key", KEYS, ids=lambda key: f"{key.section}.{key.name}")
def test_each_end_of_an_interval_is_where_the_schema_says(key: Key) -> None:
    rule, interval = key.rule, key.rule.interval
    if interval is not None:
        for end in (interval.low, interval.high):
            for value in (end, rule.kind(end)):
                if isinstance(rule, ArrayRule):
                    value = [value] * len(rule.entries)
                    value = [value] if rule.several else value
                    assert is_read(key, value)
                assert fits(key, value) == is_read(key, value)
