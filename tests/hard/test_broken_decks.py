"""A deck with one word broken is a `LammpsError` or the same run: no hang, and the interpreter lives."""

import re
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import pytest
from hypothesis import settings

from granular_lmp.errors import WorkerError
from granular_lmp.studies.executors import Workers
from tests.hard.broken import FINISHED, OTHER, deck, outcome, tokens

Break = Callable[[str], str]

BROKEN: dict[str, Break] = {"dropped": lambda word: "", "garbled": lambda word: "xyzzy"}
# Still a word of LAMMPS's, perhaps: the run may be another one
SHIFTED: dict[str, Break] = {
    "without its first character": lambda word: word[1:],
    "without its last character": lambda word: word[:-1],
    "doubled": lambda word: word + word,
    "twice": lambda word: f"{word} {word}",
}
# Words without which the run is the same one: names, what a guard says besides, and what nobody reads in a short run
HARMLESS = {"v_tau", "v_overlap", "checkpoint.a", "checkpoint.b", "NULL", "plane", "move", "looks"}
HARMLESS |= {"${dump}.contacts", "c_contact[1]", "c_contact[2]"}  # contacts are dumped when a bound passes, not here
UNREAD = {"vx", "vy", "omegaz"}  # columns of the dump of the centre that its record does not have


THOROUGH = settings().max_examples > 1000  # make stability


@pytest.fixture(scope="module")
def workers() -> Iterator[Workers]:
    with Workers(2 if THOROUGH else 1) as workers:  # to start one takes as long as thirty runs
        yield workers


def outcomes(
    workers: Workers, name: str, breaks: Iterable[Break], words: slice = slice(None)
) -> dict[tuple[str, str, int], str]:
    """(word, what became of it, where) → how the run ended, of some words of a deck."""
    text = deck(name).input_text
    runs: dict[tuple[str, str, int], Any] = {}
    for broken in breaks:
        for start, end in tokens(text)[words]:
            word = text[start:end]
            runs[word, broken(word), start] = workers.submit(outcome, name, start, end, broken(word))
    return {what: _end(run) for what, run in runs.items()}


def _end(run: Any) -> str:
    try:
        return str(run.result())
    except WorkerError as error:
        return f"WorkerError: {error}"


def wrong(ended: dict[tuple[str, str, int], str], allowed: tuple[str, ...]) -> list[str]:
    return [f"{what}: {how}" for what, how in ended.items() if not how.startswith(allowed)]


# Every eighth word is dropped here, and by make stability each is broken in both ways
thorough = pytest.mark.skipif(not THOROUGH, reason="a minute or more: make stability")
MORE = (("dropped", 4, 8), ("dropped", 2, 4), ("garbled", 1, 2))
PARTS = [
    ("dropped", 0, 8),
    *(pytest.param(*part, marks=pytest.mark.more) for part in MORE),
    *(pytest.param(*part, marks=thorough) for part in (("garbled", 0, 2), ("dropped", 1, 2))),
]


@pytest.mark.parametrize(("broken", "first", "every"), PARTS)
def test_a_deck_with_a_broken_word_is_an_error_of_lammps(broken: str, first: int, every: int, workers: Workers) -> None:
    ended = outcomes(workers, "tr_nonresonant", [BROKEN[broken]], slice(first, None, every))
    assert not wrong(ended, ("LammpsError", FINISHED))
    assert {word for (word, _, _), how in ended.items() if how == FINISHED} <= HARMLESS
    assert {word for (word, _, _), how in ended.items() if how == OTHER} <= UNREAD
    assert sum(how.startswith("LammpsError") for how in ended.values()) > 0.9 * len(ended) > 300 / every


@thorough
@pytest.mark.parametrize("scene", ["tr_nonresonant", "tr_sliding", "steel_compressed"])
def test_a_deck_with_a_word_that_is_nearly_right_ends_too(scene: str, workers: Workers) -> None:
    ended = outcomes(workers, scene, SHIFTED.values())
    # LAMMPS 22Jul2025 converts the range of types "**" with std::stol, and some numbers of a variable with std::stod,
    # and catches nothing: the process aborts
    killers = {word: how for (word, _, _), how in ended.items() if how.startswith("WorkerError")}
    assert "*" in killers
    assert all(re.search(r"what\(\):\s+sto[dl]", how) for how in killers.values())
    assert not wrong(ended, ("LammpsError", "EffectError", "WorkerError", FINISHED, OTHER))


def test_a_killed_interpreter_is_seen(workers: Workers) -> None:
    start, end = next((a, b) for a, b in tokens(deck("l_wave").input_text) if deck("l_wave").input_text[a:b] == "*")
    assert _end(workers.submit(outcome, "l_wave", start, end, "**")).startswith("WorkerError")
