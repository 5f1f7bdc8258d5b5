"""Images by least squares: many values that fit a record and vary no more than the record demands.

    minimise  χ²(p) + w P(p),    χ² = Σ_i r_i²(p) of N points

over values p, which are 1 where the crystal is as assumed, with one of the penalties P

    Tikhonov   Σ_k (p_k − 1)²                                  small differences everywhere
    Variation  Σ_{k~l} (√((p_k − p_l)² + ε²) − ε)              few edges: the total variation, rounded over ε

The weight w starts where p is nearly 1 everywhere and falls step by step; each search starts from the values of the
one before. If the errors of the points are known, w falls by factors of 10, and the chosen w is that with χ² = N (the
discrepancy principle). If they are unknown, w falls by factors of √10. Then, or if χ² stays above N, the chosen w is
the corner of the curve of log P over log χ² (the L-curve): the point at which the circle through it and its two
neighbours has the largest curvature.

A search is SciPy's L-BFGS-B with the exact gradient, in coordinates in which H + w P'' is the unit matrix. H = 2 JᵀJ is
the curvature of χ² at p = 1 and need not be exact; P'' of the variation is that of its lagged diffusion.

To first order the image of p is A⁻¹G (p − 1) with G = JᵀJ and A = G + w P''/2, and its covariance from the errors of
the points is A⁻¹GA⁻¹. A column of R = A⁻¹G is the image of a single point. It covers (Σ R²)²/Σ R⁴ values; its width is
the square root (in space the cube root) of the number of spheres that it covers.

Good values: ε from a tenth to a half of the differences to be found. When it breaks: if a change shifts an arrival by
more than half a period, χ² has several minima. A value that no wave reaches stays 1, or takes the value around it.

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
STEP, KNOWN_STEP = 10**0.5, 10.0  # ratio of two successive weights
WEIGHTS = 31  # most weights, over fifteen decades
SLOW = 0.02  # an L-curve ends when χ² falls by less than this share in two steps
NEAR = 0.03  # largest |χ²/N − 1| that counts as χ² = N
_GRADIENTS = 40  # most gradients for one weight
_ENOUGH = 1e-4  # a search ends when the minimised sum falls by less than this share
_SAME = 1e-9  # weights within this relative difference are equal: sums round differently on other numbers of threads
_TURNS = 6  # most searches for the weight with χ² = N between two weights


class Penalty(Protocol):
    """A penalty with its gradient (P,), and a positive semidefinite curvature (P, P)."""

    def __call__(self, values: Floats) -> tuple[float, Floats]: ...  # noqa: D102

    def curvature(self, values: Floats) -> Floats: ...  # noqa: D102


class Tikhonov:
    """Penalty Σ (p − 1)²."""

    def __call__(self, values: Floats) -> tuple[float, Floats]:
        """Return the penalty and its gradient (P,)."""
        away = values - 1
        return float(away @ away), 2 * away

    def curvature(self, values: Floats) -> Floats:
        """Return its Hessian (P, P)."""
        return 2 * np.eye(len(values))


class Variation(NamedTuple):
    """Total variation over pairs (E, 2) of neighbours, rounded over ε (`rounding`)."""

    pairs: NDArray[np.intp]
    rounding: float = ROUNDING

    def __call__(self, values: Floats) -> tuple[float, Floats]:
        """Return the penalty and its gradient (P,)."""
        (first, second), count = self.pairs.T, len(values)
        steps = values[first] - values[second]
        sizes = np.hypot(steps, self.rounding)
        slopes = np.zeros(count)
        np.add.at(slopes, first, steps / sizes)
        np.add.at(slopes, second, -steps / sizes)
        return float(np.sum(sizes - self.rounding)), slopes

    def curvature(self, values: Floats) -> Floats:
        """Return the matrix (P, P) of its lagged diffusion."""
        first, second = self.pairs.T
        stiff = 1 / np.hypot(values[first] - values[second], self.rounding)
        found = np.zeros((len(values), len(values)))
        for i, j, sign in ((first, first, 1), (second, second, 1), (first, second, -1), (second, first, -1)):
            np.add.at(found, (i, j), sign * stiff)
        return found


def corner(misfits: ArrayLike, penalties: ArrayLike) -> int:
    """Return the index of the corner of an L-curve: its most convex point, the ends excluded.

    misfits, penalties : χ² and P of the points, by falling weight.

    Raises ValueError for fewer than three points.
    """
    points = np.log(np.stack([np.asarray(misfits, dtype=float), np.asarray(penalties, dtype=float)], axis=1))
    if len(points) < 3:
        raise ValueError(f"an L-curve of {len(points)} points has no corner; must have at least 3")
    one, other = points[1:-1] - points[:-2], points[2:] - points[1:-1]
    turn = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    sides = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1) * np.linalg.norm(one + other, axis=1)
    # As weights fall, the curve leads to the left and up, so it turns clockwise at a corner
    return 1 + int(np.argmax(-turn / np.maximum(sides, np.finfo(float).tiny)))


class Trial(NamedTuple):
    """Image for one weight: its values (P,), χ² and penalty, and the number of gradients that it took."""

    weight: float
    values: Floats
    misfit: float
    penalty: float
    gradients: int


@dataclass(frozen=True, eq=False)
class Image:
    """Images for all weights that were tried, and the choice among them.

    Attributes
    ----------
    search : search that made them.
    trials : the images, in the order of the search.
    chosen : index of the chosen image.
    reason : reason of the choice, for a log.
    """

    search: "Search"
    trials: Sequence[Trial]
    chosen: int
    reason: str

    @property
    def best(self) -> Trial:
        """Return the chosen trial."""
        return self.trials[self.chosen]

    @property
    def values(self) -> Floats:
        """Return the values of the image, (P,)."""
        return self.best.values

    @property
    def chi_squared(self) -> float:
        """Return χ² per point, about 1 for a right model with right errors."""
        return self.best.misfit / self.search.points

    def resolution(self) -> tuple[Floats, Floats]:
        """Return the resolution (P, P), whose columns are images of points, and the standard deviations (P,).

        Both are of first order. If the errors of the points are unknown, or χ² is above 1 per point, they are scaled to
        make χ² 1 per point.
        """
        resolved, errors = resolution(
            self.search.curvature, self.search.penalty.curvature(self.values), self.best.weight
        )
        spread = self.chi_squared**0.5
        return resolved, errors * (max(1.0, spread) if self.search.known else spread)


def resolution(curvature: Floats, penalty: Floats, weight: float) -> tuple[Floats, Floats]:
    """Return the resolution A⁻¹G (P, P) and the standard deviations (P,), from H = 2G, P'' and w."""
    whole = cho_factor(curvature + weight * penalty)
    found = cho_solve(whole, curvature)
    covariance = cho_solve(whole, 2 * found.T)
    return found, np.sqrt(np.maximum(np.diag(covariance), 0.0))


def widths(resolved: Floats, each: float, dimension: int) -> Floats:
    """Return the width of the image of each point, (P,), in spheres.

    Parameters
    ----------
    resolved : (P, P) resolution.
    each : number of values per sphere.
    dimension : 2 or 3.
    """
    squares = resolved**2
    count = squares.sum(axis=0) ** 2 / np.maximum((squares**2).sum(axis=0), np.finfo(float).tiny)
    return np.asarray((count / each) ** (1 / dimension))


@dataclass(frozen=True, eq=False)
class Search:
    """Minimisation of the sum of misfit and penalty.

    Attributes
    ----------
    misfit : values (P,) → χ² and its gradient (P,).
    curvature : (P, P) H.
    points : number N of points.
    penalty : penalty P.
    bounds : lower and upper bound of all values.
    known : whether the errors of the points are known.
    told : callback for each trial.
    kept : trials made before, in the same search. Each trial follows from those before it, so the search continues as
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
        """Return the image; the search starts from the values `start` (P,).

        Raises ValueError if χ² depends on no value, and TheoryError if a kept trial has another weight than this search
        asks for, because another version or another machine made it.
        """
        largest = float(np.diag(self.curvature).max())
        if not largest:
            raise ValueError("the records do not depend on any of the values to be found: no wave reaches them")
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
        """Return whether χ² has fallen to less than half, and hardly falls any more."""
        before, last = trials[-3].misfit, trials[-1].misfit
        return before - last < SLOW * before and last < 0.5 * trials[0].misfit

    def _between(self, trials: list[Trial]) -> Image:
        """Return the image with χ² = N, between the last two weights, by regula falsi in logarithms."""
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
                raise TheoryError(f"kept trial {number + 1} has another weight than this search; begin anew")
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
