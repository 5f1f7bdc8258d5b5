"""Images by least squares: penalties, the corner of an L-curve, and a linear problem whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest

from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.imaging import NEAR, Search, Tikhonov, Trial, Variation, corner, resolution, widths

CHAIN = np.stack([np.arange(39), np.arange(1, 40)], axis=1)


def test_penalties_of_known_arrays() -> None:
    values = np.array([1.0, 1.0, 1.5, 0.5])
    assert Tikhonov()(values)[0] == pytest.approx(0.5)
    pairs = np.array([[0, 1], [1, 2], [2, 3]])
    # Without rounding the sum of the steps, 0.5 + 1
    assert Variation(pairs, 1e-9)(values)[0] == pytest.approx(1.5, rel=1e-8)
    assert Variation(pairs, 0.5)(values)[0] == pytest.approx(0.5 * (2**0.5 - 1) + 0.5 * (5**0.5 - 1))


@pytest.mark.parametrize("penalty", [Tikhonov(), Variation(CHAIN)], ids=["tikhonov", "variation"])
def test_the_slope_of_a_penalty_is_its_difference_and_its_curvature_leads_to_it(penalty: object) -> None:
    rng = np.random.default_rng(1)
    values, way = 1 + 0.1 * rng.normal(size=40), rng.normal(size=40)
    ends = [penalty(values + sign * 1e-6 * way)[0] for sign in (-1, 1)]
    slope = penalty(values)[1]
    assert slope @ way == pytest.approx((ends[1] - ends[0]) / 2e-6, rel=1e-7)
    # Lagged diffusion, and the Hessian of a square: slope = curvature (values − 1)
    np.testing.assert_allclose(penalty.curvature(values) @ (values - 1), slope, atol=1e-12 * abs(slope).max())
    assert np.linalg.eigvalsh(penalty.curvature(values)).min() > -1e-9


def test_the_corner_of_an_l_curve_is_where_its_arms_meet() -> None:
    fast, slow = np.arange(6.0), 0.02 * np.arange(6.0)
    falls, rises = np.exp(-np.append(fast, 5 + slow[1:])), np.exp(np.append(slow, 0.1 + fast[1:]))
    assert corner(falls, rises) == 5
    # Arms in the other order are convex from the other side, and have no corner there
    assert corner(np.exp(-np.append(slow, 0.1 + fast[1:])), np.exp(np.append(fast, 5 + slow[1:]))) != 5
    with pytest.raises(ValueError, match="an L-curve of 2 points has no corner"):
        corner(falls[:2], rises[:2])


def linear(noise: float) -> tuple[np.ndarray, np.ndarray, Search]:
    """Return a step of 0.4 in 40 values, the slopes of 60 blurred points, and the search for it."""
    rng = np.random.default_rng(2)
    truth = 1 + 0.4 * ((np.arange(40) > 12) & (np.arange(40) < 20))
    slopes = np.exp(-0.5 * ((np.arange(40) - np.linspace(0, 39, 60)[:, None]) / 1.5) ** 2)
    measured = slopes @ truth + noise * rng.normal(size=60)

    def misfit(values: np.ndarray) -> tuple[float, np.ndarray]:
        left = (slopes @ values - measured) / noise
        return float(left @ left), 2 * slopes.T @ left / noise

    curvature = 2 * slopes.T @ slopes / noise**2
    return truth, slopes / noise, Search(misfit, curvature, 60, Tikhonov(), (0.1, 5.0), known=True)


def with_changes(search: Search, **changes: object) -> Search:
    return replace(search, **changes)


def test_the_noise_level_chooses_a_weight_at_which_chi_squared_is_one_a_point() -> None:
    truth, _, search = linear(0.02)
    told: list[Trial] = []
    found = with_changes(search, told=told.append).image(np.ones(40))
    assert found.reason == "chi2 is 1 a point"
    assert found.chi_squared == pytest.approx(1, abs=NEAR)
    assert told == list(found.trials)
    assert abs(found.values - truth).max() < 0.2
    # Of Tikhonov's penalty the minimum of each weight is known
    slope = search.misfit(np.ones(40))[1]
    expected = 1 - np.linalg.solve(search.curvature + 2 * found.best.weight * np.eye(40), slope)
    np.testing.assert_allclose(found.values, expected, atol=1e-9)


def test_a_search_that_was_stopped_continues_to_the_same_bits() -> None:
    _, _, search = linear(0.02)
    made: list[Trial] = []
    whole = with_changes(search, told=made.append).image(np.ones(40))
    again: list[Trial] = []
    continued = with_changes(search, kept=made[:2], told=again.append).image(np.ones(40))
    assert np.array_equal(continued.values, whole.values)
    assert (again[0], again[1], len(again)) == (made[0], made[1], len(made))
    other = made[0], made[1]._replace(values=0.9 * made[1].values)
    assert not np.array_equal(with_changes(search, kept=other).image(np.ones(40)).values, whole.values)
    with pytest.raises(TheoryError, match="kept trial 2 has another weight than this search; begin anew"):
        with_changes(search, kept=[made[0], made[2]]).image(np.ones(40))


def test_total_variation_keeps_the_edges_of_a_step_that_tikhonov_rounds() -> None:
    truth, _, search = linear(0.02)
    smooth = search.image(np.ones(40)).values
    edged = with_changes(search, penalty=Variation(CHAIN)).image(np.ones(40)).values
    assert np.sum((edged - truth) ** 2) < 0.6 * np.sum((smooth - truth) ** 2)


def test_with_unknown_errors_the_corner_is_near_the_weight_of_the_noise() -> None:
    _, _, search = linear(0.02)
    found = with_changes(search, known=False).image(np.ones(40))
    assert found.reason == "the corner of the L-curve"
    assert 0.3 < found.chi_squared < 2


def test_errors_that_are_said_too_small_are_said_to_be_unexplained() -> None:
    _, _, search = linear(0.02)
    wrong = with_changes(search, points=1, known=True)
    assert "chi2 stays at" in wrong.image(np.ones(40)).reason


def test_data_without_a_difference_need_none_and_data_without_a_wave_are_refused() -> None:
    _, _, search = linear(0.02)
    flat = with_changes(search, misfit=lambda values: (30.0, 0 * values))
    assert flat.image(np.ones(40)).reason == "chi2 is 1 a point or less without any difference"
    with pytest.raises(ValueError, match="no wave reaches them"):
        with_changes(search, curvature=np.zeros((40, 40))).image(np.ones(40))


def test_resolution_and_errors_are_those_of_many_noisy_images() -> None:
    """The scatter of 400 images is known to a factor of 1 ± 0.035; five of these are allowed."""
    truth, slopes, search = linear(0.02)
    weight, rng = 300.0, np.random.default_rng(3)
    resolved, errors = resolution(search.curvature, Tikhonov().curvature(truth), weight)
    inverse = np.linalg.solve(slopes.T @ slopes + weight * np.eye(40), slopes.T)
    images = [inverse @ (slopes @ (truth - 1) + rng.normal(size=60)) for _ in range(400)]
    np.testing.assert_allclose(np.mean(images, axis=0), resolved @ (truth - 1), atol=5 * errors.max() / 20)
    np.testing.assert_allclose(np.std(images, axis=0), errors, rtol=0.18)


def test_the_width_of_a_point_s_image_is_that_of_the_spheres_it_covers() -> None:
    sharp, even = np.eye(9), np.full((9, 9), 1 / 9)
    assert widths(sharp, 1.0, 2) == pytest.approx(1)
    assert widths(even, 1.0, 2) == pytest.approx(3)  # nine spheres are three wide
    assert widths(even, 3.0, 2) == pytest.approx(3**0.5)  # three values each
