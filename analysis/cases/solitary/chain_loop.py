"""Right-hand side for `cases.solitary.chain_motion`, in one call of `granular_analysis.theory.loops`.

The formulas are those of `chain.acceleration`, which is the reference.
"""

import ctypes

import numpy as np

from cases.solitary.chain import Chain
from granular_analysis.theory import loops


class _Chain(ctypes.Structure):
    """`Chain` of loops.c."""

    _fields_ = [
        ("spheres", ctypes.c_ssize_t),
        *((name, ctypes.c_void_p) for name in ("stiffness", "overlap", "load", "mass", "dashpot")),
        *((name, ctypes.c_double) for name in ("length", "speed")),
    ]


def chain_slope(chain: Chain, length: float, speed: float) -> loops.Slope | None:
    """Return the time derivative of displacements and velocities (2, n), as a function, in units of length and speed.

    The unit of time is length/speed. Returns None without the compiled loops.
    """
    loop = loops.library()
    if loop is None:
        return None
    arrays = tuple(
        np.ascontiguousarray(each)
        for each in (chain.stiffness, chain.overlap, chain.load, chain.mass, *([chain.dashpot] if chain.damped else []))
    )
    places = [*map(loops.address, arrays), None][:5]
    data = _Chain(len(chain), *places, length, speed)
    return loops.Slope(loop.chain, data, arrays)
