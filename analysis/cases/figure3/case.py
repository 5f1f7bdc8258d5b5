"""The paper's figure 3: p, q and φ of the centre sphere at three wave numbers, LAMMPS over theory.

    granular-analysis figure3 RUN... [-o figures/figure3.png]

First row: transverse displacement q and rotation φ. Second row: their differences from the paper's order of theory; at
the resonance these contain a third harmonic and the loss of the fundamental. Third row: the longitudinal displacement p
that the shear wave generates. Fourth row: differences of two theories from the p of the run, which the curves above do
not resolve. There are three curves: the run; the paper's order of theory, with its misprints corrected and LAMMPS's
contact geometry; and the best theory for the wave, whose name is in the title. The numbers in the titles are relative
L2 errors of the two theories against the run.
"""

from collections.abc import Sequence
from string import ascii_lowercase

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cases.runner import script
from granular_analysis.measure.signals import COMPONENTS, errors
from granular_analysis.plotting import page
from granular_analysis.theory.choice import best, trajectory, wave_of
from granular_lmp.runs.record import Record

ROWS = 4


def draw(records: list[Record]) -> Figure:
    """Return the figure, with a column for each run."""
    count = len(records)
    figure = page(7.8)
    panels = figure.subplots(ROWS, count, sharex="col", squeeze=False, height_ratios=[3, 2, 3, 2])
    for column, record in enumerate(records):
        _column(list(panels[:, column]), record, [ascii_lowercase[column + row * count] for row in range(ROWS)])
    for axes, label in zip(
        panels[:, 0],
        (r"$q = -u/D_0$,  $\phi = R\theta/D_0$", "beyond the paper's\norder", "$p = v/D_0$", "error of $p$"),
        strict=True,
    ):
        axes.set_ylabel(label)
    # Outside the panels, where no curve is covered
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=6)
    figure.legend(*panels[2, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _column(panels: list[Axes], record: Record, letters: list[str]) -> None:
    upper, beyond, middle, lower = panels
    wave = wave_of(record)
    ours = best(wave, record.tau)
    upper.plot(record.tau, record.q, color="black", linewidth=1.8, label="$q$: LAMMPS")
    upper.plot(record.tau, record.phi, color="tab:grey", linewidth=1.8, label=r"$\phi$: LAMMPS")
    middle.plot(record.tau, record.p, color="black", linewidth=1.8, label="LAMMPS")
    papers, bests = (trajectory(name, wave, record.tau) for name in ("second-order", ours))
    for run, colour, index in ((record.q, "black", 1), (record.phi, "tab:grey", 2)):
        beyond.plot(record.tau, run - papers[index], color=colour, linewidth=1.5)
        beyond.plot(record.tau, bests[index] - papers[index], color="C3", linestyle="--", linewidth=0.8)
    titles: dict[str, list[str]] = {"q": [], "phi": [], "p": []}
    for (p, q, phi), label, colour, dashes in (
        (papers, "the paper's order", "C5", "-"),
        (bests, "best theory", "C3", "--"),
    ):
        for axes, values, shown in ((upper, q, label), (upper, phi, None), (middle, p, label)):
            axes.plot(record.tau, values, color=colour, linestyle=dashes, linewidth=0.8, label=shown)
        # The first record is the start, at which all theories agree
        lower.semilogy(record.tau[1:], np.abs(record.p - p)[1:], color=colour, linestyle=dashes, linewidth=0.8)
        for component, error in errors(record, (p, q, phi)).items():
            titles[component].append("0" if error is None else f"{error:.1e}")
    first, second, third, fourth = letters
    upper.set_title(
        rf"({first}) {wave.mode.name}, $\xi$ = {wave.mode.wavenumber:.4g}"
        f"\n{ours}"
        "\n"
        rf"$q$: {' → '.join(titles['q'])}"
        "\n"
        rf"$\phi$: {' → '.join(titles['phi'])}"
    )
    beyond.set_title(rf"({second}) $q$ and $\phi$ beyond")
    middle.set_title(rf"({third}) $p$: {' → '.join(titles['p'])}")
    lower.set_title(rf"({fourth}) |theory − LAMMPS|")
    lower.set_xlabel(r"time $\tau$")
    for axes in panels:
        axes.margins(x=0)
    for axes in (upper, beyond, middle):
        axes.ticklabel_format(axis="y", scilimits=(-2, 3))


def table(records: Sequence[Record]) -> str:
    """Return a line for each run: errors of p, q, φ by the paper's order, and by the best theory."""
    lines = [f"{'run':18}{'best theory':>16}" + "".join(f"{name:>10}" for name in 2 * COMPONENTS)]
    for record in records:
        wave = wave_of(record)
        ours = best(wave, record.tau)
        found = [errors(record, trajectory(name, wave, record.tau)) for name in ("second-order", ours)]
        cells = (f"{'-' if error is None else f'{error:.2e}':>10}" for each in found for error in each.values())
        lines.append(f"{record.scene.name:18}{ours:>16}" + "".join(cells))
    return "\n".join(lines)


def measure(records: list[Record]) -> list[Record]:
    """Return the runs; raise ValueError for more runs than there are letters for panels."""
    if ROWS * len(records) > len(ascii_lowercase):
        raise ValueError(f"{len(records)} runs: at most {len(ascii_lowercase) // ROWS} fit into one figure")
    return records


main = script(__name__, measure, table, draw, ("runs", "run folders, one a column"))
