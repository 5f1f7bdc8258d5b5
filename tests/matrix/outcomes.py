"""Outcomes of two features in one scene, and the golden files that hold them.

A deck is built, or an error says why not. Each error is either physics, which stays refused, or not built, which is
open, as the line of `granular_lmp.rest.refusals` has it. Settings that exclude each other by themselves, two lattices
say, are none of both. A golden file may only gain: `update` takes no pair away.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from granular_lmp import build
from granular_lmp.errors import SceneError
from tests.matrix.features import Kind, Settings, together

BUILDS, PHYSICS, NOT_BUILT, EXCLUSIVE = ".", "P", "N", "x"
MEANING = {BUILDS: "builds", PHYSICS: "physics", NOT_BUILT: "not built", EXCLUSIVE: "exclusive"}
SYMBOLS = {said: symbol for symbol, said in MEANING.items()}
GOLDEN = Path(__file__).parent


class Refused(NamedTuple):
    """Why a pair does not build: the message, and what it is."""

    message: str
    symbol: str


_FOUND: dict[tuple[str, str], Refused | None] = {}  # by kind and settings: the page and its tests ask for them again


def refusal(kind: Kind, settings: Settings) -> Refused | None:
    """Return why a scene with these settings is refused; None if its deck is built.

    Raises
    ------
    LookupError
        If the error does not say whether it is physics or not built.
    """
    key = kind.name, repr(settings)
    if key not in _FOUND:
        _FOUND[key] = _refusal(kind, settings)
    return _FOUND[key]


def _refusal(kind: Kind, settings: Settings) -> Refused | None:
    try:
        scene = kind.scene.with_values(settings)
        deck = build(scene)
    except SceneError as error:
        return refused(error)
    assert deck.files()
    return None


def refused(error: SceneError) -> Refused:
    """Return what an error says of a pair; LookupError if it does not say whether it is physics or not built."""
    if error.because is None:
        raise LookupError(f"a refusal must say whether it is physics or not built: {error}")
    return Refused(str(error), SYMBOLS[error.because])


def outcome(kind: Kind, one: str, other: str) -> str:
    """Return what becomes of two features in one scene; of a feature and itself that of it alone."""
    settings = pair(kind, one, other)
    if settings is None:
        return EXCLUSIVE
    found = refusal(kind, settings)
    return found.symbol if found else BUILDS


def pair(kind: Kind, one: str, other: str) -> Settings | None:
    """Return the settings of two features, or of one; None if they exclude each other."""
    return together(*(kind.features[name] for name in dict.fromkeys((one, other))))


def row(kind: Kind, name: str) -> str:
    """Return the outcomes of a feature with those before it, and alone."""
    names = [*kind.features]
    return "".join(outcome(kind, name, other) for other in names[: names.index(name) + 1])


# --- golden files ----------------------------------------------------------------------------------------------------

Rows = dict[str, str]  # feature → its outcomes with those before it, and alone


def text(rows: Rows) -> str:
    """Return rows as a golden file holds them."""
    lines = (f"{number:2} {name:16} {' '.join(line)}" for number, (name, line) in enumerate(rows.items(), 1))
    return "\n".join([", ".join(f"{symbol} {said}" for symbol, said in MEANING.items()), *lines]) + "\n"


def golden(kind: str) -> Rows:
    """Return the rows of a golden file."""
    lines = (GOLDEN / f"{kind}.txt").read_text("utf-8").splitlines()[1:]
    return {line[3:19].strip(): line[20:].replace(" ", "") for line in lines}


def losses(before: Rows, now: Rows) -> Iterator[str]:
    """Yield each pair that is not as good as it was: whatever changes must build now."""
    for name, line in before.items():
        if name not in now:
            yield f"{name}: is gone"
        for other, old, new in zip(before, line, now.get(name, line), strict=False):
            if old != new and new != BUILDS:
                yield f"{name} + {other}: {MEANING[old]} before, {MEANING[new]} now"


def gains(before: Rows, now: Rows) -> Iterator[str]:
    """Yield each pair that is better than it was, and each feature that is new."""
    for name, line in now.items():
        if name not in before:
            yield f"{name}: is new"
        elif before[name] != line and not [*losses({name: before[name]}, {name: line})]:
            yield f"{name}: {before[name]} before, {line} now"


def update(before: Rows, now: Rows) -> Rows:
    """Return what a golden file may hold from now on.

    Raises
    ------
    ValueError
        If a pair is worse than before. Who means it edits the file, and says in its commit why.
    """
    if lost := [*losses(before, now)]:
        raise ValueError("a golden file may only gain: " + "; ".join(lost))
    return now
