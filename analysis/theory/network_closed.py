"""Contacts of a network in the plane that stay closed and do not slide, in one pass of
`granular_analysis.theory.loops`.

The laws are those of `granular_analysis.theory.network_state.contacts`, which is the reference, and to which all else
is left: other laws, networks in space, and moments at which a contact slides, or is open and has yet to forget its
slip.
"""

import ctypes
import logging
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory import loops
from granular_analysis.theory.network import Network
from granular_analysis.theory.network_state import BLOCK, Pairs, leaving

Floats = NDArray[np.float64]


class Sums(NamedTuple):
    """Over all contacts: dW/dt of the ledger, and the energies of their normal and of their shear forces."""

    work_rate: float
    normal: float
    shear: float


NUMBERS = 7  # a pair has


class _Pairs(ctypes.Structure):
    """`Pairs` of loops.c."""

    _fields_ = [
        *((name, ctypes.c_ssize_t) for name in ("spheres", "pairs", "blocks", "width")),
        ("friction", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("starts", "first", "second")),
        ("numbers", ctypes.c_void_p * NUMBERS),
        ("same", ctypes.c_ssize_t * NUMBERS),
        *((name, ctypes.c_void_p) for name in ("radius", "outside")),
    ]


def refusal(network: Network) -> str:
    """Return why the contacts of a network are not those of this module, or ""."""
    for here, why in (
        (network.dimension == 2, "the spheres move in space"),
        (network.adhesion == "dmt", "the adhesion law is that of JKR"),
        (network.law == "secant", "the shear law is the incremental one"),
        (not network.viscosity and network.restitution is None, "contacts have dashpots"),
    ):
        if not here:
            return why
    return ""


class ClosedPairs:
    """The pairs of a network as the compiled loop takes them."""

    def __init__(self, loop: ctypes.CDLL, network: Network, pairs: Pairs) -> None:
        spheres, blocks = len(network.position), -(-len(network.position) // BLOCK)
        parts = 2 * (pairs.first // BLOCK) + leaving(pairs.first, pairs.second)
        starts = np.searchsorted(np.where(pairs.second < spheres, parts, 2 * blocks), np.arange(2 * blocks + 1))
        first, second = (each.astype(np.int32) for each in (pairs.first, pairs.second))
        each_pair = [*pairs.apart, pairs.length, pairs.overlap, pairs.A, pairs.B, pairs.F]
        same = [len(each) > 0 and bool(np.all(each == each[0])) for each in each_pair]
        numbers = [
            np.full(loops.LANES, each[0]) if one else np.ascontiguousarray(each)
            for each, one in zip(each_pair, same, strict=True)
        ]
        outside, radius = np.empty((3, len(first))), np.ascontiguousarray(network.radius)
        arrays: tuple[loops.Array, ...] = (starts, first, second, radius, outside, *numbers)
        self._arrays = arrays  # they live as long as what points to them
        *ends, sizes_at, loads_at = (loops.address(each) for each in arrays[:5])
        pointers = (ctypes.c_void_p * NUMBERS)(*map(loops.address, numbers))
        flags = (ctypes.c_ssize_t * NUMBERS)(*same)
        sizes = spheres, len(first), blocks, BLOCK
        self._pairs = _Pairs(*sizes, network.friction, *ends, pointers, flags, sizes_at, loads_at)
        self._loop, self._sums = loop, np.empty((blocks + 1, 4))

    def acting(self, motion: Floats, slip: Floats, load: Floats, slip_rate: Floats) -> Sums | None:
        """Write forces and torques (3, N) and the rates of slips (1, M) of a motion; None if the forces are others."""
        places = map(loops.address, (motion, slip, load, slip_rate, self._sums))
        self._loop.plane(loops.threads(motion.size + slip.size), ctypes.byref(self._pairs), *places)
        *found, otherwise = self._sums.sum(axis=0).tolist()
        return None if otherwise else Sums(*found)

    def sums(self, motion: Floats, slip: Floats) -> Sums | None:
        """Return the sums of a motion; None if its forces are others."""
        return self.acting(motion, slip, np.empty_like(motion[: len(motion) // 2]), np.empty_like(slip))


def closed_pairs(network: Network, pairs: Pairs) -> ClosedPairs | None:
    """Return the pairs of a network for the compiled loop, or None, with a sentence in the log, where it holds none."""
    loop, why = loops.library(), refusal(network)
    if loop is None or why:
        logging.getLogger(__name__).info("contacts are summed by NumPy: %s", why or "there is no compiled loop")
        return None
    return ClosedPairs(loop, network, pairs)
