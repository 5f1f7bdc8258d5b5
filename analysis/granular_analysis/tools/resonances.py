"""Resonances and antiresonances of second order in the crystal of a scene, along its direction or over directions.

    granular-analysis resonances SCENE [--direction DEG] [--map N] [-o FILE]

SCENE is a file or the name of a shipped scene. Its crystal may be any lattice, with rows of different densities in a
repeating pattern. A wave of one branch drives waves at twice its wave number and frequency. If one of these is a free
wave, it grows: the table has the wave number, the branches, the frequency, and the growth per period of the wave, in D0
per a = D0/Δ0. If symmetry forbids growth, the table gives the reason. An antiresonance is a wave that exerts no force
on a branch, between two waves that do. A CSV file beside the figure has all values. A line below the table says how far
second order holds for the wave of the scene.

Branches of a lattice with one sphere per cell are L, TR and RT; otherwise 1, 2, … by frequency. Amplitudes are root
mean squares over the spheres of a cell.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from granular_analysis.plotting import in_one_line, page, parser, save, scene_of, write_csv
from granular_analysis.theory.bloch import frame
from granular_analysis.theory.branches import names_of
from granular_analysis.theory.crystal import Crystal, padded
from granular_analysis.theory.phase_matching import COUNT, Match, matches, zone_edge
from granular_analysis.theory.scenes import Setting
from granular_analysis.theory.validity import together, turned, validity
from granular_lmp.cli.arguments import changes_argument

Floats = NDArray[np.float64]
FIELDS = ("direction", "kind", "wavenumber", "wave", "target", "frequency_Hz", "growth", "forbidden")
COLOURS = ("C0", "black", "C3", "C2", "C4", "C5")
SILENT = 1e-9  # rounding of a stretch, over the stretch that opens a contact, or of a coefficient of friction
LARGEST_DOT = 260.0  # points², of the fastest growth


class Row(tuple[float, str, float, str, str, float, float, str]):
    """Line of the table, by `FIELDS`."""


def rows(setting: Setting, crystal: Crystal, degrees: float) -> list[Row]:
    """Return the table along one direction."""
    along = frame(degrees)[0]
    length = setting.scene.sphere.static_overlap

    def row(each: Match) -> Row:
        names = [
            label(crystal, number * along, branch)
            for number, branch in ((each.wavenumber, each.branch), (2 * each.wavenumber, each.target))
        ]
        period = 2 * np.pi / each.frequency
        growth = each.rate * period * length
        xi = each.wavenumber / setting.unit
        return Row((degrees, each.kind, xi, *names, 1 / period, growth, each.forbidden))

    return [row(each) for each in matches(crystal, along)]


def label(crystal: Crystal, wavevector: Floats, branch: int) -> str:
    """Return the name of a branch at a wave vector, or its number from 1."""
    known = names_of(crystal, wavevector)
    return next((name for name, number in known.items() if number == branch), str(branch + 1))


def table(found: Sequence[Row], several: bool) -> str:
    """Return the table as text."""
    head = f"{'kind':14} {'xi':>9} {'branches':>10} {'frequency':>13} {'growth':>10}  a period, D0 per a"
    lines = [f"{'degrees':>8} {head}" if several else head]
    for degrees, kind, xi, wave, target, frequency, growth, forbidden in found:
        grows = f"{growth:10.3g}" if growth else f"{'-':>10}"
        line = f"{kind:14} {xi:9.6f} {f'{wave} -> {target}':>10} {frequency:10.6g} Hz {grows}"
        line += f"  {forbidden}" if forbidden else ""
        lines.append(f"{degrees:8.2f} {line}" if several else line)
    return "\n".join(lines)


def outlook(setting: Setting, crystal: Crystal) -> str:
    """Return a sentence on how far second order holds for the wave of the scene."""
    scene, a = setting.scene, setting.scene.amplitude
    said = f"{scene.require_wave().mode} at xi = {scene.wavenumber:.6g}, a = {a:g}: contacts "
    if len(crystal) > 1:
        _, waves = setting.start()
        far, periods = together(crystal, waves), 20 * np.pi / max(each.frequency for each in waves)
        turns = turned(crystal, waves, [periods])[0]
        slides = f", none slides above a friction of {far.friction:.2g}" if far.friction > SILENT else ""
        opens = _opens(a, far.opening, " or above")
        return f"{said}{opens}{slides}; third order shifts phases by up to {turns:.2g} rad in ten periods"
    alone = validity(crystal, setting.mode().times(scene.displacement_amplitude))
    turns = "" if np.isnan(alone.drift) else f", whose phase third order shifts by {alone.drift:.2g} rad a period"
    slides = f" and slide below a friction of {alone.friction:.2g}" if alone.friction > SILENT else ""
    opens = _opens(a, alone.opening)
    creeps = (
        f"; slip accumulates, and spheres creep by {alone.creep:.2g} of it per period" if alone.creep > SILENT else ""
    )
    return f"{said}{opens}{slides}; the forced second harmonic is {alone.second:.2g} of the wave{turns}{creeps}"


def _opens(a: float, opening: float, above: str = "") -> str:
    """Return the amplitude at which contacts open, from the stretch in a wave of amplitude a."""
    return f"open at a = {a / opening:.3g}{above}" if opening > SILENT else "are not stretched in first order"


def draw(setting: Setting, crystal: Crystal, found: Sequence[Row], degrees: float) -> Figure:
    """Return the figure for one direction: branches at 2k, and twice the frequencies at k."""
    along = padded(frame(degrees)[0])
    numbers = zone_edge(crystal, along) * np.arange(1, COUNT + 1) / COUNT
    waves, targets = (crystal.modes(np.outer(factor * numbers, along)).frequencies / (2e6 * np.pi) for factor in (1, 2))
    figure = page(4.6)
    axes = figure.subplots()
    axes.plot(numbers / setting.unit, targets, color="0.75", linewidth=3)
    for branch in range(waves.shape[1]):
        axes.plot(numbers / setting.unit, 2 * waves[:, branch], color=COLOURS[branch % len(COLOURS)], linewidth=1)
    most = max((row[6] for row in found), default=0.0) or 1.0
    for _, kind, xi, _, _, frequency, growth, _ in found:
        place = xi, 2e-6 * frequency
        if kind == "antiresonance":
            axes.plot(*place, "x", color="black", markersize=7)
        else:
            size = max(LARGEST_DOT * growth / most, 12.0)
            axes.scatter(*place, size, "C1" if growth else "white", edgecolors="black", zorder=5)
    axes.set_ylim(0, 1.15 * targets.max())
    axes.set_xlabel(r"wave number $\xi$ (rad per row)")
    axes.set_ylabel("twice the frequency (MHz)")
    axes.set_title(
        f"{setting.scene.name}, {degrees:g}°: thin 2f($\\xi$), grey f(2$\\xi$); dots grow (white: forbidden), "
        "crosses: no force",
        fontsize="medium",
    )
    return figure


def draw_map(setting: Setting, found: Sequence[Row]) -> Figure:
    """Return the figure of growing resonances over directions."""
    figure = page(4.6)
    axes = figure.subplots()
    grows = [row for row in found if row[6] > 0]
    drawn = axes.scatter([row[0] for row in grows], [row[2] for row in grows], 14, [np.log10(row[6]) for row in grows])
    figure.colorbar(drawn, label="log10 of the growth a period, D0 per a")
    axes.set_xlabel("direction (degrees from a row)")
    axes.set_ylabel(r"wave number $\xi$ (rad per row)")
    axes.set_title(f"resonances of {setting.scene.name.replace('_', ' ')}")
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and write figure and CSV."""
    command = parser(__doc__, "resonances.png")
    command.add_argument("scene", metavar="SCENE", help="file or name of a shipped scene")
    changes_argument(command, "sphere.poisson_ratio=0.3")
    command.add_argument(
        "--direction", type=float, metavar="DEG", help="degrees from a row (default: direction of the scene)"
    )
    command.add_argument("--map", type=int, metavar="N", help="N directions from 0 to 180 degrees")
    options = command.parse_args(arguments)
    if options.map is not None and (options.map < 2 or options.direction is not None):
        command.error(f"--map {options.map}: must be 2 or more directions, and --direction is not given with it")
    if options.direction is not None and not np.isfinite(options.direction):
        command.error(f"--direction {options.direction}: must be degrees, finite")
    with in_one_line(options.scene):
        setting = Setting(scene_of(options.scene, options))
        crystal = setting.crystal()
        said = outlook(setting, crystal)
    own = setting.scene.direction if options.direction is None else options.direction
    if setting.scene.packing.lattice == "chain" and (options.map or own % 180 != 90):
        command.error("a chain has one direction: 90")
    angles = np.linspace(0, 180, options.map) if options.map else [own]
    found = [row for angle in angles for row in rows(setting, crystal, float(angle))]
    print("\n".join(filter(None, [table(found, bool(options.map)), said])))
    figure = draw_map(setting, found) if options.map else draw(setting, crystal, found, own)
    save(figure, options.output)
    write_csv(Path(options.output).with_suffix(".csv"), FIELDS, found)
