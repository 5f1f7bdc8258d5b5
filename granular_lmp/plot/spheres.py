"""Spheres of a run in the axes of a figure: discs that move and turn, a length bar, and marks on some spheres."""

from collections.abc import Iterable
from math import floor, inf, log10

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import EllipseCollection, LineCollection
from mpl_toolkits.axes_grid1.anchored_artists import AnchoredSizeBar

from granular_lmp.crystal.lattices import Shape, lattice_constant
from granular_lmp.errors import ViewError
from granular_lmp.plot.colours import Colouring, Floats, Side, beyond, end_of, label_of, norm_of
from granular_lmp.plot.marks import Marks
from granular_lmp.plot.signals import in_si
from granular_lmp.rest.scene import Scene
from granular_lmp.runs.snapshots import Snapshots, Spheres

ROWS = 25  # rows drawn by default for a wave: three wavelengths of the paper's first case
LARGEST_SHIFT = 0.5  # radii; largest D0 as drawn with the default magnification
FEWEST_DRAWN = 8  # least number of columns, including the copies of a narrow cell
MOST_WITH_EDGES = 1500  # spheres; with more, edges and diameters would hide the colours
_BAR = 0.25  # largest length of the length bar, as a share of the width
_NARROW = 0.6  # width over height, below which the title and the length bar would overlap


class SpheresInAxes:
    """Spheres in axes with lengths in radii: discs coloured by one quantity, with a diameter that shows the rotation.

    Held spheres have a thick edge. Without a wave, displacements are drawn only if a factor is given.
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
        usual = 0.0 if scene.wave is None else round_below(LARGEST_SHIFT / amplitude)
        factor = usual if magnify is None else magnify
        if magnify is not None and not 0 < factor < inf:
            raise ViewError(f"magnify = {factor!r}: must be a number above 0")
        count = min(rows or usual_rows(scene), shape.rows)
        first = max(0, min(shape.centre_row - count // 2, shape.rows - count))
        row, radius = snapshots.crystal.arrays["row"], snapshots.crystal.arrays["radius"]
        self.drawn = np.flatnonzero((first <= row) & (row < first + count))
        if not len(self.drawn):
            raise ViewError(f"rows = {count}: none of the recorded spheres is in these rows around the centre")
        self.stretch = amplitude * factor
        self.colouring, self.scene, self.side = colouring, scene, side
        self.copies = copies_of(shape) if 0 in side.page else 1
        width = shape.columns * shape.lattice.column_distance(lattice_constant(scene.sphere))
        beside = np.arange(self.copies)[:, None, None] * np.array([width, 0.0])
        self.rest = (side.flat(snapshots.rest[self.drawn]) + beside).reshape(-1, 2)
        crowded = len(self.rest) > MOST_WITH_EDGES
        self.turns = scene.effects.tracking is True and self.stretch > 0 and not crowded

        held = np.tile(snapshots.held[self.drawn], self.copies)
        diameters = np.tile(2 * radius[self.drawn], self.copies)
        self.discs = EllipseCollection(
            diameters, diameters, 0 * diameters, units="xy", offsets=self.rest, offset_transform=axes.transData,
            cmap=colouring.colours, edgecolors=np.where(held, "black", "none" if crowded else "0.3"),
            linewidths=np.where(held, 0.7 if crowded else 1.5, 0.4),
        )  # fmt: skip
        end = largest = reach = 0.0
        for moment in moments:
            values = np.abs(self._values(moment))
            end, largest = max(end, end_of(values, colouring.scale)), max(largest, float(values.max()))
            reach = max(reach, self.stretch * float(np.max(np.abs(moment.displacement[self.drawn]))))
        # The range must not be empty if all spheres are at rest
        self.discs.set_norm(norm_of(end or largest or 1.0, colouring.scale))
        axes.add_collection(self.discs, autolim=False)
        self.hands = LineCollection([], linewidths=0.6)
        axes.add_collection(self.hands, autolim=False)
        self.marks = Marks(axes, snapshots, self.drawn, self.rest, self.copies, side)

        low, high = self.rest.min(axis=0) - 1.2 - reach, self.rest.max(axis=0) + 1.2 + reach
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xticks=[], yticks=[])
        if scene.substrate is not None and 2 in side.page:
            axes.axhspan(low[1], self.rest[:, 1].min() - 1.0, color="0.85", zorder=0)
        if 1 in side.page:
            ends = (first - shape.centre_row, first + count - 1 - shape.centre_row)
            _count_rows(axes.yaxis if side.page[1] == 1 else axes.xaxis, ends, scene)
        if side.page[1] == 1:
            axes.set_ylabel("row")
        said = "row" if side.page[0] == 1 else ""
        if self.stretch:
            moved = "displacements and angles" if self.turns else "displacements"
            said += f"{'; ' if said else ''}{moved}\n× {factor:g}"
        again = f"\n{shape.columns} columns, drawn {self.copies} times" if self.copies > 1 else ""
        axes.set_xlabel(said + again)
        _scale_bar(axes, high[0] - low[0], scene.sphere.radius)
        self.narrow = bool(high[0] - low[0] < _NARROW * (high[1] - low[1]))
        figure = axes.get_figure()
        assert figure is not None
        label, extend = label_of(colouring, scene), beyond(end, largest, colouring.scale)
        figure.colorbar(self.discs, ax=axes, label=label, fraction=0.05, pad=0.02, extend=extend)

    def _values(self, moment: Spheres) -> Floats:
        return np.tile(self.colouring.value(moment, self.scene, self.side)[self.drawn], self.copies)

    def show(self, moment: Spheres) -> None:
        """Move and colour the spheres as in a snapshot."""
        moved = self.side.flat(moment.displacement)[self.drawn]
        centres = self.rest + self.stretch * np.tile(moved, (self.copies, 1))
        self.discs.set_offsets(centres)
        values = self._values(moment)
        self.discs.set_array(values)
        self.marks.show(centres)
        if self.turns:
            angles = self.stretch * np.tile(self.side.turn(moment.rotation)[self.drawn], self.copies)
            hand = np.column_stack([np.cos(angles), np.sin(angles)])
            dark = self.colouring.dark(np.asarray(self.discs.norm(values)))
            self.hands.set_color(["white" if each else "0.2" for each in dark])
            self.hands.set_segments(list(np.stack([centres - hand, centres + hand], axis=1)))


def usual_rows(scene: Scene) -> int:
    """Return the default number of drawn rows: `ROWS` for a wave, which fills the crystal; all for a push or strike."""
    return min(ROWS, scene.shape.rows) if scene.form.waves else scene.shape.rows


def copies_of(shape: Shape) -> int:
    """Return how often a cell is drawn side by side: enough for `FEWEST_DRAWN` columns if periodic along x, else 1."""
    return -(-FEWEST_DRAWN // shape.columns) if shape.along_x else 1


def round_below(value: float) -> float:
    """Return the largest of 1, 2 or 5 times a power of ten that is at most a value."""
    power = 10.0 ** floor(log10(value))
    return float(max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-12)) * power)


def _scale_bar(axes: Axes, width: float, radius: float) -> None:
    """Draw a bar of a round length above the right end of axes in units of the radius, which is in metres."""
    length = round_below(_BAR * width * radius)
    bar = AnchoredSizeBar(
        axes.transData, length / radius, in_si(length, "m"), "lower right", pad=0.0, borderpad=0.3, sep=2,
        frameon=False, label_top=True, size_vertical=0.005 * width,
        bbox_to_anchor=(1.0, 1.0), bbox_transform=axes.transAxes,
    )  # fmt: skip
    axes.add_artist(bar)


def _count_rows(axis: Axis, ends: tuple[int, int], scene: Scene) -> None:
    """Write the row numbers along an axis: counted from the centre row for a wave, otherwise as in scene files."""
    spacing = scene.shape.lattice.row_distance(lattice_constant(scene.sphere))
    apart = 5 * -(-(ends[1] - ends[0] + 1) // 60)
    zero = 0 if scene.form.waves else scene.shape.centre_row
    ticks = range(-(-(ends[0] + zero) // apart) * apart, ends[1] + zero + 1, apart)
    axis.set_ticks((np.array(ticks) - zero) * spacing, [str(row).replace("-", "\N{MINUS SIGN}") for row in ticks])
