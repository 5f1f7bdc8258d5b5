"""Secular slip of one wave: shear springs that wind up, and the steady motion of the spheres that follows from it.

Where the sideways motion δT of a contact is out of phase with its stretch δN, its slip gathers at the mean rate

    ds/dt = (ω/2ℓ) Im[δT δN* + n × δT (Φ·n)*],

because the tangent turns by δT/ℓ while the contact is stretched, or twisted by Φ·n. Shapes of planar lattices with one
sphere a cell are real, and nothing winds up. In a layer on a substrate u_z is 90° off the motion along the wave: the
layer creeps, by rolling, in proportion to time and to a²Δ0/2R.

The next order changes the creep by the share `departure`: the second harmonic, forced and free, has a creep of its own,
and takes its energy from the wave. It is large near a resonance. Then both waves *beat*, and a mean over less than
several beats is off by far more: by 1.3 of the creep over one beat where the departure is 0.11.

When it breaks: as second order does; on a resonance, whose beat lasts forever.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory.crystal import Crystal
from granular_analysis.theory.second_order import RIGID, Mixed, Wave

Floats = NDArray[np.float64]
_SMALL = 1e-9  # share of the second harmonic below which a free wave is none


class Creep(NamedTuple):
    """Creep of a wave with its amplitude.

    Attributes
    ----------
    velocity : (B, 6) of u and Rθ.
    departure : share of the velocity that the next order adds to it, to leading order.
    beat : time in which the second harmonic beats with the slowest of the free waves that the start launches.
    """

    velocity: Floats
    departure: float
    beat: float


def creep(crystal: Crystal, wave: Wave) -> Creep:
    """Return how spheres creep in a single wave; 0 where nothing winds up."""
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
    """Return the velocities (B, 6) at which spheres creep in a single wave, without what the next order adds."""
    return np.real(0.5 * Mixed(crystal, wave, wave.reversed).creep)


def _energy(crystal: Crystal, wave: Wave) -> float:
    return float(wave.frequency**2 * np.sum(crystal.mass * np.abs(wave.shape) ** 2))


def _doubled(crystal: Crystal, wave: Wave) -> Iterator[Wave]:
    """Yield the forced second harmonic, and the free waves that the start launches."""
    pair = Mixed(crystal, wave, wave)
    forced, targets = 0.5 * pair.forced(), pair.targets
    yield Wave(pair.wavevector, pair.frequency, forced)
    least = _SMALL * np.abs(forced).max()
    for sign, amplitudes in zip((1, -1), pair.free_waves(), strict=True):
        for frequency, amplitude, shape in zip(targets.frequencies, 0.5 * amplitudes, targets.shapes, strict=True):
            if abs(amplitude) > least and frequency > RIGID * crystal.highest:
                yield Wave(pair.wavevector, sign * frequency, amplitude * shape)
