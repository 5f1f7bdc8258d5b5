"""Any wave on a periodic sheet to second order, against the snapshots of a run: beams, packets, standing waves.

    python -m analysis.sheets RUN [-o FILE] [--tau TAU]

RUN holds snapshots of all spheres (``output.particles``). The first is taken as the initial field, all of it first
order, and the later ones are predicted. With y = (u, v, φ), φ = Rθ, in D0 and a = D0/Δ0,

    y = y1 + a y2,    M y1″ = −D y1,    M y2″ = −D y2 + N(y1, y1),    y2 = y2′ = 0 at the start,

    N = Σ_l [n f_N + (t, 1) f_S]/(2(κ+3)),    f_N = −¼ δN²,    f_S = −½ κ δN δS        (all six contacts)

the second-order part of the paper's springN and springS, with δN, δS, units and axes of `analysis.directions`. Each
wave vector that the sheet holds has three modes there, which to first order oscillate by themselves. N is taken on the
spheres, where it is a product, and what a mode has of it, F, is answered by the mode:

    y2 = S(τ) ∫₀^τ C(s) F(s) ds − C(τ) ∫₀^τ S(s) F(s) ds,    C = cos Ωτ,  S = sin Ωτ/Ω,

with four points of Gauss a step, of order eight. Waves of k and k′ meet in it at k + k′ and k − k′, which is all of
second order: second harmonic, static field, and what crossing or spreading waves make of each other.

**The run's time step is in the theory.** The second order of a run is seen in its difference to y1, next to which the
phase error of velocity Verlet is not small. With the step h of the run a mode has Ω_h = (2/h) arcsin(Ωh/2) for Ω, and
S = sin Ω_hτ/(Ω cos(Ω_hh/2)): exact for y1, with O(h²) of y2 left.

LAMMPS's contact geometry is exact in D, by Ĩ/(1−η), and left out of N. Measured, that misses 3η to 10η of the static
field of beams, η = Δ0/2R (2.5e-4 for the paper's spheres), η to 2η of their second harmonic, and more where N cancels.

When it breaks: as in `directions` (contacts open, long on a resonance). run − y1 holds the third order too, whose part
at the fundamental is a drift of its phase, a²τ; hence the split by wave number, around multiples of the strongest wave
vector k. A field without one (noise) is predicted all the same.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from analysis.directions import Complexes, Floats, modes
from analysis.plotting import load, parser, save
from analysis.springs import BONDS, SOLID_SPHERE, TANGENTS, stiffness_ratio
from analysis.theories import physics_of
from granular_lmp.record import GranularError, Record

STEP = 0.5  # τ. It leaves 6e-9 of the y2 of noise on all modes, whose frequencies add to 6.
NORMAL, TANGENT = np.concatenate([BONDS, -BONDS]), np.concatenate([TANGENTS, -TANGENTS])  # of the six contacts
ROW = np.sqrt(0.75)  # spacing of rows in lattice constants
RECIPROCAL = 2 * np.pi * np.array([[1.0, -1 / np.sqrt(3)], [0.0, 2 / np.sqrt(3)]])
FieldOrWave = TypeVar("FieldOrWave", Floats, Complexes)
COMPONENTS = ("displacement along k ($D_0$)", "displacement across k ($D_0$)", r"rotation $R\theta$ ($D_0$)")


@dataclass(frozen=True)
class Sheet:
    """A periodic hexagonal sheet, spheres row by row as in LAMMPS's deck, rows even; lengths in lattice constants.

    inertia is Ĩ = I/(mR²), in LAMMPS's contact geometry Ĩ/(1−η).
    """

    rows: int
    columns: int
    poisson_ratio: float
    inertia: float = SOLID_SPHERE

    def __post_init__(self) -> None:
        if self.rows < 2 or self.rows % 2 or self.columns < 1:
            raise ValueError(f"{self.rows} rows x {self.columns} columns: rows must be even, and there must be columns")

    @cached_property
    def _index(self) -> tuple[NDArray[np.int_], NDArray[np.int_], NDArray[np.int_]]:
        """Row and column of each sphere, and whether its row is shifted by half a lattice constant, 1 or 0; (R, C)."""
        row, column = np.indices((self.rows, self.columns))
        return row, column, (row - (self.rows - 1) // 2) % 2

    @cached_property
    def rest(self) -> Floats:
        """Positions (N, 2) at rest; no sphere is on the border of the cell."""
        row, column, odd = self._index
        x, y = column - self.columns // 2 + 0.25 + 0.5 * odd, (row - (self.rows - 1) // 2) * ROW
        return np.stack([x, y], axis=-1).reshape(-1, 2)

    @cached_property
    def neighbours(self) -> NDArray[np.intp]:
        """Indices (6, N) of the spheres at the ends of `NORMAL`, seen from each sphere."""
        row, column, odd = self._index
        right = column + odd  # of the two above and of the two below
        ends = [(row, column + 1), (row + 1, right), (row + 1, right - 1)]
        ends += [(row, column - 1), (row - 1, right - 1), (row - 1, right)]
        return np.array([(r % self.rows * self.columns + c % self.columns).ravel() for r, c in ends])

    @cached_property
    def wavevectors(self) -> Floats:
        """(R, columns//2 + 1, 2): half of those that the sheet holds, −k being the conjugate of k; any zone."""
        y, x = np.indices((self.rows, self.columns // 2 + 1))
        return 2 * np.pi * np.stack([x / self.columns, y / (self.rows * ROW)], axis=-1)

    @cached_property
    def modes(self) -> tuple[Floats, Complexes]:
        """Frequencies (..., 3) and polarisations (..., mode, 3) of all wave vectors."""
        return modes(self.wavevectors, self.poisson_ratio, self.inertia)

    @cached_property
    def _turn(self) -> Complexes:
        return np.exp(-0.5j * self.wavevectors[0, :, 0] * self._index[2][:, :1])[..., None]

    def shares(self, field: Floats) -> Complexes:
        """What each mode U has of a field (..., N, 3): U†My/(U†MU), (..., R, columns//2 + 1, mode)."""
        rows = field.reshape(*field.shape[:-2], self.rows, self.columns, 3)
        waves = np.fft.fft(np.fft.rfft(rows, axis=-2) * self._turn, axis=-3)
        shapes, mass = self.modes[1], np.array([1.0, 1.0, self.inertia])
        return (shapes.conj() @ (mass * waves)[..., None])[..., 0] / (np.abs(shapes) ** 2 @ mass)

    def field(self, shares: Complexes) -> Floats:
        """The field (..., N, 3) of these shares of the modes."""
        waves = (shares[..., None, :] @ self.modes[1])[..., 0, :]
        rows = np.fft.irfft(np.fft.ifft(waves, axis=-3) * self._turn.conj(), self.columns, axis=-2)
        return rows.reshape(*rows.shape[:-3], self.rows * self.columns, 3)


def quadratic_acceleration(sheet: Sheet, field: Floats) -> Floats:
    """M⁻¹N(y, y) of every sphere, (N, 3), for a field (N, 3) in any unit, of which it is the square."""
    kappa = stiffness_ratio(sheet.poisson_ratio)
    ends = field[sheet.neighbours]  # contact, sphere, component
    stretch = np.einsum("lnc,lc->ln", ends[..., :2] - field[:, :2], NORMAL)
    slide = np.einsum("lnc,lc->ln", ends[..., :2] - field[:, :2], TANGENT) - ends[..., 2] - field[:, 2]
    normal, shear = -0.25 * stretch**2, -0.5 * kappa * stretch * slide
    push = np.einsum("ln,lc->nc", normal, NORMAL) + np.einsum("ln,lc->nc", shear, TANGENT)
    return np.column_stack([push, shear.sum(axis=0) / sheet.inertia]) / (2 * (kappa + 3))


def evolve(
    sheet: Sheet, field: Floats, rate: Floats, tau: ArrayLike, *, timestep: float = 0.0, step: float = STEP
) -> tuple[Floats, Floats]:
    """First and second order y1, y2 at the times tau, of the initial field at the first of them: y = y1 + a y2.

    field and rate (N, 3) are (u, v, Rθ) in D0 and its derivative by τ; tau (T,) ascends. timestep, of velocity Verlet,
    is 0 for exact frequencies; step is the largest of the quadrature. Returns two arrays (T, N, 3), in D0.

    Raises ValueError for other shapes and times, and for a timestep at which Verlet is not stable.
    """
    times, shape = np.asarray(tau, dtype=float), (sheet.rows * sheet.columns, 3)
    if {field.shape, rate.shape} != {shape} or times.ndim != 1 or not len(times) or not (np.diff(times) > 0).all():
        raise ValueError(f"field {field.shape} and rate {rate.shape} must be {shape}, tau {times.shape} must ascend")
    frequencies = sheet.modes[0]
    half = frequencies * timestep / 2
    if half.max() >= 1:
        raise ValueError(f"timestep = {timestep}: must be below 2/Omega_max = {2 / frequencies.max():.4g}")
    actual = 2 / timestep * np.arcsin(half) if timestep else frequencies
    # Ω_h/(Ω cos(Ω_hh/2)), at rest (Ω = 0) its limit
    gain = np.divide(actual, frequencies, out=np.ones_like(half), where=frequencies > 0) / np.sqrt(1 - half**2)

    def swing(time: float) -> tuple[Floats, Floats]:
        return np.cos(actual * time), time * np.sinc(actual * time / np.pi) * gain

    start, push = sheet.shares(field), sheet.shares(rate)
    with_cosine, with_sine = 0.0 * start, 0.0 * start
    points, weights = np.polynomial.legendre.leggauss(4)
    first, second = [field], [0.0 * field]
    for before, after in pairwise(times - times[0]):
        edges = np.linspace(before, after, int(np.ceil((after - before) / step - 1e-9)) + 1)
        width = edges[1] - edges[0]
        for middle in (edges[1:] + edges[:-1]) / 2:
            for point, weight in zip(points, weights * width / 2, strict=True):
                cosine, sine = swing(middle + point * width / 2)
                force = sheet.shares(quadratic_acceleration(sheet, sheet.field(cosine * start + sine * push)))
                with_cosine += weight * cosine * force
                with_sine += weight * sine * force
        cosine, sine = swing(after)
        first.append(sheet.field(cosine * start + sine * push))
        second.append(sheet.field(sine * with_cosine - cosine * with_sine))
    return np.array(first), np.array(second)


def component(field: Floats, rest: Floats, wavevector: ArrayLike) -> Complexes:
    """Amplitude X of a wave vector in a field: X = (2/N) Σ field e^{−ik·r}, of a real field Re[X e^{ik·r}].

    Shapes (..., N, 3), (N, 2) in lattice constants and (2,) in their inverse give (..., 3). Other waves leak in where
    the sheet does not hold this one. Where −k is k (at k = 0, in the middle of the zone's sides) it is twice as large.
    """
    phases = np.exp(-1j * rest @ np.asarray(wavevector, dtype=float))
    return 2 / len(rest) * np.einsum("...nc,n->...c", field, phases)


def in_frame(field: FieldOrWave, wavevector: ArrayLike) -> FieldOrWave:
    """(…, 3) of u, v, φ as p along a wave vector, q along ẑ × k, φ."""
    k = np.asarray(wavevector, dtype=float)
    x, y = k / (np.linalg.norm(k) or 1.0)
    return field @ np.array([[x, -y, 0], [y, x, 0], [0, 0, 1]])


def fields_of(particles: Any, moved: str = "displacement", turned: str = "rotation") -> Floats:
    """Fields (T, N, 3) of u, v, φ of the snapshots of a run, in D0, or by other names their rates."""
    return np.concatenate([particles.stack(moved), particles.stack(turned)[..., None]], axis=-1)


def carrier(sheet: Sheet, field: Floats, rate: Floats) -> Floats:
    """The wave vector (2,) of the strongest wave in an initial field, in the first zone, upwards (ky > 0)."""
    power = sum(np.sum(np.abs(sheet.shares(part)) ** 2, axis=-1) for part in (field, rate))
    images = _images(sheet.wavevectors[np.unravel_index(np.argmax(power), power.shape)])
    found = np.round(images[np.argmin(np.round(np.linalg.norm(images, axis=1), 9))], 12)  # a zero may be 1e-17
    return (found if (found[1], found[0]) >= (0, 0) else -found) + 0.0  # no −0


def _images(wavevectors: Floats) -> Floats:
    """Wave vectors (..., 9, 2) that differ from these (..., 2) by a reciprocal lattice vector, with the shortest."""
    apart = wavevectors @ np.linalg.inv(RECIPROCAL)
    around = np.indices((3, 3)).reshape(2, -1).T - 1
    return ((apart - np.round(apart))[..., None, :] + around) @ RECIPROCAL


@dataclass(frozen=True)
class Comparison:
    """Snapshots of a run and the theory of them, fields (T, N, 3) of (u, v, Rθ) in D0; second is a y2."""

    sheet: Sheet
    amplitude: float
    wavevector: Floats
    tau: Floats
    run: Floats
    linear: Floats
    second: Floats

    @property
    def beyond(self) -> Floats:
        """What of the run is not linear, run − y1: its second order, and all higher ones."""
        return self.run - self.linear

    def around(self, field: Floats, *multiples: int) -> Floats:
        """The part of a field at wave vectors nearer to ±mk, with m of the multiples, than with another m of 0 to 3."""
        centres = [[m * self.wavevector, -m * self.wavevector] for m in range(4)]
        images = _images(self.sheet.wavevectors[None, None] - np.array(centres)[:, :, None, None])
        nearest = np.argmin(np.round(np.linalg.norm(images, axis=-1).min(axis=(1, -1)), 9), axis=0)
        return self.sheet.field(self.sheet.shares(field) * np.isin(nearest, multiples)[..., None])


def compare(record: Record) -> Comparison:
    """Predict the snapshots of a run from the first.

    Raises ValueError for a run that the theory does not hold (`refuse`), or whose snapshots do not tell all of the
    field; `GranularError` where there are none.
    """
    refuse(record)
    particles = record.particles()
    sphere, shape = record.scene.sphere, record.scene.shape
    if len(particles.tau) < 2:
        raise ValueError(f"{len(particles.tau)} snapshots; the theory starts from the first and predicts the others")
    fields, rates = fields_of(particles), fields_of(particles, "velocity", "spin")
    if np.isnan(fields[..., 2]).any():
        raise ValueError("the angles are not in the snapshots; run with effects.tracking = true")
    sheet = Sheet(shape.rows, shape.columns, sphere.poisson_ratio, SOLID_SPHERE / (1 - sphere.overlap_ratio))
    if not np.allclose(particles.rest / (2 * (1 - sphere.overlap_ratio)), sheet.rest, rtol=0, atol=1e-6):
        raise ValueError("the spheres at rest are not where this theory has them, row by row")
    # Of a run to a tolerance the snapshots are of the finest step, which their own scene says
    linear, second = evolve(sheet, fields[0], rates[0], particles.tau, timestep=particles.scene.time.step)
    amplitude, wavevector = record.scene.wave.amplitude, carrier(sheet, fields[0], rates[0])
    return Comparison(sheet, amplitude, wavevector, particles.tau, fields, linear, amplitude * second)


def refuse(record: Record) -> None:
    """ValueError for a run whose lattice or contacts are not those of the theory, which names them."""
    physics = physics_of(record)
    present = sorted(physics.beyond_the_paper & {"damping", "incremental", "opening", "sliding"})
    present += [f"no {name}" for name in ("shear", "rotation") if not getattr(physics, name)]
    present += ["compression of the contacts at rest"] if physics.prestress else []
    present += ["rows held at the ends"] if record.scene.shape.ends != "periodic" else []
    if present:
        raise ValueError(f"{', '.join(present)}: the theory of sheets leaves that out")


def relative(estimate: Floats, reference: Floats, axis: tuple[int, ...] | None = None) -> Floats:
    """‖estimate − reference‖/‖reference‖ over the axes, nan where the reference is zero."""
    off, norm = (np.sqrt(np.sum(part**2, axis=axis)) for part in (estimate - reference, reference))
    return np.divide(off, norm, out=np.full_like(norm, np.nan), where=norm > 0)


def table(c: Comparison) -> str:
    """Errors of first and second order, and the second-order field by wave number, over all spheres and snapshots."""
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
    """Maps of y1, run − y1 and a y2 at a snapshot, of the component largest in theory; below, the errors over time."""
    fields = [in_frame(f[snapshot], c.wavevector) for f in (c.linear, c.beyond, c.second)]
    first, second = (int(np.argmax(np.linalg.norm(fields[which], axis=0))) for which in (0, 2))
    scales = np.abs(fields[0][:, first]).max(), np.abs([f[:, second] for f in fields[1:]]).max()
    tall = c.sheet.rows * ROW / c.sheet.columns
    height = 2.8 * float(np.clip(tall, 0.5, 2.0)) + 1.3
    figure = Figure(figsize=(9.5, height + 2.6), layout="constrained")
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
        ("of the run: $y_1$", "k:", c.linear, c.run),
        ("of the run: $y_1 + a y_2$", "k--", c.linear + c.second, c.run),
        ("of run − $y_1$: $a y_2$", "C0-", c.second, c.beyond),
        ("the same, around 0 and 2k", "C1-.", c.around(c.second, 0, 2), c.around(c.beyond, 0, 2)),
    ):
        axes.semilogy(c.tau[1:], relative(theory, run, (1, 2))[1:], style, label=label)
    axes.axvline(c.tau[snapshot], color="grey", linewidth=0.8)
    axes.set(xlabel=r"time $\tau$ (grey: that of the maps)", ylabel="relative error")
    below.legend(loc="outside right center", frameon=False, fontsize="small")
    k = f"k = ({c.wavevector[0]:.3g}, {c.wavevector[1]:.3g}) per lattice constant"
    above.suptitle(rf"LAMMPS and theory, $a = D_0/\Delta_0$ = {c.amplitude:g}, {k}, $\tau$ = {c.tau[snapshot]:g}")
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table and draw the figure into a file; returns the exit status."""
    options = parser(__doc__, "figures/sheets.png")
    options.add_argument("run", metavar="RUN", help="run folder with snapshots of all spheres")
    options.add_argument("--tau", type=float, default=np.inf, help="draw the snapshot nearest to it (default: last)")
    chosen = options.parse_args(arguments)
    try:
        comparison = compare(load(chosen.run))
    except GranularError as error:  # which names the folder
        raise SystemExit(str(error)) from error
    except ValueError as error:
        raise SystemExit(f"{chosen.run}: {error}") from error
    print(table(comparison))
    nearest = np.argmin(np.abs(comparison.tau - min(chosen.tau, comparison.tau[-1])))
    save(draw(comparison, int(nearest)), chosen.output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
