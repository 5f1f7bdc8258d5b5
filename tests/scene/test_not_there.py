"""A scene cannot say everything: the page and the messages say the same, and no wish is a key that there is."""

import re
from pathlib import Path

import pytest

from granular_lmp import Scene
from granular_lmp.errors import SceneError
from granular_lmp.scene.json_schema import keys
from granular_lmp.scene.not_there import NOT_THERE, PAGE, not_supported, table

ROOT = Path(__file__).parents[2]
WORDS = [(row, word) for row in NOT_THERE for word in row.words.split()]


def without_links(text: str) -> str:
    return re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", text)


def test_the_page_holds_the_table_of_the_messages() -> None:
    assert table() in without_links((ROOT / PAGE).read_text(encoding="utf-8"))


def test_no_wish_is_a_key_of_a_scene() -> None:
    there = {key.name for key in keys()} | set(Scene.layout.sections) | {"name", "description"}
    assert not there & {word for _, word in WORDS}


def test_no_word_stands_for_two_wishes() -> None:
    words = [word for _, word in WORDS]
    assert len(words) == len(set(words))


@pytest.mark.parametrize("key", ["packing.Gravity", "packing.kagome", "temperature"])
def test_a_wish_is_refused_with_the_reason_and_the_page(key: str) -> None:
    with pytest.raises(SceneError, match=rf"not supported: .+; instead: .+ \({PAGE}\)$"):
        Scene.load("tr_periodic").with_values({key: 1.0})


def test_a_misspelt_key_is_no_wish() -> None:
    assert not_supported("wavenumer") is None
