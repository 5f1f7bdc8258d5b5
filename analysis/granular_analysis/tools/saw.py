"""Surface waves of an elastic substrate, coupled to the contact resonances of the layer of a scene.

    granular-analysis saw SCENE [--data DATA.csv] [--density RHO] [--thickness H [--below E NU RHO]]
                                [--direction DEG] [--limit XI] [-o FILE]

SCENE is a file or the name of a shipped scene of one layer or a film on a [substrate]. In a run the substrate is rigid;
here it has the moduli in the scene, and the density RHO in kg/m³ (default: `substrate.density`, or the density of the
spheres). Guided waves are slower than its transverse waves, and the search misses none; waves that leak into the
substrate are followed from k = 0 upward. With a thickness H in m the substrate is a plate with a free lower face, from
which no wave leaks, or a film on a half-space with Young's modulus E, Poisson's ratio NU and density RHO.

The table has the speeds, the leaking resonances at k = 0 with their quality factors, and the guided waves where the
bare surface wave would cross the vertical resonance. Each guided wave has a shape: the shares of vertical,
longitudinal, transverse and rotational motion of the spheres, and the motion of the surface. A leaking wave jumps at
the line of longitudinal waves, where it begins to radiate them. A CSV file beside the figure has all branches with
their attenuation. The relative error of frequencies is half of the overlap ratio of the spheres.

DATA.csv holds measured frequencies (`granular_analysis.measure.points`), whose branch is empty or `saw` for the nearest
of these waves, or `saw1`, `saw2`, … for a guided one, counted from the lowest. They are drawn with errors at their wave
numbers, and listed beside their waves.
"""

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from granular_analysis.measure.fitting import wavevectors
from granular_analysis.measure.points import Point, read
from granular_analysis.measure.surface import BRANCH, SLOWEST, Film, Wave, is_surface_wave
from granular_analysis.plotting import in_one_line, page, parser, save, scene_of, write_csv
from granular_analysis.theory.phase_matching import zone_edge
from granular_analysis.theory.scenes import Setting
from granular_analysis.theory.surface_wave import HalfSpace
from granular_lmp.cli.arguments import changes_argument
from granular_lmp.scene.spreadsheets import TableError

Floats = NDArray[np.float64]
POINTS = 120
SHAPE = ("vertical", "along", "across", "turning", "surface")
BEYOND = 2.5  # largest wave number in the figure, over that where surface wave and vertical resonance meet


def table(film: Film) -> str:
    """Return speeds, leaking resonances at k = 0, and the guided waves at the crossing, as text."""
    solid, begin = film.solid, SLOWEST * film.crossing
    lines = [
        f"speeds: longitudinal {solid.longitudinal:.5g}, transverse {solid.transverse:.5g}, "
        f"surface {solid.rayleigh():.5g} m/s",
        f"{'wave':10}{'xi':>9}{'Hz':>13}{'rigid':>13}{'Q':>11}{'1/s':>11}" + "".join(f"{each:>9}" for each in SHAPE),
    ]
    crossing = film.guided(np.array([film.crossing]))
    if np.isinf(film.coupled.substrate.cutoff):  # a plate has no leaking resonance
        return "\n".join(lines + [_line(each) for each in [*film.guided(np.array([begin])), *crossing]])
    for rigid, omega in zip(*film.resonances(begin * film.unit), strict=True):
        if np.isfinite(omega):
            lines.append(_line(film.wave(begin, complex(omega), "resonance"), f"{rigid / (2 * np.pi):13.6g}"))
    return "\n".join(lines + [_line(each) for each in crossing])


def _line(wave: Wave, rigid: str = "") -> str:
    """Return a wave in the columns of `table`."""
    numbers = f"{wave.wavenumber:9.6f}{wave.frequency_Hz:13.6g}{rigid:>13}{wave.quality:11.4g}{wave.attenuation:11.3g}"
    return f"{wave.kind:10}{numbers}" + "".join(f"{getattr(wave, each):9.2f}" for each in SHAPE)


def beside(points: Sequence[Point], found: Floats) -> str:
    """Return a line for each measured point with the frequency of its wave, Hz, and the difference."""
    lines = [f"{'line':>5}{'branch':>8}{'measured, MHz':>16}{'wave, MHz':>14}{'off, %':>10}{'off, errors':>13}"]
    for each, hertz in zip(points, found, strict=True):
        errors = f"{(each.value - hertz) / each.error:13.2f}" if each.error else f"{'-':>13}"
        off = 100 * (each.value / hertz - 1)
        lines.append(
            f"{each.line:5}{each.branch or BRANCH:>8}{1e-6 * each.value:16.6g}{1e-6 * hertz:14.6g}{off:10.3f}{errors}"
        )
    return "\n".join(lines)


def measured(file: str) -> tuple[list[Point], str]:
    """Return the points of a table, and a sentence on its columns; TableError for a point on no surface wave."""
    found, table = read(file)
    points = [replace(each, branch=each.branch or BRANCH) for each in found]
    for each in points:
        if not is_surface_wave(each):
            said = f"branch = {each.branch!r}" if each.kind == "frequency" else f"a {each.kind}"
            raise TableError(f"{file}: line {each.line}: {said}: must be a frequency of saw, saw1, … or no branch")
    return points, table.understood


def draw(film: Film, waves: Sequence[Wave], name: str, points: Sequence[Point], numbers_of_points: Floats) -> Figure:
    """Return the figure: waves coloured by vertical motion, bare waves, and the layer on a rigid substrate.

    Measured points have wave numbers (N,), rad per row.
    """
    figure = page(4.6)
    axes = figure.subplots()
    solid, last = film.solid, max(each.wavenumber for each in waves)
    numbers = np.linspace(last / POINTS, last, POINTS)
    rigid = film.coupled.crystal.modes(np.multiply.outer(numbers, film.unit)).frequencies / (2e6 * np.pi)
    axes.plot(numbers, rigid, color="0.8", linewidth=0.8)
    cutoff = film.coupled.substrate.cutoff
    for speed, style in ((solid.rayleigh(), "--"), (cutoff if np.isfinite(cutoff) else solid.transverse, ":")):
        axes.plot(numbers, speed * np.linalg.norm(film.unit) * numbers / (2e6 * np.pi), style, color="0.4", linewidth=1)
    for kind, size in (("leaking", 3), ("guided", 14)):
        chosen = np.array([(each[0], 1e-6 * each[3], each[5]) for each in waves if each.kind == kind]).reshape(-1, 3)
        xi, megahertz, vertical = chosen.T
        shown = axes.scatter(xi, megahertz, size, vertical, cmap="plasma", vmin=0, vmax=1, linewidths=0)
    if points:
        megahertz, errors = (
            1e-6 * np.array([getattr(each, name) or 0 for each in points]) for name in ("value", "error")
        )
        axes.errorbar(numbers_of_points, megahertz, errors, fmt="o", color="C2", mfc="none", ms=6, zorder=3)
    figure.colorbar(shown, label="share of the spheres' motion along z")
    axes.set(xlabel=r"wave number $\xi$ (rad per row)", ylabel="frequency (MHz)", xlim=(0, last))
    axes.set_ylim(0, 1e-6 * film.highest / (2 * np.pi))
    axes.set_title(
        f"{name.replace('_', ' ')}: guided (large), leaking (small)\nRayleigh's wave of the substrate dashed"
    )
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and write figure and CSV."""
    command = parser(__doc__, "saw.png")
    number: dict[str, Any] = {"type": float, "default": None}
    command.add_argument("scene", metavar="SCENE", help="file or name of a shipped scene with a [substrate]")
    changes_argument(command, "substrate.density=2000")
    command.add_argument("--data", metavar="DATA.csv", help="measured points to draw over the waves and to list")
    command.add_argument(
        "--density", metavar="RHO", help="density of the substrate, kg/m3 (default: density in the scene)", **number
    )
    command.add_argument(
        "--thickness", metavar="H", help="thickness of the substrate, m: makes it a plate or a film", **number
    )
    command.add_argument(
        "--below",
        nargs=3,
        type=float,
        metavar=("E", "NU", "RHO"),
        help="moduli and density of the half-space under the film",
    )
    command.add_argument(
        "--direction", metavar="DEG", help="degrees from a row (default: direction of the scene)", **number
    )
    command.add_argument("--limit", metavar="XI", help="largest wave number, rad per row", **number)
    options = command.parse_args(arguments)
    if wrong := _wrong(options):
        command.error(wrong)
    with in_one_line(options.scene):
        setting = Setting(scene_of(options.scene, options))
        below = HalfSpace.of(*options.below) if options.below else None
        film = Film.of(setting, options.density, options.direction, thickness=options.thickness, below=below)
        points, understood = measured(options.data) if options.data else ([], "")
        vectors = wavevectors(setting, points)
        parts = [table(film)] + ([understood, beside(points, film.met(points, vectors))] if points else [])
    at = np.linalg.norm(vectors, axis=1) / np.linalg.norm(film.unit)
    edge = zone_edge(film.coupled.crystal, film.unit) / float(np.linalg.norm(film.unit))
    limit = options.limit or max([min(edge, BEYOND * film.crossing), *(1.05 * at)])
    numbers = limit * np.arange(1, POINTS + 1) / POINTS
    waves = [*film.guided(numbers), *film.leaking(numbers)]
    print("\n".join(parts))
    save(draw(film, waves, setting.scene.name, points, at), options.output)
    write_csv(Path(options.output).with_suffix(".csv"), Wave._fields, waves)


def _wrong(options: Namespace) -> str:
    """Return the error in the options, "" if there is none."""
    for name in ("density", "thickness", "limit"):
        value = getattr(options, name)
        if value is not None and not 0 < value < np.inf:
            return f"--{name} {value}: must be positive and finite"
    if options.data and Path(options.data).resolve() == Path(options.output).with_suffix(".csv").resolve():
        return f"--output {options.output}: the CSV file beside it would replace {options.data}"
    if options.direction is not None and not np.isfinite(options.direction):
        return f"--direction {options.direction}: must be degrees, finite"
    if options.below is None:
        return ""
    modulus, ratio, density = options.below
    if not (0 < modulus < np.inf and -1 < ratio < 0.5 and 0 < density < np.inf):
        return f"--below {modulus} {ratio} {density}: must be Pa, Poisson's ratio between -1 and 0.5, kg/m3"
    return "" if options.thickness else "--below: needs --thickness, the thickness of the film"
