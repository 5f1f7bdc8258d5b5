"""The table of pairs, docs/combinations.csv: of each two features of a scene what becomes of them together, and why.

`granular_lmp.studies.combine` says what becomes of them; `tests.matrix.compared` adds how far a run is from its
network. The table may only gain: `update` takes no pair away.
"""

import csv
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from granular_lmp.studies.combine import BUILDS, EXCLUSIVE, NOT_BUILT, PHYSICS, outcome
from granular_lmp.studies.features import Kind
from tests.pages import write_table

TABLE = Path(__file__).parents[2] / "docs" / "combinations.csv"
HEAD = ("scene", "feature", "with", "outcome", "message", "departure", "bound")
WORDS = (BUILDS, PHYSICS, NOT_BUILT, EXCLUSIVE)
Pair = tuple[str, str, str]  # kind of scene, feature, and one that stands before it in the list, or itself: it alone


class Row(NamedTuple):
    """What becomes of a pair, why, and how far its run is from the network, if it is compared."""

    outcome: str
    message: str = ""
    departure: str = ""
    bound: str = ""


Rows = dict[Pair, Row]


@cache
def found(kind: Kind, one: str, other: str) -> Row:
    """Return what becomes of two features in one scene today; of a feature and itself what becomes of it alone."""
    return Row(*outcome(kind, *(kind.features[name] for name in dict.fromkeys((one, other)))))


def rows_of(kind: Kind, name: str) -> Rows:
    """Return the rows of a feature with those before it, and alone, as they are today."""
    names = [*kind.features]
    return {(kind.name, name, other): found(kind, name, other) for other in names[: names.index(name) + 1]}


def committed(file: Path = TABLE) -> Rows:
    """Return the rows of the table."""
    with file.open(encoding="utf-8", newline="") as stream:
        lines = [*csv.reader(stream)][1:]
    return {(kind, name, name if other == "alone" else other): Row(*cells) for kind, name, other, *cells in lines}


def write(rows: Rows, file: Path = TABLE) -> None:
    """Write rows as the table."""
    lines = ((kind, one, "alone" if other == one else other, *row) for (kind, one, other), row in rows.items())
    write_table(file, [HEAD, *lines])


def alone(kind: Kind) -> list[str]:
    """Return the features that build without another."""
    rows = committed()
    return [name for name in kind.features if rows[kind.name, name, name].outcome == BUILDS]


def losses(before: Rows, now: Rows) -> Iterator[str]:
    """Yield each pair that is not as good as it was: whatever changes must build now."""
    for pair, old in before.items():
        new = now.get(pair, Row("gone")).outcome
        if new not in (old.outcome, BUILDS):
            yield f"{' + '.join(pair)}: {old.outcome} before, {new} now"


def gains(before: Rows, now: Rows) -> Iterator[str]:
    """Yield each pair that is better than it was, or new."""
    for pair, new in now.items():
        old = before.get(pair, Row("not there")).outcome
        if old != new.outcome:
            yield f"{' + '.join(pair)}: {old} before, {new.outcome} now"


def update(before: Rows, now: Rows) -> Rows:
    """Return what the table may hold from now on; what was measured of a pair that builds stays.

    Raises
    ------
    ValueError
        If a pair is worse than before. Who means it edits the table, and says in its commit why.
    """
    if lost := [*losses(before, now)]:
        raise ValueError("the table may only gain: " + "; ".join(lost))
    updated = dict(now)
    for pair, row in now.items():
        if row.outcome == BUILDS and pair in before and before[pair].outcome == BUILDS:
            updated[pair] = before[pair]
    return updated
