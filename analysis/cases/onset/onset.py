"""Amplitude at which contacts begin to open or to slide, from runs over the amplitude of a wave.

Contacts do not slide in these runs, so neither event changes the motion before it happens. An event lies between the
last run without it and the first run with it. For opening, a run only tells whether contacts opened: the result is the
middle of the interval, its error half the interval. (The smallest overlap does not help, because it jumps when another
contact or another time becomes the extreme.) For sliding, a run measures the largest ratio s of the shear force to the
sliding force of the same contact, before and after the event. The result is the zero of a parabola of 1 − s through the
three nearest runs; its error is the difference from the straight line through the two nearest.

The linear rule is the one that judged the scenes; it is read from the same runs (``run.json``).
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
    """Amplitude D0/Δ0 at which an event begins, its error, and the linear rule's amplitude, nan beyond all runs."""

    amplitude: float
    error: float
    linear: float


def onset(records: Sequence[Record], event: Event) -> Onset | None:
    """Return the onset of an event in runs that differ only in the amplitude; None if no run reached the event.

    Raises
    ------
    ValueError
        If contacts slide in a run or have no shear force, if runs differ in more than the amplitude or two have the
        same, or if the first run has the event already.
    """
    ordered = sorted(records, key=lambda record: record.scene.amplitude)
    amplitudes = np.array([record.scene.amplitude for record in ordered])
    if np.any(np.diff(amplitudes) == 0):
        raise ValueError(f"{ordered[0].folder}: two runs have the same wave.amplitude; each run needs its own")
    if len({repr(all_but(record, "wave.amplitude")) for record in ordered}) > 1:
        raise ValueError(f"{ordered[0].folder}: the runs must differ only in wave.amplitude")
    happened, left, rule = np.array([_margins(record, event) for record in ordered]).T
    try:
        found = crossing(amplitudes, left, happened > 0)
        linear = crossing(amplitudes, rule, rule <= 0)
    except ValueError as error:
        raise ValueError(f"{ordered[0].folder}: {error}") from error
    return None if found is None else Onset(*found, linear[0] if linear else np.nan)


def _margins(record: Record, event: Event) -> tuple[bool, float, float]:
    """Return whether the event happened, 1 − s, and the margin of the weakest contact by the linear rule.

    1 − s is nan for opening, and if an upper bound of s was enough to exclude sliding.
    """
    if record.info["effects"]["sliding"]["on"]:
        raise ValueError(f"{record.folder}: effects.sliding = true: must be false, as sliding contacts hide the onset")
    name, title = EFFECTS[event]
    effect, guard = record.info["effects"][name], record.info["guards"].get(title)
    if guard is None:
        raise ValueError(f"{record.folder}: effects.shear is off; without shear no contact slides")
    number = np.inf if effect["number"] is None else effect["number"]
    happened = guard["passed_at"] is not None
    if event == "sliding":
        exact = guard["value"] is not None and guard["bound"] > guard["limit"]
        return happened, 1 - guard["value"] if exact else np.nan, 1 - number
    return happened, np.nan, -number if effect["called_for"] else number


def crossing(amplitudes: ArrayLike, left: ArrayLike, happened: ArrayLike) -> tuple[float, float] | None:
    """Return the amplitude at which a falling quantity is 0, with its error; None if the event never happened.

    Parameters
    ----------
    amplitudes : (n,), ascending.
    left : (n,) values of the quantity, nan or infinite if unknown.
    happened : (n,) booleans; the event lies between the first True and the amplitude before it.

    Raises
    ------
    ValueError
        If the event has happened at the first amplitude.
    """
    a, y, after = np.asarray(amplitudes, float), np.asarray(left, float), np.asarray(happened, bool)
    if not after.any():
        return None
    first = int(np.argmax(after))
    if first == 0:
        raise ValueError(f"wave.amplitude = {a[0]:g}: is beyond the onset already; must be smaller in the first run")
    low, high = a[first - 1], a[first]
    near = [i for i in sorted(range(len(a)), key=lambda i: abs(i - (first - 0.5))) if np.isfinite(y[i])][:3]
    if len(near) == 3:
        # The amplitude is a parabola of the value, with one crossing; the inverse could have two
        x, z = a[near], y[near]
        straight = x[0] - z[0] * (x[1] - x[0]) / (z[1] - z[0])
        curved = sum(x[i] * np.prod([z[j] / (z[j] - z[i]) for j in range(3) if j != i]) for i in range(3))
        if low <= curved <= high:
            return float(curved), float(abs(curved - straight))
    return float((low + high) / 2), float((high - low) / 2)
