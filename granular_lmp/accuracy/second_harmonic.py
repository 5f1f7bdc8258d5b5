"""The second harmonic of a run, measured in its record alone: no theory of its amplitude is asked.

At the wave number 2ξ the lattice is one oscillator of frequency w̃, at rest at τ = 0 and driven at 2Ω, so that

    p = B S(τ) + c cos w̃τ + s sin w̃τ  (+ the fundamental, for L),   S'' + w̃²S = sin 2(Ωτ − phase),  S(0) = S'(0) = 0

Ω and w̃ are those of the linear lattice; B, c and s are fitted by least squares. The wave that runs with the fundamental
has the amplitude A = |B/(w̃² − 4Ω²)|. S stays regular, and apart from the free waves, where w̃ comes near 2Ω; A does not:
at the resonance the second harmonic grows with time and has no amplitude.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.modes import bloch_mode
from granular_lmp.runs.readouts import fitted
from granular_lmp.runs.record import Record
from granular_lmp.scene.linear import mode_of, physics_of, unit_contacts

Floats = NDArray[np.float64]

_FEWEST = 3  # records for each factor of the fit
_MOVED = ("damping", "sliding", "contact_opening")  # effects with which p has other functions of time


@dataclass(frozen=True)
class SecondHarmonic:
    """The second harmonic of a run.

    Attributes
    ----------
    amplitude : float
        A, in D0.
    error : float
        Standard error of the fit, in D0: of white noise. Where other waves are left it measures them and no more.
    frequency : float
        2Ω, in rad/t0.
    """

    amplitude: float
    error: float
    frequency: float


def second_harmonic(record: Record) -> SecondHarmonic | None:
    """Return the second harmonic of a run; None where p is not of the form above, or does not resolve it.

    That form is of a running plane wave along y, without dashpots, sliding and opening contacts, before the echo of
    walls. *Good values*: a duration of several periods of the beat 2π/|w̃ − 2Ω|, and samples of less than half a period
    of either. *Breaks* where the wave is so large that its third harmonic is in p too, of relative order a².
    """
    scene, tau = record.scene, record.tau
    moved = any(getattr(scene.effects, name) is True for name in _MOVED)
    if not scene.plane_along_y or moved or not len(tau) or tau[-1] > scene.echo_time:
        return None
    own = mode_of(scene).frequency
    free = bloch_mode(unit_contacts(scene), scene.sphere, scene.vector.doubled, "L", physics_of(scene)).frequency
    columns = [_response(tau, own, free, scene.wave.phase), np.cos(free * tau), np.sin(free * tau)]
    if scene.wave.mode == "L":  # with the slow drift of the fundamental, of order a² τ
        fundamental = [np.cos(own * tau), np.sin(own * tau)]
        columns += [*fundamental, *(tau * each for each in fundamental)]
    detuning = (free - 2 * own) * (free + 2 * own)
    seen = scene.time.sample * max(free, 2 * own) < pi
    if not seen or detuning == 0 or len(tau) < _FEWEST * len(columns):
        return None
    factors, errors = fitted(np.column_stack(columns), record.p)
    return SecondHarmonic(float(abs(factors[0] / detuning)), float(abs(errors[0] / detuning)), 2 * own)


def _response(tau: Floats, own: float, free: float, phase: float) -> Floats:
    """Return S(τ): cos 2phase times the response to sin 2Ωτ, less sin 2phase times that to cos 2Ωτ.

    With s = Ω + w̃/2 and d = Ω − w̃/2 they are [sin(w̃τ)/w̃ − τ cos(sτ) sin(dτ)/(dτ)]/2s and τ sin(sτ) sin(dτ)/(dτ)/2s.
    """
    mean, beat = own + free / 2, tau * np.sinc((own - free / 2) * tau / pi)
    to_sine = (np.sin(free * tau) / free - np.cos(mean * tau) * beat) / (2 * mean)
    to_cosine = np.sin(mean * tau) * beat / (2 * mean)
    return np.cos(2 * phase) * to_sine - np.sin(2 * phase) * to_cosine
