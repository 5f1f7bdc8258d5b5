"""The figure of the benchmark: what an accuracy costs, for every contestant that took part."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from matplotlib import rc_context
from matplotlib.figure import Figure

from granular_lmp.cli.entry import STYLE

# Lines of one kind of code have one colour; what is dashed gives the bound that no general code reaches
STYLES = {
    "LAMMPS, one step": ("C0", "o", "-"),
    "LAMMPS, to a tolerance": ("C0", "s", "-"),
    "LAMMPS, one step, kernel": ("C1", "o", "-"),
    "LAMMPS, to a tolerance, kernel": ("C1", "s", "-"),
    "contact list in C": ("tab:grey", "o", "--"),
    "contact list in C, pairs of steps": ("tab:grey", "s", "--"),
    "the row equations, scipy": ("C2", "v", "-"),
    "the exact lattice, scipy": ("C2", "^", "-"),
}
OTHERS = "XPD"  # markers of codes that make one point each


@dataclass(frozen=True)
class Point:
    """One contestant: the line that it belongs to, processor seconds of its rounds, errors of p and q."""

    series: str
    seconds: list[float]
    errors: tuple[float, float]


@rc_context(fname=STYLE)
def draw(points: Sequence[Point], path: str) -> None:
    """Draw the errors of p and q over processor seconds: median, with a bar from the fastest to the slowest round."""
    figure = Figure(figsize=(6.3, 4.8), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for component, (ax, name) in enumerate(zip(axes, ("p, second harmonic", "q, fundamental"), strict=True)):
        others = iter(OTHERS)
        for series in dict.fromkeys(point.series for point in points):
            own = sorted((point for point in points if point.series == series), key=lambda each: each.errors[component])
            colour, marker, line = STYLES[series] if series in STYLES else ("C3", next(others), "none")
            middle = [median(each.seconds) for each in own]
            around = [
                [at - min(each.seconds) for at, each in zip(middle, own, strict=True)],
                [max(each.seconds) - at for at, each in zip(middle, own, strict=True)],
            ]
            ax.errorbar(
                middle,
                [each.errors[component] for each in own],
                xerr=around,
                color=colour,
                marker=marker,
                linestyle=line,
                markersize=5,
                linewidth=1.2,
                elinewidth=0.8,
                label=series,
            )
        ax.set(xscale="log", yscale="log", xlabel="processor time (s)", title=name)
        ax.margins(0.08)
        ax.grid(which="major", linewidth=0.4, alpha=0.6)
    axes[0].set_ylabel("relative error, τ ≤ 120")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    figure.savefig(path, dpi=200)
