"""Steps of `granular_analysis.theory.network_verlet` in compiled loops: the fastest version on one core.

The loops use the formulas of the NumPy version, which is the reference, but sum in another order. On one machine the
motion is the same to the last bit, however a run is divided into calls.

When it breaks: without a C compiler (`granular_analysis.theory.loops`); `fastest_march` then returns the NumPy version.
"""

import ctypes
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from granular_analysis.theory import loops, network_verlet
from granular_analysis.theory.network import Network
from granular_analysis.theory.network_loop import contacts_of
from granular_analysis.theory.network_state import State
from granular_analysis.theory.network_verlet import Bodies, Carried, Moment, begun, motions, renewed, signals
from granular_analysis.theory.network_verlet import arrays_of as arrays_of
from granular_analysis.theory.network_verlet import extremes as extremes
from granular_analysis.theory.network_verlet import taken as taken

__all__ = ["march"]

Floats = NDArray[np.float64]
AT_ONCE = 10_000_000  # steps times pairs of one call, about 0.2 s; a run can be interrupted between calls


class _Bodies(ctypes.Structure):
    """`Bodies` of loops.c; `arrays` keeps alive the memory to which it points."""

    arrays: list[NDArray[Any]]
    _fields_ = [
        ("drives", ctypes.c_ssize_t),
        ("reach", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("mobility", "kept", "shares", "place", "component", "moves", "acts")),
    ]


class _Steps:
    """Steps of a network with the pairs of a state; it steps its own copy of the motion."""

    def __init__(self, network: Network, step: float, state: State, now: Carried) -> None:
        bodies, drives = Bodies.of(network, step), network.drives
        of_drives = [[each.component for each in drives], [each.moves for each in drives]]
        numbers = [bodies.mobility, bodies.kept, bodies.shares, state.pairs.place, *np.array(of_drives, np.intp)]
        arrays = [np.ascontiguousarray(each) for each in (*numbers, bodies.acts)]
        self.motion, self.memory, self.rates = (np.array(each) for each in (now.motion, now.memory, now.rates))
        self.begun, self.room = np.array(now.begun), np.empty_like(self.rates)
        self.contacts = contacts_of(network, state.pairs, self.begun, step)
        self.bodies = _Bodies(len(drives), network.margin / 4, *map(loops.address, arrays))
        self.bodies.arrays = arrays

    def step(self, values: Floats) -> int:
        """Make up to `count` steps with values (count, D, 2) of the drives, and return how many were made.

        The number is negative if the steps stopped because the pairs must be searched again.
        """
        loop = loops.library()
        assert loop is not None
        places = map(loops.address, (self.motion, self.memory, self.rates, self.room, values))
        return int(loop.verlet(ctypes.byref(self.contacts), ctypes.byref(self.bodies), *places, len(values)))

    @property
    def now(self) -> Carried:
        """Return a copy of what the next step needs."""
        motion, memory, rates = (tuple(np.array(each)) for each in (self.motion, self.memory, self.rates))
        return Carried(motion, memory, np.array(self.begun), rates)


def moments(
    network: Network, state: State, step: float, stops: Iterable[int], begin: Moment | None = None
) -> Iterator[Moment]:
    """Yield the motion as `granular_analysis.theory.network_verlet.moments` does."""
    done, state, now = begin or Moment(0, state, begun(network, state, Bodies.of(network, step)))
    steps = _Steps(network, step, state, now)
    for stop in stops:
        while done < stop:
            count = min(stop - done, 1 + AT_ONCE // (1 + len(state.pairs.first)))
            made = steps.step(np.ascontiguousarray(signals(network, step, done + 1, count)))
            done += abs(made)
            if made < 0:
                state, now = renewed(network, state, steps.now)
                steps = _Steps(network, step, state, now)
        yield Moment(stop, state, steps.now)


def march(network: Network, state: State, step: float, count: int, every: int) -> Iterator[Floats]:
    """Yield the motions (2f, N) as `granular_analysis.theory.network_verlet.march` does."""
    yield from motions(network, step, moments(network, state, step, range(0, count + 1, every)))


def fastest_march() -> Callable[[Network, State, float, int, int], Iterator[Floats]]:
    """Return `march`, or `granular_analysis.theory.network_verlet.march` if there is no C compiler."""
    return network_verlet.march if loops.library() is None else march
