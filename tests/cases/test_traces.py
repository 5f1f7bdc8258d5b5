"""Traces and frequencies of one record: frequencies with their errors, and the table of the page."""

from pathlib import Path

import numpy as np
import pytest

from cases.run import Case

case = pytest.importorskip("cases.traces.case")
TABLE = Path(__file__).parents[2] / "docs" / "fit_traces.csv"


def test_frequencies_of_noisy_cosines_scatter_by_their_errors() -> None:
    """The scatter of 60 sets is known to 9 %; four of these are allowed."""
    times, omega, rng = 0.5 * np.arange(1, 121), (0.5, 2.1), np.random.default_rng(1)
    moved = np.cos(omega[0] * times) + 0.3j * np.sin(omega[1] * times)
    found = np.array(
        [case.cosines(times, moved + 0.1 * rng.normal(size=(120, 2)) @ (1, 1j), 0.1, (0.52, 2.08)) for _ in range(60)]
    )
    off = (found[:, :, 0] - omega) / found[:, :, 1]
    assert np.std(off, axis=0) == pytest.approx([1, 1], rel=0.36)
    assert np.abs(off.mean(axis=0)).max() < 4 / 60**0.5
    with pytest.raises(ValueError, match="has no peak near the frequency of the model"):
        case.cosines(times, moved, 0.1, (5.0,))


def test_the_table_of_the_page_has_the_numbers_that_the_case_must_print() -> None:
    printed = TABLE.read_text(encoding="utf-8")
    numbers = [each for each in Case.load("traces").expected() if each.line.endswith(",")]
    assert len(numbers) > 8
    assert [each.missed(printed) for each in numbers] == [""] * len(numbers)
    assert printed.splitlines()[0] == case.HEAD
