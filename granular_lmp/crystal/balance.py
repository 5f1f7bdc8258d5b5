"""Balance of forces: from spheres that have nearly settled to the rest at which no force is left on any of them.

Newton steps (K + λ m) d = f lower the energy until the forces f are gone, with the masses m = 1 of the spheres and that
of the box. In a disordered crystal contacts part and form on the way, in a few places at a time, and three things keep
these from costing the whole crystal:

- *Old factors.* Each step is solved by conjugate gradients, preconditioned with the factors of an earlier K. A few
  iterations make up for the contacts that have changed since. New factors cost as much as thirty iterations in a
  crystal of 1e4 spheres, and are made when a step took many. In space blocks take the place of factors
  (`granular_lmp.crystal.dissection`). Which factors are used is a part of the way: conjugate gradients leave another
  thousandth of the force with other ones. With single-precision factors, whose λ is at least 1e-6 k1, 1e5 spheres with
  s = 2 take two thirds of the time, but of twelve crystals of 1020 spheres one with s = 4 and one with s = 8 get other
  contacts.
- *Secants.* When a step raises the energy, single contacts have become much stiffer on the way, or have formed. They
  get the stiffness that makes a parabola of the energies before and after, and the step is taken again; the other
  contacts keep theirs.
- *λ* grows (Levenberg 1944, Marquardt 1963) where the crystal would buckle, or where secants do not help.

While contacts are far from balance the factors leave out that contacts which push turn away (their stiffness across
the contact is negative), so that they are those of a stable crystal.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.potential import Pairs, Potential, State
from granular_lmp.crystal.tangent import Factors, Tangent, bounded, conjugate_gradients, order_of
from granular_lmp.errors import CrystalError

Floats = NDArray[np.float64]
Progress = Callable[[str, int, float, float], None]
BALANCED = 1e-10  # k1 Δ0: no force on a sphere at rest is larger
STEPS = 5000
# Bounds of λ, in k1, its first value, and its least one where the crystal would buckle
_SOFTEST, _STIFFEST = 1e-9, 1e6
_FIRST, _BUCKLING = 1e-5, 1e-6
# Factors of λ: after a step that failed, one that succeeded with secants, and one without. If secants did not raise λ,
# they would lock places that are about to buckle, step after step.
_HARDER, _HELPED, _SOFTER = 8.0, 2.0, 1 / 6
FAR = 1e-3  # k1 Δ0: a larger force is far from balance
# Share of the force that conjugate gradients may leave; near the rest its root, with which steps converge faster than
# linearly (Dembo, Eisenstat & Steihaug, SIAM J. Numer. Anal. 19, 400 (1982)). A share of 0.03 is a third faster, but
# lets rounding grow to other contacts at s = 12.
_SHARE_LEFT = 1e-3
_RESOLVED = 1e-3  # Δ0: over a smaller way the energy of a contact does not show its stiffness
_ATTEMPTS = 2  # secants, before λ grows


def balance(
    potential: Potential, pairs: Pairs, state: State, progress: Progress | None = None
) -> tuple[Pairs, State, int]:
    """Return the rest near a given state, and the number of Newton steps to it.

    Raises
    ------
    CrystalError
        When a force above `BALANCED` is left after `STEPS`.
    """
    order = order_of(potential, pairs)
    added, searched, failed, normal = _FIRST, state, 0, pairs.contact_stiffness(state.overlap)
    factors: Factors | None = None
    for step in range(STEPS):
        largest = potential.residual(state)
        if progress:
            progress("balance", step, largest, potential.energy(state))
        if largest <= BALANCED:
            return pairs, state, step
        if added > _STIFFEST:
            break
        across = -state.contact_force / state.length
        tangent = Tangent(*potential.stiffness(pairs, state, normal, across), potential.mass, added)
        far = largest > FAR
        if factors is None:
            stable = potential.stiffness(pairs, state, normal, np.maximum(across, 0.0)) if far else tangent.blocks
            factors = Factors(Tangent(*stable, potential.mass, added), order)
        share = min(_SHARE_LEFT, float(np.sqrt(largest)))
        change, iterations, unstable = conjugate_gradients(
            tangent, factors, np.append(state.force, state.stress), share
        )
        if iterations > factors.iterations / 2 or (unstable is not None and not far):
            factors = None
        if unstable is not None:
            added = max(_HARDER * added, _BUCKLING)
            continue
        u, e = bounded(potential, change)
        new = potential.state(pairs, state.u + u, state.e + e)
        if potential.energy_change(state, new) < 0:
            added = added * _HELPED if failed else max(added * _SOFTER, _SOFTEST)
            state, failed = new, 0
            pairs, searched, state = potential.renewed(pairs, searched, state)
            normal = pairs.contact_stiffness(state.overlap)
        else:
            failed += 1
            if failed <= _ATTEMPTS:
                normal = np.maximum(normal, _secant(state, new))
            else:
                added *= _HARDER
    raise not_at_rest(f"{step + 1} Newton steps", largest)


def not_at_rest(steps: str, largest: float) -> CrystalError:
    """Return the error of a crystal on which a force, k1 Δ0, is left after some steps, in words."""
    return CrystalError(
        f"the crystal does not come to rest: after {steps} a force of {largest:.3g} of the contact "
        f"stiffness times the overlap at rest is left, and {BALANCED} is allowed; let the spheres differ less"
    )


def _secant(before: State, after: State) -> Floats:
    """Return the stiffness of each pair, k1, with which its energy and force before would lead to its energy after."""
    closer = after.overlap - before.overlap
    more = after.energy - before.energy - before.contact_force * closer
    return np.where(np.abs(closer) > _RESOLVED, 2 * more / np.maximum(closer**2, _RESOLVED**2), 0.0)
