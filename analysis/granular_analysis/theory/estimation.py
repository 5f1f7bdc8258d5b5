"""Least-squares estimates of parameters: values, 95 % intervals, correlations, and what the data cannot tell apart.

    minimise  Σ_i ρ(r_i²),   r_i(θ) = (model_i(θ) − measured_i)/σ_i

A positive parameter is fitted as its logarithm, so its interval stays positive. The covariance is (JᵀJ)⁻¹, with the
Jacobian J of the residuals at the minimum. If the errors σ_i are known, an interval is ±1.96 standard deviations. If
they are not, all points share one error, which follows from the residuals, and the interval is Student's.

The data do not determine a combination of parameters if its standard deviation is above `WIDE`, a factor of e² for
positive parameters. The combination is a right singular vector of J, which names the parameters that it mixes; they get
no interval. A first search, with a prior of width `WIDE` about the start, finds these combinations. A second search,
without a prior, moves only along the other right singular vectors. So, to first order, the estimate is, of all values
that fit equally well, the nearest to the start: a parameter without effect stays at its start, and the parameters of a
product share the step.

When it breaks: an interval assumes that the model is linear over the width of the interval, and that residuals are
independent and Gaussian. A robust loss gives outliers less weight; its intervals are then those of a Gaussian core.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares
from scipy.special import ndtri, stdtrit

Floats = NDArray[np.float64]
Function = Callable[[Floats], Floats]
Loss = Literal["linear", "soft_l1", "huber", "cauchy"]
LOSSES: tuple[str, ...] = get_args(Loss)
COVERAGE = 0.95
WIDE = 2.0  # in e-folds for a positive parameter, in units of the start for others
_REFUSED = 1e6  # where the model has no value, residuals are this times those at the start: the search steps back
_BESIDE = 1e-5  # the model must have a value up to this step from the best values
_GUESS = 0.01  # first guess of an unknown error, as a share of the largest measured value
_ROUNDING = 1e-10  # smallest unknown error, as a share of the guess, for points without scatter
_NEAR, _EXACT = 1e-4, 1e-12  # tolerances of a search: relative changes of parameters and of the sum
_MET = 1e-9  # tolerance with a Jacobian: ends within 1e-4 of an interval, before the rounding of a model that is a run
_MIXED = 0.05  # a parameter with a smaller share of a singular vector does not count as part of it


@dataclass(frozen=True, eq=False)
class Parameter:
    """A parameter with its name, the start of the fit, and its bounds.

    Raises ValueError unless the start lies strictly between the bounds.
    """

    name: str
    start: float
    low: float = -np.inf
    high: float = np.inf

    def __post_init__(self) -> None:
        if not self.low < self.start < self.high:
            raise ValueError(f"{self.name} = {self.start:g}: a fit must start between {self.low:g} and {self.high:g}")

    @property
    def logarithmic(self) -> bool:
        """Return whether the parameter is positive, and so fitted as its logarithm."""
        return self.low >= 0

    def inner(self, value: float) -> float:
        """Return the fitted number for a value: its logarithm, or its ratio to |start|."""
        if self.logarithmic:
            return float(np.log(value)) if value > 0 else -np.inf
        return value / self._size

    def value(self, inner: float) -> float:
        """Return the value for a fitted number."""
        return float(np.exp(inner)) if self.logarithmic else inner * self._size

    def slope(self, value: float) -> float:
        """Return the derivative of the value with respect to the fitted number."""
        return value if self.logarithmic else self._size

    @property
    def _size(self) -> float:
        return abs(self.start) or 1.0


@dataclass(frozen=True, eq=False)
class Estimate:
    """Result of a least-squares fit.

    Attributes
    ----------
    parameters : (P,) parameters.
    values : (P,) values at the minimum.
    intervals : (P, 2) 95 % intervals; nan for a parameter that the data determine only in combination.
    correlations : (P, P) correlations; nan in the rows of such parameters.
    residuals : (N,) r_i; if errors were not known, in units of `error`.
    error : the one error of all points, in their unit, if errors were not known; else None.
    freedom : degrees of freedom: the number of points minus the rank of the Jacobian, which is the number of
        combinations of parameters that the data determine.
    blind : groups of parameters that the data cannot tell apart; a group of one is a parameter without effect.
    """

    parameters: tuple[Parameter, ...]
    values: Floats
    intervals: Floats
    correlations: Floats
    residuals: Floats
    error: float | None
    freedom: int
    blind: tuple[tuple[str, ...], ...]

    @property
    def chi_squared(self) -> float:
        """Return Σ r² over the degrees of freedom: about 1 for a right model with right errors; nan if there are 0."""
        return float(np.sum(self.residuals**2) / self.freedom) if self.freedom else np.nan


def estimate(
    parameters: Sequence[Parameter],
    model: Callable[[Floats], Floats],
    measured: ArrayLike,
    errors: ArrayLike | None = None,
    loss: Loss = "linear",
    jacobian: Callable[[Floats], Floats] | None = None,
) -> Estimate:
    """Return the parameters with which a model fits measured values best.

    Parameters
    ----------
    parameters : the P parameters.
    model : values (P,) → (N,) in the unit of the measured values; nan where it has no value, which the search avoids.
    measured : (N,) measured values.
    errors : (N,) standard deviations; None: one unknown error for all points.
    loss : "linear" for plain least squares; the other losses of `scipy.optimize.least_squares` ("soft_l1", "huber",
        "cauchy") give less weight to points farther off than about one σ, and need errors.
    jacobian : values (P,) → derivatives (N, P) of the model with respect to the values; None: differences.

    Raises
    ------
    ValueError
        For fewer points than parameters (one more if the error is unknown), errors that are not positive, a robust loss
        without errors, a search that does not end, and one that ends at a bound or where the model ceases to have a
        value.
    """
    data = np.asarray(measured, dtype=float)
    names = ", ".join(each.name for each in parameters)
    if len(data) < len(parameters) + (errors is None):
        more = " and their error" if errors is None else ""
        raise ValueError(f"{len(data)} points do not determine {len(parameters)} keys{more} ({names})")
    if loss != "linear" and errors is None:
        raise ValueError(f"loss = {loss!r}: needs the errors of the points, to tell what an outlier is")
    search = _Search(tuple(parameters), model, data, loss, jacobian)
    if errors is None:
        guess = _GUESS * (float(np.abs(data).max()) or 1.0)
        unit = guess * max(search.best(np.full(len(data), guess)).scatter, _ROUNDING)
        found = search.best(np.full(len(data), unit))
        return search.judged(found, unit)
    sigma = np.asarray(errors, dtype=float)
    if not np.all((sigma > 0) & np.isfinite(sigma)):
        raise ValueError("errors must be positive and finite")
    return search.judged(search.best(sigma))


class _Minimum(NamedTuple):
    """Minimum: fitted numbers (P,), residuals (N,), their Jacobian (N, P), and singular vectors that data determine."""

    inner: Floats
    residuals: Floats
    jacobian: Floats
    seen: Floats

    @property
    def freedom(self) -> int:
        return len(self.residuals) - len(self.seen)

    @property
    def scatter(self) -> float:
        """Return the root of Σ r² over the degrees of freedom."""
        return float(np.sqrt(np.sum(self.residuals**2) / self.freedom))


@dataclass(frozen=True, eq=False)
class _Search:
    """A search for the minimum, with the arguments of `estimate`."""

    parameters: tuple[Parameter, ...]
    model: Callable[[Floats], Floats]
    data: Floats
    loss: Loss
    jacobian: Callable[[Floats], Floats] | None

    def best(self, sigma: Floats) -> _Minimum:
        """Return the minimum for errors σ (N,)."""
        start = np.array([each.inner(each.start) for each in self.parameters])
        low, high = np.array([(each.inner(each.low), each.inner(each.high)) for each in self.parameters]).T

        refused = _REFUSED * (1 + float(np.abs((self.model(self.values(start)) - self.data) / sigma).max()))

        def residuals(inner: Floats) -> Floats:
            found = (self.model(self.values(np.clip(inner, low, high))) - self.data) / sigma
            return np.where(np.isfinite(found), found, refused)

        def slopes(inner: Floats) -> Floats:
            assert self.jacobian is not None
            values = self.values(np.clip(inner, low, high))
            sizes = [each.slope(value) for each, value in zip(self.parameters, values, strict=True)]
            return np.asarray(self.jacobian(values) * sizes / sigma[:, None])

        convex: Loss = "linear" if self.loss == "linear" else "soft_l1"  # it has one minimum, near that of "cauchy"
        prior = np.eye(len(start)) / WIDE
        held = self._solved(
            lambda inner: np.append(residuals(inner), (inner - start) / WIDE),
            lambda inner: np.vstack([slopes(inner), prior]),
            *(start, convex, _NEAR),
        )
        _, sizes, rows = np.linalg.svd(held.jac[: len(self.data)], full_matrices=False)
        seen = rows[sizes * WIDE > 1]
        if not len(seen):
            return _Minimum(held.x, residuals(held.x), held.jac[: len(self.data)], seen)
        free = self._solved(
            lambda along: residuals(held.x + along @ seen),
            lambda along: slopes(held.x + along @ seen) @ seen.T,
            *(np.zeros(len(seen)), self.loss, _EXACT if self.jacobian is None else _MET),
        )
        found, jacobian = held.x + free.x @ seen, free.jac @ seen
        self._refuse_edges((found <= low) | (found >= high) | self._ends(found), found)
        return _Minimum(found, residuals(found), jacobian, seen)

    def _ends(self, inner: Floats) -> NDArray[np.bool_]:
        """Return for each parameter, (P,), whether the model has no value a small step of it away."""
        steps = np.array([inner + way * _BESIDE * row for row in np.eye(len(inner)) for way in (-1, 1)])
        lost = [not np.isfinite(self.model(self.values(each))).all() for each in steps]
        return np.any(np.reshape(lost, (-1, 2)), axis=1, keepdims=False)

    def _refuse_edges(self, there: NDArray[np.bool_], inner: Floats) -> None:
        """Raise ValueError if the search ends at a bound of parameters, or where the model ceases to have a value."""
        if there.any():
            ends = zip(self.parameters, self.values(inner), there, strict=True)
            said = ", ".join(f"{each.name} = {value:.6g}" for each, value, at in ends if at)
            raise ValueError(f"the best values lie beyond the allowed range, at {said}; take another model or branch")

    def values(self, inner: Floats) -> Floats:
        """Return the values for fitted numbers."""
        return np.array([each.value(x) for each, x in zip(self.parameters, inner, strict=True)])

    def _solved(self, residuals: Function, slopes: Function, start: Floats, loss: Loss, tolerance: float) -> Any:
        ends = dict.fromkeys(("xtol", "ftol", "gtol"), tolerance)
        by_differences = "3-point" if tolerance == _EXACT else "2-point"
        jac = by_differences if self.jacobian is None else slopes
        found = least_squares(residuals, start, jac=jac, loss=loss, **ends)
        if found.status < 1:
            names = ", ".join(each.name for each in self.parameters)
            raise ValueError(f"the search for {names} does not end: start nearer, or free fewer keys")
        return found

    def judged(self, found: _Minimum, unit: float | None = None) -> Estimate:
        """Return the estimate at a minimum; `unit` is the unit of the residuals if the error is not known."""
        width, spread = float(ndtri(0.5 + COVERAGE / 2)), 1.0
        if unit is not None:
            spread = max(found.scatter, _ROUNDING)
            width = float(stdtrit(found.freedom, 0.5 + COVERAGE / 2))
        inside = found.jacobian @ found.seen.T
        covariance = found.seen.T @ np.linalg.inv(inside.T @ inside) @ found.seen * spread**2
        null = np.eye(len(self.parameters)) - found.seen.T @ found.seen  # projects on what data do not determine
        deviation = np.where(np.diag(null) > _MIXED**2, np.nan, np.sqrt(np.diag(covariance)))
        ends = found.inner + width * deviation * np.array([[-1.0], [1.0]])
        return Estimate(
            self.parameters,
            values=self.values(found.inner),
            intervals=np.array([self.values(each) for each in ends]).T,
            correlations=covariance / np.outer(deviation, deviation),
            residuals=found.residuals / spread,
            error=None if unit is None else unit * spread,
            freedom=found.freedom,
            blind=tuple(_groups(null, [each.name for each in self.parameters])),
        )


def _groups(null: Floats, names: Sequence[str]) -> list[tuple[str, ...]]:
    """Return the groups of parameters that a projector (P, P) mixes."""
    mixed = np.abs(null) > _MIXED**2
    groups: list[set[int]] = []
    for row in np.flatnonzero(np.diag(mixed)):
        own = set(np.flatnonzero(mixed[row]).tolist())
        for other in [group for group in groups if group & own]:
            own |= other
            groups.remove(other)
        groups.append(own)
    return [tuple(names[each] for each in sorted(group)) for group in groups]
