"""The solitary wave of a chain of spheres: its shape, its speed from sonic vacuum to sound, and what an impurity does.

    python -m analysis.figures.solitary [-o FILE]

Left: the overlap of touching spheres, exact and by the long-wave theory. Middle: the speed over the largest overlap
when the chain is compressed, with the KdV soliton and the long-wave theory. Right: the shares of the energy beyond and
before an impurity of another mass.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.figures.plotting import parser, save, start
from analysis.theory.scattering import impurity
from analysis.theory.solitary import long_wave_speed, solitary_wave, sound

RATIOS = 1 + np.geomspace(1e-3, 9.0, 25)  # V/c
MASSES = np.geomspace(1 / 8, 27.0, 23)


def draw() -> Figure:
    """Return the three panels."""
    figure = Figure(figsize=(11.0, 3.8), layout="constrained")
    panels = list(figure.subplots(1, 3))
    _shape(panels[0])
    _speed(panels[1])
    _shares(panels[2])
    for letter, axes in zip("abc", panels, strict=True):
        axes.set_title(f"({letter})", loc="left", fontsize="medium")
        axes.grid(alpha=0.3)
        axes.legend(fontsize="small", frameon=False)
    return figure


def _shape(axes: Axes) -> None:
    wave, places = solitary_wave(1.0), np.linspace(-4.5, 4.5, 361)
    axes.plot(places, wave.at(places)[0] / wave.largest_overlap, color="black", label="exact")
    # Nesterenko's compacton: cos⁴(√(2/5) s) within one arch
    long = np.where(np.abs(places) < np.pi / 2 * np.sqrt(2.5), np.cos(np.sqrt(0.4) * places) ** 4, 0.0)
    axes.plot(places, long, "--", color="tab:red", label="long waves")
    contacts = np.arange(-4, 5)
    axes.plot(contacts, wave.at(contacts)[0] / wave.largest_overlap, "o", color="black", markersize=4)
    axes.set(xlabel="contact $n - Vt$", ylabel=r"overlap / largest", xlim=(-4.5, 4.5))


def _speed(axes: Axes) -> None:
    unit = sound(1.0, 1.0, 1.0)
    crests = np.array([solitary_wave(ratio * unit, rest=1.0).largest_overlap for ratio in RATIOS])
    axes.loglog(crests, RATIOS - 1, color="black", label="exact")
    axes.loglog(crests, crests / 12, ":", color="tab:blue", label="KdV")
    axes.loglog(crests, long_wave_speed(1 + crests) - 1, "--", color="tab:red", label="long waves")
    alone = 0.9055157764 * crests**0.25 / unit - 1
    axes.loglog(crests[alone > 0.1], alone[alone > 0.1], "-.", color="grey", label="no compression")
    axes.set(xlabel=r"largest overlap $\delta/\delta_0$", ylabel="$V/c - 1$")


def _shares(axes: Axes) -> None:
    found = [impurity(mass) for mass in MASSES]
    axes.semilogx(MASSES, [one.transmitted for one in found], color="black", label="beyond")
    axes.semilogx(MASSES, [one.reflected for one in found], color="tab:red", label="reflected")
    axes.semilogx(MASSES, [one.velocity**2 for one in found], ":", color="black", label="beyond, first wave")
    axes.set(xlabel="mass of the impurity / mass of a sphere", ylabel="share of the energy")


def main(argv: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    options = parser(__doc__, "figures/solitary.png").parse_args(argv)
    save(draw(), options.output)
    print(options.output)
    return 0


if __name__ == "__main__":
    start(main)
