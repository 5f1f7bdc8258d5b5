"""Map of the second harmonic over the Brillouin zone: its amplitude for each branch and wave vector of the fundamental.

    granular-analysis map [-o FILE] [--poisson-ratio NU]

Each panel is for a branch of the fundamental, in ascending frequency. Colour is the forced amplitude (|u|² + |v|² +
|φ|²)^½ of the second harmonic, per unit ε D0 and for a fundamental of unit amplitude (complex fields; a real wave
generates half of it). Lines are the resonances, where 2Ω(k) is the frequency of a branch at 2k.

How to read it. On a resonance the forced amplitude is unbounded: the second harmonic grows with time until it is as
large as the fundamental, up to which second order holds. The amplitude also diverges at Γ for the acoustic branches,
which have no dispersion there. Where a resonance line crosses Γ–M or Γ–K, the target may have the wrong parity, and
does not resonate. A weakly coupled resonance is visible as its line only (middle branch with upper, ν = 0.17: its share
of the amplitude exceeds 1 only within 0.01/a of the line). At K the middle and the upper branch touch, and colours near
K depend on the side.

The lattice is the paper's, with Δ0/R → 0 and without compression, with the secant shear law and without dashpots.

The titles give the names of the paper's modes on Γ–M, for waves along y. Elsewhere a branch moves in u, v and φ, and
only its frequency identifies it.
"""

from typing import Final

import numpy as np
from matplotlib import patheffects
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from cases.runner import POISSON_RATIO, script
from granular_analysis.plotting import page
from granular_analysis.theory.bloch import branch_index, hexagonal, real_modes
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.second_order import Mixed, branch_of
from granular_analysis.theory.wave import nonlinearity

POINTS = 400  # per axis; even, so that Γ, where the amplitude is 0/0, falls between grid points
COLOURS = (1e-3, 1e1)  # range of the colours; values outside lie at resonances, at Γ and at zeros
BRANCHES = ("lower", "middle", "upper")
STYLES: Final = (":", "-", "--")  # lines of the resonances with the lower, middle, upper branch
CORNER = 4.0 * np.pi / 3.0  # |ΓK| for a close-packed row along x, in 1/lattice constant
EDGE = 2.0 * np.pi / np.sqrt(3.0)  # |ΓM|, which is ξ = π
HALO = [patheffects.withStroke(linewidth=1.8, foreground="white")]


def wave_vectors(points: int) -> NDArray[np.float64]:
    """Return the centres of points × points cells of the rectangle around the zone, (ky, kx, 2), in 1/a."""
    centres = (np.arange(points) + 0.5) / points * 2.0 - 1.0
    return np.stack(np.meshgrid(CORNER * centres, EDGE * centres), axis=-1)


def names_along_y(branch: int, contact: Contact) -> str:
    """Return the paper's names of a branch on Γ–M: "TR", or "TR/L" if modes cross."""
    line = np.stack([np.zeros(200), np.linspace(0.0, EDGE, 202)[1:-1]], axis=-1)
    return "/".join(name for name in ("TR", "L", "RT") if branch in branch_index(name, line, contact))


def amplitudes(wavevector: NDArray[np.float64], branch: int, contact: Contact) -> NDArray[np.float64]:
    """Return the amplitude (...) of the second harmonic for complex fields, in |ε| D0."""
    one = branch_of(hexagonal(contact), wavevector, branch)
    forced = Mixed(hexagonal(contact), one, one).forced()[..., 0, :]
    return np.asarray(np.linalg.norm(forced, axis=-1) / -nonlinearity(contact, 1.0))


def table(contact: Contact) -> str:
    """Return the amplitude of each branch half-way from Γ to M and to K."""
    halves = np.array([[0.0, EDGE / 2], [CORNER / 2, 0.0]])
    lines = [f"{'branch':8}{'Γ-M':>12}{'Γ-K':>12}"]
    for branch, word in enumerate(BRANCHES):
        lines.append(f"{word:8}" + "".join(f"{each:12.4e}" for each in amplitudes(halves, branch, contact)))
    return "\n".join(lines)


def draw(contact: Contact) -> Figure:
    """Return the figure of the three maps for contacts of the secant law."""
    k = wave_vectors(POINTS)
    (fundamental, _), (doubled, _) = (real_modes(each, contact) for each in (k, 2.0 * k))
    figure = page(3.3)
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    angles = np.deg2rad(np.arange(0, 360, 60))
    zone = CORNER * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    targets: set[int] = set()
    for branch, panel in enumerate(panels):
        outline = panel.add_patch(Polygon(zone, fill=False, edgecolor="black", linewidth=1.0, zorder=3))
        image = panel.imshow(
            amplitudes(k, branch, contact),
            norm=LogNorm(*COLOURS),
            cmap="viridis",
            origin="lower",
            extent=(-CORNER, CORNER, -EDGE, EDGE),
            clip_path=outline,
        )
        for target, style in enumerate(STYLES):
            detuning = 2.0 * fundamental[..., branch] - doubled[..., target]
            if detuning.min() < 0.0 < detuning.max():
                lines = panel.contour(
                    *np.moveaxis(k, -1, 0), detuning, [0.0], colors="black", linestyles=style, linewidths=0.9
                )
                lines.set(clip_path=outline, path_effects=HALO)
                targets.add(target)
        for name, place, offset in (("Γ", (0, 0), (5, 4)), ("M", (0, EDGE), (6, 3)), ("K", (CORNER, 0), (5, -3))):
            panel.plot(*place, "o", color="black", markersize=4, markeredgecolor="white", clip_on=False, zorder=4)
            panel.annotate(name, place, offset, textcoords="offset points", path_effects=HALO, zorder=4)
        panel.set(
            title=f"{BRANCHES[branch]} branch\n({names_along_y(branch, contact)} on Γ–M)",
            xlim=(-1.35 * CORNER, 1.35 * CORNER),
            ylim=(-1.45 * EDGE, 1.45 * EDGE),
            xlabel="$k_x a$ (rad)",
        )
    panels[0].set_ylabel("$k_y a$ (rad)")
    figure.colorbar(
        image,
        ax=panels,
        extend="both",
        label="second-harmonic\namplitude / " + r"$(\epsilon D_0)$",
        fraction=0.03,
        pad=0.01,
        aspect=25,
    )
    figure.legend(
        [Line2D([], [], color="black", linestyle=STYLES[target]) for target in sorted(targets)],
        [rf"resonance: $2\Omega(k)$ meets the {BRANCHES[target]} branch at $2k$" for target in sorted(targets)],
        title=rf"$\nu$ = {contact.poisson_ratio:g}, solid spheres",
        loc="outside lower center",
    )
    return figure


main = script(__name__, Contact, table, draw, options=POISSON_RATIO)
