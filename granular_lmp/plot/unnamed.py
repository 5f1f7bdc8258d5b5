"""Pictures and movies of an unnamed crystal: a chain over time, other spheres at one time or in a movie."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.collections import EllipseCollection
from numpy.typing import NDArray

from granular_lmp.errors import ViewError
from granular_lmp.plot.colours import SIDES, Scale, Side, beyond, end_of, norm_of
from granular_lmp.plot.monitors import MOST_LINES, draw_lines
from granular_lmp.plot.motion import speeds_figure
from granular_lmp.plot.movie import FRAMES_PER_SECOND, MOVIES, refuse_movie, write_movie
from granular_lmp.plot.signals import PAGE, Picture, in_si, save
from granular_lmp.runs.unnamed import Moment, Unnamed

Floats = NDArray[np.float64]

_LOW = 0.3  # height over width, below which the numbers of an axis would overlap
# Values (N,) from a snapshot and the positions at rest, their label, and their unit
_QUANTITIES: dict[str, tuple[Callable[[Moment, Floats], Floats], str, str]] = {
    "speed": (lambda moment, _: np.linalg.norm(moment.velocity, axis=1), "speed", "m/s"),
    "displacement": (lambda moment, rest: np.linalg.norm(moment.place - rest, axis=1), "displacement", "m"),
    "x": (lambda moment, rest: moment.place[:, 0] - rest[:, 0], "displacement along $x$", "m"),
    "y": (lambda moment, rest: moment.place[:, 1] - rest[:, 1], "displacement along $y$", "m"),
    "z": (lambda moment, rest: moment.place[:, 2] - rest[:, 2], "displacement along $z$", "m"),
}


def draw_unnamed(
    crystal: Unnamed,
    path: Path,
    *,
    tau: float | None = None,
    colour: str | None = None,
    magnify: float | None = None,
    side: str | None = None,
    fps: float | None = None,
    size: tuple[int, int] | None = None,
) -> None:
    """Draw an unnamed crystal as a picture, or as a movie of all snapshots.

    Arguments are those of `granular_lmp.plot.view.view`. The picture of spheres along a line shows all times, unless a
    time, a colour, a factor or a side is given.

    Raises
    ------
    ViewError
        For an unknown colour or side, a time beyond the snapshots, or an option or suffix that does not fit the
        picture.
    """
    movie = path.suffix.lower() in MOVIES
    if len(crystal.axes) == 1 and not movie and tau is None and colour is None and magnify is None and side is None:
        save(_over_time(crystal), path, size)
        return
    if path.suffix.lower() == ".html":
        raise ViewError(f"{path}: unnamed crystals have no page; take .png, .pdf, .svg, .gif or .mp4")
    if movie and tau is not None:
        raise ViewError("--tau: cannot be used for a movie, which shows all snapshots")
    numbers = range(len(crystal)) if movie else [_nearest(crystal, tau)]
    scene = _Spheres(crystal, numbers, colour or "speed", magnify or 0.0, _side(crystal, side))
    if not movie:
        scene.show(numbers[0])
        save(scene.figure, path, size)
        return
    refuse_movie(path)
    write_movie(scene.figure, scene.show, len(crystal), path, scene.colours, fps or FRAMES_PER_SECOND, size)


def contacts_figure(crystal: Unnamed, name: str) -> Picture:
    """Return the figure of contacts over time, with a panel for each quantity and a line for each contact.

    Raises
    ------
    ViewError
        For another name than "contacts", or contacts without a quantity to draw.
    """
    if name != "contacts":
        raise ViewError(f"monitor = {name!r}: an unnamed crystal has only 'contacts'")
    columns = crystal.contact_columns
    (time, times), (_, one), (_, other), *quantities = columns.items()
    moments, at = np.unique(times, return_inverse=True)
    pairs, which = np.unique(np.stack([one, other], axis=1), axis=0, return_inverse=True)
    drawn = [(each, values) for each, values in quantities if not re.search("_[xyz](_|$)", each)]
    if not drawn:
        raise ViewError(f"{crystal.folder}: the contacts have no overlap or magnitude of a force that could be drawn")
    figure = Picture(figsize=(PAGE, 0.9 + 1.2 * len(drawn)), layout="constrained")
    panels = figure.subplots(len(drawn), squeeze=False, sharex=True)[:, 0]
    for panel, (each, values) in zip(panels, drawn, strict=True):
        table = np.full((len(moments), len(pairs)), np.nan if each.startswith("overlap") else 0.0)
        table[at, which.ravel()] = values
        draw_lines(panel, moments, table, [f"{i} – {j}" for i, j in pairs.tolist()])
        said, _, unit = each.partition("_")
        panel.set(ylabel=f"{said} ({unit})" if unit else said)
        panel.margins(x=0)
    panels[-1].set(xlabel=time.replace("_", " (") + ")" * ("_" in time))
    if 1 < len(pairs) <= MOST_LINES:
        panels[0].legend(ncols=2)
    panels[0].set_title(f"{crystal.name}: contacts", fontsize="medium")
    return figure


def _over_time(crystal: Unnamed) -> Picture:
    """Return the picture of the speeds of spheres on a line over time."""
    (axis,) = crystal.axes
    order = np.argsort(crystal.rest[:, axis])
    speeds = np.linalg.norm(crystal.stack("velocity"), axis=-1)[:, order]
    largest = float(speeds.max(initial=0.0)) or 1.0
    label = f"speed (unit: {_said(crystal, largest, 'm/s')})"
    figure = speeds_figure(crystal.time, crystal.rest[order, axis], speeds / largest, label)
    time, place = ("time (s)", f"{'xyz'[axis]} (m)") if crystal.in_si else ("time (lj)", f"{'xyz'[axis]} (lj)")
    figure.axes[0].set(xlabel=time, ylabel=place)
    figure.axes[0].set_title(crystal.name, fontsize="medium")
    return figure


def _said(crystal: Unnamed, value: float, unit: str) -> str:
    return in_si(value, unit) if crystal.in_si else f"{value:.3g}"


def _nearest(crystal: Unnamed, time: float | None) -> int:
    if time is None:
        return len(crystal) - 1
    first, last = float(crystal.time[0]), float(crystal.time[-1])
    if not first <= time <= last:
        raise ViewError(f"tau = {time!r}: must be from {first:g} to {last:g}, the times of {crystal.folder}")
    return int(np.argmin(np.abs(crystal.time - time)))


def _side(crystal: Unnamed, name: str | None) -> Side:
    """Return a side by name; the default is a side from which the plane of a planar crystal is fully visible."""
    if name is not None and name not in SIDES:
        raise ViewError(f"side = {name!r}: must be one of {', '.join(SIDES)}")
    return SIDES[name] if name else next(each for each in SIDES.values() if {*crystal.axes[:2]} <= {*each.page})


class _Spheres:
    """Figure of the spheres; `show` moves and colours them as in a snapshot."""

    def __init__(self, crystal: Unnamed, numbers: range | list[int], colour: str, magnify: float, side: Side) -> None:
        if colour not in _QUANTITIES:
            raise ViewError(f"colour = {colour!r}: must be one of {', '.join(_QUANTITIES)}")
        self.crystal, self.magnify, self.side = crystal, magnify, side
        self.value, label, unit = _QUANTITIES[colour]
        self.colours = "magma_r" if colour == "speed" else "YlOrRd" if colour == "displacement" else "RdBu_r"
        scales: dict[str, Scale] = {"speed": "decades", "displacement": "positive"}
        scale = scales.get(colour, "symmetric")
        end = largest = 0.0
        for number in numbers:
            sizes = np.abs(self.value(crystal[number], crystal.rest))
            end, largest = max(end, end_of(sizes, scale)), max(largest, float(sizes.max()))
        places, radius = side.flat(crystal.rest), crystal.radius
        low, high = (places - radius[:, None]).min(axis=0), (places + radius[:, None]).max(axis=0)
        shape = float(np.clip((high - low)[1] / (high - low)[0], 0.2, 1.5))
        self.figure = Picture(figsize=(PAGE, 1.0 + 4.8 * shape), layout="constrained")
        axes = self.figure.subplots()
        self.discs = EllipseCollection(
            2 * radius, 2 * radius, 0 * radius, units="xy", offsets=places, offset_transform=axes.transData,
            cmap=self.colours, edgecolors="0.3", linewidths=0.4,
            norm=norm_of(end or largest or 1.0, scale),
        )  # fmt: skip
        axes.add_collection(self.discs, autolim=False)
        names = ["xyz"[axis] + (" (m)" if crystal.in_si else " (lj)") for axis in side.page]
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel=names[0], ylabel=names[1])
        if shape < _LOW:
            axes.set_yticks([])
        self.axes = axes
        said = f"{label} ({unit if crystal.in_si else 'lj'})"
        extend = beyond(end, largest, scale)
        self.figure.colorbar(self.discs, ax=axes, label=said, fraction=0.05, pad=0.02, extend=extend)

    def show(self, number: int) -> None:
        """Draw a snapshot; displacements are drawn only if a factor is given."""
        moment, rest = self.crystal[number], self.crystal.rest
        self.discs.set_offsets(self.side.flat(rest + self.magnify * (moment.place - rest)))
        self.discs.set_array(self.value(moment, rest))
        times = f" × {self.magnify:g}" if self.magnify else ""
        moved = f", displacements{times}" if times else ""
        self.axes.set_title(f"{self.crystal.name}, {_said(self.crystal, moment.time, 's')}{moved}", fontsize="medium")
