"""Balance of forces: from spheres that have nearly settled to the rest at which no force is left on any of them.

Steps d with (K + λ m) d = f lower the energy until the forces f are gone, with the masses m = 1 of the spheres and that
of the box. They are solved nearly, by conjugate gradients with the factors of an earlier K
(`granular_lmp.crystal.factors`). New factors cost as much as thirty iterations in a crystal of 1e4 spheres, and are
made when a step took many. Which factors are used is a part of the way, as conjugate gradients leave another thousandth
of the force with other ones. Far from balance factors leave out that contacts which push turn away (their stiffness
across the contact is negative), so that they are those of a stable crystal.

A contact that parts or forms on the way pushes its spheres with about the pull-off force, and they may part or form
others: an avalanche of some tens of spheres. There are two rules for a step, which end at other contacts, but at as
many: over 24 seeds of 1020 spheres the mean number of contacts a sphere differs by 0.0007(12) at s = 4 and 0.0002(5) at
s = 8.

*The whole crystal* takes damped Newton steps through the avalanches. When a step raises the energy, single contacts
have become much stiffer on the way, or have formed. They get the stiffness that makes a parabola of the energies before
and after, their secant, and the step is taken again; the other contacts keep theirs. λ grows (Levenberg 1944, Marquardt
1963) where the crystal would buckle, or where secants do not help. With single-precision factors, whose λ is at least
1e-6 k1, 1e5 spheres with s = 2 take two thirds of the time, but of twelve crystals of 1020 spheres one with s = 4 and
one with s = 8 get other contacts.

*By avalanches* a step says only how the whole crystal yields, and the avalanches are left to those in them:

1. d is solved with factors that are mended where contacts have changed. Far from rest K leaves out what factors do.
   Where K is not convex the crystal would buckle, and d continues in that direction.
2. Of d the largest share 1, ½, ¼ … is taken with which the energy falls. When it is small, spheres that hardly anything
   holds would be flung far, and λ grows. Taken whole, steps fling them, and 0.02 contacts a sphere are lost at s = 4.
   Shear springs in place of λ, which would hold them, take five times as many steps.
3. Spheres that then bear a force above `_LOOSE`, and their neighbours within `_RINGS`, are let go from rest against the
   drag of `granular_lmp.crystal.let_go`; all others and the box are held.

Avalanches far apart end at once, so that a large crystal needs hardly more systems of equations than a small one: 1e5
spheres with s = 2 come to rest in a fifth of the time. With single-precision factors four of 30 crystals differed
between two kernels of OpenBLAS; with these none of 48 do, s = 2 to 12.
"""

from collections.abc import Callable, Iterator
from itertools import chain, islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.disorder import AVALANCHES, WHOLE
from granular_lmp.crystal.factors import Factors, conjugate_gradients, order_of
from granular_lmp.crystal.let_go import SETTLED, Progress, let_go_near
from granular_lmp.crystal.potential import Potential, State
from granular_lmp.crystal.tangent import Tangent
from granular_lmp.errors import CrystalError

Floats = NDArray[np.float64]
BALANCED = 1e-10  # k1 Δ0: no force on a sphere at rest is larger
STEPS = 5000
_FAR = 1e-3  # k1 Δ0: a larger force is far from balance
_LONGEST_STEP = 0.05  # radii

# The whole crystal: bounds of λ, in k1, its first value, and its least one where the crystal would buckle
_SOFTEST, _STIFFEST = 1e-9, 1e6
_FIRST, _BUCKLING = 1e-5, 1e-6
# Factors of λ: after a step that failed, one that succeeded with secants, and one without. If secants did not raise λ,
# they would lock places that are about to buckle, step after step.
_HARDER, _HELPED, _SOFTER = 8.0, 2.0, 1 / 6
# Share of the force that conjugate gradients may leave; near the rest its root, with which steps converge faster than
# linearly (Dembo, Eisenstat & Steihaug, SIAM J. Numer. Anal. 19, 400 (1982)). A share of 0.03 is a third faster, but
# lets rounding grow to other contacts at s = 12.
_SHARE_LEFT = 1e-3
_RESOLVED = 1e-3  # Δ0: over a smaller way the energy of a contact does not show its stiffness
_ATTEMPTS = 2  # secants, before λ grows

# By avalanches: least λ far from rest and near it, k1; λ grows and falls by `_HARDER`, and to 1e12 times that at most
_LEAST_FAR, _LEAST_NEAR, _MOST = 1e-5, 1e-9, 1e12
_HALVINGS = 10  # A step is halved at most as often
_FLUNG = 0.2  # A smaller share of a step says that λ is too small
_SHARE_LEFT_BY_AVALANCHES = 0.1
_BUCKLED = 0.5  # Δ0: how far a crystal is pushed in the direction in which it would buckle
_LOOSE, _RINGS = 1e-2, 3  # Force k1 Δ0 of spheres that are let go, and how far their neighbours are


def balance(potential: Potential, state: State, by: str, progress: Progress | None = None) -> tuple[State, int]:
    """Return the rest near a given state, and the number of steps to it, by "whole" or "avalanches".

    Raises
    ------
    CrystalError
        When a force above `BALANCED` is left after `STEPS`.
    """
    way = chain([state], RULES[by].steps(potential, state))
    for step, now in enumerate(islice(way, STEPS + 1)):
        largest = potential.residual(now)
        if progress:
            progress("balance", step, largest, potential.energy(now))
        if largest <= BALANCED:
            return now, step
    raise CrystalError(
        f"the crystal does not come to rest: after {step} {RULES[by].in_words} a force of {largest:.3g} of the contact "
        f"stiffness times the overlap at rest is left, and {BALANCED} is allowed; let the spheres differ less"
    )


def _whole(potential: Potential, state: State) -> Iterator[State]:
    """Yield the states after Newton steps of the whole crystal, until λ is too large."""
    order, added, failed, normal = order_of(potential, state), _FIRST, 0, state.normal_stiffness
    factors: Factors | None = None
    while added <= _STIFFEST:
        largest, tangent = potential.residual(state), Tangent.of(potential, state, added, normal)
        far = largest > _FAR
        if factors is None:
            across = np.maximum(state.stiffness_across, 0.0)
            factors = Factors(Tangent.of(potential, state, added, normal, across) if far else tangent, order)
        share = min(_SHARE_LEFT, float(np.sqrt(largest)))
        change, iterations, unstable = conjugate_gradients(tangent, factors, state.all_forces, share)
        if iterations > factors.iterations / 2 or (unstable is not None and not far):
            factors = None
        if unstable is not None:
            added = max(_HARDER * added, _BUCKLING)
        elif potential.energy_change(state, new := _moved(potential, state, change)) < 0:
            added = added * _HELPED if failed else max(added * _SOFTER, _SOFTEST)
            state, failed = potential.renewed(new), 0
            normal = state.normal_stiffness
        else:
            failed += 1
            if failed <= _ATTEMPTS:
                normal = np.maximum(normal, _secant(state, new))
            else:
                added *= _HARDER
        yield state


def _secant(before: State, after: State) -> Floats:
    """Return the stiffness of each pair, k1, with which its energy and force before would lead to its energy after."""
    closer = after.overlap - before.overlap
    more = after.energy - before.energy - before.contact_force * closer
    return np.where(np.abs(closer) > _RESOLVED, 2 * more / np.maximum(closer**2, _RESOLVED**2), 0.0)


def _by_avalanches(potential: Potential, state: State) -> Iterator[State]:
    """Yield the states after steps that let the spheres of each avalanche go, until λ is too large."""
    order, stiffer = order_of(potential, state), 1.0
    factors: Factors | None = None
    while stiffer <= _MOST:
        largest = potential.residual(state)
        far = largest > _FAR
        added = stiffer * (_LEAST_FAR if far else _LEAST_NEAR)
        if far or factors is None:
            stable = Tangent.of(potential, state, added, across=np.maximum(state.stiffness_across, 0.0))
        if factors is None:
            factors = Factors(stable, order)
        tangent = stable if far else Tangent.of(potential, state, added)
        share, force = min(_SHARE_LEFT_BY_AVALANCHES, float(np.sqrt(largest))), state.all_forces
        change, iterations, unstable = conjugate_gradients(tangent, factors.mended(tangent), force, share)
        if unstable is not None:
            longest = np.abs(unstable[: state.u.size]).max()
            change = change + np.copysign(_BUCKLED / longest, unstable @ force) * unstable
        if iterations > factors.iterations / 2:
            factors = None
        taken, state = _part_of(potential, state, change)
        if taken < _FLUNG:
            stiffer *= _HARDER
        elif taken == 1:
            stiffer = max(stiffer / _HARDER, 1.0)
        state = potential.renewed(state)
        yield state


def _part_of(potential: Potential, state: State, change: Floats) -> tuple[float, State]:
    """Return the share of a step with which the energy falls, 0 if none does, and the state after avalanches in it."""
    for share in 0.5 ** np.arange(_HALVINGS + 1):
        new = _moved(potential, state, change, share)
        if potential.energy_change(state, new) < 0:
            return float(share), _after_avalanches(potential, new)
    return 0.0, state


def _after_avalanches(potential: Potential, state: State) -> State:
    """Return the state after spheres with a large force, and those around them, were let go."""
    moving, pairs = np.abs(state.force).max(axis=1) > _LOOSE, state.pairs
    if not moving.any():
        return state
    for _ in range(_RINGS):
        beside = np.concatenate([pairs.i[moving[pairs.j]], pairs.j[moving[pairs.i]]])
        moving[beside] = True
        moving &= potential.free
    after = let_go_near(potential, state, moving)
    return after if potential.energy_change(state, after) < 0 else state


def _moved(potential: Potential, state: State, change: Floats, share: float = 1.0) -> State:
    """Return the state after a share of a step, which is bounded and does not shift the crystal as a whole."""
    axes = potential.axes
    u, e = change[:-axes].reshape(-1, axes), change[-axes:]
    shifted = potential.crystal.pbc[:axes] & potential.free.all()  # nothing holds the crystal as a whole
    u = u - np.where(shifted, u.mean(axis=0), 0.0)
    bound = min(1.0, _LONGEST_STEP / potential.unit / max(float(np.abs(u).max()), 1e-300))
    return potential.state(state.pairs, state.u + share * (bound * u), state.e + share * (bound * e))


class Rule(NamedTuple):
    """A rule for the steps, how far spheres settle before them (root mean square force, k1 Δ0), and its name."""

    steps: Callable[[Potential, State], Iterator[State]]
    settled: float
    in_words: str


RULES = {
    WHOLE: Rule(_whole, SETTLED, "damped Newton steps"),
    # From here on they take less time than spheres that move longer
    AVALANCHES: Rule(_by_avalanches, 4 * SETTLED, "steps that let the spheres of each avalanche go"),
}
