"""The second harmonic of plane waves over their direction, in LAMMPS and by the general formula.

    granular-analysis oblique SWEEP... [-o FILE]

Each SWEEP is the folder of a sweep over mode and direction (``granular-lmp sweep``) whose runs hold snapshots of all
spheres, over two time steps h and h/2 as well if Richardson's extrapolation is wanted; ``make waves`` makes one.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from granular_analysis.measure.oblique import SILENT, Point, points, predicted_along, strength
from granular_analysis.measure.runs import sweep
from granular_analysis.plotting import parser, show, start
from granular_analysis.theory.choice import wave_of
from granular_analysis.theory.wave import Wave
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
BOUND = 1e-2  # drawn: the relative error is to stay below it
# Told apart by marker and dashes without colour
COMPONENTS = {"p": ("black", "o", "-"), "q": ("tab:red", "s", "--"), "phi": ("tab:blue", "^", "-.")}
AXES = (r"$\Gamma$K ($x$)", r"$\Gamma$M", r"$\Gamma$K", r"$\Gamma$M ($y$)")  # every 30 degrees
LABELS = {"p": "$p$, along $k$", "q": "$q$, across $k$", "phi": r"$\varphi = R\theta$"}


def table(made: Sequence[Point]) -> str:
    """Each wave: how large its second harmonic is, and the relative error of theory."""
    lines = [f"{'mode':5}{'direction':>10}{'xi':>9}{'p':>11}{'q':>11}{'phi':>11}   rms of X in D0, and its error"]
    for each in made:
        sizes = "".join(
            f"{'0' if size < SILENT * each.strength.max() else format(size, '.3e'):>11}" for size in each.strength
        )
        lines.append(f"{each.mode:5}{each.direction:10.2f}{each.wavenumber:9.4f}{sizes}{each.error:11.1e}")
    errors = [each.error for each in made]
    lines.append(f"relative error: median {np.median(errors):.1e}, largest {max(errors):.1e}")
    return "\n".join(lines)


def draw(made: Sequence[Point], records: Sequence[Record]) -> Figure:
    """The strength of p, q, φ at 2k over the direction for each mode, runs on theory, and below the error of each run.

    The lines are theory at the mean wave number; that of each run is as near to it as its cell allows.
    """
    names = [name for name in ("TR", "RT", "L") if any(each.mode == name for each in made)]
    figure = Figure(figsize=(1.2 + 3.4 * len(names), 6.0), layout="constrained")
    panels = figure.subplots(2, len(names), sharex=True, sharey="row", squeeze=False, height_ratios=(2, 1))
    amplitude, wavenumber = records[0].scene.wave.amplitude, float(np.mean([each.wavenumber for each in made]))
    lowest, highest = (limit(each.error for each in made) for limit in (min, max))
    for name, above, below in zip(names, *panels, strict=True):
        these = [each for each in made if each.mode == name]
        _strengths(above, these, wavenumber, _wave(records, name))
        above.set_title(name, fontsize="medium")
        below.semilogy([each.direction for each in these], [each.error for each in these], "ko", markersize=3.5)
        below.axhline(BOUND, color="black", linewidth=0.8, linestyle=":")
        below.set(xlabel="direction of the wave (degrees)", ylim=(min(1e-5, lowest / 2), max(3e-2, 2 * highest)))
        below.set_xticks(
            range(0, 91, 30), [rf"{angle}, {axis}" for angle, axis in zip(range(0, 91, 30), AXES, strict=True)]
        )
    panels[0, 0].set(ylabel="second harmonic, rms over the run ($D_0$)")
    panels[1, 0].set(ylabel="relative error")
    panels[1, 0].text(0.02, BOUND * 1.15, f"{BOUND:.0%}", transform=panels[1, 0].get_yaxis_transform())
    entries = panels[0, 0].get_legend_handles_labels()
    figure.legend(*entries, loc="outside lower center", ncols=2 * len(names), frameon=False)
    figure.suptitle(
        "plane waves in LAMMPS"
        + (", " if len(names) > 1 else "\n")
        + rf"$\xi$ = {wavenumber:.3g}, $D_0$ = {amplitude:g} $\Delta_0$, $\tau \leq$ {made[0].tau[-1]:g}"
    )
    return figure


def _wave(records: Sequence[Record], name: str) -> Wave:
    """Return the wave of the first oblique run of a mode: along an axis an L wave runs without rotation."""
    these = [wave_of(record) for record in records if record.scene.wave.mode == name]
    return next((wave for wave in these if wave.contact.rotation), these[0])


def _strengths(axes: Axes, these: Sequence[Point], wavenumber: float, wave: Wave) -> None:
    directions = [each.direction for each in these]
    angles = np.linspace(min(0.0, *directions), max(90.0, *directions), 181)  # one direction has its line too
    theory = strength(predicted_along(angles, wavenumber, wave, these[0].tau))
    largest = theory.max()
    for index, (name, (colour, marker, line)) in enumerate(COMPONENTS.items()):
        sizes = theory[:, index]
        axes.semilogy(
            angles, np.where(sizes > SILENT * largest, sizes, np.nan), line, color=colour, linewidth=1,
            label=f"{LABELS[name]}: theory",
        )  # fmt: skip
        seen = [(each.direction, each.strength[index]) for each in these if each.strength[index] > SILENT * largest]
        axes.semilogy(*np.reshape(seen, (-1, 2)).T, marker, color=colour, markersize=4, label="LAMMPS")


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table and draw the figure into a file; returns the exit status."""
    options = parser(__doc__, "figures/oblique.png", sweeps="folders of sweeps over wave.mode, wave.direction")
    chosen = options.parse_args(arguments)
    records = [record for folder in chosen.sweeps for record in sweep(folder)]
    return show(lambda: points(records), table, lambda made: draw(made, records), chosen.output)


if __name__ == "__main__":
    start(main)
