"""The fast part of the stability table holds; that each measurement can fail is found in `test_broken_cases`."""

from math import nan

import pytest

from tests.hard.case import Case
from tests.hard.cases import FAST, LONG, Measure
from tests.hard.report import table


def rounded(name: str) -> bool:
    """Return whether a case lies at an edge of the zone, at a degenerate pair of modes, or where a mode is small."""
    edge = "of the zone" in name and "next to" not in name
    return edge or "degenerate" in name or name == "L, xi = 0.01001"


# `make test` runs a similar case for each of these; tests/validation/test_pull_off.py has collisions that part
MORE = {"parting velocity", "sticking speed", "spheres that leave their substrate", "a = 0.9", "antiresonance"}
MORE |= {"corners, nu = -0.9", "corners, nu = -0.5", "corners, nu = 0.0", "corners, nu = 0.3", "corners, nu = 0.49"}
MORE |= {"a = 2", "order at a = 5", "order at a = 2.3, jkr", "noise of a long cell", "energy of a struck sheet"}
MORE |= {"order of a rough sheet, incremental", "TR, xi = 3.132", "RT, xi = 3.132", "RT, xi = 0.01001"}
MORE |= {"p at a = 0.001", "p at a = 1e-06", "a rough sheet, incremental", "mirror of a rough sheet, incremental"}
MORE |= {"sizes and units", "fcc under load", "order at a = 2.1, jkr"}
MORE |= {f"the edge of opening, {kind}" for kind in ("Hertz, secant", "DMT, incremental", "JKR, incremental")}
MORE |= {"energy of a network", "energy of a network with shear", "rounding of a network"}
# tests/theory/test_network_gradient.py and test_gradient_beside_theory.py check slopes of both modes
MORE |= {"slopes next to a pull-off", "slopes at the resonance"}
assert set(FAST) > MORE


def marks(name: str) -> list[pytest.MarkDecorator]:
    """Return what decides where a case is run."""
    return [pytest.mark.rounding] * rounded(name) + [pytest.mark.more] * (name in MORE)


CASES = [pytest.param(measure, id=name, marks=marks(name)) for name, measure in FAST.items()]


@pytest.mark.parametrize("measure", CASES)
def test_the_fast_part_of_the_stability_table_holds(measure: Measure) -> None:
    assert not [str(case) for case in measure() if not case.holds]


def test_a_figure_that_is_no_number_does_not_hold() -> None:
    assert not Case("name", "hard", nan, "reason").holds


def test_a_figure_outside_its_bounds_does_not_hold() -> None:
    held = [Case("name", "hard", figure, "reason", least=1, most=2).holds for figure in (0.99, 1, 2, 2.01)]
    assert held == [False, True, True, False]


def test_the_table_marks_what_does_not_hold() -> None:
    good, bad = (Case(name, "hard", 1.0, "reason", most=most) for name, most in (("good", 2), ("bad", 0.5)))
    _, held, missed = table([good, bad])
    assert "**" not in "".join(held)
    assert "**missed**" in "".join(missed)


def test_no_measurement_is_listed_twice() -> None:
    assert not set(FAST) & set(LONG)
