"""The paper's figure 2 (b, c) by simulation: amplitude of the generated wave over wave number, measured in LAMMPS runs.

    granular-analysis spectrum SWEEP... [-o FILE]

Each SWEEP is the folder of a sweep over mode and wave number (``granular-lmp sweep``), and over two time steps h and
h/2 for Richardson's extrapolation; ``make spectrum`` makes them. p(τ) of each run is fitted with the time functions of
its wave (`cases.spectrum.points`). The figure compares the amplitude with theory, and shows the deviation below.
Resonance and antiresonance are located twice, by theory and by the runs alone. Runs with different spheres, contacts or
amplitudes are refused, because theory is a single line.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cases.runner import script
from cases.spectrum.points import (
    Point,
    extrapolated,
    locate_antiresonance,
    locate_resonance,
    point,
    refusal,
)
from granular_analysis.plotting import COLOURS, page
from granular_analysis.theory.choice import wave_of
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import Wave, antiresonance, generated, nonlinearity, resonance
from granular_lmp.runs.record import Record

BOUND = 5e-3  # line in the figure: the median deviation should stay below it
Measured = tuple[Sequence[Point], Sequence[Record]]  # points of sweeps, and their runs, extrapolated
TITLES = {"TR": "transverse-rotational", "RT": "rotational-transverse", "L": "longitudinal"}


def refuse(records: Sequence[Record]) -> None:
    """Raise ValueError for a run that `refusal` refuses, several amplitudes, or several contacts of one mode."""
    for record in records:
        if reason := refusal(record):
            raise ValueError(f"{record.folder}: {reason}")
    amplitudes = sorted({record.scene.amplitude for record in records})
    if len(amplitudes) > 1:
        raise ValueError(f"wave.amplitude = {', '.join(f'{each:g}' for each in amplitudes)}: must be equal in all runs")
    first: dict[str, tuple[Record, Contact]] = {}
    for record in records:
        here = wave_of(record).contact
        other, there = first.setdefault(record.scene.require_wave().mode, (record, here))
        for part in fields(here):
            mine, its = getattr(here, part.name), getattr(there, part.name)
            if mine != its:
                raise ValueError(
                    f"{record.folder}: {part.name} = {mine!r}, but {its!r} in {other.folder}; "
                    "all runs must have the same crystal"
                )


def table(found: Measured) -> str:
    """Return the deviation from theory by mode, and the wave numbers of resonance and antiresonance."""
    points, records = found
    amplitude = records[0].scene.amplitude
    lines = [
        f"{'':4}{'D0/Delta0':>10}{'runs':>6}{'deviation, median':>19}{'largest':>10}{'standard error, median':>24}"
    ]
    for name, these in by_mode(points).items():
        off = np.abs([each.deviation for each in these])
        error = np.median([abs(each.error / each.predicted) for each in these])
        lines.append(f"{name:4}{amplitude:9g}{len(off):6}{np.median(off):19.1e}{off.max():10.1e}{error:24.1e}")
    if "TR" in by_mode(points):
        contact = _wave(records, "TR").contact
        lines.append(f"\n{'':13}{'D0/Delta0':>10}{'from the runs':>21}{'theory':>12}{'difference':>12}")
        zero, pole = partial(locate_antiresonance, points), partial(locate_resonance, records)
        lines.append(_located("resonance", amplitude, pole, resonance(contact)))
        lines.append(_located("antiresonance", amplitude, zero, antiresonance(contact)))
    return "\n".join(lines)


def _located(name: str, amplitude: float, locate: Callable[[], tuple[float, float]], expected: float | None) -> str:
    line = f"{name:13}{amplitude:10g}"
    try:
        place, error = locate()
    except ValueError as reason:
        return f"{line}   not located: {reason}"
    shown = f"{'none':>12}" if expected is None else f"{expected:12.6f}{place - expected:12.1e}"
    return f"{line}{place:11.6f} ±{error:8.1e}{shown}"


def by_mode(points: Sequence[Point]) -> dict[str, list[Point]]:
    """Return the points of each mode, in the order of `TITLES`, by wave number."""
    ordered = sorted(points, key=lambda each: each.wavenumber)
    found = {name: [each for each in ordered if each.mode == name] for name in TITLES}
    return {name: these for name, these in found.items() if these}


def _wave(records: Sequence[Record], name: str) -> Wave:
    """Return the wave of the first run of a mode; L and TR have different constants, as L does not turn spheres."""
    return wave_of(next(record for record in records if record.scene.require_wave().mode == name))


def draw(found: Measured) -> Figure:
    """Return the figure: amplitude over wave number, of runs and theory; below, deviations and standard errors."""
    points, records = found
    families = by_mode(points)
    figure = page(5.0)
    panels = figure.subplots(2, len(families), sharex=True, sharey="row", squeeze=False, height_ratios=(2, 1.2))
    for (name, these), above, below in zip(families.items(), *panels, strict=True):
        _theory(above, _wave(records, name))
        _amplitudes(above, these, COLOURS[name])
        xis = [each.wavenumber for each in these]
        below.semilogy(xis, [abs(each.deviation) for each in these], "o", ms=3, color=COLOURS[name], label="LAMMPS")
        errors = [abs(each.error / each.predicted) for each in these]
        below.semilogy(xis, errors, color="tab:grey", linewidth=1, label="standard error")
        below.axhline(BOUND, color="black", linewidth=0.8, linestyle=":", label=f"{BOUND:.1%}")
        below.set(xlabel=r"wave number $\xi$ (rad per row)", xlim=(0, np.pi))
    panels[0, 0].set(ylabel=r"generated wave $|\tilde P_1|/2$  ($|\epsilon| D_0$)", ylim=(3e-6, 300))
    panels[1, 0].set(ylabel="relative deviation", ylim=(1e-7, 1))
    handles = panels[0, 0].get_legend_handles_labels()[0] + panels[1, 0].get_legend_handles_labels()[0][1:]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    end, amplitude = max(record.tau[-1] for record in records), records[0].scene.amplitude
    figure.suptitle(
        "second harmonic in LAMMPS"
        + (", " if len(families) > 1 else "\n")
        + rf"$D_0$ = {amplitude:g} $\Delta_0$, $\tau \leq$ {end:g}"
    )
    return figure


def _theory(axes: Axes, wave: Wave) -> None:
    name, xis = wave.mode.name, np.linspace(0.02, np.pi - 0.02, 4000)
    theory = np.abs(generated(name, xis, wave.contact) / nonlinearity(wave.contact, 1.0))
    axes.semilogy(xis, theory, color=COLOURS[name], linewidth=1, label="theory")
    axes.set_title(f"{name}, {TITLES[name]}")


def _amplitudes(axes: Axes, points: Sequence[Point], colour: str) -> None:
    for positive, face, label in ((True, colour, "LAMMPS, > 0"), (False, "white", "LAMMPS, < 0")):
        these = [(each.wavenumber, abs(each.value)) for each in points if (each.value > 0) == positive]
        marks = {"markersize": 3.5, "color": colour, "markerfacecolor": face}
        axes.semilogy(*np.reshape(these, (-1, 2)).T, "o", **marks, label=label)


def measure(runs: Sequence[Record]) -> Measured:
    """Return the points of runs, and the runs, with pairs of steps extrapolated."""
    refuse(runs)
    records = extrapolated(runs)
    return [point(record) for record in records], records


main = script(__name__, measure, table, draw, ("sweeps", "sweeps over wave.mode and wave.wavenumber"))
