"""Sums over large arrays and contacts: NumPy, or one pass in C where the machine has a compiler.

``loops.c`` is compiled by ``CC``, else ``cc``, when it is first asked for, into a folder of the user's cache, under a
name that its source, its flags and the machine give; a file that is damaged is compiled again. Without a compiler, or
in a folder that others may write to, all is NumPy, which is the reference: both give the same numbers, to the rounding
of sums in another order.

A sum of rows takes the loop from `LARGE` numbers on: below, a call of NumPy costs no more.

Large work is shared by `threads`: as many as the environment variable OMP_NUM_THREADS says, else as the process has
cores. Each takes parts that do not depend on their number, and sums of parts are added in the order of the parts, so
any number of threads gives the same bits.
"""

import ctypes
import logging
import os
import platform
import shutil
import subprocess
from functools import cache
from math import sqrt
from pathlib import Path
from threading import get_ident
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp import compiled

Array = NDArray[Any]  # floats or complex numbers
Floats = NDArray[np.float64]
SOURCE = Path(__file__).with_suffix(".c")
# Products are not fused with sums: all processors then give the same bits
FLAGS = ("-O3", "-fPIC", "-shared", "-pthread", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
LARGE = 1000  # numbers of a row
LANES, PART = 64, 16384  # as in loops.c
_BEGIN = ctypes.c_char * 0  # at the begin of an array, also of an empty one
SHARED = 8 * PART  # numbers from which on a thread more takes less time than to begin it


@cache
def library() -> ctypes.CDLL | None:
    """Return the loops, compiled if they were not; None where they cannot be, with a sentence in the log."""
    try:
        place = _place()
        if compiled.trouble(place):
            _compile(place)
        if why := compiled.trouble(place):
            raise OSError(why)
        return _typed(ctypes.CDLL(str(place)))
    except (OSError, RuntimeError, AttributeError, subprocess.SubprocessError) as trouble:  # no home, no POSIX, …
        logging.getLogger(__name__).info("loops are those of NumPy: %s", trouble)
        return None


def _typed(found: ctypes.CDLL) -> ctypes.CDLL:
    """Return the library with the types of its functions; raises AttributeError for one that lacks some."""
    pointer, number, size = ctypes.c_void_p, ctypes.c_double, ctypes.c_ssize_t
    found.weighted.argtypes = [size, size, size, pointer, pointer, size, pointer]
    found.errors.argtypes = [size, size, size, *[pointer] * 4]
    found.plane.argtypes = [size, *[pointer] * 6]
    found.plane_stages.argtypes = [size, pointer]
    found.touched.argtypes = [pointer] * 5
    for slope in (found.chain, found.chain_complex, found.torus, found.torus_complex):
        slope.argtypes = [pointer] * 3
    found.stepped.argtypes = [*[pointer] * 3, number, size]
    found.marched.argtypes = found.marched_complex.argtypes = [*[pointer] * 3, size, pointer, size, size]
    found.stages.argtypes = [*[size] * 4, *[pointer] * 5]
    names = (
        "weighted",
        "errors",
        "plane",
        "plane_stages",
        "chain",
        "chain_complex",
        "torus",
        "torus_complex",
        "stages",
        "stepped",
        "marched",
        "marched_complex",
    )
    for name in names:
        getattr(found, name).restype = None
    found.touched.restype = number
    return found


def _place() -> Path:
    """Return where the compiled loops lie, or will lie."""
    made_of = [SOURCE.read_bytes(), " ".join((platform.system(), platform.machine(), *FLAGS)).encode()]
    return compiled.place("granular-analysis", "loops", "loops.so", made_of)


def _compile(place: Path) -> None:
    """Compile the loops; several processes and threads may do so at once."""
    compiler = shutil.which(os.environ.get("CC", "cc"))
    if compiler is None:
        raise OSError("there is no C compiler on the PATH, or in CC")
    compiled.make_folders(place)
    if why := compiled.foreign(place):
        raise OSError(why)
    part = place.with_name(f"{os.getpid()}-{get_ident()}.so")
    try:
        subprocess.run([compiler, *FLAGS, SOURCE, "-lm", "-o", part], check=True, capture_output=True)
        compiled.seal(part)
        part.replace(place)
    finally:
        part.unlink(missing_ok=True)


def threads(numbers: int) -> int:
    """Return how many threads share work on so many numbers."""
    if numbers < SHARED:
        return 1
    wanted = os.environ.get("OMP_NUM_THREADS", "").partition(",")[0].strip()
    if wanted.isdecimal() and int(wanted) > 0:
        return int(wanted)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def address(array: Array) -> int:
    """Return where the numbers of a contiguous array lie, by its buffer, in a third of the time of `ctypes`."""
    view = array.data
    return array.ctypes.data if view.readonly else ctypes.addressof(_BEGIN.from_buffer(view))


class Tolerance(ctypes.Structure):
    """`Tolerance` of loops.c."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("begin", "after", "atol")),
        ("each", ctypes.c_ssize_t),
        ("rtol", ctypes.c_double),
    ]


def tolerance(begin: Array, after: Array, rtol: float, sizes: Floats) -> Tolerance:
    """Return the tolerance of a step between two states; sizes () are of all numbers, or (n,) of each."""
    return Tolerance(*map(address, (begin, after, sizes)), sizes.ndim, rtol)


class Slope:
    """A slope that is one of the loops, and the data that it takes, whose arrays live as long."""

    def __init__(self, function: Any, data: ctypes.Structure, arrays: tuple[Floats, ...]) -> None:
        self.function, self.data, self._arrays = function, data, arrays

    def __call__(self, time: float, state: Floats, out: Floats) -> None:
        self.function(ctypes.byref(self.data), address(state), address(out))

    def stages(self, first: int, last: int, weights: Floats, stack: Floats, trial: Floats) -> None:
        """Fill the slopes `first` to `last` in the rows of a stack behind its state; see `integrator.Step`."""
        loop = library()
        assert loop is not None
        sizes = trial.view(np.float64).size, first, last, weights.shape[1]
        loop.stages(*sizes, *map(address, (weights, stack, trial)), self.function, ctypes.addressof(self.data))

    def stepped(self, state: Floats, step: float, count: int) -> None:
        """Make steps of velocity Verlet in a state of the lattice; see `timestep.verlet`."""
        loop, rate = library(), np.empty_like(state)
        assert loop is not None
        loop.stepped(ctypes.addressof(self.data), address(state), address(rate), step, count)

    def marched(self, state: Array, rate: Array, halves: Floats, count: int) -> None:
        """Make steps in the states (..., 2, n) of chains, whose rates are those of now; see `chain_motion.march`."""
        loop, chains = library(), state.size // (2 * state.shape[-1])
        assert loop is not None
        places = map(address, (state, rate))
        marched = loop.marched if state.dtype == float else loop.marched_complex
        marched(ctypes.addressof(self.data), *places, chains, address(halves), len(halves), count)


def weighted(weights: Floats, rows: Floats, out: Floats) -> None:
    """Write Σ_r weights[p, r] rows[r] (P, n) of the first rows of (S, n), by weights (P, R), into `out`."""
    (count, used), size = weights.shape, out.shape[1]
    loop = library() if size > LARGE else None
    if loop is None:
        np.einsum("pi,ij->pj", weights, rows[:used], out=out)
        return
    for each in range(count):
        places = address(weights[each]), address(rows[0]), rows.strides[0] // rows.itemsize, address(out[each])
        loop.weighted(threads(size), size, used, *places)


def errors(
    weights: Floats, slopes: Array, begin: Array, after: Array, rtol: float, atol: Floats | float
) -> tuple[float, float]:
    """Return the root mean squares of Σ_r weights[e][r] slopes[r] over atol + rtol max(|begin|, |after|), e = 0, 1."""
    loop = library() if begin.dtype == float else None
    if loop is None:
        scale = atol + rtol * np.maximum(np.abs(begin), np.abs(after))
        rows = slopes[: weights.shape[1]].reshape(weights.shape[1], -1).view(np.float64)
        both = np.einsum("ki,ij->kj", weights, rows).view(slopes.dtype).reshape(2, *begin.shape) / scale
        return norm(both[0]), norm(both[1])
    squares, sizes = np.empty((-(-begin.size // PART), 2)), np.asarray(atol, dtype=np.float64)
    allowed = tolerance(begin, after, rtol, sizes)
    places = address(weights), address(slopes), ctypes.addressof(allowed), address(squares)
    loop.errors(threads(begin.size), begin.size, weights.shape[1], *places)
    fifth, third = squares.sum(axis=0) / begin.size
    return sqrt(fifth), sqrt(third)


def norm(values: Array) -> float:
    """Return the root mean square of numbers, real or complex."""
    numbers = values.reshape(-1).view(np.float64)
    return sqrt(np.einsum("i,i", numbers, numbers) / values.size)
