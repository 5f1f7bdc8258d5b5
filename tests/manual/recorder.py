"""A plugin of pytest: the fixture `measured`, and what it measured for ``python -m tests.manual``."""

import json
import math
import os
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.manual import ROOT, Case, Measure, agree
from tests.manual.table import committed, node

OUTPUT = "VERIFICATION_RECORD"  # the environment names a file, which gets a line for each test of a case that ran
LARGEST = pytest.StashKey[float]()
PASSED = pytest.StashKey[bool]()


@pytest.fixture
def measured(request: pytest.FixtureRequest) -> Iterator[Measure]:
    """Take an error of the case that the test verifies; it fails above the tolerance of the case."""
    case: Case = request.node.get_closest_marker("verifies").args[0]

    def measure(error: float) -> None:
        __tracebackhide__ = True
        largest = request.node.stash.get(LARGEST, 0.0)
        request.node.stash[LARGEST] = max(largest, abs(float(error))) if math.isfinite(error) else math.inf
        assert abs(float(error)) <= case.tolerance, f"{case.feature}: off by {error:.3g}, tolerance {case.tolerance:g}"

    yield measure
    if OUTPUT not in os.environ and PASSED in request.node.stash:
        assert LARGEST in request.node.stash, "the test of a case of the manual measures something"
        as_in_the_table(request.node.nodeid, request.node.stash[LARGEST], case)


def as_in_the_table(test: str, error: float, case: Case) -> None:
    """Assert that an error agrees with the table, whose test has the parameters of the largest one."""
    name = test.partition("[")[0]
    line = committed().get(name)
    assert line, f"no line of docs/verification.csv: python -m tests.manual {name} makes it"
    known = float(line["measured"])
    same = node(line) == test or error > known
    assert not same or agree(error, known, case.tolerance), (
        f"off by {error:.3g}, and by {known:g} in docs/verification.csv: python -m tests.manual {name} measures it anew"
    )


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Generator[None, Any, Any]:
    report = yield
    if report.when != "call" or not item.get_closest_marker("verifies"):
        return report
    if report.passed:
        item.stash[PASSED] = True
    if OUTPUT in os.environ:
        own = call.excinfo is None or (
            call.excinfo.type is AssertionError and not _inside_the_package(str(call.excinfo.traceback[-1].path))
        )
        said = {"test": item.nodeid, "outcome": report.outcome, "own": own, "error": item.stash.get(LARGEST, None)}
        with Path(os.environ[OUTPUT]).open("a", encoding="utf-8") as file:
            file.write(json.dumps(said) + "\n")
    return report


def _inside_the_package(path: str) -> bool:
    return any(Path(path).is_relative_to(ROOT / folder) for folder in ("granular_lmp", "analysis", "granular_analysis"))
