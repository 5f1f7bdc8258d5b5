"""Balance of forces: steps from nearly settled spheres to the rest, where no force is left on any sphere.

Steps d with (K + λ m) d = f lower the energy until the forces f vanish, with the masses m of the spheres (1) and of the
box. Conjugate gradients solve for d approximately, with the factors of an earlier K (`granular_lmp.crystal.factors`) as
preconditioner. New factors cost as much as thirty iterations in a crystal of 1e4 spheres; they are made after a step
with many iterations. The choice of factors affects the path, because with other factors conjugate gradients leave a
different thousandth of the force. Far from balance the factors omit the negative stiffness across contacts that push,
so they belong to a stable crystal.

A contact that parts or forms pushes its spheres with about the pull-off force, and these spheres may part or form other
contacts: an avalanche of some tens of spheres. There are two rules for a step. They end at different contacts, but at
equal numbers of contacts: over 24 seeds of 1020 spheres the mean number of contacts per sphere differs by 0.0007(12) at
s = 4 and by 0.0002(5) at s = 8.

*The whole crystal* takes damped Newton steps through the avalanches. If a step raises the energy, single contacts have
become much stiffer during the step, or have formed. They get their secant stiffness, which makes a parabola through the
energies before and after, the other contacts keep their stiffness, and the step is repeated. λ grows (Levenberg 1944,
Marquardt 1963) where the crystal would buckle, or where secants do not help. With single-precision factors, whose λ is
at least 1e-6 k1, 1e5 spheres with s = 2 take two thirds of the time, but of twelve crystals of 1020 spheres one with
s = 4 and one with s = 8 get other contacts.

*By avalanches* a step describes only how the whole crystal yields, and the spheres in an avalanche move separately:

1. d is solved with factors that are mended where contacts have changed. Far from rest K omits the same terms as the
   factors. If K is not convex the crystal would buckle, and d continues in that direction.
2. The step is the largest share 1, ½, ¼ … of d that lowers the energy. A small share means that nearly free spheres
   would be flung far, so λ grows. Whole steps would fling them, and lose 0.02 contacts per sphere at s = 4. Shear
   springs instead of λ would hold these spheres, but take five times as many steps.
3. Spheres with a force above `_LOOSE`, and their neighbours within `_RINGS`, are then released from rest against the
   drag of `granular_lmp.crystal.let_go`; all other spheres and the box are held.

Avalanches far apart end at the same time, so a large crystal needs hardly more systems of equations than a small one:
1e5 spheres with s = 2 come to rest in a fifth of the time. With single-precision factors, four of 30 crystals differed
between two kernels of OpenBLAS; with double-precision factors none of 48 crystals differ, for s = 2 to 12.
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
BALANCED = 1e-10  # k1 Δ0: largest force on a sphere at rest
STEPS = 5000
_FAR = 1e-3  # k1 Δ0: with a larger force the crystal is far from balance
_LONGEST_STEP = 0.05  # radii

# The whole crystal: bounds of λ, in k1, its first value, and its least value where the crystal would buckle
_SOFTEST, _STIFFEST = 1e-9, 1e6
_FIRST, _BUCKLING = 1e-5, 1e-6
# Factors of λ after a failed step, after a step that succeeded with secants, and after a step that succeeded without.
# If secants did not raise λ, they would lock regions that are about to buckle, step after step.
_HARDER, _HELPED, _SOFTER = 8.0, 2.0, 1 / 6
# Share of the force that conjugate gradients may leave. Near rest the share is the square root of the force, with which
# steps converge faster than linearly (Dembo, Eisenstat & Steihaug, SIAM J. Numer. Anal. 19, 400 (1982)). A share of
# 0.03 is a third faster, but lets rounding grow to other contacts at s = 12.
_SHARE_LEFT = 1e-3
_RESOLVED = 1e-3  # Δ0: a smaller displacement is too short to resolve the stiffness of a contact by its energy
_ATTEMPTS = 2  # attempts with secants before λ grows

# By avalanches: least λ far from rest and near rest, k1. λ grows and falls by `_HARDER`, up to 1e12 times the least λ
_LEAST_FAR, _LEAST_NEAR, _MOST = 1e-5, 1e-9, 1e12
_HALVINGS = 10  # largest number of halvings of a step
_FLUNG = 0.2  # a smaller share of a step means that λ is too small
_SHARE_LEFT_BY_AVALANCHES = 0.1
_BUCKLED = 0.5  # Δ0: displacement of a crystal in the direction in which it would buckle
_LOOSE, _RINGS = 1e-2, 3  # k1 Δ0: least force on spheres that are released; rings of neighbours released with them


def balance(potential: Potential, state: State, by: str, progress: Progress | None = None) -> tuple[State, int]:
    """Return the rest near a given state and the number of steps to it, by the rule "whole" or "avalanches".

    Raises
    ------
    CrystalError
        If a force above `BALANCED` is left after `STEPS`, or when λ has reached its limit.
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
    """Return the secant stiffness of each pair, k1: with energy and force before, it gives the energy after."""
    closer = after.overlap - before.overlap
    more = after.energy - before.energy - before.contact_force * closer
    return np.where(np.abs(closer) > _RESOLVED, 2 * more / np.maximum(closer**2, _RESOLVED**2), 0.0)


def _by_avalanches(potential: Potential, state: State) -> Iterator[State]:
    """Yield the states after steps that release the spheres of each avalanche, until λ is too large."""
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
    """Return the largest share of a step that lowers the energy, 0 if none does, and the state after its avalanches."""
    for share in 0.5 ** np.arange(_HALVINGS + 1):
        new = _moved(potential, state, change, share)
        if potential.energy_change(state, new) < 0:
            return float(share), _after_avalanches(potential, new)
    return 0.0, state


def _after_avalanches(potential: Potential, state: State) -> State:
    """Return the state after spheres with a large force, and the spheres around them, were released."""
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
    """Return the state after a share of a step, with its length bounded and without a shift of the whole crystal."""
    axes = potential.axes
    u, e = change[:-axes].reshape(-1, axes), change[-axes:]
    shifted = potential.crystal.pbc[:axes] & potential.free.all()  # axes along which nothing holds the whole crystal
    u = u - np.where(shifted, u.mean(axis=0), 0.0)
    bound = min(1.0, _LONGEST_STEP / potential.unit / max(float(np.abs(u).max()), 1e-300))
    return potential.state(state.pairs, state.u + share * (bound * u), state.e + share * (bound * e))


class Rule(NamedTuple):
    """Rule for the steps.

    Attributes
    ----------
    steps : function that yields the states after each step
    settled : root mean square force to which spheres settle before the first step, k1 Δ0
    in_words : description of the steps
    """

    steps: Callable[[Potential, State], Iterator[State]]
    settled: float
    in_words: str


RULES = {
    WHOLE: Rule(_whole, SETTLED, "damped Newton steps"),
    # Steps from this larger force take less time than letting the spheres settle further
    AVALANCHES: Rule(_by_avalanches, 4 * SETTLED, "steps that let the spheres of each avalanche go"),
}
