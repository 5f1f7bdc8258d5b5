"""The paper's figure 2: dispersion along y, and the second harmonic that RT and TR waves generate.

    granular-analysis figure2 [-o figures/figure2.png] [--poisson-ratio 0.17]

(a) Branches L, TR and RT. The TR branch, doubled in wave number and frequency, meets L at the resonance. The curve on
which the source of the second harmonic vanishes meets TR at the antiresonance. (b, c) Amplitude |P̃1|/2 per ε of the
longitudinal second harmonic, for real fields (½ of the paper's complex amplitude, without its factor 4/3), with |Q| and
|f| of the fundamental.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cases.runner import POISSON_RATIO, script
from granular_analysis.plotting import COLOURS, legend_above, page
from granular_analysis.second_harmonic import (
    MODES,
    ModeName,
    Ratios,
    antiresonance,
    dispersion,
    generated_amplitude,
    mode,
    ratios,
    resonance,
)

WAVENUMBERS = np.linspace(1e-3, np.pi, 1201)
PAPER = (0.802, 1.475, 2.127)  # wave numbers of the paper's three runs, rad per row


def draw(constants: Ratios) -> Figure:
    """Draw the three panels for one lattice."""
    figure = page(3.7)
    branches, upper, lower = figure.subplots(1, 3, width_ratios=[1.15, 1, 1])
    _dispersion(branches, constants)
    generated: tuple[tuple[Axes, ModeName, str], ...] = ((upper, "RT", "b"), (lower, "TR", "c"))
    for axes, name, letter in generated:
        _amplitudes(axes, name, constants)
        axes.set_title(f"({letter}) second harmonic\nof {name}", loc="left")
        legend_above(axes)
    for axes in (branches, upper, lower):
        axes.set(xlabel="wave number $\\xi$\n(rad per row)", xlim=(0, np.pi))
    return figure


def table(constants: Ratios) -> str:
    """Return resonance and antiresonance of TR, and the amplitude of its second harmonic at the paper's ξ."""
    vanishing = antiresonance(constants)
    lines = [f"resonance {resonance(constants):.5f}", f"antiresonance {vanishing:.5f}" if vanishing else ""]
    waves = [mode("TR", xi, constants) for xi in PAPER]
    lines += [f"TR {wave.wavenumber:.3f} {abs(generated_amplitude(wave, constants)) / 2:.4e}" for wave in waves]
    return "\n".join(filter(None, lines))


def _dispersion(axes: Axes, constants: Ratios) -> None:
    at = 600
    offsets = {"L": (-12, 6), "TR": (8, -14), "RT": (4, 6)}
    for name in MODES:
        frequency, offset = dispersion(WAVENUMBERS, name, constants), offsets[name]
        axes.plot(WAVENUMBERS, frequency, color=COLOURS[name])
        axes.annotate(
            name, (WAVENUMBERS[at], frequency[at]), xytext=offset, textcoords="offset points", color=COLOURS[name]
        )
    doubled = dispersion(WAVENUMBERS / 2, "TR", constants)
    axes.plot(WAVENUMBERS, 2 * doubled, color=COLOURS["TR"], linestyle="--", label="TR, doubled")
    rate = constants.mu1 - 3 * constants.mu2 * constants.alpha / constants.beta
    if rate > 0:
        axes.plot(
            WAVENUMBERS,
            np.sin(WAVENUMBERS / 2) * np.sqrt(rate),
            color="tab:grey",
            linestyle="-.",
            label="no second harmonic",
        )
    meeting = 2 * resonance(constants)
    axes.plot(meeting, np.sin(meeting / 2), "ko", label=rf"resonance, $2\xi$ = {meeting:.4f}")
    vanishing = antiresonance(constants)
    if vanishing is not None:
        axes.plot(
            vanishing, mode("TR", vanishing, constants).frequency, "ks", markerfacecolor="white",
            label=rf"antiresonance, $\xi$ = {vanishing:.4f}",
        )  # fmt: skip
    axes.set(ylabel=r"frequency $\Omega$ (rad per $t_0$)", ylim=(0, 2.6))
    axes.set_title("(a) dispersion along y", loc="left")
    legend_above(axes)


def _amplitudes(axes: Axes, name: ModeName, constants: Ratios) -> None:
    waves = [mode(name, xi, constants) for xi in WAVENUMBERS]
    generated = [abs(generated_amplitude(wave, constants)) / 2 for wave in waves]
    axes.semilogy(WAVENUMBERS, generated, color="black", label=r"$|\tilde P_1|/2$ per $\epsilon$")
    axes.semilogy(WAVENUMBERS, [wave.q for wave in waves], color="C0", linestyle="--", label="$|Q|$")
    axes.semilogy(WAVENUMBERS, [abs(wave.f) for wave in waves], color="C3", linestyle="-.", label="$|f|$")
    axes.set(ylim=(1e-5, 1e2), ylabel="amplitude")


main = script(__name__, ratios, table, draw, options=POISSON_RATIO)
