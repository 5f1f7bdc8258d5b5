"""The table of the manual, ``docs/verification.csv``."""

import csv
from dataclasses import dataclass
from functools import cache

from tests.manual import ROOT, Case, declared
from tests.pages import write_table

TABLE = ROOT / "docs" / "verification.csv"
HEAD = ["feature", "reference", "tolerance", "measured", "with the change", "reason of the tolerance", "change", "test"]


@dataclass(frozen=True)
class Row:
    """A case, its test with the parameters of the largest error, and the errors measured without and with its mutant.

    The second is empty where the changed source fails before anything is measured.
    """

    case: Case
    test: str
    measured: float
    changed: float | None

    def cells(self) -> list[str]:
        """Return the cells of its line."""
        case, changed = self.case, "fails" if self.changed is None else number(self.changed)
        path, _, test = self.test.partition("::")
        where = f"`{path.removeprefix('tests/')}` `{test}`"
        errors = [number(case.tolerance), number(self.measured), changed]
        return [case.feature, case.reference, *errors, case.reason, str(case.mutant), where]


def number(value: float) -> str:
    """Return a number of the table, two digits."""
    return f"{value:.2g}"


def write(rows: dict[str, Row]) -> None:
    """Write the rows in the order of their declarations."""
    write_table(TABLE, [HEAD, *(rows[name].cells() for name in declared() if name in rows)])


@cache
def committed() -> dict[str, dict[str, str]]:
    """Return the lines of the table by the names of their tests, each by the words of the head."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        lines = list(csv.DictReader(file))
    return {node(line).partition("[")[0]: line for line in lines}


def node(line: dict[str, str]) -> str:
    """Return the test of a line, as pytest names it."""
    path, test = line["test"].strip("`").split("` `")
    return f"tests/{path}::{test}"
