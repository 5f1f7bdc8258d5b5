"""The front of an impact in sheets of unequal spheres: its decay and its speed over the spread of the radii.

    granular-analysis unequal RUN [RUN ...] [-o FILE]

RUN is a run folder of the shipped ``point_impact`` with any ``disorder.radius`` and ``disorder.seed``, and otherwise
alike. Runs of one spread are averaged. The spread is in units of the impact's overlap, σR/ℓ. Fronts are fitted from 10
to 30 diameters, on both sides of the striker where there are two.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from granular_analysis.measure.front import Front, front
from granular_analysis.measure.strikes import Sites, require
from granular_analysis.plotting import letter, parser, show, start
from granular_lmp.runs.record import Record

DIRECTIONS = {30: (30, 150), 60: (60, 120), 90: (90,)}  # degrees from the edge, with their mirror images
NEAREST, FARTHEST = 10.0, 30.0  # diameters
TOLERANCE = 1.0  # diameters: spheres of a direction are up to √3 apart
_STYLES = {30: "s", 60: "^", 90: "D"}
Estimate = tuple[float, float]


@dataclass(frozen=True)
class Spread:
    """Fronts of all runs of one spread: direction → mean of the single fronts, and its standard error.

    Attributes
    ----------
    spread : σR/ℓ.
    seeds : number of runs.
    decay : β of height ∝ distance^−β.
    height : mean of the logarithm of the height at the far end, and its error.
    speed : diameters per t0, from the near to the far end.
    """

    spread: float
    seeds: int
    decay: dict[int, Estimate]
    height: dict[int, Estimate]
    speed: dict[int, Estimate]


def fronts(record: Record, degrees: int, farthest: float) -> list[Front]:
    """Return the fronts of a run in a direction and its mirror image, distances in diameters.

    Raises ValueError if the front has not come as far.
    """
    sites = Sites.of(record.scene)
    places = sites.place[sites.recorded(record.scene)] - sites.place[sites.chosen(record.scene.striker[0])[0]]
    found = []
    for each in DIRECTIONS[degrees]:
        part = front(record.tau, record.velocity, places / 2, each).between(NEAREST, farthest)
        if not len(part.distance) or part.distance[-1] < farthest - 2 * TOLERANCE:
            raise ValueError(
                f"the front has not come {farthest:g} diameters far at {degrees} degrees: take a longer run"
            )
        found.append(part)
    return found


def measured(records: Iterable[Record], farthest: float | None = None) -> list[Spread]:
    """Return the fronts by spread, ascending. Records are taken one at a time, and not kept.

    Raises ValueError if runs differ in more than their disorder, the sheet is not one that a single sphere strikes, or
    a run is too short.
    """
    farthest = FARTHEST if farthest is None else farthest
    found: dict[float, list[dict[int, list[Front]]]] = {}
    first = None
    for record in records:
        require(record, "effects.friction", "effects.restitution", "disorder", "inclusion")
        scene = record.scene
        tables = {**scene.to_dict(), "disorder": None}
        first = first or tables
        if tables != first:
            raise ValueError(f"{scene.name}: differs from the first run in more than its disorder")
        if scene.packing.lattice != "hexagonal" or [len(Sites.of(scene).chosen(each)) for each in scene.striker] != [1]:
            raise ValueError(f"{scene.name}: must be a hexagonal sheet that one sphere strikes")
        if scene.disorder.density or scene.disorder.vacancies:
            raise ValueError(f"{scene.name}: must be without disorder.density and disorder.vacancies")
        spread = scene.disorder.radius * scene.sphere.radius / record.scale.length
        found.setdefault(spread, []).append({degrees: fronts(record, degrees, farthest) for degrees in DIRECTIONS})
    return [_averaged(spread, found[spread]) for spread in sorted(found)]


def _averaged(spread: float, runs: Sequence[dict[int, list[Front]]]) -> Spread:
    decay, height, speed = {}, {}, {}
    for degrees in DIRECTIONS:
        parts = [part for run in runs for part in run[degrees]]
        decay[degrees] = _mean([part.decay for part in parts])
        height[degrees] = _mean([float(np.log(part.height[-1])) for part in parts])
        speed[degrees] = _mean([float(np.ptp(part.distance) / (part.time[-1] - part.time[0])) for part in parts])
    return Spread(spread, len(runs), decay, height, speed)


def _mean(values: Sequence[float]) -> Estimate:
    """Return the mean and its standard error, nan for one value."""
    error = float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else np.nan
    return float(np.mean(values)), error


def draw(spreads: Sequence[Spread]) -> Figure:
    """Return the panels: decay and speed over the spread."""
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    decays, speeds = figure.subplots(1, 2)
    x = [each.spread for each in spreads]
    for axes, name, label in (
        (decays, "decay", r"decay $\beta$"),
        (speeds, "speed", "speed (diameters / $t_0$)"),
    ):
        for degrees, style in _STYLES.items():
            values = np.array([getattr(each, name)[degrees] for each in spreads])
            axes.errorbar(x, values[:, 0], values[:, 1], marker=style, markersize=4, capsize=2, label=f"{degrees}°")
        axes.set_xscale("symlog", linthresh=1e-3)
        axes.set(xlabel=r"spread of the radii $\sigma R/\ell$", ylabel=label)
        axes.grid(alpha=0.3)
    letter((decays, speeds))
    decays.legend(frameon=False)
    return figure


def table(spreads: Sequence[Spread]) -> str:
    """Return a line for each spread: decay, height at the far end and speed in each direction."""
    names = "".join(f"{f'{name} {degrees}':>18}" for name in ("decay", "height", "speed") for degrees in DIRECTIONS)
    lines = [f"{'spread':>7}{'runs':>6}{names}"]
    for each in spreads:
        line = f"{each.spread:7.4f}{each.seeds:6d}"
        line += "".join(f"{value:10.3f} +- {error:.3f}" for value, error in each.decay.values())
        line += "".join(f"{np.exp(value):10.4f} +-{error:4.0%}" for value, error in each.height.values())
        line += "".join(f"{value:10.4f} +- {error:.3f}" for value, error in each.speed.values())
        lines.append(line)
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table and draw the figure into a file; returns the exit status."""
    chosen = parser(__doc__, "figures/unequal.png", runs="run folder of an impact on a sheet").parse_args(arguments)
    return show(lambda: measured(Record.load(folder) for folder in chosen.runs), table, draw, chosen.output)


if __name__ == "__main__":
    start(main)
