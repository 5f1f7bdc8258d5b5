"""Balance of forces avalanche by avalanche: where a step parts or forms contacts, the spheres around them go again.

A contact that parts or forms on the way to rest pushes its spheres with about the pull-off force, and they may part or
form others: an avalanche of some tens of spheres. Newton steps of the whole crystal (`granular_lmp.crystal.balance`)
follow it through many systems of equations of all spheres. Here a system says only how the whole crystal yields, and
the avalanche is left to those in it:

1. *Yield.* (K + λ m) d = f is solved nearly, with old factors that are mended around contacts which have parted or
   formed since (`granular_lmp.crystal.patches`). Far from rest K leaves out that contacts which push turn away, so that
   it is that of a stable crystal, and factors always do. Where K is not convex the crystal would buckle, and d goes on
   in that direction.
2. *Share.* Of d the largest share 1, ½, ¼ … is taken with which the energy falls. When it is small, spheres that
   hardly anything holds would be flung far, and λ grows.
3. *Let go.* Spheres that then bear a force above `_LOOSE`, and their neighbours within `_RINGS`, are let go from rest
   against the drag of `granular_lmp.crystal.let_go`; all others and the box are held.

Avalanches far apart end at once, so that a large crystal needs hardly more systems of equations than a small one: 1e5
spheres with s = 2 come to rest in a fifth of the time. Crystals get other contacts than by Newton steps of the whole
crystal, but as many of them: over 24 seeds of 1020 spheres the mean number of contacts a sphere differs by 0.0007(12)
at s = 4 and 0.0002(5) at s = 8. Taken whole in place of in shares, steps fling spheres that hardly anything holds, and
0.02 contacts a sphere are lost at s = 4. Shear springs in place of λ, which would hold them, take five times as many
steps. Single-precision factors let rounding decide on contacts: four of 30 crystals differed between two kernels of
OpenBLAS. With these none of 48 do, s = 2 to 12.
"""

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.balance import BALANCED, FAR, STEPS, Progress, not_at_rest
from granular_lmp.crystal.let_go import let_go_near
from granular_lmp.crystal.patches import Mended
from granular_lmp.crystal.potential import Pairs, Potential, State
from granular_lmp.crystal.tangent import Factors, Tangent, bounded, conjugate_gradients, order_of

Floats = NDArray[np.float64]
# k1 Δ0, root mean square, at which these steps begin: they do the rest in less time than spheres that are let go longer
ROUGHLY_SETTLED = 4e-3
_SOFT, _SOFTEST = 1e-5, 1e-9  # Least λ far from rest and near it, k1
_STIFFER, _STIFFEST = 8.0, 1e12  # λ grows and falls by the first, and over its least value to the second at most
_HALVINGS = 10  # A step is halved at most as often
_FLUNG = 0.2  # A smaller share of a step says that λ is too small
_SHARE_LEFT = 0.1  # Conjugate gradients may leave this share of the force; near the rest its root
_BUCKLED = 0.5  # Δ0: how far a crystal is pushed in the direction in which it would buckle
_LOOSE, _RINGS = 1e-2, 3  # Force k1 Δ0 of spheres that are let go, and how far their neighbours are


def by_avalanches(
    potential: Potential, pairs: Pairs, state: State, progress: Progress | None = None
) -> tuple[Pairs, State, int]:
    """Return the rest near a given state, and the number of steps to it.

    Raises
    ------
    CrystalError
        When a force above `BALANCED` is left after `STEPS`.
    """
    order, searched, stiffer = order_of(potential, pairs), state, 1.0
    factors: Factors | None = None
    for step in range(STEPS):
        largest = potential.residual(state)
        if progress:
            progress("balance", step, largest, potential.energy(state))
        if largest <= BALANCED:
            return pairs, state, step
        if stiffer > _STIFFEST:
            break
        far = largest > FAR
        added = stiffer * (_SOFT if far else _SOFTEST)
        if far or factors is None:
            stable = _tangent(potential, pairs, state, added, 0.0)
        if factors is None:
            factors = Factors(stable, order)
        tangent = stable if far else _tangent(potential, pairs, state, added, -np.inf)
        change, iterations = _yielding(tangent, factors, state, min(_SHARE_LEFT, float(np.sqrt(largest))))
        if iterations > factors.iterations / 2:
            factors = None
        share, state = _part_of(potential, pairs, state, *bounded(potential, change))
        if share < _FLUNG:
            stiffer *= _STIFFER
        elif share == 1:
            stiffer = max(stiffer / _STIFFER, 1.0)
        pairs, searched, state = potential.renewed(pairs, searched, state)
    raise not_at_rest(f"{step + 1} steps by avalanches", largest)


def _tangent(potential: Potential, pairs: Pairs, state: State, added: float, least: float) -> Tangent:
    """Return K + λ m with contacts that have at least some stiffness across their normal, k1."""
    across = np.maximum(-state.contact_force / state.length, least)
    normal = pairs.contact_stiffness(state.overlap)
    return Tangent(*potential.stiffness(pairs, state, normal, across), potential.mass, added, least == 0)


def _yielding(tangent: Tangent, factors: Factors, state: State, share: float) -> tuple[Floats, int]:
    """Return how the crystal yields to its forces, and the iterations; in a direction of buckling it is pushed on."""
    force = np.append(state.force, state.stress)
    change, iterations, unstable = conjugate_gradients(tangent, Mended.of(factors, tangent), force, share)
    if unstable is not None:
        longest = np.abs(unstable[: state.u.size]).max()
        change = change + np.copysign(_BUCKLED / longest, unstable @ force) * unstable
    return change, iterations


def _part_of(potential: Potential, pairs: Pairs, state: State, u: Floats, e: Floats) -> tuple[float, State]:
    """Return the share of a step with which the energy falls, 0 if none does, and the state after avalanches in it."""
    for share in 0.5 ** np.arange(_HALVINGS + 1):
        new = potential.state(pairs, state.u + share * u, state.e + share * e)
        if potential.energy_change(state, new) < 0:
            return float(share), _after_avalanches(potential, pairs, new)
    return 0.0, state


def _after_avalanches(potential: Potential, pairs: Pairs, state: State) -> State:
    """Return the state after spheres with a large force, and those around them, were let go."""
    moving = np.abs(state.force).max(axis=1) > _LOOSE
    if not moving.any():
        return state
    for _ in range(_RINGS):
        beside = np.concatenate([pairs.i[moving[pairs.j]], pairs.j[moving[pairs.i]]])
        moving[beside] = True
        moving &= potential.free
    after = let_go_near(potential, pairs, state, moving)
    return after if potential.energy_change(state, after) < 0 else state
