"""The paper's figure 2 (b, c) by simulation: the generated wave over the wave number, measured in LAMMPS runs.

    python -m analysis.figures.spectrum SWEEP... [-o FILE]

Each SWEEP is the folder of a sweep over mode and wave number (``granular-lmp sweep``), over two time steps h and h/2 as
well if Richardson's extrapolation is wanted; ``make spectrum`` makes them. p(τ) of each run is fitted with the time
functions of its wave (`analysis.measure.spectrum`); the amplitude is drawn over that of theory, with the deviation
below. Resonance and antiresonance are located twice, by theory and by the runs alone.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis import second_harmonic as closed
from analysis.figures.plotting import COLOURS, parser, save, start, write
from analysis.measure.runs import sweep
from analysis.measure.spectrum import Point, extrapolated, locate_antiresonance, locate_resonance, point, refusal
from analysis.theory.choice import wave_of
from analysis.theory.wave import Wave
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
BOUND = 5e-3  # drawn: the median deviation is to stay below it
TITLES = {"TR": "transverse-rotational", "RT": "rotational-transverse", "L": "longitudinal"}


def table(points: Sequence[Point], records: Sequence[Record]) -> str:
    """Deviation from theory by mode, and both locations, of runs and theory."""
    lines = [f"{'':4}{'runs':>5}{'deviation, median':>20}{'largest':>10}{'standard error, median':>25}"]
    for name in _names(points):
        off = np.abs([each.deviation for each in points if each.mode == name])
        error = np.median([abs(each.error / each.predicted) for each in points if each.mode == name])
        lines.append(f"{name:4}{len(off):5}{np.median(off):20.1e}{off.max():10.1e}{error:25.1e}")
    if "TR" in _names(points):
        constants = _wave(records, "TR").ratios
        lines.append(f"\n{'':15}{'from the runs':>21}{'theory':>12}{'difference':>12}")
        lines.append(_located("resonance", lambda: (*locate_resonance(records), closed.resonance(constants))))
        lines.append(
            _located("antiresonance", lambda: (*locate_antiresonance(points), closed.antiresonance(constants)))
        )
    return "\n".join(lines)


def _located(name: str, locate: Callable[[], tuple[float, float, float | None]]) -> str:
    try:
        place, error, theory = locate()
    except ValueError as reason:
        return f"{name:15}not located: {reason}"
    shown = f"{'none':>12}" if theory is None else f"{theory:12.6f}{place - theory:12.1e}"
    return f"{name:15}{place:11.6f} ±{error:8.1e}{shown}"


def _names(points: Sequence[Point]) -> list[str]:
    return [name for name in TITLES if any(each.mode == name for each in points)]


def _wave(records: Sequence[Record], name: str) -> Wave:
    """Return the wave of the first run of a mode; L runs have other constants than TR, as no sphere turns in them."""
    return wave_of(next(record for record in records if record.scene.wave.mode == name))


def draw(points: Sequence[Point], records: Sequence[Record]) -> Figure:
    """The amplitude of each mode over the wave number, runs on theory, and below the deviation of each run."""
    names = _names(points)
    figure = Figure(figsize=(1.0 + 3.6 * len(names), 6.2), layout="constrained")
    panels = figure.subplots(2, len(names), sharex=True, sharey="row", squeeze=False, height_ratios=(2, 1.2))
    for name, above, below in zip(names, *panels, strict=True):
        these = sorted((each for each in points if each.mode == name), key=lambda each: each.wavenumber)
        _amplitudes(above, these, _wave(records, name))
        _deviations(below, these)
        below.set(xlabel=r"wave number $\xi$ (rad per row)", xlim=(0, np.pi))
    panels[0, 0].set(ylabel=r"generated wave $|\tilde P_1|/2$  ($|\epsilon| D_0$)", ylim=(3e-6, 300))
    panels[1, 0].set(ylabel="relative deviation", ylim=(1e-7, 1))
    panels[0, 0].legend(frameon=False, fontsize="small", loc="upper left")
    panels[1, 0].legend(frameon=False, fontsize="small", loc="upper left", ncols=3, columnspacing=1, handlelength=1.5)
    wave, end = records[0].scene.wave, max(record.tau[-1] for record in records)
    figure.suptitle(rf"second harmonic in LAMMPS, $D_0$ = {wave.amplitude:g} $\Delta_0$, $\tau \leq$ {end:g}")
    return figure


def _amplitudes(axes: Axes, points: Sequence[Point], wave: Wave) -> None:
    name, constants = wave.mode.name, wave.ratios
    xis = np.linspace(0.02, np.pi - 0.02, 4000)
    theory = [abs(closed.generated_amplitude(closed.mode(name, float(xi), constants), constants)) / 2 for xi in xis]
    axes.semilogy(xis, theory, color=COLOURS[name], linewidth=1, label="theory")
    for positive, face, label in ((True, COLOURS[name], "LAMMPS, > 0"), (False, "white", "LAMMPS, < 0")):
        these = [(each.wavenumber, abs(each.value)) for each in points if (each.value > 0) == positive]
        marks = {"markersize": 3.5, "color": COLOURS[name], "markerfacecolor": face}
        axes.semilogy(*np.reshape(these, (-1, 2)).T, "o", **marks, label=label)
    axes.set_title(f"{name}, {TITLES[name]}", fontsize="medium")


def _deviations(axes: Axes, points: Sequence[Point]) -> None:
    rows = [(each.wavenumber, abs(each.deviation), abs(each.error / each.predicted)) for each in points]
    xis, off, errors = np.transpose(rows)
    axes.semilogy(xis, off, "o", markersize=3, color=COLOURS[points[0].mode], label="LAMMPS")
    axes.semilogy(xis, errors, color="tab:grey", linewidth=1, label="standard error")
    axes.axhline(BOUND, color="black", linewidth=0.8, linestyle=":", label=f"{BOUND:.1%}")


def to_csv(points: Sequence[Point]) -> str:
    """Return the points as CSV: amplitudes in εD0, each number in the shortest form that reads back to the same."""
    lines = ["mode,wavenumber,amplitude,standard_error,theory,deviation"]
    for each in sorted(points, key=lambda point: (point.mode, point.wavenumber)):
        numbers = (each.wavenumber, each.value, each.error, each.predicted, each.deviation)
        lines.append(",".join([each.mode, *(repr(float(number)) for number in numbers)]))
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table and draw the figure into a file; returns the exit status."""
    options = parser(__doc__, "figures/spectrum.png", sweeps="folders of sweeps over wave.mode, wave.wavenumber")
    options.add_argument("--csv", metavar="FILE", help="write the points too: mode, wave number, amplitude, theory")
    chosen = options.parse_args(arguments)
    runs = [record for folder in chosen.sweeps for record in sweep(folder)]
    if not runs:
        options.error(f"{chosen.sweeps[0]}: no sweep with finished runs")
    for record in runs:
        if reason := refusal(record):
            options.error(f"{record.folder}: {reason}")
    try:
        records = extrapolated(runs)
    except ValueError as error:
        options.error(str(error))
    points = [point(record) for record in records]
    print(table(points, records))
    if chosen.csv:
        write(Path(chosen.csv), to_csv(points))
    save(draw(points, records), chosen.output)
    return 0


if __name__ == "__main__":
    start(main)
