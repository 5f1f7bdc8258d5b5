"""Creep in one wave: slip that accumulates in the contacts, and the resulting steady motion of the spheres.

If the sideways motion δT of a contact is out of phase with its stretch δN, slip accumulates at the mean rate

    ds/dt = (ω/2ℓ) Im[δT δN* + n × δT (Φ·n)*],

because the tangent turns by δT/ℓ while the contact is stretched, or twisted by Φ·n. Modes of planar lattices with one
sphere per cell are real, so no slip accumulates. In a layer on a substrate, u_z is 90° out of phase with the motion
along the wave, so the layer creeps by rolling, in proportion to time and to a²Δ0/2R.

The next order changes the creep by the share `departure`: the forced and free second harmonics creep themselves, and
take their energy from the wave. The departure is large near a resonance. There the waves *beat*, and a mean over less
than several beats is wrong by far more: by 1.3 times the creep over one beat where the departure is 0.11.

When it breaks: as second order does; on a resonance, whose beat lasts forever.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory.crystal import Crystal
from granular_analysis.theory.second_order import RIGID, Mixed, Wave

Floats = NDArray[np.float64]
_SMALL = 1e-9  # free waves below this share of the forced second harmonic are rounding


class Creep(NamedTuple):
    """Creep in a wave of given amplitude.

    Attributes
    ----------
    velocity : (B, 6) mean velocity of u and Rθ.
    departure : relative change of the velocity by the next order, to leading order.
    beat : period of the beat between the second harmonic and the free wave nearest to it in frequency.
    """

    velocity: Floats
    departure: float
    beat: float


def creep(crystal: Crystal, wave: Wave) -> Creep:
    """Return the creep of the spheres in a single wave; its velocity is 0 where no slip accumulates."""
    velocity = creep_velocity(crystal, wave)
    if not np.any(velocity):
        return Creep(velocity, 0.0, np.inf)
    waves = list(_doubled(crystal, wave))
    own = sum((np.sum(creep_velocity(crystal, each) * velocity) for each in waves), 0.0)
    taken = sum(_energy(crystal, each) for each in waves) / _energy(crystal, wave)
    doubled = 2 * abs(float(wave.frequency))
    slowest = min((abs(abs(float(each.frequency)) - doubled) for each in waves[1:]), default=0.0)
    return Creep(
        velocity=velocity,
        departure=float(own / np.sum(velocity**2) - taken),
        beat=2 * np.pi / slowest if slowest else np.inf,
    )


def creep_velocity(crystal: Crystal, wave: Wave) -> Floats:
    """Return the creep velocities (B, 6) of the spheres in a single wave, without the change by the next order."""
    return np.real(0.5 * Mixed(crystal, wave, wave.reversed).creep)


def _energy(crystal: Crystal, wave: Wave) -> float:
    return float(wave.frequency**2 * np.sum(crystal.mass * np.abs(wave.shape) ** 2))


def _doubled(crystal: Crystal, wave: Wave) -> Iterator[Wave]:
    """Yield the forced second harmonic and the free waves that the start launches."""
    pair = Mixed(crystal, wave, wave)
    forced, targets = 0.5 * pair.forced(), pair.targets
    yield Wave(pair.wavevector, pair.frequency, forced)
    least = _SMALL * np.abs(forced).max()
    for sign, amplitudes in zip((1, -1), pair.free_waves(), strict=True):
        for frequency, amplitude, shape in zip(targets.frequencies, 0.5 * amplitudes, targets.shapes, strict=True):
            if abs(amplitude) > least and frequency > RIGID * crystal.highest:
                yield Wave(pair.wavevector, sign * frequency, amplitude * shape)
