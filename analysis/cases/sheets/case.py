"""Any wave on a periodic sheet to second order, compared with the snapshots of a run: beams, packets, standing waves.

    granular-analysis sheets RUN [-o FILE]

RUN has snapshots of all spheres (``output.particles``). The first snapshot is the initial field, which counts as first
order. `granular_analysis.theory.cell` predicts the later ones, y = y1 + a y2, in LAMMPS's contact geometry and with the
time step of the run: the second order of the run is its difference from y1, and compared with that the phase error of
velocity Verlet is not small.

run − y1 also contains third order, which at the fundamental is a drift of the phase, a²τ. So fields are split by wave
number, around multiples of the strongest wave vector k. A field without such a k (noise) is predicted all the same.
"""

from dataclasses import dataclass

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cases.fields import ROW, Sheet, field_of, fields_of, in_frame, rest_of
from cases.runner import script
from granular_analysis.measure.snapshot import first_snapshot
from granular_analysis.plotting import page
from granular_analysis.theory.bloch import RECIPROCAL
from granular_analysis.theory.catalogue import ENVELOPE, HOLDS, NO_ROTATION, NO_SHEAR, STANDING
from granular_analysis.theory.catalogue import HELD as WALLS
from granular_analysis.theory.cell import Cell
from granular_analysis.theory.cell import fields as second_order
from granular_analysis.theory.choice import traits_of
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
COMPONENTS = ("displacement along k ($D_0$)", "displacement across k ($D_0$)", r"rotation $R\theta$ ($D_0$)")
# Traits of a run that the theory holds
HELD = HOLDS["second-order"] - WALLS - {NO_SHEAR, NO_ROTATION} | {STANDING, ENVELOPE}


def carrier(sheet: Sheet, field: Floats, rate: Floats) -> Floats:
    """Return the wave vector (2,) of the strongest wave in an initial field, in the first zone, with ky > 0."""
    power = sum(np.sum(np.abs(sheet.waves(part)) ** 2, axis=-1) for part in (field, rate))
    images = _images(sheet.wavevectors[np.unravel_index(np.argmax(power), power.shape)])
    found = np.round(images[np.argmin(np.round(np.linalg.norm(images, axis=1), 9))], 12)  # a zero may be 1e-17
    return (found if (found[1], found[0]) >= (0, 0) else -found) + 0.0  # no −0


def _images(wavevectors: Floats) -> Floats:
    """Return nine equivalents (..., 9, 2) of wave vectors (..., 2), among them the shortest."""
    apart = wavevectors @ np.linalg.inv(RECIPROCAL)
    around = np.indices((3, 3)).reshape(2, -1).T - 1
    return ((apart - np.round(apart))[..., None, :] + around) @ RECIPROCAL


@dataclass(frozen=True)
class Comparison:
    """Snapshots of a run, and their prediction: fields (T, N, 3) of (u, v, Rθ) in D0; `second` is a y2."""

    sheet: Sheet
    amplitude: float
    wavevector: Floats
    tau: Floats
    run: Floats
    linear: Floats
    second: Floats

    @property
    def beyond(self) -> Floats:
        """Return the nonlinear part of the run, run − y1: second and all higher orders."""
        return self.run - self.linear

    def around(self, field: Floats, *multiples: int) -> Floats:
        """Return the part of a field at wave vectors whose nearest ±mk, among m = 0 to 3, has m in `multiples`."""
        centres = [[m * self.wavevector, -m * self.wavevector] for m in range(4)]
        images = _images(self.sheet.wavevectors[None, None] - np.array(centres)[:, :, None, None])
        nearest = np.argmin(np.round(np.linalg.norm(images, axis=-1).min(axis=(1, -1)), 9), axis=0)
        return self.sheet.field(self.sheet.waves(field) * np.isin(nearest, multiples)[..., None])


def compare(record: Record) -> Comparison:
    """Return the snapshots of a run with their prediction from the first.

    Raises ValueError for a run that the theory leaves out (`refuse`), and for snapshots that lack a part of the field;
    `GranularError` without snapshots.
    """
    refuse(record)
    particles = record.snapshots()
    shape = record.scene.shape
    if len(particles.tau) < 2:
        raise ValueError(f"{len(particles.tau)} snapshots; the theory starts from the first and predicts the others")
    fields, rate = fields_of(particles), field_of(particles[0], "velocity", "spin")
    if np.isnan(fields[..., 2]).any():
        raise ValueError("the angles are not in the snapshots; run with effects.tracking = true")
    sheet = Sheet(shape.rows, shape.columns)
    if not np.allclose(rest_of(particles), sheet.rest, rtol=0, atol=1e-6):
        raise ValueError("the places of the spheres at rest are not those of the hexagonal sheet of this theory")
    first, tau = first_snapshot(record), particles.tau
    start = (fields[0] * first.length).ravel(), (rate * first.length / first.time).ravel()
    since, step = (tau - tau[0]) * first.time, particles.step * first.time
    orders = second_order(Cell.of(first.network), start[0], start[1], since, step)
    linear, second = (each.reshape(fields.shape) / first.length for each in orders)
    wavevector = carrier(sheet, fields[0], rate)
    return Comparison(sheet, record.scene.amplitude, wavevector, tau, fields, linear, second)


def refuse(record: Record) -> None:
    """Raise ValueError with the names of the traits of a run that the theory leaves out."""
    if left_out := sorted(traits_of(record) - HELD):
        raise ValueError(f"the theory of sheets leaves out {', '.join(left_out)}")


def relative(estimate: Floats, reference: Floats, axis: tuple[int, ...] | None = None) -> Floats:
    """Return ‖estimate − reference‖/‖reference‖ over the axes; nan if the reference is zero."""
    off, norm = (np.sqrt(np.sum(part**2, axis=axis)) for part in (estimate - reference, reference))
    return np.divide(off, norm, out=np.full_like(norm, np.nan), where=norm > 0)


def table(c: Comparison) -> str:
    """Return errors of first and second order, and the second-order field by wave number, over all snapshots."""
    lines = [
        f"{c.sheet.rows} rows x {c.sheet.columns} columns, a = {c.amplitude:g}, {len(c.tau)} snapshots to tau = "
        f"{c.tau[-1]:g}, carrier k = ({c.wavevector[0]:.4g}, {c.wavevector[1]:.4g}) per lattice constant",
        f"{'relative error of':24}{'displacement':>13}{'rotation':>13}",
    ]
    for name, theory in (("y1", c.linear), ("y1 + a y2", c.linear + c.second)):
        cells = (relative(theory[..., part], c.run[..., part]) for part in (slice(2), slice(2, 3)))
        lines.append(f"{name:24}" + "".join(f"{cell:13.2e}" for cell in cells))
    lines.append(f"{'rms in D0':24}{'run - y1':>13}{'a y2':>13}{'error':>13}")
    parts = [("all wave numbers", c.beyond, c.second)]
    parts += [(f"around {m}k", c.around(c.beyond, m), c.around(c.second, m)) for m in range(4)]
    for name, run, theory in parts:
        size = [np.sqrt(np.mean(np.sum(part**2, axis=-1))) for part in (run, theory)]
        lines.append(f"{name:24}{size[0]:13.2e}{size[1]:13.2e}{float(relative(theory, run)):13.2e}")
    return "\n".join(lines)


def draw(c: Comparison, snapshot: int = -1) -> Figure:
    """Return the figure: y1, run − y1 and a y2 at a snapshot, for the largest component; below, errors over time."""
    fields = [in_frame(f[snapshot], c.wavevector) for f in (c.linear, c.beyond, c.second)]
    first, second = (int(np.argmax(np.linalg.norm(fields[which], axis=0))) for which in (0, 2))
    scales = np.abs(fields[0][:, first]).max(), np.abs([f[:, second] for f in fields[1:]]).max()
    tall = c.sheet.rows * ROW / c.sheet.columns
    height = 2.8 * float(np.clip(tall, 0.5, 2.0)) + 1.3
    figure = page(0.7 * height + 2.4)
    grid = figure.add_gridspec(2, 1, height_ratios=[height, 2.6])
    above, below = figure.add_subfigure(grid[0]), figure.add_subfigure(grid[1])
    panels = above.subplots(1, 3, sharex=True, sharey=True)
    corners = np.pi / 6 + np.pi / 3 * np.arange(6)
    cells = (c.sheet.rest[:, None] + np.column_stack([np.cos(corners), np.sin(corners)]) / np.sqrt(3)) / [1, ROW]
    titles = ("linear: $y_1$", "run − $y_1$", "second order: $a y_2$")
    for axes, title, field, order in zip(panels, titles, fields, (0, 1, 1), strict=True):
        top, value = scales[order] or 1.0, field[:, (first, second)[order]]
        hexagons = PolyCollection(cells, array=value, cmap="cividis", edgecolors="face", rasterized=True)
        hexagons.set_clim(-top, top)
        axes.add_collection(hexagons)
        axes.set(title=title, xlabel="x (lattice constants)", aspect=ROW if 0.4 < tall < 2.5 else "auto")
        axes.margins(0)
    for beside, index in ((panels[:1], first), (panels[1:], second)):
        bar = above.colorbar(beside[0].collections[0], ax=beside, location="bottom", aspect=25 * len(beside))
        bar.set_label(COMPONENTS[index])
    panels[0].set_ylabel("row")
    axes = below.subplots()
    for label, style, theory, run in (
        ("$y_1$ against run", "k:", c.linear, c.run),
        ("$y_1 + a y_2$ against run", "k--", c.linear + c.second, c.run),
        ("$a y_2$ against run − $y_1$", "C0-", c.second, c.beyond),
        ("the same, near 0 and 2k only", "C1-.", c.around(c.second, 0, 2), c.around(c.beyond, 0, 2)),
    ):
        axes.semilogy(c.tau[1:], relative(theory, run, (1, 2))[1:], style, label=label)
    axes.axvline(c.tau[snapshot], color="grey", linewidth=0.8)
    axes.set(xlabel=r"time $\tau$ (grey: time of the maps)", ylabel="relative error")
    below.legend(loc="outside right center")
    k = f"k = ({c.wavevector[0]:.3g}, {c.wavevector[1]:.3g}) per lattice constant"
    above.suptitle(rf"LAMMPS and theory, $a = D_0/\Delta_0$ = {c.amplitude:g}, {k}, $\tau$ = {c.tau[snapshot]:g}")
    return figure


main = script(__name__, compare, table, draw, ("run", "run with snapshots of all spheres"), figure="pulse.png")
