"""Linear steps of a crystal towards rest: conjugate gradients preconditioned with factors of an earlier stiffness.

**In the plane** the factors are sparse, in the order of a nested dissection (George, SIAM J. Numer. Anal. 10, 345
(1973)): the crystal is cut in two at the median of its longer side, the spheres on one side of the cut that have a
neighbour on the other side are numbered last, and both halves are cut in the same way. Factors then have O(N log N)
entries. SciPy's orderings do not use the geometry: minimum degree takes minutes for 1e5 spheres once some per cent of
their contacts are open.

**In space** sparse factors would have O(N^{4/3}) entries, and 1e4 spheres of fcc would take ten times as long as with
the diagonal blocks of single spheres. Doubled, these blocks exceed the stiffness of any network of springs, because
2 Σ k (u_i² + u_j²) ≥ Σ k (u_j − u_i)², and conjugate gradients converge with them in about a hundred steps.

**Mended factors.** The spheres of contacts that have parted or formed since the factors G were made, and their
neighbours within `_RINGS`, make up patches, up to a third of a large crystal. L solves the present tangent A exactly in
the patches, and G solves it approximately everywhere. Conjugate gradients that start at L f leave no force in any
patch, and with the preconditioner

    M = (1 − L A) G

no force appears there later: this is deflation (Nicolaides, SIAM J. Numer. Anal. 24, 355 (1987)). The remaining unknown
is how the rest of the crystal yields. This changes little, and three iterations find it, where old factors alone take
25. In 1e5 spheres with s = 2 the first factors then last until the last contact has parted. Patches are factorised
again in each step, in double precision, so a crystal hardly depends on the rounding of factors.
"""

from collections.abc import Callable
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.potential import Potential, State
from granular_lmp.crystal.tangent import Tangent

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Solve = Callable[[Floats], Floats]
_ITERATIONS, _BLOCKWISE = 30, 400  # largest number of conjugate-gradient iterations with old factors and with blocks
_LEAF = 8  # number of spheres in a part that is not cut further
_SOFTEST = 1e-3  # k1: least stiffness of a block, for directions in which hardly anything holds a sphere
# k1: where the diagonal of the tangent changes by more, a contact has parted or formed; good values: 0.1 to 0.3
_CHANGED = 0.3
_RINGS = 4  # rings of neighbours in a patch; good values: 3 to 6


class Factors:
    """Inverse of a `Tangent`: the strains, which couple to every sphere, are eliminated last.

    Without an order it is the inverse of a stiffer tangent, from the blocks of single spheres.
    """

    def __init__(self, tangent: Tangent, order: Integers | None) -> None:
        self._tangent, self._order, by_u = tangent, order, tangent.with_added()
        self._solve = _blockwise(by_u, tangent.axes) if order is None else _factorised(by_u, order)
        self.iterations = _ITERATIONS if order is not None else _BLOCKWISE
        self._answer = self._solve(tangent.by_both)
        self._schur = tangent.by_e - tangent.by_both.T @ self._answer
        self._schur += np.diag(tangent.added * tangent.mass[-tangent.axes :])
        self._diagonal = tangent.diagonal
        # Rows of the patches, the blocks of A by u and by e in these rows, and L
        self._patches: tuple[Integers, Any, Floats, Solve] | None = None

    def mended(self, tangent: Tangent) -> "Factors":
        """Return the factors mended for a tangent; unchanged if no contact changed or a patch would buckle."""
        inside = self._changed(tangent)
        if self._order is None or not inside.any():
            return self
        rows = _rows_of(self._order[inside[self._order]], tangent.axes)
        part = tangent.with_added()[rows]
        factors = _factors_of(part[:, rows])
        if (factors.U.diagonal() <= 0).any():
            return self  # conjugate gradients find the direction in which the patch would buckle
        mended = copy(self)
        mended._patches = rows, part, tangent.by_both[rows], factors.solve
        return mended

    def _changed(self, tangent: Tangent) -> NDArray[np.bool_]:
        """Return which spheres are in a patch, (N,)."""
        near = tangent.by_u
        inside = np.any(np.abs(tangent.diagonal - self._diagonal).reshape(-1, tangent.axes) > _CHANGED, axis=1)
        sphere = np.repeat(np.arange(len(inside)), np.diff(near.indptr))
        for _ in range(_RINGS):
            inside[near.indices[inside[sphere]]] = True
        return inside

    def start(self, force: Floats) -> Floats:
        """Return the start of conjugate gradients: L f."""
        x = np.zeros_like(force)
        if self._patches:
            rows, _, _, solve = self._patches
            x[rows] = solve(force[rows])
        return x

    def __call__(self, force: Floats) -> Floats:
        """Return M f, approximately the displacements that balance a force f; without patches M is G."""
        axes = self._tangent.axes
        u = self._solve(force[:-axes])
        e = np.linalg.solve(self._schur, force[-axes:] - self._tangent.by_both.T @ u)
        x = np.append(u - self._answer @ e, e)
        if self._patches:
            rows, by_u, by_both, solve = self._patches
            x[rows] -= solve(by_u @ x[:-axes] + by_both @ x[-axes:])
        return x


def conjugate_gradients(
    tangent: Tangent, factors: Factors, force: Floats, share: float
) -> tuple[Floats, int, Floats | None]:
    """Return an approximate solution x of tangent x = force, the number of iterations, and an unstable direction.

    share is the share of the force that may be left. The unstable direction is one along which the tangent is not
    convex, so that forces push away from rest; x then stops there. It is None in a convex tangent. The criterion uses
    both the remaining force and its energy: the force alone misses soft regions, the energy alone misses stiff ones.
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
            return x, factors.iterations, direction  # the factors are those of an unstable crystal: replace them
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


def order_of(potential: Potential, state: State) -> Integers | None:
    """Return an order of all bodies in which factors stay sparse; None in space. Walls couple to no sphere."""
    if potential.axes == 3:
        return None
    places, pairs = np.zeros((len(potential.free), potential.axes)), state.pairs
    places[: len(potential.crystal)] = potential.crystal.positions[:, : potential.axes]
    return dissection(places, pairs.i[: pairs.between], pairs.j[: pairs.between])


def dissection(positions: Floats, i: Integers, j: Integers) -> Integers:
    """Return an order of spheres at positions (N, D) with neighbours i, j (C,), as indices (N,)."""
    count = len(positions)
    levels = max(0, int(np.ceil(np.log2(count / _LEAF))))
    part, key = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    inside = np.ones(count, dtype=bool)  # spheres that are not yet in a cut
    for _ in range(levels):
        side = _upper_half(positions, part)
        across = inside[i] & inside[j] & (part[i] == part[j]) & (side[i] != side[j])
        cut = np.zeros(count, dtype=bool)
        cut[np.where(side[i], j, i)[across]] = True
        key = 3 * key + np.where(inside, np.where(cut, 2, side), 0)  # base 3: one half, the other, the cut behind both
        inside &= ~cut
        part = 2 * part + side
    return np.argsort(key, kind="stable")


def _upper_half(positions: Floats, part: Integers) -> NDArray[np.bool_]:
    """Return which spheres are in the upper half of their part, which is cut across its longest side."""
    _, part, count = np.unique(part, return_inverse=True, return_counts=True)
    start = np.cumsum(count) - count
    grouped = positions[np.argsort(part, kind="stable")]
    extent = np.maximum.reduceat(grouped, start) - np.minimum.reduceat(grouped, start)
    along = positions[np.arange(len(part)), np.argmax(extent, axis=1)[part]]
    upper = np.empty(len(part), dtype=bool)
    upper[np.lexsort((along, part))] = np.arange(len(part)) >= np.repeat(start + count // 2, count)
    return upper


def _rows_of(spheres: Integers, freedoms: int) -> Integers:
    """Return the matrix rows of some spheres, each with a number of freedoms."""
    return np.ravel(freedoms * spheres[:, None] + np.arange(freedoms))


def _factors_of(matrix: Any) -> Any:
    """Return the factors of a symmetric sparse matrix in its own order."""
    from scipy.sparse.linalg import splu  # slow to import, and only crystals at rest need it

    return splu(matrix.tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _factorised(matrix: Any, order: Integers) -> Solve:
    """Return a function that solves a symmetric sparse system (DN, DN), D freedoms per sphere, for sides (DN, K)."""
    rows = _rows_of(order, matrix.shape[0] // len(order))
    factors = _factors_of(matrix[rows][:, rows])

    def solve(right: Floats) -> Floats:
        solution = np.empty_like(right)
        solution[rows] = factors.solve(right[rows])
        return solution

    return solve


def _blockwise(matrix: Any, freedoms: int) -> Solve:
    """Return a function that solves a system of D freedoms per sphere by twice its diagonal blocks."""
    blocks = matrix.tobsr((freedoms, freedoms))
    count = blocks.shape[0] // freedoms
    rows = np.repeat(np.arange(count), np.diff(blocks.indptr))
    diagonal = np.zeros((count, freedoms, freedoms))
    np.add.at(diagonal, rows[rows == blocks.indices], blocks.data[rows == blocks.indices])
    stiffness, axes = np.linalg.eigh(2 * diagonal)
    inverse = axes / np.maximum(stiffness, _SOFTEST)[:, None] @ np.swapaxes(axes, 1, 2)

    def solve(right: Floats) -> Floats:
        return np.asarray((inverse @ right.reshape(count, freedoms, -1)).reshape(right.shape))

    return solve
