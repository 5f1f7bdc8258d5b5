"""The two numbers every comparison rests on, each with values that are deliberately wrong."""

import numpy as np
import pytest

from granular_analysis.measure.norms import relative_error, slope


def test_relative_error_is_that_of_the_l2_norm():
    assert relative_error([3.0, 4.5], [3.0, 4.0]) == pytest.approx(0.1, rel=1e-15)
    assert relative_error([[1.0, 2.0]], [[1.0, 2.0]]) == 0


@pytest.mark.parametrize(("estimate", "error"), [([-1.0, -2.0], 2.0), ([0.0, 0.0], 1.0), ([1.01, 2.02], 0.01)])
def test_relative_error_sees_a_sign_an_absence_and_a_percent(estimate, error):
    assert relative_error(estimate, [1.0, 2.0]) == pytest.approx(error, rel=1e-12)  # 1.01 − 1 has 14 digits


@pytest.mark.parametrize("exponent", [-1.0, 0.0, 2.0])
def test_slope_is_the_exponent_of_a_power_law(exponent):
    x = np.array([0.2, 0.1, 0.05])
    assert slope(x, 3 * x**exponent) == pytest.approx(exponent, abs=1e-13)


def test_slope_sees_a_floor_and_one_wrong_point():
    x = np.array([0.2, 0.1, 0.05])
    assert abs(slope(x, x**2 + 1e-3) - 2) > 0.1
    assert abs(slope(x, x**2 * [1, 1, 1.1]) - 2) > 0.05


@pytest.mark.parametrize(
    ("number", "first", "second", "message"),
    [
        (relative_error, [1.0, 1.0], [1.0], "shape"),
        (relative_error, [[1.0, 1.0]], [1.0, 1.0], "shape"),
        (relative_error, 1.0, [1.0, 1.0], "shape"),
        (relative_error, [np.nan, 1.0], [1.0, 1.0], "finite"),
        (relative_error, [1.0, 1.0], [np.inf, 1.0], "finite"),
        (relative_error, [1.0, 1.0], [0.0, 0.0], "zero"),
        (relative_error, [], [], "zero"),
        (slope, [1.0, 2.0], [1.0], "length"),
        (slope, [[1.0, 2.0]], [[1.0, 2.0]], "one-dimensional"),
        (slope, [1.0, 2.0], [1.0, 0.0], "positive"),
        (slope, [-1.0, 2.0], [1.0, 1.0], "positive"),
        (slope, [1.0, 2.0], [1.0, np.nan], "finite"),
        (slope, [1.0, 1.0], [1.0, 2.0], "different"),
        (slope, [], [], "different"),
    ],
)
def test_what_has_no_relative_error_or_no_slope_is_refused(number, first, second, message):
    with pytest.raises(ValueError, match=message):
        number(first, second)
