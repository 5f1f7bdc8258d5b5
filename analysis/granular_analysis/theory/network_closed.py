"""Contacts of a network in the plane that stay closed and do not slide, in one pass of
`granular_analysis.theory.loops`.

The laws are those of `granular_analysis.theory.network_state.contacts`, which is the reference. All else is left to it
or to `granular_analysis.theory.network_loop`: other laws, networks in space, and moments at which a contact slides, or
is open and has yet to forget its slip.
"""

import ctypes
import logging
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory import loops
from granular_analysis.theory.integrator import ROWS, STAGES, Step, of_places, tableau
from granular_analysis.theory.network import Network
from granular_analysis.theory.network_state import BLOCK, Pairs

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]


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
        *((name, ctypes.c_void_p) for name in ("bundles", "own", "others", "met", "first", "second", "run")),
        ("numbers", ctypes.c_void_p * NUMBERS),
        ("same", ctypes.c_ssize_t * NUMBERS),
        *((name, ctypes.c_void_p) for name in ("radius", "outside", "done")),
    ]


class _Stages(ctypes.Structure):
    """`Stages` of loops.c."""

    _fields_ = [
        ("pairs", ctypes.c_void_p),
        *((name, ctypes.c_ssize_t) for name in ("first", "last", "n")),
        *((name, ctypes.c_void_p) for name in ("weights", "places", "mobility", "drag", "stack", "trial", "renewed")),
        ("tolerance", loops.Tolerance),
        *((name, ctypes.c_void_p) for name in ("errors", "errors_of_places", "sums", "squares")),
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
        first, second = (each.astype(np.int32) for each in (pairs.first, pairs.second))
        each_pair = [*pairs.apart, pairs.length, pairs.overlap, pairs.A, pairs.B, pairs.F]
        same = [len(each) > 0 and bool(np.all(each == each[0])) for each in each_pair]
        numbers = [
            np.full(loops.LANES, each[0]) if one else np.ascontiguousarray(each)
            for each, one in zip(each_pair, same, strict=True)
        ]
        radius, outside = np.ascontiguousarray(network.radius), np.empty((3, len(first)))
        shared: tuple[loops.Array, ...] = (radius, outside, np.empty(blocks, np.int32))
        self._mobility = np.ascontiguousarray(network.mobility)
        self._drag = None if network.drag is None else np.ascontiguousarray(network.drag)
        ends: tuple[loops.Array, ...] = (*bundles(pairs, spheres, blocks), first, second, runs(first, second))
        self._arrays = (*ends, *numbers, *shared)  # they live as long as what points to them
        pointers = (ctypes.c_void_p * NUMBERS)(*map(loops.address, numbers))
        flags = (ctypes.c_ssize_t * NUMBERS)(*same)
        sizes = spheres, len(first), blocks, BLOCK
        self._pairs = _Pairs(
            *sizes, network.friction, *map(loops.address, ends), pointers, flags, *map(loops.address, shared)
        )
        self._loop, self.blocks = loop, blocks

    def acting(self, motion: Floats, slip: Floats, load: Floats, slip_rate: Floats) -> Sums | None:
        """Write forces and torques (3, N) and the rates of slips (1, M) of a motion; None if the forces are others."""
        sums = np.empty((self.blocks, 4))
        places = map(loops.address, (motion, slip, load, slip_rate, sums))
        self._loop.plane(loops.threads(motion.size + slip.size), ctypes.byref(self._pairs), *places)
        *found, otherwise = sums.sum(axis=0).tolist()
        return None if otherwise else Sums(*found)

    def sums(self, motion: Floats, slip: Floats) -> Sums | None:
        """Return the sums of a motion; None if its forces are others."""
        return self.acting(motion, slip, np.empty_like(motion[: len(motion) // 2]), np.empty_like(slip))

    def stages(
        self, step: Step, first: int, last: int, length: float, tolerance: tuple[float, Floats | float] | None
    ) -> tuple[float, float] | None:
        """Fill the slopes of a step as `integrator.Fused` does; None if the forces of a stage are others."""
        numbers, table, work = step.numbers, tableau(), slice(len(step.begin) - 1, None)
        if step.ended:
            step.begin[work], step.slopes[0, work] = step.after[work], step.slopes[STAGES, work]
        weights = np.concatenate([np.ones((ROWS, 1)), length * table.stages], axis=1)
        rtol, sizes = (0.0, np.zeros(())) if tolerance is None else (tolerance[0], np.asarray(tolerance[1], float))
        sums, squares = np.empty((last - first + 1, self.blocks, 4)), np.zeros((self.blocks, 2))
        tables = weights, of_places(weights[:, 1:], length), self._mobility
        errors = table.errors, of_places(table.errors, length)
        data = _Stages(
            *(ctypes.addressof(self._pairs), first, last, numbers.shape[1]),
            *map(loops.address, tables),
            None if self._drag is None else loops.address(self._drag),
            *map(loops.address, (step.stack, step.trial)),
            loops.address(step.after) if step.ended else None,
            loops.tolerance(step.begin, step.trial, rtol, sizes),
            *map(loops.address, (*errors, sums)),
            None if tolerance is None else loops.address(squares),
        )
        self._loop.plane_stages(loops.threads(numbers.shape[1]), ctypes.byref(data))
        rates, _, _, otherwise = np.moveaxis(sums.sum(axis=1), 1, 0)
        step.slopes[first : last + 1, -1] = rates
        step.trial[-1] = (weights[last, : last + 1] * numbers[: last + 1, -1]).sum()
        step.ended, step.lean = False, True
        fifth, third = squares.sum(axis=0) / numbers.shape[1]
        return None if np.any(otherwise) else (sqrt(fifth), sqrt(third))


def runs(first: loops.Array, second: loops.Array) -> loops.Array:
    """Return how many pairs from each on are of spheres i, i + 1, … and j, j + 1, …, (M,)."""
    breaks = np.flatnonzero((np.diff(first) != 1) | (np.diff(second) != 1)) + 1
    ends = np.append(breaks, len(first))
    return (np.repeat(ends, np.diff(ends, prepend=0)) - np.arange(len(first))).astype(np.int32)


def bundles(pairs: Pairs, spheres: int, blocks: int) -> tuple[Integers, ...]:
    """Return the bundles (K, 4) of pairs, where those of each block and those that meet it begin, and the latter."""
    ends = pairs.first // BLOCK, np.where(pairs.second < spheres, pairs.second // BLOCK, blocks)
    change = np.any(np.diff(ends, axis=1) != 0, axis=0)
    from_ = np.flatnonzero(np.concatenate([[True], change])) if len(pairs.first) else np.empty(0, np.intp)
    table = np.stack(
        [*(each[from_] for each in ends), from_, np.append(from_[1:], len(pairs.first))[: len(from_)]], axis=1
    )
    table = table[np.argsort(table[:, 0], kind="stable")]
    leaving = np.flatnonzero((table[:, 0] != table[:, 1]) & (table[:, 1] < blocks))
    met = leaving[np.argsort(table[leaving, 1], kind="stable")]
    numbered = np.arange(blocks + 1)
    return table, np.searchsorted(table[:, 0], numbered), np.searchsorted(table[met, 1], numbered), met


def closed_pairs(network: Network, pairs: Pairs) -> ClosedPairs | None:
    """Return the pairs of a network for the compiled loop, or None, with a sentence in the log, where it holds none."""
    loop, why = loops.library(), refusal(network)
    if loop is None or why:
        logging.getLogger(__name__).info("stages of a step are made one by one: %s", why or "there is no compiled loop")
        return None
    return ClosedPairs(loop, network, pairs)
