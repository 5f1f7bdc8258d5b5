"""The error of p and q over the cost, of single runs and of Richardson pairs, by `cases.timestep.stepped`.

    granular-analysis timestep [-o FILE]

Dots are runs of the stepped lattice, lines the law of their phase.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from cases.timestep.stepped import SAMPLE, TAU, extrapolated, limit, phase_error, stepped
from granular_analysis.measure.norms import relative_error
from granular_analysis.plotting import parser, save, start
from granular_analysis.second_harmonic import ModeName
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import Wave

WAVES: tuple[tuple[ModeName, float, str], ...] = (
    ("TR", 0.802, ""),
    ("TR", 1.475, ", resonance"),
    ("TR", 2.127, ", antiresonance"),
    ("RT", 0.802, ""),
    ("L", 0.802, ""),
)
Floats = NDArray[np.float64]
# The paper's spheres in LAMMPS's geometry
SPHERES = Contact(0.17, overlap_ratio=2.4985144e-4)
SHOWN = {rf"{name}, $\xi$ = {xi}{place}": Wave.of_mode(name, xi, 0.2, SPHERES) for name, xi, place in WAVES}
SILENT = 1e-9  # D0: what a symmetry makes zero is rounding, 1e-12 after a run; the smallest p here is 1e-4
COLOURS = ("#000000", "#0072b2", "#d55e00", "#009e73", "#cc79a7")  # Okabe and Ito's
PER_SAMPLE = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32)


def errors(record: Floats, exact: Floats) -> list[float]:
    """Relative L2 errors of p, q, φ, (T, 3) each; of p alone where q and φ vanish (L). inf for a run that blew up."""
    shown = [index for index in range(3) if np.max(np.abs(exact[:, index])) > SILENT]
    if not np.all(np.isfinite(record)):
        return [float("inf")] * len(shown)
    return [relative_error(record[:, index], exact[:, index]) for index in shown]


def study(waves: Sequence[Wave]) -> tuple[Floats, Floats]:
    """Errors of p and q, (waves, steps, 2), of single runs and of pairs with PER_SAMPLE steps; nan for q of L."""
    counts = sorted(set(PER_SAMPLE) | {2 * count for count in PER_SAMPLE})
    runs = {count: stepped(waves, count) for count in counts}
    single, pair = (np.full((len(waves), len(PER_SAMPLE), 2), np.nan) for _ in range(2))
    for w, exact in enumerate(limit(waves)):
        for i, count in enumerate(PER_SAMPLE):
            coarse, fine = runs[count][w], runs[2 * count][w]
            for table, record in ((single, coarse), (pair, extrapolated(coarse, fine))):
                found = errors(record, exact)[:2]
                table[w, i, : len(found)] = found
    return single, pair


def table(waves: Mapping[str, Wave], single: Floats, pair: Floats) -> str:
    """Return a line for each wave and number of steps to a sample: errors of p and q of a run, and of a pair."""
    lines = [f"{'wave':34}{'steps':>6}" + "".join(f"{word:>10}" for word in ("p", "q", "p, pair", "q, pair"))]
    for w, label in enumerate(waves):
        for i in (0, 4, 9):
            cells = "".join(f"{error:10.2e}" for error in (*single[w, i], *pair[w, i]))
            lines.append(f"{label:34}{PER_SAMPLE[i]:6d}{cells}")
    return "\n".join(lines)


def draw(waves: Mapping[str, Wave], single: Floats, pair: Floats) -> Figure:
    """Errors of p and q over the steps that a unit of time costs: single runs, pairs, and the law of the phase."""
    counts = np.array(PER_SAMPLE)
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, component, title in zip(panels, (0, 1), ("$p$", "$q$"), strict=True):
        for w, (wave, colour) in enumerate(zip(waves.values(), COLOURS, strict=True)):
            style = {"color": colour, "markersize": 4, "linewidth": 0.6, "linestyle": ":"}
            axes.loglog(counts / SAMPLE, single[w, :, component], marker="o", **style)
            axes.loglog(3 * counts / SAMPLE, pair[w, :, component], marker="s", markerfacecolor="w", **style)
            if (component == 0) == (wave.mode.name == "L"):
                fine = np.geomspace(counts[0], counts[-1], 100)
                for cost, law in zip((1, 3), phase_error(wave.mode.frequency, SAMPLE / fine, TAU[-1]), strict=True):
                    axes.loglog(cost * fine / SAMPLE, law, color=colour, linewidth=0.8)
        axes.set(xlabel=r"steps per unit of $\tau$, all runs together", ylim=(1e-8, 3), title=f"error of {title}")
        axes.grid(alpha=0.3)
    panels[1].text(
        0.98, 0.97, "pairs end on slope −1:\n" r"slip of turning contacts, $\propto\Delta\tau\,\Delta_0/R$",
        ha="right", va="top", fontsize="small", transform=panels[1].transAxes,
    )  # fmt: skip
    panels[0].set_ylabel(r"relative $L_2$ error, $\tau \leq 120$")
    handles = [Line2D([], [], color=c, marker="o", markersize=4, linewidth=0.8) for c in COLOURS]
    figure.legend(handles, list(waves), loc="outside lower center", ncols=3, frameon=False)
    kinds = [Line2D([], [], color="grey", marker="o", markersize=4, linestyle=""),
             Line2D([], [], color="grey", marker="s", markersize=4, linestyle="", markerfacecolor="w"),
             Line2D([], [], color="grey", linewidth=0.8)]  # fmt: skip
    panels[1].legend(kinds, ["one run", "Richardson pair", "law of the phase"], fontsize="small", loc="lower left")
    return figure


def main(argv: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    options = parser(__doc__, "figures/timestep.png").parse_args(argv)
    single, pair = study(list(SHOWN.values()))
    print(table(SHOWN, single, pair))
    save(draw(SHOWN, single, pair), options.output)
    return 0


if __name__ == "__main__":
    start(main)
