"""Cost of accuracy: error over time for every setting that `granular-lmp cost` has measured, and for the theories.

    granular-analysis accuracy runs/cost [-o FILE]

prints the levels of model, and draws error over time, with a marker for each group.

There are two references. A setting of a run is measured against LAMMPS extrapolated from two fine steps, so its error
is that of the setting alone. A level of model (a formula, the exact lattice at some tolerance of its integrator, or
LAMMPS) is measured against the exact lattice, integrated with 1e-12. The row of LAMMPS in that table says how far the
two references differ.

The Pareto front joins the settings that no other beats in both time and error; an error must be smaller by a tenth to
count. The recommended setting is a tolerance, on the fewest spheres: another setting may be cheaper, but a tolerance
reports its own error.
"""

import json
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from math import inf
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from cases.runner import script
from granular_analysis.measure.runs import load
from granular_analysis.measure.signals import errors
from granular_analysis.plotting import page
from granular_analysis.theory.catalogue import missing
from granular_analysis.theory.choice import THEORIES, Trajectory, holding, traits_of, wave_of
from granular_analysis.theory.lattice import torus
from granular_analysis.theory.wave import Wave
from granular_lmp.runs.record import Record

COMPONENTS = ("p", "q", "phi")
MARKED = 1e-3  # error of the setting that the figure marks
RTOL = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10)  # tolerances of the integrator of the exact lattice
FINEST = 1e-12
REPEATS = 9
GAIN = 0.9  # an error must be below this share of another one to count as better
FORMULA, LATTICE, LAMMPS = "closed form", "exact lattice", "LAMMPS"
NOT_CLOSED = ("exact-lattice", "hierarchy")
TOLERANCE = "tolerance"  # the group whose settings report their own error


@dataclass(frozen=True)
class Setting:
    """One point: its family (a group of settings, or a level of model), seconds of rounds, relative errors of p, q, φ.

    An error is None if its component is zero by symmetry or was not recorded.
    """

    family: str
    name: str
    seconds: float
    fastest: float
    slowest: float
    error: dict[str, float | None]

    @property
    def worst(self) -> float:
        """The largest error."""
        return max((value for value in self.error.values() if value is not None), default=inf)


@dataclass(frozen=True)
class Study:
    """Settings of a study folder, and the estimated errors and the record of their reference."""

    settings: list[Setting]
    reference: Setting
    record: Record

    @classmethod
    def load(cls, folder: str | Path) -> "Study":
        """Return the study in a folder; SystemExit with one line if ``cost.json`` or a run cannot be read."""
        path = Path(folder) / "cost.json"
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            best, rows = content["reference"], content["points"]
            if best is None:
                raise ValueError("the reference has not been run; continue granular-lmp cost")
            settings, reference = [_setting(row) for row in rows if row["repeats"]], _setting(best)
            places = [Path(folder) / place for place in best["runs"]]
            share = 1 / (2 ** best["order"] - 1) if best["order"] else 0.0
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise SystemExit(f"{path}: not the result of a finished granular-lmp cost: {error}") from error
        coarse, fine = map(load, places)
        signals = {name: values + share * (values - coarse.signals[name]) for name, values in fine.signals.items()}
        return cls(settings, reference, fine.with_signals(**signals))

    @property
    def floor(self) -> dict[str, float | None]:
        """Estimated error of the reference by component; smaller errors of settings are unknown."""
        return self.reference.error

    @property
    def complete(self) -> list[Setting]:
        """Settings that have an error in each component that the reference has."""
        there = [name for name, value in self.floor.items() if value is not None]
        return [setting for setting in self.settings if all(setting.error[name] is not None for name in there)]


# A study, and the levels of model
Measured = tuple[Study, Sequence[Setting]]


def _setting(row: dict[str, Any]) -> Setting:
    times = (row["seconds"], row["seconds_min"], row["seconds_max"])
    return Setting(row["varied"], row["setting"], *times, {name: row[f"error_{name}"] for name in COMPONENTS})


# --- level of model --------------------------------------------------------------------------------------------------


def models(study: Study, repeats: int = REPEATS) -> list[Setting]:
    """Return formulas, the exact lattice, and the reference of LAMMPS, measured against the exact lattice.

    The list is empty if the run has features that the exact lattice leaves out (`unheld`).
    """
    record = study.record
    if unheld(record):
        return []
    wave, tau = wave_of(record), record.tau
    theories: dict[tuple[str, str], Callable[[], Trajectory]] = {}
    for name in holding(wave):
        if name not in NOT_CLOSED:
            theories[FORMULA, name] = partial(THEORIES[name], wave, tau)
    for rtol in RTOL:
        theories[LATTICE, f"rtol {rtol:.0e}"] = partial(lattice, wave, tau, rtol)
    exact = lattice(wave, tau, FINEST)
    spent: dict[tuple[str, str], list[float]] = {key: [] for key in theories}
    found: dict[tuple[str, str], Trajectory] = {}
    for _ in range(repeats):  # interleaved, so that other load on the machine affects all alike
        for key, theory in theories.items():
            started = time.perf_counter()
            found[key] = theory()
            spent[key].append(time.perf_counter() - started)
    made = []
    for (family, name), values in found.items():
        known = errors(Record.of_centre(tau, *values, scene=record.scene), exact)
        times = spent[family, name]
        made.append(Setting(family, name, median(times), min(times), max(times), known))
    return [*made, replace(study.reference, family=LAMMPS, error=errors(record, exact))]


def unheld(record: Record) -> list[str]:
    """Return the traits of a run that the exact lattice leaves out; the formulas leave out more."""
    return missing("exact-lattice", traits_of(record))


def lattice(wave: Wave, tau: NDArray[np.float64], rtol: float) -> Trajectory:
    """Return p, q, φ of the exact lattice, integrated with a tolerance."""
    return torus(wave, tau, rtol=rtol)


# --- recommendation --------------------------------------------------------------------------------------------------


def front(settings: Iterable[Setting], component: str | None = None) -> list[Setting]:
    """Return the settings that no other beats in both time and error (of one or all components), in order of time."""
    best: list[Setting] = []
    for setting in sorted(settings, key=lambda setting: (setting.seconds, _error(setting, component))):
        if _error(setting, component) < (GAIN * _error(best[-1], component) if best else inf):
            best.append(setting)
    return best


def _error(setting: Setting, component: str | None) -> float:
    if component is None:
        return setting.worst
    value = setting.error[component]
    return inf if value is None else value


def recommended(study: Study) -> Setting | None:
    """Return the setting that the figure marks: the tolerance `MARKED`, if it was measured and met."""
    asked = [s for s in study.complete if s.family == TOLERANCE and np.isclose(float(s.name), MARKED)]
    return next((s for s in asked if s.worst <= MARKED), None)


def table(found: Measured) -> str:
    """Return the levels of model with their seconds and errors, and the error of the reference of the settings."""
    study, levels = found
    lines = [f"{'level of model':16}{'':18}{'s, median':>10}" + "".join(f"{name:>10}" for name in COMPONENTS)]
    for s in levels:
        errors_of = ("-" if value is None else f"{value:.1e}" for value in s.error.values())
        lines.append(f"{s.family:16}{s.name:18}{s.seconds:10.2g}" + "".join(f"{error:>10}" for error in errors_of))
    known = ", ".join(f"{name} {value:.1e}" for name, value in study.floor.items() if value is not None)
    lines += ["", f"error of the reference of the settings, estimated: {known}"]
    if left_out := unheld(study.record):
        lines.append(f"no theory here holds {', '.join(left_out)}: the table has LAMMPS only")
    return "\n".join(lines)


# --- figure ----------------------------------------------------------------------------------------------------------

# Colours by Okabe and Ito; each family also has its own shape, so that it is recognised in grey
STYLES = {
    "time step": ("o", "#0072b2"),
    TOLERANCE: ("D", "#000000"),
    FORMULA: ("$f$", "#000000"),
    LATTICE: ("h", "#ffffff"),
}
JOINED = ("time step", TOLERANCE, LATTICE)  # families with ordered settings, joined by a line
# Offset of a name from its marker, in points, and the end of the name that is there
NAMES: dict[str, tuple[tuple[float, float], str]] = {
    "second-order": ((0, 9), "left"),
    "frequency-shift": ((-3, -10), "right"),
    "three-mode": ((-2, -9), "right"),
}
TITLES = {"p": "$p$ (second harmonic)", "q": "$q$ (fundamental)", "phi": r"$\phi$ (rotation)"}


def draw(found: Measured) -> Figure:
    """Return the figure: errors of p and of q over the seconds, with bars from the fastest to the slowest round.

    The grey area is below the error of the reference of the settings; theories have another reference.
    """
    study, levels = found
    shown = [name for name in COMPONENTS if study.floor[name] is not None][:2]
    figure = page(4.6)
    panels = figure.subplots(1, len(shown), sharex=True, squeeze=False)[0]
    star = recommended(study)
    for axes, name in zip(panels, shown, strict=True):
        axes.set(xscale="log", yscale="log", xlabel="seconds, median", title=f"error of {TITLES[name]}")
        _panel(axes, study, [s for s in levels if s.family != LAMMPS], name)
        if star is not None:
            axes.plot(star.seconds, _error(star, name), zorder=2.5, **STAR)
        axes.margins(x=0.08)
        axes.grid(alpha=0.25, linewidth=0.5)
    panels[0].set_ylabel(rf"relative $L_2$ error, $\tau \leq {study.record.tau[-1]:g}$")
    there = {s.family for s in [*study.settings, *levels]}
    handles: list[Artist] = [Line2D([], [], label=name, **_look(name)) for name in STYLES if name in there]
    handles.append(Line2D([], [], label="Pareto front of the settings", **FRONT))
    if star is not None:
        handles.append(Line2D([], [], label=f"recommended for {MARKED:g}: {star.family}, {star.name}", **STAR))
    handles.append(Patch(label="below the error of the reference", **BELOW))
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


FRONT: dict[str, Any] = {"color": "black", "alpha": 0.2, "linewidth": 6}
BELOW: dict[str, Any] = {"color": "black", "alpha": 0.1, "linewidth": 0}
STAR: dict[str, Any] = {
    "linestyle": "", "marker": "*", "markersize": 20, "color": "white", "markeredgecolor": "black",
}  # fmt: skip


def _panel(axes: Axes, study: Study, levels: Sequence[Setting], name: str) -> None:
    best = [s for s in front(study.complete, name) if _error(s, name) < inf]
    axes.plot([s.seconds for s in best], [_error(s, name) for s in best], zorder=1, **FRONT)
    for family, settings in groupby([*study.settings, *levels], key=lambda s: s.family):
        points = [(s, _error(s, name)) for s in settings if 0 < _error(s, name) < inf]
        look = _look(family)
        line: dict[str, Any] = {"color": "black", "linewidth": 0.7, "zorder": 2}
        if family in JOINED:
            axes.plot([s.seconds for s, _ in points], [error for _, error in points], linestyle=":", **line)
        for s, error in points:
            axes.plot([s.fastest, s.slowest], [error, error], **line)
            axes.plot(s.seconds, error, zorder=3, **look)
            if s.name in NAMES:
                offset, side = NAMES[s.name]
                axes.annotate(
                    s.name, (s.seconds, error), xytext=offset, textcoords="offset points",
                    ha=side, va="center",
                )  # fmt: skip
    low, high = axes.get_ylim()
    if (study.floor[name] or 0.0) > low:
        axes.axhspan(low, study.floor[name] or 0.0, zorder=0, **BELOW)
    axes.set_ylim(low, high)


def _look(family: str) -> dict[str, Any]:
    marker, colour = STYLES.get(family, (".", "black"))
    return {
        "linestyle": "", "marker": marker, "color": colour, "markersize": 7,
        "markeredgecolor": "black", "markeredgewidth": 0.6,
    }  # fmt: skip


def measure(folder: str) -> Measured:
    """Return a study and the levels of model."""
    study = Study.load(folder)
    return study, models(study)


main = script(__name__, measure, table, draw, ("folder", "folder of granular-lmp cost"))
