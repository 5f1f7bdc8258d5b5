"""Stiffness of a crystal: second derivatives of its energy (`potential`) by displacements and strains."""

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.potential import Potential, State
from granular_lmp.frozen import dataclass

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Tangent:
    """Matrix K + λ m over all u, followed by e.

    Attributes
    ----------
    by_u : block of K by u, (DN, DN), sparse
    by_both : block of K by u and e, (DN, D)
    by_e : block of K by e, (D, D)
    mass : m, (DN + D,)
    added : λ, k1
    """

    by_u: Any
    by_both: Floats
    by_e: Floats
    mass: Floats
    added: float

    @classmethod
    def of(
        cls,
        potential: Potential,
        state: State,
        added: float = 0.0,
        normal: Floats | None = None,
        across: Floats | None = None,
    ) -> Self:
        """Return the tangent at a state.

        `normal` and `across` (C,) replace the stiffnesses of the state along and across each pair. A pair whose normal
        stiffness is 0 is left out. Rows of held spheres, and of axes along which the box keeps its length, are zero.
        """
        import scipy.sparse as sparse  # slow to import, and only crystals at rest need it

        normal = state.normal_stiffness if normal is None else normal
        across = state.stiffness_across if across is None else across
        pairs, on, free, axes = state.pairs, np.flatnonzero(normal > 0), potential.free, potential.axes
        i, j, vector, length, count = pairs.i[on], pairs.j[on], state.vector[:, on], state.length[on], len(free)
        across = np.where(on < pairs.between, across[on], 0.0)  # motion along a wall does not change its distance
        direction = vector / length
        spring = (normal[on] - across) * direction[:, None] * direction + np.eye(axes)[..., None] * across

        scale, breathing = 1 + state.e, potential.breathing / (1 + state.e)
        strained = spring * vector * breathing[:, None]  # index: component of the force, axis of the strain
        by_e = np.einsum("ac,abc->ab", vector * breathing[:, None], strained)
        by_both = np.empty((count, axes, axes))
        for a, b in np.ndindex(axes, axes):
            by_both[:, a, b] = np.bincount(j, strained[a, b], count) - np.bincount(i, strained[a, b], count)
        by_both *= free[:, None, None] * scale[:, None]
        # A strain also turns and stretches the displacements themselves; at rest this term is zero
        by_both[:, range(axes), range(axes)] -= breathing * state.force

        blocks = np.moveaxis(spring * np.multiply.outer(scale, scale)[..., None], -1, 0)
        mutual = blocks * (free[i] & free[j])[:, None, None]
        own = np.empty((count, axes, axes))
        for a, b in np.ndindex(axes, axes):
            own[:, a, b] = np.bincount(i, blocks[:, a, b], count) + np.bincount(j, blocks[:, a, b], count)
        own *= free[:, None, None]
        row, column = np.concatenate([np.arange(count), i, j]), np.concatenate([np.arange(count), j, i])
        data = np.concatenate([own, -mutual, -mutual])
        order = np.argsort(row, kind="stable")
        starts = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=count))])
        by_u = sparse.bsr_matrix((data[order], column[order], starts), shape=(axes * count, axes * count))
        return cls(by_u, by_both.reshape(axes * count, axes), by_e, potential.mass, added)

    @property
    def axes(self) -> int:
        """D, the number of dimensions."""
        return len(self.by_e)

    @property
    def diagonal(self) -> Floats:
        """Diagonal of the block by u with λ m, (DN,)."""
        return np.asarray(self.by_u.diagonal() + self.added * self.mass[: -self.axes])

    def with_added(self) -> Any:
        """Return the block by u with λ m, (DN, DN)."""
        import scipy.sparse as sparse  # slow to import, and only crystals at rest need it

        return self.by_u.tocsr() + sparse.diags(self.added * self.mass[: -self.axes], format="csr")

    def __matmul__(self, x: Floats) -> Floats:
        u, e = x[: -self.axes], x[-self.axes :]
        product = np.append(self.by_u @ u + self.by_both @ e, self.by_both.T @ u + self.by_e @ e)
        return product + self.added * self.mass * x
