"""Amplitude spectra of recorded signals: heights, resolution, noise floor."""

import numpy as np
import pytest

from granular_lmp.runs.spectra import spectrum
from tests.manual import Measure, Mutant, verifies

TAU = np.arange(0.0, 200.0, 0.5)


@pytest.mark.parametrize("frequency", [0.5, 0.5 + np.pi / 800, 0.513, 2.1])
@verifies(
    "Amplitude spectrum: height of a tone anywhere between two frequencies",
    reference="analytic: its amplitude, 0.3",
    tolerance=0.012,
    reason="Hann's window falls by 1 % at an eighth of an unpadded step",
    mutant=Mutant(
        "granular_lmp/runs/spectra.py",
        "_FINER * count, axis=0)) / window.sum()",
        "_FINER * count, axis=0)) / count * 0.98",
    ),
)
def test_a_tone_has_its_amplitude_at_its_frequency(frequency: float, measured: Measure) -> None:
    found = spectrum(TAU, 0.3 * np.cos(frequency * TAU + 0.4) + 7.0)
    peak = int(np.argmax(found.amplitude))
    assert abs(found.frequency[peak] - frequency) <= found.frequency[1] / 2 * (1 + 1e-6)  # the nearest; rounding
    # Hann's window falls by 1 % at an eighth of an unpadded step, the farthest from a frequency
    measured(found.amplitude[peak] / 0.3 - 1)
    assert found.amplitude[0] < 1e-3  # the mean of 7 is gone


def test_tones_are_told_apart_at_the_resolution_and_not_at_three_quarters() -> None:
    def dip(apart: float) -> float:
        two = [np.cos((1.0 + each) * (TAU - TAU.mean())) for each in (0.0, apart)]  # in phase in the middle: the worst
        found = spectrum(TAU, np.sum(two, axis=0))
        middle, tone = np.interp([1.0 + apart / 2, 1.0], found.frequency, found.amplitude)
        return float(middle / tone)

    resolution = spectrum(TAU, np.cos(TAU)).resolution
    assert resolution == pytest.approx(4 * np.pi / 200)
    assert dip(1.5 * resolution) < 0.5  # two peaks
    assert dip(0.75 * resolution) > 1.0  # one


def test_the_floor_is_that_of_noise_whatever_the_tones() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.01, (len(TAU), 50))
    quiet, loud = spectrum(TAU, noise), spectrum(TAU, noise + np.cos(0.7 * TAU)[:, None])
    # |Σ w x|² of white noise has an exponential distribution of mean σ² Σ w², whose median is ln 2 of that; with
    # Σ w² = 3/2 T and Σ w = T the floor is 2σ √(3/2 ln 2/T). 50 floors of 200 numbers each have it to about 1 %
    expected = 2 * 0.01 * np.sqrt(1.5 * np.log(2) / len(TAU))
    assert quiet.floor.mean() == pytest.approx(expected, rel=0.05)
    assert loud.floor.mean() == pytest.approx(expected, rel=0.15)  # the tone covers a few of the frequencies
    assert loud.amplitude.max() == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize(
    ("tau", "signals", "message"),
    [
        (TAU[:5], TAU[:5], "tau: 5 records, signals: 5; must have equal length, at least 8"),
        (TAU, TAU[:-1], "tau: 400 records, signals: 399"),
        (TAU**2, TAU, "tau: steps from 0.25 to 199.25; must be even"),
        (TAU, np.full_like(TAU, np.nan), "signals: not finite"),
    ],
)
def test_what_has_no_spectrum_is_refused(tau: np.ndarray, signals: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        spectrum(tau, signals)
