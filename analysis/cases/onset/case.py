"""Limits of the paper's wave: amplitudes at which contacts open or slide, and the second harmonic beyond them.

    granular-analysis onset SWEEP... [-o FILE]

Each SWEEP is the folder of a sweep (``granular-lmp sweep``) with ``effects.contact_opening = true``; ``make onset``
makes them. Runs without sliding, over the amplitude and any of wave number, Poisson's ratio and form, give the onsets
(`cases.onset.onset`), and for one wave the second harmonic over the amplitude. Runs with sliding, over the friction,
give the last panel.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cases.onset.onset import Event, Onset, onset
from cases.runner import script
from granular_analysis.measure.runs import all_but
from granular_analysis.plotting import SILICA, legend_above, page
from granular_lmp.runs.record import Record

MARKERS = {"running": ("o", 4), "standing": ("s", 6), "pulse": ("^", 8)}  # marker and its size in points
COLOURS = ("C0", "black", "C1", "C2", "C3")  # by Poisson's ratio
SHOWN = 0.8  # the second harmonic is drawn for the running wave whose wave number is nearest to this


@dataclass(frozen=True)
class Point:
    """Onsets of one wave: its form, Poisson's ratio and wave number, and the onset of each event."""

    form: str
    poisson_ratio: float
    wavenumber: float
    opening: Onset | None
    sliding: Onset | None


Measured = tuple[Sequence[Record], Sequence[Point]]  # all runs, and the onsets in the runs without sliding


def form_of(record: Record) -> str:
    """Return the form of a wave: running, standing, or a pulse."""
    return "pulse" if record.scene.envelope.finite else record.scene.form.name


def waves(records: Sequence[Record]) -> dict[tuple[str, float, float], list[Record]]:
    """Return the runs without sliding by form, Poisson's ratio and wave number, each by amplitude."""
    groups: dict[tuple[str, float, float], list[Record]] = defaultdict(list)
    for record in sorted(records, key=lambda each: each.scene.amplitude):
        if not record.info["effects"]["sliding"]["on"]:
            groups[form_of(record), record.scene.sphere.poisson_ratio, record.scene.wavenumber].append(record)
    return dict(sorted(groups.items()))


def points(records: Sequence[Record]) -> list[Point]:
    """Return the onsets of all waves of the runs."""
    return [Point(*wave, onset(runs, "opening"), onset(runs, "sliding")) for wave, runs in waves(records).items()]


def table(runs: Measured) -> str:
    """Return a line for each wave: its onsets, measured and by the linear rule."""
    _, found = runs
    lines = [f"{'form':9}{'nu':>6}{'xi':>8}" + f"{'opens at a':>22}{'rule':>8}" + f"{'slides at a':>22}{'rule':>8}"]
    for each in found:
        line = f"{each.form:9}{each.poisson_ratio:6g}{each.wavenumber:8.4f}"
        for event in (each.opening, each.sliding):
            if event is None:
                line += f"{'not reached':>22}{'':8}"
            else:
                line += f"{event.amplitude:12.4f} ±{event.error:8.1e}{event.linear:8.3f}"
        lines.append(line)
    return "\n".join(lines)


def draw(runs: Measured) -> Figure:
    """Return the figure: onset of opening, onset of sliding, second harmonic over amplitude, and wave over friction.

    Raises ValueError for different frictions in the runs without sliding, and for runs with sliding that differ in more
    than the friction.
    """
    records, found = runs
    figure = page(6.2)
    (opens, slides), (beyond, rubbed) = figure.subplots(2, 2)
    _map(opens, found, "opening", "(a) contacts open")
    frictions = sorted({run.scene.effects.friction for own in waves(records).values() for run in own})
    if len(frictions) > 1:
        raise ValueError(f"effects.friction = {frictions}: must be equal in the runs without sliding")
    _map(slides, found, "sliding", f"(b) contacts slide, friction {frictions[0]:g}")
    _beyond(beyond, records)
    _frictions(rubbed, records)
    figure.legend(*opens.get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def _map(axes: Axes, found: Sequence[Point], event: Event, title: str) -> None:
    for ratio, colour in zip(sorted({each.poisson_ratio for each in found}), COLOURS, strict=False):
        for form, (marker, size) in MARKERS.items():
            mine = [each for each in found if (each.form, each.poisson_ratio) == (form, ratio)]
            there = [(each.wavenumber, on) for each in mine if (on := getattr(each, event)) is not None]
            xis, amplitudes = [xi for xi, _ in there], [on.amplitude for _, on in there]
            face = colour if form == "running" else "none"
            marks: dict[str, Any] = {
                "color": colour,
                "markerfacecolor": face,
                "capsize": 2,
                "linestyle": "none",
                "markersize": size,
            }
            label = rf"{form}, $\nu$ = {ratio:g}" if there else None
            axes.errorbar(xis, amplitudes, [on.error for _, on in there], marker=marker, label=label, **marks)
            if form == "running":
                axes.plot(xis, [on.linear for _, on in there], color=colour, linewidth=0.8)
    axes.plot([], [], color="grey", linewidth=0.8, label="linear rule")
    axes.set(xlabel=r"wave number $\xi$ (rad per row)", ylabel=r"amplitude $D_0/\Delta_0$", title=title)
    axes.set(xlim=(0, np.pi), ylim=(0, None))


def _beyond(axes: Axes, records: Sequence[Record]) -> None:
    """Draw the largest |p| of one running wave over its amplitude, with closed contacts and with open ones."""
    groups = {wave: runs for wave, runs in waves(records).items() if wave[0] == "running"}
    wave = min(groups, key=lambda each: (abs(each[2] - SHOWN), abs(each[1] - SILICA)))
    amplitudes = np.array([run.scene.amplitude for run in groups[wave]])
    largest = np.array([np.abs(run.p).max() for run in groups[wave]]) / amplitudes
    opened = np.array([run.info["guards"]["open_contacts"]["passed_at"] is not None for run in groups[wave]])
    axes.semilogy(amplitudes, largest, color="black", linewidth=0.8)
    axes.semilogy(amplitudes[~opened], largest[~opened], "o", color="black", markersize=4, label="contacts stay closed")
    axes.semilogy(amplitudes[opened], largest[opened], "o", color="black", mfc="white", markersize=4, label="some open")
    axes.set(xlabel=r"amplitude $a=D_0/\Delta_0$", ylabel=r"$\max|p|\,/\,aD_0$")
    axes.set_title(rf"(c) generated wave, $\xi$ = {wave[2]:.3f}, $\nu$ = {wave[1]:g}", loc="left")
    legend_above(axes, 2)


def _frictions(axes: Axes, records: Sequence[Record]) -> None:
    """Draw the fundamental in the last period, and the largest |p|, over the friction."""
    runs = [run for run in records if run.info["effects"]["sliding"]["on"]]
    runs.sort(key=lambda run: float(run.scene.effects.friction))
    axes.set(xlabel="friction", ylabel=r"amplitude ($D_0$)")
    axes.set_title("(d) contacts that slide", loc="left")
    if not runs:
        axes.text(0.5, 0.5, "no runs with sliding", ha="center", transform=axes.transAxes)
        return
    if len({repr(all_but(run, "effects.friction")) for run in runs}) > 1:
        raise ValueError(f"{runs[0].folder}: the runs with sliding must differ only in effects.friction")
    frictions = [float(run.scene.effects.friction) for run in runs]
    period = 2 * np.pi / runs[0].info["frequency"]
    last = [np.abs(run.q[run.tau > run.tau[-1] - period]).max() for run in runs]
    axes.semilogx(frictions, last, "o-", markersize=4, linewidth=0.8, color="C0", label=r"$|q|$ in the last period")
    largest = [np.abs(run.p).max() for run in runs]
    axes.semilogx(frictions, largest, "o-", markersize=4, linewidth=0.8, color="black", label=r"$\max|p|$")
    scene = runs[0].scene
    axes.set_title(rf"(d) sliding, $a$ = {scene.amplitude:g}, $\xi$ = {scene.wavenumber:.3f}", loc="left")
    legend_above(axes, 2)


def measure(runs: Sequence[Record]) -> Measured:
    """Return the runs and the onsets; raise ValueError if all runs have sliding."""
    if not waves(runs):
        raise ValueError("no finished runs with effects.sliding = false")
    return runs, points(runs)


main = script(__name__, measure, table, draw, ("sweeps", "sweeps over wave.amplitude or effects.friction"))
