"""Hints for keys that a scene does not have say where to go, and none of these words is a key that there is."""

import pytest

from granular_lmp import Scene
from granular_lmp.errors import SceneError
from granular_lmp.scene.json_schema import keys
from granular_lmp.scene.unsupported import ELSEWHERE, NOT_SUPPORTED, hint

WORDS = [word for words in (NOT_SUPPORTED | ELSEWHERE).values() for word in words.split()]


def test_no_word_that_is_not_supported_is_a_key_of_a_scene() -> None:
    there = {key.name for key in keys()} | set(Scene.layout.sections) | {"name", "description"}
    assert not there & set(" ".join(NOT_SUPPORTED.values()).split())


def test_no_word_has_two_hints() -> None:
    assert len(WORDS) == len(set(WORDS))


@pytest.mark.parametrize("key", ["packing.Gravity", "packing.kagome", "temperature"])
def test_what_is_not_supported_is_refused_with_a_hint(key: str) -> None:
    with pytest.raises(SceneError, match=rf"{key}: not supported; use [^()]+$"):
        Scene.load("tr_periodic").with_values({key: 1.0})


def test_a_misspelt_key_has_no_hint() -> None:
    assert hint("wavenumer") is None
