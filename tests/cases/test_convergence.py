"""Second order against the exact lattice at ever smaller amplitude: the slope is 2, and a wrong theory has another."""

from dataclasses import replace
from functools import cache

import pytest

from cases.convergence import case as cv
from granular_analysis import second_harmonic as sh
from tests.conftest import members

SILICA = sh.ratios(cv.POISSON_RATIO)


@cache
def curves(name, xi):
    return list(cv.convergence([(name, xi)]))


@pytest.mark.parametrize(("name", "xi"), members(cv.WAVES, ("L", 2.6), ("RT", 2.6)))
def test_relative_error_of_second_order_has_slope_two(name, xi):
    # 0.02: the orders above bend the fit over a ≤ 0.1 by up to 0.0084 (L at ξ=0.802).
    assert [c.slope for c in curves(name, xi)] == pytest.approx([2] * len(curves(name, xi)), abs=0.02)


def test_the_largest_amplitude_is_left_out_of_the_fit_with_reason():
    assert {(c.row, c.component) for c in curves("L", 0.802)} == {(row, "p") for row in cv.ROWS}
    assert min(c.first_slope for c in curves("L", 0.802)) < 1.98


@pytest.mark.parametrize("coefficient", ["alpha", "beta"])
def test_one_percent_in_a_nonlinear_coefficient_shows_in_every_p_and_nowhere_else(coefficient):
    wrong = replace(SILICA, **{coefficient: 1.01 * getattr(SILICA, coefficient)})
    found = list(cv.convergence([("TR", 0.802)], theory=wrong))
    assert max(c.slope for c in found if c.component == "p") < 1
    assert [c.slope for c in found if c.component != "p"] == pytest.approx([2] * 6, abs=0.02)  # as above


def fake_curves():
    errors = {"p": 1.0, "q": 0.1, "φ": 0.5}
    return [
        cv.Curve(name, xi, row, component, tuple(scale * a**2 for a in cv.AMPLITUDES))
        for name, xi in cv.WAVES
        for row in cv.ROWS
        for component, scale in errors.items()
    ]


def test_table_shows_errors_and_slopes_of_every_curve():
    made = fake_curves()
    made[0] = replace(made[0], errors=(0.1, *made[0].errors[1:]))
    head, first, *rest = cv.table(made).splitlines()
    assert head.split()[-2:] == ["slope", "(0.2→0.1)"]
    assert first.split() == [
        "L", "0.802", "0", "p", "1.00e-01", "1.00e-02", "2.50e-03", "6.25e-04", "1.56e-04", "2.000", "3.322",
    ]  # fmt: skip
    assert len(rest) == len(made) - 1


@pytest.mark.usefixtures("drawn_once")
def test_command_prints_the_table_and_writes_the_figure(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cv, "convergence", fake_curves)
    cv.main(["-o", str(tmp_path / "new" / "convergence.png")])
    assert capsys.readouterr().out == cv.table(fake_curves()) + "\n"
    assert (tmp_path / "new" / "convergence.png").read_bytes().startswith(b"\x89PNG")
