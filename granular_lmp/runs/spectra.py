"""Amplitude spectra of evenly sampled signals, with resolution and noise floor.

With the Hann window w of the whole record and the weighted mean m of the signal,

    A(Ω) = 2 |Σ w (x − m) e^{−iΩτ}| / Σ w

so a tone of amplitude A that lasts for the whole record has the height A at its frequency. Two tones can be
distinguished if their frequencies differ by more than the resolution 4π/T, half of the main lobe of the window.
"""

from math import pi

import numpy as np
from numpy.typing import NDArray

from granular_lmp.frozen import dataclass

__all__ = ["spectrum"]

Floats = NDArray[np.float64]

FEWEST = 8  # records
_FINER = 4  # frequencies for each of an unpadded transform: a tone between two of them loses 1 % at most


@dataclass(frozen=True)
class Spectrum:
    """Amplitude spectra of N signals.

    Attributes
    ----------
    frequency : (F,) array
        Ω from 0 to half the sampling rate, rad/t0.
    amplitude : (F, N) array
        Amplitudes in the unit of the signals; (F,) for one signal.
    resolution : float
        Smallest distance between distinguishable tones, rad/t0.
    floor : (N,) array or float
        Noise floor: the median of the amplitudes over all frequencies, which a few tones do not raise. A peak of a few
        times the floor is noise.
    """

    frequency: Floats
    amplitude: Floats
    resolution: float
    floor: Floats


def spectrum(tau: Floats, signals: Floats) -> Spectrum:
    """Return the amplitude spectra of signals.

    Parameters
    ----------
    tau : (T,) array
        Even times, t0.
    signals : (T,) or (T, N) array

    Raises
    ------
    ValueError
        If there are fewer than 8 records, the times are not even, or a signal is not finite.

    Notes
    -----
    *Good values*: a record of many periods without transients, ``signals[tau > 100]``, and samples closer than half a
    period of the highest frequency, as higher frequencies are folded down.

    Examples
    --------
    >>> tau = np.linspace(0.0, 200.0, 401)
    >>> found = spectrum(tau, 0.3 * np.cos(1.2 * tau))
    >>> top = found.amplitude.argmax()
    >>> print(f"{found.amplitude[top]:.2f} at {found.frequency[top]:.2f} rad/t0")
    0.30 at 1.20 rad/t0
    """
    count = len(tau)
    if count < FEWEST or len(signals) != count:
        raise ValueError(f"tau: {count} records, signals: {len(signals)}; must have equal length, at least {FEWEST}")
    steps = np.diff(tau)
    if not np.allclose(steps, steps.mean(), rtol=1e-6, atol=0.0):
        raise ValueError(f"tau: steps from {steps.min():.6g} to {steps.max():.6g}; must be even")
    if not np.isfinite(signals).all():
        raise ValueError("signals: not finite; must be numbers (rotations need tracked spheres)")
    length = count * float(steps.mean())
    window = 1 - np.cos(2 * pi * (np.arange(count) + 0.5) / count)
    weighted = window if signals.ndim == 1 else window[:, None]
    centred = signals - np.average(signals, axis=0, weights=window)
    amplitude: Floats = 2 * np.abs(np.fft.rfft(weighted * centred, _FINER * count, axis=0)) / window.sum()
    frequency = 2 * pi / (_FINER * length) * np.arange(len(amplitude), dtype=np.float64)
    return Spectrum(frequency, amplitude, 4 * pi / length, np.asarray(np.median(amplitude, axis=0)))
