"""Driven row in LAMMPS, compared with the steady waves of `cases.driven.waves`.

    granular-analysis driven RUN [-o FILE]

RUN is a run of form "driven" with snapshots of all spheres. The script fits 1, τ, and the harmonics 1 to 3 of Ω to the
motion of each row, with a Hann window over whole periods at the end of the run. It takes the rows that the slowest of
the waves has reached before, and that no echo of the far end reaches. It prints median deviations over these rows, and
draws the amplitudes over the rows.
"""

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from cases.driven.waves import beat_length, driven_amplitudes, slowest, static
from cases.rows import AIRY, Rows, amplitudes_at, echo, load_form
from cases.runner import script
from granular_analysis.plotting import page
from granular_analysis.theory.choice import wave_of
from granular_analysis.theory.wave import Wave
from granular_lmp.runs.record import Record

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
PERIODS = 5  # fewest periods in the window of the fit; Hann's side lobes then separate 1, Ω and 2Ω
PER_PERIOD = 8  # fewest snapshots in a period; the third harmonic needs 6
FEWEST_ROWS = 3
PART = 1 / 3  # share of the time after the ramp that is in the window


@dataclass(frozen=True)
class Comparison:
    """Amplitudes of a run and of theory over the rows n (N,), by name: fundamental, p at 2Ω, mean p."""

    wave: Wave
    n: NDArray[np.intp]
    run: dict[str, Complexes]
    theory: dict[str, Complexes]

    def deviations(self) -> dict[str, tuple[float, float]]:
        """Return medians over the rows of |X − X_theory|/|X_theory|, and of the same for the moduli of X."""
        return {name: _medians(self.run[name], theory) for name, theory in self.theory.items()}


def _medians(run: Complexes, theory: Complexes) -> tuple[float, float]:
    whole = np.abs(run - theory) / np.abs(theory)
    moduli = np.abs(np.abs(run) / np.abs(theory) - 1)
    return float(np.median(whole)), float(np.median(moduli))


def compare(record: Record, rows: Rows) -> Comparison:
    """Return the fitted amplitudes of a run with those of theory, in the rows and the window that the module defines.

    Raises ValueError for a run that is too short, or whose snapshots are too far apart.
    """
    scene, wave = record.scene, wave_of(record)
    linear = wave.mode
    period = 2 * np.pi / linear.frequency
    first, last = _window(rows.tau, scene.envelope.ramp, period)
    tau, velocity = rows.tau[first:], slowest(wave)
    distance = np.arange(rows.count - 1)
    # Rows that the Airy front of the slowest wave has reached, and that the echo of the held end has not
    reached = scene.envelope.ramp + (distance + AIRY * np.cbrt(distance)) / velocity < tau[0]
    quiet = int(scene.absorb.rows)
    # Quiet ends send no echo back, but the rows that absorb move differently
    echoed = distance >= rows.count - 1 - quiet if quiet else echo(2 * (rows.count - 1) - distance) <= last
    n = distance[reached & ~echoed & (distance > 0)]
    if len(n) < FEWEST_ROWS:
        raise ValueError(
            f"too short a run or strip: {len(n)} of {FEWEST_ROWS} rows are reached by the slowest wave ({velocity:.3g} "
            f"rows per tau, ramp {scene.envelope.ramp:g}) at tau = {tau[0]:.4g} and see no echo until {last:.4g}"
        )
    fundamental, second = driven_amplitudes(wave, n)
    harmonics = linear.frequency * np.arange(1, 4)
    means, p = amplitudes_at(tau, rows.p[first:, n], harmonics)
    if linear.name == "L":
        run, theory = {"p": p[0]}, {"p": fundamental[0]}
    else:
        run = {"q": amplitudes_at(tau, rows.q[first:, n], harmonics)[1][0]}
        theory = {"q": fundamental[1]}
        if wave.contact.turns:
            run["phi"] = amplitudes_at(tau, rows.phi[first:, n], harmonics)[1][0]
            theory["phi"] = fundamental[2]
    run["p at 2Ω"], theory["p at 2Ω"] = p[1], second
    # Quiet ends do not absorb a steady displacement, and a held end hinders it
    if not quiet and (linear.name == "L" or not wave.contact.incremental):
        run["mean p"], theory["mean p"] = means + 0j, static(wave, n) + 0j
    return Comparison(wave, n, run, theory)


def _window(tau: Floats, ramp: float, period: float) -> tuple[int, float]:
    """Return the first snapshot and the last τ of the window: whole periods in the last part of the run."""
    spacing = float(np.max(np.diff(tau))) if len(tau) > 1 else np.inf
    if spacing > period / PER_PERIOD * (1 + 1e-9):
        raise ValueError(f"snapshots every tau = {spacing:.4g} are too far apart: at most {period / PER_PERIOD:.4g}")
    count = max(PERIODS, int(PART * (tau[-1] - ramp) / period))
    begin = tau[-1] - count * period
    if begin <= ramp:
        raise ValueError(
            f"too short a run: tau = {tau[-1]:.4g} is not above {ramp + count * period:.4g}, the ramp ({ramp:g}) and "
            f"{count} periods of {period:.4g}"
        )
    return int(np.searchsorted(tau, begin, side="right")), float(tau[-1])


LINES = {"p": "C0", "q": "C0", "phi": "C1", "p at 2Ω": "C0", "mean p": "C1"}
LABELS = {"phi": r"$\varphi$", "p at 2Ω": r"$p$ at $2\Omega$", "mean p": "mean of $p$", "q": "$q$", "p": "$p$"}


def draw(found: Comparison) -> Figure:
    """Return the figure: moduli over the rows, of run and theory; below, the differences of the complex amplitudes."""
    figure = page(4.8)
    panels = figure.subplots(2, 2, sharex=True, height_ratios=[3, 2])
    for name, theory in found.theory.items():
        upper, lower = panels[:, int(name in ("p at 2Ω", "mean p"))]
        all_rows = np.arange(found.n[-1] + 1)
        upper.plot(all_rows, _theory(found, name, all_rows), color=LINES[name], linewidth=1.0)
        upper.plot(found.n, np.abs(found.run[name]), "o", color=LINES[name], markersize=4, label=LABELS[name])
        lower.semilogy(found.n, np.abs(found.run[name] - theory), "o-", color=LINES[name], markersize=3, linewidth=0.5)
    beat = beat_length(found.wave)
    second = "free wave above the cutoff" if np.isnan(beat) else f"beat length {beat:.4g} rows"
    for axes, title in zip(panels[0], ("(a) fundamental", f"(b) second order; {second}"), strict=True):
        axes.set_title(title, loc="right")
        axes.set_ylim(0, 1.35 * axes.get_ylim()[1])  # room for the legend
        axes.ticklabel_format(axis="y", scilimits=(-2, 3))
        axes.legend(title="dots: run, lines: theory", ncols=2, loc="upper left")
    panels[0, 0].set_ylabel(r"amplitude ($D_0$)")
    panels[1, 0].set_ylabel("|run − theory| ($D_0$)")
    for axes in panels[1]:
        axes.set_xlabel("row $n$")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    numbers = ",  ".join(f"{LABELS[name]} {whole:.1e}" for name, (whole, _) in found.deviations().items())
    figure.suptitle(
        rf"driven {found.wave.mode.name}, $\xi$ = {found.wave.mode.wavenumber:.4g}, $a$ = {found.wave.amplitude:g}"
        f"\nmedian relative deviations: {numbers}",
    )
    return figure


def _theory(found: Comparison, name: str, rows: NDArray[np.intp]) -> Floats:
    wave = found.wave
    if name == "mean p":
        return np.abs(static(wave, rows))
    fundamental, second = driven_amplitudes(replace(wave, phase=0.0), rows)
    return np.abs(second if name == "p at 2Ω" else fundamental[["p", "q", "phi"].index(name)])


def table(found: Comparison) -> str:
    """Return the median deviations, one a line."""
    lines = [f"rows {found.n[0]} to {found.n[-1]}; median deviation: complex, of the modulus"]
    lines += [f"{name:10s} {whole:.2e} {modulus:.2e}" for name, (whole, modulus) in found.deviations().items()]
    return "\n".join(lines)


def of_folder(folder: str) -> Comparison:
    """Return the comparison of a run folder."""
    return compare(*load_form(folder, "driven"))


main = script(__name__, of_folder, table, draw, ("folder", "run folder of a driven row, with snapshots"))
