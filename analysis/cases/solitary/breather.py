"""Discrete breathers of a compressed chain: periodic motions that stay where they are, in the gap of the linear bands.

A breather that starts at rest, v(0) = 0, is at rest again after half its period, v(T/2) = 0. Newton's method solves
this for u(0), with derivatives by a complex step, which are exact to rounding. The motion is that of
`chain_motion.SIXTH`: the stepped chain is periodic to rounding, the exact one to 1e-6 of the overlap at rest, with 48
steps to half a period.

The interaction softens, so breathers come from the bottom ω₂ of the optical band of a diatomic chain down into the gap
ω₁ < ω < ω₂ (`chain.bands`). G. Theocharis et al., Phys. Rev. E 82, 056604 (2010), find two families: centred on a heavy
sphere, symmetric, unstable; and centred on a light one, asymmetric, stable or nearly so.

Good values: 40 or more spheres; ends that are free and loaded, since between held ends the expansion of the breather
compresses the chain; heavy end spheres, as light ones have surface modes in the gap. Frequencies of 0.6 to 0.95 ω₂.
Starts, in overlaps d at rest: 0.9 on a light sphere and −0.25 on both neighbours; or −0.9 and 0.9 on the light
neighbours of a heavy sphere. Follow a family in steps of 5 %. A Newton step for 43 spheres takes 0.02 s.

Breaks near ω₂, where the breather is wider than the chain, and near ω₁.
"""

import numpy as np

from cases.solitary.chain import Chain, Floats
from cases.solitary.chain_motion import SIXTH, march

TINY = 1e-30  # size of a complex step; its square is lost in the rounding of any motion
ENOUGH = 1e-12  # change of a Newton step, relative to the largest displacement
MOST = 20  # Newton steps; it takes 4 to 8


def breather(chain: Chain, frequency: float, guess: Floats, steps: int = 48) -> Floats:
    """Return the displacements (n,) from which a chain at rest moves with the period 2π/ω.

    Parameters
    ----------
    chain : compressed, with free or held ends.
    frequency : ω.
    guess : (n,) displacements, large enough: Newton's method also finds the chain at rest.
    steps : to half a period.

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
        # A chain with free ends may lie anywhere: of all solutions, the least squares take the smallest change
        change[free] = np.linalg.lstsq(slope[np.ix_(free, free)], v[free], rcond=1e-9)[0]
        u -= change
        if not np.max(np.abs(change)) < 100 * size:
            break
        if np.max(np.abs(change)) < ENOUGH * size:
            if np.ptp(u) < 1e-6 * size:
                raise RuntimeError(
                    f"at frequency {frequency:.6g} the guess leads to the chain at rest: take a larger one"
                )
            return u
    raise RuntimeError(f"no breather of frequency {frequency:.6g} from this guess: start nearer to a known one")


def multipliers(chain: Chain, u: Floats, frequency: float, steps: int = 48) -> Floats:
    """Return the moduli (2k,) of the Floquet multipliers of a breather, the largest first; k spheres are not held.

    A small disturbance grows by at most the largest in each period. They come in pairs λ, 1/λ; all are 1 for a stable
    breather, those of free motion of the whole chain and of time to the root of the rounding, 1e-6.
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
    """Return the velocities (n,) after half a period and their derivatives (n, n) by the displacements at the start."""
    us = u + TINY * 1j * np.eye(len(u))
    _, (vs,) = march(chain, us, np.zeros_like(us), step, steps, SIXTH)
    return vs[0].real, vs.imag.T / TINY
