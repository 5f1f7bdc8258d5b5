"""Images by least squares: the many values that meet a record, and vary no more than the record demands.

    minimise  χ²(p) + w P(p),    χ² = Σ_i r_i²(p) of N points

over values p, which are 1 where nothing differs, with one of the penalties P

    Tikhonov   Σ_k (p_k − 1)²                                  small differences everywhere
    Variation  Σ_{k~l} (√((p_k − p_l)² + ε²) − ε)              few edges: the total variation, rounded over ε

The weight w falls by steps of √10 from one at which p is nearly 1 everywhere, and each search begins with the values
before it. Where the errors of the points are known, steps are 10, and w is that at which χ² = N: the discrepancy
principle. Where they are not, or χ² stays above N, it is the corner of the curve of log P over log χ²: the point of
largest curvature of the circle through it and its two neighbours.

A search is SciPy's L-BFGS-B with the exact gradient, in coordinates in which H + w P'' is the unit matrix; H = 2 JᵀJ is
the curvature of χ² where p = 1, which need not be exact, and P'' of the variation that of its lagged diffusion.

To first order the image of p is A⁻¹G (p − 1) with G = JᵀJ and A = G + w P''/2, and the errors of the points make a
covariance A⁻¹GA⁻¹ of it. A column of A⁻¹G is the image of a point; its width is the root (in space the cube root) of
the number of spheres that it covers, (Σ R²)²/Σ R⁴ values.

Good values: a tenth to a half of the differences that are looked for as ε. When it breaks: χ² has several minima where
a change shifts an arrival by more than half a period. A value that no wave meets stays 1, or is what lies around it.

Sources: V. A. Morozov, Soviet Math. Dokl. 7, 414 (1966); P. C. Hansen, SIAM Review 34, 561 (1992); A. Cultrera and
L. Callegaro, IOP SciNotes 1, 025004 (2020), the curvature by three points; C. R. Vogel and M. E. Oman, SIAM J. Sci.
Comput. 17, 227 (1996), the lagged diffusion.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.optimize import minimize

from granular_analysis.theory.errors import TheoryError

Floats = NDArray[np.float64]
Misfit = Callable[[Floats], tuple[float, Floats]]
ROUNDING = 0.02  # ε
STEP, KNOWN_STEP = 10**0.5, 10.0  # between two weights
WEIGHTS = 31  # at most, over fifteen decades
SLOW = 0.02  # relative fall of χ² in two steps at which a curve ends
NEAR = 0.03  # |χ²/N − 1| that is met
_GRADIENTS = 40  # of one weight
_ENOUGH = 1e-4  # relative fall of what is minimised, at which a search ends
_SAME = 1e-9  # relative difference of weights that are one: another number of threads rounds sums otherwise
_TURNS = 6  # searches for the weight between two


class Penalty(Protocol):
    """A penalty: its value and gradient, and a curvature (P, P) that is nowhere negative."""

    def __call__(self, values: Floats) -> tuple[float, Floats]: ...  # noqa: D102

    def curvature(self, values: Floats) -> Floats: ...  # noqa: D102


class Tikhonov:
    """Σ (p − 1)²."""

    def __call__(self, values: Floats) -> tuple[float, Floats]:
        """Return it and its gradient."""
        away = values - 1
        return float(away @ away), 2 * away

    def curvature(self, values: Floats) -> Floats:
        """Return its Hessian."""
        return 2 * np.eye(len(values))


class Variation(NamedTuple):
    """The total variation over pairs (E, 2) of neighbours, rounded over ε."""

    pairs: NDArray[np.intp]
    rounding: float = ROUNDING

    def __call__(self, values: Floats) -> tuple[float, Floats]:
        """Return it and its gradient."""
        (first, second), count = self.pairs.T, len(values)
        steps = values[first] - values[second]
        sizes = np.hypot(steps, self.rounding)
        slopes = np.zeros(count)
        np.add.at(slopes, first, steps / sizes)
        np.add.at(slopes, second, -steps / sizes)
        return float(np.sum(sizes - self.rounding)), slopes

    def curvature(self, values: Floats) -> Floats:
        """Return the matrix of its lagged diffusion."""
        first, second = self.pairs.T
        stiff = 1 / np.hypot(values[first] - values[second], self.rounding)
        found = np.zeros((len(values), len(values)))
        for i, j, sign in ((first, first, 1), (second, second, 1), (first, second, -1), (second, first, -1)):
            np.add.at(found, (i, j), sign * stiff)
        return found


def corner(misfits: ArrayLike, penalties: ArrayLike) -> int:
    """Return the index of the corner of an L-curve, the points by falling weights: the most convex of those between.

    Raises ValueError for fewer than three points.
    """
    points = np.log(np.stack([np.asarray(misfits, dtype=float), np.asarray(penalties, dtype=float)], axis=1))
    if len(points) < 3:
        raise ValueError(f"an L-curve of {len(points)} points has no corner; must have at least 3")
    one, other = points[1:-1] - points[:-2], points[2:] - points[1:-1]
    turn = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    sides = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1) * np.linalg.norm(one + other, axis=1)
    # By falling weights the curve leads to the left and up, so that a corner turns it clockwise
    return 1 + int(np.argmax(-turn / np.maximum(sides, np.finfo(float).tiny)))


class Trial(NamedTuple):
    """Image of one weight: its values (P,), χ² and penalty, and how many gradients it took."""

    weight: float
    values: Floats
    misfit: float
    penalty: float
    gradients: int


@dataclass(frozen=True, eq=False)
class Image:
    """Images of all weights that were tried, in their order, and which one is chosen, with the reason.

    Attributes
    ----------
    search : Search
    trials : sequence of Trial
    chosen : int
    reason : str
    """

    search: "Search"
    trials: Sequence[Trial]
    chosen: int
    reason: str

    @property
    def best(self) -> Trial:
        """Return the trial that is chosen."""
        return self.trials[self.chosen]

    @property
    def values(self) -> Floats:
        """Return the values of the image, (P,)."""
        return self.best.values

    @property
    def chi_squared(self) -> float:
        """Return χ² a point, 1 for a right model with right errors."""
        return self.best.misfit / self.search.points

    def resolution(self) -> tuple[Floats, Floats]:
        """Return the resolution (P, P), whose columns are images of points, and standard deviations (P,) by errors.

        Both are of first order. Where errors of points are unknown, or χ² is above 1 a point, they are taken to be
        those at which it is 1.
        """
        resolved, errors = resolution(
            self.search.curvature, self.search.penalty.curvature(self.values), self.best.weight
        )
        spread = self.chi_squared**0.5
        return resolved, errors * (max(1.0, spread) if self.search.known else spread)


def resolution(curvature: Floats, penalty: Floats, weight: float) -> tuple[Floats, Floats]:
    """Return the resolution A⁻¹G (P, P) and the standard deviations (P,) of H = 2G, P'' and w."""
    whole = cho_factor(curvature + weight * penalty)
    found = cho_solve(whole, curvature)
    covariance = cho_solve(whole, 2 * found.T)
    return found, np.sqrt(np.maximum(np.diag(covariance), 0.0))


def widths(resolved: Floats, each: float, dimension: int) -> Floats:
    """Return the width of the image of each point, (P,), in spheres, of which each has so many values."""
    squares = resolved**2
    count = squares.sum(axis=0) ** 2 / np.maximum((squares**2).sum(axis=0), np.finfo(float).tiny)
    return np.asarray((count / each) ** (1 / dimension))


@dataclass(frozen=True, eq=False)
class Search:
    """A sum of misfit and penalty that is minimised.

    Attributes
    ----------
    misfit : values (P,) → χ² and its gradient.
    curvature : (P, P) H.
    points : N
    penalty : Penalty
    bounds : of all values.
    known : whether the errors of the points are known.
    told : called with each trial, for a log.
    kept : trials of the same search that were made before. As each follows from those before, the search continues as
        if it had not been stopped.
    """

    misfit: Misfit
    curvature: Floats
    points: int
    penalty: Penalty
    bounds: tuple[float, float]
    known: bool
    told: Callable[[Trial], None] = lambda _: None
    kept: Sequence[Trial] = ()

    def image(self, start: Floats) -> Image:
        """Return the image; the search begins with values (P,).

        Raises ValueError if χ² does not depend on any value, and TheoryError for a kept trial of another weight than
        the search asks for: another version, or another machine, made it.
        """
        largest = float(np.diag(self.curvature).max())
        if not largest:
            raise ValueError("the records do not depend on any value that is looked for: no wave comes by")
        trials: list[Trial] = []
        weight = largest
        while len(trials) < WEIGHTS:
            trials.append(self._trial(len(trials), weight, trials[-1].values if trials else start))
            if self.known and trials[-1].misfit <= self.points:
                return self._between(trials)
            if len(trials) > 4 and self._ends(trials):
                break
            weight /= KNOWN_STEP if self.known else STEP
        chosen = corner([each.misfit for each in trials], [max(each.penalty, 1e-300) for each in trials])
        said = "the corner of the L-curve"
        if self.known:
            said += f", as chi2 stays at {trials[-1].misfit / self.points:.3g} a point"
        return Image(self, trials, chosen, said)

    def _ends(self, trials: Sequence[Trial]) -> bool:
        """Return whether χ² has fallen far, and falls no more."""
        before, last = trials[-3].misfit, trials[-1].misfit
        return before - last < SLOW * before and last < 0.5 * trials[0].misfit

    def _between(self, trials: list[Trial]) -> Image:
        """Return the image whose χ² is N, between the last two weights, by regula falsi in their logarithms."""
        said = "chi2 is 1 a point"
        if len(trials) == 1:
            return Image(self, trials, 0, f"{said} or less without any difference")
        high, low = trials[-2], trials[-1]
        for _ in range(_TURNS):
            if abs(trials[-1].misfit / self.points - 1) < NEAR:
                break
            ends = [np.log(each.misfit / self.points) for each in (high, low)]
            share = np.clip(ends[0] / (ends[0] - ends[1]), 0.1, 0.9)
            trials.append(
                self._trial(len(trials), float(high.weight * (low.weight / high.weight) ** share), low.values)
            )
            if trials[-1].misfit > self.points:
                high = trials[-1]
            else:
                low = trials[-1]
        return Image(self, trials, len(trials) - 1, said)

    def _trial(self, number: int, weight: float, start: Floats) -> Trial:
        if number < len(self.kept):
            trial = self.kept[number]
            if abs(trial.weight - weight) > _SAME * weight:
                raise TheoryError(f"trial {number + 1} that was kept is of another weight; begin anew")
        else:
            trial = self._made(weight, start)
        self.told(trial)
        return trial

    def _made(self, weight: float, start: Floats) -> Trial:
        whole = self.curvature + weight * self.penalty.curvature(start)
        root = np.linalg.cholesky(whole + 1e-12 * np.diag(whole).max() * np.eye(len(whole)))
        seen: list[tuple[float, Floats, float, float]] = []

        def at(inner: Floats) -> tuple[float, Floats]:
            moved = start + solve_triangular(root, inner, lower=True, trans="T")
            values = np.clip(moved, *self.bounds)
            (misfit, slope), (penalty, other) = self.misfit(values), self.penalty(values)
            total = misfit + weight * penalty
            seen.append((total, values, misfit, penalty))
            return total, solve_triangular(root, np.where(values == moved, slope + weight * other, 0.0), lower=True)

        limits = {"maxfun": _GRADIENTS, "maxiter": _GRADIENTS, "ftol": _ENOUGH, "gtol": 0.0}
        minimize(at, np.zeros(len(start)), jac=True, method="L-BFGS-B", options=limits)
        _, values, misfit, penalty = min(seen, key=lambda each: each[0])
        return Trial(weight, values, misfit, penalty, len(seen))
