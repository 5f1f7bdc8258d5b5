"""Known keys of scenes, found again from synthetic frequencies with noise: coverage of the intervals, and bias.

    granular-analysis recovery RUN [--sets N] [-o FILE]

For each scene and noise, N sets of frequencies are made from the theory with the true keys, each with Gaussian noise of
a share of the frequency, and fitted from a start that is wrong by 10 %. Coverage is the share of sets whose 95 %
interval holds the true value, for each key; of 500 sets it scatters by 1 %. Bias is the mean departure over half the
width of an interval; it scatters by 0.51/√N.

Frequencies by the JKR law, fitted by the DMT law, show what the residuals say of a wrong model.

RUN is the folder of a sheet that LAMMPS has run (``granular-lmp kick``). The peaks of its spectrum along y are the
points of one more set, without errors, and what its time step shifts is taken back: Ω = (2/h) sin(Ω'h/2) by velocity
Verlet.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from scipy.special import ndtr

from cases.dispersion.density import Sheet, density, peaks
from cases.runner import script
from granular_analysis.measure.fitting import Fit
from granular_analysis.measure.points import Point
from granular_analysis.theory.estimation import Estimate
from granular_lmp.runs.record import Record, Scene

Floats = NDArray[np.float64]
NOISES = (0.001, 0.01, 0.05)
_STYLES = ("-", "--", ":")
SETS = 500
QUANTILE = 1.959964  # a 95 % interval has this many standard errors on each side
_START = 1.1  # times the true value


@dataclass(frozen=True, eq=False)
class Setup:
    """A scene with its true keys, and the places of the points: each of the branches at each wave number."""

    name: str
    scene: Scene
    truth: Mapping[str, float]
    wavenumbers: tuple[float, ...]
    branches: tuple[str, ...]

    @cached_property
    def exact(self) -> list[Point]:
        """Return the points without noise."""
        places = [(xi, branch) for xi in self.wavenumbers for branch in self.branches]
        points = [
            Point("frequency", 1.0, 1.0, line, branch=branch, wavenumber=xi)
            for line, (xi, branch) in enumerate(places, 2)
        ]
        hertz = Fit(self.scene, points, tuple(self.truth)).predicted(np.array([*self.truth.values()]))
        return [Point(**vars(each) | {"value": float(value)}) for each, value in zip(points, hertz, strict=True)]

    def departures(self, noise: float, sets: int, seed: int = 1) -> Floats:
        """Return the departure of each key of each set over half the width of its interval, (sets, P).

        It is taken in what the interval is symmetric in: the logarithm of a positive key.
        """
        rng = np.random.default_rng([seed, round(1e6 * noise), len(self.name)])
        begin = self.scene.with_values({key: value * _START for key, value in self.truth.items()})
        found = []
        for _ in range(sets):
            points = [
                Point(**vars(each) | {"value": each.value * (1 + noise * rng.normal()), "error": each.value * noise})
                for each in self.exact
            ]
            found.append(departure(Fit(begin, points, tuple(self.truth)).answer(), self.truth))
        return np.array(found)


def departure(answer: Estimate, truth: Mapping[str, float]) -> list[float]:
    """Return the departure of each key from the true value over half the width of its interval."""
    rows = zip(answer.parameters, answer.values, answer.intervals, truth.values(), strict=True)
    return [
        (each.inner(value) - each.inner(true)) / (each.inner(high) - each.inner(value))
        for each, value, (_, high), true in rows
    ]


def setups() -> list[Setup]:
    """Return the sheet, the chain of two densities, whose spheres move along it and do not turn, and the monolayer."""
    sheet = Scene.load("tr_periodic")
    chain = Scene.load("l_chain").with_values(
        {
            "packing.ends": "periodic",
            "packing.rows": 40,
            "inclusion": [{"rows": [0, 39], "every": 2, "density": 5000.0}],
        }
    )
    stiffnesses = {
        "substrate.normal_stiffness": 2500.0,
        "substrate.shear_stiffness": 1500.0,
        "contact.shear_stiffness": 150.0,
        "contact.normal_stiffness": 300.0,
    }
    six = (0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
    return [
        Setup("sheet", sheet, {"sphere.youngs_modulus": 7.3e10, "sphere.poisson_ratio": 0.17}, six, ("1", "2", "3")),
        Setup("chain", chain, {"sphere.youngs_modulus": 7.3e10, "inclusion.1.density": 5000.0}, six[:3], ("3", "4")),
        Setup(
            "layer",
            Scene.load("monolayer_rocking").with_values(stiffnesses),
            {key: stiffnesses[key] for key in list(stiffnesses)[:3]},
            (0.0, 1.5),
            ("S1", "S2", "S3"),
        ),
    ]


def kicked(folder: str) -> list[Point]:
    """Return the three branches of a kicked sheet in its run folder, by their peaks along y, Hz.

    Wave vectors whose branches are not three peaks are left out: two are nearer than the resolution.
    """
    sheet, record = Sheet.load(folder), Record.load(folder)
    unit, step = record.scene.sphere.time_scale, record.scene.time.step
    rows = round(sheet.box[1] * 2 / np.sqrt(3))
    wavenumbers = 2 * np.pi / rows * np.arange(1, rows // 2)
    k = np.column_stack([0 * wavenumbers, wavenumbers * 2 / np.sqrt(3)])
    frequencies, power = density(sheet, k)
    found = [peaks(frequencies, each) for each in power]
    return [
        Point("frequency", float(2 / step * np.sin(peak * step / 2) / (2 * np.pi * unit)), None, line, str(branch), xi)
        for line, (xi, row) in enumerate(zip(wavenumbers.tolist(), found, strict=True), 2)
        if len(row) == 3
        for branch, peak in enumerate(row, 1)
    ]


def judged(found: Floats) -> tuple[Floats, Floats]:
    """Return coverage and bias of each key, (P,), from departures (sets, P)."""
    return np.mean(np.abs(found) <= 1, axis=0), np.mean(found, axis=0)


def wrong_law() -> tuple[list[Point], Estimate]:
    """Return frequencies of the sheet by the JKR law, with errors of 1 %, and their fit by the DMT law."""
    sheet = setups()[0]
    points = replace(sheet, scene=sheet.scene.with_values({"sphere.adhesion_law": "jkr"})).exact
    points = [replace(each, error=0.01 * each.value) for each in points]
    return points, Fit(sheet.scene, points, ("sphere.youngs_modulus",)).answer()


def told_of_law() -> str:
    """Return the residuals of the wrong law: a line for each branch, from the smallest wave number on."""
    points, answer = wrong_law()
    lines = [f"JKR by DMT: chi2 = {answer.chi_squared:.1f} a degree of freedom, residuals in standard deviations:"]
    for branch in dict.fromkeys(each.branch for each in points):
        own = [left for each, left in zip(points, answer.residuals, strict=True) if each.branch == branch]
        lines.append(f"JKR by DMT, branch {branch}: " + " ".join(f"{left:6.1f}" for left in own))
    return "\n".join(lines)


def told(folder: str) -> str:
    """Return a line for each key of the sheet, fitted to one that was kicked."""
    sheet, points = setups()[0], kicked(folder)
    begin = sheet.scene.with_values({key: value * _START for key, value in sheet.truth.items()})
    answer = Fit(begin, points, tuple(sheet.truth)).answer()
    lines = [f"kicked sheet: {len(points)} peaks", f"{'key':30}{'fitted':>13}{'departure':>11}"]
    rows = zip(sheet.truth, answer.values, departure(answer, sheet.truth), strict=True)
    return "\n".join(lines + [f"{f'kicked {key}':30}{value:13.6g}{off:11.2f}" for key, value, off in rows])


Found = tuple[Mapping[tuple[str, float, str], Floats], str]  # departures by scene, noise, key; of the sheet in words


def measure(folder: str, sets: int) -> Found:
    """Return the departures of all scenes and noises, and what a kicked sheet gives back."""
    of_sheet = told(folder)
    found = {
        (setup.name, noise, key): own
        for setup in setups()
        for noise in NOISES
        for key, own in zip(setup.truth, setup.departures(noise, sets).T, strict=True)
    }
    return found, of_sheet


def table(found: Found) -> str:
    """Return a line for each scene, noise and key, and the residuals of the wrong law and the kicked sheet."""
    departures, of_sheet = found
    lines = [f"{'scene':9}{'noise':>7}  {'key':24}{'coverage':>9}{'bias':>9}"]
    for (name, noise, key), each in departures.items():
        coverage, bias = judged(each)
        lines.append(f"{f'{name} {noise:.1%}':18}{key:24}{coverage:9.3f}{bias:9.3f}")
    return "\n".join([*lines, told_of_law(), of_sheet])


def draw(measured: Found) -> Figure:
    """Return the share of sets up to each departure, beside the Gaussian one, a panel for each scene."""
    found, _ = measured
    names = list(dict.fromkeys(name for name, _, _ in found))
    drawing = Figure(figsize=(10, 3.8), layout="constrained")
    panels = drawing.subplots(1, len(names), sharey=True)
    x = np.linspace(-2, 2, 101)
    for axes, own in zip(panels, names, strict=True):
        axes.axvspan(-1, 1, color="0.94")
        axes.plot(x, ndtr(QUANTILE * x), color="black", label="Gaussian")
        keys = list(dict.fromkeys(key for name, _, key in found if name == own))
        for (name, noise, key), values in found.items():
            if name == own:
                shares = (np.arange(len(values)) + 0.5) / len(values)
                colour, style = f"C{keys.index(key)}", _STYLES[NOISES.index(noise)]
                label = named(key, keys) if noise == NOISES[0] else None
                axes.step(np.sort(values), shares, lw=1, color=colour, linestyle=style, label=label)
        axes.set(xlabel="departure over half the 95 % interval", title=own, xlim=(-2, 2))
        axes.legend(fontsize=8, loc="upper left", frameon=False)
    handles = [Line2D([], [], color="black", lw=1, ls=style) for style in _STYLES]
    words = [f"noise {noise:.1%}" for noise in NOISES]
    drawing.legend(handles, words, loc="outside lower center", ncols=len(NOISES), fontsize=8, frameon=False)
    panels[0].set_ylabel("share of sets up to it")
    return drawing


def named(key: str, keys: Sequence[str]) -> str:
    """Return the words of a key, with its table where another key of the panel has the same."""
    table, _, name = key.rpartition(".")
    alike = sum(each.rpartition(".")[2] == name for each in keys) > 1
    return name.replace("_", " ") + (f"\nof the {table}" if alike else "")


main = script(
    __name__, measure, table, draw, ("folder", "of a kicked sheet"), options={"sets": (int, SETS, "of each noise")}
)
