"""Time derivative of `granular_analysis.theory.lattice` on the phase torus in one call of a compiled loop.

The reference is `lattice.rhs`, which has the same formulas. It takes about forty calls of NumPy, a microsecond each,
for a few hundred numbers. Neighbours other than those of a phase torus use the reference.
"""

import ctypes

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory import loops
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.neighbours import Neighbours, directions_at_rest

Floats = NDArray[np.float64]
MOST = 128  # most points, as in loops.c


class _Torus(ctypes.Structure):
    """`Torus` of loops.c."""

    _fields_ = [
        *((name, ctypes.c_ssize_t) for name in ("waves", "points", "history", "incremental", "potential")),
        *((name, ctypes.c_void_p) for name in ("shifts", "back")),
        *((name, ctypes.c_double * 3) for name in ("along", "across")),
        *((name, ctypes.c_double) for name in ("A", "F", "shear", "length", "overlap_ratio")),
        *((name, ctypes.c_double) for name in ("depth", "width", "least", "dashpot", "softens")),
        ("mobility", ctypes.c_double * 3),
    ]


def torus_slope(state: Floats, contact: Contact, neighbours: Neighbours) -> loops.Slope | None:
    """Return the slope for states of the shape of `state`, (..., 6 or 9, K), or None.

    It is None without compiled loops, without a phase torus, and for more than `MOST` points.
    """
    loop, torus, points = loops.library(), neighbours.torus, state.shape[-1]
    if loop is None or torus is None or points > MOST:
        return None
    arrays = np.ascontiguousarray(torus.shifts), np.ascontiguousarray(torus.shifts.T)
    sizes = state.size // points // (9 if contact.has_history else 6), points, contact.has_history
    triple = ctypes.c_double * 3
    data = _Torus(
        *(*sizes, contact.incremental, contact.law == "potential"),
        *map(loops.address, arrays),
        *(triple(*each.ravel()) for each in directions_at_rest(torus.direction)),
        *contact.adhesion.coefficients,
        contact.shear_stiffness,
        1 / contact.overlap_ratio - 1 if contact.overlap_ratio else 0.0,
        contact.overlap_ratio,
        *contact.adhesion.scales,
        contact.adhesion.least_overlap,
        2 * (contact.kappa + 3) * contact.dashpot,
        contact.restitution is not None,
        triple(*contact.mobility.ravel()),
    )
    return loops.Slope(loop.torus if state.dtype == float else loop.torus_complex, data, arrays)
