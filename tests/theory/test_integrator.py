"""DOP853 at the times asked for, and motions that it refuses."""

import numpy as np
import pytest

from granular_analysis.theory.integrator import dop853

TAU = np.linspace(0, 20, 41)


def test_the_error_falls_with_the_tolerance() -> None:
    def error(rtol: float) -> float:
        turned = dop853(lambda y: 1j * y, np.ones((2, 3), dtype=complex), TAU, rtol, rtol, np.inf)
        return float(np.max(np.abs(turned - np.exp(1j * TAU)[:, None, None])))

    assert error(1e-6) < 1e-3
    assert error(1e-9) < error(1e-6) / 100  # a thousand, give or take ten


def test_a_step_is_no_longer_than_allowed() -> None:
    seen = []

    def derivative(y: np.ndarray) -> np.ndarray:
        seen.append(y[0])  # y is the time
        return np.ones(1)

    dop853(derivative, np.zeros(1), np.array([0.0, 10.0]), 1e-3, 1e-3, 0.5)
    assert np.max(np.diff(sorted(seen))) < 0.5 + 1e-9


@pytest.mark.parametrize("tau", [[0.0], [0.0, 1.0], [0.7, 1.0]])
def test_the_times_are_those_asked_for(tau: list[float]) -> None:
    found = dop853(lambda y: -y, np.ones(1), np.array(tau), 1e-9, 1e-9, np.inf)[:, 0]
    assert np.allclose(found, np.exp(-np.array(tau)), rtol=0, atol=1e-7)
