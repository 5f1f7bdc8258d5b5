"""Measure every case, fast and long, and write the stability table: `python -m tests.hard.report`."""

import argparse
import logging
import sys
from collections.abc import Sequence
from pathlib import Path
from time import process_time

from tests.hard.case import Case, Cases
from tests.hard.cases import FAST, LONG
from tests.pages import write_table

HEAD = ("case", "what is hard", "figure", "bound", "where the bound comes from")


def table(cases: Cases) -> list[Sequence[str]]:
    """The cases as rows of a table, its head first."""
    return [HEAD, *map(_row, cases)]


def _row(case: Case) -> tuple[str, ...]:
    figure = f"{case.figure:.3g}" + ("" if case.holds else " **missed**")
    return case.name, case.hard, figure, case.bound, case.reason


def main(arguments: list[str] | None = None) -> int:
    """Exit status 1 when a bound is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/stability.csv"))
    output = parser.parse_args(arguments).output
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    cases: Cases = []
    for name, measure in {**FAST, **LONG}.items():
        start = process_time()
        cases += measure()
        logging.info("%-28s %6.1f s of CPU", name, process_time() - start)
    write_table(output, table(cases))
    missed = [case for case in cases if not case.holds]
    for case in missed:
        logging.error("missed: %s", case)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
