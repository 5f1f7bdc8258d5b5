"""Decay of the front of an impact on a chain of alternating heavy and light spheres that just touch.

Heavy spheres have the mass 1, light ones the mass ε, all contacts A = 1; the first sphere, a heavy one, starts with the
velocity 1. The first crest of the velocity of the heavy sphere in cell n is h_n. After some cells the front is a wave
of constant shape that loses the same share in each cell, because spheres that just touch have no scale of their own:

    h_n ∝ exp(−λ n),   λ(ε) ≥ 0

The lost energy stays in light spheres that rattle between their neighbours. For equal spheres and for a series of ε,
the resonances, light spheres come to rest behind the front, and the front is a solitary wave. Between two resonances λ
has a maximum, the antiresonance. At a resonance the velocity r of a light sphere behind the front changes its sign,
while λ only touches zero; so resonances are computed as roots of r.

Good values: ε from 0.03 to 1; a lighter sphere collides too often for the step. For ε from 0.53 to 0.59 pulses that
follow the front push it, and overtake it after 40 cells: there λ depends on the cells, by 3 % at the antiresonance and
by 20 % at 0.55. Other contacts, friction and dissipation are left out.

Published: K. R. Jayaprakash, Y. Starosvetsky & A. F. Vakakis, Phys. Rev. E 83, 036606 (2011), for the resonances. The
paper was not available; the numbers are measured here.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from cases.solitary.chain import Chain, compressed
from cases.solitary.chain_motion import SIXTH, first_peak, march

Floats = NDArray[np.float64]
# Time step. A third of it changes resonances by 2e-5 at most, and λ by 4e-6 or, for ε below 0.06, by 1 %
STEP = 0.15
CELLS = (15, 35)  # measured cells: there the front has a constant shape, and no later pulse has overtaken it
BEHIND = 3  # cells from a light sphere to the front when its velocity is measured
LOWEST, HIGHEST = 0.03, 1.0  # ε
SLOWEST = 1.7  # longest time in which a front passes a sphere in the measured cells
SILENCE = 1e-4  # velocity below which a pulse is rounding ahead of the front
RESOLUTION = 1e-4  # of ε at an antiresonance, where λ hardly changes


def dimer(ratio: float, cells: int) -> Chain:
    """Return a chain of alternating heavy and light spheres, the first heavy, with free ends.

    Parameters
    ----------
    ratio : ε, mass of a light sphere over that of a heavy one, in [0.03, 1].
    cells : number of pairs of spheres.

    Raises ValueError for another ratio.
    """
    if not LOWEST <= ratio <= HIGHEST:
        raise ValueError(f"ratio must be from {LOWEST} to {HIGHEST:g}, not {ratio:g}")
    stiffness = np.ones(2 * cells + 1)
    stiffness[[0, -1]] = 0.0
    return compressed(np.tile([1.0, ratio], cells), stiffness)


def decay_of(velocity: Floats) -> float:
    """Return λ of a struck chain, by least squares on the logarithms of h_n in the cells 15 to 35.

    velocity : (T, n) of all spheres at equally spaced times, at most 0.15 apart in the units above; n at least 2 · 39.

    Raises ValueError if the front has not passed these cells.
    """
    first, last = CELLS
    times = np.arange(len(velocity))
    heights = [first_peak(times, velocity[:, 2 * cell], SILENCE)[0] for cell in range(first, last + 1)]
    return -float(np.polyfit(np.arange(len(heights)), np.log(heights), 1)[0])


def rattle_of(velocity: Floats) -> float:
    """Return r: velocity of the light sphere of cell 35 over h_38, when the front is at the heavy sphere of cell 38.

    velocity, Raises : as for `decay_of`.
    """
    cell = CELLS[1]
    times = np.arange(len(velocity))
    height, moment = first_peak(times, velocity[:, 2 * (cell + BEHIND)], SILENCE)
    return float(np.interp(moment, times, velocity[:, 2 * cell + 1])) / height


def decay(ratio: float) -> float:
    """Return λ of the theory; raise ValueError for a ratio outside [0.03, 1]."""
    return decay_of(struck(ratio))


def rattle(ratio: float) -> float:
    """Return r of the theory; raise ValueError for a ratio outside [0.03, 1]."""
    return rattle_of(struck(ratio))


def resonance(low: float, high: float) -> float:
    """Return the ε between two ratios at which light spheres come to rest behind the front.

    Good values: 0.34 to 0.35, 0.15 to 0.16, 0.088 to 0.092. Farther from a resonance r has other roots, at which a
    rattling sphere reverses.

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


@lru_cache(maxsize=4)  # decay and rattle use the same motion, and a root search evaluates its ends again
def struck(ratio: float) -> Floats:
    """Return the velocities (T, n) of a struck chain after each step, until the front has passed the measured cells.

    Raises ValueError for a ratio outside [0.03, 1].
    """
    last = CELLS[1] + BEHIND
    chain = dimer(ratio, last + 5)
    v = np.eye(len(chain))[0]
    steps = round(SLOWEST * 2 * last / STEP)
    return march(chain, 0 * v, v, STEP, steps, SIXTH, every=1)[1]
