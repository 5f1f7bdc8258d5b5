"""The matrix as docs/reference/combinations.md prints it: the golden files, and why each refused pair is refused."""

import re
from collections import defaultdict
from pathlib import Path

from tests.matrix.features import KINDS, Kind
from tests.matrix.outcomes import (
    BUILDS,
    GOLDEN,
    MEANING,
    NOT_BUILT,
    PHYSICS,
    golden,
    pair,
    refusal,
)
from tests.pages import placed

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "combinations.md"


def current(page: str) -> str:
    """Return the page with both kinds of scene as they are now."""
    for kind in KINDS:
        page = placed(page, kind.name, written(kind))
    return page


def written(kind: Kind) -> str:
    """Return the matrix of a kind of scene and the table of its refusals in Markdown."""
    matrix = (GOLDEN / f"{kind.name}.txt").read_text("utf-8")
    lines = [
        f"| {MEANING[symbol]} | {_in_words(kind, pairs)} | `{_said(kind, pairs)}` |"
        for (symbol, _), pairs in sorted(refused(kind).items(), key=lambda each: each[0][0] == NOT_BUILT)
    ]
    return "\n".join(["```text", f"{matrix}```", "", "| why | refused together | message |", "|---|---|---|", *lines])


def refused(kind: Kind) -> dict[tuple[str, str], list[tuple[str, str]]]:
    """Return the refused pairs of a kind of scene by symbol and rule, a feature and itself for it alone."""
    found = defaultdict(list)
    for name, line in golden(kind.name).items():
        for other, symbol in zip(kind.features, line, strict=False):
            if symbol in (PHYSICS, NOT_BUILT):
                found[symbol, _rule(_message(kind, name, other))].append((name, other))
    return found


def _message(kind: Kind, name: str, other: str) -> str:
    found = refusal(kind, pair(kind, name, other) or {})
    assert found is not None, f"{name} + {other} builds, and the golden file does not say so"
    return found.message


def _rule(message: str) -> str:
    """Return what a message asks for, whatever its key and its values are."""
    asked = re.search(r": (must|needs|has|is) .*", message)
    return re.sub(r'\d[\d.e+-]*|\(.*?\)|"\w+"', "#", asked[0] if asked else message)


def _said(kind: Kind, pairs: list[tuple[str, str]]) -> str:
    """Return the message of the first feature that is refused alone, or of the first pair."""
    first = next((each for each in pairs if each[0] == each[1]), pairs[0])
    return re.sub(r"\s+", " ", _message(kind, *first)).replace("|", r"\|")


def _in_words(kind: Kind, pairs: list[tuple[str, str]]) -> str:
    """Return pairs in words: features that are refused alone, with what they need; then the others of each feature."""
    alone = [name for name, other in pairs if name == other]
    beside: dict[str, list[str]] = defaultdict(list)
    for name, other in pairs:
        if not {name, other} & {*alone}:
            beside[name].append(other)
    said = [f"{name} with {', '.join(others)}" for name, others in beside.items()]
    return "; ".join([*(name + _but(kind, name) for name in alone), *said])


def _but(kind: Kind, name: str) -> str:
    """Return " without A or B" for a feature that is refused alone and builds with these."""
    rows, names = golden(kind.name), [*kind.features]
    own = zip(names, rows[name], strict=False)
    later = ((other, line[names.index(name)]) for other, line in rows.items() if len(line) > len(rows[name]))
    there = [other for other, symbol in (*own, *later) if symbol == BUILDS]
    return f" without {' or '.join(there)}" if there else ""
