"""Pictures of a run without a wave: speeds in a chain over time, in a sheet at a moment or as a movie; bands."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from granular_lmp.crystal.chain_bands import edges, frequencies, gaps
from granular_lmp.crystal.lattices import CHAIN
from granular_lmp.errors import ViewError
from granular_lmp.plot.movie import refuse_movie, write_movie
from granular_lmp.plot.signals import Picture, frequency_axis
from granular_lmp.problem import Problem
from granular_lmp.runs.record import Record
from granular_lmp.scene.strikers import leads

COLOURS = "magma_r"
DARKEST, LIGHTEST = 1.0, 1e-4  # speeds at the ends of the colours: four decades, as the front in a sheet decays


def motion_figure(record: Record, tau: float | None = None) -> Picture:
    """Return a picture of the speeds of the recorded spheres.

    Parameters
    ----------
    record : Record
    tau : float, optional
        Of a sheet the time, t0, of which the nearest record is drawn; by default the last. A chain is drawn at all
        times.

    Raises
    ------
    ViewError
        If a time is asked for in a chain, or is not in the record.
    """
    if record.scene.lattice == CHAIN:
        if tau is not None:
            raise ViewError(f"tau = {tau!r}: is for a sheet; a chain is drawn at all times")
        return _chain(record)
    if tau is not None and not record.tau[0] <= tau <= record.tau[-1]:
        raise ViewError(f"tau = {tau!r}: must be from {record.tau[0]:g} to {record.tau[-1]:g}")
    sheet = _Sheet(record)
    sheet.show(len(record.tau) - 1 if tau is None else int(np.argmin(np.abs(record.tau - tau))))
    return sheet.figure


def motion_movie(record: Record, path: str | Path) -> None:
    """Write a movie of a sheet, GIF or MP4, with a frame for each record.

    Raises
    ------
    ViewError
        If the lattice is a chain, or an MP4 needs the program ffmpeg, which is missing.
    RunFolderError
        If the file cannot be written.
    """
    if record.scene.lattice == CHAIN:
        raise ViewError(f"{path}: a chain is drawn at all times, in a picture; not in a movie")
    path = Path(path)
    refuse_movie(path)
    sheet = _Sheet(record)
    write_movie(sheet.figure, sheet.show, len(record.tau), path, COLOURS)


def bands_figure(problem: Problem) -> Figure:
    """Return a figure of the bands of a chain that is pressed together, its gaps shaded, with an axis in hertz.

    Raises SceneError as `Problem.cell`.
    """
    mass, stiffness = problem.collisions.cell
    phases = np.linspace(0.0, np.pi, 200)
    figure = Figure(figsize=(5.5, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.plot(phases, frequencies(mass, stiffness, phases), color="black")
    for low, high in gaps(edges(mass, stiffness)):
        axes.axhspan(low, high, color="0.9")
    axes.set(xlabel=r"phase from cell to cell (rad)", ylabel=r"frequency $\Omega$ (rad per $t_0$)", xlim=(0, np.pi))
    axes.set_ylim(bottom=0)
    axes.set_title(f"{problem.scene.name}: cell of {len(mass)}", fontsize="medium")
    frequency_axis(axes, 2 * np.pi * problem.scene.scale.time)
    return figure


def _speeds(record: Record) -> NDArray[np.float64]:
    """Return the speeds (T, n) in the unit of the colours, those below the colours as the lightest of them."""
    return np.maximum(np.linalg.norm(record.velocity, axis=-1) * record.scale.velocity / _unit(record), LIGHTEST)


def _unit(record: Record) -> float:
    """Return the speed of the darkest colour, m/s: v of an impact, else the largest that was recorded."""
    if record.scene.loose:
        return record.scale.velocity
    return float(np.linalg.norm(record.velocity, axis=-1).max(initial=0.0)) * record.scale.velocity or 1.0


def _title(record: Record) -> str:
    scale = record.scale
    return f"{record.scene.name}: {_unit(record):.3g} m/s, $t_0$ = {scale.time:.3g} s"


def _label(record: Record) -> str:
    scene = record.scene
    struck = scene.loose and leads(scene.striker, scene.start, scene.sphere.radius)
    unit = "that of the striker" if struck else f"{_unit(record):.3g} m/s"
    return f"speed ({unit})"


def _chain(record: Record) -> Picture:
    figure = Picture(figsize=(7.0, 4.0), layout="constrained")
    axes: Axes = figure.subplots()
    rows = record.problem.crystal.arrays["row"][record.problem.recorded]
    mesh = axes.pcolormesh(
        record.tau, rows, _speeds(record).T, norm=LogNorm(LIGHTEST, DARKEST), cmap=COLOURS, shading="nearest"
    )
    axes.set(xlabel=r"$\tau$ ($t_0$)", ylabel="row")
    axes.set_title(_title(record), fontsize="medium")
    figure.colorbar(mesh, label=_label(record))
    return figure


class _Sheet:
    """Figure of a sheet; `show` moves its spheres and its clock to another record."""

    def __init__(self, record: Record):
        self.record, self.speeds = record, _speeds(record)
        places, problem = record.rest, record.problem
        width, height = np.ptp(places, axis=0) + 2
        self.figure = Picture(figsize=(6.0, 0.6 + 5.0 * min(max(height / width, 0.3), 1.5)), layout="constrained")
        axes: Axes = self.figure.subplots()
        diameters = 2 * problem.crystal.arrays["radius"][problem.recorded]
        self.discs = EllipseCollection(
            diameters, diameters, 0 * diameters, units="xy", offsets=places, offset_transform=axes.transData,
            cmap=COLOURS, norm=LogNorm(LIGHTEST, DARKEST), edgecolors="none",
        )  # fmt: skip
        axes.add_collection(self.discs, autolim=False)
        low, high = places.min(axis=0) - 1.2, places.max(axis=0) + 1.2
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xticks=[], yticks=[])
        self.axes = axes
        self.figure.colorbar(self.discs, ax=axes, label=_label(record), fraction=0.04, pad=0.02)

    def show(self, number: int) -> None:
        self.discs.set_array(self.speeds[number])
        self.axes.set_title(rf"{_title(self.record)}, $\tau$ = {self.record.tau[number]:.4g}", fontsize="medium")
