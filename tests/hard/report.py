"""Measure every case, fast and long, and write the stability table: `python -m tests.hard.report`."""

import argparse
import logging
import sys
from pathlib import Path
from time import process_time

from tests.hard.case import Case, Cases
from tests.hard.cases import FAST, LONG

HEAD = """\
# Stability

Hard cases for LAMMPS as the decks use it, what was measured, and the bound, which is decided by physics or arithmetic
and not by the measurement. The references are the exact lattice of `analysis/theory/lattice.py` in LAMMPS's contact
geometry, symmetry, and conservation. Written by `make stability`; the fast half is asserted by `make test`, where each
kind of figure in it is also measured on a broken deck or against a wrong reference, and has to miss its bound
(`tests/hard/test_broken_cases.py`).

Tested elsewhere: restart and ranks in `tests/runs/test_launch.py`, contacts and collisions in `tests/validation/`, bad
input, broken decks, kills, full disks and honest status in `tests/hard/test_*.py`.

Two limits are known: `**` as a word of a deck aborts LAMMPS itself, and the process with it (an uncaught `std::stol`);
and a run that is killed before its first checkpoint, by default after about half a minute, starts anew.

Units: lengths in D0, times in τ; spheres of the paper. Impacts are in their own units, of steel spheres.
"The works" is what the secant law, which has no potential, and
LAMMPS's lever arm do on the wave (`tests/hard/ledger.py`).

"""


def table(cases: Cases) -> str:
    """The cases as a Markdown table."""
    lines = ["| case | what is hard | figure | bound |", "|---|---|---|---|"]
    return "\n".join([*lines, *map(_line, cases)]) + "\n"


def _line(case: Case) -> str:
    figure = f"{case.figure:.3g}" + ("" if case.holds else " **missed**")
    return f"| {case.name} | {case.hard} | {figure} | {case.bound}: {case.reason} |"


def main(arguments: list[str] | None = None) -> int:
    """Exit status 1 when a bound is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/stability.md"))
    output = parser.parse_args(arguments).output
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    cases: Cases = []
    for name, measure in {**FAST, **LONG}.items():
        start = process_time()
        cases += measure()
        logging.info("%-28s %6.1f s of CPU", name, process_time() - start)
    output.write_text(HEAD + table(cases), encoding="utf-8")
    missed = [case for case in cases if not case.holds]
    for case in missed:
        logging.error("missed: %s", case)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
