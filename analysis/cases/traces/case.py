"""Fits of two keys of a sheet to its traces, and to frequencies from the same records: errors, intervals, starts.

    granular-analysis traces RUN RUN [-o FILE]

The runs are LAMMPS's of `sheet.toml`, with the time step of the fits and with a quarter of it. Gaussian noise is added
to the displacements of one column of spheres, as a share of the largest value. Young's modulus and Poisson's ratio are
fitted to these traces, and to the frequencies of L, TR and RT at three wave numbers. A frequency is measured by a
least-squares fit of cosines and sines to the motion with its wave number, which starts at the peak of the spectrum. The
effect of the step h is removed by sin(ωh/2) = Ωh/2; the error is that of the fit. RT, which the strike hardly excites,
is used only if its frequency is known to `SEEN`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cases.runner import script
from granular_analysis.measure.fitting import Fit
from granular_analysis.measure.points import Point
from granular_analysis.measure.spectral_density import density, peaks
from granular_analysis.plotting import legend_above, letter, page
from granular_analysis.theory.estimation import COVERAGE, Estimate, Parameter
from granular_lmp.runs.record import GranularError, Record, Scene

Floats = NDArray[np.float64]
KEYS = "sphere.youngs_modulus", "sphere.poisson_ratio"
KINDS = "displacement_x", "displacement_y"
BRANCHES = ("TR", "RT"), ("L",)  # branches of motion along x, across the wave, and of motion along y
WAVES = 1, 2, 3  # periods of a wave in the cell
SETS = {0.002: 200, 0.02: 200, 0.05: 40, 0.2: 40}  # number of noisy sets for each noise
FEWEST = 10  # least number of answered fits for a point in the figure
FILLED = "full", "none"  # fill styles of the two keys
STARTS = np.geomspace(0.5, 2.0, 10)  # starts, over the true modulus
WITHIN = 0.3  # relative range around a frequency of the model in which the measured one is sought
SEEN = 0.5  # largest phase error over the record, rad; a frequency known less well may be from noise
# Two fits are the same minimum if they agree to this share of an interval; their time steps in seconds differ
MINIMUM = 1.0


@dataclass(frozen=True)
class Level:
    """Fits of one kind of data with one noise.

    Attributes
    ----------
    noise : standard deviation of a value, over the largest value.
    by : "traces" or "frequencies".
    sets : number of fitted sets.
    errors, widths : (F, 2) deviations from the truth, and half intervals, of the F sets whose fit was answered, over
        the true value; for the modulus in its logarithm.
    """

    noise: float
    by: str
    sets: int
    errors: Floats
    widths: Floats

    @property
    def scatter(self) -> Floats:
        """Return the root mean square of the errors, (2,)."""
        return np.sqrt(np.mean(self.errors**2, axis=0))

    @property
    def held(self) -> Floats:
        """Return the share of sets whose interval contains the truth, (2,)."""
        return np.mean(np.abs(self.errors) < self.widths, axis=0)

    def line(self) -> str:
        """Return noise, kind, sets, refused fits, and for both keys error, half interval, and share of hits."""
        cells = [f"{100 * self.noise:g} %", self.by, str(self.sets), str(self.sets - len(self.errors))]
        for key in range(len(KEYS)):
            numbers = self.scatter[key], np.median(self.widths[:, key]), self.held[key]
            cells += [f"{100 * each:.3g} %" for each in numbers]
        return ",".join(cells)


@dataclass(frozen=True)
class Found:
    """All levels; how many of `STARTS` end at the minimum, by kind of data; and the effect of a finer step."""

    levels: Sequence[Level]
    starts: dict[str, int]
    finer: float


@dataclass(frozen=True, eq=False)
class Data:
    """Record of a column of spheres without noise: times (T,) in s, displacements (T, rows, 2) in m."""

    scene: Scene
    times: Floats
    motion: Floats

    @classmethod
    def of(cls, record: Record) -> "Data":
        """Return the record of the monitor of a run, without the start."""
        found, scale = record.monitor("column"), record.scene.scale
        return cls(record.scene, found.tau[1:] * scale.time, found.displacement[1:] * scale.length)

    @property
    def largest(self) -> float:
        """Return the largest displacement, m."""
        return float(np.abs(self.motion).max())

    def noisy(self, noise: float, seed: int) -> "Data":
        """Return the data with noise."""
        draw = np.random.default_rng(seed).normal(size=self.motion.shape)
        return replace(self, motion=self.motion + noise * self.largest * draw)

    def traces(self, error: float) -> list[Point]:
        """Return all values as points with an error in m."""
        return [
            Point(kind, float(self.motion[n, row, way]), error, 1, time=float(time), row=row, column=0)
            for way, kind in enumerate(KINDS)
            for row in range(self.motion.shape[1])
            for n, time in enumerate(self.times)
        ]

    def frequencies(self, error: float, model: Fit) -> list[Point]:
        """Return the frequencies of all waves as points; the model selects the peaks.

        Raises ValueError for a spectrum without a peak.
        """
        rows, step = np.arange(self.motion.shape[1]), self.scene.time.step * self.scene.scale.time
        found = []
        for way, names in enumerate(BRANCHES):
            for xi in dict.fromkeys(each.wavenumber for each in model.points):
                pairs = zip(model.points, model.at_start, strict=True)
                asked = [(each, 2 * np.pi * at) for each, at in pairs if each.wavenumber == xi and each.branch in names]
                moved = self.motion[:, :, way] @ np.exp(-1j * xi * rows)
                # Noise of the real and of the imaginary part is that of half as many rows
                each_of = cosines(self.times, moved, error * np.sqrt(len(rows) / 2), [near for _, near in asked])
                for (point, _), (omega, deviation) in zip(asked, each_of, strict=True):
                    if deviation * self.times[-1] < SEEN:
                        value = 2 / step * np.sin(omega * step / 2) / (2 * np.pi)
                        own = deviation * np.cos(omega * step / 2) / (2 * np.pi)
                        found.append(replace(point, value=float(value), error=float(own)))
        return found


def cosines(
    times: Floats, moved: NDArray[np.complex128], error: float, near: Sequence[float]
) -> list[tuple[float, float]]:
    """Return the frequencies of the cosines and sines that fit a motion, each with its standard deviation, rad/s.

    Parameters
    ----------
    times : (T,) equally spaced, s.
    moved : (T,) complex motion.
    error : standard deviation of the real and of the imaginary part.
    near : expected frequencies, rad/s; the search for the first starts at the nearest peak of the spectrum.

    Raises ValueError for a spectrum without a peak there.
    """
    at, power = density(times, moved[:, None, None])
    tops, begin = peaks(at, power[0, 0]), np.array(near)
    low, high = np.outer((1 - WITHIN, 1 + WITHIN), begin)
    tops = tops[(low[0] < tops) & (tops < high[0])]
    if not len(tops):
        raise ValueError("the spectrum has no peak near the frequency of the model")
    begin[0] = tops[np.argmin(np.abs(tops - near[0]))]

    def left(omega: Floats) -> Floats:
        phases = np.outer(times, omega)
        design = np.concatenate([np.cos(phases), np.sin(phases)], axis=1)
        both = np.stack([moved.real, moved.imag], axis=1) / error
        return np.ravel(both - design @ np.linalg.lstsq(design, both, rcond=None)[0])

    found = least_squares(left, begin, bounds=(low, high), x_scale=1 / times[-1])
    deviations = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    return [*zip(found.x.tolist(), deviations.tolist(), strict=True)]


def with_wave(scene: Scene) -> Scene:
    """Return a scene with a wave in the same crystal, which the theory of frequencies needs."""
    tables, rows = scene.to_dict(), int(scene.packing.rows)
    packing = {"rows": rows, "columns": int(scene.packing.columns), "ends": "periodic"}
    wave = {"mode": "TR", "wavenumber": 2 * np.pi / rows, "amplitude": 0.1}
    return Scene.from_dict(
        {name: tables[name] for name in ("name", "sphere", "time")} | {"packing": packing, "wave": wave}
    )


def model_of(scene: Scene) -> Fit:
    """Return a fit whose predictions at the start are the frequencies of all waves."""
    xis = 2 * np.pi * np.array(WAVES) / int(scene.packing.rows)
    points = [Point("frequency", 1.0, 1.0, 1, name, float(xi)) for xi in xis for names in BRANCHES for name in names]
    return Fit(with_wave(scene), points, KEYS)


def answer(points: Sequence[Point], scene: Scene) -> Estimate | None:
    """Return the fit of points, starting from a scene; None if it is refused, lacks points or leaves a key open."""
    if not points:
        return None
    try:
        found = Fit(scene if points[0].of_trace else with_wave(scene), points, KEYS).answer()
    except (GranularError, ValueError):
        return None
    return None if found.blind else found


def points_of(data: Data, noise: float, seed: int) -> dict[str, list[Point]]:
    """Return the points of a noisy set, by kind of data."""
    own, error = data.noisy(noise, seed), noise * data.largest
    return {"traces": own.traces(error), "frequencies": own.frequencies(error, model_of(data.scene))}


def fitted(data: Data, noise: float, seed: int) -> dict[str, Estimate | None]:
    """Return the fits of a noisy set, by kind of data, starting at the truth."""
    return {by: answer(points, data.scene) for by, points in points_of(data, noise, seed).items()}


def level(noise: float, by: str, answers: Sequence[Estimate | None], truth: Sequence[float]) -> Level:
    """Return the summary of the fits of one kind of data with one noise."""
    rows = []
    for each in filter(None, answers):
        own = zip(each.parameters, each.values, each.intervals[:, 1], truth, strict=True)
        rows.append([of_key(*one) for one in own])
    errors, widths = np.reshape(rows, (-1, len(KEYS), 2)).transpose(2, 0, 1)
    return Level(noise, by, len(answers), errors, widths)


def of_key(key: Parameter, value: float, high: float, true: float) -> tuple[float, float]:
    """Return the deviation of a key from the truth, and half of its interval, both over the true value."""
    size = 1.0 if key.logarithmic else key.inner(true)
    inner = key.inner(value)
    return (inner - key.inner(true)) / size, (key.inner(high) - inner) / size


def measure(records: Sequence[Record]) -> Found:
    """Return all levels, the number of starts that end at the minimum, and the effect of a finer step."""
    data, finer = map(Data.of, records)
    scene = data.scene
    truth = scene.sphere.youngs_modulus, scene.sphere.poisson_ratio
    levels = []
    for noise, sets in SETS.items():
        answers = [fitted(data, noise, seed) for seed in range(sets)]
        levels += [level(noise, by, [each[by] for each in answers], truth) for by in answers[0]]
    exact = answer(finer.traces(1e-3 * finer.largest), scene)
    return Found(levels, starts(data), np.nan if exact is None else float(exact.values[0] / truth[0] - 1))


def starts(data: Data) -> dict[str, int]:
    """Return how many of `STARTS` end at the same minimum as the true modulus, by kind of data."""
    counts = {}
    for by, points in points_of(data, min(SETS), 0).items():
        begun = [data.scene.with_values({KEYS[0]: float(each * data.scene.sphere.youngs_modulus)}) for each in STARTS]
        best, *others = [answer(points, each) for each in (data.scene, *begun)]
        counts[by] = sum(best is not None and other is not None and same(other, best) for other in others)
    return counts


def same(one: Estimate, other: Estimate) -> bool:
    """Return whether two fits are the same minimum."""
    return bool(np.all(np.abs(one.values - other.values) < MINIMUM * np.ptp(other.intervals, axis=1)))


HEAD = (
    "noise,fit of,sets,refused,error of modulus,half of its interval,holds,error of Poisson's ratio,"
    "half of its interval,holds"
)


def table(found: Found) -> str:
    """Return the levels as CSV, and lines for the starts and the time step."""
    of_starts = "; ".join(f"{by} {count} of {len(STARTS)}" for by, count in found.starts.items())
    return "\n".join(
        [
            *(HEAD, *(each.line() for each in found.levels), ""),
            f"starts from {STARTS[0]:g} to {STARTS[-1]:g} times the modulus that end at the minimum: {of_starts}",
            f"step: traces with a quarter of the step give a modulus that differs by {found.finer:.2%}",
        ]
    )


def draw(found: Found) -> Figure:
    """Return the figure: errors of both keys over the noise, and the share of intervals that contain the truth."""
    figure = page(3.5)
    panels = figure.subplots(1, 2, width_ratios=[1.3, 1])
    styles = {"traces": ("C0", "o"), "frequencies": ("C3", "s")}
    for by, (colour, mark) in styles.items():
        own = [each for each in found.levels if each.by == by and len(each.errors) >= FEWEST]
        noise = [100 * each.noise for each in own]
        for key, line in enumerate(("-", "--")):
            error = [100 * each.scatter[key] for each in own]
            styled = {"color": colour, "marker": mark, "markersize": 4, "fillstyle": FILLED[key]}
            name = ("modulus", "Poisson's ratio")[key]
            panels[0].loglog(noise, error, line, label=f"{name}, {by}", **styled)
            held = [100 * each.held[key] for each in own]
            chance = [200 * np.sqrt(COVERAGE * (1 - COVERAGE) / len(each.errors)) for each in own]
            shifted = np.array(noise) * (1 + 0.06 * (2 * key - 1) * (1 if by == "traces" else 2))
            panels[1].errorbar(shifted, held, chance, fmt=mark, color=colour, markersize=4, fillstyle=FILLED[key])
    panels[0].set(xlabel="noise, % of the largest value", ylabel="error of a key, %")
    panels[1].axhline(100 * COVERAGE, color="0.6", linewidth=1)
    panels[1].set(xlabel="noise, % of the largest value", ylabel="intervals that hold the truth, %", xscale="log")
    for axes in panels:
        axes.set(xticks=[100 * each for each in SETS], xticklabels=[f"{100 * each:g}" for each in SETS])
        axes.xaxis.set_minor_locator(NullLocator())
    letter(panels)
    legend_above(panels[0])
    return figure


main = script(__name__, measure, table, draw, ("runs", "runs of sheet.toml, with its step and with a quarter of it"))
