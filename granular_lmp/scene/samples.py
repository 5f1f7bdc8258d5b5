"""Signals given as samples, in a CSV file or as pairs in the scene, and the cubic spline through them.

A file is read together with its scene. Afterwards the scene, its run folder and its deck hold the samples and need no
second file. A measured drive has units in its header and stays in SI units in the scene, behind the head ``["time_s",
"force_N"]``; `granular_lmp.scene.sources.Source.in_units` converts it.

Between samples, a step h apart, the signal is the cubic spline with slope 0 at both ends. Before the first sample the
signal is 0; after the last sample it keeps its last value.
"""

from collections.abc import Sequence
from math import inf, isfinite, pi
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.schema import ArrayRule, Rule, shown
from granular_lmp.scene.spreadsheets import (
    FORCES,
    LENGTHS,
    TIMES,
    Column,
    Heads,
    Quantities,
    read,
    say_understood,
    value_of,
)

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

Samples = Sequence[
    tuple[float, float]
]  # (τ, value) of each sample; (s, value in SI) behind the head of a measured drive
HEADER = "tau,value"
TIME = "time"
# What a measured drive records, for a force, a torque, a motion and a rotation
MEASURED: Quantities = {
    "force": FORCES,
    "torque": {"Nm": 1.0, "mNm": 1e-3, "uNm": 1e-6, "nNm": 1e-9},
    "motion": LENGTHS,
    "angle": {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": pi / 180},
}
QUANTITIES: Quantities = {"tau": {"": 1.0}, "value": {"": 1.0}, TIME: TIMES, **MEASURED}
WORDS = {"t": TIME, "f": "force", "displacement": "motion", "rotation": "angle"}
FEWEST = 5
# For all sources together: the deck then has 1 MB, and the scene file stays below
# `granular_lmp.scene.files.LARGEST_FILE`
MOST = 10_000
LARGEST = 1e6
UNEVEN = 1e-6  # Steps of τ differ by this share at most: files with seven digits pass
# A spline through every second sample must predict the others to this share of the largest value. If the signal is
# smooth, the spline through all samples has 1/16 of this error. Nine samples per period of a sine pass.
SMOOTH = 1e-2
REST = 1e-3  # A signal whose last value is below this share of its largest value has ended


@dataclass(frozen=True)
class SignalRule(Rule):
    """Rule for a signal: a word, the name of a CSV file, or pairs [τ, value]."""

    @property
    def allowed(self) -> str:
        """Allowed values in words."""
        return (
            f'{super().allowed}, or a file "NAME.csv" with the columns {HEADER} or as time_s,force_N, or a list of both'
        )

    def schema(self) -> dict[str, Any]:
        """Return the JSON Schema of a signal."""
        pair = ArrayRule(float, "", "").schema()
        rows = {"anyOf": [pair, pair | {"items": {"type": "string"}}]}  # a head before the pairs
        pairs = {"type": "array", "items": rows, "minItems": FEWEST, "maxItems": MOST + 1}
        return {"anyOf": [{"enum": list(self.words)}, {"type": "string", "pattern": r"\.csv$"}, pairs]}

    def value(self, value: Any, key: str) -> Any:
        """Return a word unchanged, and a file or a list as a tuple of pairs.

        Raises
        ------
        SceneError
            If the word is unknown, the file cannot be read, or a number is out of range.
        """
        if isinstance(value, str) and value.endswith(".csv"):
            return _read(value, key)
        if isinstance(value, list | tuple):
            return checked(_pairs(value, key), key)
        return super().value(value, key)


def located(source: Any, folder: Path) -> Any:
    """Return a table ``[[source]]`` with the name of its file relative to the current folder."""
    name = source.get("signal") if isinstance(source, dict) else None
    return source | {"signal": str(folder / name)} if isinstance(name, str) and name.endswith(".csv") else source


def _pairs(value: Sequence[Any], key: str) -> Samples:
    """Return pairs of numbers; the head of a measured drive, if any, comes first."""
    names, pairs = split(value)
    for number, pair in enumerate(pairs, len(value) - len(pairs)):
        right = isinstance(pair, list | tuple) and len(pair) == 2
        if not right or not all(_is_number(each) for each in pair):
            raise SceneError(f"{key}[{number}] = {shown(pair)}: must be [tau, value], two numbers")
    try:
        columns = _two([Heads(QUANTITIES, WORDS).checked(each) for each in names]) if names else ()
    except ValueError as error:
        raise SceneError(f"{key}[0] = {shown(names)}: {error}") from error
    return _ordered(columns, [(float(first), float(second)) for first, second in pairs])


def _two(columns: Sequence[Column]) -> tuple[Column, ...]:
    """Return the columns; ValueError unless they are τ and values, or a time and a measured quantity."""
    held = {each.quantity for each in columns}
    if len(columns) != 2 or not (held == {"tau", "value"} or (TIME in held and held & MEASURED.keys())):
        must = ", ".join(f"{name}_{_si(name)}" for name in MEASURED)
        here = ", ".join(each.quantity for each in columns)
        raise ValueError(
            f"must have the columns {HEADER}, or {TIME}_s and one of {must} (or another unit), here {here}"
        )
    return tuple(columns)


def _si(quantity: str) -> str:
    """Return the SI unit of a quantity."""
    return next(iter(QUANTITIES[quantity]))


def _ordered(columns: Sequence[Column], pairs: Samples) -> Any:
    """Return pairs with the time first; measured pairs are in SI units behind their head."""
    sizes = [QUANTITIES[each.quantity][each.unit] for each in columns] or [1.0, 1.0]
    held = [each.quantity for each in columns] or ["tau", "value"]
    way = 1 if held[0] in ("tau", TIME) else -1
    rows = tuple((first * sizes[0], second * sizes[1])[::way] for first, second in pairs)
    head = tuple(f"{name}_{_si(name)}" for name in held[::way])
    return rows if "tau" in held else (head, *rows)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _read(name: str, key: str) -> Samples:
    """Return the samples in a file."""
    said = f"{key} = {shown(name)}"
    table = read(Path(name), QUANTITIES, WORDS, said)
    try:
        columns = _two(table.columns)
    except ValueError as error:
        raise SceneError(f"{said}: {error}") from error
    pairs = [(value_of(first), value_of(second)) for _, (first, second) in table.rows]
    for (line, cells), pair in zip(table.rows, pairs, strict=True):
        if not all(map(isfinite, pair)):
            raise SceneError(f"{said}: line {line} must be two numbers, here {', '.join(cells)}")
    if TIME in {each.quantity for each in columns}:  # a measured drive comes from anywhere
        say_understood(table)
    return checked(_ordered(columns, pairs), key)


def checked(pairs: Samples, key: str) -> Samples:
    """Return the samples after checks.

    Raises
    ------
    SceneError
        If there are fewer than `FEWEST` or more than `MOST` samples, if times do not begin at 0 or have unequal steps,
        if the first value is not 0 or all values are, or if a spline through every second sample misses the others.
    """
    head, rows = split(pairs)
    name = head[0] if head else "tau"

    def refused(what: str) -> SceneError:
        return SceneError(f"{key}: {what}")

    if not FEWEST <= len(rows) <= MOST:
        raise refused(f"{len(rows)} samples: must be from {FEWEST} to {MOST}")
    tau, value = np.array(rows).T
    if (most := max(abs(tau).max(), abs(value).max())) > LARGEST:
        raise refused(f"{most:g} among the numbers: must be from {-LARGEST:g} to {LARGEST:g}")
    steps, step = np.diff(tau), tau[-1] / (len(tau) - 1)
    if tau[0] != 0:
        raise refused(f"begins at {name} = {tau[0]:g}: must begin at 0; a delay is source.delay")
    if not (steps > 0).all():
        raise refused(f"{name} = {tau[1 + np.argmax(steps <= 0)]:g} after a later time: {name} must increase")
    if abs(tau - step * np.arange(len(tau))).max() > UNEVEN * step:
        raise refused(
            f"steps of {name} from {steps.min():.6g} to {steps.max():.6g}: must be equal within {UNEVEN:g} of a step"
        )
    largest = abs(value).max()
    if value[0] != 0 or largest == 0:
        raise refused(f"first value {value[0]:g}, largest {largest:g}: must begin at 0, and not be 0 throughout")
    fit = _through(tau[::2], value[::2], "clamped" if len(tau) % 2 else ((1, 0.0), "not-a-knot"))
    inside = tau <= tau[::2][-1]
    missed = abs(fit(tau) - value)[inside]
    if missed.max() > SMOOTH * largest:
        raise refused(
            f"around {name} = {tau[inside][missed.argmax()]:g} a spline through every second sample misses the others "
            f"by {missed.max() / largest:.2g} of the largest: must be at most {SMOOTH:g}; use more samples, or smooth "
            "them"
        )
    return pairs


def split(samples: Sequence[Any]) -> tuple[Sequence[str], Samples]:
    """Return the head of the samples, () if there is none, and the pairs."""
    first = samples[0] if samples else ()
    head = isinstance(first, list | tuple) and first and all(isinstance(each, str) for each in first)
    return (first, samples[1:]) if head else ((), samples)


def spline(pairs: Samples) -> "CubicSpline":
    """Return the cubic spline through samples, with slope 0 at both ends."""
    tau, value = np.array(pairs).T
    return _through(tau[-1] / (len(tau) - 1) * np.arange(len(tau)), value, "clamped")


def _through(tau: NDArray[np.float64], value: NDArray[np.float64], ends: Any) -> "CubicSpline":
    from scipy.interpolate import CubicSpline  # slow to import, and only samples need it

    return CubicSpline(tau, value, bc_type=ends)


def pulsation(pairs: Samples) -> float:
    """Return the Ω, rad/t0, of a tone with the same largest value and largest second derivative as the samples."""
    fit = spline(pairs)
    return float(np.sqrt(abs(fit(fit.x, 2)).max() / abs(fit(fit.x)).max()))


def largest(pairs: Samples) -> float:
    """Return the largest absolute value of samples."""
    return max(abs(value) for _, value in pairs)


def end(pairs: Samples) -> float:
    """Return the last time of the signal, τ: that of the last sample, or infinity if the signal has ended at 0."""
    tau, value = pairs[-1]
    return inf if abs(value) <= REST * largest(pairs) else tau


def pieces(pairs: Samples) -> NDArray[np.float64]:
    """Return the polynomials of the spline, (4, n + 1): value = c0 + x(c1 + x(c2 + x c3)), x from 0 to 1 in each step.

    The first polynomial is 0, before the first sample; the last one is a constant, after the last sample. Numbers are
    rounded to 13 digits of the largest, because further digits depend on the processor.
    """
    fit = spline(pairs)
    inside = fit.c[::-1] * fit.x[1] ** np.arange(4)[:, None]
    after = np.array([[fit(fit.x[-1])], [0.0], [0.0], [0.0]])
    scale = largest(pairs)
    return np.asarray(np.hstack([np.zeros((4, 1)), inside, after]) / scale).round(13) * scale + 0.0
