"""Processor time of each test file, children included, printed when all tests are done: seconds on the clock
depend on what else the machine does, and on how many tests run side by side."""

import os
from collections import Counter
from collections.abc import Generator
from typing import Any

import pytest

NAME = "processor_seconds"
STARTED = pytest.StashKey[float]()


def _processor_seconds() -> float:
    """Return the processor time of this process and of its children that have ended."""
    return sum(os.times()[:4])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, Any, Any]:
    item.stash[STARTED] = _processor_seconds()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Generator[None, Any, Any]:
    report = yield
    if report.when == "teardown":  # with its set-up, and that of the fixtures it was the first to ask for
        report.user_properties.append((NAME, _processor_seconds() - item.stash[STARTED]))
    return report


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print the files from the longest to the shortest, down to one second."""
    seconds: Counter[str] = Counter()
    tests: Counter[str] = Counter()
    for report in (report for reports in terminalreporter.stats.values() for report in reports):
        if isinstance(report, pytest.TestReport) and report.when == "teardown":
            file = report.nodeid.partition("::")[0]
            seconds[file] += dict(report.user_properties)[NAME]
            tests[file] += 1
    terminalreporter.section("processor time by file")
    for file, spent in seconds.most_common():
        if spent >= 1.0:
            terminalreporter.write_line(f"{spent:7.1f} s  {tests[file]:4d} tests  {file}")
    terminalreporter.write_line(f"{seconds.total():7.1f} s  {tests.total():4d} tests  in all")
