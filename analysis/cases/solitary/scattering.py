"""Scattering of a solitary wave by another one, a wall, an impurity or an interface, for spheres that just touch.

The waves start as exact solutions (`cases.solitary.travelling`), so no other motion starts with them, and
`chain_motion.SIXTH` integrates. Shares are relative to the energy of the incoming wave. Units do not matter, because
all solitary waves of such spheres are the same up to scale.

Published (the abstracts were read): waves that have collided are ahead of waves that have not, and leave secondary
waves, which are stronger if they meet at a contact than at a sphere (F. Santibanez et al., arXiv:1102.3364; S. Zhang et
al., arXiv:2310.19356). A light impurity vibrates, and gaps open next to it (S. Job et al., arXiv:0901.3532).
"""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from cases.solitary.chain import Chain, compressed, energies, uniform
from cases.solitary.chain_motion import SIXTH, first_peak, march, peak
from cases.solitary.travelling import solitary_wave

WAVE = solitary_wave(1.0)
STEP = 0.05  # time step, over the time in which the wave moves by one sphere; shares of energy are right to 2e-6
HALF = 15  # spheres on each side of a crest that contain the whole wave; it starts this far from the end
AWAY = 30, 45  # distances from an event, in spheres, at which waves are measured: different waves are separate there
DURATION = 105.0  # of a run with an impurity: 45 to reach it, and the way of the reflected wave back to the end
PASSED = 20  # spheres from an interface at which the first waves are measured
WEAKEST = 0.01  # share of the incoming velocity below which a crest is not a wave of its own
NEAR = 5  # spheres on each side of an impurity whose energy counts as kept
Meeting = Literal["contact", "sphere"]


@dataclass(frozen=True)
class Crossing:
    """Two equal waves after a head-on collision, or one after a reflection.

    Attributes
    ----------
    lead : distance, in spheres, by which each wave is ahead of a wave that did not collide.
    velocity : largest velocity of a wave over that before the collision.
    secondary : share of its energy that is left in secondary waves and other motion.
    """

    lead: float
    velocity: float
    secondary: float


def crossing(meeting: Meeting) -> Crossing:
    """Return the waves after two equal waves have met at a contact, or at a sphere.

    By symmetry this also is the reflection at a rigid plane, with A = 2√2 times that of two spheres, and at a held
    sphere.

    Raises ValueError for another meeting.
    """
    if meeting not in ("contact", "sphere"):
        raise ValueError(f"meeting must be 'contact' or 'sphere', not {meeting!r}")
    count = HALF + AWAY[1]
    chain = _mirror(count, meeting)
    u, v = WAVE.start(count, HALF)
    # Contact j is at j and sphere i at i + 1/2
    way = (count if meeting == "contact" else count - 0.5) - HALF
    steps = round((2 * way + HALF / 2) / STEP)
    us, vs = march(chain, u, v, STEP, steps, SIXTH, every=1)
    late = slice(round((way + HALF) / STEP), None)
    times = STEP * np.arange(1, steps + 1)
    (_, first), (high, second) = (peak(times[late], -vs[late, count - away]) for away in AWAY)
    speed = (AWAY[1] - AWAY[0]) / (second - first)
    distance = HALF + way - (count - AWAY[1] + 0.5)
    # Extrapolated back to the mirror, at which a wave without a collision would be at the time `way`
    lead = way - (second - distance / speed)
    shares = energies(chain, us[-1], vs[-1]) / energies(chain, u, v).sum()
    crest = int(np.argmin(vs[-1]))
    main = shares[max(crest - HALF, 0) : crest + HALF // 2].sum()
    return Crossing(float(lead), high / WAVE.largest_velocity, float(1 - main))


@dataclass(frozen=True)
class Scattered:
    """A wave after an impurity, at the time DURATION − 45 after its arrival there.

    Attributes
    ----------
    transmitted, reflected, kept : shares of the energy beyond the impurity, before it, and within NEAR spheres of it.
    velocity : largest velocity of the first transmitted wave over that of the incoming wave.
    """

    transmitted: float
    reflected: float
    kept: float
    velocity: float


def impurity(mass: float) -> Scattered:
    """Return the waves after a solitary wave has met an impurity with contacts of the same A.

    Parameters
    ----------
    mass : mass of the impurity over that of the other spheres, from 0.1 to 30. A wave that passes a heavier one is too
        slow to be measured in the time of a run.

    Raises ValueError for another mass. The energy `kept` leaks away with time.
    """
    if not 0.1 <= mass <= 30:
        raise ValueError(f"mass must be from 0.1 to 30 times that of a sphere, not {mass:g}")
    place = HALF + AWAY[1]
    count = place + AWAY[1] + 2 * HALF
    equal = uniform(count)
    masses = equal.mass.copy()
    masses[place] = mass
    chain = compressed(masses, equal.stiffness)
    u, v = WAVE.start(count, HALF)
    steps = round(DURATION / STEP)
    us, vs = march(chain, u, v, STEP, steps, SIXTH, every=1)
    shares = energies(chain, us[-1], vs[-1]) / energies(chain, u, v).sum()
    before, beyond = place - NEAR, place + NEAR + 1
    velocity, _ = peak(STEP * np.arange(steps), vs[:, place + AWAY[0]])
    return Scattered(
        float(shares[beyond:].sum()),
        float(shares[:before].sum()),
        float(shares[before:beyond].sum()),
        velocity / WAVE.largest_velocity,
    )


@dataclass(frozen=True)
class Interface:
    """A wave after an interface.

    Attributes
    ----------
    transmitted, reflected : shares of the energy beyond and before the interface.
    momentum : momentum of all spheres beyond over that of the incoming wave; the spheres before have the rest.
    velocity : largest velocity of the first transmitted wave over that of the incoming wave.
    velocity_back : the same for the first reflected wave; 0 if there is none.
    """

    transmitted: float
    reflected: float
    momentum: float
    velocity: float
    velocity_back: float


@cache
def interface(mass: float) -> Interface:
    """Return the waves after a solitary wave has met spheres of another mass with contacts of the same A.

    Spheres of the same size and modulus but another density have the same A. Heavier spheres transmit one wave and
    reflect one. Into lighter spheres the last sphere before them sends a series of waves, and no wave is reflected.

    Parameters
    ----------
    mass : mass of a sphere beyond the interface over that of a sphere before it, from 0.1 to 10.

    Raises ValueError for another mass.
    """
    if not 0.1 <= mass <= 10:
        raise ValueError(f"mass must be from 0.1 to 10 times that of a sphere before the interface, not {mass:g}")
    place = HALF + AWAY[1]
    # The first wave moves by PASSED spheres and its own length, and farther in light spheres
    slowest = mass**-0.4 * (2 / (1 + mass)) ** 0.2
    duration = AWAY[1] + HALF + 1.5 * PASSED / min(slowest, 0.7)
    count = place + round(duration * max(slowest, 1.0))
    masses = np.where(np.arange(count) < place, 1.0, mass)
    chain = compressed(masses, uniform(count).stiffness)
    u, v = WAVE.start(count, HALF)
    step = STEP * min(mass, 1.0) ** 0.4
    us, vs = march(chain, u, v, step, round(duration / step), SIXTH, every=1)
    shares = energies(chain, us[-1], vs[-1]) / energies(chain, u, v).sum()
    times, least = step * np.arange(len(vs)), WEAKEST * WAVE.largest_velocity
    forth, _ = first_peak(times, vs[:, place + PASSED], least)
    back = first_peak(times, -vs[:, place - PASSED], least)[0] if mass > 1 else 0.0
    return Interface(
        float(shares[place:].sum()),
        float(shares[:place].sum()),
        float(np.sum(masses[place:] * vs[-1, place:]) / np.sum(masses * v)),
        forth / WAVE.largest_velocity,
        back / WAVE.largest_velocity,
    )


def _mirror(count: int, meeting: Meeting) -> Chain:
    """Return the left half of a symmetric chain; a sphere on the plane of symmetry has half the overlap of two."""
    equal = uniform(count)
    masses, contacts = equal.mass.copy(), equal.stiffness.copy()
    if meeting == "contact":
        contacts[-1] = 2 * np.sqrt(2)
    else:
        masses[-1] = np.inf
    return compressed(masses, contacts)
