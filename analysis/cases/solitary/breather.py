"""Discrete breathers of a compressed chain: localised periodic motions with frequencies in the gap of the linear bands.

A breather that starts at rest, v(0) = 0, is at rest again after half its period, v(T/2) = 0. Newton's method solves
this for u(0), with derivatives by a complex step, which are exact to rounding. `chain_motion.SIXTH` integrates the
motion: with 48 steps in half a period, the stepped chain is periodic to rounding, the exact chain to 1e-6 of the
overlap at rest.

The interaction softens, so breathers of a diatomic chain bifurcate from the bottom ω₂ of the optical band down into the
gap ω₁ < ω < ω₂ (`chain.bands`). G. Theocharis et al., Phys. Rev. E 82, 056604 (2010), find two families: one centred on
a heavy sphere, symmetric, unstable; one centred on a light sphere, asymmetric, stable or nearly so.

Good values: 40 or more spheres; free and loaded ends, because between held ends the expansion of the breather
compresses the chain; heavy end spheres, as light ones have surface modes in the gap; frequencies of 0.6 to 0.95 ω₂.
Guesses, in overlaps d at rest: 0.9 on a light sphere and −0.25 on both neighbours; or −0.9 and 0.9 on the light
neighbours of a heavy sphere. Follow a family in steps of 5 %. A Newton step for 43 spheres takes 0.02 s.

Breaks near ω₂, where the breather is wider than the chain, and near ω₁.
"""

import numpy as np

from cases.solitary.chain import Chain, Floats
from cases.solitary.chain_motion import SIXTH, march

TINY = 1e-30  # size of a complex step; its square is far below the rounding of any motion
ENOUGH = 1e-12  # change, relative to the largest displacement, at which Newton's method ends
MOST = 20  # largest number of Newton steps; 4 to 8 are typical


def breather(chain: Chain, frequency: float, guess: Floats, steps: int = 48) -> Floats:
    """Return the displacements (n,) from which a chain, starting at rest, moves with the period 2π/ω.

    Parameters
    ----------
    chain : compressed chain with free or held ends.
    frequency : ω, rad per unit of time.
    guess : (n,) displacements; with a small guess Newton's method finds the chain at rest.
    steps : time steps in half a period.

    Raises ValueError for a chain that is not compressed, RuntimeError if Newton's method does not converge or leads to
    the chain at rest.
    """
    if not np.all(chain.overlap[1:-1] > 0):
        raise ValueError("a breather needs a band gap: every contact must be compressed")
    if not frequency > 0:
        raise ValueError(f"frequency must be positive, not {frequency}")
    u, free = np.array(guess, dtype=float), np.isfinite(chain.mass)
    size = np.max(np.abs(u))
    for _ in range(MOST):
        v, slope = _half_period(chain, u, np.pi / frequency / steps, steps)
        change = np.zeros_like(u)
        # The place of a chain with free ends is arbitrary; least squares take the solution with the smallest change
        change[free] = np.linalg.lstsq(slope[np.ix_(free, free)], v[free], rcond=1e-9)[0]
        u -= change
        if not np.max(np.abs(change)) < 100 * size:
            break
        if np.max(np.abs(change)) < ENOUGH * size:
            if np.ptp(u) < 1e-6 * size:
                raise RuntimeError(
                    f"at frequency {frequency:.6g} the guess leads to the chain at rest: use a larger guess"
                )
            return u
    raise RuntimeError(f"no breather of frequency {frequency:.6g} from this guess: start nearer to a known one")


def multipliers(chain: Chain, u: Floats, frequency: float, steps: int = 48) -> Floats:
    """Return the moduli (2k,) of the Floquet multipliers of a breather, descending, for k spheres that are not held.

    A small disturbance grows in each period by at most the largest. Multipliers come in pairs λ, 1/λ; all are 1 for a
    stable breather. Those of translations of the chain and of time are 1 only to the root of rounding, 1e-6.
    """
    free = np.flatnonzero(np.isfinite(chain.mass))
    count, moved = len(free), np.arange(len(free))
    us, vs = np.tile(u.astype(complex), (2 * count, 1)), np.zeros((2 * count, len(u)), dtype=complex)
    us[moved, free] += TINY * 1j
    vs[count + moved, free] += TINY * 1j
    (us,), (vs,) = march(chain, us, vs, np.pi / frequency / steps, 2 * steps, SIXTH)
    matrix = np.hstack([us[:, free].imag, vs[:, free].imag]).T / TINY
    result: Floats = np.sort(np.abs(np.linalg.eigvals(matrix)))[::-1]
    return result


def _half_period(chain: Chain, u: Floats, step: float, steps: int) -> tuple[Floats, Floats]:
    """Return the velocities (n,) after half a period, and their derivatives (n, n) by the initial displacements."""
    us = u + TINY * 1j * np.eye(len(u))
    _, (vs,) = march(chain, us, np.zeros_like(us), step, steps, SIXTH)
    return vs[0].real, vs.imag.T / TINY
