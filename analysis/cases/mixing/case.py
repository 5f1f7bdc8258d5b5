"""Map of the partners of one wave: waves of the zone that are phase-matched with it, and the growth of the third wave.

    granular-analysis mixing [-o FILE] [--poisson-ratio NU] [--mode NAME] [--wavenumber XI] [--direction DEG]

The star is the first wave. Each panel is for second waves of one branch: the upper row for the sum of the two, the
lower row for the difference, the first minus the second. On a line Ω1 ± Ω2 is the frequency of a branch at k1 ± k2. The
colour of the line is for that branch, its width for the growth rate of the third wave
(`granular_analysis.theory.second_order.Mixed.growth_rates`).

How to read it. A point on a wide line is a second wave. Together with the first it generates a third wave, which
reaches the size of both in τ = 1/(rate·a), a = D0/Δ0. Where a line gets thin, the drive has a zero. If the first wave
lies on Γ–M or Γ–K, symmetry forbids some drives there altogether (`granular_analysis.theory.selection`). A sum of wave
vectors may leave the zone; it is equivalent to a wave vector inside.

The map does not show how far from a line two waves still mix: with a detuning d a third wave grows to 2·rate·a/|d|. All
lines are for small amplitudes.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, Literal, NamedTuple

import numpy as np
from contourpy import contour_generator
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from cases.map.case import BRANCHES, CORNER, EDGE, wave_vectors
from cases.runner import POISSON_RATIO, script
from granular_analysis.plotting import page
from granular_analysis.theory.bloch import branch_index, pair_of, wavevector_of
from granular_analysis.theory.contact import Contact

Floats = NDArray[np.float64]
Tone = tuple[Floats, int]  # wave vector and branch
POINTS = 240  # per axis; even, so that Γ, where a static wave is 0/0, falls between grid points
COLOURS: Final = ("C0", "black", "C3")  # by the branch that grows, lower to upper
SHOWN = (0.01, 0.03, 0.1)  # rates in the legend
SIGNS: Final[dict[Literal[1, -1], str]] = {1: "sum", -1: "difference"}


def width(rate: Floats | float) -> Floats:
    """Return the width of a line in points: proportional to the rate, and hairline at rate zero."""
    return np.asarray(0.3 + 60.0 * np.asarray(rate))


def partners(
    first: Tone, branch: int, sign: Literal[1, -1], contact: Contact, points: int
) -> Iterator[tuple[int, Floats, Floats]]:
    """Yield the lines of second waves that are phase-matched with a wave, in the rectangle around the zone.

    Parameters
    ----------
    first : a single wave.
    branch : branch of the second waves.
    sign : 1 for the sum, −1 for the difference.
    points : grid points per axis. Errors of wave vectors scale with the square of the spacing: 2e-4 of the zone with
        240.

    Yields
    ------
    branch that grows; wave vectors (N, 2) of a line; rates (N,) per τ and a
    """
    k = wave_vectors(points)
    gaps = pair_of(first, (k, branch), sign, contact).detunings
    for target in range(gaps.shape[-1]):
        for line in contour_generator(k[..., 0], k[..., 1], gaps[..., target]).lines(0.0):
            vectors = np.asarray(line, dtype=float)
            yield target, vectors, pair_of(first, (vectors, branch), sign, contact).growth_rates()[:, target]


class Found(NamedTuple):
    """The first wave, its `partners` by sign and branch, and a title."""

    first: Tone
    partners: Mapping[tuple[str, int], Sequence[tuple[int, Floats, Floats]]]
    title: str


def measured(poisson_ratio: float, mode: str, wavenumber: float, direction: float) -> Found:
    """Return the partners of a wave; raise ValueError for a wave that the lattice does not have."""
    contact, k = Contact(poisson_ratio), wavevector_of(wavenumber, direction)
    first = k, int(branch_index(mode, k, contact))
    found = {
        (name, branch): list(partners(first, branch, sign, contact, POINTS))
        for sign, name in SIGNS.items()
        for branch in range(3 if contact.turns else 2)
    }
    return Found(
        first,
        found,
        rf"partners of {mode}, $\xi$ = {wavenumber:g} at {direction:g}°, $\nu$ = {poisson_ratio:g}",
    )


def table(found: Found) -> str:
    """Return a line for each sign and branch: number of points on the lines of partners, and the highest rate."""
    lines = [f"{'with the branch':24}{'points':>8}{'rate':>10}"]
    for (name, branch), drawn in found.partners.items():
        rates = np.concatenate([rates for _, _, rates in drawn]) if drawn else np.zeros(1)
        count = sum(len(line) for _, line, _ in drawn)
        lines.append(f"{f'{name}, {BRANCHES[branch]}':24}{count:8d}{np.nanmax(rates):10.4f}")
    return "\n".join(lines)


def draw(found: Found) -> Figure:
    """Return the figure of the partners of one wave."""
    branches = sorted({branch for _, branch in found.partners})
    figure = page(5.6)
    panels = figure.subplots(2, len(branches), sharex=True, sharey=True)
    for row, name in zip(panels, SIGNS.values(), strict=True):
        for branch, panel in zip(branches, row, strict=True):
            _zone(panel, found.first)
            for target, line, rates in found.partners[name, branch]:
                pieces = np.stack([line[:-1], line[1:]], axis=1)
                drawn = LineCollection(
                    list(pieces),
                    linewidths=width((rates[1:] + rates[:-1]) / 2),
                    colors=COLOURS[target],
                    capstyle="round",
                )
                panel.add_collection(drawn)
                drawn.set_clip_path(panel.patches[0])
            panel.set_title(f"{name} with the\n{BRANCHES[branch]} branch")
        row[0].set_ylabel("$k_y a$ of the second wave (rad)")
    for panel in panels[-1]:
        panel.set_xlabel("$k_x a$ of the second\nwave (rad)")
    keys = [(COLOURS[branch], 2.0, f"makes the {BRANCHES[branch]} branch") for branch in branches]
    keys += [("0.4", float(width(rate)), rf"at the rate {rate:g} $D_0/\Delta_0$ per $\tau$") for rate in SHOWN]
    handles = [Line2D([], [], color=colour, linewidth=points, label=label) for colour, points, label in keys]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    figure.suptitle(found.title)
    return figure


def _zone(panel: Axes, first: Tone) -> None:
    """Draw the first zone, the names of its points and the first wave; the zone is the first patch of the panel."""
    angles = np.deg2rad(np.arange(0, 360, 60))
    panel.add_patch(
        Polygon(CORNER * np.stack([np.cos(angles), np.sin(angles)], axis=-1), fill=False, edgecolor="0.6", zorder=1)
    )
    for name, place in (("Γ", (0.0, 0.0)), ("M", (0.0, EDGE)), ("K", (CORNER, 0.0))):
        panel.plot(*place, ".", color="0.4", markersize=4, clip_on=False)
        panel.annotate(name, place, (4, 2), textcoords="offset points", color="0.4")
    panel.plot(*np.asarray(first[0]), "*", color="C1", markersize=12, markeredgecolor="black", zorder=5)
    panel.set(xlim=(-1.3 * CORNER, 1.3 * CORNER), ylim=(-1.3 * EDGE, 1.3 * EDGE), aspect="equal")


WAVE = {
    "mode": (str, "TR", "mode of the first wave: L, TR or RT"),
    "wavenumber": (float, 0.802, "its wave number ξ"),
    "direction": (float, 90.0, "its direction, degrees from a close-packed row"),
}
main = script(__name__, measured, table, draw, options={**POISSON_RATIO, **WAVE})
