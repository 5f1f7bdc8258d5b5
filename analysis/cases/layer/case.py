"""Six branches of a layer on a substrate: theory, closed form, and waves in LAMMPS.

    granular-analysis layer SWEEP [-o FILE]

SWEEP is a sweep over branches and wave numbers of a layer, along y. The table compares the frequency of each run,
corrected for its time step, with theory.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import minimize_scalar

from cases.layer.monolayer import Layer
from cases.runner import script
from granular_analysis.plotting import page
from granular_analysis.theory.crystal import Crystal
from granular_analysis.theory.phase_matching import zone_edge
from granular_analysis.theory.scenes import Setting
from granular_lmp.runs.record import Record

MEGAHERTZ = 2e6 * np.pi
# Colours that also differ in lightness, for readers who do not distinguish red and green
MOTIONS = {"up and down": (0.90, 0.62, 0.0), "in the plane": (0.0, 0.62, 0.45), "turning": (0.34, 0.20, 0.60)}
AROUND = 0.02  # relative range around the expected frequency in which the frequency of a run is sought
POINTS = 120
Measured = tuple[Sequence[Record], Sequence[tuple[float, float]]]  # frequencies by theory, by the run


def frequency(record: Record, near: float) -> float:
    """Return the frequency of a run near an expected one, rad/s, corrected for the time step.

    With a step h velocity Verlet has the frequency (2/h) arcsin(ωh/2) in place of ω.
    """
    scale, step = record.scene.sphere.time_scale, record.scene.time.step
    moved = max((record.signals[name] for name in ("ux", "uy", "uz", "phix", "phiy", "phiz")), key=np.ptp)

    def left(omega: float) -> float:
        columns = np.stack([np.cos(omega * record.tau), np.sin(omega * record.tau)], axis=1)
        return float(np.linalg.norm(moved - columns @ np.linalg.lstsq(columns, moved, rcond=None)[0]))

    between = tuple(near * scale * (1 + side * AROUND) for side in (-1, 1))
    found = minimize_scalar(left, bounds=between, method="bounded", options={"xatol": 1e-10}).x
    return float(2 / step * np.sin(found * step / 2) / scale)


def closed(crystal: Crystal) -> Layer:
    """Return the closed form for a layer with one sphere in a cell."""
    bonds = crystal.bonds
    pairs, law = bonds.second >= 0, bonds.law
    stiffness = law.stiffness[pairs][0], law.shear[pairs][0], law.stiffness[~pairs][0], law.shear[~pairs][0]
    return Layer(bonds.apart[pairs, :2], crystal.mass[0, 0], *map(float, stiffness))


def frequencies(records: Sequence[Record]) -> Measured:
    """Return the runs, and for each its frequency in theory and in LAMMPS, rad/s."""
    theory = [float(Setting(record.scene).mode().frequency) for record in records]
    return records, [(each, frequency(record, each)) for record, each in zip(records, theory, strict=True)]


def table(found: Measured) -> str:
    """Return the frequencies of each run and of theory, the deviation of the closed form, and its values at k = 0."""
    lines, worst = [f"{'branch':>6}{'xi':>10}{'theory, MHz':>14}{'LAMMPS, MHz':>14}{'deviation':>11}"], 0.0
    for record, (theory, measured) in zip(*found, strict=True):
        share = measured / theory - 1
        worst = max(worst, abs(share))
        name, xi = record.scene.require_wave().mode, record.scene.wavenumber
        lines.append(f"{name:>6}{xi:10.5f}{theory / MEGAHERTZ:14.6f}{measured / MEGAHERTZ:14.6f}{share:11.1e}")
    setting = Setting(found[0][0].scene)
    crystal, vertical = setting.crystal(), closed(setting.crystal()).resonances()
    k = np.array([setting.wavevector(xi) for xi in np.linspace(0.05, 3.1, 62)])
    both = np.sort(np.concatenate(closed(crystal).frequencies(k), axis=-1), axis=-1)
    apart = np.abs(both / crystal.modes(k).frequencies - 1).max()
    at_rest = np.array([vertical.vertical, *vertical.rocking, vertical.torsion]) / MEGAHERTZ
    lines.append(f"largest deviation of a run {worst:.1e}; of the closed form {apart:.2e}")
    lines.append("at k = 0: vertical {:.2f} MHz, rocking {:.2f} and {:.2f}, torsion {:.2f}".format(*at_rest))
    return "\n".join(lines)


def draw(found: Measured) -> Figure:
    """Return the figure: branches, coloured by their motion, and runs as circles."""
    records, measured = found
    setting = Setting(records[0].scene)
    crystal, along = setting.crystal(), setting.wavevector(1.0)
    edge = zone_edge(crystal, along) / setting.unit
    numbers = edge * np.arange(1, POINTS + 1) / POINTS
    modes = crystal.modes(np.array([setting.wavevector(xi) for xi in numbers]))
    size = crystal.mass[0] * np.abs(modes.shapes[..., 0, :]) ** 2
    shares = np.stack([size[..., 2], size[..., :2].sum(axis=-1), size[..., 3:].sum(axis=-1)], axis=-1)
    colours = np.clip(shares / shares.sum(axis=-1, keepdims=True) @ np.array(list(MOTIONS.values())), 0, 1)
    figure = page(4.4)
    axes = figure.subplots()
    for branch in range(modes.frequencies.shape[1]):
        axes.scatter(numbers, modes.frequencies[:, branch] / MEGAHERTZ, 9, colours[:, branch], linewidths=0)
    places, own = [each.scene.wavenumber for each in records], [each / MEGAHERTZ for _, each in measured]
    axes.plot(places, own, "o", color="black", markerfacecolor="none", markersize=7, label="LAMMPS")
    for name, colour in MOTIONS.items():
        axes.plot([], [], ".", color=colour, markersize=9, label=name)
    axes.set(xlabel=r"wave number $\xi$ (rad per row)", ylabel="frequency (MHz)", xlim=(0, edge), ylim=(0, None))
    axes.legend(loc="lower right", ncols=2)
    return figure


main = script(__name__, frequencies, table, draw, ("sweeps", "sweep over branches and wave numbers of a layer"))
