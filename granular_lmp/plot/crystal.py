"""Picture or movie of the crystal of a run, with the signals of its centre sphere beside it if there is a wave.

Displacements in a wave are about 1e-4 of a radius, so one factor magnifies displacements and angles; the picture states
the factor. Seen from the top, a wave along y runs upward. A crystal in space can also be seen from a side, on its
substrate. A narrow periodic cell is drawn several times side by side.
"""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from granular_lmp.errors import ViewError
from granular_lmp.plot.colours import SIDES, Side, colouring_of, side_of
from granular_lmp.plot.fronts import Fronts
from granular_lmp.plot.movie import FRAMES_PER_SECOND, MARK, refuse_movie, write_movie
from granular_lmp.plot.signals import PAGE, Picture, clock, draw_signals, signals_to_draw, title
from granular_lmp.plot.spheres import SpheresInAxes
from granular_lmp.runs.record import Record
from granular_lmp.runs.snapshots import Snapshots, Spheres


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
        Time in units of t0; the nearest snapshot is drawn. The default is the last snapshot.
    colour : "rotation", "energy", "speed", "displacement", "p", "q", "x", "y" or "z", optional
        Quantity of the colours. "displacement" is the magnitude of the displacement, p and q are its components along
        and across the wave vector, and x, y and z its components along the axes. For a wave the default is the
        rotation, or the energy if the run has no angles; without a wave it is the speed.
    magnify : float, optional
        Factor of displacements and angles. For a wave the default is the largest of 1, 2 or 5 times a power of ten with
        which D0 is at most half a radius. Without a wave, spheres are drawn at their places unless a factor is given.
    rows : int, optional
        Number of rows around the centre row; by default 25 for a wave, all rows for a push or a strike.
    fronts : bool
        True for lines at the positions of bursts from sources, by their group velocities (`granular_lmp.plot.fronts`).
    side : "top", "x" or "y", optional
        Side from which the crystal is seen: the top, or the end of an axis. The default is "x" for a wave in space, and
        "top" otherwise.

    Raises
    ------
    ViewError
        If τ is beyond the snapshots, the run does not record the quantity, the factor is not above 0, or waves of the
        run have no fronts.
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
    fps: float | None = None,
    size: tuple[int, int] | None = None,
) -> None:
    """Write a movie, GIF or MP4, with one frame for each snapshot of a run; parameters as in `run_figure`.

    `fps` is the number of frames per second, 10 by default, and `size` the width and height in pixels.

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

    colours = scenery.crystal.colouring.colours
    write_movie(scenery.figure, show, len(snapshots), path, colours, fps or FRAMES_PER_SECOND, size)


def _nearest(snapshots: Snapshots, tau: float | None) -> int:
    times = snapshots.tau
    if not len(times):
        raise ViewError(f"{snapshots.path}: has no complete snapshot yet")
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
        names = [] if record.scene.wave is None else signals_to_draw(record.signals)
        self.record, self.names = record, names
        seen = side_of(snapshots.scene, side)
        self.figure, self.axes, panels = _laid_out(snapshots, seen, len(names))
        for panel in panels[:-1]:
            panel.sharex(panels[-1])
            panel.tick_params(labelbottom=False)
        if panels:
            draw_signals(panels, record.tau, record.signals, names, record.scene)
            panels[0].set_title("centre sphere", fontsize="medium")
        self.marks = [panel.plot([], [], "o", color=MARK, markersize=4, zorder=3, clip_on=False)[0] for panel in panels]
        colouring = colouring_of(snapshots, colour)
        self.crystal = SpheresInAxes(self.axes, snapshots, colouring, moments, magnify, rows, seen)
        self.fronts = Fronts(self.axes, snapshots) if fronts else None
        self.figure.suptitle(title(record.scene), fontsize="medium")

    def show(self, moment: Spheres) -> None:
        self.crystal.show(moment)
        if self.fronts:
            self.fronts.show(moment.tau)
        pad = 16 if self.crystal.narrow else None  # above the bar of length
        self.axes.set_title(clock(moment.tau, self.record.scene), loc="left", pad=pad)
        for mark, name in zip(self.marks, self.names, strict=True):
            mark.set_data([moment.tau], [np.interp(moment.tau, self.record.tau, self.record.signals[name])])


def _laid_out(snapshots: Snapshots, side: Side, signals: int) -> tuple[Picture, Axes, list[Axes]]:
    """Return a figure with axes for the crystal, and one panel per signal beside the crystal or below it."""
    if not signals:
        width, height = np.ptp(side.flat(snapshots.rest), axis=0) + 2
        tall = 0.9 + 4.6 * min(max(height / width, 0.3), 1.2)
        figure = Picture(figsize=(PAGE, tall), layout="constrained")
        return figure, figure.subplots(), []
    figure = Picture(figsize=(PAGE, 4.3), layout="constrained")
    if side == SIDES["top"]:
        grid = figure.add_gridspec(signals, 2, width_ratios=[1.0, 1.3])
        panels = [figure.add_subplot(grid[place, 1]) for place in range(signals)]
        return figure, figure.add_subplot(grid[:, 0]), panels
    grid = figure.add_gridspec(1 + signals, 1, height_ratios=[1.5, *[1.0] * signals])
    axes, *panels = (figure.add_subplot(grid[place, 0]) for place in range(1 + signals))
    return figure, axes, panels
