"""Bad input by the thousand: one line that names the key, never a traceback; and LAMMPS never ends the interpreter.

`make stability` tries thousands, drawn anew; `make test` hundreds, always the same (`tests/hard/conftest.py`).
"""

import json
import re
from collections.abc import Callable, Mapping
from copy import deepcopy
from datetime import date
from math import inf, nan, pi
from pathlib import Path
from typing import Any

from hypothesis import example, given
from hypothesis import strategies as st

from granular_lmp import ImpactScene, Scene, build
from granular_lmp.errors import CrystalError, GranularError, SceneError
from granular_lmp.lammps.deck import deck_of
from granular_lmp.problem import prepare
from granular_lmp.runs.manifest import description
from granular_lmp.scene.collision import Collision
from granular_lmp.scene.files import assignment
from granular_lmp.scene.shipped import SHIPPED
from granular_lmp.studies.collide import scene_of
from granular_lmp.studies.sweep_points import axes, points
from tests.conftest import PAPER

SCENES = [Scene.load(path) for path in sorted(SHIPPED.glob("*/scene.toml"))]
IMPACTS = [
    ImpactScene.load("solitary_chain"),
    ImpactScene.load("point_impact").with_values(
        {"packing.rows": 9, "packing.columns": 7, "striker.1.spheres": [[0, 3]], "effects.friction": 0.3}
    ),
]
COLLISIONS = [Collision.load(path) for path in sorted((SHIPPED / "collisions").glob("*.toml"))]
KEYS = sorted({f"{table}.{key}" for table, keys in PAPER.to_dict().items() if table != "name" for key in keys})
KEYS += ["name", "time.tolerance", "wave.wavevector"]
MOST_BUILT = 3000  # spheres; a larger packing takes seconds, and is no other code

NASTY: list[Any] = [
    *(nan, inf, -inf, 0, -1, 1, 2, 3, 1e300, -1e300, 1e-300, 5e-324, 1e308, 1e-9, 1e7, pi, 0.5, 1.0),
    *(10**400, -(10**400), 2**31, 2**63, True, False, "", "auto", "fixed", "periodic", "L", "RT", "nan", "a b"),
    *("x", "y", "standing", "driven", 45.0, 90.0, -90.0, [0.5, 1.0], [0.0, 3.0], [nan, 1.0], [1e9, 1], ["a", "b"]),
    *("a\nb", "\x00", "\x1b[31m", "ünï\u202ecode", "x" * 10_000, [], [1.0], {}, {"a": 1}, date(2020, 2, 29)),
]
values = st.one_of(st.sampled_from(NASTY), st.floats(), st.floats(1e-9, 1e9), st.integers(), st.text(max_size=8))
names = st.one_of(st.sampled_from([key.rpartition(".")[2] for key in KEYS]), st.text(max_size=6))


@st.composite
def mutated(draw: Callable[..., Any], bases: list[Any]) -> dict[str, Any]:
    """The tables of a scene or collision with up to three values changed, dropped or added."""
    tables: dict[str, Any] = draw(st.sampled_from(bases)).to_dict()
    for _ in range(draw(st.integers(1, 3))):
        table = draw(st.sampled_from(sorted(tables)))
        inner = tables[table]
        what = draw(st.sampled_from(["value", "value", "value", "drop", "add", "table"]))
        if what == "table" or not isinstance(inner, dict) or not inner:
            tables[table] = deepcopy(draw(values))  # what is sampled is one object, and the next change writes into it
        elif what == "add":
            inner[draw(names)] = draw(values)
        else:
            key = draw(st.sampled_from(sorted(inner)))
            if what == "drop":
                del inner[key]
            else:
                inner[key] = draw(values)
    return tables


def is_one_line(error: GranularError, words: set[str]) -> None:
    """An error that a user can act on: printable, one line, not a page, with one of these words in it."""
    text = str(error)
    assert text.isprintable(), text
    assert len(text) < 1000, text
    assert any(word in text for word in words), text


def is_finite(deck: str) -> bool:
    """Return whether the commands of a deck hold only numbers: its first line and its files are named by the scene."""
    return not re.search(r"\b(nan|inf)\b", deck.partition("\n")[2].replace(".nan", "").replace(".inf", ""))


def survives(make: Callable[[], Scene], words: set[str]) -> None:
    """A scene is refused in one line, or is one that the whole way to the deck is open to."""
    try:
        scene = make()
        resolved = prepare(scene).scene
        if resolved.shape.spheres <= MOST_BUILT:
            deck = build(scene)
            json.dumps(description(deck.problem, [], "module", 1), allow_nan=False)
            assert is_finite(deck.input_text)
    except (SceneError, CrystalError) as error:
        is_one_line(error, words)
        return
    scene.remarks()
    assert Scene.loads(scene.to_toml()) == scene


def named(tables: Mapping[str, Any]) -> set[str]:
    """Return the names that an error may have: any key or table of this input, or one that is missing in it."""
    inner = {str(key) for table in tables.values() if isinstance(table, dict) for key in table}
    keys = {*KEYS, *(key.partition(".")[2] for key in KEYS), *PAPER.to_dict(), *map(str, tables), *inner}
    return {repr(key)[1:-1] for key in keys} - {""} | {"unknown key"}


@given(mutated(SCENES))
@example(PAPER.to_dict() | {"time": {"duration": 1e7, "sample": 1e7, "timestep": 5e-324}})
@example(PAPER.to_dict() | {"time": {"duration": 1e-3, "sample": 5e-324, "timestep": 0.05}})
@example(PAPER.to_dict() | {"a\nb": 1})
def test_a_bad_scene_is_one_line_that_names_a_key(tables: dict[str, Any]) -> None:
    survives(lambda: Scene.from_dict(tables), named(tables))


COLLISION_KEYS = {key for part in ("sphere", "contact", "collision") for key in COLLISIONS[0].to_dict()[part]}


@given(mutated(COLLISIONS))
def test_a_bad_collision_is_one_line_that_names_a_key(tables: dict[str, Any]) -> None:
    try:
        text = deck_of(prepare(scene_of(Collision.from_dict(tables)))).input_text
        assert is_finite(text)
    except SceneError as error:
        is_one_line(error, named(tables) | COLLISION_KEYS)


@given(mutated(IMPACTS))
def test_a_bad_impact_is_one_line_that_names_a_key(tables: dict[str, Any]) -> None:
    try:
        scene = ImpactScene.from_dict(tables)
        if scene.packing.rows * scene.packing.columns <= MOST_BUILT:
            problem = prepare(scene)
            json.dumps(description(problem, [], "module", 1), allow_nan=False)
            assert is_finite(deck_of(problem).input_text)
    except (SceneError, CrystalError) as error:
        is_one_line(error, named(tables) | {"striker", "inclusion"})


ALPHABET = st.text(st.sampled_from("[]{}=\"'\n\\#.,-+0123456789eE_aT:\x00\t é"), max_size=6)


@st.composite
def garbled(draw: Callable[..., Any]) -> bytes:
    """The bytes of a shipped scene, cut, doubled, overwritten, and not always UTF-8."""
    text = draw(st.sampled_from(SCENES)).to_toml()
    for _ in range(draw(st.integers(1, 3))):
        at, length = draw(st.integers(0, len(text))), draw(st.integers(0, 20))
        text = text[:at] + draw(ALPHABET) + text[at + length :]
    raw: bytes = text.encode()
    return raw + draw(st.sampled_from([b"", b"", b"", b"\xff", b"\xef\xbb\xbf", b"x = " + b"[" * 5000, b"\r\nx=1"]))


@given(garbled())
@example(b"name = " + b"9" * 5000)
@example(b"name = 0x" + b"f" * 5000)
@example(b"[" * 100_000)
def test_a_garbled_file_is_one_line(tmp_path: Path, raw: bytes) -> None:
    path = tmp_path / "scene.toml"
    path.write_bytes(raw)
    survives(lambda: Scene.load(path), {"scene.toml", *KEYS, *PAPER.to_dict()})


@st.composite
def changes(draw: Callable[..., Any]) -> list[str]:
    """Arguments of ``--set``: right and wrong keys and values."""
    keys = st.one_of(st.sampled_from([*KEYS, *PAPER.to_dict()]), st.text(max_size=8))
    long = st.sampled_from(["[" * 10_000, "1\nname = 'x'", "9" * 5000])
    worded = st.one_of(values.map(str), st.text(max_size=10), long)
    return [f"{draw(keys)}={draw(worded)}" for _ in range(draw(st.integers(1, 3)))]


@given(changes())
@example(["time=3", "time.tolerance=1e-3"])
@example(["wave=3", "wave.mode=L"])
def test_a_bad_set_is_one_line(texts: list[str]) -> None:
    survives(
        lambda: PAPER.with_values(dict(assignment(text) for text in texts)),
        {*KEYS, *(key.partition(".")[2] for key in KEYS), "KEY=VALUE", "unknown key", *PAPER.to_dict()},
    )


@given(changes())
def test_a_bad_set_of_a_collision_is_one_line(texts: list[str]) -> None:
    try:
        COLLISIONS[0].with_values(dict(assignment(text) for text in texts))
    except SceneError as error:
        is_one_line(error, {*COLLISION_KEYS, *COLLISIONS[0].to_dict(), "KEY=VALUE", "unknown key", "not supported"})


@st.composite
def swept(draw: Callable[..., Any]) -> list[str]:
    """Arguments of ``--over``."""
    numbers = st.sampled_from(["1e400", "nan", "2", "1e-300", "-1", "1_0"])
    word = st.one_of(values.map(str), st.text(max_size=6), numbers)
    ranges = st.lists(word, min_size=2, max_size=4).map(":".join)
    lists = st.lists(st.one_of(word, ranges), min_size=1, max_size=3).map(",".join)
    keys = st.one_of(st.sampled_from(KEYS), st.text(max_size=4))
    return [f"{draw(keys)}={draw(lists)}" for _ in range(draw(st.integers(1, 2)))]


@given(swept())
@example(["wave.wavenumber=0.1:inf:3"])
@example(["wave.wavenumber=0.1:1e400:3"])
@example(["wave.wavenumber=0.1:3:1000000000000"])
def test_a_bad_sweep_is_one_line(texts: list[str]) -> None:
    try:
        over = axes(texts)
        if sum(map(len, over.values())) < 50:
            points(PAPER.with_values({"packing.rows": "auto"}), over)
    except SceneError as error:
        is_one_line(error, {*KEYS, *PAPER.to_dict(), "KEY=VALUES", "FIRST:LAST:COUNT", "COUNT", "unknown key", "swept"})
