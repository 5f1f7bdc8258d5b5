"""The verification manual: cases that stand beside their tests, and the table that the tests and their mutants write.

A case is declared on a test by `verifies`, and the test hands its error to the fixture `measured`, which holds it to
the tolerance of the case:

    @verifies("feature", reference="…", tolerance=1e-6, reason="…", mutant=Mutant("analysis/…", "old", "new"))
    def test_claim(measured):
        measured(off(found, expected))

`python -m tests.manual` runs every test with its mutant, a change of the source by which it has to fail, and writes
``docs/verification.csv``. The tests hold the table to the declarations and to what they measure.
"""

import ast
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
Measure = Callable[[float], None]  # of the fixture `measured`


@dataclass(frozen=True)
class Mutant:
    """A change of the source: the text `old`, which stands once in a file, becomes `new`."""

    file: str
    old: str
    new: str

    def __str__(self) -> str:
        old, new = (" ".join(text.split()) for text in (self.old, self.new))
        return f"`{self.file}`: `{old}` → `{new}`"

    def applied(self, text: str) -> str:
        """Return the text of the file with the change.

        Raises
        ------
        ValueError
            If `old` does not stand in the text exactly once, or is `new`.
        """
        if text.count(self.old) != 1 or self.old == self.new:
            raise ValueError(f"{self}: the text stands {text.count(self.old)} times in the file; must be once")
        return text.replace(self.old, self.new)


@dataclass(frozen=True)
class Case:
    """A line of the manual: the feature, the reference, the tolerance with its reason, and the mutant that fails."""

    feature: str
    reference: str
    tolerance: float
    reason: str
    mutant: Mutant


def verifies(feature: str, *, reference: str, tolerance: float, reason: str, mutant: Mutant) -> pytest.MarkDecorator:
    """Declare that a test, which asks for `measured`, is a case of the manual."""
    return pytest.mark.verifies(Case(feature, reference, tolerance, reason, mutant))


def off(found: Any, expected: Any, size: float | None = None) -> float:
    """Return the largest difference of two arrays over a size, by default the largest magnitude of `expected`."""
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.shape == expected.shape
    return float(np.max(np.abs(found - expected)) / (np.max(np.abs(expected)) if size is None else size))


def differing(one: bytes, other: bytes) -> int:
    """Return how many bytes of two files differ."""
    return abs(len(one) - len(other)) + sum(a != b for a, b in zip(one, other, strict=False))


def agree(measured: float, committed: float, tolerance: float) -> bool:
    """Return whether two measured errors are within a factor of two, give or take a twentieth of the tolerance.

    Errors of method hardly differ between processors. Those of rounding do, and are far below their tolerances.
    """
    small, large = sorted([measured, committed])
    return bool(large <= 2 * small + tolerance / 20)


@cache
def declared() -> dict[str, Case]:
    """Return the cases of all tests, in the order of their files: ``tests/…/test_x.py::test_y`` → case."""
    words = {"verifies": Case, "Mutant": Mutant}
    cases = {}
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        text = path.read_text("utf-8")
        if "\n@verifies(" not in text:
            continue
        for test in ast.parse(text).body:
            for mark in getattr(test, "decorator_list", []):
                if isinstance(mark, ast.Call) and getattr(mark.func, "id", "") == "verifies":
                    assert isinstance(test, ast.FunctionDef)
                    assert "measured" in [argument.arg for argument in test.args.args], test.name
                    case = eval(compile(ast.Expression(mark), str(path), "eval"), dict(words))
                    cases[f"{path.relative_to(ROOT).as_posix()}::{test.name}"] = case
    return cases
