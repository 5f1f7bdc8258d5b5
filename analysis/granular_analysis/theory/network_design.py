"""Search for the densities of spheres that maximise a number of a whole run, by its gradient.

A `Design` has one density for each group of spheres, in units of the density of the uniform crystal. A group is a
single sphere, or the equal spheres of rows or cells that repeat. SciPy's L-BFGS-B varies the densities between two
bounds and follows the gradient of log V,

    V = |mean of s over signs|

where a `Goal` reads the real or complex vector s off each run. Each run starts with one of the signs: the mean over +1
and −1 keeps only even orders of the amplitude. A robust design maximises the mean of V over several crystals; in each
of them, drawn with its own seed, every density is off by a normally distributed share.

If the total mass is kept, the density of group j, which has w_j spheres, is

    f_j = low + (high − low)/(1 + e^{−(y_j + λ)}),    Σ w_j f_j = Σ w_j

The numbers y_j are free, and λ is the one number that keeps the mass, so bounds and mass hold exactly in every run.

The gradient refuses a run in which a contact opens, closes or slides, since the record has a kink there. The optimizer
then steps back toward the last accepted run.

When it breaks: maxima are local; take several starts. If contacts are about to open, the best design lies at a kink,
and the search ends there.

Source: R. H. Byrd, P. Lu, J. Nocedal and C. Zhu, SIAM J. Sci. Comput. 16, 1190 (1995).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from jax import numpy as jnp
from jax.tree_util import Partial
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize
from scipy.special import expit, logit

from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network_factors import Run
from granular_analysis.theory.network_gradient import Record, gradient, record

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
_SPREAD = 0.1  # densities at the start differ from 1 by at most this much
_WORSE = 1.0  # a refused run counts as log V this far below the smallest log V so far
_FAR = 700.0  # e^x is finite up to this x


class Goal(NamedTuple):
    """Objective V of a run, to be maximised.

    Attributes
    ----------
    read : `Record` → s, a number or a vector, as a ``jax.tree_util.Partial`` of arrays.
    signs : factors of the start, one run each.
    """

    read: Partial
    signs: tuple[float, ...] = (1.0,)

    def of(self, records: Sequence[Record]) -> tuple[float, Any]:
        """Return V from one record for each sign, and the unit vector e with V = Re(e·s) for the mean s."""
        mean = np.mean([np.asarray(self.read(each)) for each in records], axis=0)
        length = float(np.linalg.norm(mean))
        return length, np.conj(mean) / length if length else np.zeros_like(mean)


class Evaluation(NamedTuple):
    """One evaluation of V.

    Attributes
    ----------
    value : V; nan for a refused run.
    slope : (P,) derivatives of V with respect to `numbers`.
    numbers : (P,) numbers of the optimizer (`Scaling`).
    why : reason of a refusal, if known.
    """

    value: float
    slope: Floats
    numbers: Floats
    why: str = ""


class Scaling(Protocol):
    """Densities (P,) as a function of the numbers (P,) that the optimizer changes."""

    bounds: list[tuple[float, float]] | None

    def of(self, numbers: Floats) -> Floats:
        """Return the densities."""

    def back(self, numbers: Floats, slope: Floats) -> Floats:
        """Return the slope with respect to the numbers, from the slope with respect to the densities."""

    def to(self, densities: Floats) -> Floats:
        """Return numbers whose densities are near the given ones."""


class Bounded:
    """Scaling whose numbers are the densities themselves, between bounds."""

    def __init__(self, low: float, high: float, sizes: Floats) -> None:
        self.low, self.high = low, high
        self.bounds: list[tuple[float, float]] | None = [(low, high)] * len(sizes)

    def of(self, numbers: Floats) -> Floats:
        """Return the numbers."""
        return numbers

    def back(self, numbers: Floats, slope: Floats) -> Floats:  # noqa: ARG002  # as of `Scaling`
        """Return the slope, unchanged."""
        return slope

    def to(self, densities: Floats) -> Floats:
        """Return the densities, clipped to the bounds."""
        return np.clip(densities, self.low, self.high)


class SameMass:
    """Scaling that keeps the mean density of all spheres at 1: the equation at the top of this module.

    Raises TheoryError unless the bounds enclose 1.
    """

    bounds: list[tuple[float, float]] | None = None

    def __init__(self, low: float, high: float, sizes: Floats) -> None:
        if not low < 1 < high:
            raise TheoryError(f"within {low:g} {high:g}: keeping the mass needs one bound below 1 and one above")
        self.low, self.width, self.sizes = low, high - low, sizes / sizes.sum()

    def _shares(self, numbers: Floats) -> Floats:
        """Return (f_j − low)/(high − low), with the λ that keeps the mass."""
        wanted = (1 - self.low) / self.width

        def off(shift: float) -> float:
            return float(self.sizes @ expit(numbers + shift)) - wanted

        return np.asarray(expit(numbers + brentq(off, -_FAR - numbers.max(), _FAR - numbers.min(), xtol=1e-13)))

    def of(self, numbers: Floats) -> Floats:
        """Return the densities."""
        return self.low + self.width * self._shares(numbers)

    def back(self, numbers: Floats, slope: Floats) -> Floats:
        """Return the slope with respect to the numbers."""
        shares = self._shares(numbers)
        steep = self.width * shares * (1 - shares)
        return np.asarray(steep * (slope - self.sizes * (slope @ steep) / (self.sizes @ steep)))

    def to(self, densities: Floats) -> Floats:
        """Return the numbers, of densities clipped to stay 2 % of the range away from the bounds."""
        return np.asarray(logit(np.clip((densities - self.low) / self.width, 0.02, 0.98)))


@dataclass(frozen=True, eq=False)
class Design:
    """Densities that vary, and the objective that they maximise.

    Attributes
    ----------
    run : run of the uniform crystal.
    goal : objective.
    group : (N,) group of each sphere, from 0 to P − 1.
    low, high : bounds of the densities, in units of the density of the uniform crystal.
    same_mass : whether the mean density is kept.
    spread : relative standard deviation of the densities of single spheres, at most 0.1; 0: exact densities.
    seeds : number of crystals over which V is averaged; 1 without a spread.

    Raises TheoryError for bounds that are not positive and ascending, or a spread without two or more seeds.
    """

    run: Run
    goal: Goal
    group: Integers
    low: float
    high: float
    same_mass: bool = False
    spread: float = 0.0
    seeds: int = 1

    def __post_init__(self) -> None:
        if not 0 < self.low < self.high < np.inf:
            raise TheoryError(f"within {self.low:g} {self.high:g}: must be two numbers above 0, the lower one first")
        if not 0 <= self.spread <= 0.1 or (self.spread == 0) != (self.seeds == 1) or self.seeds < 1:
            raise TheoryError(
                f"robust {self.spread:g} with {self.seeds} seeds: must be a spread up to 0.1 with two or more seeds"
            )

    @property
    def sizes(self) -> Floats:
        """Return the number of spheres of each group, (P,)."""
        return np.bincount(self.group).astype(float)

    @property
    def scaling(self) -> Scaling:
        """Return the map from the numbers of the optimizer to the densities."""
        return (SameMass if self.same_mass else Bounded)(self.low, self.high, self.sizes)

    def begin(self, seed: int) -> Floats:
        """Return random densities (P,) near 1 to start from: the symmetry of a uniform crystal may hide what helps."""
        noise = np.random.default_rng(seed).uniform(-_SPREAD, _SPREAD, len(self.sizes))
        return np.clip(np.clip(1.0, self.low, self.high) + noise, self.low, self.high)

    def crystals(self, densities: Floats) -> Iterator[tuple[Floats, Floats]]:
        """Yield the densities (N,) of each crystal, and their derivatives with respect to the group densities."""
        for seed in range(self.seeds):
            off = 1 + self.spread * np.random.default_rng(seed).normal(size=len(self.group)) if self.spread else 1.0
            yield densities[self.group] * off, np.broadcast_to(off, self.group.shape)

    def value(self, densities: Floats) -> float:
        """Return V for densities (P,)."""
        return float(np.mean([self._read(own)[0] for own, _ in self.crystals(densities)]))

    def evaluated(self, densities: Floats) -> tuple[float, Floats]:
        """Return V for densities (P,), and its derivatives with respect to them.

        Raises TheoryError for a run in which a contact opens, closes or slides.
        """
        value, slope = 0.0, np.zeros(len(self.sizes))
        for own, by in self.crystals(densities):
            size, way = self._read(own)
            for sign in self.goal.signs:
                _, slopes = gradient(self.run, Partial(_along, self.goal.read, way), self._factors(own, sign))
                slope += np.bincount(self.group, by * slopes["density"], len(slope)) / len(self.goal.signs)
            value += size
        return value / self.seeds, slope / self.seeds

    def _read(self, own: Floats) -> tuple[float, Any]:
        """Return V for one crystal, and the vector e of `Goal.of`."""
        return self.goal.of([record(self.run, self._factors(own, sign)) for sign in self.goal.signs])

    def _factors(self, own: Floats, sign: float) -> dict[str, Any]:
        drives = self.run.network.drives
        factors = {"density": own, "amplitude": np.array(sign)}
        return factors | ({"drives": sign * np.ones(len(drives))} if drives else {})


def _along(read: Callable[[Record], Any], way: Any, found: Record) -> Any:
    """Return Re(e·s), for the vector e of `Goal.of`."""
    return jnp.real(jnp.sum(way * read(found)))


class Best(NamedTuple):
    """The result of a search.

    Attributes
    ----------
    densities : (P,) densities with the largest V.
    value : V there.
    evaluations : number of evaluations.
    refused : number of evaluations whose run was refused.
    why : reason of the last refusal; "" if there was none.
    ended : why the search ended.
    interrupted : whether Ctrl-C ended it.
    """

    densities: Floats
    value: float
    evaluations: int
    refused: int
    why: str
    ended: str
    interrupted: bool = False


class _EnoughError(Exception):
    """Raised when all requested evaluations are made."""


def improved(
    design: Design,
    start: Floats,
    most: int,
    kept: Sequence[Evaluation] = (),
    noted: Callable[[Evaluation], None] = lambda _: None,
) -> Best:
    """Return the best densities found within a number of evaluations of V.

    Parameters
    ----------
    start : (P,) densities at the start.
    most : largest number of evaluations; each computes a gradient.
    kept : evaluations made before, in the same search. Each evaluation follows from those before it, so the search
        continues as if it had not been stopped.
    noted : callback for each new evaluation.

    Raises TheoryError if the run at the start is refused or has V = 0, or if a kept evaluation has other densities than
    this search asks for, because another version or another machine made it.
    """
    scaling, made = design.scaling, list[Evaluation]()
    best: tuple[float, Floats] = -np.inf, start
    interrupted = False

    def descending(numbers: Floats) -> tuple[float, Floats]:
        nonlocal best
        if len(made) == most:
            raise _EnoughError
        densities = scaling.of(numbers)
        if len(made) < len(kept):
            found = kept[len(made)]
            if not np.array_equal(found.numbers, numbers):
                raise TheoryError(f"kept evaluation {len(made) + 1} has other densities than this search; begin anew")
        else:
            found = _tried(design, scaling, numbers, densities)
            noted(found)
        made.append(found)
        if not made[0].value > 0:
            why = made[0].why or "the objective is 0"
            raise TheoryError(f"at the start {why}: take a smaller wave, or another start")
        if found.value > best[0]:
            best = found.value, densities
        if not found.value > 0:
            least = min(each.value for each in made if each.value > 0)
            return _WORSE - np.log(least), np.zeros_like(numbers)
        return -np.log(found.value), -found.slope / found.value

    try:
        ended = minimize(
            descending, scaling.to(start), jac=True, method="L-BFGS-B", bounds=scaling.bounds,
            options={"maxfun": most + 1, "maxiter": most + 1},
        ).message  # fmt: skip
    except _EnoughError:
        ended = "the requested number"
    except KeyboardInterrupt:
        if not made:
            raise
        interrupted, ended = True, "interrupted; the same command again continues"
    refused = [each.why or "before" for each in made if not each.value > 0]
    return Best(best[1], best[0], len(made), len(refused), refused[-1] if refused else "", str(ended), interrupted)


def _tried(design: Design, scaling: Scaling, numbers: Floats, densities: Floats) -> Evaluation:
    """Return the evaluation at some densities; a refused run gives one with the value nan."""
    try:
        value, slope = design.evaluated(densities)
    except TheoryError as error:
        return Evaluation(np.nan, np.zeros_like(numbers), numbers.copy(), str(error).partition("; the gradient")[0])
    return Evaluation(value, scaling.back(numbers, slope), numbers.copy())
