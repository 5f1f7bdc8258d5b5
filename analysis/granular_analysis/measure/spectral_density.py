"""Spectral density of the motion of spheres over wave vector and frequency. Its peaks are the branches.

    S(k, Ω) = Σ_components |Σ_n Σ_t h(t) v_n(t) e^{−ik·r_n ± iΩt}|²

has power only where the crystal has waves. h is a Hann window: two waves are resolved if their frequencies differ by
more than 4π/T, with T the length of the record.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

PADDING = 4  # points of the transform per 2π/T
# Maxima below this share of the largest power at a wave vector are not peaks. Side lobes of the Hann window reach 7e-4
FLOOR = 2e-3


def projected(velocities: Iterable[Floats], phases: Complexes) -> Complexes:
    """Return Σ_n v_n e^{−ik·r_n}, (T, C, K).

    Parameters
    ----------
    velocities : at each of T moments, (N, C) for N spheres and C components.
    phases : (K, N) factors e^{−ik·r_n} at K wave vectors.
    """
    return np.array([velocity.T @ phases.T for velocity in velocities])


def density(times: Floats, waves: Complexes) -> tuple[Floats, Floats]:
    """Return frequencies Ω (F,) in rad per unit of `times`, and the power (K, C, F) of waves that run either way.

    Parameters
    ----------
    times : (T,) equally spaced.
    waves : (T, C, K) of `projected`.
    """
    steps = len(times)
    points = PADDING * steps
    transformed = np.fft.fft(waves * np.hanning(steps)[:, None, None], points, axis=0)
    power = np.abs(transformed.transpose(2, 1, 0)) ** 2
    half = points // 2
    both = power[..., :half] + np.concatenate([power[..., :1], power[..., : points - half : -1]], axis=-1)
    return 2 * np.pi * np.arange(half) / (points * (times[1] - times[0])), both


def peaks(frequencies: Floats, power: Floats) -> Floats:
    """Return the frequencies of the peaks of a spectrum: local maxima above `FLOOR` times the largest power.

    A parabola through the logarithms of three points refines each frequency.

    Parameters
    ----------
    frequencies, power : (F,) of one wave vector.
    """
    inner = power[1:-1]
    top = 1 + np.flatnonzero((inner > power[:-2]) & (inner >= power[2:]) & (inner > FLOOR * power.max()))
    before, at, after = (np.log(power[top + shift]) for shift in (-1, 0, 1))
    shift = (before - after) / (2 * (before - 2 * at + after))
    return np.asarray(frequencies[top] + shift * (frequencies[1] - frequencies[0]))
