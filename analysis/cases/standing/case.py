"""Standing wave in a run, as a transient grating excites it, compared with theory.

    granular-analysis standing RUN [-o FILE]

RUN is a run of form "standing" with snapshots of all spheres. The script prints relative L2 errors of the theory over
all rows and times before echoes of the walls arrive. The panels show the wave over the rows at three times, one in each
third of the run, when p_SH is largest; dots are the run, lines theory; below are the differences. For L the second
harmonic of the run is p minus the linear wave. This also contains third-order changes of the fundamental, so the
relative error is of order a; for TR and RT it is of order a². With the incremental shear law LAMMPS's own error is of
first order in the step and soon exceeds this: halve the step and compare.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike, NDArray

from cases.rows import Rows, echo, load_form
from cases.runner import script
from granular_analysis.measure.norms import relative_error
from granular_analysis.plotting import letter, page
from granular_analysis.theory.choice import wave_of
from granular_analysis.theory.second_order import Mixed, started, together
from granular_analysis.theory.wave import Wave
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
HARMONIC = "second harmonic"
COLOURS = ("C0", "C1", "C2")
NAMES = {"p": "$p$", "q": "$q$", "phi": r"$\varphi$"}


def standing(wave: Wave, tau: ArrayLike, row: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return p, q, φ in D0, to second order, of a standing wave along y that starts at rest at τ = 0.

        q = Q cos θ cos Ωτ,  φ = −f sin θ cos Ωτ (TR, RT)  or  p = cos θ cos Ωτ (L),    θ = ξn + phase

    It is the sum of two waves of half the amplitude, ±Ω. Each generates a second harmonic, and both together a wave of
    frequency 0. p_SH = Re[X e^{2iθ}] vanishes where cos θ = 0 and where sin θ = 0, at the nodes *and* the antinodes of
    the fundamental. Relative errors of p (TR, RT), q and φ fall as a².

    Parameters
    ----------
    wave : running wave along y, with the amplitude of the standing wave.
    tau, row : times and rows n, of shapes that broadcast.
    """
    times, mode = np.asarray(tau, dtype=float), wave.mode
    theta = mode.wavenumber * np.asarray(row, dtype=float) + wave.phase
    one = wave.linear
    both = started(wave.crystal, one.wavevector, one.shape, 0 * one.shape)
    first, second = zip(*product(both, both), strict=True)
    pairs = Mixed(wave.crystal, together(first), together(second))
    field = 0.5 * wave.amplitude * pairs.signal(times[..., None]).sum(axis=-3)
    swing = np.cos(mode.frequency * times)
    p = mode.p * np.cos(theta) * swing + np.real(wave.framed(field)[..., 0] * np.exp(2j * theta))
    return p, mode.q * np.cos(theta) * swing, -mode.f * np.sin(theta) * swing


@dataclass(frozen=True)
class Comparison:
    """A run and its theory: motion and numbers n of the rows, a mask (T, rows) without echoes, and the wave."""

    wave: Wave
    run: Rows
    n: NDArray[np.intp]
    clean: NDArray[np.bool_]

    def theory(self, tau: ArrayLike, n: ArrayLike) -> dict[str, Floats]:
        """Return p, q, φ, and the second harmonic, from `standing`."""
        wave = self.wave
        p, q, phi = standing(wave, tau, n)
        return {"p": p, "q": q, "phi": phi, HARMONIC: p - self._linear(tau, n)}

    def measured(self) -> dict[str, Floats]:
        """Return p, q, φ, and the second harmonic, of the run, (T, rows)."""
        run = self.run
        return {"p": run.p, "q": run.q, "phi": run.phi, HARMONIC: run.p - self._linear(run.tau[:, None], self.n)}

    def _linear(self, tau: ArrayLike, n: ArrayLike) -> Floats:
        theta = self.wave.mode.wavenumber * np.asarray(n) + self.wave.phase
        return self.wave.mode.p * np.cos(theta) * np.cos(self.wave.mode.frequency * np.asarray(tau))

    def errors(self) -> dict[str, float]:
        """Return relative L2 errors, without echoes, for the components that move and for the second harmonic."""
        names = ["p"] if self.wave.mode.name == "L" else ["q", "phi"] if self.wave.mode.f else ["q"]
        theory, run = self.theory(self.run.tau[:, None], self.n), self.measured()
        return {name: relative_error(theory[name][self.clean], run[name][self.clean]) for name in [*names, HARMONIC]}


def compare(record: Record, rows: Rows) -> Comparison:
    """Return a run with its theory.

    Raises ValueError if p_SH is zero at every row, as for ξ = π/2 and phase 0, and if echoes reach all rows.
    """
    wave, scene = wave_of(record), record.scene
    xi = wave.mode.wavenumber
    n = np.arange(rows.count) - scene.shape.centre_row
    # This limit is far above the rounding of ξn, and far below a measurable second harmonic
    if np.max(np.abs(np.sin(2 * (xi * n + wave.phase)))) < 1e-6:
        raise ValueError(f"no second harmonic at any row: xi = {xi:g} and phase = {wave.phase:g}")
    walls = np.minimum(np.arange(rows.count), np.arange(rows.count)[::-1])
    fixed = scene.shape.ends == "fixed"
    clean = (rows.tau[:, None] < echo(walls)) if fixed else np.ones(rows.p.shape, dtype=bool)
    if not clean[rows.tau > 0].any():
        raise ValueError(f"{rows.count} rows between fixed ends or the snapshots are too few: echoes reach all rows")
    return Comparison(wave, rows, n, clean)


def draw(found: Comparison) -> Figure:
    """Return the figure: fundamental and second harmonic over the rows at three times; below, the differences."""
    figure = page(5.8)
    panels = list(figure.subplots(3, 1, sharex=True, height_ratios=[3, 3, 2]))
    fundamental = "p" if found.wave.mode.name == "L" else "q"
    _over_rows(panels, found, [fundamental, HARMONIC])
    errors = ",  ".join(f"{NAMES.get(key, key)} {value:.1e}" for key, value in found.errors().items())
    figure.suptitle(
        rf"standing {found.wave.mode.name}, $\xi$ = {found.wave.mode.wavenumber:.4g}, $a$ = {found.wave.amplitude:g}"
        f"\nrelative errors: {errors}",
    )
    letter(panels)
    labels = {"p": "$p = v/D_0$", "q": "$q = -u/D_0$"}[fundamental], r"$p_{\rm SH}$", r"|error| of $p_{\rm SH}$"
    for axes, label in zip(panels, labels, strict=True):
        axes.margins(x=0.01)
        axes.set_ylabel(label)
    for axes in panels[:2]:
        axes.ticklabel_format(axis="y", scilimits=(-2, 3))
    panels[2].set_xlabel("row $n$ (grey: nodes; dotted: antinodes)")
    panels[2].xaxis.set_major_locator(MaxNLocator(integer=True))
    # Outside the panels, where no curve is covered
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, title="dots: run, lines: theory")
    return figure


def _over_rows(panels: list[Axes], found: Comparison, names: list[str]) -> None:
    xi, tau, run = found.wave.mode.wavenumber, found.run.tau, found.measured()
    # Draws two wavelengths; with more the curves are too dense
    near = np.abs(found.n) <= np.ceil(2 * np.pi / xi)
    size = found.theory(tau, (np.pi / 4 - found.wave.phase) / xi)[HARMONIC]
    for third, sign, colour in zip(np.array_split(np.arange(len(tau)), 3), (1, -1, 1), COLOURS, strict=True):
        at = third[np.argmax(sign * size[third])]
        use = near & found.clean[at]
        if not use.any():
            continue
        n, fine = found.n[use], np.linspace(found.n[use][0], found.n[use][-1], 401)
        for axes, name in zip(panels, names, strict=False):
            axes.plot(fine, found.theory(tau[at], fine)[name], color=colour, linewidth=1.0)
            axes.plot(n, run[name][at, use], "o", color=colour, markersize=4, label=rf"$\tau$ = {tau[at]:.4g}")
        residual = np.abs(run[HARMONIC][at, use] - found.theory(tau[at], n)[HARMONIC])
        panels[2].semilogy(n, residual, "o-", color=colour, markersize=3, linewidth=0.5)
    ends = np.sort(xi * found.n[near][[0, -1]] + found.wave.phase) / (np.pi / 2)
    for quarter in range(int(np.ceil(ends[0])), int(np.floor(ends[1])) + 1):
        for axes in panels[:2]:
            place = (quarter * np.pi / 2 - found.wave.phase) / xi
            axes.axvline(place, color="silver", linestyle="-" if quarter % 2 else ":", linewidth=0.8, zorder=0)


def table(found: Comparison) -> str:
    """Return the relative errors, one a line."""
    return "\n".join(f"{name:16s} {size:.2e}" for name, size in found.errors().items())


def of_folder(folder: str) -> Comparison:
    """Return the comparison of a run folder."""
    return compare(*load_form(folder, "standing"))


main = script(__name__, of_folder, table, draw, ("folder", "run folder of a standing wave"), figure="grating.png")
