"""Old factors of a crystal, mended where contacts have parted or formed since.

The spheres of such contacts and their neighbours within `_RINGS` make up patches, up to a third of a large crystal. The
tangent A of now is solved exactly in the patches, by L, and nearly everywhere by the old factors G. Conjugate gradients
that start at L f leave no force in any patch, and with the preconditioner

    M = (1 − L A) G

none appears there later: this is deflation (Nicolaides, SIAM J. Numer. Anal. 24, 355 (1987)). What is left is how the
rest of the crystal yields, which changes little, and three iterations find it where old factors alone take 25. In 1e5
spheres with s = 2 the first factors then last until the last contact has parted.

Patches are factorised anew in each step, in double precision: a crystal hardly hangs on how factors are rounded.
"""

from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from granular_lmp.crystal.dissection import factors_of, rows_of
from granular_lmp.crystal.tangent import Factors, Tangent
from granular_lmp.frozen import dataclass

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
# k1: the diagonal of the tangent changes by more where a contact parts or forms; good values: 0.1 to 0.3
_CHANGED = 0.3
_RINGS = 4  # How far the neighbours in a patch are; good values: 3 to 6


@dataclass(frozen=True, eq=False)
class Mended:
    """Factors G of an earlier tangent, and of A in patches: of its rows `rows`, which are `part`."""

    old: Factors
    tangent: Tangent
    rows: Integers
    part: Any
    factors: Any

    @classmethod
    def of(cls, old: Factors, tangent: Tangent) -> Self | Factors:
        """Return old factors mended for a tangent, or as they are where no contact changed or a patch would buckle."""
        if old.order is None:
            return old
        inside = _changed(old, tangent)
        if not inside.any():
            return old
        rows = rows_of(old.order[inside[old.order]], len(tangent.by_e))
        part = tangent.with_added()[rows]
        factors = factors_of(part[:, rows])
        if not tangent.stable and (factors.U.diagonal() <= 0).any():
            return old  # conjugate gradients find the direction in which it would buckle
        return cls(old, tangent, rows, part, factors)

    @property
    def iterations(self) -> int:
        """Most iterations of conjugate gradients."""
        return self.old.iterations

    def start(self, force: Floats) -> Floats:
        """Return L f."""
        x = np.zeros_like(force)
        x[self.rows] = self.factors.solve(force[self.rows])
        return x

    def __call__(self, force: Floats) -> Floats:
        x, axes = self.old(force), len(self.tangent.by_e)
        pushed = self.part @ x[:-axes] + self.tangent.by_both[self.rows] @ x[-axes:]
        x[self.rows] -= self.factors.solve(pushed)
        return x


def _changed(old: Factors, tangent: Tangent) -> NDArray[np.bool_]:
    """Return which spheres are in a patch, (N,)."""
    axes, near = len(tangent.by_e), tangent.by_u
    inside = np.any(np.abs(tangent.diagonal - old.diagonal).reshape(-1, axes) > _CHANGED, axis=1)
    sphere = np.repeat(np.arange(len(inside)), np.diff(near.indptr))
    for _ in range(_RINGS):
        inside[near.indices[inside[sphere]]] = True
    return inside
