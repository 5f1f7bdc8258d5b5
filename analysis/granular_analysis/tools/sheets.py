"""Beams, packets and other waves on a periodic sheet: the second order of a run beside theory, as maps and over time.

    granular-analysis sheets RUN [-o FILE] [--tau TAU]

RUN holds snapshots of all spheres (``output.particles``); `granular_analysis.measure.sheets` says how the two are
compared.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from granular_analysis.measure.runs import load
from granular_analysis.measure.sheets import ROW, Comparison, compare, in_frame, relative
from granular_analysis.plotting import parser, show, start

COMPONENTS = ("displacement along k ($D_0$)", "displacement across k ($D_0$)", r"rotation $R\theta$ ($D_0$)")


def table(c: Comparison) -> str:
    """Errors of first and second order, and the second-order field by wave number, over all spheres and snapshots."""
    lines = [
        f"{c.sheet.rows} rows x {c.sheet.columns} columns, a = {c.amplitude:g}, {len(c.tau)} snapshots to tau = "
        f"{c.tau[-1]:g}, carrier k = ({c.wavevector[0]:.4g}, {c.wavevector[1]:.4g}) per lattice constant",
        f"{'relative error of':24}{'displacement':>13}{'rotation':>13}",
    ]
    for name, theory in (("y1", c.linear), ("y1 + a y2", c.linear + c.second)):
        cells = (relative(theory[..., part], c.run[..., part]) for part in (slice(2), slice(2, 3)))
        lines.append(f"{name:24}" + "".join(f"{cell:13.2e}" for cell in cells))
    lines.append(f"{'rms in D0':24}{'run - y1':>13}{'a y2':>13}{'error':>13}")
    parts = [("all wave numbers", c.beyond, c.second)]
    parts += [(f"around {m}k", c.around(c.beyond, m), c.around(c.second, m)) for m in range(4)]
    for name, run, theory in parts:
        size = [np.sqrt(np.mean(np.sum(part**2, axis=-1))) for part in (run, theory)]
        lines.append(f"{name:24}{size[0]:13.2e}{size[1]:13.2e}{float(relative(theory, run)):13.2e}")
    return "\n".join(lines)


def draw(c: Comparison, snapshot: int = -1) -> Figure:
    """Maps of y1, run − y1 and a y2 at a snapshot, of the component largest in theory; below, the errors over time."""
    fields = [in_frame(f[snapshot], c.wavevector) for f in (c.linear, c.beyond, c.second)]
    first, second = (int(np.argmax(np.linalg.norm(fields[which], axis=0))) for which in (0, 2))
    scales = np.abs(fields[0][:, first]).max(), np.abs([f[:, second] for f in fields[1:]]).max()
    tall = c.sheet.rows * ROW / c.sheet.columns
    height = 2.8 * float(np.clip(tall, 0.5, 2.0)) + 1.3
    figure = Figure(figsize=(9.5, height + 2.6), layout="constrained")
    grid = figure.add_gridspec(2, 1, height_ratios=[height, 2.6])
    above, below = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
    panels = above.subplots(1, 3, sharex=True, sharey=True)
    corners = np.pi / 6 + np.pi / 3 * np.arange(6)
    cells = (c.sheet.rest[:, None] + np.column_stack([np.cos(corners), np.sin(corners)]) / np.sqrt(3)) / [1, ROW]
    titles = ("linear: $y_1$", "run − $y_1$", "second order: $a y_2$")
    for axes, title, field, order in zip(panels, titles, fields, (0, 1, 1), strict=True):
        top, value = scales[order] or 1.0, field[:, (first, second)[order]]
        hexagons = PolyCollection(cells, array=value, cmap="cividis", edgecolors="face", rasterized=True)
        hexagons.set_clim(-top, top)
        axes.add_collection(hexagons)
        axes.set(title=title, xlabel="x (lattice constants)", aspect=ROW if 0.4 < tall < 2.5 else "auto")
        axes.margins(0)
    for beside, index in ((panels[:1], first), (panels[1:], second)):
        bar = above.colorbar(beside[0].collections[0], ax=beside, location="bottom", aspect=25 * len(beside))
        bar.set_label(COMPONENTS[index])
    panels[0].set_ylabel("row")
    axes = below.subplots()
    for label, style, theory, run in (
        ("of the run: $y_1$", "k:", c.linear, c.run),
        ("of the run: $y_1 + a y_2$", "k--", c.linear + c.second, c.run),
        ("of run − $y_1$: $a y_2$", "C0-", c.second, c.beyond),
        ("the same, around 0 and 2k", "C1-.", c.around(c.second, 0, 2), c.around(c.beyond, 0, 2)),
    ):
        axes.semilogy(c.tau[1:], relative(theory, run, (1, 2))[1:], style, label=label)
    axes.axvline(c.tau[snapshot], color="grey", linewidth=0.8)
    axes.set(xlabel=r"time $\tau$ (grey: that of the maps)", ylabel="relative error")
    below.legend(loc="outside right center", frameon=False, fontsize="small")
    k = f"k = ({c.wavevector[0]:.3g}, {c.wavevector[1]:.3g}) per lattice constant"
    above.suptitle(rf"LAMMPS and theory, $a = D_0/\Delta_0$ = {c.amplitude:g}, {k}, $\tau$ = {c.tau[snapshot]:g}")
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table and draw the figure into a file; returns the exit status."""
    options = parser(__doc__, "figures/sheets.png", run="run folder with snapshots of all spheres")
    options.add_argument("--tau", type=float, default=np.inf, help="draw the snapshot nearest to it (default: last)")
    chosen = options.parse_args(arguments)

    def nearest(c: Comparison) -> Figure:
        return draw(c, int(np.argmin(np.abs(c.tau - min(chosen.tau, c.tau[-1])))))

    return show(lambda: compare(load(chosen.run)), table, nearest, chosen.output, run=chosen.run)


if __name__ == "__main__":
    start(main)
