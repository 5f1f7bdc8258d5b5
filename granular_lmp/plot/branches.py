"""Figures of the branches of a crystal: along a path through the zone, coloured by polarisation; density of states."""

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from granular_lmp.crystal.zone import CHARACTERS, Branches
from granular_lmp.plot.signals import PAGE, frequency_axis, in_words
from granular_lmp.rest.scene import Scene

# Each kind of motion has a colour; a line mixes the colours by the shares of the kinetic energy
COLOURS = np.array([[0.00, 0.45, 0.70], [0.84, 0.37, 0.00], [0.00, 0.62, 0.45], [0.90, 0.62, 0.00], [0.80, 0.47, 0.65]])


def path_figure(branches: Branches, scene: Scene) -> Figure:
    """Return a figure of all branches along a path, coloured by the kind of motion that has the kinetic energy."""
    figure = Figure(figsize=(PAGE, 4.4), layout="constrained")
    axes = figure.subplots()
    for branch in range(branches.frequency.shape[1]):
        points = np.column_stack([branches.way, branches.frequency[:, branch]])
        lines = np.stack([points[:-1], points[1:]], axis=1)
        colours = branches.character[:-1, branch] @ COLOURS
        axes.add_collection(LineCollection(list(lines), colors=colours, linewidths=1.6))
    ways = [way for way, _ in branches.corners]
    axes.set_xticks(ways, [{"G": "Γ"}.get(name, name) for _, name in branches.corners])
    for way in ways:
        axes.axvline(way, color="0.85", linewidth=0.8, zorder=0)
    axes.set(xlim=(ways[0], ways[-1]), ylabel=r"frequency $\Omega$ (rad per $t_0$)")
    axes.set_ylim(0, 1.05 * branches.frequency.max())
    frequency_axis(axes, 2 * np.pi * scene.sphere.time_scale)
    present = branches.character.max(axis=(0, 1)) > 1e-6
    handles = [
        Line2D([], [], color=colour, label=name)
        for name, colour, there in zip(CHARACTERS, COLOURS, present, strict=True)
        if there
    ]
    axes.legend(handles=handles, title=in_words(scene.name), loc="upper right")
    return figure


def density_figure(middle: NDArray[np.float64], density: NDArray[np.float64], scene: Scene) -> Figure:
    """Return a figure of the density of states over the frequency Ω, in rad per t0, with 1 rad per t0 in hertz."""
    figure = Figure(figsize=(PAGE, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.fill_between(middle, density, step="mid", color="0.6")
    hertz = 2 * np.pi * scene.sphere.time_scale
    axes.set(xlabel=r"frequency $\Omega$ (rad per $t_0$)", ylabel=r"share of the modes ($t_0$ per rad)")
    axes.set(xlim=(0, middle[-1]), title=f"{in_words(scene.name)}: 1 rad per $t_0$ is {1 / hertz:.4g} Hz")
    axes.set_ylim(bottom=0)
    return figure
