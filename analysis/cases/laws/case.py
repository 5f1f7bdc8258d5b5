"""Three shear laws (`granular_analysis.theory.bonds`) and the second harmonic that each gives.

    granular-analysis laws [-o FILE] [--poisson-ratio NU]

Above stands the amplitude of the generated wave for TR, by theory (lines) and exact lattice (circles); below,
p(τ) of the exact lattice at a wave number next to the antiresonance of the secant law, where the laws differ most.
"""

from functools import cache
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from cases.runner import POISSON_RATIO, script
from granular_analysis.plotting import SILICA
from granular_analysis.theory.contact import LAWS, Contact, Law
from granular_analysis.theory.lattice import torus
from granular_analysis.theory.wave import Wave, antiresonance, generated, nonlinearity, resonance, second_harmonic

Floats = NDArray[np.float64]
AMPLITUDE = 0.2  # D0/Δ0 of the paper's simulations
TAU = np.linspace(0.0, 120.0, 241)  # the paper's duration
PAPER = 0.802  # rad per row, of the paper's first case
NEAR_ANTIRESONANCE = 2.127  # rad per row, of the paper's third case
SMALL = 0.005  # amplitude of the circles: the lattice is off second order by a² of it, by 150 a² at the antiresonance
CIRCLES = (0.3, 0.6, PAPER, 1.1, 1.3, 1.475, 1.65, 1.9, NEAR_ANTIRESONANCE, 2.4, 2.7, 3.0)  # rad per row
# Dark to light, and told apart by their dashes in grey.
LINES: Final[dict[Law, dict[str, str]]] = {
    "secant": {"color": "black", "linestyle": "-"},
    "incremental": {"color": "tab:blue", "linestyle": "--"},
    "potential": {"color": "tab:orange", "linestyle": "-."},
}


def ratio_to_secant(wavenumber: float, law: Law, poisson_ratio: float = SILICA) -> tuple[float, float, float]:
    """Return p, q, φ of the exact lattice under a law over those under the secant law, TR at a=0.2.

    Norm: root mean square over 0 ≤ τ ≤ 120 (every 0.5) in the row and at the phase where ϑ = −Ωτ.
    """
    laws: tuple[Law, Law] = (law, "secant")
    own, secant = (_exact(wavenumber, Contact(poisson_ratio, law=each)) for each in laws)
    p, q, phi = np.sqrt(np.mean(own**2, axis=-1) / np.mean(secant**2, axis=-1))
    return float(p), float(q), float(phi)


@cache
def _exact(wavenumber: float, contact: Contact) -> Floats:
    """Return p, q, φ (3, T) of TR in the exact lattice at the times `TAU`."""
    return np.stack(torus(Wave.of_mode("TR", wavenumber, AMPLITUDE, contact), TAU))


def amplitude(wavenumber: ArrayLike, contact: Contact) -> Floats:
    """Return |P̃1|/2 per ε of the secant law, of the wave that TR generates."""
    paper = Contact(contact.poisson_ratio)
    return np.abs(generated("TR", wavenumber, contact) / nonlinearity(paper, 1.0))


def lattice_amplitude(wavenumber: float, contact: Contact) -> float:
    """Return `amplitude` as the exact lattice shows it: times rms p (lattice)/rms p (`second_harmonic`).

    At a = 0.005 and τ ≤ 60, in the row and at the phase where ϑ = −Ωτ.
    """
    wave, tau = Wave.of_mode("TR", wavenumber, SMALL, contact), TAU[TAU <= 60]
    exact, theory = torus(wave, tau)[0], second_harmonic(wave, tau)[0]
    return float(amplitude(wavenumber, contact) * np.linalg.norm(exact) / np.linalg.norm(theory))


def table(poisson_ratio: float) -> str:
    """Return a line for each law: its antiresonance, and |P̃1|/2 by theory and in the exact lattice."""
    lines = [f"{'law':12}{'antiresonance':>14}{f'at {PAPER}':>12}{'lattice':>12}"]
    for law in LAWS:
        contact = Contact(poisson_ratio, law=law)
        zero = antiresonance(contact)
        made, exact = float(amplitude(PAPER, contact)), lattice_amplitude(PAPER, contact)
        lines.append(f"{law:12}{'-' if zero is None else f'{zero:.4f}':>14}{made:12.4e}{exact:12.4e}")
    return "\n".join(lines)


def draw(poisson_ratio: float) -> Figure:
    """Return the figure for one Poisson's ratio (−1 to 0.5)."""
    pole = resonance(Contact(poisson_ratio)) or np.nan
    times = np.linspace(0, TAU[-1], 1201)
    figure = Figure(figsize=(7.0, 7.0), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(1.5, 1.0))
    for law in LAWS:
        contact = Contact(poisson_ratio, law=law)
        zero = antiresonance(contact)
        grid = np.union1d(np.linspace(0.02, np.pi - 1e-3, 1200), [] if zero is None else [zero])
        above.semilogy(grid, amplitude(grid, contact), label=law, **LINES[law])
        dots = [lattice_amplitude(xi, contact) for xi in CIRCLES]
        above.semilogy(CIRCLES, dots, "o", color=LINES[law]["color"], markersize=5, markerfacecolor="white")
        if zero is not None:
            side, align = (8, "left") if zero < 2.4 else (-8, "right")
            above.annotate(
                f"antiresonance\n({law}), {zero:.3f}",
                (zero, 1.6e-6),
                (side, 0),
                textcoords="offset points",
                ha=align,
                fontsize=9,
            )
        p = torus(Wave.of_mode("TR", NEAR_ANTIRESONANCE, AMPLITUDE, contact), times)[0]
        below.plot(times, 1e3 * p, label=rf"{law}, max {1e3 * np.max(np.abs(p)):.2g}", **LINES[law])
    above.axvline(pole, color="0.6", linewidth=0.8, zorder=0)
    above.annotate(f"resonance (all laws), {pole:.3f}", (pole, 1.3e1), (7, 0), textcoords="offset points", fontsize=9)
    above.plot([], [], "o", color="black", markerfacecolor="white", label=f"exact lattice, $a$ = {SMALL:g}")
    above.set(
        xlim=(0, np.pi),
        ylim=(1e-6, 3e1),
        xlabel=r"wave number $\xi$ (rad per row)",
        ylabel=r"second harmonic $|\tilde P_1|/2$  ($|\epsilon| D_0$)",
        title=rf"TR wave, $\nu$ = {poisson_ratio:g}, by the law of the shear force",
    )
    above.legend(loc="lower left", frameon=False)
    below.set(
        xlim=(0, TAU[-1]),
        xlabel=r"time $\tau$",
        ylabel="$p$ ($10^{-3} D_0$)",
        title=rf"exact lattice, $\xi$ = {NEAR_ANTIRESONANCE}, $a$ = {AMPLITUDE:g}",
    )
    below.margins(y=0.25)
    below.legend(loc="upper center", ncols=3, frameon=False, fontsize=9, columnspacing=1.5)
    return figure


def checked(poisson_ratio: float) -> float:
    """Return Poisson's ratio; ValueError for one that no material has."""
    return Contact(poisson_ratio).poisson_ratio


main = script(__name__, checked, table, draw, options=POISSON_RATIO)
