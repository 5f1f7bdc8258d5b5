"""Marks on the spheres of sources, strikers, monitors and inclusions, lines along interfaces, and their legend."""

from collections.abc import Iterator
from typing import TypedDict

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from granular_lmp.crystal.disorder import Inclusion, chosen_of
from granular_lmp.crystal.lattices import packed
from granular_lmp.plot.colours import Floats, Side
from granular_lmp.rest.at_rest import crystal_of
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.snapshots import Snapshots
from granular_lmp.scene.places import spheres_at

Integers = NDArray[np.int64]
_STRIKERS = {"y": "^", "-y": "v", "x": ">", "-x": "<"}


class Look(TypedDict):
    """Marker, size and fill of a mark."""

    marker: str
    markersize: float
    markerfacecolor: str


_LOOKS: dict[str, Look] = {
    "source": {"marker": "*", "markersize": 9, "markerfacecolor": "white"},
    "striker": {"marker": "^", "markersize": 7, "markerfacecolor": "white"},
    "monitor": {"marker": "s", "markersize": 6, "markerfacecolor": "none"},
    "inclusion": {"marker": "o", "markersize": 3, "markerfacecolor": "black"},
}


class Marks:
    """Marks that move with their spheres, and lines of interfaces, which stay."""

    def __init__(self, axes: Axes, snapshots: Snapshots, drawn: Integers, rest: Floats, copies: int, side: Side):
        scene = snapshots.scene
        place = np.full(len(crystal_of(scene).atoms), -1)
        place[snapshots.spheres[drawn]] = np.arange(len(drawn))
        self.lines: list[tuple[Line2D, Integers]] = []
        handles: dict[str, Line2D] = {}
        for kind, marker, spheres in marked(scene):
            seen = place[spheres][place[spheres] >= 0]
            if not len(seen):
                continue
            indices = (np.arange(copies)[:, None] * len(drawn) + seen).ravel()
            look = _LOOKS[kind]
            (line,) = axes.plot(
                *rest[indices].T,
                linestyle="none",
                marker=marker or look["marker"],
                markersize=look["markersize"],
                markerfacecolor=look["markerfacecolor"],
                markeredgecolor="black",
                zorder=5,
                clip_on=False,
            )
            self.lines.append((line, indices))
            handles.setdefault(kind, line)
        if side.page == (0, 1):
            for ends in interfaces(scene, snapshots):
                (line,) = axes.plot(*ends, color="black", linestyle="--", linewidth=1.2, zorder=4)
                line.set_path_effects([withStroke(linewidth=3, foreground="white")])
                handles.setdefault("interface", line)
        self.legend(axes, handles, snapshots, drawn)

    def legend(self, axes: Axes, handles: dict[str, Line2D], snapshots: Snapshots, drawn: Integers) -> None:
        """Draw the legend below the axes."""
        if snapshots.held[drawn].any():
            name = "held or driven" if snapshots.scene.form.driven else "held"
            handles[name] = Line2D(
                [],
                [],
                linestyle="none",
                marker="o",
                markersize=8,
                markeredgewidth=1.5,
                markerfacecolor="white",
                markeredgecolor="black",
            )
        figure = axes.get_figure()
        if handles and figure is not None:
            figure.legend(
                handles.values(), handles.keys(), loc="outside lower left", ncols=6,
                handletextpad=0.2, columnspacing=1.0,
            )  # fmt: skip

    def show(self, centres: Floats) -> None:
        """Move the marks with their spheres; centres (N, 2) are those of all drawn spheres."""
        for line, indices in self.lines:
            line.set_data(*centres[indices].T)


def marked(scene: Scene) -> Iterator[tuple[str, str, Integers]]:
    """Yield the kind, the marker ("" for the default of the kind) and the spheres of each mark."""
    atoms = crystal_of(scene).atoms
    for source in scene.source:
        yield "source", "", spheres_at(source.rows, source.spheres, atoms, "source", source.layers)
    for striker in scene.striker:
        yield (
            "striker",
            _STRIKERS.get(str(striker.direction), "P"),
            spheres_at(striker.rows, striker.spheres, atoms, "striker", striker.layers),
        )
    for monitor in scene.monitor:
        yield "monitor", "", spheres_at(monitor.rows, monitor.spheres, atoms, "monitor", monitor.layers)
    for number, each in enumerate(scene.inclusion):
        if not each.vacancy and not _is_body(each):
            yield "inclusion", "", _of_inclusion(scene, each, number)


def _is_body(inclusion: Inclusion) -> bool:
    """Return True if an inclusion is another crystal with an interface: successive rows, or a half-plane."""
    rows = inclusion.rows
    return bool(inclusion.half_plane) or len(rows) == 2 and inclusion.every == 1 and rows[1] > rows[0]


def _of_inclusion(scene: Scene, inclusion: Inclusion, number: int) -> Integers:
    """Return the spheres of an inclusion in the crystal at rest, found by their places in the lattice."""
    lattice, atoms = packed(scene.sphere, scene.shape), crystal_of(scene).atoms
    names = [name for name in ("row", "column", "layer") if name in lattice.arrays and name in atoms.arrays]
    sizes = [int(lattice.arrays[name].max()) + 1 for name in names]
    numbers, own = (np.ravel_multi_index([each.arrays[name] for name in names], sizes) for each in (lattice, atoms))
    return np.flatnonzero(np.isin(own, numbers[chosen_of(lattice, inclusion, number, scene.disorder.seed)]))


def interfaces(scene: Scene, snapshots: Snapshots) -> Iterator[tuple[Floats, Floats]]:
    """Yield the ends of each interface as seen from the top: x (2,) and y (2,), in radii."""
    x, y = snapshots.rest[:, 0], snapshots.rest[:, 1]
    row = snapshots.crystal.arrays["row"]
    reach = np.array([x.min() - 1, x.max() + 1])
    for each in scene.inclusion:
        if not _is_body(each):
            continue
        if each.half_plane:
            at_row, at_column, angle = each.half_plane
            atoms = crystal_of(scene).atoms
            corner = spheres_at((), [(int(at_row), int(at_column))], atoms, "half-plane")[0]
            (x0, y0), slope = atoms.positions[corner, :2], np.radians(angle)
            way = np.array([np.cos(slope), np.sin(slope)])
            # The line is half a row spacing, √3/2 radii, before the first spheres of the half-plane
            start = np.array([x0, y0]) - np.sqrt(3) / 2 * np.array([-way[1], way[0]])
            along = (np.column_stack([x, y]) - start) @ way
            near = np.abs((np.column_stack([x, y]) - start) @ [-way[1], way[0]]) < 1.5
            ends = start + np.array([along[near].min(), along[near].max()])[:, None] * way
            yield ends[:, 0], ends[:, 1]
            continue
        for inside, outside in ((each.rows[0], each.rows[0] - 1), (each.rows[-1], each.rows[-1] + 1)):
            if (row == inside).any() and (row == outside).any():
                yield reach, np.full(2, (y[row == inside].mean() + y[row == outside].mean()) / 2)
