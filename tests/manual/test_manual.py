"""The manual says what its tests declare and measure, and each mutant can still be made."""

import csv
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.manual import ROOT, Mutant, agree, declared, off
from tests.manual.__main__ import rewrite
from tests.manual.table import Row, committed, node


def test_the_table_has_a_line_for_each_case_as_it_is_declared() -> None:
    assert len(declared()) >= 40
    assert list(committed()) == list(declared()), "python -m tests.manual writes the table"
    for name, case in declared().items():
        line = committed()[name]
        changed = None if line["with the change"] == "fails" else float(line["with the change"])
        row = Row(case, node(line), float(line["measured"]), changed)
        assert row.cells() == list(line.values())
        assert row.measured <= case.tolerance
        assert changed is None or changed > case.tolerance


def test_the_pages_and_tests_that_the_table_lists_are_there() -> None:
    with (ROOT / "docs/tests.csv").open(encoding="utf-8", newline="") as file:
        rows = {line["page"]: line["tests"].split() for line in csv.DictReader(file)}
    listed = [f"tests/{name}.py" for names in rows.values() for name in names]
    assert len(listed) > 50
    pages = [page if "/" in page else f"docs/{page}" for pages in rows for page in pages.split()]
    assert [name for name in (*listed, *pages) if not (ROOT / name).is_file()] == []


@pytest.mark.parametrize("name", declared())
def test_the_text_that_a_mutant_changes_stands_once_in_its_file(name: str) -> None:
    mutant = declared()[name].mutant
    mutant.applied((ROOT / mutant.file).read_text("utf-8"))


def test_a_text_that_stands_twice_or_is_not_changed_is_no_mutant() -> None:
    assert Mutant("a.py", "b", "c").applied("a b") == "a c"
    for text, new in (("b b", "c"), ("a", "c"), ("b", "b")):
        with pytest.raises(ValueError, match="must be once"):
            Mutant("a.py", "b", new).applied(text)


def test_errors_agree_to_a_factor_of_two_or_far_below_the_tolerance() -> None:
    assert agree(1e-6, 1.9e-6, 1e-5)
    assert agree(1e-15, 3e-14, 1e-12)
    assert not agree(1e-6, 3e-6, 1e-5)
    assert not agree(3e-6, 1e-6, 1e-5)


def test_a_difference_is_over_the_largest_magnitude_or_the_size_given() -> None:
    assert off([1.0, -2.0], [1.0, -4.0]) == 0.5
    assert off([1.0], [2.0], size=4) == 0.25


def test_a_change_of_the_same_size_in_the_same_second_is_seen(tmp_path: Path) -> None:
    file = tmp_path / "changed.py"
    for value in (1, 2):
        rewrite(file, f"VALUE = {value}\n")
        os.utime(file, (0, 0))
        command = [sys.executable, "-c", "import changed; print(changed.VALUE)"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        assert done.stdout == f"{value}\n"
