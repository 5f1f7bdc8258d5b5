"""Second harmonic with the time step of LAMMPS: velocity Verlet applied to one oscillator instead of the lattice.

A test compares it with steps of the whole lattice.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from granular_analysis.second_harmonic import refuse_oblique
from granular_analysis.theory.wave import Wave

Floats = NDArray[np.float64]


def stepped_second_harmonic(wave: Wave, tau: Floats, step: float) -> Floats:
    """Return p (T,) of the second harmonic in D0 at times τ, computed with time steps h; h → 0 gives `second_harmonic`.

        p_{n+1} − 2p_n + p_{n−1} = h²[Re(F f_n²) − w̃² p_n],   f = e^{i phase}(cos Ω_hτ − ir sin Ω_hτ)

    with sin(Ω_h h/2) = Ωh/2 and the force F on the free waves. The start has the velocity of the exact wave, which is
    r = Ωh/sin(Ω_h h) times the velocity of a stepped wave of Ω_h that runs one way. The force that the start leaves in
    the contacts is static.

    The incremental law adds up its shear force with the stiffness at the end of each step, half a step late. The part
    of F that this delays equals F of the secant law minus F of the incremental law. It acquires a share Ωh/2 in
    quadrature, minus the value of that share at the start.

    Parameters
    ----------
    wave : along y, in contacts without dashpots.
    tau : times (T,), multiples of the step.
    step : h, in τ.

    Raises ValueError for a wave in another direction than y.
    """
    refuse_oblique(wave.mode)
    frequency, free = wave.mode.frequency, wave.free_frequency
    force, left = _forces(wave)
    angle = 2 * np.arcsin(frequency * step / 2)
    turns = angle * np.arange(round(tau[-1] / step) + 1)
    started = np.cos(turns) - 1j * frequency * step / np.sin(angle) * np.sin(turns)
    drive = np.real(force * started**2)
    if wave.contact.incremental:
        secant, _ = _forces(replace(wave, contact=replace(wave.contact, law="secant")))
        late = (secant - force) * frequency * step / 2
        drive += np.imag(late * (np.exp(-2j * turns) - 1))
    drive[0] /= 2
    turn = 2 * np.arcsin(free * step / 2)
    p = _leapfrog(drive, turn) * step**2
    slower = turn / (free * step) * tau
    return p[np.rint(tau / step).astype(int)] + left.real * slower**2 / 2 * np.sinc(free * slower / (2 * np.pi)) ** 2


def _leapfrog(drive: Floats, turn: float) -> Floats:
    """Return x_n of x_{n+1} − 2 x_n cos θ + x_{n−1} = drive_n, x_0 = x_{−1} = 0: Σ_m drive_m sin((n−m)θ)/sin θ."""
    wheel = np.exp(1j * turn * np.arange(len(drive)))
    return np.asarray((wheel * np.cumsum(drive / wheel)).imag / np.sin(turn))


def _forces(wave: Wave) -> tuple[complex, complex]:
    """Return two forces on the longitudinal waves at 2k, in D0 and t0: running with 2ϑ, and static."""
    running, left, _ = wave.doubled.shares
    direction = wave.framed(wave.doubled.targets.shapes)[wave.longitudinal, 0]
    scale = 0.5 * wave.amplitude * np.exp(2j * wave.phase) * direction
    return complex(scale * running[wave.longitudinal]), complex(scale * left[wave.longitudinal])
