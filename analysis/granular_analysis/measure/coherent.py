"""Coherent wave in an imperfect crystal: the part of the motion that still is the plane wave, and its decay.

Disorder scatters a plane wave. Its remainder at the time t is the part of the displacements (or velocities) u_j of
spheres at places r_j that is periodic along the wave vector k, here with its second harmonic,

    u_j(t) = U_0(t) + Re[C_1(t) e^{ik·r_j} + C_2(t) e^{2ik·r_j}] + scattered,

with components along k̂ and across, ẑ × k̂. Least squares over all spheres make the fit exact for a plane wave on any
set of places, also with vacancies and in cells that do not hold a whole number of waves. In a perfect periodic crystal
the fit is the discrete Fourier transform.

A wave that runs along k and is scattered has C_1 = C e^{−Γt − iωt}; `decay` fits Γ and ω to log C_1. The standard
errors assume independent residuals. Residuals of scattered waves are correlated over a period or more, so true errors
are larger by the root of the number of samples per independent one. Good values: two to four samples a period, or a
comparison of runs with different seeds.

Breaks if C_1 is small against the scattered field (log C is biased below about twice that field), if waves run both
ways (then |C_1| beats), and if the phase turns by more than half a circle between samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

HARMONICS = (1, 2)
# Largest turn of the phase between two samples, rad: with more, noise could reverse the sign of the turn
_TURN = 0.9 * np.pi


@dataclass(frozen=True, eq=False)
class Coherent:
    """Coherent part of a field at T times.

    Attributes
    ----------
    amplitudes : (2, T, 2) complex amplitudes C_1 and C_2, along k and across, in the unit of the field.
    mean : (T, 2) uniform motion U_0 of all spheres, along k and across.
    scattered : (T,) scattered share of Σ|u_j|², from 0 to 1; nan if nothing moves.
    """

    amplitudes: Complexes
    mean: Floats
    scattered: Floats

    @property
    def along(self) -> Complexes:
        """Return C_1 (T,) along k."""
        return self.amplitudes[0, :, 0]

    @property
    def across(self) -> Complexes:
        """Return C_1 (T,) across k."""
        return self.amplitudes[0, :, 1]


def project(places: ArrayLike, field: ArrayLike, wavevector: Sequence[float]) -> Coherent:
    """Return the coherent part of displacements or velocities, see the module.

    Parameters
    ----------
    places : (N, 2) places of the spheres at rest.
    field : (T, N, 2) x and y components. For velocities times √m, `scattered` is a share of the kinetic energy.
    wavevector : k, in rad per unit of length.

    Raises ValueError for wrong shapes, values that are not finite, k = 0, and a k that is equivalent to 2k, to 0 or to
    the negative of one of them at these places.
    """
    places, field, k = np.asarray(places, float), np.asarray(field, float), np.asarray(wavevector, float)
    if places.ndim != 2 or places.shape[1] != 2 or field.ndim != 3 or field.shape[1:] != places.shape:
        raise ValueError(f"places {places.shape} and field {field.shape} must be (N, 2) and (T, N, 2)")
    if not (np.all(np.isfinite(places)) and np.all(np.isfinite(field)) and np.all(np.isfinite(k))):
        raise ValueError("places, field and wavevector must be finite")
    if k.shape != (2,) or not np.any(k):
        raise ValueError(f"wavevector = {wavevector} must be two numbers, not both 0")
    direction = k / np.hypot(*k)
    frame = np.array([direction, [-direction[1], direction[0]]])
    phase = places @ k
    waves = [wave(n * phase) for n in HARMONICS for wave in (np.cos, np.sin)]
    basis = np.stack([np.ones(len(places)), *waves], axis=1)
    motion = np.moveaxis(field @ frame.T, 1, 0).reshape(len(places), -1)  # (N, 2T)
    weights, _, rank, _ = np.linalg.lstsq(basis, motion, rcond=1e-8)
    if rank < basis.shape[1]:
        raise ValueError(f"wavevector = {wavevector}: k, 2k and 0 are not independent at these {len(places)} places")
    left = (motion - basis @ weights).reshape(len(places), -1, 2)
    whole, rest = np.sum(field**2, axis=(1, 2)), np.sum(left**2, axis=(0, 2))
    weights = weights.reshape(len(weights), -1, 2)
    scattered = np.divide(rest, whole, out=np.full(len(whole), np.nan), where=whole > 0)
    return Coherent(weights[1::2] - 1j * weights[2::2], weights[0], scattered)


@dataclass(frozen=True)
class Decay:
    """Fit of C e^{−Γt − iωt} to a coherent amplitude.

    Attributes
    ----------
    rate, rate_error : Γ and its standard error, 1 per unit of time.
    frequency, frequency_error : ω and its standard error, rad per unit of time; positive for a wave that runs along k.
    amplitude : C, in the unit of the amplitude.
    """

    rate: float
    rate_error: float
    frequency: float
    frequency_error: float
    amplitude: complex


def decay(times: ArrayLike, amplitude: ArrayLike) -> Decay:
    """Return the decay rate and frequency of a coherent amplitude (T,) at ascending times (T,), T ≥ 3.

    Lines are fitted to log|C_1| and to the unwrapped phase by weighted least squares. The weights are |C|²e^{−2Γt} from
    a first fit without weights, because the same scattered field disturbs the logarithm of a small wave more. The
    measured |C_1|² as weights would favour samples that the scattered field makes large, and so bias Γ.

    Raises ValueError for fewer than three samples, for an amplitude that vanishes, and if the phase turns by more than
    0.9 π between samples.
    """
    times, amplitude = np.asarray(times, float), np.asarray(amplitude, complex)
    if times.ndim != 1 or times.shape != amplitude.shape or len(times) < 3 or np.any(np.diff(times) <= 0):
        raise ValueError(f"times {times.shape} and amplitude {amplitude.shape} must be (T,), T at least 3, in order")
    if not np.all(np.isfinite(amplitude)) or np.any(amplitude == 0):
        raise ValueError("amplitude must be finite and nowhere 0")
    phase = np.unwrap(np.angle(amplitude))
    turn = float(np.max(np.abs(np.diff(phase))))
    if turn > _TURN:
        raise ValueError(f"the phase turns by {turn:.3g} rad between samples, more than {_TURN:.3g}: sample finer")
    size = np.log(np.abs(amplitude))
    (growth, _), _ = _line(times, size, np.ones_like(size))
    weight = np.exp(growth * (times - times[-1 if growth > 0 else 0]))
    (growth, start), growth_error = _line(times, size, weight)
    (turning, offset), turning_error = _line(times, phase, weight)
    return Decay(-growth, growth_error, -turning, turning_error, complex(np.exp(start + 1j * offset)))


def _line(x: Floats, y: Floats, weight: Floats) -> tuple[tuple[float, float], float]:
    """Return slope and intercept of a line, and the standard error of the slope; `weight` multiplies residuals."""
    share = weight**2 / np.sum(weight**2)
    centre = share @ x
    spread = share @ (x - centre) ** 2
    slope = share @ ((x - centre) * y) / spread
    intercept = share @ y - slope * centre
    residual = share @ (y - slope * x - intercept) ** 2
    return (float(slope), float(intercept)), float(np.sqrt(residual / spread / (len(x) - 2)))
