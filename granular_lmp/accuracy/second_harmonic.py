"""Second harmonic of a run, measured only in its record, without a theory of its amplitude.

At the wave number 2ξ the lattice is one oscillator of frequency w̃, at rest at τ = 0 and driven at 2Ω, so that

    p = B S(τ) + c cos w̃τ + s sin w̃τ  (+ the fundamental, for L),   S'' + w̃²S = sin 2(Ωτ − phase),  S(0) = S'(0) = 0

and a constant at a phase other than 0. Ω and w̃ are those of the linear lattice; the factors are fitted by least
squares. The forced wave, which runs with the fundamental, has the amplitude A = |B/(w̃² − 4Ω²)|. Where w̃ comes near
2Ω, S stays regular and distinct from the free waves, but A does not: at the resonance the second harmonic grows with
time and has no amplitude.

The time step changes the frequencies and the drive. A second fit uses the functions of the stepped lattice
(`granular_lmp.accuracy.oscillator`), so its A is that for step 0; the difference is the error of the step. For a run to
a tolerance, whose record is extrapolated, the relative error is the estimate for p.
"""

from math import hypot, pi

import numpy as np
from numpy.typing import NDArray

from granular_lmp.accuracy.oscillator import Oscillator, late_shear, oscillator_of
from granular_lmp.frozen import dataclass
from granular_lmp.rest.linear import plane_along_y
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.readouts import fitted
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]

_FEWEST = 3  # records per coefficient of the fit
_MOVED = ("damping", "sliding", "contact_opening")  # effects that give p another form


@dataclass(frozen=True)
class SecondHarmonic:
    """Second harmonic of a run.

    Attributes
    ----------
    amplitude : float
        A, in D0.
    error : float
        Error of the time step, and standard error of the second fit for white noise, in D0. If other waves are present
        it only measures their size.
    frequency : float
        2Ω, in rad/t0.
    """

    amplitude: float
    error: float
    frequency: float


def second_harmonic(record: Record) -> SecondHarmonic | None:
    """Return the second harmonic of a run; None if p does not have the form above, or does not resolve it.

    The form holds for a running plane wave along y, without dashpots, sliding or opening contacts, before the echo of
    walls. *Good values*: a duration of several periods of the beat 2π/|w̃ − 2Ω|, and samples of less than half a period
    of either. *Breaks* if the wave is so large that p contains its third harmonic, of relative order a².
    """
    scene, tau = record.scene, record.tau
    moved = any(getattr(scene.effects, name) is True for name in _MOVED)
    if not plane_along_y(scene) or moved or not len(tau) or tau[-1] > scene.echo_time:
        return None
    exact = oscillator_of(scene)
    seen = scene.time.sample * max(exact.free, 2 * exact.wave) < pi
    if not seen or exact.detuning == 0 or len(tau) < _FEWEST * _columns(exact, scene, tau).shape[1]:
        return None
    amplitude, _ = _fitted(exact, record)
    stepped, spread = _fitted(oscillator_of(scene, scene.time.clock.of_answer), record)
    share = scene.time.clock.left(record.info.get("error_estimate", {}).get("p"))
    change = amplitude - stepped + amplitude * share
    return SecondHarmonic(amplitude, hypot(change, spread), 2 * exact.wave)


def _fitted(oscillator: Oscillator, record: Record) -> tuple[float, float]:
    """Return the amplitude without a step and its standard error, by the functions of an oscillator."""
    p = record.p - late_shear(record.scene, oscillator, record.tau)
    factors, errors = fitted(_columns(oscillator, record.scene, record.tau), p)
    return float(abs(factors[0] / oscillator.detuning)), float(abs(errors[0] / oscillator.detuning))


def _columns(oscillator: Oscillator, scene: Scene, tau: Floats) -> Floats:
    own, free = oscillator.stepped
    columns = [*oscillator.shapes(tau).T, np.cos(free * tau), np.sin(free * tau)]
    if scene.require_wave().mode == "L":  # with the slow drift of the fundamental, of order a² τ
        fundamental = [np.cos(own * tau), np.sin(own * tau)]
        columns += [*fundamental, *(tau * each for each in fundamental)]
    return np.column_stack(columns)
