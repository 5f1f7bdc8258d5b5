"""Fit keys of a scene to measured points, with 95 % intervals, and write the fitted scene, ready to run.

    granular-analysis fit DATA.csv SCENE --free KEY [KEY ...] [--only KIND ...] [--loss LOSS] [-o FIGURE]
        [--json FILE] [--scene FILE]

DATA.csv has a row for each point: a frequency at a wave number, an amplitude of a second harmonic, an arrival or a
speed of the front of an impact, the motion of a sphere at a time (`granular_analysis.measure.points`). The scene, a
file or the name of a shipped one, gives all other numbers and the start of the search. If points have no error, the
error follows from their scatter. If they have, the table gives χ² per degree of freedom, which is 1 if the model and
the errors are right.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from granular_analysis.measure.fitting import Fit, summary
from granular_analysis.measure.points import KINDS, TRACES, UNITS, Point, read
from granular_analysis.measure.surface import Film, is_surface_wave
from granular_analysis.plotting import in_one_line, letter, page, save, scene_of, write, write_scene
from granular_analysis.theory.estimation import LOSSES, Estimate
from granular_analysis.theory.scenes import Setting
from granular_lmp.cli.arguments import changes_argument
from granular_lmp.runs.record import Scene
from granular_lmp.scene.spreadsheets import ERROR, Column

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STRONG = 0.99  # smallest correlation in the report
_FAR = 5.0  # smallest residual in the report, standard deviations
_MOVED = 100.0  # smallest factor between a key and its start in the report
_UNLIKELY = 1e3  # χ² per degree of freedom, and its inverse, above which the report mentions it
_LINES = 200  # wave numbers of a branch in the figure
_DRAWN = 6  # traces in the figure


@dataclass(frozen=True, eq=False)
class Fitted:
    """Fit with its answer, and the columns of its table."""

    fit: Fit
    found: Estimate
    columns: Sequence[Column] = ()

    @property
    def scene(self) -> Scene:
        """Return the scene with the fitted values."""
        return self.fit.at(self.found.values)


def table(fitted: Fitted) -> str:
    """Return the keys with their intervals, the quality of the fit, keys that it cannot determine, and the points."""
    fit, found = fitted.fit, fitted.found
    lines = [f"{'key':30}{'fitted':>13}{'95 % from':>13}{'to':>13}{'start':>13}"]
    for each, value, (low, high) in zip(found.parameters, found.values, found.intervals, strict=True):
        ends = [f"{end:13.6g}" if np.isfinite(end) else f"{'-':>13}" for end in (low, high)]
        lines.append(f"{each.name:30}{value:13.6g}{''.join(ends)}{each.start:13.6g}")
    lines += [
        *_verdict(fitted),
        "",
        f"{'line':>5} {'kind':22}{'branch':>7}{'measured':>13}{'fitted':>13}{'residual':>10}",
    ]
    predicted = fit.predicted(found.values)
    for point, branch, value, residual in zip(
        fit.points, fit.branches(found.values), predicted, found.residuals, strict=True
    ):
        if point.of_trace:
            continue
        unit, size = _unit(point.kind, point.value)
        lines.append(
            f"{point.line:5} {f'{point.kind}, {unit}':22}{branch:>7}{point.value / size:13.6g}{value / size:13.6g}"
            f"{residual:10.2f}"
        )
    for (kind, *_), chosen in _of_traces(fit).items():
        first, values = fit.points[chosen[0]], np.array([fit.points[n].value for n in chosen])
        largest = int(np.argmax(np.abs(values)))
        unit, size = _unit(kind, values[largest])
        scatter = np.sqrt(np.mean(found.residuals[chosen] ** 2))
        lines.append(
            f"{first.line:5} {f'{kind}, {unit}':22}{_place(first):>7}{values[largest] / size:13.6g}"
            f"{predicted[chosen[largest]] / size:13.6g}{scatter:10.2f}"
        )
    lines.append("residuals are in standard deviations of a point")
    if any(each.of_trace for each in fit.points):
        lines.append("a trace shows row/column, its largest value, and the root mean square of its residuals")
    return "\n".join(lines)


def _place(point: Point) -> str:
    """Return the row, column and layer of a point of a trace, if it has them."""
    return "/".join(str(each) for each in (point.row, point.column, point.layer) if each >= 0)


def _of_traces(fit: Fit) -> dict[tuple[str, int, int, int], list[int]]:
    """Return the points of each trace, by kind, row, column and layer."""
    found: dict[tuple[str, int, int, int], list[int]] = {}
    for n, each in enumerate(fit.points):
        if each.of_trace:
            found.setdefault((each.kind, each.row, each.column, each.layer), []).append(n)
    return found


def _verdict(fitted: Fitted) -> list[str]:
    """Return sentences on the residuals, and on keys that the points cannot distinguish."""
    found = fitted.found
    if found.error is not None:
        unit, size = _unit(fitted.fit.points[0].kind, found.error)
        said = [f"error of a point, from the scatter of {len(found.residuals)}: {found.error / size:.4g} {unit}"]
    elif found.freedom:
        said = [f"chi2 = {found.chi_squared:.4g} per degree of freedom, with {found.freedom} degrees"]
    else:
        said = ["as many keys as points: the points cannot test the model"]
    said += [f"slopes of traces are differences of runs: {each}" for each in fitted.fit.remarks]
    said += _unlikely(fitted)
    worst = int(np.argmax(np.abs(found.residuals)))
    if abs(found.residuals[worst]) > _FAR:
        said.append(
            f"line {fitted.fit.points[worst].line} is {abs(found.residuals[worst]):.0f} standard deviations off: try "
            "another branch, another model or a closer start"
        )
    for group in found.blind:
        keys = ", ".join(group)
        said.append(f"the data do not determine {keys}" if len(group) == 1 else f"the data cannot distinguish: {keys}")
    names = [each.name for each in found.parameters]
    for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
        correlation = found.correlations[i, j]
        if abs(correlation) > _STRONG:
            said.append(f"{names[i]} and {names[j]} can hardly be distinguished: correlation {correlation:.4f}")
        elif np.isfinite(correlation):
            said.append(f"correlation of {names[i]} and {names[j]}: {correlation:.2f}")
    return said


def unlikely_units(fit: Fit, columns: Sequence[Column]) -> list[str]:
    """Return a sentence on each kind of point that is about 1000 times, or 1/1000 of, its value at the start."""
    said, pairs = [], list(zip(fit.points, fit.at_start, strict=True))
    for kind in dict.fromkeys(each.kind for each in fit.points):
        own = np.array([(each.value, value) for each, value in pairs if each.kind == kind]).T
        factors = own[0][own[1] > 0] / own[1][own[1] > 0]
        factor = float(np.median(factors)) if len(factors) else 0.0
        if kind in TRACES:
            size = np.linalg.norm(own, axis=1)
            factor = float(size[0] / size[1]) if size[1] else 0.0
        if _thousands(factor):
            said.append(f"{kind} is {factor:.2g} times its value at the start{_perhaps(columns, kind, kind, factor)}")
    return said


def _unlikely(fitted: Fitted) -> list[str]:
    """Return sentences on keys far from their start, and on errors whose size differs from the residuals."""
    found = fitted.found
    said = [
        f"{each.name} is {value / each.start:.2g} times its start"
        for each, value in zip(found.parameters, found.values, strict=True)
        if each.logarithmic and not 1 / _MOVED < value / each.start < _MOVED
    ]
    if found.error is None and found.freedom and not 1 / _UNLIKELY < found.chi_squared < _UNLIKELY:
        size = float(np.sqrt(found.chi_squared))
        unit = _perhaps(fitted.columns, ERROR, fitted.fit.points[0].kind, 1 / size)
        said.append(f"residuals are {size:.2g} times the given errors{unit}")
    return said


def _thousands(factor: float) -> int:
    """Return the power of 1000 nearest to a factor."""
    return round(np.log10(factor) / 3) if 0 < factor < np.inf else 0


def _perhaps(columns: Sequence[Column], quantity: str, kind: str, factor: float) -> str:
    """Return a question about the unit of a column if another unit would explain values `factor` times too large."""
    for column in columns:
        if column.quantity == quantity and column.unit in UNITS[kind]:
            size = UNITS[kind][column.unit] / 1e3 ** _thousands(factor)
            for unit, other in UNITS[kind].items():
                if unit != column.unit and np.isclose(other, size, atol=0):
                    return f"; is the column {quantity}_{column.unit} in {unit}?"
    return ""


def _unit(kind: str, value: float) -> tuple[str, float]:
    """Return the unit of a kind in which a value is at least 1, and its size."""
    ordered = sorted(UNITS[kind].items(), key=lambda each: each[1])
    return next(((name, size) for name, size in reversed(ordered) if abs(value) >= size), ordered[0])


def figure(fitted: Fitted) -> "Figure":
    """Return the figure of the points with fitted branches, traces or predictions, and of the residuals."""
    fit, found = fitted.fit, fitted.found
    drawing = page(3.4)
    left, right = drawing.subplots(1, 2)
    kinds = [each.kind for each in fit.points]
    if set(kinds) == {"frequency"}:
        _branches(fitted, left)
    elif traces := _of_traces(fit):
        _records(fitted, [*traces.values()][:_DRAWN], left)
    else:
        predicted = fit.predicted(found.values)
        for kind in dict.fromkeys(kinds):
            own = [n for n, each in enumerate(kinds) if each == kind]
            unit, size = _unit(kind, max(fit.points[n].value for n in own))
            measured = [fit.points[n].value / size for n in own]
            left.loglog(predicted[own] / size, measured, "o", label=f"{kind.replace('_', ' ')}, {unit}")
        left.axline((1, 1), slope=1, color="0.6", lw=1)
        left.set(xlabel="fitted", ylabel="measured")
        left.legend()
    right.axhspan(-2, 2, color="0.93")
    right.axhline(0, color="0.6", lw=1)
    right.plot([each.line for each in fit.points], found.residuals, "o")
    right.set(xlabel="line of the table", ylabel="residual, standard deviations")
    letter((left, right))
    return drawing


def _branches(fitted: Fitted, axes: "Axes") -> None:
    """Draw measured frequencies over the wave number, on the fitted branches along the direction of the scene.

    Guided surface waves are dashed, and drawn only if there is a point on them.
    """
    fit, scene = fitted.fit, fitted.scene
    setting = Setting(scene)
    xi = np.array([each.wavenumber / (1 if each.unit == "rad/row" else setting.unit) for each in fit.points])
    line = np.linspace(0, max(xi.max() * 1.1, 0.5), _LINES)
    hertz = setting.crystal().modes(setting.wavevector(line)).frequencies / (2 * np.pi)
    unit, size = _unit("frequency", max(each.value for each in fit.points))
    axes.plot(line, hertz / size, color="0.5", lw=1)
    if any(map(is_surface_wave, fit.points)):
        guided = Film.of(setting).coupled.guided(setting.wavevector(line[1:])) / (2 * np.pi * size)
        axes.plot(line[1:], guided, "--", color="C1", lw=1)
    values = [each.value / size for each in fit.points]
    errors = None if fitted.found.error is not None else [(each.error or 0.0) / size for each in fit.points]
    axes.errorbar(xi, values, yerr=errors, fmt="o", ms=4)
    axes.set(xlabel="wave number, rad per row", ylabel=f"frequency, {unit}")


def _records(fitted: Fitted, traces: Sequence[Sequence[int]], axes: "Axes") -> None:
    """Draw measured and fitted traces over time, one above the other, each divided by its largest measured value."""
    fit, predicted = fitted.fit, fitted.fit.predicted(fitted.found.values)
    second = fitted.scene.scale.time
    for height, chosen in enumerate(traces):
        own = [fit.points[n] for n in chosen]
        times, values = np.array([(each.time / second, each.value) for each in own]).T
        largest = 2 * np.abs(values).max() or 1.0
        axes.plot(times, height + values / largest, "o", color="0.6", ms=2)
        axes.plot(times, height + predicted[list(chosen)] / largest, color=f"C{height}", lw=1)
        axes.annotate(f"{own[0].kind} {_place(own[0])}", (times[0], height + 0.5), va="center")
    axes.set(xlabel="time, t0", yticks=[])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status."""
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").partition("\n")[0],
        epilog="A column of DATA.csv is a quantity and its unit: "
        + "; ".join(f"{name} in {', '.join(filter(None, units))}" for name, units in UNITS.items() if name in KINDS)
        + ". Other columns describe the point: branch, wavenumber or wavelength, direction, amplitude, time, row, "
        "column; and its error: error_UNIT or error_%.",
    )
    parser.add_argument("data", metavar="DATA.csv", help="measured points, one per row")
    parser.add_argument("scene", metavar="SCENE", help="file or shipped scene: the model and the start of the fit")
    changes_argument(parser, "sphere.poisson_ratio=0.3")
    parser.add_argument("--free", nargs="+", required=True, metavar="KEY", help="keys of the scene to fit")
    parser.add_argument(
        "--only",
        nargs="+",
        default=[],
        choices=sorted(KINDS),
        metavar="KIND",
        help="use only these columns of values",
    )
    parser.add_argument(
        "--loss", choices=LOSSES, default="linear", help="linear: least squares; the others give outliers less weight"
    )
    parser.add_argument("-o", "--output", metavar="FIGURE", help="draw points, fit and residuals: PNG, PDF or SVG")
    parser.add_argument("--json", metavar="FILE", help="write the full result as JSON")
    parser.add_argument("--scene", dest="fitted", metavar="FILE", help="write the fitted scene, ready to run")
    options = parser.parse_args(arguments)
    with in_one_line():
        scene, (points, measured) = scene_of(options.scene, options), read(options.data, options.only)
        print(measured.understood)
        begun = [each for each in points if not (each.of_trace and each.time < 0)]
        if begun and len(begun) < len(points):
            print(f"left out: {len(points) - len(begun)} values of traces before the start of the run")
            points = begun
        fit = Fit(scene, points, tuple(options.free), options.loss)
        print("".join(f"{each}\n" for each in unlikely_units(fit, measured.columns)), end="")
        fitted = Fitted(fit, fit.answer(), measured.columns)
        print(table(fitted))
    if options.output:
        save(figure(fitted), options.output)
    if options.json:
        write(Path(options.json), json.dumps(summary(fit, fitted.found), indent=2) + "\n")
    if options.fitted:
        write_scene(Path(options.fitted), fitted.scene)
    return 0
