"""Figure of the signals of a monitor over time: a panel per quantity, and a line per sphere, contact or row."""

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from granular_lmp.accuracy.rounding import moving
from granular_lmp.errors import ViewError
from granular_lmp.plot.colours import unit_of
from granular_lmp.plot.signals import PAGE, Picture, in_words
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.monitors import MonitorRecord
from granular_lmp.runs.tables import places_of
from granular_lmp.scene.monitor_kinds import Quantity, quantity_of

MOST_LINES = 8  # if there are more, a panel has their mean, and a band from the least to the largest of them


def monitor_figure(monitor: MonitorRecord) -> Picture:
    """Return a figure of the signals of a monitor, without signals that are zero or rounding beside the largest.

    Raises
    ------
    ViewError
        If all signals of the monitor are zero.
    """
    columns, times = monitor.columns(), monitor.tau
    known = {name: quantity_of(name, monitor.monitor.known.quantities) for name in columns if not name.endswith("_t")}
    symbols = {name: _symbol(name, each, monitor.scene) for name, each in known.items() if each and each.symbol}
    found = {name: columns[name].reshape(len(times), -1) for name in symbols if len(times)}
    drawn = {name: found[name] for name in moving(found)}
    if not drawn:
        raise ViewError(f"monitor {monitor.monitor.name}: recorded only zeros; there is nothing to draw")
    figure = Picture(figsize=(PAGE, 0.9 + 1.2 * len(drawn)), layout="constrained")
    panels = figure.subplots(len(drawn), squeeze=False, sharex=True)[:, 0]
    labels = _labels(monitor)
    for panel, (name, values) in zip(panels, drawn.items(), strict=True):
        draw_lines(panel, times, values, labels)
        panel.set(ylabel=symbols[name])
        panel.margins(x=0)
    panels[-1].set(xlabel=r"$\tau$ ($t_0$)")
    if 1 < len(labels) <= MOST_LINES:
        panels[0].legend(ncols=2)
    panels[0].set_title(f"{in_words(monitor.scene.name)}: monitor {monitor.monitor.name}", fontsize="medium")
    return figure


def _symbol(name: str, quantity: Quantity, scene: Scene) -> str:
    """Return the symbol of a signal with its unit."""
    axis = name.partition("_")[2]
    unit = replace(quantity.unit, radius=0)  # the symbol of an angle already contains R
    words = unit.words(unit_of(scene), scene.scale.symbol, of_impact=scene.scale.of_impact)
    along = f" along {axis}" if axis else ""
    return f"{quantity.symbol}{along} (${words.replace('k1', 'k_1').replace('t0', 't_0')}$)"


def _labels(monitor: MonitorRecord) -> list[str]:
    """Return the labels of the lines: "row n", the place [row, column(, layer)] of a sphere, or both of a contact."""

    def at(spheres: NDArray[np.int64]) -> list[str]:
        columns = places_of(monitor.crystal, spheres).values()
        return [str([*place]) for place in zip(*(each.tolist() for each in columns), strict=True)]

    if monitor.monitor.known.of == "row":
        return [f"row {number}" for number in monitor.rows]
    if monitor.monitor.known.of == "sphere":
        return at(monitor.spheres)
    contacts = monitor.contacts
    others = [f"wall {face}" if face else place for face, place in zip(contacts.wall, at(contacts.j), strict=True)]
    return [" – ".join(pair) for pair in zip(at(contacts.i), others, strict=True)]


def draw_lines(axes: Axes, times: NDArray[np.float64], values: NDArray[np.float64], labels: list[str]) -> None:
    """Draw a line for each column of values (T, n); for more than `MOST_LINES`, their mean and range."""
    if len(labels) > MOST_LINES:
        axes.fill_between(times, np.nanmin(values, axis=1), np.nanmax(values, axis=1), color="0.85", linewidth=0)
        axes.plot(times, np.nanmean(values, axis=1), color="black", linewidth=0.9)
        return
    for each, label in zip(values.T, labels, strict=True):
        axes.plot(times, each, linewidth=0.9, label=label)
