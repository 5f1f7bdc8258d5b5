"""An impact on a chain of heavy and light spheres in turn that just touch: how its front decays, over their masses.

The heavy spheres have m = 1, the light ones m = ε, all contacts A = 1, and the first sphere, a heavy one, starts with
the velocity 1. The front takes the heavy sphere of cell n to its first crest h_n. After some cells it is a wave of one
shape that loses the same share in each cell, because spheres that just touch have no scale of their own:

    h_n ∝ exp(−λ n),   λ(ε) ≥ 0

What it loses is left in light spheres that rattle between their neighbours. At equal spheres and at a series of ε, the
resonances, they come to rest behind the front, and it is a solitary wave. Between two resonances λ has a largest value,
the antiresonance. The velocity r of a light sphere behind the front changes its sign at a resonance, where λ only
touches zero: resonances are its roots.

Good values: ε from 0.03 to 1; a lighter sphere collides too often for the step. From 0.53 to 0.59 pulses that follow
the front push it, and overtake it after 40 cells: there λ depends on the cells, by 3 % at the antiresonance and by 20 %
at 0.55. Does not hold other contacts, friction or dissipation.

Published: K. R. Jayaprakash, Y. Starosvetsky & A. F. Vakakis, Phys. Rev. E 83, 036606 (2011), for the resonances. The
paper could not be read here; the numbers are measured.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from cases.solitary.chain import Chain, compressed
from cases.solitary.chain_motion import SIXTH, first_peak, march

Floats = NDArray[np.float64]
# A third of it changes resonances by 2e-5 at most, and λ by 4e-6 or, at ε below 0.06, by 1 %
STEP = 0.15
CELLS = (15, 35)  # The front has one shape there, and no later pulse has overtaken it
BEHIND = 3  # cells from a light sphere to the front, when its velocity is read
LOWEST, HIGHEST = 0.03, 1.0  # ε
SLOWEST = 1.7  # time in which a front passes a sphere, at most, in the cells that are measured
SILENCE = 1e-4  # a pulse below it is rounding ahead of the front
RESOLUTION = 1e-4  # in the mass ratio of an antiresonance, where λ hardly changes


def dimer(ratio: float, cells: int) -> Chain:
    """Return a chain of heavy and light spheres in turn, the first heavy, with free ends.

    Parameters
    ----------
    ratio : ε, mass of a light sphere over that of a heavy one, in [0.03, 1].
    cells : pairs of spheres.

    Raises ValueError for another ratio.
    """
    if not LOWEST <= ratio <= HIGHEST:
        raise ValueError(f"ratio must be from {LOWEST} to {HIGHEST:g}, not {ratio:g}")
    stiffness = np.ones(2 * cells + 1)
    stiffness[[0, -1]] = 0.0
    return compressed(np.tile([1.0, ratio], cells), stiffness)


def decay_of(velocity: Floats) -> float:
    """Return λ of a struck chain, by least squares on the logarithms of h_n in the cells 15 to 35.

    velocity : (T, n) of all spheres at even times, n at least 2 · 39; samples of 0.15 in the units above, or shorter.

    Raises ValueError if the front has not passed these cells.
    """
    first, last = CELLS
    times = np.arange(len(velocity))
    heights = [first_peak(times, velocity[:, 2 * cell], SILENCE)[0] for cell in range(first, last + 1)]
    return -float(np.polyfit(np.arange(len(heights)), np.log(heights), 1)[0])


def rattle_of(velocity: Floats) -> float:
    """Return r, the velocity of the light sphere of cell 35 over h_38 when the front is at the heavy one of cell 38.

    velocity, Raises : as for `decay_of`.
    """
    cell = CELLS[1]
    times = np.arange(len(velocity))
    height, moment = first_peak(times, velocity[:, 2 * (cell + BEHIND)], SILENCE)
    return float(np.interp(moment, times, velocity[:, 2 * cell + 1])) / height


def decay(ratio: float) -> float:
    """Return λ. Raises ValueError for a ratio outside [0.03, 1]."""
    return decay_of(struck(ratio))


def rattle(ratio: float) -> float:
    """Return r. Raises ValueError for a ratio outside [0.03, 1]."""
    return rattle_of(struck(ratio))


def resonance(low: float, high: float) -> float:
    """Return the ε between two ratios at which light spheres come to rest behind the front.

    Good values: 0.34 to 0.35, 0.15 to 0.16, 0.088 to 0.092. Farther from a resonance r has other roots, where a sphere
    that rattles turns.

    Raises ValueError if r has the same sign at both ratios.
    """
    ends = rattle(low), rattle(high)
    if ends[0] * ends[1] > 0:
        raise ValueError(f"no resonance from {low:g} to {high:g}: light spheres have {ends[0]:.2g} and {ends[1]:.2g}")
    return float(brentq(rattle, low, high, xtol=1e-6))


def antiresonance(low: float, high: float) -> tuple[float, float]:
    """Return ε and λ where λ is largest between two ratios.

    Raises ValueError if λ is largest at an end.
    """
    found = minimize_scalar(lambda ratio: -decay(ratio), bounds=(low, high), options={"xatol": RESOLUTION})
    if not low + 2 * RESOLUTION < found.x < high - 2 * RESOLUTION:
        raise ValueError(f"no antiresonance from {low:g} to {high:g}: the front decays most at an end")
    return float(found.x), -float(found.fun)


@lru_cache(maxsize=4)  # decay and rattle are of one motion, and a search for a root asks for its ends again
def struck(ratio: float) -> Floats:
    """Return the velocities (T, n) of a struck chain after each step, until the front has passed the measured cells.

    Raises ValueError for a ratio outside [0.03, 1].
    """
    last = CELLS[1] + BEHIND
    chain = dimer(ratio, last + 5)
    v = np.eye(len(chain))[0]
    steps = round(SLOWEST * 2 * last / STEP)
    return march(chain, 0 * v, v, STEP, steps, SIXTH, every=1)[1]
