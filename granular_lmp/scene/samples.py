"""Signals that are given as samples: in a CSV file, or as pairs in the scene, with the cubic spline through them.

A file is read when its scene is: from then on the scene, its run folder and its deck hold the samples themselves, and
need no second file. Between samples, a step h apart, the signal is the cubic spline that is level at both ends; before
the first sample it is 0, and after the last one it keeps the value of that.
"""

from collections.abc import Sequence
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from granular_lmp.errors import SceneError
from granular_lmp.frozen import dataclass
from granular_lmp.scene.schema import Rule, shown
from granular_lmp.scene.spreadsheets import read, value_of

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

Samples = Sequence[tuple[float, float]]  # (τ, value) of each
HEADER = "tau,value"
FEWEST = 5
# All sources together: a deck of 1 MB, and a scene file below `granular_lmp.scene.files.LARGEST_FILE`
MOST = 10_000
LARGEST = 1e6
UNEVEN = 1e-6  # Steps of τ differ by this share at most: files with seven digits pass
# A spline through every second sample predicts the others to this share of the largest value. Where the signal is
# smooth, that through all of them errs by 1/16 of it; nine samples a period of a sine pass.
SMOOTH = 1e-2
REST = 1e-3  # A signal that ends below this share of its largest value counts as over


@dataclass(frozen=True)
class SignalRule(Rule):
    """Allowed values of a signal: a word, the name of a CSV file, or pairs [τ, value]."""

    @property
    def allowed(self) -> str:
        """Allowed values in words."""
        return f'{super().allowed}, or a file "NAME.csv" with the columns {HEADER}, or a list of [tau, value]'

    def value(self, value: Any, key: str) -> Any:
        """Return a word as it is, and a file or a list as a tuple of pairs.

        Raises
        ------
        SceneError
            If the word is unknown, the file cannot be read, or a number is out of range.
        """
        if isinstance(value, str) and value.endswith(".csv"):
            value = _read(value, key)
        if isinstance(value, list | tuple):
            return checked(_pairs(value, key), key)
        return super().value(value, key)


def located(source: Any, folder: Path) -> Any:
    """Return a table ``[[source]]`` as it was read, with the name of its file relative to the current folder."""
    name = source.get("signal") if isinstance(source, dict) else None
    return source | {"signal": str(folder / name)} if isinstance(name, str) and name.endswith(".csv") else source


def _pairs(value: Sequence[Any], key: str) -> Samples:
    for number, pair in enumerate(value):
        right = isinstance(pair, list | tuple) and len(pair) == 2
        if not right or not all(_is_number(each) for each in pair):
            raise SceneError(
                f"{key}[{number}] = {shown(pair)}: must be [tau, value], two numbers from {-LARGEST:g} to {LARGEST:g}"
            )
    return tuple((float(tau), float(value)) for tau, value in value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST


def _read(name: str, key: str) -> list[list[float]]:
    """Return the pairs of a file."""
    said = f"{key} = {shown(name)}"
    table = read(Path(name), {"tau": {"": 1.0}, "value": {"": 1.0}}, {}, said)
    held = [each.quantity for each in table.columns]
    if sorted(held) != ["tau", "value"]:
        raise SceneError(f"{said}: must have the columns {HEADER}, here {', '.join(held)}")
    pairs = []
    for line, cells in table.rows:
        pairs.append([value_of(cells[held.index(each)]) for each in ("tau", "value")])
        if not all(map(_is_number, pairs[-1])):
            raise SceneError(
                f"{said}: line {line} must be two numbers from {-LARGEST:g} to {LARGEST:g}, here {', '.join(cells)}"
            )
    return pairs


def checked(pairs: Samples, key: str) -> Samples:
    """Return samples as they are.

    Raises
    ------
    SceneError
        If there are fewer than `FEWEST` or more than `MOST`, times do not begin at 0 or grow by unequal steps, the
        first value is not 0 or all are, or a spline through every second one misses the others.
    """

    def refused(what: str) -> SceneError:
        return SceneError(f"{key}: {what}")

    if not FEWEST <= len(pairs) <= MOST:
        raise refused(f"{len(pairs)} samples: must be from {FEWEST} to {MOST}")
    tau, value = np.array(pairs).T
    steps, step = np.diff(tau), tau[-1] / (len(tau) - 1)
    if tau[0] != 0:
        raise refused(f"begins at tau = {tau[0]:g}: must begin at 0; a delay is source.delay")
    if not (steps > 0).all():
        raise refused(f"tau = {tau[1 + np.argmax(steps <= 0)]:g} after a later time: tau must increase")
    if abs(tau - step * np.arange(len(tau))).max() > UNEVEN * step:
        raise refused(
            f"steps of tau from {steps.min():.6g} to {steps.max():.6g}: must be equal to {UNEVEN:g} of a step"
        )
    largest = abs(value).max()
    if value[0] != 0 or largest == 0:
        raise refused(f"first value {value[0]:g}, largest {largest:g}: must begin at 0, and not stay there")
    fit = _through(tau[::2], value[::2], "clamped" if len(tau) % 2 else ((1, 0.0), "not-a-knot"))
    inside = tau <= tau[::2][-1]
    missed = abs(fit(tau) - value)[inside]
    if missed.max() > SMOOTH * largest:
        raise refused(
            f"around tau = {tau[inside][missed.argmax()]:g} every second sample follows from the others to "
            f"{missed.max() / largest:.2g} of the largest only: must be {SMOOTH:g}; take more samples, or smooth them"
        )
    return pairs


def spline(pairs: Samples) -> "CubicSpline":
    """Return the cubic spline through samples, level at both ends."""
    tau, value = np.array(pairs).T
    return _through(tau[-1] / (len(tau) - 1) * np.arange(len(tau)), value, "clamped")


def _through(tau: NDArray[np.float64], value: NDArray[np.float64], ends: Any) -> "CubicSpline":
    from scipy.interpolate import CubicSpline  # slow to import, and only samples need it

    return CubicSpline(tau, value, bc_type=ends)


def pulsation(pairs: Samples) -> float:
    """Return the Ω, rad/t0, of the tone that has the largest value and the largest second derivative of samples."""
    fit = spline(pairs)
    return float(np.sqrt(abs(fit(fit.x, 2)).max() / abs(fit(fit.x)).max()))


def largest(pairs: Samples) -> float:
    """Return the largest absolute value of samples."""
    return max(abs(value) for _, value in pairs)


def end(pairs: Samples) -> float:
    """Return the time until which samples hold, τ: that of the last, infinite if they have come back to 0."""
    tau, value = pairs[-1]
    return inf if abs(value) <= REST * largest(pairs) else tau


def pieces(pairs: Samples) -> NDArray[np.float64]:
    """Return the polynomials of the spline, (4, n + 1): value = c0 + x(c1 + x(c2 + x c3)), x from 0 to 1 in each step.

    The first is that before the first sample, 0; the last that after the last one, a constant. Numbers are rounded to
    13 digits of the largest, as the last ones depend on the processor.
    """
    fit = spline(pairs)
    inside = fit.c[::-1] * fit.x[1] ** np.arange(4)[:, None]
    after = np.array([[fit(fit.x[-1])], [0.0], [0.0], [0.0]])
    scale = largest(pairs)
    return np.asarray(np.hstack([np.zeros((4, 1)), inside, after]) / scale).round(13) * scale + 0.0
