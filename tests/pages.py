"""What is written from code for the pages: a part between two marks, and tables as CSV."""

import csv
import re
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path


def placed(page: str, name: str, text: str) -> str:
    """Return a page with a text between the marks ``<!-- name -->`` and ``<!-- end of name -->``.

    Raises
    ------
    ValueError
        If the page does not have the marks, once each.
    """
    between = re.compile(rf"(?<=<!-- {name} -->\n).*(?=<!-- end of {name} -->)", re.DOTALL)
    changed, count = between.subn(lambda _: f"\n{text.strip()}\n\n", page)
    if count != 1:
        raise ValueError(f"the page has {count} places for {name!r}; must have one")
    return changed


def write_table(file: Path | None, rows: Iterable[Sequence[object]]) -> None:
    """Write a table, its head first, as CSV; print it where no file is given."""
    if file is None:
        csv.writer(sys.stdout, lineterminator="\n").writerows(rows)
        return
    with file.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows(rows)
