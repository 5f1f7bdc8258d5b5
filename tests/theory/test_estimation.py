"""Least squares: closed forms of straight lines, coverage, and parameters that data cannot tell apart."""

import numpy as np
import pytest

from granular_analysis.theory.estimation import LOSSES, WIDE, Estimate, Parameter, estimate
from tests.conftest import members

X = np.linspace(1.0, 2.0, 9)
LINE = [Parameter("slope", 3.0), Parameter("offset", 0.5)]


def line(values: np.ndarray) -> np.ndarray:
    return values[0] * X + values[1]


def noisy(sigma: float, seed: int = 0) -> np.ndarray:
    return 2.0 * X + 1.0 + sigma * np.random.default_rng(seed).normal(size=len(X))


def test_a_line_with_known_errors_has_the_values_and_the_errors_of_the_normal_equations() -> None:
    found = estimate(LINE, line, noisy(0.01), np.full(len(X), 0.01))
    design = np.column_stack([X, np.ones_like(X)]) / 0.01
    covariance = np.linalg.inv(design.T @ design)
    values = covariance @ design.T @ (noisy(0.01) / 0.01)
    deviation = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(found.values, values, rtol=1e-9)
    half = (found.intervals[:, 1] - found.intervals[:, 0]) / 2
    np.testing.assert_allclose(half, 1.959964 * deviation, rtol=1e-6)
    np.testing.assert_allclose(found.correlations[0, 1], covariance[0, 1] / deviation.prod(), rtol=1e-6)


def test_errors_that_are_not_known_are_those_of_the_scatter_with_students_quantile() -> None:
    found = estimate(LINE, line, noisy(0.01))
    residuals = noisy(0.01) - np.polyval(np.polyfit(X, noisy(0.01), 1), X)
    scatter = np.sqrt(np.sum(residuals**2) / 7)
    assert found.error == pytest.approx(scatter, rel=1e-4)
    deviation = scatter / np.sqrt(np.sum((X - X.mean()) ** 2))
    assert (found.intervals[0, 1] - found.intervals[0, 0]) / 2 == pytest.approx(2.364624 * deviation, rel=1e-4)


@pytest.mark.parametrize("known", members([True, False], False))
def test_intervals_of_noisy_lines_hold_the_truth_in_95_of_100_sets(known: bool) -> None:
    errors = np.full(len(X), 0.05) if known else None
    found = [estimate(LINE, line, noisy(0.05, seed), errors).intervals for seed in range(400)]
    covered = np.mean([(low <= [2.0, 1.0]) & (high >= [2.0, 1.0]) for low, high in (each.T for each in found)], axis=0)
    assert np.all(np.abs(covered - 0.95) < 0.033)  # three deviations of 400 sets


def test_points_without_noise_are_met_to_rounding() -> None:
    found = estimate([Parameter("rate", 2.0, 0.0)], lambda v: np.exp(-v[0] * X), np.exp(-1.3 * X))
    assert found.values[0] == pytest.approx(1.3, rel=1e-9)


def test_a_positive_parameter_has_a_positive_interval() -> None:
    rate = Parameter("rate", 1.0, 0.0)
    found = estimate([rate], lambda v: v[0] * X, 1.0 * X, np.full(len(X), 2.0))
    low, high = found.intervals[0]
    assert 0 < low < 1 < high
    assert low * high == pytest.approx(found.values[0] ** 2, rel=1e-6)


def power(values: np.ndarray) -> np.ndarray:
    return values[0] ** 2 * values[1] * X + values[2]


def powers() -> Estimate:
    three = [Parameter("a", 1.5, 0.0), Parameter("b", 2.0, 0.0), Parameter("c", 0.5), Parameter("idle", 4.0, 0.0)]
    return estimate(three, power, 4.0 * X + 1.0, np.full(len(X), 0.01))


def test_parameters_of_which_data_know_a_product_are_named_together_and_stay_near_their_start() -> None:
    found = powers()
    assert set(found.blind) == {("a", "b"), ("idle",)}
    assert np.isnan(found.intervals[[0, 1, 3]]).all()
    assert np.isfinite(found.intervals[2]).all()
    a, b, c, idle = found.values
    assert a**2 * b == pytest.approx(4.0, rel=1e-6)
    # The shortest way from the start to a² b = 4 in logarithms: along (2, 1)
    step = np.log(4.0 / 4.5) / 5
    assert [a, b] == pytest.approx(
        [1.5 * np.exp(2 * step), 2.0 * np.exp(step)], rel=1e-2
    )  # in the metric of the prior, to first order
    assert c == pytest.approx(1.0, rel=1e-6)
    assert idle == pytest.approx(4.0, rel=1e-6)


@pytest.mark.parametrize("known", [True, False])
def test_parameters_that_data_do_not_determine_take_no_degree_of_freedom(known: bool) -> None:
    data, errors = noisy(0.01), np.full(len(X), 0.01) if known else None
    spare = [Parameter("scale", 1.5, 0.0), Parameter("idle", 4.0, 0.0)]
    two = estimate(LINE, line, data, errors)
    four = estimate([*LINE, *spare], lambda v: line(np.array([v[0] * v[2], v[1]])), data, errors)
    assert two.freedom == four.freedom == len(X) - 2
    assert four.blind == (("slope", "scale"), ("idle",))
    assert four.chi_squared == pytest.approx(two.chi_squared, rel=1e-6)
    np.testing.assert_allclose(four.intervals[1], two.intervals[1], rtol=1e-6)


@pytest.mark.parametrize("loss", [loss for loss in LOSSES if loss != "linear"])
def test_a_robust_loss_weighs_an_outlier_down(loss: str) -> None:
    data = noisy(0.01)
    data[4] += 1.0
    errors = np.full(len(X), 0.01)
    plain, robust = (estimate(LINE, line, data, errors, each) for each in ("linear", loss))
    assert (
        abs(robust.values[1] + 1.5 * robust.values[0] - 4.0) < 0.02 < abs(plain.values[1] + 1.5 * plain.values[0] - 4.0)
    )


def test_a_direction_is_blind_from_the_declared_width_on() -> None:
    for width, blind in ((0.9 * WIDE, ()), (1.1 * WIDE, (("x",),))):
        found = estimate([Parameter("x", 1.0)], lambda v: v, [1.0], [width])
        assert found.blind == blind
