"""Pictures of a chain without a wave: speeds at all times, and frequency bands."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from granular_lmp.crystal.chain_bands import edges, frequencies, gaps
from granular_lmp.plot.colours import DARKEST, LIGHTEST
from granular_lmp.plot.signals import PAGE, Picture, frequency_axis, in_si, in_words, title
from granular_lmp.problem import Problem
from granular_lmp.runs.record import Record
from granular_lmp.scene.strikers import leads

Floats = NDArray[np.float64]
COLOURS = "magma_r"


def chain_figure(record: Record) -> Picture:
    """Return a picture of the speeds of the recorded spheres of a chain, over time and row."""
    rows = record.problem.rest.atoms.arrays["row"][record.problem.rest.recorded]
    figure = speeds_figure(record.tau, rows, _speeds(record), _label(record))
    xlabel = rf"time $\tau$ ($t_0$ = {in_si(record.scale.time, 's')})"
    figure.axes[0].set(xlabel=xlabel, ylabel="row")
    figure.axes[0].set_title(title(record.scene), fontsize="medium")
    return figure


def speeds_figure(times: Floats, places: NDArray[Any], speeds: Floats, label: str) -> Picture:
    """Return a picture of speeds over times (T,) and places (n,) along a line.

    Parameters
    ----------
    times : (T,)
    places : (n,)
    speeds : (T, n), in units of the speed that has the darkest colour
    label : label of the colour bar
    """
    figure = Picture(figsize=(PAGE, 3.6), layout="constrained")
    axes: Axes = figure.subplots()
    shown = np.maximum(speeds, LIGHTEST).T  # speeds below the colour map have its lightest colour
    mesh = axes.pcolormesh(times, places, shown, norm=LogNorm(LIGHTEST, DARKEST), cmap=COLOURS, shading="nearest")
    figure.colorbar(mesh, label=label)
    return figure


def bands_figure(problem: Problem) -> Figure:
    """Return a figure of the frequency bands of a compressed chain with shaded gaps, and an axis in hertz.

    Raises SceneError for a scene that has no such chain (`granular_lmp.rest.face.Rest.cell`).
    """
    mass, stiffness = problem.rest.cell
    phases = np.linspace(0.0, np.pi, 200)
    figure = Figure(figsize=(PAGE, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.plot(phases, frequencies(mass, stiffness, phases), color="black")
    for low, high in gaps(edges(mass, stiffness)):
        axes.axhspan(low, high, color="0.9")
    axes.set(xlabel=r"phase from cell to cell (rad)", ylabel=r"frequency $\Omega$ (rad per $t_0$)", xlim=(0, np.pi))
    axes.set_ylim(bottom=0)
    axes.set_title(f"{in_words(problem.scene.name)}: cell of {len(mass)}", fontsize="medium")
    frequency_axis(axes, 2 * np.pi * problem.scene.scale.time)
    return figure


def _speeds(record: Record) -> NDArray[np.float64]:
    """Return the speeds (T, n) in units of the speed that has the darkest colour."""
    return np.asarray(np.linalg.norm(record.velocity, axis=-1) * record.scale.velocity / _unit(record))


def _unit(record: Record) -> float:
    """Return the speed of the darkest colour, m/s: the unit v of an impact, otherwise the largest recorded speed."""
    if record.scale.of_impact:
        return record.scale.velocity
    return float(np.linalg.norm(record.velocity, axis=-1).max(initial=0.0)) * record.scale.velocity or 1.0


def _label(record: Record) -> str:
    scene = record.scene
    struck = record.scale.of_impact and leads(scene.striker, scene.start, scene.sphere.radius)
    unit = "speed of the striker" if struck else in_si(_unit(record), "m/s")
    return f"speed (unit: {unit})"
