"""Motion of a chain of spheres: symplectic schemes of two orders, and DOP853.

A symplectic scheme is a composition of velocity Verlet, in which steps γ_i h replace a step h:

| scheme | forces per step | order, smooth motion | order, contacts close or open |
|---|---|---|---|
| VERLET | 1 | 2 | 2 |
| VERLET, dashpots | 1 | 1 | 1 |
| SIXTH | 9 | 6 | 5/2 |

With dashpots VERLET is LAMMPS's scheme, which computes their forces with the velocities of half a step earlier; SIXTH
is refused.

A contact closes or opens within a step, where its force t₊^{3/2} is not smooth; each such event leaves an error of
h^{5/2} with any scheme of fixed step. DOP853 shortens its steps there. A solitary wave in equal spheres that just touch
has no such event: its overlap rises and falls faster than any power.

Good values: a step of `collision_time` / 80 for VERLET (error 1.4e-4 of the velocities after 12 collision times), / 20
for SIXTH (3e-6), rtol = 1e-10 for DOP853 (2e-8). An evaluation of all forces takes half a µs of processor time for a
hundred spheres, or 10 µs without a compiler or with dashpots.
"""

from math import gamma, pi, sqrt

import numpy as np
from numpy.typing import ArrayLike

from cases.solitary.chain import Array, Chain, Floats, acceleration, energies, linear_stiffness
from cases.solitary.chain_loop import chain_slope
from granular_analysis.theory.integrator import dop853

Scheme = tuple[float, ...]

VERLET: Scheme = (1.0,)
# W. Kahan & R.-C. Li, Mathematics of Computation 66, 1089 (1997), nine steps; their order 6 is measured in a test
_OUTER = (0.39216144400731413928, 0.33259913678935943860, -0.70624617255763935981, 0.08221359629355080023)
SIXTH: Scheme = (*_OUTER, 1 - 2 * sum(_OUTER), *reversed(_OUTER))
AROUND = 4  # samples on each side of the highest one, for the polynomial at a peak


def collision_time(stiffness: float, mass: float, velocity: float) -> float:
    """Return the contact time of two equal spheres of mass m that collide with the relative velocity v.

        T = (4√π/5) Γ(2/5)/Γ(9/10) (5μ/4A)^{2/5} v^{−1/5} = 3.2181 (μ²/(A² v))^{1/5},  μ = m/2

    Source: Hertz; L. D. Landau & E. M. Lifshitz, Theory of Elasticity, section 9.
    """
    if not min(stiffness, mass, velocity) > 0:
        raise ValueError(f"stiffness, mass and velocity must be positive, not {stiffness}, {mass}, {velocity}")
    return 0.8 * sqrt(pi) * gamma(0.4) / gamma(0.9) * (0.625 * mass / stiffness) ** 0.4 * velocity**-0.2


def march(
    chain: Chain, u: Array, v: Array, step: float, steps: int, scheme: Scheme = VERLET, every: int | None = None
) -> tuple[Array, Array]:
    """Return displacements and velocities (T, …, n) after every `every` steps; only after the last if None.

    Parameters
    ----------
    u, v : (…, n) displacements and velocities at the start, not changed; complex numbers carry derivatives.
    step : time step; negative to run backward.
    steps : number of steps, a multiple of `every`.

    Raises ValueError for another number of steps, and for a chain with dashpots with any scheme but VERLET or backward;
    RuntimeError for velocities that overflow.
    """
    every = every or steps
    if steps < 1 or steps % every:
        raise ValueError(f"steps must be a positive multiple of every = {every}, not {steps}")
    if chain.damped and (scheme != VERLET or step < 0):
        raise ValueError(f"restitution = {chain.restitution}: needs VERLET and a positive step, not step = {step}")
    us, vs = np.empty((steps // every, *u.shape), u.dtype), np.empty((steps // every, *v.shape), v.dtype)
    halves = np.array([part * step / 2 for part in scheme])
    alike = u.shape == v.shape and u.dtype == v.dtype in (float, complex)
    slope = chain_slope(chain, 1.0, 1.0) if alike else None
    if slope is None:
        _march(chain, u.copy(), v.copy(), halves, every, us, vs)
    else:
        state = np.stack([u, v], axis=-2)
        rate = np.stack([v, acceleration(chain, u, v)], axis=-2)
        for now in zip(us, vs, strict=True):
            slope.marched(state, rate, halves, every)
            now[0][...], now[1][...] = state[..., 0, :], state[..., 1, :]
    if not np.isfinite(vs[-1]).all():
        raise RuntimeError(f"velocities have overflowed: the step {step} is too long, or the start is not finite")
    return us, vs


def _march(chain: Chain, u: Array, v: Array, halves: Array, every: int, us: Array, vs: Array) -> None:
    """Write displacements and velocities after every `every` steps, see `march`; u and v are changed."""
    pull = acceleration(chain, u, v)
    for number in range(len(us)):
        for half in [*halves] * every:
            v += half * pull
            u += 2 * half * v
            pull = acceleration(chain, u, v)
            v += half * pull
        us[number], vs[number] = u, v


def integrate(chain: Chain, u: Floats, v: Floats, times: ArrayLike, rtol: float = 1e-10) -> tuple[Floats, Floats]:
    """Return the displacements and the velocities (T, n) at ascending times ≥ 0, by DOP853.

    Parameters
    ----------
    u, v : (n,) displacements and velocities at time 0.
    rtol : error of a step, relative to the largest overlap and velocity that the energy allows, root mean square over
        the spheres.

    Raises ValueError if nothing moves, or if no sphere touches another or a wall.
    """
    if not chain.stiffness.any():
        raise ValueError("the chain has no contact: its spheres fly freely")
    total = float(np.sum(energies(chain, u, v)))
    if not total > 0:
        raise ValueError("the chain is at rest: give it a displacement or a velocity")
    stiffness = float(linear_stiffness(chain).max())
    length = (2.5 * total / chain.stiffness.max()) ** 0.4
    if stiffness > 0:
        length = min(length, sqrt(2 * total / stiffness))
    speed = sqrt(2 * total / chain.mass.min())

    def derivative(y: Array) -> Array:
        return np.stack([y[1], acceleration(chain, y[0] * length, y[1] * speed) * (length / speed**2)])

    start = np.stack([u / length, v / speed])
    slope = chain_slope(chain, length, speed) or derivative
    states = dop853(slope, start, np.asarray(times, dtype=float) * (speed / length), rtol, rtol, np.inf)
    return states[:, 0] * length, states[:, 1] * speed


def peak(times: ArrayLike, values: ArrayLike) -> tuple[float, float]:
    """Return height and time of the highest value, from the polynomial through 2·`AROUND` + 1 samples around it.

    For a solitary wave sampled at 0.1 of its `collision_time` both are right to 3e-6, at 0.03 to 1e-10.

    Raises ValueError if the highest sample is too near to an end.
    """
    times, values = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
    top = int(np.argmax(values))
    near = slice(top - AROUND, top + AROUND + 1)
    if top < AROUND or near.stop > len(values):
        raise ValueError(f"the highest value is sample {top} of {len(values)}: too near to an end for a peak")
    apart, scale = times[near] - times[top], times[top + AROUND] - times[top]
    curve = np.linalg.solve(np.vander(apart / scale), values[near])
    slopes = np.roots(np.polyder(curve))
    turns = slopes[np.isreal(slopes)].real
    turn = float(turns[np.argmin(np.abs(turns))])
    return float(np.polyval(curve, turn)), float(times[top] + scale * turn)


def first_peak(times: ArrayLike, values: ArrayLike, least: float) -> tuple[float, float]:
    """Return height and time of the crest of the first pulse higher than `least`, by the method of `peak`.

    A pulse ends where it has fallen to half of its height; until then it may have two maxima.

    Raises ValueError if no pulse has ended, or if its crest is too near to an end.
    """
    times, values = np.asarray(times, dtype=float), np.asarray(values, dtype=float)
    highest = np.maximum.accumulate(values)
    over = np.flatnonzero((values < highest / 2) & (highest > least))
    if not len(over):
        raise ValueError(f"no pulse above {least:g} has passed")
    top = int(np.argmax(values[: over[0]]))
    near = slice(max(top - AROUND, 0), top + AROUND + 1)
    return peak(times[near], values[near])
