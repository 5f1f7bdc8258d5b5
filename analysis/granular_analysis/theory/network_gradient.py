"""Gradient of a whole run: how a number of its record depends on each sphere, contact and signal.

The number is a function of a `Record`, such as those of `granular_analysis.theory.network_objectives`. It depends on
the factors of `granular_analysis.theory.network_factors`.

`gradient` uses reverse mode. It costs four to eight runs for any number of factors and holds 2 √steps states in memory:
the run is cut into √steps parts, and the backward pass repeats each part, and each of its steps, once more.
`derivative` uses forward mode, costs as much for one direction, and holds no states. `hessian_product`, the change of
the gradient along a direction, uses forward over reverse mode and costs 15 to 40 runs.

Good values: a part is a number of whole samples, or an equal share of one sample; so choose a number of samples, or of
steps per sample, whose divisors allow parts of about √steps steps.

When it breaks: if a contact opens, closes or slides, the record has a kink and the derivative is one-sided. The
functions here refuse such a run by default; `events` names these contacts, and says how near the others come. If a
force also jumps (an adhesive contact opens or closes, or a sheared contact opens), the derivative differs from that of
the true motion: steps of fixed length ignore that a factor a shifts the jump ΔF in time, so the derivative of the
velocity lacks the term (ΔF/m)(dx/da)/v, where v is the speed at the jump. Hertz contacts without shear have no such
jump, and neither has sliding.

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
    """Record of a run at the start and at each of T samples.

    Attributes
    ----------
    times : (T + 1,) times since the start.
    motion : (T + 1, 2f, n) displacements, turns, velocities, spins of the recorded spheres.
    power : (T + 1, C) power that each recorded contact carries from its first to its second sphere: half the power on
        the second, minus half the power on the first.
    """

    times: Any
    motion: Any
    power: Any


Objective = Callable[[Record], Any]
Start = tuple[Given, Factors]


def _traced(objective: Objective) -> Partial:
    """Return the objective as a ``jax.tree_util.Partial``, whose arrays are traced: equal shapes share one program."""
    return objective if isinstance(objective, Partial) else Partial(objective)


class _Looks(NamedTuple):
    """Extremes of pairs and spheres up to one moment, for `Events`.

    Attributes
    ----------
    least : (M,) smallest overlap while a pair touched, inf if it never did.
    always, ever : (M,) whether a pair has touched at all moments, or at any.
    hardest : (M,) largest ratio of the shear force to the limit of friction.
    farthest : largest displacement of a sphere, along one axis, since pairs were searched.
    """

    least: Any
    always: Any
    ever: Any
    hardest: Any
    farthest: Any

    def with_more(self, other: "_Looks") -> "_Looks":
        """Return the extremes over both."""
        return _Looks(
            jnp.minimum(self.least, other.least),
            self.always & other.always,
            self.ever | other.ever,
            jnp.maximum(self.hardest, other.hardest),
            jnp.maximum(self.farthest, other.farthest),
        )


def _look(network: Traits, pairs: Pairs, now: Carried) -> _Looks:
    """Return the extremes at one moment; derivatives do not pass through them."""
    now = lax.stop_gradient(now)
    there = seen(network, pairs, now)
    far = [jnp.max(jnp.abs(way - place)) for way, place in zip(now.motion, pairs.place, strict=False)]
    least = jnp.where(there.closed, there.overlap, jnp.inf)
    share = slip_ratios(network, pairs, there) / (network.friction or np.inf)  # without friction nothing is sheared
    return lax.stop_gradient(_Looks(least, there.closed, there.closed, share, jnp.max(jnp.stack(far))))


def _power(network: Traits, pairs: Pairs, now: Carried, contacts: Any) -> Any:
    """Return the power (C,) through the recorded contacts."""
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
    """Return the record of a run, and the extremes at its start and over the whole run."""
    network, samples, every, _ = plan
    pairs, bodies, values, begin = prepared(plan, given, factors)
    again = partial(jax.checkpoint, prevent_cse=False)  # a scan does not need the protection of prevent_cse

    def noted(now: Carried) -> tuple[Any, Any]:
        return jnp.stack([row[given.spheres] for row in now.motion]), _power(network, pairs, now, given.contacts)

    def one(carry: tuple[Carried, _Looks], at: Any) -> tuple[tuple[Carried, _Looks], None]:
        now, looks = carry
        now = stepped(network, pairs, bodies, now, at)
        return (now, looks.with_more(_look(network, pairs, now))), None

    # The backward pass holds the start of each part, and of each step of the part that it repeats
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
    """Return the size of a part of a run, about the root of the number of all its steps.

    It is (samples of a part, `every`) if a part is a number of whole samples, and (`samples`, steps of a part) if a
    part is a share of each sample.
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
    """Return a function from factors to the objective of the record and the extremes of the run."""

    def number(factors: Factors) -> tuple[Any, tuple[_Looks, _Looks]]:
        found, looks = _marched(plan, given, factors)
        return objective(found), looks

    return number


@partial(jax.jit, static_argnums=0)
def _value_and_slope(plan: Plan, objective: Objective, given: Given, factors: Factors) -> Any:
    """Return the objective with the extremes, and its gradient."""
    return jax.value_and_grad(_number(plan, objective, given), has_aux=True)(factors)


@partial(jax.jit, static_argnums=0)
def _along(plan: Plan, objective: Objective, given: Given, factors: Factors, direction: Factors) -> Any:
    """Return the objective, its derivative along a direction, and the extremes."""
    return jax.jvp(_number(plan, objective, given), (factors,), (direction,), has_aux=True)


@partial(jax.jit, static_argnums=0)
def _slope_along(plan: Plan, objective: Objective, given: Given, factors: Factors, direction: Factors) -> Any:
    """Return the gradient, its derivative along a direction, and the extremes."""
    return jax.jvp(jax.grad(_number(plan, objective, given), has_aux=True), (factors,), (direction,), has_aux=True)


@partial(jax.jit, static_argnums=0)
def _along_given(plan: Plan, objective: Objective, start: Start, ways: Start) -> Any:
    """Return the objective, its derivatives along directions that are stacked in `ways`, and the extremes."""
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
    """Return the record of a run, as NumPy arrays.

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
    """Return a number of the record of a run, and its derivatives with respect to the factors, by name.

    Parameters
    ----------
    run : Run
    objective : callable
        `Record` → a number, computed by functions of ``jax.numpy``. A ``jax.tree_util.Partial`` is compiled once for
        all arrays of equal shapes that it holds.
    factors : mapping
        Factors by name, as from `Run.neutral`; a factor that is not given has no effect and no gradient.
    kinks : bool
        Whether to accept a run in which a contact opens, closes or slides; the effect of force jumps is left out.

    Raises
    ------
    TheoryError
        If a contact opens, closes or slides and `kinks` is False, or if spheres move so far that new contacts are
        possible.
    """
    (value, looks), slope = _value_and_slope(run.plan(factors), _traced(objective), run.given, on_device(dict(factors)))
    _refuse(_events(run, *looks), kinks)
    return float(value), _by_name(slope)


def bytes_of_gradient(run: Run, objective: Objective, factors: Factors) -> int:
    """Return the bytes that the compiled program of `gradient` needs on the device, beside its input."""
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

    Parameters and errors are otherwise as for `gradient`.
    """
    value, slope, looks = _along(
        run.plan(factors), _traced(objective), run.given, on_device(dict(factors)), on_device(dict(direction))
    )
    _refuse(_events(run, *looks), kinks)
    return value, slope


def jacobian(
    run: Run, objective: Objective, factors: Factors, ways: Sequence[Start], *, kinks: bool = False
) -> tuple[Floats, Floats]:
    """Return a readout of the record (N,), and its derivatives (N, P) along P directions.

    Parameters
    ----------
    ways : P directions, each a change of `Run.given` and of the factors; changes of integers, such as indices, are
        ignored.

    Parameters and errors are otherwise as for `gradient`.
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

    Parameters and errors are otherwise as for `gradient`.
    """
    slope, change, looks = _slope_along(
        run.plan(factors), _traced(objective), run.given, on_device(dict(factors)), on_device(dict(direction))
    )
    _refuse(_events(run, *looks), kinks)
    return _by_name(slope), _by_name(change)


def _by_name(slope: Factors) -> dict[str, Floats]:
    return {name: np.asarray(each) for name, each in slope.items()}


def _refuse(known: "Events", kinks: bool) -> None:
    """Raise TheoryError if spheres move too far, or if the run has kinks and `kinks` is False."""
    if known.farthest > 1:
        raise TheoryError("spheres move so far that new contacts are possible; a gradient does not search for them")
    if known.trouble and not kinks:
        raise TheoryError(f"{known.trouble}; the gradient is one-sided there: kinks = True accepts it")


class Events(NamedTuple):
    """Contacts that opened, closed or slid in a run, and how near the others came.

    Attributes
    ----------
    parted : (K,) pairs that touched at the start and opened later.
    met : (K,) pairs that did not touch at the start and closed later.
    slid : (K,) pairs that slid.
    nearest : smallest overlap of a closed pair, over the mean overlap at the start.
    closest : the pair with the smallest overlap.
    hardest : largest ratio of a shear force to the limit of friction; 0 without friction.
    farthest : largest displacement of a sphere over the displacement from which new contacts are possible.
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
        """Return a sentence on the contacts that make a kink, "" if there are none."""
        kinds = {"opened": self.parted, "closed": self.met, "slid": self.slid}
        found = [f"{len(which)} contacts {what}, first pair {which[0]}" for what, which in kinds.items() if len(which)]
        return "; ".join(found)


def events(run: Run, factors: Factors) -> Events:
    """Return which contacts opened, closed or slid in a run, and how near the others came."""
    return _events(run, *_recorded(run.plan(factors), run.given, on_device(dict(factors)))[1])


def _events(run: Run, first: _Looks, last: _Looks) -> Events:
    """Return the events of a run from its extremes at the start and over the whole run."""
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
