"""The cost of second order: no way in a ratio is less accurate than another, and the page holds what was measured."""

from pathlib import Path

import pytest

from benchmarks import second_order
from benchmarks.second_order import Plane, Sheet, Spent

PAGE = Path(__file__).parents[2] / "benchmarks" / "RESULTS.md"


def test_the_cheapest_way_that_is_no_less_accurate_is_taken() -> None:
    ways = [Spent(0.1, 1e-2), Spent(0.4, 1e-4), Spent(0.3, 1e-5)]
    assert second_order.cheapest(ways, 1e-3) == ways[2]
    assert second_order.cheapest(ways, 2e-2) == ways[0]
    assert second_order.cheapest(ways, 1e-6) is None


def test_ratios_are_within_rounds() -> None:
    # The machine was ten times slower in the second round
    rounds = [Plane(Spent(k * 0.01, 1e-3), Spent(k * 0.05, 1e-4), None) for k in (1.0, 10.0)]
    assert second_order.plane_line(0.2, rounds)[-2:] == ["5, 5", "–"]
    sheets = [Sheet(k * 0.1, k * 0.6, 1e-9, 1e-5) for k in (1.0, 10.0)]
    assert second_order.sheet_line(64, sheets)[3:] == ["6, 6", "1e-09", "1e-05"]


def test_the_tables_have_the_times_and_errors_of_all(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(second_order, "LAMMPS", second_order.LAMMPS[2:3])
    assert second_order.main(["--spheres", "64", "--amplitudes", "0.2", "--repeats", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    plane, sheet = ([cell.strip() for cell in line.strip("|").split("|")] for line in (lines[-5], lines[-1]))
    assert len(plane) == len(second_order.PLANE_HEAD)
    assert float(plane[1]) == pytest.approx(4.2e-3, rel=0.05)  # the page has this error of the closed form
    assert "–" not in plane
    assert len(sheet) == len(second_order.SHEET_HEAD)
    # The two agree to sixth order, and what is left of the tolerance of the integration
    assert float(sheet[-2]) < 1e-2 * float(sheet[-1])


def test_the_page_has_the_heads_of_the_tables() -> None:
    text = PAGE.read_text("utf-8")
    for head in (second_order.PLANE_HEAD, second_order.SHEET_HEAD):
        assert "| " + " | ".join(head) + " |" in text
