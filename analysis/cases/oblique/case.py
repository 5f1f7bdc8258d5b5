"""Second harmonic of plane waves of any direction, from snapshots, compared with the general formula.

    granular-analysis oblique SWEEP... [-o FILE]

Each SWEEP is the folder of a sweep over mode and direction (``granular-lmp sweep``) with snapshots of all spheres, and
over two time steps h and h/2 for Richardson's extrapolation; ``make waves`` makes one.

The displacements of all spheres are projected on twice the wave vector of the run, which removes the fundamental:

    X(τ) = (2/N) Σ u(r, τ) e^{−2ik·r}        of the field Re[X e^{2ik·r}]

Theory is `granular_analysis.theory.second_order`, in LAMMPS's contact geometry. If the wave is symmetric under a mirror
(along y and x), only the component along k is driven; in other directions a wave of any mode drives all three: p along
k, q across k, and φ.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from cases.fields import component, fields_of, in_frame, rest_of
from cases.pairs import by_wave
from cases.runner import script
from granular_analysis.measure.norms import relative_error
from granular_analysis.plotting import page
from granular_analysis.theory.bloch import branch_index, in_plane, wavevector_of
from granular_analysis.theory.catalogue import HELD as WALLS
from granular_analysis.theory.catalogue import HOLDS, JKR
from granular_analysis.theory.choice import traits_of, wave_of
from granular_analysis.theory.second_order import Mixed, branch_of
from granular_analysis.theory.wave import Wave
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
HELD = HOLDS["second-order"] - WALLS - {JKR}  # traits of a run that the general formula holds
SILENT = 1e-3  # share of the largest component below which a component is zero by symmetry
BOUND = 1e-2  # line in the figure: relative errors should stay below it
# Marker and dashes distinguish the components without colour
COMPONENTS = {"p": ("black", "o", "-"), "q": ("C3", "s", "--"), "phi": ("C0", "^", "-.")}
AXES = (r"$\Gamma$K ($x$)", r"$\Gamma$M", r"$\Gamma$K", r"$\Gamma$M ($y$)")  # every 30 degrees
LABELS = {"p": "$p$, along $k$", "q": "$q$, across $k$", "phi": r"$\varphi = R\theta$"}


@dataclass(frozen=True)
class Point:
    """One wave: X(τ) of the run and of theory, (T, 3) complex for p, q, φ, in D0."""

    mode: str
    wavenumber: float
    direction: float
    tau: Floats
    run: Complexes
    theory: Complexes

    @property
    def error(self) -> float:
        """Return the relative L2 error of all components together."""
        return relative_error(_reals(self.run), _reals(self.theory))

    @property
    def strength(self) -> Floats:
        """Return the root mean square over τ of |X| for p, q, φ in the run, (3,)."""
        return strength(self.run)


Measured = tuple[Sequence[Point], Sequence[Record]]  # points of sweeps, and their runs


def _reals(wave: Complexes) -> Floats:
    """Return real and imaginary parts (T, 3, 2) of complex (T, 3)."""
    return np.stack([wave.real, wave.imag], axis=-1)


def strength(wave: Complexes) -> Floats:
    """Return the root mean square over time of |X| (..., T, 3)."""
    return np.sqrt(np.mean(np.abs(wave) ** 2, axis=-2))


def second_harmonic(record: Record) -> tuple[Floats, Complexes]:
    """Return the times (T,) and X(τ) (T, 3) for p, q, φ, from the snapshots of a run.

    Raises ValueError if 2k and −2k are the same wave vector of the lattice: X and its conjugate are then not separable.
    """
    particles, scene = record.snapshots(), record.scene
    k = wavevector_of(scene.wavenumber, scene.direction)
    rest = rest_of(particles)
    rest = rest - rest[scene.shape.centre_row * scene.shape.columns + scene.shape.columns // 2]
    if np.allclose(np.exp(4j * rest @ k), 1, atol=1e-6):
        raise ValueError("2k is half a reciprocal lattice vector, so its wave has no direction")
    return particles.tau, in_frame(component(fields_of(particles), rest, 2 * k), k)


def predicted(wave: Wave, tau: Floats) -> Complexes:
    """Return X(τ) (T, 3) for p, q, φ, by theory."""
    mode = wave.mode
    return predicted_along([mode.direction], mode.wavenumber, wave, tau)[0]


def predicted_along(angles: ArrayLike, wavenumber: float, wave: Wave, tau: Floats) -> Complexes:
    """Return X(τ) (A, T, 3) for p, q, φ, by theory, for another wave number and other directions (A,), in degrees."""
    k = np.array([[wavevector_of(wavenumber, angle)] for angle in np.asarray(angles, dtype=float)])
    one = branch_of(wave.crystal, k, branch_index(wave.mode.name, k, wave.contact))
    field = in_plane(Mixed(wave.crystal, one, one).signal(tau))
    return in_frame(0.5 * wave.amplitude * np.exp(2j * wave.phase) * field, k)


def refusal(record: Record) -> str | None:
    """Return the reason why a run is refused, or None."""
    left_out = sorted(traits_of(record) - HELD)
    return f"the general formula leaves out {', '.join(left_out)}" if left_out else None


def points(records: Iterable[Record]) -> list[Point]:
    """Return a point for each wave; two runs with steps h and h/2 are extrapolated, (4·fine − coarse)/3.

    Raises ValueError for a run that `refusal` refuses, and for runs of one wave that are not such a pair.
    """
    runs = list(records)
    for record in runs:
        if reason := refusal(record):
            raise ValueError(f"{record.folder}: {reason}")
    return sorted(map(_point, by_wave(runs)), key=lambda each: (each.mode, each.direction))


def _point(runs: list[Record]) -> Point:
    scene = runs[0].scene
    mode, wavenumber, direction = scene.require_wave().mode, scene.wavenumber, scene.direction
    (tau, wave), *coarse = (second_harmonic(record) for record in runs)
    for times, rougher in coarse:
        if len(times) != len(tau):
            raise ValueError(f"{mode} at {direction:.5g} degrees: {len(times)} and {len(tau)} snapshots; must be equal")
        wave = (4 * wave - rougher) / 3
    return Point(mode, wavenumber, direction, tau, wave, predicted(wave_of(runs[0]), tau))


def table(runs: Measured) -> str:
    """Return a line for each wave: strength of its second harmonic, and relative error of theory."""
    made, _ = runs
    lines = [f"{'mode':5}{'direction':>10}{'xi':>9}{'p':>11}{'q':>11}{'phi':>11}   rms of X in D0, and its error"]
    for each in made:
        sizes = "".join(
            f"{'0' if size < SILENT * each.strength.max() else format(size, '.3e'):>11}" for size in each.strength
        )
        lines.append(f"{each.mode:5}{each.direction:10.2f}{each.wavenumber:9.4f}{sizes}{each.error:11.1e}")
    errors = [each.error for each in made]
    lines.append(f"relative error: median {np.median(errors):.1e}, largest {max(errors):.1e}")
    return "\n".join(lines)


def draw(runs: Measured) -> Figure:
    """Return the figure: strength of p, q, φ at 2k over direction, of runs and theory; below, the error of each run.

    The lines are theory at the mean wave number; the wave number of a run is the nearest one that fits its cell.
    """
    made, records = runs
    names = [name for name in ("TR", "RT", "L") if any(each.mode == name for each in made)]
    figure = page(4.8)
    panels = figure.subplots(2, len(names), sharex=True, sharey="row", squeeze=False, height_ratios=(2, 1))
    amplitude, wavenumber = records[0].scene.amplitude, float(np.mean([each.wavenumber for each in made]))
    lowest, highest = (limit(each.error for each in made) for limit in (min, max))
    for name, above, below in zip(names, *panels, strict=True):
        these = [each for each in made if each.mode == name]
        _strengths(above, these, wavenumber, _wave(records, name))
        above.set_title(name)
        below.semilogy([each.direction for each in these], [each.error for each in these], "ko", markersize=3.5)
        below.axhline(BOUND, color="black", linewidth=0.8, linestyle=":")
        below.set(xlabel="direction (degrees)", ylim=(min(1e-5, lowest / 2), max(3e-2, 2 * highest)))
        below.set_xticks(
            range(0, 91, 30), [f"{angle}\n{axis}" for angle, axis in zip(range(0, 91, 30), AXES, strict=True)]
        )
    panels[0, 0].set(ylabel="second harmonic,\nrms over the run ($D_0$)")
    panels[1, 0].set(ylabel="relative error")
    panels[1, 0].text(0.02, BOUND * 1.15, f"{BOUND:.0%}", transform=panels[1, 0].get_yaxis_transform())
    entries = panels[0, 0].get_legend_handles_labels()
    figure.legend(*entries, loc="outside lower center", ncols=3)
    figure.suptitle(
        "plane waves in LAMMPS"
        + (", " if len(names) > 1 else "\n")
        + rf"$\xi$ = {wavenumber:.3g}, $D_0$ = {amplitude:g} $\Delta_0$, $\tau \leq$ {made[0].tau[-1]:g}"
    )
    return figure


def _wave(records: Sequence[Record], name: str) -> Wave:
    """Return the wave of the first oblique run of a mode; along an axis an L wave has no rotation."""
    these = [wave_of(record) for record in records if record.scene.require_wave().mode == name]
    return next((wave for wave in these if wave.contact.rotation), these[0])


def _strengths(axes: Axes, these: Sequence[Point], wavenumber: float, wave: Wave) -> None:
    directions = [each.direction for each in these]
    angles = np.linspace(min(0.0, *directions), max(90.0, *directions), 181)  # a line even for a single direction
    theory = strength(predicted_along(angles, wavenumber, wave, these[0].tau))
    largest = theory.max()
    for index, (name, (colour, marker, line)) in enumerate(COMPONENTS.items()):
        sizes = theory[:, index]
        axes.semilogy(
            angles, np.where(sizes > SILENT * largest, sizes, np.nan), line, color=colour, linewidth=1,
            label=f"{LABELS[name]}: theory",
        )  # fmt: skip
        seen = [(each.direction, each.strength[index]) for each in these if each.strength[index] > SILENT * largest]
        axes.semilogy(*np.reshape(seen, (-1, 2)).T, marker, color=colour, markersize=4, label="LAMMPS")


def measure(records: Sequence[Record]) -> Measured:
    """Return the points of runs, and the runs."""
    return points(records), records


main = script(__name__, measure, table, draw, ("sweeps", "sweeps over wave.mode and wave.direction"))
