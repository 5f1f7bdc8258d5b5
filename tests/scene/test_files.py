"""A scene copes with what a user hands over: numpy's numbers, files that never end, keys of thousands of parts."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from granular_lmp import ImpactScene, Scene
from granular_lmp.errors import SceneError
from granular_lmp.scene import files, samples, start
from granular_lmp.scene.files import LARGEST_TABLE, MOST_PARTS, assignment, file_text, toml_tables
from granular_lmp.studies.sweep_points import scene_hash
from tests.scene.test_samples import SMALL, burst_samples, sources

CHAIN = ImpactScene.load("solitary_chain")


@pytest.mark.parametrize(
    ("key", "value", "same"),
    [
        ("packing.columns", np.int64(8), 8),
        ("packing.columns", np.uint8(8), 8),
        ("packing.columns", np.array(8), 8),
        ("wave.amplitude", np.float32(0.125), 0.125),
        ("wave.amplitude", np.float16(0.125), 0.125),
        ("wave.amplitude", np.longdouble(0.125), 0.125),
        ("wave.amplitude", np.array(0.125), 0.125),
        ("wave.amplitude", np.int32(1), 1.0),
        ("wave.wavevector", np.array([0.25, 0.5]), [0.25, 0.5]),
        ("wave.mode", np.str_("RT"), "RT"),
        ("time.allow_echo", np.bool_(True), True),
        ("effects.adhesion", np.array(True), True),
    ],
)
def test_numbers_of_numpy_are_numbers(key: str, value: Any, same: Any) -> None:
    scene, expected = (Scene.load("tr_periodic").with_values({key: each}) for each in (value, same))
    assert scene == expected
    assert scene.to_toml() == expected.to_toml()
    assert json.dumps(scene.to_dict()) == json.dumps(expected.to_dict())
    assert scene_hash(scene) == scene_hash(expected)


def test_arrays_of_numpy_are_samples_places_and_states() -> None:
    pairs = burst_samples()
    sampled = SMALL.with_values({"source": [{"spheres": np.array([[3, 3]]), "force": "x", "signal": np.array(pairs)}]})
    assert sampled == SMALL.with_values({"source": sources(force="x", signal=pairs)})
    tables = {key: table for key, table in CHAIN.to_dict().items() if key != "striker"}
    state = [[0, 0, 0, 0, 0, 1.0, 0]]
    begun, expected = (ImpactScene.from_dict(tables | {"start": {"state": each}}) for each in (np.array(state), state))
    assert begun == expected
    assert CHAIN.with_values({"striker.1.velocity": np.float32(2)}).striker[0].velocity == 2.0


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("packing.columns", np.float64(8), r"packing\.columns = 8\.0: must be a whole number"),
        ("packing.columns", np.bool_(True), r"packing\.columns = True: must be a whole number"),
        ("wave.amplitude", np.bool_(True), r"wave\.amplitude = True: must be a number"),
        ("wave.amplitude", np.array([0.1]), r"wave\.amplitude = \[0\.1\]: must be a number"),
        ("wave.amplitude", np.float32("nan"), r"wave\.amplitude = nan: must be a number"),
        ("wave.amplitude", np.ma.masked, r"wave\.amplitude = masked: must be a number"),
        ("wave.amplitude", np.complex128(0.1), r"wave\.amplitude = \(0\.1\+0j\): must be a number"),
    ],
)
def test_what_is_no_number_of_the_kind_stays_refused(key: str, value: Any, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        Scene.load("tr_periodic").with_values({key: value})


def endless(kind: str, folder: Path) -> Path:
    """A name that ends in .csv and leads to what has no end."""
    path = folder / "endless.csv"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "folder":
        path.mkdir()
    else:
        path.write_bytes(b" " * (LARGEST_TABLE + 1))
    return path


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("pipe", "must be a regular file, not a folder, device or pipe"),
        ("device", "must be a regular file, not a folder, device or pipe"),
        ("folder", "must be a regular file, not a folder, device or pipe"),
        ("large", f"is too large: must be at most {LARGEST_TABLE} bytes"),
    ],
)
@pytest.mark.parametrize(
    ("rule", "key"),
    [
        (samples.SignalRule(str, "", "", words=("tone",)), "source.1.signal"),
        (start.StateRule(str, "", ""), "start.state"),
    ],
)
def test_a_table_is_a_regular_file_of_bounded_size(
    rule: samples.SignalRule | start.StateRule, key: str, kind: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(SceneError, match=rf"^{key} = '.*: {message}"):
        rule.value(str(endless(kind, tmp_path)), key)


def test_a_scene_is_a_regular_file_of_bounded_size(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "scene.toml")
    with pytest.raises(SceneError, match=r"scene\.toml: must be a regular file"):
        file_text(tmp_path / "scene.toml")
    (tmp_path / "large.toml").write_bytes(b"#" * (files.LARGEST_FILE + 1))
    with pytest.raises(SceneError, match=r"large\.toml: is too large: must be at most 1000000 bytes"):
        Scene.load(tmp_path / "large.toml")


@pytest.mark.parametrize("part", ["a", '"="', "'#'", r'"\""'])
@pytest.mark.parametrize("dot", [".", " . "])
@pytest.mark.parametrize("line", ["{} = 1", "[{}]", "x = {{{} = 1}}", "x = [1.0,\n {{{} = 1}}]"])
def test_the_parts_of_a_dotted_key_are_bounded(part: str, dot: str, line: str) -> None:
    with pytest.raises(SceneError, match=f"^not a scene: a key has more than {MOST_PARTS} parts$"):
        toml_tables(line.format(dot.join([part] * (MOST_PARTS + 1))))
    assert toml_tables(line.format(dot.join([part] * MOST_PARTS)))


def test_the_bound_is_that_of_keys_only() -> None:
    text = f"signal = {[[0.1 * n, 0.2 * n] for n in range(1000)]}"
    assert len(toml_tables(text)["signal"]) == 1000
    assert toml_tables('x = "' + ". " * 1000 + '"')
    assert assignment("a=" + "b." * 1000) == ("a", "b." * 1000)  # a word: never a key of inner tables
