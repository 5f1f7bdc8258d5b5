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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.dissection import blockwise, dissection, factorised
from granular_lmp.crystal.potential import SKIN, Pairs, Potential, State
from granular_lmp.errors import CrystalError
from granular_lmp.frozen import dataclass

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Progress = Callable[[str, int, float, float], None]
BALANCED = 1e-10  # k1 Δ0: no force on a sphere at rest is larger
_STEPS = 5000
# Bounds of λ, in k1, its first value, and its least one where the crystal would buckle
_SOFTEST, _STIFFEST = 1e-9, 1e6
_FIRST, _BUCKLING = 1e-5, 1e-6
# Factors of λ: after a step that failed, one that succeeded with secants, and one without. If secants did not raise λ,
# they would lock places that are about to buckle, step after step.
_HARDER, _HELPED, _SOFTER = 8.0, 2.0, 1 / 6
_LONGEST_STEP = 0.05  # radii
_FAR = 1e-3  # k1 Δ0: a larger force is far from balance
# Share of the force that conjugate gradients may leave; near the rest its root, with which steps converge faster than
# linearly (Dembo, Eisenstat & Steihaug, SIAM J. Numer. Anal. 19, 400 (1982)). A share of 0.03 is a third faster, but
# lets rounding grow to other contacts at s = 12.
_SHARE_LEFT = 1e-3
_ITERATIONS, _BLOCKWISE = 30, 400  # Most iterations of conjugate gradients, with old factors and with blocks
_RESOLVED = 1e-3  # Δ0: over a smaller way the energy of a contact does not show its stiffness
_ATTEMPTS = 2  # secants, before λ grows


def balance(
    potential: Potential, pairs: Pairs, state: State, progress: Progress | None = None
) -> tuple[Pairs, State, int]:
    """Return the rest near a given state, and the number of Newton steps to it.

    Raises
    ------
    CrystalError
        When a force above `BALANCED` is left after `_STEPS`.
    """
    order = _order(potential, pairs)
    added, searched, failed, normal = _FIRST, state, 0, pairs.contact_stiffness(state.overlap)
    factors: _Factors | None = None
    for step in range(_STEPS):
        largest = potential.residual(state)
        if progress:
            progress("balance", step, largest, potential.energy(state))
        if largest <= BALANCED:
            return pairs, state, step
        if added > _STIFFEST:
            break
        across = -state.contact_force / state.length
        tangent = _Tangent(*potential.stiffness(pairs, state, normal, across), potential.mass, added)
        far = largest > _FAR
        if factors is None:
            stable = potential.stiffness(pairs, state, normal, np.maximum(across, 0.0)) if far else tangent.blocks
            factors = _Factors(_Tangent(*stable, potential.mass, added), order)
        share = min(_SHARE_LEFT, float(np.sqrt(largest)))
        change, iterations = _conjugate_gradients(tangent, factors, np.append(state.force, state.stress), share)
        if iterations > factors.iterations / 2 or (change is None and not far):
            factors = None
        if change is None:
            added = max(_HARDER * added, _BUCKLING)
            continue
        u, e = _bounded(potential, change)
        new = potential.state(pairs, state.u + u, state.e + e)
        if _energy_change(potential, state, new) < 0:
            added = added * _HELPED if failed else max(added * _SOFTER, _SOFTEST)
            state, failed = new, 0
            if potential.moved(searched, state) > SKIN / 4:
                pairs = potential.pairs(state.u, state.e)
                searched = state = potential.state(pairs, state.u, state.e)
            normal = pairs.contact_stiffness(state.overlap)
        else:
            failed += 1
            if failed <= _ATTEMPTS:
                normal = np.maximum(normal, _secant(state, new))
            else:
                added *= _HARDER
    raise CrystalError(
        f"the crystal does not come to rest: after {step + 1} Newton steps a force of {largest:.3g} of the contact "
        f"stiffness times the overlap at rest is left, and {BALANCED} is allowed; let the spheres differ less"
    )


def _order(potential: Potential, pairs: Pairs) -> Integers | None:
    """Return the order of all bodies in which factors stay sparse; None in space. Walls couple to no sphere."""
    if potential.axes == 3:
        return None
    places = np.zeros((len(potential.free), potential.axes))
    places[: len(potential.crystal)] = potential.crystal.positions[:, : potential.axes]
    return dissection(places, pairs.i[: pairs.between], pairs.j[: pairs.between])


def _bounded(potential: Potential, change: Floats) -> tuple[Floats, Floats]:
    """Return the changes of u (N, D) and e (D,) of a step, without a shift of the whole crystal, and not too long."""
    axes = potential.axes
    u, e = change[:-axes].reshape(-1, axes), change[-axes:]
    shifted = potential.crystal.pbc[:axes] & potential.free.all()  # nothing holds the crystal as a whole
    u = u - np.where(shifted, u.mean(axis=0), 0.0)
    share = min(1.0, _LONGEST_STEP / potential.unit / max(float(np.abs(u).max()), 1e-300))
    return share * u, share * e


def _energy_change(potential: Potential, before: State, after: State) -> float:
    """Return by how much the energy, and the work on the loads, has risen between two states."""
    e = after.e - before.e
    # Pair by pair, as the sum over a large crystal has lost the last digits of a small change
    change = float(np.sum(after.energy - before.energy) + potential.load @ e)
    if abs(change) > 1e-14 * len(before.energy):
        return change
    # Changes that are lost to rounding even so are known from the work of the forces
    u = after.u - before.u
    return -0.5 * float(np.sum((before.force + after.force) * u) + np.sum((before.stress + after.stress) * e))


def _secant(before: State, after: State) -> Floats:
    """Return the stiffness of each pair, k1, with which its energy and force before would lead to its energy after."""
    closer = after.overlap - before.overlap
    more = after.energy - before.energy - before.contact_force * closer
    return np.where(np.abs(closer) > _RESOLVED, 2 * more / np.maximum(closer**2, _RESOLVED**2), 0.0)


@dataclass(frozen=True, eq=False)
class _Tangent:
    """K + λ m over all u and then e: blocks by u (DN, DN, sparse), by both (DN, D) and by e (D, D)."""

    by_u: Any
    by_both: Floats
    by_e: Floats
    mass: Floats
    added: float

    @property
    def blocks(self) -> tuple[Any, Floats, Floats]:
        """K."""
        return self.by_u, self.by_both, self.by_e

    def __matmul__(self, x: Floats) -> Floats:
        u, e = x[: -len(self.by_e)], x[-len(self.by_e) :]
        product = np.append(self.by_u @ u + self.by_both @ e, self.by_both.T @ u + self.by_e @ e)
        return product + self.added * self.mass * x


class _Factors:
    """The inverse of a `_Tangent`: the strains, which couple to every sphere, are eliminated last.

    Without an order it is that of a stiffer one, by the blocks of single spheres.
    """

    def __init__(self, tangent: _Tangent, order: Integers | None) -> None:
        import scipy.sparse as sparse  # slow to import, and only crystals at rest need it

        self._by_both, self._axes = tangent.by_both, len(tangent.by_e)
        added = tangent.added * tangent.mass
        by_u = tangent.by_u.tocsr() + sparse.diags(added[: -self._axes], format="csr")
        self._solve = blockwise(by_u, self._axes) if order is None else factorised(by_u, order)
        self.iterations = _ITERATIONS if order is not None else _BLOCKWISE
        self._answer = self._solve(tangent.by_both)
        self._schur = tangent.by_e - tangent.by_both.T @ self._answer + np.diag(added[-self._axes :])

    def __call__(self, force: Floats) -> Floats:
        u = self._solve(force[: -self._axes])
        e = np.linalg.solve(self._schur, force[-self._axes :] - self._by_both.T @ u)
        return np.append(u - self._answer @ e, e)


def _conjugate_gradients(
    tangent: _Tangent, factors: _Factors, force: Floats, share: float
) -> tuple[Floats | None, int]:
    """Return the x with tangent x = force, to a share of it, and the iterations; None where it is not convex.

    Both the force left and the energy in it count: the force alone passes over soft places, the energy over stiff ones.
    """
    x, left = np.zeros_like(force), force.copy()
    direction = factors(left)
    first = energy = float(left @ direction)
    weighted = float(np.sum(force**2 / tangent.mass))
    for iteration in range(1, factors.iterations + 1):
        product = tangent @ direction
        curvature = float(direction @ product)
        if energy < 0:
            return None, factors.iterations  # the factors are those of an unstable crystal, of no use for long
        if curvature <= 0:
            return None, iteration
        x += energy / curvature * direction
        left -= energy / curvature * product
        answer = factors(left)
        energy, old = float(left @ answer), energy
        enough = energy < share**2 * first and np.sum(left**2 / tangent.mass) < share**2 * weighted
        if enough:
            break
        direction = answer + energy / old * direction
    return x, iteration
