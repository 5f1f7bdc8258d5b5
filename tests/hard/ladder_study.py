"""How often a ladder to a tolerance ends too early, and what it costs: random small scenes beside runs of fine steps.

Each scene of `tests.hard.ladder_scenes` is run with many steps. Its reference is a polynomial in the step through the
finer runs; it must agree with other such polynomials, and its error, with that of rounding, must be below a tenth of
the tolerance, or the signal does not count. The ladder is that of a run with ``time.tolerance``: first step, answer,
estimate and next step are the functions that it calls. Its cost is compared with that of the cheapest ladder of two or
three runs, n and 2n with 3n or 4n, that truly meets the tolerance, for any n.

    python -m tests.hard.ladder_study --write docs/ladders.csv
"""

import argparse
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, inf, sqrt
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from granular_lmp import ImpactScene, Scene, run
from granular_lmp.accuracy import collisions
from granular_lmp.accuracy.estimates import slip_bounds
from granular_lmp.accuracy.extrapolation import ALL, EVEN, Judgement, combined, following, judge, l2, weights_of
from granular_lmp.accuracy.ladder import plan
from granular_lmp.accuracy.rounding import judged, noise_floor
from granular_lmp.effects.selection import order
from granular_lmp.errors import GranularError
from granular_lmp.problem import prepare
from tests.hard.ladder_scenes import FAMILIES, IMPACTS, impact_scene, wave_scene
from tests.pages import write_table

Floats = NDArray[np.float64]
Signals = dict[str, Floats]
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4)
FACTORS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64)  # runs of each scene, over the fewest steps per sample
FINEST = 400  # steps per sample: the study does not follow a ladder beyond
FIRST_SEED = 600  # no scene with which the estimate was made


class Case:
    """A scene with its runs by steps per sample, made when they are asked for."""

    def __init__(self, family: str, seed: int) -> None:
        self.family, self.is_impact = family, family in IMPACTS
        self.runs: dict[int, Signals | None] = {}
        if self.is_impact:
            self.impact = impact_scene(family, seed)
            self.problem = prepare(self.impact)
            self.order = order(self.impact)
            self.scene: Scene | ImpactScene = self.impact
            self.fewest = max(1, ceil(self.scene.time.sample * 8 / self.problem.rest.shortest_collision))
        else:
            wave = wave_scene(family, seed)
            self.problem = prepare(wave.with_values({"time.timestep": wave.time.sample / 1000}))
            self.wave = self.problem.scene
            self.order = order(self.wave)
            self.scene = self.wave
            self.fewest = int(self.scene.time.sample / min(rule.first for rule in self.problem.rest.step_rules())) + 1

    def norm(self, values: Floats) -> float:
        """Return the size that errors have: L2 of waves, the largest of impacts."""
        return float(np.max(np.abs(values))) if self.is_impact else l2(values)

    def signals(self, count: int) -> Signals | None:
        """Return the signals of a run, None of one that fails."""
        if count not in self.runs:
            self.runs[count] = self._made(count)
        return self.runs[count]

    def _made(self, count: int) -> Signals | None:
        changes = {"time.timestep": self.scene.time.sample / count}
        with tempfile.TemporaryDirectory() as folder:
            try:
                if self.is_impact:
                    made = run(self.impact.with_values(changes), Path(folder) / "run").signals
                    return {name: made[name] for name in made if name != "displacement"}
                record = run(self.wave.with_values(changes), Path(folder) / "run")
            except GranularError:
                return None
            return {name: record.signals[name] for name in judged(record.problem, record.signals)}

    @cached_property
    def made(self) -> list[tuple[int, Signals]]:
        """The runs of the study, from the longest step."""
        found = [(factor * self.fewest, self.signals(factor * self.fewest)) for factor in FACTORS]
        if self.order == 0:
            found += [(count, self.signals(count)) for count in (96 * self.fewest, 192 * self.fewest)]
        return [(count, signals) for count, signals in found if signals is not None]

    @cached_property
    def reference(self) -> tuple[Signals, dict[str, float]]:
        """The truth, and its absolute error."""
        first, degrees = (-3, (0, 1)) if self.order == 0 else (-5, (1, 2, 3)) if self.is_impact else (2, range(2, 8))
        runs = self.made[first:]
        tried = [
            [
                _fitted(runs[start:], name, degree)
                for start in range(len(runs))
                for degree in degrees
                if len(runs) - start > degree
            ]
            for name in runs[-1][1]
        ]
        truth, error = {}, {}
        for name, values in zip(runs[-1][1], tried, strict=True):
            apart = np.array([[self.norm(one - other) for one in values] for other in values])
            apart.sort(axis=1)
            third = min(3, len(values) - 1)
            best = int(np.argmin(apart[:, third]))
            truth[name], error[name] = values[best], 2 * float(apart[best, third]) + self._noise(runs[-1][0])
        return truth, error

    def _noise(self, count: int) -> float:
        if self.is_impact:
            return 0.0
        fine = self.wave.with_values({"time.timestep": self.scene.time.sample / count})
        return noise_floor(fine) * sqrt(self.scene.time.samples)

    def size(self, name: str) -> float:
        """Return what the error of a signal is relative to."""
        return 1.0 if self.is_impact else self.norm(self.reference[0][name])

    def counted(self, tolerance: float) -> list[str]:
        """Return the signals whose reference is good enough for a tolerance."""
        return [name for name, error in self.reference[1].items() if error < tolerance / 10 * self.size(name)]

    def error(self, runs: Sequence[Signals], weights: Sequence[float], names: Sequence[str]) -> float:
        """Return the true error of a sum of runs."""
        truth = self.reference[0]
        return max(
            self.norm(combined([each[name] for each in runs], weights) - truth[name]) / self.size(name)
            for name in names
        )

    def first(self, tolerance: float) -> int:
        """Return the steps per sample of the first run."""
        return plan(prepare(self.scene.with_values({"time.tolerance": tolerance})))[0]

    def judgement(self, runs: Sequence[Signals], counts: Sequence[int], names: Sequence[str]) -> Judgement:
        """Return what a run with a tolerance finds."""
        if self.is_impact:
            return collisions.judge([{name: each[name] for name in names} for each in runs], counts, self.order)
        return judge(
            [{name: each[name] for name in names} for each in runs],
            counts,
            self.order,
            hidden=slip_bounds(self.problem, runs[-1]),
        )

    def cheapest(self, tolerance: float) -> float:
        """Return the steps per sample of the cheapest ladder that meets a tolerance."""
        names, made, best = self.counted(tolerance), dict(self.made), inf
        for count in made:
            for ladder in ((1, 2), (1, 2, 3), (1, 2, 4)):
                counts = [count * each for each in ladder]
                if not set(counts) <= set(made) or sum(counts) >= best:
                    continue
                runs = [made[each] for each in counts]
                sums = [weights_of(counts, powers[: len(counts) - 1]) for powers in (EVEN, ALL)]
                sums.append(np.eye(len(counts))[-1])
                if min(self.error(runs, weights, names) for weights in sums) <= tolerance:
                    best = sum(counts)
        return best


def _fitted(runs: Sequence[tuple[int, Signals]], name: str, degree: int) -> Floats:
    """Return the value at step 0 of the polynomial in the step through runs, by least squares."""
    step = np.array([runs[0][0] / count for count, _ in runs])
    weights = np.linalg.pinv(step[:, None] ** np.arange(degree + 1))[0]
    return combined([signals[name] for _, signals in runs], weights)


@dataclass(frozen=True)
class Outcome:
    """One ladder: true error and estimate over the tolerance, cost over the cheapest."""

    error: float
    estimate: float
    cost: float
    runs: int


def climbed(case: Case, tolerance: float) -> Outcome | None:
    """Return the outcome of a ladder; None if it goes beyond the study."""
    names, runs, counts = case.counted(tolerance), list[Signals](), list[int]()
    count = case.first(tolerance)
    while count <= FINEST * max(1, case.fewest // 4):
        signals = case.signals(count)
        if signals is None or not set(names) <= set(signals):
            return None
        runs, counts = [*runs, signals], [*counts, count]
        if len(runs) > 1:
            found = case.judgement(runs, counts, names)
            estimate = max(found.errors[name] for name in names)
            if estimate <= tolerance:
                cost = sum(counts) / case.cheapest(tolerance)
                true = case.error(runs, found.weights, names)
                return Outcome(true / tolerance, estimate / tolerance, cost, len(runs))
            count = following(counts, found, estimate, tolerance)
        else:
            count = 2 * count
    return None


def study(
    seeds: Sequence[int], say: Callable[[str], None] = lambda text: None
) -> Iterator[tuple[str, float, Outcome | None]]:
    """Yield family, tolerance and outcome of every ladder of every scene."""
    for seed in seeds:
        for family in (*FAMILIES, *IMPACTS):
            try:
                case = Case(family, seed)
            except GranularError as error:
                say(f"{family} {seed}: {error}")
                continue
            if len(case.made) < 5:
                continue
            for tolerance in TOLERANCES:
                if case.counted(tolerance):
                    found = climbed(case, tolerance)
                    if found is None or found.error > 1:
                        say(f"{family} {seed} at {tolerance:g}: {found}")
                    yield family, tolerance, found


FIRST_ORDER, NO_SERIES = ["damped", "incremental", "rolling"], ["sliding", "opening"]
# Kinds of ladders, a few rows each of the table
KINDS = {
    "waves and sources in any crystal": [name for name in FAMILIES if name not in (*FIRST_ORDER, *NO_SERIES)],
    "dashpots, incremental law": FIRST_ORDER,
    "contacts that open or slide": NO_SERIES,
    "impacts": [*IMPACTS],
}


HEAD = ["scenes", "tolerance", "ladders", "above the tolerance", "largest error over the tolerance", "median"]
HEAD += ["median cost over the cheapest", "nine in ten, at most", "runs, mean"]


def table(found: Sequence[tuple[str, float, Outcome | None]]) -> list[list[str]]:
    """The outcomes as a table, a row a kind and tolerance; None is a ladder that went on beyond the study's steps."""
    rows = [HEAD]
    for kind, families in KINDS.items():
        for tolerance in TOLERANCES:
            rows += _row(
                kind, f"{tolerance:g}", [one for name, at, one in found if name in families and at == tolerance]
            )
    return rows + _row("all", "all", [one for *_, one in found])


def _row(kind: str, tolerance: str, outcomes: Sequence[Outcome | None]) -> list[list[str]]:
    ended = [one for one in outcomes if one is not None]
    if not ended:
        return []
    errors, costs = [one.error for one in ended], [one.cost for one in ended if one.cost < inf]
    words = [kind, tolerance, str(len(ended)), str(sum(error > 1 for error in errors)), f"{max(errors):.2g}"]
    words += [f"{np.median(errors):.1g}", f"{np.median(costs):.2f}", f"{np.quantile(costs, 0.9):.1f}"]
    return [[*words, f"{np.mean([one.runs for one in ended]):.1f}"]]


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--first", type=int, default=FIRST_SEED)
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    write_table(arguments.write, table(list(study(seeds, lambda said: print(said, flush=True)))))


if __name__ == "__main__":
    main()
