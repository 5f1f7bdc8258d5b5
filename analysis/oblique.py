"""The second harmonic of plane waves over their direction, in LAMMPS and by the general formula.

    python -m analysis.oblique SWEEP... [-o FILE]

Each SWEEP is the folder of a sweep over mode and direction (``granular-lmp sweep``) whose runs hold snapshots of all
spheres, over two time steps h and h/2 as well if Richardson's extrapolation is wanted; ``make waves`` makes one. The
displacements of all spheres are projected on twice the wave vector of the run, which leaves nothing of the fundamental:

    X(τ) = (2/N) Σ u(r, τ) e^{−2ik·r}        of the field Re[X e^{2ik·r}]

Theory is `directions.doubled_wave`, in LAMMPS's contact geometry. Where a mirror holds the wave (along y and x) only
the component along k is driven; in between a wave of any mode drives all three, p and q along and across k, and φ.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isclose

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis import directions
from analysis.catalogue import missing
from analysis.effects import sweep
from analysis.norms import relative_error
from analysis.plotting import parser, save, start
from analysis.quasilinear import component, in_frame
from analysis.sheets import fields_of, rest_of
from analysis.theories import Physics, physics_of
from granular_lmp.runs.record import GranularError, Record

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

BOUND = 1e-2  # drawn: the relative error is to stay below it
SILENT = 1e-3  # of the largest component: less is zero by symmetry
# Told apart by marker and dashes without colour
COMPONENTS = {"p": ("black", "o", "-"), "q": ("tab:red", "s", "--"), "phi": ("tab:blue", "^", "-.")}
AXES = (r"$\Gamma$K ($x$)", r"$\Gamma$M", r"$\Gamma$K", r"$\Gamma$M ($y$)")  # every 30 degrees
LABELS = {"p": "$p$, along $k$", "q": "$q$, across $k$", "phi": r"$\varphi = R\theta$"}


@dataclass(frozen=True)
class Point:
    """One wave: X(τ) of the run and of theory, (T, 3) complex, components p, q, φ, in D0."""

    mode: str
    wavenumber: float
    direction: float
    tau: Floats
    run: Complexes
    theory: Complexes

    @property
    def error(self) -> float:
        """Relative L2 error of all components together."""
        return relative_error(_reals(self.run), _reals(self.theory))

    @property
    def strength(self) -> Floats:
        """Root mean square over the run of |X| of p, q, φ in the run, (3,)."""
        return strength(self.run)


def _reals(wave: Complexes) -> Floats:
    """Real and imaginary parts of (T, 3), (T, 3, 2)."""
    return np.stack([wave.real, wave.imag], axis=-1)


def strength(wave: Complexes) -> Floats:
    """Root mean square over time of the magnitudes of (T, 3)."""
    return np.sqrt(np.mean(np.abs(wave) ** 2, axis=0))


def second_harmonic(record: Record) -> tuple[Floats, Complexes]:
    """Times (T,) and X(τ) (T, 3) of p, q, φ of a run, from its snapshots.

    Raises ValueError where 2k and −2k are one wave vector of the lattice: X is then not told from its conjugate.
    """
    particles, scene = record.snapshots(), record.scene
    k = directions.wavevector_of(scene.wavenumber, scene.direction)
    rest = rest_of(particles)
    rest = rest - rest[scene.shape.centre_row * scene.shape.columns + scene.shape.columns // 2]
    if np.allclose(np.exp(4j * rest @ k), 1, atol=1e-6):
        raise ValueError("2k is half a wave vector of the reciprocal lattice: its wave has no direction")
    return particles.tau, in_frame(component(fields_of(particles), rest, 2 * k), k)


def predicted(
    mode: str, wavenumber: float, direction: float, amplitude: float, tau: Floats, physics: Physics, phase: float = 0.0
) -> Complexes:
    """X(τ) (T, 3) of p, q, φ by theory."""
    k, contacts = directions.wavevector_of(wavenumber, direction), physics.springs
    branch = int(directions.branch_index(mode, k, physics.poisson_ratio, **contacts))
    wave = directions.doubled_wave(
        k, branch, amplitude, tau, poisson_ratio=physics.poisson_ratio, phase=phase, **contacts
    )
    return in_frame(wave, k)


def refusal(record: Record) -> str | None:
    """Why a run is not one of these, or None."""
    left_out = missing("analysis.oblique", physics_of(record).traits)
    return f"the general formula leaves out {', '.join(left_out)}" if left_out else None


def points(records: Iterable[Record]) -> list[Point]:
    """One point a wave, of two runs with steps h and h/2 the extrapolation (4·fine − coarse)/3.

    Raises ValueError for a run that is none of these (`refusal`), and for other runs of one wave.
    """
    waves: dict[tuple[str, float, float, float, float], list[Record]] = {}
    for record in records:
        if reason := refusal(record):
            raise ValueError(f"{record.folder}: {reason}")
        scene = record.scene
        wave = scene.wave
        key = (wave.mode, scene.wavenumber, scene.direction, wave.amplitude, wave.phase)
        waves.setdefault(key, []).append(record)
    return sorted((_point(runs) for runs in waves.values()), key=lambda each: (each.mode, each.direction))


def _point(runs: list[Record]) -> Point:
    scene = runs[0].scene
    mode, wavenumber, direction = scene.wave.mode, scene.wavenumber, scene.direction
    runs = sorted(runs, key=lambda record: record.scene.time.step)
    (tau, wave), *coarse = (second_harmonic(record) for record in runs)
    steps = [record.scene.time.step for record in runs]
    if len(runs) > 2 or (coarse and not (isclose(steps[1], 2 * steps[0]) and len(coarse[0][0]) == len(tau))):
        raise ValueError(f"{mode} at {direction:.5g} degrees: {len(runs)} runs that are no pair of steps h and h/2")
    for _, rougher in coarse:
        wave = (4 * wave - rougher) / 3
    theory = predicted(
        mode, wavenumber, direction, scene.wave.amplitude, tau, physics_of(runs[0]), phase=scene.wave.phase
    )
    return Point(mode, wavenumber, direction, tau, wave, theory)


def table(made: Sequence[Point]) -> str:
    """Each wave: how large its second harmonic is, and the relative error of theory."""
    lines = [f"{'mode':5}{'direction':>10}{'xi':>9}{'p':>11}{'q':>11}{'phi':>11}   rms of X in D0, and its error"]
    for each in made:
        sizes = "".join(
            f"{'0' if size < SILENT * each.strength.max() else format(size, '.3e'):>11}" for size in each.strength
        )
        lines.append(f"{each.mode:5}{each.direction:10.2f}{each.wavenumber:9.4f}{sizes}{each.error:11.1e}")
    errors = [each.error for each in made]
    lines.append(f"relative error: median {np.median(errors):.1e}, largest {max(errors):.1e}")
    return "\n".join(lines)


def draw(made: Sequence[Point], records: Sequence[Record]) -> Figure:
    """The strength of p, q, φ at 2k over the direction for each mode, runs on theory, and below the error of each run.

    The lines are theory at the mean wave number; that of each run is as near to it as its cell allows.
    """
    names = [name for name in ("TR", "RT", "L") if any(each.mode == name for each in made)]
    figure = Figure(figsize=(1.2 + 3.4 * len(names), 6.0), layout="constrained")
    panels = figure.subplots(2, len(names), sharex=True, sharey="row", squeeze=False, height_ratios=(2, 1))
    amplitude, wavenumber = records[0].scene.wave.amplitude, float(np.mean([each.wavenumber for each in made]))
    lowest, highest = (limit(each.error for each in made) for limit in (min, max))
    for name, above, below in zip(names, *panels, strict=True):
        these = [each for each in made if each.mode == name]
        _strengths(above, these, wavenumber, amplitude, _physics(records, name))
        above.set_title(name, fontsize="medium")
        below.semilogy([each.direction for each in these], [each.error for each in these], "ko", markersize=3.5)
        below.axhline(BOUND, color="black", linewidth=0.8, linestyle=":")
        below.set(xlabel="direction of the wave (degrees)", ylim=(min(1e-5, lowest / 2), max(3e-2, 2 * highest)))
        below.set_xticks(
            range(0, 91, 30), [rf"{angle}, {axis}" for angle, axis in zip(range(0, 91, 30), AXES, strict=True)]
        )
    panels[0, 0].set(ylabel="second harmonic, rms over the run ($D_0$)")
    panels[1, 0].set(ylabel="relative error")
    panels[1, 0].text(0.02, BOUND * 1.15, f"{BOUND:.0%}", transform=panels[1, 0].get_yaxis_transform())
    entries = panels[0, 0].get_legend_handles_labels()
    figure.legend(*entries, loc="outside lower center", ncols=2 * len(names), frameon=False)
    figure.suptitle(
        "plane waves in LAMMPS"
        + (", " if len(names) > 1 else "\n")
        + rf"$\xi$ = {wavenumber:.3g}, $D_0$ = {amplitude:g} $\Delta_0$, $\tau \leq$ {made[0].tau[-1]:g}"
    )
    return figure


def _physics(records: Sequence[Record], name: str) -> Physics:
    """Of the first oblique run of a mode: along an axis an L wave runs without rotation."""
    these = [record for record in records if record.scene.wave.mode == name]
    return physics_of(next((record for record in these if physics_of(record).rotation), these[0]))


def _strengths(axes: Axes, these: Sequence[Point], wavenumber: float, amplitude: float, physics: Physics) -> None:
    angles = np.linspace(min(each.direction for each in these), max(each.direction for each in these), 181)
    tau = these[0].tau
    theory = [strength(predicted(these[0].mode, wavenumber, angle, amplitude, tau, physics)) for angle in angles]
    largest = np.max(theory)
    for index, (name, (colour, marker, line)) in enumerate(COMPONENTS.items()):
        sizes = np.array(theory)[:, index]
        axes.semilogy(
            angles, np.where(sizes > SILENT * largest, sizes, np.nan), line, color=colour, linewidth=1,
            label=f"{LABELS[name]}: theory",
        )  # fmt: skip
        seen = [(each.direction, each.strength[index]) for each in these if each.strength[index] > SILENT * largest]
        axes.semilogy(*np.reshape(seen, (-1, 2)).T, marker, color=colour, markersize=4, label="LAMMPS")


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table and draw the figure into a file; returns the exit status."""
    options = parser(__doc__, "figures/oblique.png")
    options.add_argument("sweeps", nargs="+", metavar="SWEEP", help="folders of sweeps over wave.mode, wave.direction")
    chosen = options.parse_args(arguments)
    records = [record for folder in chosen.sweeps for record in sweep(folder)]
    if not records:
        options.error(f"{chosen.sweeps[0]}: no sweep with finished runs")
    try:
        made = points(records)
    except (ValueError, GranularError) as error:
        options.error(str(error))
    print(table(made))
    save(draw(made, records), chosen.output)
    return 0


if __name__ == "__main__":
    start(main)
