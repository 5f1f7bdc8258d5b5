"""A solitary wave meets another one, a wall, an impurity or an interface, among spheres that just touch.

The waves start as exact ones (`cases.solitary.travelling`), so that nothing else moves, and run by
`chain_motion.SIXTH`. Shares are of the energy of the incoming wave. No unit enters: every wave of such spheres is one
wave but for its scale.

Published, of which the abstracts were read: waves that collide are ahead of where they would be alone, and leave
secondary waves, stronger ones where they meet at a contact than at a sphere (F. Santibanez et al., arXiv:1102.3364;
S. Zhang et al., arXiv:2310.19356); a light impurity vibrates, and gaps open beside it (S. Job et al., arXiv:0901.3532).
"""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np

from cases.solitary.chain import Chain, compressed, energies, uniform
from cases.solitary.chain_motion import SIXTH, first_peak, march, peak
from cases.solitary.travelling import solitary_wave

WAVE = solitary_wave(1.0)
STEP = 0.05  # share of the time in which the wave moves by one sphere; the shares of energy are good to 2e-6
HALF = 15  # spheres to each side of a crest that hold all of a wave; it starts so far from the end
AWAY = 30, 45  # spheres away from an event, where waves are measured: those of different speed have parted there
DURATION = 105.0  # a run with an impurity: 45 to it, and until the reflected wave is back at the end
PASSED = 20  # spheres from an interface, where the first waves are measured
WEAKEST = 0.01  # share of the incoming velocity: a lower crest is no wave of its own
NEAR = 5  # spheres on each side that count as the place of an impurity
Meeting = Literal["contact", "sphere"]


@dataclass(frozen=True)
class Crossing:
    """Two equal waves after a head-on collision, or one after a reflection.

    Attributes
    ----------
    lead : by how many spheres either wave is ahead of one that met no other.
    velocity : its largest velocity over that before.
    secondary : share of the energy that it has left to secondary waves and other motion.
    """

    lead: float
    velocity: float
    secondary: float


def crossing(meeting: Meeting) -> Crossing:
    """Return what follows when two equal waves meet at a contact, or at a sphere.

    By symmetry it is also what follows at a rigid plane, A = 2√2 times that of two spheres, and at a held sphere.

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
    # Back along its line to the mirror, where the wave alone would be at the time `way`
    lead = way - (second - distance / speed)
    shares = energies(chain, us[-1], vs[-1]) / energies(chain, u, v).sum()
    crest = int(np.argmin(vs[-1]))
    main = shares[max(crest - HALF, 0) : crest + HALF // 2].sum()
    return Crossing(float(lead), high / WAVE.largest_velocity, float(1 - main))


@dataclass(frozen=True)
class Scattered:
    """A wave after an impurity, at the time DURATION − 45 after it came there.

    Attributes
    ----------
    transmitted, reflected, kept : shares of the energy beyond it, before it, and within NEAR spheres of it.
    velocity : largest velocity of the first transmitted wave over that of the incoming one.
    """

    transmitted: float
    reflected: float
    kept: float
    velocity: float


def impurity(mass: float) -> Scattered:
    """Return what an impurity, with contacts of the same A, makes of a solitary wave.

    Parameters
    ----------
    mass : of the impurity, over that of the other spheres, from 0.1 to 30: what passes a heavier one is too slow to be
        measured in the time of a run.

    What `kept` holds leaks away in time.
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
    transmitted, reflected : shares of the energy beyond and before it.
    momentum : that of all spheres beyond, over that of the incoming wave; what is before has the rest.
    velocity : largest velocity of the first transmitted wave over that of the incoming one.
    velocity_back : that of the first reflected wave; 0 if there is none.
    """

    transmitted: float
    reflected: float
    momentum: float
    velocity: float
    velocity_back: float


@cache
def interface(mass: float) -> Interface:
    """Return what follows when a solitary wave comes to spheres of another mass, with contacts of the same A.

    Spheres of density and modulus of their own have another A; equal spheres of another density have this one. Heavier
    spheres take one wave, and throw one back. Into lighter ones the last sphere before them sends one wave after the
    other, and nothing comes back.

    Parameters
    ----------
    mass : of a sphere beyond, over that of one before, from 0.1 to 10.

    Raises ValueError for another mass.
    """
    if not 0.1 <= mass <= 10:
        raise ValueError(f"mass must be from 0.1 to 10 times that of a sphere before the interface, not {mass:g}")
    place = HALF + AWAY[1]
    # The first wave moves by PASSED spheres and its own length, and a light sphere lets it come farther
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
    """Return the left half of a symmetric chain: a sphere on a plane is half of two, and overlaps by half of theirs."""
    equal = uniform(count)
    masses, contacts = equal.mass.copy(), equal.stiffness.copy()
    if meeting == "contact":
        contacts[-1] = 2 * np.sqrt(2)
    else:
        masses[-1] = np.inf
    return compressed(masses, contacts)
