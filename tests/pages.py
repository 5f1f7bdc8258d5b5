"""Tables of the pages that are written from code, as CSV."""

import csv
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path


def write_table(file: Path | None, rows: Iterable[Sequence[object]]) -> None:
    """Write a table, its head first, as CSV; print it where no file is given."""
    if file is None:
        csv.writer(sys.stdout, lineterminator="\n").writerows(rows)
        return
    with file.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows(rows)
