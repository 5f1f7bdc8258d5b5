"""Sums of runs are free of the powers of the step that they should be, and the estimate is above their error."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from granular_lmp.accuracy.extrapolation import ALL, EVEN, OF_TWO, SAFETY, combined, following, judge, l2, weights_of

TAU = np.linspace(0, 30, 121)
EXACT = np.sin(TAU)
LADDERS = [(1, 2, 4), (1, 2, 3), (2, 4, 3), (2, 4, 5, 8), (1, 2, 4, 8, 6)]
each_ladder = pytest.mark.parametrize("counts", LADDERS, ids=str)


def made(counts: Sequence[int], error: Callable[[float], float]) -> list[dict[str, np.ndarray]]:
    """Runs whose error is a function of the step, as another wave."""
    return [{"q": EXACT + error(1 / count) * np.cos(3 * TAU)} for count in counts]


def error_of(runs: Sequence[dict[str, np.ndarray]], weights: Sequence[float]) -> float:
    return l2(combined([run["q"] for run in runs], weights) - EXACT) / l2(EXACT)


@pytest.mark.parametrize("powers", [EVEN[:1], EVEN, ALL[:1], ALL])
def test_weights_take_powers_out_and_keep_the_rest(powers: tuple[int, ...]) -> None:
    counts = (2, 3, 5, 7)[: len(powers) + 1]
    weights = weights_of(counts, powers)
    assert sum(weights) == pytest.approx(1, abs=1e-13)
    for power in powers:
        assert abs(sum(w / count**power for w, count in zip(weights, counts, strict=True))) < 1e-13
    assert abs(sum(w / count ** (powers[-1] + 1) for w, count in zip(weights, counts, strict=True))) > 1e-6


@each_ladder
def test_the_answer_is_free_of_the_orders_of_its_effects(counts: tuple[int, ...]) -> None:
    even = made(counts, lambda h: 0.1 * h**2 - h**4)
    assert error_of(even, judge(even, counts, 2).weights) < 1e-13
    if len(counts) > 3:
        odd = made(counts, lambda h: 0.1 * h - 0.2 * h**2 + 0.1 * h**3)
        assert error_of(odd, judge(odd, counts, 1).weights) < 1e-13
        assert error_of(odd, judge(odd, counts, 2).weights) > 1e-6


@each_ladder
@pytest.mark.parametrize("power", [1, 2, 3, 4, 6])
@pytest.mark.parametrize("order", [1, 2])
def test_the_estimate_is_above_an_error_of_any_order(counts: tuple[int, ...], power: int, order: int) -> None:
    # An error of second order in the foreground is taken out first, and would hide a small one of another
    runs = made(counts, lambda h: 0.05 * h**2 + 1e-3 * h**power)
    found = judge(runs, counts, order)
    # What the sums take out exactly leaves rounding on both sides
    assert found.errors["q"] > error_of(runs, found.weights) - 1e-13


def test_a_hidden_error_of_first_order_counts_by_the_smaller_of_its_bounds() -> None:
    counts = (1, 2, 4, 5)
    runs = made(counts, lambda h: 0.05 * h**2 + 1e-3 * h)
    unknown, known, none = (judge(runs, counts, 2, hidden=each) for each in ({}, {"q": 1e-3 * l2(EXACT)}, {"q": 0.0}))
    assert none.errors["q"] < known.errors["q"] < unknown.errors["q"]
    true = error_of(runs, known.weights)
    assert none.errors["q"] < true  # what the distances alone would say
    assert true < known.errors["q"] < 1.5 * true


def test_an_error_that_is_no_series_is_not_extrapolated() -> None:
    runs = made((1, 2, 4), lambda h: {1.0: 0.1, 0.5: 0.02, 0.25: 0.01}[h])
    found = judge(runs, (1, 2, 4), 0)
    assert found.weights == (0, 0, 1)
    # Half of what the run before the last had changed is more than what the last one has
    assert found.errors["q"] == pytest.approx(0.04 * l2(np.cos(3 * TAU)) / l2(runs[-1]["q"]))


def test_one_run_tells_nothing_and_two_are_judged_by_the_error_of_the_finer() -> None:
    runs = made((1, 2), lambda h: 0.1 * h**2 + 0.01 * h**4)
    assert judge(runs[:1], (1,), 2).errors == {"q": np.inf}
    found = judge(runs, (1, 2), 2)
    assert found.errors["q"] == pytest.approx(OF_TWO * error_of(runs, (0, 1)), rel=0.1)


def test_the_signals_that_count_choose_the_answer() -> None:
    counts = (2, 4, 8)
    of_first, of_second = (made(counts, f) for f in (lambda h: 0.1 * h + 0.1 * h**2, lambda h: 0.1 * h**2 + 0.1 * h**4))
    runs = [{"a": one["q"], "b": other["q"]} for one, other in zip(of_first, of_second, strict=True)]
    assert [judge(runs, counts, 1, counted=[name]).powers for name in "ab"] == [ALL[:2], EVEN]


def test_the_next_run_is_as_fine_as_it_must_be_and_no_finer_than_twice() -> None:
    counts = [4, 8]
    assert following([4], judge(made([4], abs), [4], 2), np.inf, 1e-3) == 8
    runs = made((4, 8, 16), lambda h: h**2 + 100 * h**4 + h**6)
    found = judge(runs, (4, 8, 16), 2, hidden={"q": 0.0})
    error = found.errors["q"]
    assert following((4, 8, 16), found, error, error / 1e6) == 32
    # A little too large: a run in between, whose step stands in the error of the pair, is enough
    between = following((4, 8, 16), found, error, error / 1.1)
    assert 8 < between < 16
    more = made((4, 8, 16, between), lambda h: h**2 + 100 * h**4 + h**6)
    assert judge(more, (4, 8, 16, between), 2, hidden={"q": 0.0}).errors["q"] < error / 1.1
    assert following(counts, judge(made(counts, abs), counts, 0), 0.1, 0.09) == 11  # 8 · 1.2 · 0.1/0.09


def test_a_run_in_between_is_not_made_twice() -> None:
    counts = (8, 16, 10)
    runs = made(counts, lambda h: h**2 + 100 * h**4)
    found = judge(runs, counts, 2)
    for tolerance in (1e-1, 1e-3, 1e-5):
        assert following(counts, found, 1e-2, tolerance) not in counts


def test_the_safety_is_that_of_the_distances() -> None:
    runs = made((1, 2, 4), lambda h: 0.1 * h**2 + 0.01 * h**4 + 1e-4 * h**6)
    one, two = (judge(runs, (1, 2, 4), 2, safety=each, hidden={"q": 0.0}).errors["q"] for each in (SAFETY, 2 * SAFETY))
    assert two == pytest.approx(2 * one)
