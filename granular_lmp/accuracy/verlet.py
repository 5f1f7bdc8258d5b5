"""Phase error of velocity Verlet in a wave, as a function of the time step.

It advances a mode of frequency ω too fast by (ωh)²/24. In the relative L2 norm over a run of duration τ the errors are

    e = (ωh)² ωτ/(24√3)                                     for one run with the step h
    E² = (6/√5 e²)² + (9/20 (ωh)² e)²,  h the finer step    for the Richardson extrapolation of two runs
"""

from math import hypot, sqrt


def phase_error(frequency: float, step: float, duration: float) -> float:
    """Return e, the relative L2 error of a wave of this frequency (rad/t0), for a step and a duration (τ)."""
    return (frequency * step) ** 2 * frequency * duration / (24 * sqrt(3))


def pair_error(frequency: float, step: float, duration: float) -> float:
    """Return E, the relative L2 error of the extrapolation of two runs, of which the finer has this step (τ)."""
    e = phase_error(frequency, step, duration)
    return hypot(6 / sqrt(5) * e**2, 9 / 20 * (frequency * step) ** 2 * e)
