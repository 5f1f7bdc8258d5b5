"""Meaning of the columns of dumps of contacts, from the computes of the deck."""

import re
from collections.abc import Sequence
from pathlib import Path

from granular_lmp.foreign.interpreter import Command
from granular_lmp.foreign.known import files_of
from granular_lmp.foreign.reading import Reading
from granular_lmp.lammps.local_dump import ENDS, OTHER, WORDS

_COLUMN = re.compile(r"c_(\w+)(?:\[(\d+|\*|\d+\*\d*|\*\d+)\])?")
_LOCAL = ("property/local", "pair/local")


def local_dumps(reading: Reading) -> dict[Path, list[str]]:
    """Return the existing files of a deck's dumps of contacts, each with the words of its columns."""
    folder = Path(reading.deck).parent
    found: dict[Path, list[str]] = {}
    for dump in reading.dumps:
        if dump.words[3] in ("local", "local/gz"):
            words = words_of(reading, dump)
            if {*ENDS} <= {*words}:
                found |= dict.fromkeys(files_of(folder, dump), words)
    return found


def words_of(reading: Reading, dump: Command) -> list[str]:
    """Return the words of the columns of a ``dump local``; `OTHER` if a column does not describe contacts."""
    computes = {each.words[1]: each.words[4:] for each in reading.named("compute") if each.words[3] in _LOCAL}
    # With other pair styles p1, p2, … are other quantities
    known = [word for word in WORDS if reading.is_granular or not word.startswith("p") or word in ENDS]
    return [word for column in dump.words[6:] for word in _words(column, computes, known)]


def _words(column: str, computes: dict[str, tuple[str, ...]], known: Sequence[str]) -> list[str]:
    """Return the words of a column of a dump; for "c_ID[*]" those of all values of the compute."""
    match = _COLUMN.fullmatch(column)
    if match is None or match[1] not in computes:
        return [OTHER]
    values = list(computes[match[1]])
    if "cutoff" in values:
        values = values[: values.index("cutoff")]
    values = [each if each in known else OTHER for each in values]
    if match[2] is None:
        return values[:1]
    low, star, high = match[2].partition("*")
    first = int(low or 1)
    last = int(high or len(values)) if star else first
    return values[first - 1 : last]
