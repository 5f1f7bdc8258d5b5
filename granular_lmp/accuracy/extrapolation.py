"""Extrapolation to step 0 of runs with any steps, the estimate of its error, and the next step to run.

The error of a run with n steps to a sample is a series in 1/n: in even powers for velocity Verlet, in all powers with
effects of first order (`granular_lmp.effects.selection.order`). The runs of a ladder are summed with weights that
remove the first powers. Two such sums are judged, and the one whose estimate is smaller is the answer:

- even: the last three runs without 1/n² and 1/n⁴;
- all, with effects of first order: the last four runs without 1/n, 1/n² and 1/n³.

Contacts that open or slide do so at any phase of a step, and the error is no series. The answer is then the finest run.
Its error is estimated by the larger of two distances: from the finest run to the previous one, and half of that from
the previous run to its predecessor.

The error of an answer is estimated by `SAFETY` times its distance to the sum of one run less, which is the error of
that sum. The sum of two runs alone is estimated by `OF_TWO` times its distance to the finer of them.

**A first-order error hides below the others** in the even sum, because LAMMPS turns the slip of a contact with the
contact's direction at the end of the step: distances of sums of the same runs hardly show it. It leaves C ρ in an
answer, ρ = Σ wₙ/n, and so is at most ρ/|ρ − ρ'| times the distance to the answer before the last run, which has ρ'.
Where its size is known (`granular_lmp.accuracy.estimates.slip_bounds`), the smaller of the two counts.

"Last" is by steps: a run may come in between two others (`following`), because the error of a sum goes as the product
of all its steps. The page Accuracy says how often the estimate is wrong.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import field, replace
from math import ceil, inf

import numpy as np
from numpy.typing import NDArray

from granular_lmp.frozen import dataclass

Floats = NDArray[np.float64]
Signals = Mapping[str, Floats]
Norm = Callable[[Floats], float]

EVEN, ALL = (2, 4), (1, 2, 3)
# The true error, less that of the slip, was 0.92 of the distance at most in 500 triples of random waves, and 1.73 in
# one of 0.4 Δ0 at the edge of the zone
SAFETY = 2.0
OF_TWO = 2.0  # over the distance of the sum of two runs to the finer
HIDDEN = 1.3  # the same of the distance to the answer before the last run
_HASTE = 1.2  # a run is made as fine as if the estimate were larger by this
_APART = 1.25  # runs next to each other differ at least by this factor in their steps, as rounding is amplified by it


@dataclass(frozen=True)
class Judgement:
    """Joint answer of the runs of a ladder, with its estimated errors.

    Attributes
    ----------
    weights : tuple of float
        Weight of each run, in the order of the runs, in the answer; they sum to 1.
    errors : dict of str to float
        Estimated error of each signal of the answer; inf if it is not known, nan if the signal is.
    powers : tuple of int
        Powers of 1/n that the answer is free of.
    hidden : dict of str to float
        The part of `errors` that an error of first order may have hidden in the answer.
    """

    weights: tuple[float, ...]
    errors: dict[str, float]
    powers: tuple[int, ...]
    hidden: dict[str, float] = field(default_factory=dict)


def l2(values: Floats) -> float:
    """Return the L2 norm over all axes."""
    return float(np.linalg.norm(values))


def weights_of(counts: Sequence[int], powers: Sequence[int]) -> Floats:
    """Return the weights of runs with these steps per sample, one more than powers, in the sum free of the powers."""
    ratio = counts[0] / np.asarray(counts, dtype=float)
    return np.linalg.solve(np.vstack([ratio**power for power in (0, *powers)]), np.eye(len(counts))[0])


def combined(runs: Sequence[Floats], weights: Sequence[float] | Floats) -> Floats:
    """Return the sum of arrays of runs with their weights."""
    return np.asarray(sum(weight * each for weight, each in zip(weights, runs, strict=True) if weight))


def judge(
    runs: Sequence[Signals],
    counts: Sequence[int],
    order: int,
    *,
    counted: Collection[str] | None = None,
    hidden: Mapping[str, float] | None = None,
    norm: Norm = l2,
    relative: bool = True,
    safety: float = SAFETY,
) -> Judgement:
    """Return the answer of runs and the estimate of its error.

    Parameters
    ----------
    runs : sequence of dict
        Signals by name of each run, in the order in which they were made.
    counts : sequence of int
        Steps per sample of each run.
    order : int
        Order of the error in the step, 1 or 2; 0 if it is no series.
    counted : collection of str, optional
        Names of the signals by which the answer is chosen; all of them if left out.
    hidden : mapping, optional
        Bound of ``norm`` of the hidden first-order error of each signal, for ρ = 1; inf for names that are left out,
        and for all if the order is 1.
    norm : callable
        Size of an array.
    relative : bool
        Errors are relative to the size of the answer.
    safety : float
        Estimated error over distance.
    """
    if len(runs) == 1:
        return Judgement((1.0,), dict.fromkeys(runs[0], inf), ())
    ladder = _Ladder(runs, counts, norm, relative)
    if order == 0:
        return ladder.finest()
    even = () if order == 1 and len(runs) == 2 else (ladder.even(safety, {} if order == 1 else hidden or {}),)
    found = (*even, ladder.without(ALL, safety)) if order == 1 else even
    names = runs[-1] if counted is None else counted
    return min(found, key=lambda each: max((each.errors[name] for name in names), default=0.0))


@dataclass(frozen=True)
class _Ladder:
    """Runs with the sums that are made of them."""

    runs: Sequence[Signals]
    counts: Sequence[int]
    norm: Norm
    relative: bool

    def last(self, many: int, powers: Sequence[int], made: int | None = None) -> Floats:
        """Return the weights, one a run, of the sum of the finest runs, of all or of those `made` first."""
        finest = sorted(range(made or len(self.runs)), key=lambda run: self.counts[run])[-many:]
        weights = np.zeros(len(self.runs))
        weights[finest] = weights_of([self.counts[run] for run in finest], powers[: len(finest) - 1])
        return weights

    def distances(self, one: Floats, other: Floats) -> dict[str, float]:
        """Return the sizes of the difference of two sums, of the first if that is what they are relative to."""
        found = {}
        for name in self.runs[-1]:
            values = [run[name] for run in self.runs]
            size = self.norm(combined(values, one)) if self.relative else 1.0
            found[name] = self.norm(combined(values, one - other)) / size if size else 0.0
        return found

    def finest(self) -> Judgement:
        made = len(self.runs)
        fine, coarse, before = (self.last(1, (), max(each, 1)) for each in (made, made - 1, made - 2))
        moved, earlier = self.distances(fine, coarse), self.distances(fine, fine + before - coarse)
        return Judgement(tuple(map(float, fine)), {name: max(moved[name], earlier[name] / 2) for name in moved}, ())

    def without(self, powers: Sequence[int], safety: float) -> Judgement:
        many = min(len(self.runs), len(powers) + 1)
        weights = self.last(many, powers)
        apart = self.distances(weights, self.last(many - 1, powers))
        factor = safety if many > 2 else OF_TWO
        errors = {name: factor * each for name, each in apart.items()}
        return Judgement(tuple(map(float, weights)), errors, tuple(powers[: many - 1]))

    def even(self, safety: float, hidden: Mapping[str, float]) -> Judgement:
        found = self.without(EVEN, safety)
        weights, many = np.array(found.weights), len(found.powers) + 1
        errors, hides = dict(found.errors), dict[str, float]()
        if many > 2:
            before = self.last(many, EVEN, len(self.runs) - 1)
            left, left_before = (abs(float(np.sum(each / np.asarray(self.counts)))) for each in (weights, before))
            factor = HIDDEN * left / max(abs(left - left_before), 1e-9 * left)
            for name, moved in self.distances(weights, before).items():
                size = self.norm(combined([run[name] for run in self.runs], weights)) if self.relative else 1.0
                known = left * hidden.get(name, inf) / size if size else 0.0
                hides[name] = min(factor * moved, known)
                errors[name] = max(errors[name], hides[name])
        return replace(found, errors=errors, hidden=hides)


def _hides(judgement: Judgement, error: float) -> bool:
    """Return whether an error of a judgement is one of first order that may be hidden."""
    return any(judgement.hidden.get(name, 0.0) >= error for name in judgement.errors)


def needed(counts: Sequence[int], judgement: Judgement, error: float, tolerance: float) -> tuple[int, float]:
    """Return the run that the next one is made beside, and the steps per sample that bring an error to the tolerance.

    The estimate goes as the product of the powers of the steps of a sum of one run less. Parameters are those of
    `following`.
    """
    made = sorted(counts)
    finest, excess, removed = made[-1], _HASTE * error / tolerance, len(judgement.powers)
    if not judgement.powers or _hides(judgement, error):
        return finest, finest * excess
    if 1 in judgement.powers:
        full = removed == len(ALL)
        base = made[-removed] if full else finest
        return base, base * (excess if full else excess ** (1 / (removed + 1)))
    # If the finer of two runs errs by e, their sum errs by about 5 e², as waves err by their phase
    seen = excess if removed > 1 else excess * 5 * SAFETY * error / OF_TWO**2
    return made[-2], made[-2] * seen**0.5


def following(counts: Sequence[int], judgement: Judgement, error: float, tolerance: float) -> int:
    """Return the steps per sample of the run that is expected to bring an error below the tolerance.

    The next run is one in between where that is enough, and has at most twice the steps of the finest.

    Parameters
    ----------
    counts : sequence of int
        Steps per sample of the runs so far.
    judgement : Judgement
        Judgement of these runs.
    error : float
        Largest error of the judgement that counts.
    tolerance : float
        What it must be.
    """
    finest = max(counts)
    if len(counts) == 1:
        return 2 * finest
    base, steps = needed(counts, judgement, error, tolerance)
    between = ceil(max(steps, _APART * base))
    if base < between <= finest / _APART and between not in counts:
        return between
    return min(max(ceil(steps), ceil(_APART * finest), finest + 1), 2 * finest)
