"""Spectral density of the motion of spheres in wave vector and frequency, and its peaks, which are the branches.

    S(k, Ω) = Σ_components |Σ_n Σ_t h(t) v_n(t) e^{−ik·r_n ± iΩt}|²

has power only where the crystal has waves. h is a Hann window, so that two waves are told apart if their frequencies
differ by more than 4π/T.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

PADDING = 4  # points of the transform to a resolution
# Maxima below this share of the largest power at a wave vector are no peaks. Side lobes of the Hann window are 7e-4.
FLOOR = 2e-3


def projected(velocities: Iterable[Floats], phases: Complexes) -> Complexes:
    """Return the velocities (N, C) of each moment on the waves with phases (K, N), (T, C, K)."""
    return np.array([velocity.T @ phases.T for velocity in velocities])


def density(times: Floats, waves: Complexes) -> tuple[Floats, Floats]:
    """Return frequencies (F,), rad per time, and power (K, C, F) in both directions of waves (T, C, K)."""
    steps = len(times)
    points = PADDING * steps
    transformed = np.fft.fft(waves * np.hanning(steps)[:, None, None], points, axis=0)
    power = np.abs(transformed.transpose(2, 1, 0)) ** 2
    half = points // 2
    both = power[..., :half] + np.concatenate([power[..., :1], power[..., : points - half : -1]], axis=-1)
    return 2 * np.pi * np.arange(half) / (points * (times[1] - times[0])), both


def peaks(frequencies: Floats, power: Floats) -> Floats:
    """Return the frequencies of the local maxima of a spectrum, by a parabola through the logarithm of three points."""
    inner = power[1:-1]
    top = 1 + np.flatnonzero((inner > power[:-2]) & (inner >= power[2:]) & (inner > FLOOR * power.max()))
    before, at, after = (np.log(power[top + shift]) for shift in (-1, 0, 1))
    shift = (before - after) / (2 * (before - 2 * at + after))
    return np.asarray(frequencies[top] + shift * (frequencies[1] - frequencies[0]))
