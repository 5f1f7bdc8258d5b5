"""The amplitude at which contacts begin to open, or to slide, from runs over the amplitude of a wave.

Contacts do not slide in these runs, so that neither event changes the motion before it happens. An event lies between
the last run without it and the first one with it. Whether contacts opened is all that a run says of opening: the middle
of the interval is the result, and its half the error. The smallest overlap does not help, as it falls by jumps when
another contact, or another time, becomes the extreme. Of sliding a run measures the largest ratio s of the shear force
to the sliding force of the same contact, before the event and after it, and the result is read off the parabola of
1 − s through the three nearest runs; its error is the difference to the straight line through the two nearest.

The linear rule is that by which the scenes were judged, read off the same runs (``run.json``).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from granular_analysis.measure.runs import all_but
from granular_lmp.runs.record import Record

Event = Literal["opening", "sliding"]
EFFECTS: dict[Event, tuple[str, str]] = {
    "opening": ("contact_opening", "open_contacts"),
    "sliding": ("sliding", "largest_slip"),
}


@dataclass(frozen=True)
class Onset:
    """Amplitude D0/Δ0 at which an event begins, its error, and that by the linear rule, nan beyond all runs."""

    amplitude: float
    error: float
    linear: float


def onset(records: Sequence[Record], event: Event) -> Onset | None:
    """Return where an event begins in runs that differ in the amplitude alone; None where no run reached it.

    Raises
    ------
    ValueError
        If contacts slide in a run or bear no shear, runs differ in more or have one amplitude, or the first has the
        event already.
    """
    ordered = sorted(records, key=lambda record: record.scene.amplitude)
    amplitudes = np.array([record.scene.amplitude for record in ordered])
    if np.any(np.diff(amplitudes) == 0):
        raise ValueError(f"{ordered[0].folder}: two runs have one amplitude; they must differ in the amplitude alone")
    if len({repr(all_but(record, "wave.amplitude")) for record in ordered}) > 1:
        raise ValueError(f"{ordered[0].folder}: the runs must differ in wave.amplitude alone")
    happened, left, rule = np.array([_margins(record, event) for record in ordered]).T
    try:
        found = crossing(amplitudes, left, happened > 0)
        linear = crossing(amplitudes, rule, rule <= 0)
    except ValueError as error:
        raise ValueError(f"{ordered[0].folder}: {error}") from error
    return None if found is None else Onset(*found, linear[0] if linear else np.nan)


def _margins(record: Record, event: Event) -> tuple[bool, float, float]:
    """Return whether the event happened, 1 − s, and what is left of the weakest contact by the linear rule.

    1 − s is nan for opening, and where an upper bound of s was enough to exclude sliding.
    """
    if record.info["effects"]["sliding"]["on"]:
        raise ValueError(f"{record.folder}: effects.sliding = true: must be false; contacts that slide hide it")
    name, title = EFFECTS[event]
    effect, guard = record.info["effects"][name], record.info["guards"].get(title)
    if guard is None:
        raise ValueError(f"{record.folder}: effects.shear is off; without shear nothing slides")
    number = np.inf if effect["number"] is None else effect["number"]
    happened = guard["passed_at"] is not None
    if event == "sliding":
        exact = guard["value"] is not None and guard["bound"] > guard["limit"]
        return happened, 1 - guard["value"] if exact else np.nan, 1 - number
    return happened, np.nan, -number if effect["called_for"] else number


def crossing(amplitudes: ArrayLike, left: ArrayLike, happened: ArrayLike) -> tuple[float, float] | None:
    """Return the amplitude at which a falling quantity is 0, with its error; None where the event never happened.

    Parameters
    ----------
    amplitudes : (n,), ascending.
    left : (n,) values, nan or infinite where unknown.
    happened : (n,) booleans; the event is between the last False before the first True, and that.

    Raises
    ------
    ValueError
        If the first amplitude has the event.
    """
    a, y, after = np.asarray(amplitudes, float), np.asarray(left, float), np.asarray(happened, bool)
    if not after.any():
        return None
    first = int(np.argmax(after))
    if first == 0:
        raise ValueError(f"wave.amplitude = {a[0]:g} has the event already; must be smaller in the first run")
    low, high = a[first - 1], a[first]
    near = [i for i in sorted(range(len(a)), key=lambda i: abs(i - (first - 0.5))) if np.isfinite(y[i])][:3]
    if len(near) == 3:
        # The amplitude as a parabola of the value, which has one crossing where the value as a parabola may have two
        x, z = a[near], y[near]
        straight = x[0] - z[0] * (x[1] - x[0]) / (z[1] - z[0])
        curved = sum(x[i] * np.prod([z[j] / (z[j] - z[i]) for j in range(3) if j != i]) for i in range(3))
        if low <= curved <= high:
            return float(curved), float(abs(curved - straight))
    return float((low + high) / 2), float((high - low) / 2)
