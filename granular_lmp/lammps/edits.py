"""Insert additional lines into a deck, at the places that its headings name.

A block begins with a line ``# --- NAME ...`` and ends before the next one; the last block is ``run``.
"""

import re
from collections.abc import Mapping

from granular_lmp.errors import DeckError
from granular_lmp.scene.schema import allowed_names

# LAMMPS joins lines at a last & and between triple quotes before it strips comments: such comments are more than that
_COMMENT = re.compile(r'(?:^|[ \t]+)#(?= )(?!.*(?:"""|&\s*$)).*', re.MULTILINE)
_BEGIN = re.compile(r"^(?:# --- (\w+)|(run) \$)", re.MULTILINE)


def places(text: str) -> dict[str, tuple[int, int]]:
    """Return the begin and end of each block of a deck, by name, in the order of the text."""
    found = list(_BEGIN.finditer(text))
    ends = [match.start() for match in found[1:]] + [len(text)]
    return {match[1] or match[2]: (match.start(), end) for match, end in zip(found, ends, strict=True)}


def with_lines(text: str, before: Mapping[str, str], after: Mapping[str, str]) -> str:
    """Return the text of a deck with lines before and after blocks.

    Raises
    ------
    DeckError
        If there is no such block.
    """
    there = places(text)
    for name in (*before, *after):
        if name not in there:
            raise DeckError(f"{name!r}: no such place in this deck; {allowed_names(name, there)}")
    pieces = [text[: min(begin for begin, _ in there.values())]]
    for name, (begin, end) in there.items():
        block = text[begin:end].rstrip("\n")
        own = [lines.strip("\n") for lines in (before.get(name, ""), block, after.get(name, "")) if lines.strip()]
        pieces.append("\n".join(own) + text[begin:end][len(block) :])
    return "".join(pieces)


def differing_lines(written: str, text: str) -> list[str]:
    """Return the lines that differ between a written and another text: "+ ..." is new, "- ..." is gone.

    Comments do not count, so a deck that an earlier release wrote with other comments is not an edited one; those that
    end in "&" or hold triple quotes do, as LAMMPS ignores lines behind them too.
    """
    if written == text:
        return []
    from difflib import ndiff  # kept out of start-up

    before, after = ([line for line in _COMMENT.sub("", each).splitlines() if line] for each in (written, text))
    return [line for line in ndiff(before, after) if line.startswith(("+ ", "- "))]
