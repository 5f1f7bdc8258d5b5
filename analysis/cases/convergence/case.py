"""Accuracy of second order: the error of `second_harmonic.second_order` against the exact lattice as the wave shrinks.

    granular-analysis convergence [-o FILE]

prints a table of the relative L2 errors of p, q, φ over τ ≤ 120 at several rows, and draws them over the amplitude
a = D0/Δ0. Second order leaves a² out of q and φ, and of p where p is the wave (L). Out of the p of TR and RT it leaves
a³, where p itself is of order a. So the relative error of everything falls as a². What a wrong coefficient adds does
not fall with a: one percent in α or β stops every p of TR and RT at about one percent.

The slopes are fitted over a ≤ 0.1. At a = 0.2 the orders above bend the curves, most of all L at ξ = 0.802, whose
slope from 0.2 to 0.1 is 1.93; the last column shows it for every curve.

Not for a resonance or an antiresonance: near the former a²τ² takes the place of a², near the latter second order has
next to no p and `hierarchy` has the orders it takes. q and φ of L are zero in theory and lattice alike, and left out.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cases.runner import script
from granular_analysis.measure.norms import relative_error, slope
from granular_analysis.second_harmonic import Mode, ModeName, Ratios, mode, ratios, second_order
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.lattice import Floats, torus_trajectories
from granular_analysis.theory.neighbours import periodic_kernel, torus_phases

POISSON_RATIO = 0.17  # silica, the paper's spheres
TAU = np.linspace(0.0, 120.0, 241)
AMPLITUDES = (0.2, 0.1, 0.05, 0.025, 0.0125)
ASYMPTOTIC = AMPLITUDES[1:]  # for the fits
MODES: tuple[ModeName, ...] = ("L", "TR", "RT")
WAVENUMBERS = (0.802, 2.6)  # the paper's, and one past its resonance (1.476) and antiresonance (2.128)
ROWS = (0, 1, 7)
WAVES = tuple((name, xi) for name in MODES for xi in WAVENUMBERS)
COMPONENTS = ("p", "q", "φ")


@dataclass(frozen=True)
class Curve:
    """Relative L2 errors over time of one displacement of one wave at one row, for AMPLITUDES."""

    mode: ModeName
    wavenumber: float
    row: int
    component: str
    errors: tuple[float, ...]

    @property
    def slope(self) -> float:
        """Exponent of a, fitted over ASYMPTOTIC."""
        return slope(ASYMPTOTIC, self.errors[1:])

    @property
    def first_slope(self) -> float:
        """Exponent of a between the two largest amplitudes."""
        return slope(AMPLITUDES[:2], self.errors[:2])


def convergence(waves: Iterable[tuple[ModeName, float]] = WAVES, theory: Ratios | None = None) -> Iterator[Curve]:
    """Yield the curves of each wave (mode, ξ): of every row in ROWS, and of every displacement the wave has.

    theory : the constants put into the theory, those of the lattice unless given.
    """
    theory = theory or ratios(POISSON_RATIO)
    for name, wavenumber in waves:
        wave, exact = mode(name, wavenumber, theory), _exact(name, wavenumber)
        errors = [_errors(wave, theory, a, states / a) for a, states in zip(AMPLITUDES, exact, strict=True)]
        for row, component in errors[0]:
            yield Curve(name, wavenumber, row, component, tuple(e[row, component] for e in errors))


@cache  # the same for every theory
def _exact(name: ModeName, wavenumber: float) -> Floats:
    wave = mode(name, wavenumber, ratios(POISSON_RATIO))
    # rtol: the smallest reference is p of RT, 1e-5 at a=0.0125, with an error of 5e-6 to be resolved in it. With
    # 21 points the error is 5e-9 at a=0.2, and falls with the amplitude to the power of ten
    return torus_trajectories(wave, AMPLITUDES, Contact(POISSON_RATIO), TAU, points=21, rtol=5e-13)


def _errors(wave: Mode, theory: Ratios, amplitude: float, trajectory: Floats) -> dict[tuple[int, str], float]:
    """Relative error at each row and of each displacement that is not identically zero."""
    phases = torus_phases(trajectory.shape[-1])
    errors = {}
    for row in ROWS:
        exact = (trajectory @ periodic_kernel(wave.wavenumber * row - phases, phases.size)).T
        estimate = second_order(wave, theory, amplitude, TAU, row=row)
        for component, e, x in zip(COMPONENTS, estimate, exact, strict=True):
            if wave.name != "L" or component == "p":
                errors[row, component] = relative_error(e, x)
    return errors


def table(curves: Iterable[Curve]) -> str:
    """Text with one line per curve: its errors, its slope over a ≤ 0.1, its slope from 0.2 to 0.1."""
    lines = ["mode     ξ  row      " + "".join(f"  a={a:<7g}" for a in AMPLITUDES) + "   slope  (0.2→0.1)"]
    for c in curves:
        errors = "".join(f"  {e:.2e} " for e in c.errors)
        wave = f"{c.mode:4} {c.wavenumber:5.3f}  {c.row:3}   {c.component}"
        lines.append(f"{wave}  {errors}  {c.slope:6.3f}   {c.first_slope:6.3f}")
    return "\n".join(lines)


COLOURS = dict(zip(MODES, ("#000000", "#0072b2", "#d55e00"), strict=True))  # Okabe and Ito's, apart in grey as well
MARKERS = dict(zip(MODES, ("o", "s", "^"), strict=True))


def draw(curves: Iterable[Curve]) -> Figure:
    """Figure of the errors over a, a panel each for p, q, φ: a wave's worst row as a line, the others as a band."""
    figure = Figure(figsize=(10.0, 4.8), layout="constrained")
    panels = dict(zip(COMPONENTS, figure.subplots(1, 3, sharex=True, sharey=True), strict=True))
    by_wave: dict[tuple[str, ModeName, float], list[tuple[float, ...]]] = defaultdict(list)
    slopes: dict[str, list[float]] = defaultdict(list)
    for c in curves:
        by_wave[c.component, c.mode, c.wavenumber].append(c.errors)
        slopes[c.component].append(c.slope)
    waves: dict[tuple[ModeName, float], Line2D] = {}
    for (component, name, xi), errors in by_wave.items():
        panel, worst = panels[component], np.max(errors, axis=0)
        panel.fill_between(AMPLITUDES, np.min(errors, axis=0), worst, color=COLOURS[name], alpha=0.2, linewidth=0)
        waves[name, xi] = panel.plot(
            AMPLITUDES,
            worst,
            label=rf"{name}, $\xi$ = {xi:g}",
            color=COLOURS[name],
            linewidth=0.8,
            marker=MARKERS[name],
            markersize=5.5,
            fillstyle="full" if xi == WAVENUMBERS[0] else "none",
        )[0]
    ends = np.array([AMPLITUDES[-1], AMPLITUDES[0]])
    for component, panel in panels.items():
        fitted = f"{min(slopes[component]):.3f} to {max(slopes[component]):.3f}"
        (slope_2,) = panel.plot(ends, 0.5 * (ends / ends[1]) ** 2, color="grey", linestyle="--", label="slope 2")
        panel.set(xscale="log", yscale="log", xlabel=r"amplitude $a = D_0/\Delta_0$")
        panel.set_title(f"error of {component}: slopes {fitted}", fontsize="medium")
        panel.set_xticks(AMPLITUDES, [f"{a:g}" for a in AMPLITUDES])
        panel.minorticks_off()
        panel.grid(alpha=0.3, linewidth=0.5)
    panels["p"].set_ylabel(rf"relative $L_2$ error over $\tau \leq {TAU[-1]:g}$")
    figure.legend(
        handles=[*waves.values(), slope_2],
        title=f"line: worst of the rows {', '.join(map(str, ROWS))}; band: down to the best; "
        rf"slopes fitted over $a \leq {ASYMPTOTIC[0]:g}$",
        loc="outside lower center",
        ncols=7,
        frameon=False,
    )
    return figure


def measure() -> list[Curve]:
    """Return all curves."""
    return list(convergence())


main = script(__name__, measure, table, draw)
