"""Signals of a monitor over time: a panel for each thing that it records, a line for each sphere, contact or row."""

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from granular_lmp.accuracy.rounding import moving
from granular_lmp.errors import ViewError
from granular_lmp.plot.colours import unit_of
from granular_lmp.plot.signals import LEGEND, Picture
from granular_lmp.runs.monitors import MonitorRecord
from granular_lmp.runs.tables import places_of

MOST_LINES = 8  # If there are more, their mean is drawn between the least and the largest of them
# Symbol of each signal, and its unit beside a wave and without one
_SIGNALS = {
    "motion": {
        **{name: (f"${name}$", "D_0", r"\ell") for name in "uvw"},
        **{f"phi{axis}": (rf"$R\theta_{axis}$" if axis else r"$R\theta$", "D_0", r"\ell") for axis in ("", *"xyz")},
    },
    "contacts": {
        "normal": ("normal force", "k_1 D_0", r"m\ell/t_0^2"),
        "shear": ("shear force", "k_1 D_0", r"m\ell/t_0^2"),
        **{f"shear_{axis}": (f"shear force along {axis}", "k_1 D_0", r"m\ell/t_0^2") for axis in "xyz"},
        "overlap": ("overlap", r"\Delta_0", r"\ell"),
    },
    "flux": {"flux": ("flux along $y$", "k_1 D_0^2/t_0", r"m\ell^2/t_0^3")},
}


def monitor_figure(monitor: MonitorRecord) -> Picture:
    """Return a figure of what a monitor recorded, without signals that are zero, or rounding beside the largest.

    Raises
    ------
    ViewError
        If the monitor has recorded nothing that is not zero.
    """
    columns, times = monitor.columns(), monitor.tau
    known = _SIGNALS[monitor.monitor.what]
    found = {name: columns[name].reshape(len(times), -1) for name in known if name in columns and len(times)}
    drawn = {name: found[name] for name in moving(found)}
    if not drawn:
        raise ViewError(f"monitor {monitor.monitor.name}: recorded nothing but zeros; there is nothing to draw")
    figure = Picture(figsize=(7.0, 1.2 + 1.4 * len(drawn)), layout="constrained")
    panels = figure.subplots(len(drawn), squeeze=False, sharex=True)[:, 0]
    labels = _labels(monitor)
    for panel, (name, values) in zip(panels, drawn.items(), strict=True):
        symbol, *units = known[name]
        _draw(panel, times, values, labels)
        unit = units[monitor.scene.wave is None].replace(r"\ell", unit_of(monitor.scene))
        panel.set(ylabel=f"{symbol} (${unit}$)")
        panel.margins(x=0)
    panels[-1].set(xlabel=r"$\tau$ ($t_0$)")
    if 1 < len(labels) <= MOST_LINES:
        panels[0].legend(fontsize=LEGEND, ncols=2)
    panels[0].set_title(f"{monitor.scene.name}: monitor {monitor.monitor.name}", fontsize="medium")
    return figure


def _labels(monitor: MonitorRecord) -> list[str]:
    """Return the places of the lines: [row, column] of spheres, or with the layer, of both of a contact, or a row."""

    def at(spheres: NDArray[np.int64]) -> list[str]:
        columns = places_of(monitor.crystal, spheres).values()
        return [str([*place]) for place in zip(*(each.tolist() for each in columns), strict=True)]

    if monitor.monitor.what == "flux":
        return [f"row {number}" for number in monitor.rows]
    if monitor.monitor.what == "motion":
        return at(monitor.spheres)
    contacts = monitor.contacts
    others = [f"wall {face}" if face else place for face, place in zip(contacts.wall, at(contacts.j), strict=True)]
    return [" – ".join(pair) for pair in zip(at(contacts.i), others, strict=True)]


def _draw(axes: Axes, times: NDArray[np.float64], values: NDArray[np.float64], labels: list[str]) -> None:
    """Draw a line for each column of values (T, n), or the mean of many and what lies between them."""
    if len(labels) > MOST_LINES:
        axes.fill_between(times, np.nanmin(values, axis=1), np.nanmax(values, axis=1), color="0.85", linewidth=0)
        axes.plot(times, np.nanmean(values, axis=1), color="black", linewidth=0.9)
        return
    for each, label in zip(values.T, labels, strict=True):
        axes.plot(times, each, linewidth=0.9, label=label)
