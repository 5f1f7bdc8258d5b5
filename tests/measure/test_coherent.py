"""The coherent wave, on synthetic fields whose answers are known."""

import numpy as np
import pytest

from granular_analysis.measure.coherent import decay, project
from tests.manual import Mutant, verifies

K = np.array([0.7, 0.9])
FORWARD, SIDEWAYS = K / np.hypot(*K), np.array([-K[1], K[0]]) / np.hypot(*K)
PLACES = np.random.default_rng(1).uniform(0, 40, (500, 2))  # no lattice, no whole number of waves
TIMES = np.linspace(0, 30, 91)


def field(along=0.0, across=0.0, second=0.0, mean=0.0):
    """Return a field (T, N, 2): waves of amplitude (T,) at k, `second` at 2k along k, and a motion along k of all."""
    phase = PLACES @ K
    longitudinal = np.real(np.outer(along + 0j * TIMES, np.exp(1j * phase)))
    longitudinal = longitudinal + np.real(np.outer(second + 0j * TIMES, np.exp(2j * phase))) + mean
    transverse = np.real(np.outer(across + 0j * TIMES, np.exp(1j * phase)))
    return longitudinal[..., None] * FORWARD + transverse[..., None] * SIDEWAYS


def running(amplitude, rate, frequency):
    return amplitude * np.exp(-(rate + 1j * frequency) * TIMES)


def test_a_plane_wave_is_found_whole_on_any_places():
    along, across, second = running(1.5j, 0.01, 0.8), running(0.7, 0.02, -0.3), running(0.1 + 0.2j, 0, 1.6)
    found = project(PLACES, field(along, across, second, 0.3), K)
    # Rounding of a well-conditioned fit over 500 spheres
    assert found.along == pytest.approx(along, abs=1e-12)
    assert found.across == pytest.approx(across, abs=1e-12)
    assert found.amplitudes[1, :, 0] == pytest.approx(second, abs=1e-12)
    assert found.amplitudes[1, :, 1] == pytest.approx(0, abs=1e-12)
    assert found.mean == pytest.approx(np.broadcast_to([0.3, 0.0], (91, 2)), abs=1e-12)
    assert found.scattered == pytest.approx(0, abs=1e-12)


def test_a_wave_of_another_wave_vector_is_not_found():
    found = project(PLACES, field(running(1.0, 0, 0.8)), -1.3 * K[::-1])
    # 500 random places leave about √(2/500) of another wave, of either component
    assert np.max(np.abs(found.amplitudes)) < 0.3
    assert np.min(found.scattered) > 0.9


def test_the_scattered_share_is_that_of_the_noise():
    noise = np.random.default_rng(2).normal(0, 0.5, (91, 500, 2))
    found = project(PLACES, field(1.0) + noise, K)
    # Σ|u|² is ½ of the wave and 2·0.25 of the noise, of which 5 of 500 degrees are fitted; it scatters by 1/√500
    assert np.mean(found.scattered) == pytest.approx(0.5 * (1 - 5 / 500), rel=0.03)


def test_nothing_moves():
    found = project(PLACES, field(), K)
    assert np.isnan(found.scattered).all()
    assert not found.amplitudes.any()


@verifies(
    "Coherent wave: rate and frequency of a decaying one, relative",
    reference="analytic: the rate 0.05 and frequency 0.8 put in",
    tolerance=1e-10,
    reason="rounding of a fit over ninety times",
    mutant=Mutant("analysis/granular_analysis/measure/coherent.py", "centre = share @ x", "centre = np.mean(x)"),
)
def test_decay_and_frequency_are_those_of_the_wave(measured):
    fit = decay(TIMES, running(0.3 - 0.4j, 0.05, 0.8))
    measured(fit.rate / 0.05 - 1)
    measured(fit.frequency / 0.8 - 1)
    assert fit.amplitude == pytest.approx(0.3 - 0.4j, rel=1e-10)
    assert max(fit.rate_error, fit.frequency_error) < 1e-12


def test_the_errors_are_those_of_repeated_measurements():
    rng, true, fits = np.random.default_rng(3), running(1.0, 0.05, 0.8), []
    for _ in range(400):
        noise = 0.02 * (rng.normal(size=91) + 1j * rng.normal(size=91))
        fits.append(decay(TIMES, true + noise))
    for name, value in (("rate", 0.05), ("frequency", 0.8)):
        values = np.array([getattr(fit, name) for fit in fits])
        claimed = np.mean([getattr(fit, f"{name}_error") for fit in fits])
        # From 400 fits the mean is known to 1/20 of the spread, the spread to 1/28: three of each
        assert np.mean(values) == pytest.approx(value, abs=0.15 * claimed)
        assert np.std(values) == pytest.approx(claimed, rel=0.12)


def test_a_wave_that_runs_back_has_a_negative_frequency():
    assert decay(TIMES, running(1.0, 0.0, -0.8)).frequency == pytest.approx(-0.8)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: project(PLACES, field(1.0)[:, :9], K), "must be .N, 2. and .T, N, 2."),
        (lambda: project(PLACES, field(1.0), [0.0, 0.0]), "wavevector"),
        (lambda: project(PLACES, np.full((2, 500, 2), np.nan), K), "finite"),
        (lambda: project(PLACES[:4], field(1.0)[:, :4], K), "k, 2k and 0 are not independent"),
        (lambda: decay(TIMES[:2], np.ones(2)), "at least 3"),
        (lambda: decay(TIMES, 0 * TIMES), "nowhere 0"),
        (lambda: decay(TIMES, running(1.0, 0.0, 9.0)), "sample finer"),
    ],
)
def test_what_cannot_be_fitted_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
