"""DOP853 without BLAS against SciPy's, step by step, and against motions that are known."""

import numpy as np
import pytest
from scipy.integrate import DOP853, solve_ivp

from granular_analysis.theory.integrator import STAGES, dop853, tableau

TAU = np.linspace(0, 20, 41)


def pendulum(y: np.ndarray) -> np.ndarray:
    return np.array([y[1], -np.sin(y[0])])


def test_the_coefficients_are_scipys() -> None:
    table = tableau()
    assert np.array_equal(table.stages[:STAGES, :STAGES], DOP853.A)
    assert np.array_equal(table.stages[STAGES, :STAGES], DOP853.B)
    assert np.array_equal(table.stages[STAGES + 1 :], DOP853.A_EXTRA)
    assert np.array_equal(table.errors, [DOP853.E5, DOP853.E3])
    assert np.array_equal(table.dense, DOP853.D)


@pytest.mark.parametrize("longest", [np.inf, 0.3])
@pytest.mark.parametrize("start", [np.array([2.0, 0.0]), np.array([0.5 + 0.2j, 0.1j])], ids=["real", "complex"])
def test_it_is_scipys_method(start: np.ndarray, longest: float) -> None:
    ours = dop853(pendulum, start, TAU, 1e-9, 1e-9, longest)
    known = solve_ivp(
        lambda _, y: pendulum(y), (0, TAU[-1]), start, "DOP853", TAU, rtol=1e-9, atol=1e-9, max_step=longest
    ).y.T
    # The steps are the same but for rounding; where one is not, the two differ by the tolerance, summed over 20 steps.
    assert np.allclose(ours, known, rtol=0, atol=1e-7)


def test_the_error_falls_with_the_tolerance() -> None:
    def error(rtol: float) -> float:
        turned = dop853(lambda y: 1j * y, np.ones((2, 3), dtype=complex), TAU, rtol, rtol, np.inf)
        return float(np.max(np.abs(turned - np.exp(1j * TAU)[:, None, None])))

    assert error(1e-6) < 1e-3
    assert error(1e-9) < error(1e-6) / 100  # a thousand, give or take ten


def test_a_state_may_lie_in_memory_by_columns() -> None:
    start = np.array([[1.0, 0.5, 0.2], [0.0, 0.3, -1.0]])
    spring = (lambda state: np.stack([state[1], -state[0]]), np.array([1.0, 2.0]), 1e-9, 1e-9, 1.0)
    by_rows, by_columns = (dop853(spring[0], each, *spring[1:]) for each in (start, np.asfortranarray(start)))
    assert np.array_equal(by_rows, by_columns)


def test_a_step_is_no_longer_than_allowed() -> None:
    seen = []

    def derivative(y: np.ndarray) -> np.ndarray:
        seen.append(y[0])  # y is the time
        return np.ones(1)

    dop853(derivative, np.zeros(1), np.array([0.0, 10.0]), 1e-3, 1e-3, 0.5)
    assert np.max(np.diff(sorted(seen))) < 0.5 + 1e-9


def test_a_motion_that_ends_is_refused() -> None:
    with pytest.raises(RuntimeError, match="tau = "):
        dop853(lambda y: y**2, np.ones(1), np.array([0.0, 2.0]), 1e-8, 1e-8, np.inf)  # infinite at τ = 1


@pytest.mark.parametrize("tau", [[0.0], [0.0, 1.0], [0.7, 1.0]])
def test_the_times_are_those_asked_for(tau: list[float]) -> None:
    found = dop853(lambda y: -y, np.ones(1), np.array(tau), 1e-9, 1e-9, np.inf)[:, 0]
    assert np.allclose(found, np.exp(-np.array(tau)), rtol=0, atol=1e-7)
