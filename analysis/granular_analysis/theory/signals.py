"""Signals of sources over time τ: tones, bursts, chirps, Ricker's wavelet, steps and samples.

Each function here returns a signal: a function from times (T,), in a NumPy or JAX array, to values (T,). Frequencies
are in rad per unit of time, phases in rad; the delay shifts the signal to later times.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.network_tangents import module_of

Floats = NDArray[np.float64]
Function = Callable[[Floats], Floats]


def tone(frequency: float, ramp: float, phase: float = 0.0, delay: float = 0.0) -> Function:
    """Return r(t/ramp) cos(Ωt − phase), t = τ − delay, with r(s) = s³(10 − 15s + 6s²) on [0, 1]."""
    return lambda tau: _rise((tau - delay) / ramp) * module_of(tau).cos(frequency * (tau - delay) - phase)


def burst(frequency: float, cycles: float, phase: float = 0.0, delay: float = 0.0) -> Function:
    """Return ½[1 − cos(Ωt/cycles)] cos(Ωt − phase), t = τ − delay: some cycles under a Hann window, else 0."""

    def signal(tau: Floats) -> Floats:
        xp, angle = module_of(tau), frequency * (tau - delay)
        inside = (angle > 0) & (angle < 2 * np.pi * cycles)
        return xp.where(inside, 0.5 * (1 - xp.cos(angle / cycles)) * xp.cos(angle - phase), 0.0)

    return signal


def chirp(frequency: float, sweep: float, cycles: float, phase: float = 0.0, delay: float = 0.0) -> Function:
    """Return cos(∫ω dt − phase) under a Hann window; ω goes linearly from Ω to sweep·Ω within some cycles."""
    duration = 2 * np.pi * cycles / (0.5 * (1 + sweep) * frequency)
    rate = (sweep - 1) * frequency / duration

    def signal(tau: Floats) -> Floats:
        xp = module_of(tau)
        t = xp.clip(tau - delay, 0.0, duration)  # the window is 0 at both ends
        return xp.sin(np.pi * t / duration) ** 2 * xp.cos(frequency * t + rate * t**2 / 2 - phase)

    return signal


def ricker(frequency: float, delay: float = 0.0) -> Function:
    """Return Ricker's wavelet (1 − y²/2) e^{−y²/4}, y = Ωt − 12, t = τ − delay, whose spectrum peaks at Ω.

    It is the second derivative of a Gaussian, up to a factor.
    """

    def signal(tau: Floats) -> Floats:
        y = frequency * (tau - delay) - 12.0
        return (1 - y**2 / 2) * module_of(tau).exp(-(y**2) / 4)

    return signal


def step(ramp: float, delay: float = 0.0) -> Function:
    """Return r(t/ramp) with r as for `tone` and t = τ − delay, which rises from 0 and stays at 1."""
    return lambda tau: _rise((tau - delay) / ramp)


def samples(pairs: ArrayLike, delay: float = 0.0) -> Function:
    """Return the cubic spline through (τ, value) pairs (n, 2), equidistant in τ; flat at both ends, constant beyond."""
    from scipy.interpolate import CubicSpline  # slow to import, and only samples need it

    tau, value = np.asarray(pairs, dtype=float).T
    spline = CubicSpline(np.linspace(tau[0], tau[-1], len(tau)), value, bc_type="clamped")
    begins, powers = spline.x[:-1], spline.c

    def signal(times: Floats) -> Floats:
        xp = module_of(times)
        t = xp.clip(times - delay, tau[0], tau[-1])
        piece = xp.clip(xp.searchsorted(xp.asarray(begins), t, side="right") - 1, 0, len(begins) - 1)
        a, b, c, d = xp.asarray(powers)[:, piece]
        s = t - xp.asarray(begins)[piece]
        return ((a * s + b) * s + c) * s + d

    return signal


def _rise(share: Floats) -> Floats:
    s = module_of(share).clip(share, 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2)
