"""Time derivatives of states in one pass in C, in place of dozens of NumPy calls, if the machine has a C compiler.

The first use compiles ``loops.c`` with the compiler in ``CC``, else ``cc``, into a folder of the user's cache, whose
name has a hash of the source, the flags and the machine; a damaged file is compiled again. Without a compiler, or if
others may write to the folder, NumPy computes everything. NumPy is the reference: both give the same numbers, up to the
rounding of sums in another order.
"""

import ctypes
import logging
import os
import platform
import shutil
import subprocess
from functools import cache
from pathlib import Path
from threading import get_ident
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp import compiled

Array = NDArray[Any]  # floats or complex numbers
Floats = NDArray[np.float64]
SOURCE = Path(__file__).with_suffix(".c")
# Without fused multiply-adds, all processors give the same bits
FLAGS = ("-O3", "-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
_BEGIN = ctypes.c_char * 0  # length 0, so it fits at the start of an empty array too


@cache
def library() -> ctypes.CDLL | None:
    """Return the loops, compiled if need be; None if they cannot be compiled, with the reason in the log."""
    try:
        place = _place()
        if compiled.trouble(place):
            _compile(place)
        if why := compiled.trouble(place):
            raise OSError(why)
        return _typed(ctypes.CDLL(str(place)))
    except (OSError, RuntimeError, AttributeError, subprocess.SubprocessError) as trouble:  # no home, no POSIX, …
        logging.getLogger(__name__).info("NumPy computes all loops: %s", trouble)
        return None


def _typed(found: ctypes.CDLL) -> ctypes.CDLL:
    """Return the library with the types of its functions; raise AttributeError if a function is missing."""
    pointer, size = ctypes.c_void_p, ctypes.c_ssize_t
    found.touched.argtypes = [pointer] * 6
    found.verlet.argtypes = [*[pointer] * 7, size]
    found.verlet.restype = size
    for slope in (found.chain, found.chain_complex, found.torus, found.torus_complex):
        slope.argtypes = [pointer] * 3
    found.stepped.argtypes = [*[pointer] * 3, ctypes.c_double, size]
    found.marched.argtypes = found.marched_complex.argtypes = [*[pointer] * 3, size, pointer, size, size]
    for name in ("chain", "chain_complex", "torus", "torus_complex", "stepped", "marched", "marched_complex"):
        getattr(found, name).restype = None
    found.touched.restype = ctypes.c_double
    return found


def _place() -> Path:
    """Return the path of the compiled loops, whether they exist or not."""
    made_of = [SOURCE.read_bytes(), " ".join((platform.system(), platform.machine(), *FLAGS)).encode()]
    return compiled.place("granular-analysis", "loops", "loops.so", made_of)


def _compile(place: Path) -> None:
    """Compile the loops; several processes and threads may do this at the same time."""
    compiler = shutil.which(os.environ.get("CC", "cc"))
    if compiler is None:
        raise OSError("no C compiler on the PATH or in CC")
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


def address(array: Array) -> int:
    """Return the address of the numbers of a contiguous array, in a third of the time of ``array.ctypes``."""
    view = array.data
    return array.ctypes.data if view.readonly else ctypes.addressof(_BEGIN.from_buffer(view))


class Slope:
    """Time derivative of a state, computed by one of the loops.

    Parameters
    ----------
    function : the loop.
    data : its constants; they hold addresses.
    arrays : arrays at these addresses, kept alive with the slope.
    """

    def __init__(self, function: Any, data: ctypes.Structure, arrays: tuple[Floats, ...]) -> None:
        self.function, self.data, self._arrays = function, data, arrays

    def __call__(self, state: Array) -> Array:
        """Return the time derivative of a state."""
        out = np.empty_like(state)
        self.function(ctypes.byref(self.data), address(state), address(out))
        return out

    def stepped(self, state: Floats, step: float, count: int) -> None:
        """Make steps of velocity Verlet in place in a state of the lattice, for tests."""
        loop, rate = library(), np.empty_like(state)
        assert loop is not None
        loop.stepped(ctypes.addressof(self.data), address(state), address(rate), step, count)

    def marched(self, state: Array, rate: Array, halves: Floats, count: int) -> None:
        """Make steps in place in states (..., 2, n) of chains with their present rates; see `chain_motion.march`."""
        loop, chains = library(), state.size // (2 * state.shape[-1])
        assert loop is not None
        places = map(address, (state, rate))
        marched = loop.marched if state.dtype == float else loop.marched_complex
        marched(ctypes.addressof(self.data), *places, chains, address(halves), len(halves), count)
