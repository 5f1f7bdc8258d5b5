"""Compare transmission and reflection by unequal rows, measured by ``granular-lmp scatter``, with the linear lattice.

    granular-analysis scatter FOLDER... [-o FILE]

Each FOLDER was made by ``granular-lmp scatter``. The first snapshot of its run with inclusions gives the spheres at
rest. `granular_analysis.theory.transfer` computes the scattered waves at each frequency of ``scatter.csv``, for time
step and amplitude 0. Runs with dashpots, contacts that slide or open, or sources other than whole rows are refused.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from granular_analysis.measure.runs import load
from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.plotting import COLOURS, in_one_line, legend_above, page, parser, save
from granular_analysis.theory import catalogue
from granular_analysis.theory.choice import traits_of
from granular_analysis.theory.rows import Rows, rows_of
from granular_analysis.theory.transfer import scattering
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]

_MATERIAL = ("radius", "density", "youngs_modulus", "poisson_ratio", "work_of_adhesion")
HELD = (catalogue.HOLDS["second-order"] | catalogue.QUIET | {catalogue.AT_REST, "source"}) - {
    catalogue.RUNNING,
    catalogue.OBLIQUE,
    catalogue.JKR,
    catalogue.NO_SHEAR,
    catalogue.NO_ROTATION,
} | {f"inclusion.{name}" for name in ("rows", "spheres", "vacancy", *_MATERIAL)}
FORBIDDEN = 1e-6  # share below which a wave is left out, as the mirror symmetry of a row forbids it
DENSE = 101  # points on a line
ABREAST = 3  # panels per row of the figure


@dataclass(frozen=True)
class Measured:
    """Line of ``scatter.csv`` with theory, as shares of the incident flux.

    Attributes
    ----------
    signal, incident, mode : as in the table.
    frequency : rad/t0.
    transmission, reflection : measured share and its error.
    theory : transmitted and reflected share.
    """

    signal: str
    incident: str
    mode: str
    frequency: float
    transmission: tuple[float, float]
    reflection: tuple[float, float]
    theory: tuple[float, float]


@dataclass(frozen=True)
class Comparison:
    """Folder compared with theory.

    Attributes
    ----------
    name : name of the scene.
    lines : lines of the table.
    frequency : (F,) from the least to the largest of the table, rad/t0.
    curves : theory by mode, (F, 2) transmitted and reflected shares.
    """

    name: str
    lines: list[Measured]
    frequency: Floats
    curves: dict[str, Floats]

    @property
    def deviation(self) -> float:
        """Largest difference of a measured share from theory."""
        return max(max(abs(a - b) for a, b in _pairs(line)) for line in self.lines)

    @property
    def imbalance(self) -> float:
        """Largest departure from 1 of the sum of all measured shares at one frequency."""
        sums: dict[tuple[str, float], float] = {}
        for line in self.lines:
            key = line.signal, line.frequency
            sums[key] = sums.get(key, 0.0) + line.transmission[0] + line.reflection[0]
        return max(abs(total - 1) for total in sums.values())

    @property
    def between_signals(self) -> float | None:
        """Largest difference of a share between burst and tone at one frequency; None without both."""
        burst = {(line.mode, line.frequency): line for line in self.lines if line.signal == "burst"}
        found = [
            abs(a[0] - b[0])
            for line in self.lines
            if line.signal == "tone" and (other := burst.get((line.mode, line.frequency)))
            for a, b in ((line.transmission, other.transmission), (line.reflection, other.reflection))
        ]
        return max(found, default=None)


def _pairs(line: Measured) -> tuple[tuple[float, float], tuple[float, float]]:
    return (line.transmission[0], line.theory[0]), (line.reflection[0], line.theory[1])


def rows_at_rest(record: Record) -> tuple[Rows, float]:
    """Return the rows of a run between its source and the upper quiet end, and t0 in the unit of the rows.

    Raises ValueError if the run has another form, or anything that the linear lattice leaves out.
    """
    if left := sorted(traits_of(record) - HELD):
        raise ValueError(f"{record.folder}: {', '.join(left)}: the linear lattice of rows leaves this out")
    scene = record.scene
    if len(scene.source) != 1 or not scene.source[0].rows:
        raise ValueError(f"{record.folder}: must have one source, of whole rows")
    first = first_snapshot(record)
    last = scene.shape.rows - 2 - int(scene.absorb.rows)
    return rows_of(first.network, scene.source[0].rows[1] + 1, last), first.time


def compare(folder: str | Path) -> Comparison:
    """Return the comparison of a folder of ``granular-lmp scatter`` with theory.

    Raises ValueError for a folder without a table, and for runs that theory does not cover.
    """
    folder = Path(folder)
    try:
        with (folder / "scatter.csv").open(encoding="utf-8", newline="") as stream:
            table = list(csv.DictReader(stream))
    except OSError as error:
        raise ValueError(f"{folder}: not a folder of granular-lmp scatter: {error.strerror or error}") from error
    record = load(folder / "inclusions")
    rows, unit = rows_at_rest(record)
    shares = {
        float(line["frequency"]): scattering(rows, float(line["frequency"]) / unit, line["incident"]) for line in table
    }
    lines = []
    for line in table:
        number = {name: float(text) for name, text in line.items() if name not in ("signal", "incident", "mode")}
        found, mode = shares[number["frequency"]], line["mode"]
        lines.append(
            Measured(
                line["signal"],
                line["incident"],
                mode,
                number["frequency"],
                (number["transmission"], number["transmission_error"]),
                (number["reflection"], number["reflection_error"]),
                (found.transmitted.get(mode, 0.0), found.reflected.get(mode, 0.0)),
            )
        )
    if not lines:
        raise ValueError(f"{folder / 'scatter.csv'}: holds no line")
    at = np.linspace(min(shares), max(shares), DENSE if len(shares) > 1 else 1)
    dense = [scattering(rows, frequency / unit, lines[0].incident) for frequency in at]
    modes = sorted(
        {line.mode for line in lines if max(*line.theory, line.transmission[0], line.reflection[0]) > FORBIDDEN}
    )
    curves = {
        mode: np.array([(each.transmitted.get(mode, 0.0), each.reflected.get(mode, 0.0)) for each in dense])
        for mode in modes
    }
    return Comparison(record.scene.name, lines, at, curves)


def table(found: Sequence[Comparison]) -> str:
    """Return a line for each share and its theory, and the largest departures of each folder."""
    head = f"{'signal':7}{'Ω t0':>9}{'wave':>10}{'T':>10}{'error':>9}{'theory':>10}{'R':>10}{'error':>9}{'theory':>10}"
    lines = []
    for each in found:
        lines += [each.name, head]
        for line in each.lines:
            if line.mode in each.curves:
                (passed, a), (back, b) = line.transmission, line.reflection
                lines.append(
                    f"{line.signal:7}{line.frequency:9.4f}{line.incident + ' → ' + line.mode:>10}{passed:10.5f}{a:9.1e}"
                    f"{line.theory[0]:10.5f}{back:10.5f}{b:9.1e}{line.theory[1]:10.5f}"
                )
        both = "" if each.between_signals is None else f", burst from tone {each.between_signals:.1e}"
        lines.append(
            f"largest departures: from theory {each.deviation:.1e}, of the sum from 1 {each.imbalance:.1e}{both}"
        )
    return "\n".join(lines)


def draw(found: Sequence[Comparison]) -> Figure:
    """Draw the shares of each folder over frequency, with theory as lines, and below them the differences."""
    columns = min(len(found), ABREAST)
    rows = -(-len(found) // columns)
    figure = page(3.6 * rows)
    grid = figure.add_gridspec(2 * rows, columns, height_ratios=[3, 1.2] * rows)
    for number, each in enumerate(found):
        row, column = divmod(number, columns)
        upper = figure.add_subplot(grid[2 * row, column])
        lower = figure.add_subplot(grid[2 * row + 1, column], sharex=upper)
        upper.tick_params(labelbottom=False)
        _shares(upper, each)
        for line in each.lines:
            if line.mode in each.curves:
                for (value, error), theory, filled in zip(
                    (line.transmission, line.reflection), line.theory, (True, False), strict=True
                ):
                    lower.errorbar(
                        line.frequency, value - theory, error, color=COLOURS[line.mode], markersize=4, linewidth=0.7,
                        marker=_MARKERS[line.signal], fillstyle="full" if filled else "none",
                    )  # fmt: skip
        lower.axhline(0, color="0.7", linewidth=0.7, zorder=0)
        lower.ticklabel_format(axis="y", scilimits=(0, 0))
        lower.set_xlabel(r"frequency $\Omega$ (rad/$t_0$)")
        if not column:
            upper.set_ylabel("share of the\nincident energy")
            lower.set_ylabel("measured\n− theory")
    return figure


_MARKERS = {"burst": "o", "tone": "s"}


def _shares(axes: Axes, found: Comparison) -> None:
    for mode, curve in found.curves.items():
        for way, style, values in (("passes", "-", curve[:, 0]), ("comes back", "--", curve[:, 1])):
            axes.plot(found.frequency, values, style, color=COLOURS[mode], linewidth=1, label=f"{mode} {way}")
    for line in found.lines:
        if line.mode in found.curves:
            marker, colour = _MARKERS[line.signal], COLOURS[line.mode]
            axes.plot(line.frequency, line.transmission[0], marker, color=colour, markersize=4)
            axes.plot(line.frequency, line.reflection[0], marker, color=colour, markersize=4, fillstyle="none")
    axes.set_title(found.name.replace("_", " "), loc="left")
    axes.set_ylim(-0.02, 1.02)
    legend_above(axes)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table, draw the figure into a file, and return the exit status."""
    options = parser(__doc__, "scattering.png")
    options.add_argument("folders", nargs="+", metavar="FOLDER", help="folders of granular-lmp scatter")
    chosen = options.parse_args(arguments)
    with in_one_line():
        found = [compare(folder) for folder in chosen.folders]
    print(table(found))
    save(draw(found), chosen.output)
    return 0
