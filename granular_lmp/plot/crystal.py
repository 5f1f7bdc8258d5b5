"""The crystal of a run with the signals of its centre sphere beside it, as a picture or a movie.

Displacements of a wave are 1e-4 of a radius, so displacements and angles are magnified by one factor, which stands in
the picture. Seen from the top, a wave along y runs upward; a crystal in space is also seen from a side, on its
substrate. A narrow periodic cell is drawn several times side by side.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import floor, inf, log10
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import EllipseCollection, LineCollection
from numpy.typing import NDArray

from granular_lmp.crystal.lattices import lattice_constant
from granular_lmp.crystal.wavevector import WaveVector
from granular_lmp.errors import ViewError
from granular_lmp.plot.fronts import Fronts
from granular_lmp.plot.movie import MARK, refuse_movie, write_movie
from granular_lmp.plot.signals import Picture, draw_signals, signals_to_draw, title
from granular_lmp.runs.record import Record
from granular_lmp.runs.snapshots import Snapshots, Spheres
from granular_lmp.scene.scene import Scene

ROWS = 25  # rows drawn by default: three wavelengths of the paper's first case
LARGEST_SHIFT = 0.5  # radii: largest D0 as drawn by the default magnification
FEWEST_DRAWN = 8  # columns, with the copies of a narrow cell
MOST_WITH_EDGES = 1500  # spheres; with more, edges and diameters would hide the colours
_DARK = 0.6  # share of the largest value above which both colour maps are too dark for a grey line


@dataclass(frozen=True)
class Side:
    """A direction from which a crystal is seen.

    Attributes
    ----------
    page : (int, int)
        Axes to the right and upward, 0 to 2 for x to z.
    towards : int
        Axis towards the reader, about which turns are seen.
    sign : int
        −1 if that axis points away from the reader.
    """

    page: tuple[int, int]
    towards: int
    sign: int

    def flat(self, vectors: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return vectors (N, 2 or 3) on the page, (N, 2)."""
        return vectors[:, list(self.page)]

    def turn(self, rotation: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return rotations (N,) or (N, 3) as they are seen, counterclockwise."""
        return rotation if rotation.ndim == 1 else self.sign * rotation[:, self.towards]


SIDES = {"top": Side((0, 1), 2, 1), "x": Side((1, 2), 0, 1), "y": Side((0, 2), 1, -1)}


@dataclass(frozen=True)
class Colouring:
    """Colouring of the spheres.

    Attributes
    ----------
    value : callable
        (Spheres, WaveVector, Side) → number of each sphere, (N,).
    label : str
        Label of the colour bar.
    colours : str
        Colour map of matplotlib.
    symmetric : bool
        True if 0 is in the middle of the map.
    """

    value: Callable[[Spheres, WaveVector, Side], NDArray[np.float64]]
    label: str
    colours: str
    symmetric: bool


COLOURINGS = {
    "rotation": Colouring(
        lambda spheres, k, side: side.turn(spheres.rotation), r"rotation $R\theta/D_0$", "RdBu_r", symmetric=True
    ),
    "energy": Colouring(
        lambda spheres, k, side: spheres.energy, r"kinetic energy ($m\,D_0^2/t_0^2$)", "YlOrRd", symmetric=False
    ),
    "p": Colouring(
        lambda spheres, k, side: k.along(*spheres.displacement.T[:2]),
        r"displacement along $k$ ($D_0$)",
        "RdBu_r",
        symmetric=True,
    ),
    "q": Colouring(
        lambda spheres, k, side: k.across(*spheres.displacement.T[:2]),
        r"displacement across $k$ ($D_0$)",
        "RdBu_r",
        symmetric=True,
    ),
}


def run_figure(
    record: Record,
    snapshots: Snapshots,
    *,
    tau: float | None = None,
    colour: str | None = None,
    magnify: float | None = None,
    rows: int | None = None,
    fronts: bool = False,
    side: str | None = None,
) -> Picture:
    """Return a picture of the crystal at one moment, and of the signals of its centre sphere over the run.

    Parameters
    ----------
    record : Record
        Record of the run.
    snapshots : Snapshots
        Snapshots of the run.
    tau : float, optional
        Time in units of t0, of which the nearest snapshot is drawn; by default the last one.
    colour : "rotation", "energy", "p" or "q", optional
        Quantity of the colours. p and q are the displacements along and across the wave vector. The default is the
        rotation if spheres turn.
    magnify : float, optional
        Factor of displacements and angles; by default 1, 2 or 5 times a power of ten with which D0 is at most half a
        radius.
    rows : int, optional
        Number of rows around the centre row; by default 25, or all if there are fewer.
    fronts : bool
        True for lines where the bursts of sources are by their group velocities, as in `granular_lmp.plot.fronts`.
    side : "top", "x" or "y", optional
        Where the crystal is seen from: the top, or the end of an axis. The default is "x" in space.

    Raises
    ------
    ViewError
        If τ is beyond the snapshots, the run does not hold the quantity, the factor is not above 0, or waves of the run
        have no fronts.
    """
    moment = snapshots[_nearest(snapshots, tau)]
    scenery = _Scenery(record, snapshots, [moment], colour, magnify, rows, fronts, side)
    scenery.show(moment)
    return scenery.figure


def run_movie(
    record: Record,
    snapshots: Snapshots,
    path: str | Path,
    *,
    colour: str | None = None,
    magnify: float | None = None,
    rows: int | None = None,
    fronts: bool = False,
    side: str | None = None,
) -> None:
    """Write a movie, GIF or MP4, with a frame for each snapshot of a run; parameters as in `run_figure`.

    Raises
    ------
    ViewError
        As in `run_figure`, and if an MP4 needs the program ffmpeg, which is missing.
    RunFolderError
        If the file cannot be written.
    """
    path = Path(path)
    refuse_movie(path)
    _nearest(snapshots, None)
    moments = map(snapshots.__getitem__, range(len(snapshots)))
    scenery = _Scenery(record, snapshots, moments, colour, magnify, rows, fronts, side)

    def show(number: int) -> None:
        scenery.show(snapshots[number])

    write_movie(scenery.figure, show, len(snapshots), path, scenery.crystal.colouring.colours)


def _nearest(snapshots: Snapshots, tau: float | None) -> int:
    times = snapshots.tau
    if not len(times):
        raise ViewError(f"{snapshots.path}: holds no whole snapshot yet")
    if tau is None:
        return len(times) - 1
    if not times[0] <= tau <= times[-1]:
        raise ViewError(f"tau = {tau!r}: must be from {times[0]:g} to {times[-1]:g}, the snapshots of {snapshots.path}")
    return int(np.argmin(np.abs(times - tau)))


class _Scenery:
    """Figure of a run; `show` moves its spheres, clock and marks to another snapshot."""

    def __init__(
        self,
        record: Record,
        snapshots: Snapshots,
        moments: Iterable[Spheres],
        colour: str | None,
        magnify: float | None,
        rows: int | None,
        fronts: bool,
        side: str | None,
    ):
        names = signals_to_draw(record.signals)
        self.record, self.names = record, names
        self.figure = Picture(figsize=(8.0, 5.0), layout="constrained")
        seen = _side(snapshots, side)
        if SIDES["top"] == seen:
            grid = self.figure.add_gridspec(len(names), 2, width_ratios=[1.0, 1.3])
            panels = [self.figure.add_subplot(grid[place, 1]) for place in range(len(names))]
            self.axes = self.figure.add_subplot(grid[:, 0])
        else:
            grid = self.figure.add_gridspec(1 + len(names), 1, height_ratios=[1.5, *[1.0] * len(names)])
            self.axes, *panels = (self.figure.add_subplot(grid[place, 0]) for place in range(1 + len(names)))
        for panel in panels[:-1]:
            panel.sharex(panels[-1])
            panel.tick_params(labelbottom=False)
        draw_signals(panels, record.tau, record.signals, names, record.scene)
        panels[0].set_title("centre sphere", fontsize="medium")
        self.marks = [panel.plot([], [], "o", color=MARK, markersize=4, zorder=3, clip_on=False)[0] for panel in panels]
        self.crystal = _Crystal(self.axes, snapshots, _colouring(snapshots, colour), moments, magnify, rows, seen)
        self.fronts = Fronts(self.axes, snapshots) if fronts else None
        self.figure.suptitle(title(record.scene), fontsize="medium")

    def show(self, moment: Spheres) -> None:
        self.crystal.show(moment)
        if self.fronts:
            self.fronts.show(moment.tau)
        self.axes.set_title(rf"$\tau$ = {moment.tau:.4g}", fontsize="medium")
        for mark, name in zip(self.marks, self.names, strict=True):
            mark.set_data([moment.tau], [np.interp(moment.tau, self.record.tau, self.record.signals[name])])


def _side(snapshots: Snapshots, side: str | None) -> Side:
    space = snapshots.scene.space == 3
    if side is None:
        return SIDES["x" if space else "top"]
    if side not in SIDES:
        raise ViewError(f"side = {side!r}: must be one of {', '.join(SIDES)}")
    if side != "top" and not space:
        raise ViewError(f"side = {side!r}: spheres that stay in their plane are seen from the top")
    return SIDES[side]


def _colouring(snapshots: Snapshots, colour: str | None) -> Colouring:
    tracked = snapshots.scene.effects.tracking is True
    if colour is None:
        return COLOURINGS["rotation" if tracked else "energy"]
    if colour not in COLOURINGS:
        raise ViewError(f"colour = {colour!r}: must be one of {', '.join(COLOURINGS)}")
    if colour == "rotation" and not tracked:
        raise ViewError("colour = 'rotation': the run holds no angles (effects.tracking is off); take 'energy'")
    return COLOURINGS[colour]


class _Crystal:
    """Spheres in their axes, lengths in radii: discs with a diameter that turns, coloured by one quantity.

    Held spheres have a thick edge.
    """

    def __init__(
        self,
        axes: Axes,
        snapshots: Snapshots,
        colouring: Colouring,
        moments: Iterable[Spheres],
        magnify: float | None,
        rows: int | None,
        side: Side,
    ):
        scene, shape = snapshots.scene, snapshots.scene.shape
        amplitude = scene.displacement_amplitude / scene.sphere.radius  # D0, radii
        factor = _magnification(amplitude) if magnify is None else magnify
        if not 0 < factor < inf:
            raise ViewError(f"magnify = {factor!r}: must be a number above 0")
        count = min(rows or ROWS, shape.rows)
        first = max(0, min(shape.centre_row - count // 2, shape.rows - count))
        row, radius = snapshots.crystal.arrays["row"], snapshots.crystal.arrays["radius"]
        self.drawn = np.flatnonzero((first <= row) & (row < first + count))
        self.stretch = amplitude * factor
        self.colouring, self.vector, self.side = colouring, scene.vector, side
        self.copies = -(-FEWEST_DRAWN // shape.columns) if shape.along_x and 0 in side.page else 1
        width = shape.columns * shape.lattice.column_distance(lattice_constant(scene.sphere))
        beside = np.arange(self.copies)[:, None, None] * np.array([width, 0.0])
        self.rest = (side.flat(snapshots.rest[self.drawn]) + beside).reshape(-1, 2)
        crowded = len(self.rest) > MOST_WITH_EDGES
        self.turns = scene.effects.tracking is True and not crowded

        held = np.tile(snapshots.held[self.drawn], self.copies)
        diameters = np.tile(2 * radius[self.drawn], self.copies)
        self.discs = EllipseCollection(
            diameters, diameters, 0 * diameters, units="xy", offsets=self.rest, offset_transform=axes.transData,
            cmap=colouring.colours, edgecolors=np.where(held, "black", "none" if crowded else "0.3"),
            linewidths=np.where(held, 1.5, 0.4),
        )  # fmt: skip
        largest = reach = 0.0
        for moment in moments:
            largest = max(largest, float(np.max(np.abs(self._values(moment)))))
            reach = max(reach, self.stretch * float(np.max(np.abs(moment.displacement[self.drawn]))))
        self.largest = largest or 1.0  # avoids a range of zero if all spheres are at rest
        self.discs.set_clim(-self.largest if colouring.symmetric else 0.0, self.largest)
        axes.add_collection(self.discs, autolim=False)
        self.hands = LineCollection([], linewidths=0.6)
        axes.add_collection(self.hands, autolim=False)

        low, high = self.rest.min(axis=0) - 1.2 - reach, self.rest.max(axis=0) + 1.2 + reach
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xticks=[], yticks=[])
        if scene.substrate is not None and 2 in side.page:
            axes.axhspan(low[1], self.rest[:, 1].min() - 1.0, color="0.85", zorder=0)
        if 1 in side.page:
            ends = (first - shape.centre_row, first + count - 1 - shape.centre_row)
            _count_rows(axes.yaxis if side.page[1] == 1 else axes.xaxis, ends, scene)
        if side.page[1] == 1:
            axes.set_ylabel("row")
        moved = "displacements and angles" if self.turns else "displacements"
        again = f"\n{shape.columns} columns, drawn {self.copies} times" if self.copies > 1 else ""
        before = "row; " if side.page[0] == 1 else ""
        axes.set_xlabel(f"{before}{moved} × {factor:g}{again}", fontsize="small")
        figure = axes.get_figure()
        assert figure is not None
        figure.colorbar(self.discs, ax=axes, label=colouring.label, fraction=0.05, pad=0.02)

    def _values(self, moment: Spheres) -> NDArray[np.float64]:
        return np.tile(self.colouring.value(moment, self.vector, self.side)[self.drawn], self.copies)

    def show(self, moment: Spheres) -> None:
        moved = self.side.flat(moment.displacement)[self.drawn]
        centres = self.rest + self.stretch * np.tile(moved, (self.copies, 1))
        self.discs.set_offsets(centres)
        values = self._values(moment)
        self.discs.set_array(values)
        if self.turns:
            angles = self.stretch * np.tile(self.side.turn(moment.rotation)[self.drawn], self.copies)
            hand = np.column_stack([np.cos(angles), np.sin(angles)])
            self.hands.set_color(["white" if dark else "0.2" for dark in np.abs(values) > _DARK * self.largest])
            self.hands.set_segments(list(np.stack([centres - hand, centres + hand], axis=1)))


def _count_rows(axis: Axis, ends: tuple[int, int], scene: Scene) -> None:
    """Write the numbers of rows, from the centre row, along an axis."""
    spacing = scene.shape.lattice.row_distance(lattice_constant(scene.sphere))
    apart = 5 * -(-(ends[1] - ends[0] + 1) // 60)
    ticks = range(-(-ends[0] // apart) * apart, ends[1] + 1, apart)
    axis.set_ticks(np.array(ticks) * spacing, [str(row).replace("-", "\N{MINUS SIGN}") for row in ticks])


def _magnification(amplitude: float) -> float:
    """Return 1, 2 or 5 times a power of ten that magnifies an amplitude, in radii, to at most `LARGEST_SHIFT`."""
    wanted = LARGEST_SHIFT / amplitude
    power = 10.0 ** floor(log10(wanted))
    return float(max(step for step in (1, 2, 5) if step * power <= wanted) * power)
