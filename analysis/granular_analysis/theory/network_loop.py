"""Contacts of a network, under any law, in the plane or in space, in one call of `granular_analysis.theory.loops`.

The reference is `granular_analysis.theory.network_state.contacts` and `resultants`, which has the same formulas. It
takes about a hundred calls of NumPy, a microsecond each, for a few hundred contacts.
"""

import ctypes
from collections.abc import Callable
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory import loops
from granular_analysis.theory.network import Network
from granular_analysis.theory.network_state import Pairs, State, damping_ratio

Floats = NDArray[np.float64]
Acting = Callable[[Floats, Floats, Floats, Floats], tuple[float, bool]]


class Contacts(ctypes.Structure):
    """`Contacts` of loops.c; `arrays` keeps alive the memory to which it points."""

    arrays: list[NDArray[Any]]
    _fields_ = [
        *((name, ctypes.c_ssize_t) for name in ("spheres", "pairs", "dimension")),
        *((name, ctypes.c_ssize_t) for name in ("jkr", "incremental", "shear", "adheres")),
        *((name, ctypes.c_double) for name in ("friction", "viscosity", "loss", "step")),
        *((name, ctypes.c_void_p) for name in ("first", "second", "apart", "length", "overlap", "radii", "shortened")),
        *((name, ctypes.c_void_p) for name in ("mass", "A", "B", "F", "frame", "begun")),
    ]


def contacts_of(network: Network, pairs: Pairs, begun: NDArray[np.bool_], step: float = 0.0) -> Contacts:
    """Return the pairs, and whether they touch (M,), as the loops need them.

    step : length of a step of velocity Verlet; 0 for the rates of a motion alone.
    """
    ends = (pairs.first, pairs.second, pairs.apart, pairs.length, pairs.overlap, pairs.radii, pairs.shortened)
    arrays = [np.ascontiguousarray(each) for each in (*ends, pairs.mass, pairs.A, pairs.B, pairs.F, pairs.frame, begun)]
    data = Contacts(
        *(len(network.position), len(pairs.first), network.dimension),
        *(("dmt", "jkr").index(network.adhesion), network.law == "incremental", network.shear, network.adheres),
        *(network.friction, network.viscosity),
        -1.0 if network.restitution is None else sqrt(5) * damping_ratio(network.restitution),
        step,
        *map(loops.address, arrays),
    )
    data.arrays = arrays
    return data


def contact_loop(network: Network, state: State) -> Acting | None:
    """Return a function that computes forces and memory rates of contacts, or None without compiled loops.

    The function takes a motion (2f, N), the memory (d − 1, M), and two arrays into which it writes: forces and torques
    (f, N), and rates of the memory (d − 1, M). It returns dW/dt of `granular_analysis.theory.network_ledger`, and
    whether the motion is settled: no contact slides, has opened or closed, or is open with a slip to forget. It uses
    the pairs of `state`, and whether they touched there.
    """
    loop = loops.library()
    if loop is None:
        return None
    data = contacts_of(network, state.pairs, state.begun)

    def acting(motion: Floats, memory: Floats, load: Floats, memory_rate: Floats) -> tuple[float, bool]:
        changes = ctypes.c_ssize_t()
        places = map(loops.address, (motion, memory, load, memory_rate))
        work_rate = loop.touched(ctypes.byref(data), *places, ctypes.byref(changes))
        return float(work_rate), changes.value == 0

    return acting
