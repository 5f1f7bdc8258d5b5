"""Time a fit, and measure how its error depends on the number of points and on their noise.

    granular-analysis fit_error [--sets N] [-o FILE]

Four stiffnesses of a layer on a substrate are fitted to synthetic frequencies of its six branches at wave numbers that
share the zone evenly, from a start that is wrong by 10 %. A width is half of a 95 % interval, in % of its key, the mean
of N sets; departures are those of the fitted keys from the true ones over half the width, root mean square of all keys
and sets, 0.51 if intervals are right. Trials are frequencies that one fit asks the theory for, seconds its processor
time.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from granular_analysis.measure.fitting import Fit
from granular_analysis.measure.points import Point
from granular_analysis.plotting import parser, save, start
from granular_analysis.theory.estimation import estimate
from granular_lmp.runs.record import Scene

Floats = NDArray[np.float64]
TRUTH = {
    "substrate.normal_stiffness": 1200.0,
    "substrate.shear_stiffness": 900.0,
    "contact.normal_stiffness": 130.0,
    "contact.shear_stiffness": 75.0,
}
# Points and noise: each of both alone, from 24 points with 1 %
SETTINGS = ((6, 0.01), (12, 0.01), (24, 0.01), (48, 0.01), (96, 0.01), (24, 0.001), (24, 0.05))
BRANCHES, EDGE = 6, 3.0  # and rad per row up to which wave numbers go
ASKEW = 75.0  # degrees, off the mirror lines, along which branches cross
SETS = 20
_START = 1.1  # times the true value


class Row(NamedTuple):
    """A line of the table; widths (4,) in %."""

    points: int
    noise: float
    widths: Floats
    departure: float
    trials: float
    seconds: float


def layer() -> Scene:
    """Return the layer with its true stiffnesses."""
    return Scene.load("monolayer_rocking").with_values({**TRUTH})


def exact(count: int) -> list[Point]:
    """Return so many points without noise, whose errors are 1 of their values."""
    rows = count // BRANCHES
    places = [(EDGE * (n + 0.5) / rows, branch) for n in range(rows) for branch in range(1, BRANCHES + 1)]
    asked = [
        Point("frequency", 1.0, 1.0, line, branch=str(branch), wavenumber=xi, direction=ASKEW)
        for line, (xi, branch) in enumerate(places, 2)
    ]
    hertz = Fit(layer(), asked, tuple(TRUTH)).predicted(np.array([*TRUTH.values()]))
    return [replace(each, value=float(value), error=float(value)) for each, value in zip(asked, hertz, strict=True)]


def fitted(points: Sequence[Point]) -> tuple[Floats, Floats, int]:
    """Return widths (4,), departures over them (4,), both in what intervals are symmetric in, and the trials."""
    begin = layer().with_values({key: value * _START for key, value in TRUTH.items()})
    fit, trials = Fit(begin, points, tuple(TRUTH)), 0

    def model(values: Floats) -> Floats:
        nonlocal trials
        trials += 1
        return fit.predicted(values)

    found = estimate(
        fit.parameters, model, [each.value for each in points], [float(each.error or 1) for each in points]
    )
    widths = np.log(found.intervals[:, 1] / found.values)
    return widths, np.log(found.values / [*TRUTH.values()]) / widths, trials


def row(count: int, noise: float, sets: int) -> Row:
    """Return the line of a number of points and a noise."""
    rng, plain, begin = np.random.default_rng([count, round(1e6 * noise)]), exact(count), time.process_time()
    answers = [
        fitted(
            [replace(each, value=each.value * (1 + noise * rng.normal()), error=each.value * noise) for each in plain]
        )
        for _ in range(sets)
    ]
    seconds = (time.process_time() - begin) / sets
    widths, departures, trials = (np.array(each) for each in zip(*answers, strict=True))
    root = float(np.sqrt(np.mean(departures**2)))
    return Row(count, noise, 100 * widths.mean(axis=0), root, float(np.mean(trials)), seconds)


def table(rows: Sequence[Row]) -> str:
    """Return a line for each number of points and noise."""
    names = "".join(f"{key.replace('_stiffness', ''):>18}" for key in TRUTH)
    lines = [f"{'points':15}{names}{'departure':>11}{'trials':>8}{'seconds':>9}"]
    for each in rows:
        widths = "".join(f"{width:18.3g}" for width in each.widths)
        begin = f"{each.points} at {each.noise:.1%}"
        lines.append(f"{begin:15}{widths}{each.departure:11.2f}{each.trials:8.0f}{each.seconds:9.2f}")
    return "\n".join(lines)


def draw(rows: Sequence[Row]) -> Figure:
    """Return the widths over the number of points, beside 1/√n, and over the noise, beside a line through 0."""
    drawing = Figure(figsize=(8, 3.4), layout="constrained")
    panels = drawing.subplots(1, 2, sharey=True)
    for axes, varied, other in ((panels[0], "points", "noise"), (panels[1], "noise", "points")):
        usual = getattr(rows[2], other)
        chosen = sorted(
            (each for each in rows if getattr(each, other) == usual), key=lambda each: getattr(each, varied)
        )
        x = np.array([getattr(each, varied) for each in chosen], dtype=float)
        for key, widths in zip(TRUTH, np.array([each.widths for each in chosen]).T, strict=True):
            (line,) = axes.loglog(x, widths, "o", label=key.replace("_stiffness", "").replace(".", ", "))
            law = (x / rows[2].points) ** -0.5 if varied == "points" else x / rows[2].noise
            width = rows[2].widths[list(TRUTH).index(key)]
            axes.loglog(x, width * law, color=line.get_color(), lw=1)
    panels[0].set(xlabel="points, with noise of 1 %", ylabel="half of the 95 % interval (%)")
    panels[1].set(xlabel="noise, of 24 points")
    panels[0].legend(fontsize=8)
    return drawing


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and draw the widths."""
    command = parser(__doc__, "figures/fit_error.png")
    command.add_argument("--sets", type=int, default=SETS, metavar="N", help=f"of each line (default: {SETS})")
    options = command.parse_args(arguments)
    rows = [row(count, noise, options.sets) for count, noise in SETTINGS]
    print(table(rows))
    save(draw(rows), options.output)


if __name__ == "__main__":
    start(main)
