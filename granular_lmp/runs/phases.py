"""Where the time of a run goes: seconds of wall time by phase.

Work is timed where it is done, ``with phase("build"): ...``, for every `collected` that is open around it in the same
thread. A phase inside another takes its seconds from the outer one, so phases never overlap and their sum is the time
that they account for.
"""

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar

Seconds = dict[str, float]

_collectors: ContextVar[tuple[Seconds, ...]] = ContextVar("collectors", default=())
_inner: ContextVar[list[float] | None] = ContextVar("inner", default=None)  # seconds inside the phase that is open


@contextmanager
def collected() -> Iterator[Seconds]:
    """Yield a dict that holds, name → seconds, the phases that end while this context is open in this thread."""
    seconds: Seconds = {}
    token = _collectors.set((*_collectors.get(), seconds))
    try:
        yield seconds
    finally:
        _collectors.reset(token)


@contextmanager
def phase(name: str) -> Iterator[None]:
    """Time the work in this context, less the phases inside it, as a phase of this name; equal names add up."""
    outer, within = _inner.get(), [0.0]
    token = _inner.set(within)
    started = time.perf_counter()
    try:
        yield
    finally:
        spent = time.perf_counter() - started
        _inner.reset(token)
        if outer is not None:
            outer[0] += spent
        for seconds in _collectors.get():
            seconds[name] = seconds.get(name, 0.0) + spent - within[0]


def split(name: str, parts: Mapping[str, float]) -> None:
    """Move seconds from a phase that has ended to its parts, which something other than this clock has timed."""
    for seconds in _collectors.get():
        seconds[name] = seconds.get(name, 0.0) - sum(parts.values())
        for part, spent in parts.items():
            seconds[part] = seconds.get(part, 0.0) + spent
