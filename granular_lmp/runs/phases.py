"""Wall time of the phases of a run, in seconds.

``with phase("build"): ...`` times work for every `collected` that is open around it in the same thread. The time of an
inner phase is subtracted from the outer phase, so phases never overlap and their times add up.
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
    """Yield a dict, name → seconds, of the phases that end in this context and thread."""
    seconds: Seconds = {}
    token = _collectors.set((*_collectors.get(), seconds))
    try:
        yield seconds
    finally:
        _collectors.reset(token)


@contextmanager
def phase(name: str) -> Iterator[None]:
    """Time the work in this context, without inner phases, as a phase of this name; equal names add up."""
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
    """Move seconds from a finished phase to its parts, which another clock has timed."""
    for seconds in _collectors.get():
        seconds[name] = seconds.get(name, 0.0) - sum(parts.values())
        for part, spent in parts.items():
            seconds[part] = seconds.get(part, 0.0) + spent
