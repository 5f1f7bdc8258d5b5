"""Solitary wave of a chain of spheres: its shape, its speed from sonic vacuum to sound, and impurities.

    granular-analysis solitary RUN... [-o FILE]

Left: overlap of touching spheres, exact and in the long-wave theory. Middle: speed over largest overlap in a compressed
chain, with the KdV soliton and the long-wave theory. Right: shares of the energy beyond and before an impurity of
another mass.

RUN is a run folder of an impact on a compressed chain of equal spheres, in which two neighbours and another two farther
on are recorded. The crests of their overlaps give a point of the middle panel. The point is open if the crest still
changes between the two places by more than `STEADY`, so that the front is not yet a solitary wave.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isclose
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cases.runner import script
from cases.solitary.chain_motion import peak
from cases.solitary.scattering import impurity
from cases.solitary.travelling import long_wave_speed, solitary_wave, sound
from cases.strikes import recorded, require, rest_overlap
from granular_analysis.plotting import legend_above, letter, page
from granular_lmp.runs.record import Record

STEADY = 1e-3  # largest relative change of the crest of a solitary wave between the two places
RATIOS = 1 + np.geomspace(1e-3, 9.0, 25)  # V/c
MASSES = np.geomspace(1 / 8, 27.0, 23)


@dataclass(frozen=True)
class Front:
    """Front of a struck chain: its crests at two contacts, above the overlap at rest and in units of it; and V/c."""

    first: float
    second: float
    speed: float

    @property
    def steady(self) -> bool:
        """True if the crest is equal at both contacts, within `STEADY`."""
        return isclose(self.first, self.second, rel_tol=STEADY)


def front(record: Record) -> Front:
    """Return the front in the record of a struck chain.

    Raises ValueError if the chain is not compressed, if its spheres differ, or if the recorded spheres are not two
    pairs of neighbours.
    """
    scene = record.scene
    rows = recorded(scene)
    if not scene.packing.contact_force or scene.inclusion or scene.disorder.radius or scene.disorder.density:
        raise ValueError(f"{scene.name}: must be a chain of equal spheres with packing.contact_force above 0")
    require(record, "packing.contact_force")
    if len(rows) != 4 or rows[1] - rows[0] != 1 or rows[3] - rows[2] != 1:
        raise ValueError(f"{scene.name}: rows {rows.tolist()} are recorded: must be two pairs of neighbours")
    rest, u = rest_overlap(scene), record.displacement[..., 1]
    (one, begin), (other, end) = (peak(record.tau, u[:, at] - u[:, at + 1]) for at in (0, 2))
    return Front(one / rest, other / rest, (rows[2] - rows[0]) / (end - begin) / sound(1.0, 1.0, rest))


def table(fronts: Mapping[str, Front]) -> str:
    """Return a line for each run: crests at both places, and speed."""
    lines = [f"{'run':12}{'crest':>10}{'farther on':>12}{'V/c - 1':>12}"]
    lines += [f"{name:12}{each.first:10.5f}{each.second:12.5f}{each.speed - 1:12.6f}" for name, each in fronts.items()]
    return "\n".join(lines)


def draw(fronts: Mapping[str, Front]) -> Figure:
    """Return the three panels."""
    figure = page(3.6)
    panels = list(figure.subplots(1, 3))
    _shape(panels[0])
    _speed(panels[1], list(fronts.values()))
    _shares(panels[2])
    letter(panels)
    for axes in panels:
        axes.grid(alpha=0.3)
        legend_above(axes)
    return figure


def _shape(axes: Axes) -> None:
    wave, places = solitary_wave(1.0), np.linspace(-4.5, 4.5, 361)
    axes.plot(places, wave.at(places)[0] / wave.largest_overlap, color="black", label="exact")
    # Nesterenko's compacton: cos⁴(√(2/5) s) within one arch
    long = np.where(np.abs(places) < np.pi / 2 * np.sqrt(2.5), np.cos(np.sqrt(0.4) * places) ** 4, 0.0)
    axes.plot(places, long, "--", color="C3", label="long waves")
    contacts = np.arange(-4, 5)
    axes.plot(contacts, wave.at(contacts)[0] / wave.largest_overlap, "o", color="black", markersize=4)
    axes.set(xlabel="contact $n - Vt$", ylabel=r"overlap / largest", xlim=(-4.5, 4.5))


def _speed(axes: Axes, fronts: Sequence[Front]) -> None:
    unit = sound(1.0, 1.0, 1.0)
    crests = np.array([solitary_wave(ratio * unit, rest=1.0).largest_overlap for ratio in RATIOS])
    axes.loglog(crests, RATIOS - 1, color="black", label="exact")
    axes.loglog(crests, crests / 12, ":", color="C0", label="KdV")
    axes.loglog(crests, long_wave_speed(1 + crests) - 1, "--", color="C3", label="long waves")
    alone = 0.9055157764 * crests**0.25 / unit - 1
    axes.loglog(crests[alone > 0.1], alone[alone > 0.1], "-.", color="grey", label="no compression")
    for steady, face in ((True, "black"), (False, "white")):
        found = [each for each in fronts if each.steady == steady]
        label = "LAMMPS" if steady and found else None
        points = [each.second for each in found], [each.speed - 1 for each in found]
        axes.loglog(*points, "o", color="black", markerfacecolor=face, markersize=5, label=label)
    axes.set(xlabel=r"largest overlap $\delta/\delta_0$", ylabel="$V/c - 1$")


def _shares(axes: Axes) -> None:
    found = [impurity(mass) for mass in MASSES]
    axes.semilogx(MASSES, [one.transmitted for one in found], color="black", label="beyond")
    axes.semilogx(MASSES, [one.reflected for one in found], color="C3", label="reflected")
    axes.semilogx(MASSES, [one.velocity**2 for one in found], ":", color="black", label="beyond, first wave")
    axes.set(xlabel="mass of the impurity\n(mass of a sphere)", ylabel="share of the energy")


def measure(records: Sequence[Record]) -> dict[str, Front]:
    """Return the fronts of the runs by name."""
    return {Path(record.folder or "").name: front(record) for record in records}


main = script(__name__, measure, table, draw, ("runs", "impacts on a compressed chain"))
