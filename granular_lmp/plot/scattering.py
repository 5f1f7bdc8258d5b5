"""Figure of transmission and reflection by the inclusions of a scene, over frequency."""

from granular_lmp.plot.signals import BRANCH_STYLES, PAGE, Picture, in_words
from granular_lmp.studies.scatter import Scatter

_MARKERS = {"burst": "o", "tone": "s"}


def scattering_figure(found: Scatter) -> Picture:
    """Return a figure of the transmitted and reflected shares of the incident energy, with errors, and their sum."""
    figure = Picture(figsize=(PAGE, 3.8), layout="constrained")
    axes = figure.subplots()
    for mode in found.modes:
        colour = BRANCH_STYLES[mode]["color"]
        for signal, marker in _MARKERS.items():
            rows = [row for row in found.rows if (row.mode, row.signal) == (mode, signal)]
            if not rows:
                continue
            at = [row.frequency for row in rows]
            for name, style in (("transmission", "full"), ("reflection", "none")):
                axes.errorbar(
                    at,
                    [getattr(row, name) for row in rows],
                    [getattr(row, f"{name}_error") for row in rows],
                    marker=marker,
                    fillstyle=style,
                    color=colour,
                    linewidth=0.8,
                    markersize=4,
                    label=f"{name}, {mode}, {signal}",
                )
    balance = sorted((frequency, total) for (_, frequency), total in found.balance().items())
    axes.plot(*zip(*balance, strict=True), color="0.6", linewidth=0.8, label="sum")
    axes.set(xlabel=r"frequency $\Omega$ (rad/$t_0$)", ylabel="share of the incident energy", ylim=(-0.02, 1.05))
    axes.set_title(
        f"{in_words(found.scene.name)}: {found.rows[0].incident} meets {found.scene.imperfections}", fontsize="medium"
    )
    axes.legend()
    return figure
