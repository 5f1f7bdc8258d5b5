"""Zeros of many functions at once."""

import numpy as np
import pytest

from granular_analysis.theory.roots import crossings


def test_each_bracket_has_its_own_zero() -> None:
    places = np.array([0.3, 1.0, 2.0, 7.0])

    def values(x: np.ndarray) -> np.ndarray:
        return np.array([x[0] - places[0], np.log(x[1]), x[2] ** 9 - 2.0**9, np.tanh(40 * (7.0 - x[3]))])

    low, high = np.array([0.0, 0.1, 0.5, 1.0]), np.array([1.0, 30.0, 9.0, 20.0])
    np.testing.assert_allclose(crossings(values, low, high), places, rtol=2e-14)
    np.testing.assert_allclose(crossings(values, high, low), places, rtol=2e-14)


def test_a_zero_at_an_end_is_found() -> None:
    assert crossings(lambda x: x - 1.0, np.array([1.0, 0.0]), np.array([2.0, 1.0])).tolist() == [1.0, 1.0]


def test_no_bracket_has_no_zero() -> None:
    assert crossings(lambda x: x, np.zeros(0), np.zeros(0)).shape == (0,)


def test_a_bracket_with_one_sign_is_refused() -> None:
    with pytest.raises(ValueError, match="one sign at both ends"):
        crossings(lambda x: x + 1.0, np.array([0.0]), np.array([1.0]))
