"""Solvers for the stiffness of a crystal: sparse factors in the plane, the blocks of single spheres in space.

Nested dissection (George, SIAM J. Numer. Anal. 10, 345 (1973)): the crystal is cut in two at the median of its
longer side, the spheres on one side of the cut that have a neighbour on the other are numbered last, and both halves
are cut in the same way. In the plane the factors then have O(N log N) entries. The orderings that SciPy offers know no
geometry: minimum degree takes minutes for 1e5 spheres once some per cent of their contacts are open.

In space factors have O(N^{4/3}) entries, and 1e4 spheres of fcc would take ten times as long as with the blocks of
single spheres on the diagonal. Doubled, these are above the stiffness of any network of springs, as
2 Σ k (u_i² + u_j²) ≥ Σ k (u_j − u_i)², and conjugate gradients converge with them in a hundred steps or so.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
_LEAF = 8  # spheres in a part that is not cut any more
_SOFTEST = 1e-3  # k1: a sphere that hardly anything holds in a direction is held there as much by its block


def dissection(positions: Floats, i: Integers, j: Integers) -> Integers:
    """Return an order of spheres at positions (N, D) with neighbours i, j (C,), as indices (N,)."""
    count = len(positions)
    levels = max(0, int(np.ceil(np.log2(count / _LEAF))))
    part, key = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    inside = np.ones(count, dtype=bool)  # not yet in a cut
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
    """Return which spheres are in the upper half of their part, cut across its longest side."""
    _, part, count = np.unique(part, return_inverse=True, return_counts=True)
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    axes = positions.shape[1]
    rank = np.empty((axes, len(part)), dtype=np.int64)
    extent = np.empty((axes, len(count)))
    for axis in range(axes):
        order = np.lexsort((positions[:, axis], part))
        rank[axis, order] = np.arange(len(part)) - np.repeat(start, count)
        extent[axis] = positions[order[start + count - 1], axis] - positions[order[start], axis]
    longest = np.argmax(extent, axis=0)[part]
    return rank[longest, np.arange(len(part))] >= count[part] // 2


def rows_of(spheres: Integers, freedoms: int) -> Integers:
    """Return the rows of spheres with some freedoms each in the matrix of all of them."""
    return np.ravel(freedoms * spheres[:, None] + np.arange(freedoms))


def factors_of(matrix: Any) -> Any:
    """Return the factors of a symmetric sparse matrix in the order that it has."""
    from scipy.sparse.linalg import splu  # slow to import, and only crystals at rest need it

    return splu(matrix.tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def factorised(matrix: Any, order: Integers) -> Any:
    """Return a function that solves a symmetric sparse system of D freedoms a sphere, (DN, DN), for (DN, K) sides."""
    rows = rows_of(order, matrix.shape[0] // len(order))
    factors = factors_of(matrix[rows][:, rows])

    def solve(right: Floats) -> Floats:
        solution = np.empty_like(right)
        solution[rows] = factors.solve(right[rows])
        return solution

    return solve


def blockwise(matrix: Any, freedoms: int) -> Any:
    """Return a function that solves with twice the diagonal blocks of a system of D freedoms a sphere in its place."""
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
