"""Gradient of a whole run: how a number from its record depends on each sphere, contact and signal.

Numbers are functions of a `Record`, such as those of `granular_analysis.theory.network_objectives`; they depend on the
factors of `granular_analysis.theory.network_factors`.

Reverse mode (`gradient`) costs four to eight runs for any number of factors, with the memory of 2 √steps states: each
of √steps parts is run again on the way back, and so is each of its steps. Forward mode (`derivative`) costs as much for
one direction, and holds no states. The change of the gradient along a direction (`hessian_product`) is forward over
reverse mode, and costs 15 to 40 runs.

Good values: a number of samples, or of steps per sample, with a divisor that gives parts of about √steps: parts are
equal numbers of whole samples, or equal parts of each sample.

When it breaks: if a contact opens, closes or slides, the record has a kink and a derivative is one-sided. `events`
names such contacts, and how near the others are; the functions here refuse such a run by default. If a force also
jumps, as when an adhesive contact opens or closes or a sheared contact opens, this derivative is not that of the
motion: steps of fixed length ignore that the jump comes earlier or later, which changes the velocity by (ΔF/m)(dx/da)/v
for a jump ΔF at the speed v. Hertz contacts without shear have no jump, and neither has sliding.

Source: A. Griewank and A. Walther, Evaluating Derivatives (2008), chapters 3 and 12.
"""

from collections.abc import Callable, Sequence
from functools import partial
from math import log, sqrt
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import lax
from jax import numpy as jnp
from jax.tree_util import Partial
from numpy.typing import NDArray

from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network import Traits
from granular_analysis.theory.network_factors import Factors, Given, Plan, Run, prepared
from granular_analysis.theory.network_state import Pairs, with_walls
from granular_analysis.theory.network_tangents import combined, dot, less, scaled
from granular_analysis.theory.network_traced import on_device
from granular_analysis.theory.network_verlet import Carried, seen, slip_ratios, stepped

__all__ = ["Record", "bytes_of_gradient", "derivative", "events", "gradient", "hessian_product", "jacobian", "record"]

Floats = NDArray[np.float64]


class Record(NamedTuple):
    """Record of a run: at the start and after each sample.

    Attributes
    ----------
    times : (T + 1,).
    motion : (T + 1, 2f, n) displacements, turns, velocities, spins of the spheres.
    power : (T + 1, C) that each contact carries from its first to its second sphere: half of the power on the second,
        minus half of the power on the first.
    """

    times: Any
    motion: Any
    power: Any


Objective = Callable[[Record], Any]
Start = tuple[Given, Factors]


def _traced(objective: Objective) -> Partial:
    """Return an objective whose numbers are traced if it is a ``jax.tree_util.Partial``, so that others share it."""
    return objective if isinstance(objective, Partial) else Partial(objective)


class _Looks(NamedTuple):
    """Extremes of contacts and spheres so far, for `Events`; (M,) but for the last.

    `least` is the smallest overlap while a pair touched, inf if it has not; `always` and `ever` say whether it has
    touched since the start, or at all; `hardest` is the largest share of the limit of friction.
    """

    least: Any
    always: Any
    ever: Any
    hardest: Any
    farthest: Any

    def with_more(self, other: "_Looks") -> "_Looks":
        """Return these after what has come to pass since."""
        return _Looks(
            jnp.minimum(self.least, other.least),
            self.always & other.always,
            self.ever | other.ever,
            jnp.maximum(self.hardest, other.hardest),
            jnp.maximum(self.farthest, other.farthest),
        )


def _look(network: Traits, pairs: Pairs, now: Carried) -> _Looks:
    """Return what contacts and spheres do at one moment; nothing has a slope by it."""
    now = lax.stop_gradient(now)
    there = seen(network, pairs, now)
    far = [jnp.max(jnp.abs(way - place)) for way, place in zip(now.motion, pairs.place, strict=False)]
    least = jnp.where(there.closed, there.overlap, jnp.inf)
    share = slip_ratios(network, pairs, there) / (network.friction or np.inf)  # without friction nothing is sheared
    return lax.stop_gradient(_Looks(least, there.closed, there.closed, share, jnp.max(jnp.stack(far))))


def _power(network: Traits, pairs: Pairs, now: Carried, contacts: Any) -> Any:
    """Return the power (C,) through the contacts that are recorded."""
    dimension = network.dimension
    if not len(contacts):
        return jnp.zeros(0)
    there = seen(network, pairs, now)
    pull = less(combined(there.shear, there.tangents.along), scaled(there.repulsion, there.normal))
    rates = with_walls(network, now.motion[network.freedoms :])
    gains = []
    for end, arm, force in zip((pairs.first, pairs.second), pairs.radii, (pull, scaled(-1.0, pull)), strict=True):
        speed = [row[end] for row in rates]
        lever = arm - pairs.shortened * there.overlap
        gains.append(dot(force, speed[:dimension]) + lever * dot(there.twist, speed[dimension:]))
    return ((gains[1] - gains[0]) / 2)[contacts]


def _marched(plan: Plan, given: Given, factors: Factors) -> tuple[Record, tuple[_Looks, _Looks]]:
    """Return the record of a run, and what was seen at its begin and until its end."""
    network, samples, every, _ = plan
    pairs, bodies, values, begin = prepared(plan, given, factors)
    again = partial(jax.checkpoint, prevent_cse=False)  # which is for no scan

    def noted(now: Carried) -> tuple[Any, Any]:
        return jnp.stack([row[given.spheres] for row in now.motion]), _power(network, pairs, now, given.contacts)

    def one(carry: tuple[Carried, _Looks], at: Any) -> tuple[tuple[Carried, _Looks], None]:
        now, looks = carry
        now = stepped(network, pairs, bodies, now, at)
        return (now, looks.with_more(_look(network, pairs, now))), None

    # The way back holds the start of each part, and of each step of the part that it runs again
    many, few = _part(samples, every)
    whole = few == every

    def few_steps(carry: tuple[Carried, _Looks], at: Any) -> tuple[tuple[Carried, _Looks], None]:
        return lax.scan(again(one), carry, at)[0], None

    def sample(carry: tuple[Carried, _Looks], at: Any) -> tuple[tuple[Carried, _Looks], Any]:
        carry = lax.scan(few_steps if whole else again(few_steps), carry, at)[0]
        return carry, noted(carry[0])

    def many_samples(carry: tuple[Carried, _Looks], at: Any) -> tuple[tuple[Carried, _Looks], Any]:
        return lax.scan(sample, carry, at)

    shape = samples // many, many, every // few, few, *values.shape[1:]
    first = _look(network, pairs, begin)
    (_, last), found = lax.scan(
        again(many_samples) if whole else many_samples, (begin, first), values[1:].reshape(shape)
    )
    rows = [
        jnp.concatenate([now[None], later.reshape(samples, *now.shape)])
        for now, later in zip(noted(begin), found, strict=True)
    ]
    return Record(bodies.step * every * jnp.arange(samples + 1), *rows), (first, last)


def _part(samples: int, every: int) -> tuple[int, int]:
    """Return how a run is cut into parts of about the root of all its steps.

    A part is a number of whole samples, which is returned with all steps of one; or a part of each sample, which is
    returned after the number of all samples.
    """
    parts = [(many, every) for many in _divisors(samples)]
    parts += [(samples, few) for few in _divisors(every)[:-1]]

    def off(part: tuple[int, int]) -> float:
        many, few = part
        return abs(log((many * every if few == every else few) / sqrt(samples * every)))

    return min(parts, key=off)


def _divisors(number: int) -> list[int]:
    return [each for each in range(1, number + 1) if number % each == 0]


_recorded = partial(jax.jit, static_argnums=0)(_marched)


def _number(plan: Plan, objective: Objective, given: Given) -> Callable[[Factors], tuple[Any, tuple[_Looks, _Looks]]]:
    """Return what reads a number off the record of factors, beside what was seen."""

    def number(factors: Factors) -> tuple[Any, tuple[_Looks, _Looks]]:
        found, looks = _marched(plan, given, factors)
        return objective(found), looks

    return number


@partial(jax.jit, static_argnums=0)
def _value_and_slope(plan: Plan, objective: Objective, given: Given, factors: Factors) -> Any:
    return jax.value_and_grad(_number(plan, objective, given), has_aux=True)(factors)


@partial(jax.jit, static_argnums=0)
def _along(plan: Plan, objective: Objective, given: Given, factors: Factors, direction: Factors) -> Any:
    return jax.jvp(_number(plan, objective, given), (factors,), (direction,), has_aux=True)


@partial(jax.jit, static_argnums=0)
def _slope_along(plan: Plan, objective: Objective, given: Given, factors: Factors, direction: Factors) -> Any:
    return jax.jvp(jax.grad(_number(plan, objective, given), has_aux=True), (factors,), (direction,), has_aux=True)


@partial(jax.jit, static_argnums=0)
def _along_given(plan: Plan, objective: Objective, start: Start, ways: Start) -> Any:
    leaves, tree = jax.tree.flatten(start)
    smooth = [n for n, each in enumerate(leaves) if jnp.issubdtype(each.dtype, jnp.floating)]

    def number(values: list[Any]) -> tuple[Any, tuple[_Looks, _Looks]]:
        every = list(leaves)
        for n, each in zip(smooth, values, strict=True):
            every[n] = each
        found, looks = _marched(plan, *jax.tree.unflatten(tree, every))
        return objective(found), looks

    here, along = ([jax.tree.leaves(each)[n] for n in smooth] for each in (start, ways))
    slopes: Any = jax.vmap(lambda way: jax.jvp(number, (here,), (way,), has_aux=True), out_axes=(None, 0, None))
    return slopes(along)


def record(run: Run, factors: Factors) -> Record:
    """Return the record of a run, in arrays of NumPy.

    Raises
    ------
    TheoryError
        If spheres move so far that new contacts are possible.
    """
    found, looks = _recorded(run.plan(factors), run.given, on_device(dict(factors)))
    _refuse(_events(run, *looks), kinks=True)
    return Record(*map(np.asarray, found))


def gradient(
    run: Run, objective: Objective, factors: Factors, *, kinks: bool = False
) -> tuple[float, dict[str, Floats]]:
    """Return a number from the record of a run, and its gradient.

    Parameters
    ----------
    run : Run
    objective : callable
        `Record` → a number, by functions of ``jax.numpy``; as a ``jax.tree_util.Partial`` it is compiled once for all
        arrays of equal shapes that it holds.
    factors : mapping
        Factors by name, such as `Run.neutral`; factors that are not given have no effect and no gradient.
    kinks : bool
        Accept a run in which a contact opens, closes or slides; the effect of force jumps is left out.

    Raises
    ------
    TheoryError
        For such a run without `kinks`, and if spheres move so far that new contacts are possible.
    """
    (value, looks), slope = _value_and_slope(run.plan(factors), _traced(objective), run.given, on_device(dict(factors)))
    _refuse(_events(run, *looks), kinks)
    return float(value), _by_name(slope)


def bytes_of_gradient(run: Run, objective: Objective, factors: Factors) -> int:
    """Return the memory that `gradient` needs on the device beside its input, from its compiled program."""
    found: Any = (
        _value_and_slope.lower(run.plan(factors), _traced(objective), run.given, on_device(dict(factors)))
        .compile()
        .memory_analysis()
    )
    return int(found.temp_size_in_bytes)


def derivative(
    run: Run, objective: Objective, factors: Factors, direction: Factors, *, kinks: bool = False
) -> tuple[Any, Any]:
    """Return a readout of the record, of any shape, and its derivative along a direction of the factors.

    Other parameters and errors are as for `gradient`.
    """
    value, slope, looks = _along(
        run.plan(factors), _traced(objective), run.given, on_device(dict(factors)), on_device(dict(direction))
    )
    _refuse(_events(run, *looks), kinks)
    return value, slope


def jacobian(
    run: Run, objective: Objective, factors: Factors, ways: Sequence[Start], *, kinks: bool = False
) -> tuple[Floats, Floats]:
    """Return a readout of the record (N,), and its slopes (N, P) along changes of all numbers of a run.

    Parameters
    ----------
    ways : P changes of `Run.given` and of the factors; changes of whole numbers, such as indices, are ignored.

    Other parameters and errors are as for `gradient`.
    """
    start = run.given, on_device(dict(factors))
    stacked = jax.tree.map(lambda *each: jnp.stack(each), *ways)
    value, slopes, looks = _along_given(run.plan(factors), _traced(objective), start, stacked)
    _refuse(_events(run, *looks), kinks)
    return np.asarray(value), np.asarray(slopes).T


def hessian_product(
    run: Run, objective: Objective, factors: Factors, direction: Factors, *, kinks: bool = False
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Return the gradient, and the product of the Hessian with a direction of the factors.

    Other parameters and errors are as for `gradient`.
    """
    slope, change, looks = _slope_along(
        run.plan(factors), _traced(objective), run.given, on_device(dict(factors)), on_device(dict(direction))
    )
    _refuse(_events(run, *looks), kinks)
    return _by_name(slope), _by_name(change)


def _by_name(slope: Factors) -> dict[str, Floats]:
    return {name: np.asarray(each) for name, each in slope.items()}


def _refuse(known: "Events", kinks: bool) -> None:
    """Raise TheoryError for a run with kinks that were not asked for, or in which spheres move too far."""
    if known.farthest > 1:
        raise TheoryError("spheres move so far that others may touch, which a gradient does not search")
    if known.trouble and not kinks:
        raise TheoryError(f"{known.trouble}; the gradient is that of one side: kinks = True takes it")


class Events(NamedTuple):
    """Contacts that opened, closed or slid in a run, and how near others came.

    Attributes
    ----------
    parted, met : pairs (K,) that touched at the start and did not later, and the other way round.
    slid : pairs that slid.
    nearest : smallest overlap of pairs that touch, over the mean one of those at the start.
    closest : the pair that has it.
    hardest : largest share of the limit of friction; 0 without friction.
    farthest : largest displacement over that at which pairs are searched again.
    """

    parted: NDArray[np.intp]
    met: NDArray[np.intp]
    slid: NDArray[np.intp]
    nearest: float
    closest: int
    hardest: float
    farthest: float

    @property
    def trouble(self) -> str:
        """Return what makes a kink, "" if nothing does."""
        kinds = {"opened": self.parted, "closed": self.met, "slid": self.slid}
        found = [f"{len(which)} contacts {what}, first pair {which[0]}" for what, which in kinds.items() if len(which)]
        return "; ".join(found)


def events(run: Run, factors: Factors) -> Events:
    """Return which contacts opened, closed or slid in a run, and how near the others were."""
    return _events(run, *_recorded(run.plan(factors), run.given, on_device(dict(factors)))[1])


def _events(run: Run, first: _Looks, last: _Looks) -> Events:
    """Return the events between two looks."""
    least, begun, hardest = (np.asarray(each) for each in (first.least, first.always, last.hardest))
    mean = float(least[begun].mean()) if begun.any() else np.inf
    return Events(
        np.flatnonzero(begun & ~np.asarray(last.always)),
        np.flatnonzero(~begun & np.asarray(last.ever)),
        np.flatnonzero(hardest >= 1 - 1e-9),
        float(np.min(last.least)) / mean if 0 < mean < np.inf else np.inf,
        int(np.argmin(last.least)),
        float(hardest.max(initial=0.0)),
        float(last.farthest) / (run.network.margin / 2),
    )
