"""Linear steps of a crystal towards rest: its stiffness, factors that solve nearly with it, and conjugate gradients."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.dissection import blockwise, dissection, factorised
from granular_lmp.crystal.potential import Pairs, Potential
from granular_lmp.frozen import dataclass

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
_ITERATIONS, _BLOCKWISE = 30, 400  # Most iterations of conjugate gradients, with old factors and with blocks
_LONGEST_STEP = 0.05  # radii


def order_of(potential: Potential, pairs: Pairs) -> Integers | None:
    """Return the order of all bodies in which factors stay sparse; None in space. Walls couple to no sphere."""
    if potential.axes == 3:
        return None
    places = np.zeros((len(potential.free), potential.axes))
    places[: len(potential.crystal)] = potential.crystal.positions[:, : potential.axes]
    return dissection(places, pairs.i[: pairs.between], pairs.j[: pairs.between])


def bounded(potential: Potential, change: Floats) -> tuple[Floats, Floats]:
    """Return the changes of u (N, D) and e (D,) of a step, without a shift of the whole crystal, and not too long."""
    axes = potential.axes
    u, e = change[:-axes].reshape(-1, axes), change[-axes:]
    shifted = potential.crystal.pbc[:axes] & potential.free.all()  # nothing holds the crystal as a whole
    u = u - np.where(shifted, u.mean(axis=0), 0.0)
    share = min(1.0, _LONGEST_STEP / potential.unit / max(float(np.abs(u).max()), 1e-300))
    return share * u, share * e


@dataclass(frozen=True, eq=False)
class Tangent:
    """K + λ m over all u and then e: blocks by u (DN, DN, sparse), by both (DN, D) and by e (D, D)."""

    by_u: Any
    by_both: Floats
    by_e: Floats
    mass: Floats
    added: float
    stable: bool = False

    @property
    def diagonal(self) -> Floats:
        """Diagonal of the block by u, (DN,)."""
        return np.asarray(self.by_u.diagonal() + self.added * self.mass[: -len(self.by_e)])

    def with_added(self) -> Any:
        """Return the block by u with λ m, (DN, DN)."""
        import scipy.sparse as sparse  # slow to import, and only crystals at rest need it

        return self.by_u.tocsr() + sparse.diags(self.added * self.mass[: -len(self.by_e)], format="csr")

    @property
    def blocks(self) -> tuple[Any, Floats, Floats]:
        """K."""
        return self.by_u, self.by_both, self.by_e

    def __matmul__(self, x: Floats) -> Floats:
        u, e = x[: -len(self.by_e)], x[-len(self.by_e) :]
        product = np.append(self.by_u @ u + self.by_both @ e, self.by_both.T @ u + self.by_e @ e)
        return product + self.added * self.mass * x


class Solver(Protocol):
    """Solves nearly with a `Tangent`, as the preconditioner of conjugate gradients."""

    @property
    def iterations(self) -> int:
        """Most iterations."""

    def start(self, force: Floats) -> Floats:
        """Return where they start."""

    def __call__(self, force: Floats) -> Floats: ...


class Factors:
    """The inverse of a `Tangent`: the strains, which couple to every sphere, are eliminated last.

    Without an order it is that of a stiffer one, by the blocks of single spheres.
    """

    def __init__(self, tangent: Tangent, order: Integers | None) -> None:
        self._by_both, self._axes = tangent.by_both, len(tangent.by_e)
        self.order, self.diagonal, by_u = order, tangent.diagonal, tangent.with_added()
        self._solve = blockwise(by_u, self._axes) if order is None else factorised(by_u, order)
        self.iterations = _ITERATIONS if order is not None else _BLOCKWISE
        self._answer = self._solve(tangent.by_both)
        self._schur = tangent.by_e - tangent.by_both.T @ self._answer
        self._schur += np.diag(tangent.added * tangent.mass[-self._axes :])

    def start(self, force: Floats) -> Floats:
        """Return where conjugate gradients start: at rest."""
        return np.zeros_like(force)

    def __call__(self, force: Floats) -> Floats:
        u = self._solve(force[: -self._axes])
        e = np.linalg.solve(self._schur, force[-self._axes :] - self._by_both.T @ u)
        return np.append(u - self._answer @ e, e)


def conjugate_gradients(
    tangent: Tangent, factors: Solver, force: Floats, share: float
) -> tuple[Floats, int, Floats | None]:
    """Return the x with tangent x = force, to a share of it, the iterations, and where the tangent is not convex.

    That is a direction along which forces push away from rest, after which x goes no further, or None. Both the force
    left and the energy in it count: the force alone passes over soft places, the energy over stiff ones.
    """
    x = factors.start(force)
    left = force - tangent @ x
    direction = factors(left)
    energy = float(left @ direction)
    first = energy + float(force @ x)
    weighted = float(np.sum(force**2 / tangent.mass))
    for iteration in range(1, factors.iterations + 1):
        product = tangent @ direction
        curvature = float(direction @ product)
        if energy < 0:
            return x, factors.iterations, direction  # factors of an unstable crystal, of no use for long
        if curvature <= 0:
            return x, iteration, direction
        x += energy / curvature * direction
        left -= energy / curvature * product
        answer = factors(left)
        energy, old = float(left @ answer), energy
        enough = energy < share**2 * first and np.sum(left**2 / tangent.mass) < share**2 * weighted
        if enough:
            break
        direction = answer + energy / old * direction
    return x, iteration, None
