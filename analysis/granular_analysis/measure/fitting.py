"""Least-squares fit of keys of a scene to measured points.

| measured | predicted by |
|---|---|
| frequency | modes of the scene's crystal (`granular_analysis.theory.scenes.Setting`) |
| frequency of a surface wave | `granular_analysis.measure.surface` |
| second harmonic | theory of second order |
| arrival, front speed | integration of Hertz's springs (`granular_analysis.measure.arrivals`) |
| trace | motion of spheres in a run of the network, with exact slopes (`granular_analysis.measure.traced_runs`) |
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.arrivals import fronts
from granular_analysis.measure.points import Point
from granular_analysis.measure.surface import BRANCH, Film, is_surface_wave
from granular_analysis.measure.traced_runs import TracedRuns
from granular_analysis.theory.bloch import branch_among, frame, in_plane
from granular_analysis.theory.branches import branch_named, names_of
from granular_analysis.theory.crystal import PLANE, Crystal, Modes
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.estimation import Estimate, Loss, Parameter, estimate
from granular_analysis.theory.scenes import Setting
from granular_lmp.runs.record import GranularError, Scene

Floats = NDArray[np.float64]
_APART = 1e-5  # relative change of a key for a difference
_NEXT_TO_0 = 1e-3  # rad per row, in place of 0: frequencies change by 1e-6, and degenerate branches split


@dataclass(frozen=True, eq=False)
class Fit:
    """Measured points and the free keys of a scene.

    Attributes
    ----------
    scene : the scene with all other keys; its values of the free keys start the search.
    points : measured points, N.
    keys : free keys, P; each has a number as value.
    loss : as in `granular_analysis.theory.estimation.estimate`.

    Raises ValueError without a free key, for a key named twice, for errors given to some of the points only, and for
    points of several kinds without errors.
    """

    scene: Scene
    points: Sequence[Point]
    keys: tuple[str, ...]
    loss: Loss = "linear"

    def __post_init__(self) -> None:
        if not self.keys:
            raise ValueError("no key is free; name one or more")
        if twice := {key for key in self.keys if self.keys.count(key) > 1}:
            raise ValueError(f"{', '.join(sorted(twice))}: named twice")
        given = [each.error is not None for each in self.points]
        if any(given) and not all(given):
            line = self.points[given.index(False)].line
            raise ValueError(f"line {line}: has no error, and others have one; give an error for all points, or none")
        alike = {each.kind.partition("_")[0] if each.of_trace else each.kind for each in self.points}
        if len(alike) > 1 and not all(given):
            raise ValueError("points of several kinds need their errors, which set their weights")

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Return the free keys with start and range; raise ValueError for a key that is not a number of the scene."""
        return tuple(self._parameter(key) for key in self.keys)

    def _parameter(self, key: str) -> Parameter:
        section, _, name = key.rpartition(".")
        value = self.scene.value(key)
        if value is None:
            self._refuse_undeclared(key, section, name)
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise ValueError(f"--free {key}: must be a number that the scene declares, not {value!r}")
        if section in self.scene.layout.sections:
            rule = next(each.rule for each in self.scene.keys_of(section) if each.name == name)
            low, high = (rule.interval.low, rule.interval.high) if rule.interval else (-np.inf, np.inf)
        else:  # each number in an array of tables is positive
            low, high = 0.0, np.inf
        return Parameter(key, float(value), float(low), float(high))

    def _refuse_undeclared(self, key: str, section: str, name: str) -> NoReturn:
        """Raise ValueError or SceneError for a key that no scene has, or that has no value in this scene."""
        if section in self.scene.layout.sections and name in [own.name for own in self.scene.keys_of(section)]:
            raise ValueError(f"--free {key}: has no value in the scene; give the value from which the search starts")
        self.scene.with_values({key: 1.0})  # its error suggests the nearest key
        raise ValueError(f"--free {key}: must be a number that the scene declares")

    def at(self, values: Floats) -> Scene:
        """Return the scene with values of the free keys."""
        return self.scene.with_values(dict(zip(self.keys, map(float, values), strict=True)))

    def predicted(self, values: Floats) -> Floats:
        """Return the predicted points (N,), in SI units, for values (P,) of the free keys."""
        scene, found = self.at(values), np.empty(len(self.points))
        if self._traced.any():
            found[self._traced] = self._traces.predicted(scene)
        found[~self._traced] = self._others(scene)
        return found

    def _others(self, scene: Scene) -> Floats:
        """Return the predictions for the points that are not of a trace."""
        points = [each for each in self.points if not each.of_trace]
        found, kinds = np.empty(len(points)), [_theory(each) for each in points]
        for kind, rule in _RULES.items():
            chosen = [n for n, each in enumerate(kinds) if each == kind]
            if chosen:
                found[chosen] = rule(scene, [points[n] for n in chosen])
        return found

    @cached_property
    def _traced(self) -> NDArray[np.bool_]:
        return np.array([each.of_trace for each in self.points])

    @cached_property
    def _traces(self) -> TracedRuns:
        return TracedRuns(self.scene, [each for each in self.points if each.of_trace])

    @cached_property
    def remarks(self) -> dict[str, None]:
        """Reasons, as keys, why slopes of traces were differences of runs; a search adds them as it meets them."""
        return {}

    def slopes(self, values: Floats) -> Floats:
        """Return the slopes of the points with respect to the free keys, (N, P).

        Slopes of traces are exact, unless `remarks` says why not; all others are differences.
        """
        found, others, whole = np.empty((len(self.points), len(self.keys))), ~self._traced, False
        try:
            found[self._traced] = self._traces.slopes(self.at, values)
        except TheoryError as error:
            self.remarks[str(error)] = None
            whole = True
        if whole or others.any():
            rule, left = (self.predicted, ~others | others) if whole else (lambda at: self._others(self.at(at)), others)
            for n, change in enumerate(np.diag(_APART * np.where(values, np.abs(values), 1.0))):
                found[left, n] = _difference(rule, values, change) / change[n]
        return found

    @cached_property
    def at_start(self) -> Floats:
        """Return the predicted points (N,) for the values that the scene declares."""
        return self.predicted(np.array([each.start for each in self.parameters]))

    def answer(self) -> Estimate:
        """Return the least-squares estimate of the free keys.

        Raises ValueError for a scene or a point that no theory here holds, and GranularError for declared values that
        a scene may not have.
        """
        errors = [each.error for each in self.points if each.error is not None]
        start = np.array([each.start for each in self.parameters])
        # A refusal at the start is the error of the fit; a search asks twice for its first and its last values
        known = {start.tobytes(): self.at_start}

        def model(values: Floats) -> Floats:
            place = values.tobytes()
            if place not in known:
                known[place] = self._tried(values)
            return known[place]

        slopes = self.slopes if self._traced.any() else None
        measured = [each.value for each in self.points]
        return estimate(self.parameters, model, measured, errors or None, self.loss, slopes)

    def _tried(self, values: Floats) -> Floats:
        """Return the predicted points (N,); nan for values that a scene may not have."""
        try:
            return self.predicted(values)
        except (GranularError, ValueError):
            return np.full(len(self.points), np.nan)

    def branches(self, values: Floats) -> list[str]:
        """Return the branch of each point: as the table names it, or the number, from 1, nearest to its frequency."""
        found = [each.branch for each in self.points]
        near = [n for n, each in enumerate(self.points) if each.kind == "frequency" and not each.branch]
        if near:
            chosen = [self.points[n] for n in near]
            for n, number in zip(near, _branches(_modes(self.at(values), chosen), chosen), strict=True):
                found[n] = str(number + 1)
        return found


def _difference(rule: Callable[[Floats], Floats], values: Floats, change: Floats) -> Floats:
    """Return the change of a rule when its values change by `change`: a central difference, one-sided at a bound."""
    ends = []
    for way in (1, -1):
        try:
            ends.append((way, rule(values + way * change)))
        except (GranularError, ValueError) as error:
            refused = error
    if not ends:
        raise refused
    (first, found), (last, other) = ends[0], ends[-1] if len(ends) > 1 else (0, rule(values))
    return np.asarray((found - other) / (first - last))


def _theory(point: Point) -> str:
    """Return the key of `_RULES` for a point."""
    return BRANCH if is_surface_wave(point) else {"speed": "arrival"}.get(point.kind, point.kind)


def wavevectors(setting: Setting, points: Sequence[Point]) -> Floats:
    """Return the wave vectors of points, (N, 2) in rad/m; at least 1e-3 rad per row, as branches have no names at 0."""
    unit, along = setting.unit, setting.scene.direction
    lengths = [each.wavenumber * (unit if each.unit == "rad/row" else 1.0) for each in points]
    degrees = [along if each.direction is None else each.direction for each in points]
    ways = {each: frame(each)[0] for each in set(degrees)}
    return np.maximum(lengths, _NEXT_TO_0 * unit)[:, None] * np.reshape([ways[each] for each in degrees], (-1, 2))


class _Found(NamedTuple):
    """The crystal of a scene, the wave vectors of points (N, 2) in rad/m, and its modes there."""

    crystal: Crystal
    wavevectors: Floats
    modes: Modes


def _modes(scene: Scene, points: Sequence[Point]) -> _Found:
    """Return the modes of a scene's crystal at the wave vectors of points."""
    setting = Setting(scene)
    crystal, k = setting.crystal(), wavevectors(setting, points)
    return _Found(crystal, k, crystal.modes(k))


def _branches(found: _Found, points: Sequence[Point]) -> NDArray[np.intp]:
    """Return the index of the branch of each point, (N,): by its name, by its number, or the nearest in frequency."""
    hertz = found.modes.frequencies / (2 * np.pi)
    chosen = np.argmin(np.abs(hertz - np.array([each.value for each in points])[:, None]), axis=1)
    numbers = [str(branch + 1) for branch in range(hertz.shape[1])]
    known: dict[bytes, dict[str, int]] = {}  # names at each wave vector
    for n, each in enumerate(points):
        if each.branch in numbers:
            chosen[n] = numbers.index(each.branch)
        elif each.branch:
            try:
                chosen[n] = _named(found, n, each.branch, known)
            except ValueError as error:
                raise ValueError(f"line {each.line}: branch: {error}") from error
    return chosen


def _named(found: _Found, number: int, name: str, known: dict[bytes, dict[str, int]]) -> int:
    """Return the index of the branch with a name at the wave vector of a point; `known` caches names by vector."""
    if len(found.crystal) == 1 and found.crystal.freedoms in (PLANE, PLANE[:2]):  # the modes are there already
        return int(branch_among(name, in_plane(found.modes.shapes[number]), found.wavevectors[number]))
    place = found.wavevectors[number].tobytes()
    if place not in known:
        known[place] = names_of(found.crystal, found.wavevectors[number], found.modes.shapes[number])
    return branch_named(known[place], name)


def _frequencies(scene: Scene, points: Sequence[Point]) -> Floats:
    """Return the frequencies of waves in the crystal, Hz."""
    found = _modes(scene, points)
    chosen = _branches(found, points)
    return np.take_along_axis(found.modes.frequencies, chosen[:, None], axis=1)[:, 0] / (2 * np.pi)


def _surface_waves(scene: Scene, points: Sequence[Point]) -> Floats:
    """Return the frequencies of surface waves of the substrate, Hz."""
    setting = Setting(scene)
    return Film.of(setting).met(points, wavevectors(setting, points))


def _harmonics(scene: Scene, points: Sequence[Point]) -> Floats:
    """Return the amplitudes |C| of second harmonics in m, each for its own wave number, amplitude and time."""
    setting, waves = Setting(scene), dict[tuple[float, float], list[int]]()  # points of one wave at several times
    for n, each in enumerate(points):
        xi = each.wavenumber * (1.0 if each.unit == "rad/row" else 1 / setting.unit)
        waves.setdefault((xi, each.amplitude), []).append(n)
    found = np.empty(len(points))
    for (xi, amplitude), chosen in waves.items():
        numbers = {"wave.wavenumber": xi} if xi else {}
        own = scene.with_values({"wave.amplitude": amplitude / scene.sphere.static_overlap} | numbers)
        # The measured wave number, even if a periodic cell of the scene would round it
        fields, _ = Setting(own, numbers).harmonic([points[n].time / own.sphere.time_scale for n in chosen])
        found[chosen] = np.linalg.norm(fields, axis=1) * amplitude
    return found


_RULES: dict[str, Callable[[Scene, Sequence[Point]], Floats]] = {
    "frequency": _frequencies,
    BRANCH: _surface_waves,
    "second_harmonic": _harmonics,
    "arrival": fronts,
}


def summary(fit: Fit, found: Estimate) -> dict[str, Any]:
    """Return a fit as plain values for its JSON; None stands for nan and inf."""

    def plain(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    predicted, branches = fit.predicted(found.values), fit.branches(found.values)
    return {
        "scene": fit.scene.name,
        "keys": {
            each.name: {"value": float(value), "start": each.start, "from": plain(low), "to": plain(high)}
            for each, value, (low, high) in zip(found.parameters, found.values, found.intervals, strict=True)
        },
        "chi_squared_a_degree_of_freedom": plain(found.chi_squared) if found.error is None else None,
        "degrees_of_freedom": found.freedom,
        "error": found.error,
        "correlations": [[plain(value) for value in row] for row in found.correlations],
        "cannot_tell_apart": [list(group) for group in found.blind],
        "points": [
            {"line": each.line, "kind": each.kind, "branch": branch, "measured": each.value, "fitted": float(value)}
            | {"residual": float(residual)}
            | ({name: getattr(each, name) for name in ("time", "row", "column")} if each.of_trace else {})
            for each, branch, value, residual in zip(fit.points, branches, predicted, found.residuals, strict=True)
        ],
    }
