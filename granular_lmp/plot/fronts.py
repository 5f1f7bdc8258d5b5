"""Fronts of bursts, drawn over the picture of a crystal from group velocities (`granular_lmp.crystal.zone`)."""

from math import pi

import numpy as np
from matplotlib.axes import Axes

from granular_lmp.crystal.lattices import HEXAGONAL
from granular_lmp.crystal.zone import fronts
from granular_lmp.errors import ViewError
from granular_lmp.plot.signals import BRANCH_STYLES
from granular_lmp.rest.linear import physics_of, unit_contacts, usual_frequency
from granular_lmp.runs.snapshots import Snapshots

MOST_SPHERES = 4  # largest number of spheres of a source, because each sphere has its own fronts


class Fronts:
    """Lines around the spheres of sources: positions that the middle of each burst has reached.

    Raises
    ------
    ViewError
        If the crystal is not a perfect hexagonal sheet, or a source is not a burst on at most `MOST_SPHERES` spheres.
    """

    def __init__(self, axes: Axes, snapshots: Snapshots):
        scene = snapshots.scene
        sources = scene.source
        if scene.lattice is not HEXAGONAL or not scene.perfect or scene.space == 3:
            raise ViewError(
                f"--fronts: {scene.name} must be a perfect hexagonal sheet in its plane; only its waves have fronts"
            )
        if not sources or any(each.kind != "burst" or not 0 < len(each.spheres) <= MOST_SPHERES for each in sources):
            raise ViewError(
                f'--fronts: sources of {scene.name} must have signal = "burst", whose middle makes the front, and list '
                f"1 to {MOST_SPHERES} spheres"
            )
        usual, lattice, physics = usual_frequency(scene), unit_contacts(scene), physics_of(scene)
        row, column = snapshots.crystal.arrays["row"], snapshots.crystal.arrays["column"]
        self.lines = []
        labelled: set[str] = set()
        for source in sources:
            frequency = source.pulsation(scene.sphere, usual)
            middle = source.delay + pi * source.cycles / frequency
            for name, velocity in fronts(lattice, scene.sphere, frequency, physics).items():
                closed = np.vstack([velocity, velocity[:1]])
                for place in source.spheres:
                    start = next(iter(snapshots.rest[(row == place[0]) & (column == place[1])]), None)
                    if start is None:
                        raise ViewError(
                            f"--fronts: the source on sphere {list(place)} of {scene.name} is not recorded; add the "
                            "sphere to output.rows or output.spheres, or leave both keys out"
                        )
                    dashes = BRANCH_STYLES[name]["linestyle"]
                    label = None if name in labelled else f"{name}, $\\Omega$ = {frequency:.3g}"
                    labelled.add(name)
                    (line,) = axes.plot([], [], label=label, zorder=4, color="black", linestyle=dashes, linewidth=0.9)
                    self.lines.append((line, start, closed, middle))
        if labelled:
            figure = axes.get_figure(root=True)
            assert figure is not None
            figure.legend(*axes.get_legend_handles_labels(), loc="outside lower right", ncols=3)

    def show(self, tau: float) -> None:
        """Move the lines to a time; a line is invisible before the middle of its burst has left."""
        for line, start, velocity, middle in self.lines:
            line.set_data(*(start + velocity * max(tau - middle, 0.0)).T)
            line.set_visible(tau > middle)
