"""Surface waves of an elastic substrate that couple to the contact resonances of the layer of a scene.

    granular-analysis saw SCENE [--density RHO] [--direction DEG] [--limit XI] [-o FILE]

SCENE is a file or the name of a shipped scene of one layer, or of a film, with a [substrate]. In a run the substrate is
rigid; here it has the moduli that the scene gives, and the density RHO in kg/m³ (default: that of the spheres). Guided
waves are slower than its transverse waves, and none is missed; waves that leak into it are followed from k = 0 upward.

The table has the speeds, the leaking resonances at k = 0 with their quality factors, and the guided waves where the
bare surface wave would cross the vertical resonance. Next to the line of longitudinal waves a leaking wave jumps, as it
begins to send them out. All branches stand in a CSV file beside the figure: wave number,
wavelength, frequency, attenuation, and the share of the spheres' motion that is vertical. Frequencies leave out half of
the overlap ratio of the spheres.
"""

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.plotting import parser, save, start, write
from analysis.theory.bloch import frame
from analysis.theory.phase_matching import zone_edge
from analysis.theory.scenes import Setting
from analysis.theory.surface_wave import Coupled, HalfSpace
from granular_lmp.runs.record import GranularError, Scene

Floats = NDArray[np.float64]
POINTS = 120
BEYOND = 2.5  # of the wave number at which the surface wave meets the vertical resonance: what is drawn
STILL = 1e-6  # of the vertical resonance: a frequency below is that of spheres that nothing holds
SLOWEST = 1e-3  # of the first wave number: where leaking waves begin
STEP = 0.05  # of a frequency by which a leaking wave may change from one wave number to the next


class Point(NamedTuple):
    """A wave: rad per row, m, "guided" or "leaking", Hz, 1/s, and the share of the spheres' motion along z."""

    wavenumber: float
    wavelength: float
    kind: str
    frequency_Hz: float
    attenuation: float
    vertical: float


class Film(NamedTuple):
    """A layer on its half-space, with the wave vector of one rad per row in a direction, and K_N, m of a sphere."""

    coupled: Coupled
    unit: Floats
    own: float

    @classmethod
    def of(cls, setting: Setting, density: float, degrees: float) -> "Film":
        """Return the film of a scene. Raises ValueError for a scene without a substrate below."""
        substrate = setting.scene.substrate
        if substrate is None or substrate.sides != "below":
            raise ValueError('[substrate]: missing, or with sides = "both"; surface waves run under one film')
        if substrate.poisson_ratio >= 0.5:
            raise ValueError("substrate.poisson_ratio = 0.5: must be below 0.5 for a half-space that is compressed")
        crystal = setting.crystal(true_geometry=False)
        half_space = HalfSpace.of(substrate.youngs_modulus, substrate.poisson_ratio, density)
        own = float(np.sqrt(crystal.bonds.law.stiffness[-1] / crystal.mass[0, 0]))
        return cls(Coupled(crystal, half_space), setting.unit * frame(degrees)[0], own)

    @property
    def crossing(self) -> float:
        """Return where the bare surface wave has the frequency of the vertical resonance, rad per row."""
        return float(self.own / self.coupled.substrate.rayleigh() / np.linalg.norm(self.unit))

    def point(self, xi: float, omega: complex, kind: str) -> Point:
        """Return a wave at a wave number ξ, rad per row."""
        spheres, _ = self.coupled.shape(xi * self.unit, omega)
        size = np.sum(np.abs(spheres) ** 2, axis=0)
        length = 2 * np.pi / (xi * np.linalg.norm(self.unit))
        share = float(size[2] / max(size.sum(), np.finfo(float).tiny))
        return Point(xi, float(length), kind, omega.real / (2 * np.pi), -omega.imag + 0.0, share)

    def guided(self, numbers: Floats) -> list[Point]:
        """Return the guided waves at wave numbers, rad per row."""
        found = self.coupled.guided(np.multiply.outer(numbers, self.unit))
        return [
            self.point(float(xi), complex(omega), "guided")
            for xi, row in zip(numbers, found, strict=True)
            for omega in row[row > STILL * self.own]
        ]

    def leaking(self, numbers: Floats) -> Iterator[Point]:
        """Yield the leaking waves at wave numbers, followed from those of the rigid substrate at k = 0."""
        begin = SLOWEST * numbers[0] * self.unit
        for resonance in self.coupled.crystal.modes(begin).frequencies:
            omega = self.coupled.leaking(begin, resonance)
            for xi in numbers:
                found = self.coupled.leaking(xi * self.unit, omega)
                slow = found.real < self.coupled.substrate.transverse * xi * np.linalg.norm(self.unit)
                if not abs(found - omega) < STEP * abs(omega) or slow:
                    break
                omega = found
                yield self.point(float(xi), omega, "leaking")


def table(film: Film) -> str:
    """Return speeds, leaking resonances at k = 0, and the guided waves at the crossing, as text."""
    solid, begin = film.coupled.substrate, SLOWEST * film.crossing * film.unit
    lines = [
        f"speeds: longitudinal {solid.longitudinal:.5g}, transverse {solid.transverse:.5g}, "
        f"surface {solid.rayleigh():.5g} m/s"
    ]
    seen: list[complex] = []
    for resonance in film.coupled.crystal.modes(begin).frequencies:
        omega = film.coupled.leaking(begin, resonance)
        if np.isnan(omega) or any(abs(omega - other) < 1e-6 * abs(omega) for other in seen):
            continue
        seen.append(omega)
        quality = omega.real / (2 * abs(omega.imag)) if omega.imag else np.inf
        vertical = film.point(SLOWEST * film.crossing, omega, "leaking").vertical
        lines.append(
            f"resonance at k = 0: {omega.real / (2 * np.pi):12.6g} Hz, Q {quality:8.4g}, vertical {vertical:4.2f}, "
            f"on a rigid substrate {resonance / (2 * np.pi):.6g} Hz"
        )
    for each in film.guided(np.array([film.crossing])):
        lines.append(
            f"guided at xi = {each.wavenumber:.6f}: {each.frequency_Hz:12.6g} Hz, vertical {each.vertical:4.2f}"
        )
    return "\n".join(lines)


def as_csv(points: Sequence[Point]) -> str:
    """Return the waves as CSV, every number with all its digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(Point._fields)
    writer.writerows(points)
    return text.getvalue()


def draw(film: Film, points: Sequence[Point], name: str) -> Figure:
    """Return the figure: waves by the share of vertical motion, the bare waves, and the layer on a rigid substrate."""
    figure = Figure(figsize=(7.2, 5.2), layout="constrained")
    axes = figure.subplots()
    solid, last = film.coupled.substrate, max(each.wavenumber for each in points)
    numbers = np.linspace(last / POINTS, last, POINTS)
    rigid = film.coupled.crystal.modes(np.multiply.outer(numbers, film.unit)).frequencies / (2e6 * np.pi)
    axes.plot(numbers, rigid, color="0.8", linewidth=0.8)
    for speed, style in ((solid.rayleigh(), "--"), (solid.transverse, ":")):
        axes.plot(numbers, speed * np.linalg.norm(film.unit) * numbers / (2e6 * np.pi), style, color="0.4", linewidth=1)
    for kind, size in (("leaking", 3), ("guided", 14)):
        chosen = np.array([(each[0], 1e-6 * each[3], each[5]) for each in points if each.kind == kind]).reshape(-1, 3)
        xi, megahertz, vertical = chosen.T
        shown = axes.scatter(xi, megahertz, size, vertical, cmap="plasma", vmin=0, vmax=1, linewidths=0)
    figure.colorbar(shown, label="share of the spheres' motion along z")
    axes.set(xlabel=r"wave number $\xi$ (rad per row)", ylabel="frequency (MHz)", xlim=(0, last))
    axes.set_ylim(0, 1.6e-6 * film.own / (2 * np.pi))
    axes.set_title(f"{name}: guided (large), leaking (small); bare surface wave dashed", fontsize="medium")
    return figure


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and write figure and CSV."""
    command = parser(__doc__, "saw.png")
    command.add_argument("scene", metavar="SCENE", help="file or name of a shipped scene with a [substrate]")
    command.add_argument("--density", type=float, metavar="RHO", help="of the substrate, kg/m3 (default: the spheres')")
    command.add_argument("--direction", type=float, metavar="DEG", help="from a row (default: that of the scene)")
    command.add_argument("--limit", type=float, metavar="XI", help="largest wave number, rad per row")
    options = command.parse_args(arguments)
    for name in ("density", "limit"):
        value = getattr(options, name)
        if value is not None and not 0 < value < np.inf:
            command.error(f"--{name} {value}: must be positive and finite")
    if options.direction is not None and not np.isfinite(options.direction):
        command.error(f"--direction {options.direction}: must be degrees, finite")
    try:
        setting = Setting(Scene.load(options.scene))
        degrees = setting.scene.direction if options.direction is None else options.direction
        film = Film.of(setting, options.density or setting.scene.sphere.density, degrees)
    except GranularError as error:
        raise SystemExit(error.in_options()) from error
    except ValueError as error:
        raise SystemExit(f"{options.scene}: {error}") from error
    edge = zone_edge(film.coupled.crystal, film.unit) / float(np.linalg.norm(film.unit))
    limit = min(edge, BEYOND * film.crossing) if options.limit is None else options.limit
    numbers = limit * np.arange(1, POINTS + 1) / POINTS
    points = [*film.guided(numbers), *film.leaking(numbers)]
    print(table(film))
    save(draw(film, points, setting.scene.name), options.output)
    write(Path(options.output).with_suffix(".csv"), as_csv(points))


if __name__ == "__main__":
    start(main)
