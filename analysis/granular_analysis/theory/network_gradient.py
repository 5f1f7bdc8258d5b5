"""The gradient of a whole run: how a number that is read off a record depends on each sphere, contact and signal.

A run of `granular_analysis.theory.network_traced` from a state is a function of factors, each 1 where nothing changes:

    density          (N,) of the density of each sphere
    radius           (N,) of its radius, with the mass, the stiffnesses and the overlaps that follow; places stay
    normal_stiffness (M,) of the normal force of each pair at a given overlap, and of its pull
    shear_stiffness  (M,) of the shear force of each pair at a given overlap
    damping          ()   of the dashpots
    amplitude        ()   of the displacements, turns, velocities and spins at the start
    drives           (D,) of the signal of each drive

Reverse mode (`gradient`) costs about ten runs for any number of factors, with the memory of 2 √steps states: each of
√steps parts is run again on the way back. Forward mode (`derivative`) costs two runs for one direction.

Good values: a number of samples with a divisor near √(samples/every), as the parts are whole samples of equal number.

When it breaks: where a contact opens, closes or slides the record has a kink, and the gradient is that of one side of
it. `events` tells which contacts do, and how near the others are; `gradient` refuses such a run unless it is asked.

Source: A. Griewank and A. Walther, Evaluating Derivatives (2008), chapters 3 and 12.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from math import log
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import lax
from jax import numpy as jnp
from numpy.typing import NDArray

from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network import Network
from granular_analysis.theory.network_state import Pairs, State, acting, meetings, resultants
from granular_analysis.theory.network_tangents import combined, dot, scaled, times
from granular_analysis.theory.network_traced import Arrays, arrays_of, on_device, pairs_of
from granular_analysis.theory.network_verlet import Bodies, Carried, moved, pushed, signals, stepped

__all__ = ["Run", "derivative", "events", "gradient", "record"]

Floats = NDArray[np.float64]
Factors = Mapping[str, Any]
Objective = Callable[[Any], Any]
SIZES = ("density", "radius", "normal_stiffness", "shear_stiffness", "damping", "amplitude", "drives")


@dataclass(frozen=True, eq=False)
class Run:
    """A run whose record is differentiated.

    Attributes
    ----------
    network, state : as of `granular_analysis.theory.network_state.start`; pairs are not searched again.
    step : length of a step.
    samples, every : number of records after the begin, and the steps between two.
    spheres : (n,) indices of those recorded.
    """

    network: Network
    state: State
    step: float
    samples: int
    every: int
    spheres: NDArray[np.intp]

    def ones(self, *names: str) -> dict[str, Floats]:
        """Return factors of 1 by name, of their shapes."""
        count, pairs = len(self.network.position), len(self.state.pairs.first)
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(SIZES, ())
        shapes |= dict.fromkeys(("density", "radius"), (count,))
        shapes |= dict.fromkeys(("normal_stiffness", "shear_stiffness"), (pairs,))
        shapes |= {"drives": (len(self.network.drives),)}
        if unknown := [name for name in names if name not in shapes]:
            raise TheoryError(f"{unknown[0]!r}: is no factor of a run; {', '.join(SIZES)} are")
        return {name: np.ones(shapes[name]) for name in names}


def varied(network: Network, arrays: Arrays, bodies: Bodies, factors: Factors) -> tuple[Arrays, Bodies]:
    """Return the numbers of pairs and spheres with factors."""
    count, still = len(network.position), jnp.zeros(len(network.walls))
    radius, density = (jnp.asarray(factors.get(name, 1.0)) * jnp.ones(count) for name in ("radius", "density"))
    lighter = 1 / (radius**3 * density)
    ways, turns = [lighter] * network.dimension, [lighter / radius**2] * (network.freedoms - network.dimension)
    first, second, radii = arrays["first"], arrays["second"], arrays["radii"]
    larger = radii * jnp.stack([radius[first], jnp.concatenate([radius, still])[second]])
    wider = _curvature(radii) / _curvature(larger)
    free = jnp.ones(count) if network.held is None else 1.0 - jnp.asarray(network.held)
    light = jnp.concatenate([free * lighter / jnp.asarray(network.mass), still])
    both = light[first] + light[second]
    normal, shear = (factors.get(name, 1.0) for name in ("normal_stiffness", "shear_stiffness"))
    arrays = arrays | {
        "radii": larger,
        "overlap": arrays["overlap"] + (larger - radii).sum(axis=0),
        "mass": jnp.where(both > 0, 1 / jnp.where(both > 0, both, 1.0), 0.0),
        "A": arrays["A"] * normal * jnp.sqrt(wider),
        "F": arrays["F"] * normal * wider,
        "B": arrays["B"] * shear * jnp.sqrt(wider),
        "damping": arrays["damping"] * factors.get("damping", 1.0),
    }
    return arrays, bodies._replace(mobility=bodies.mobility * jnp.stack([*ways, *turns]))


def _curvature(radii: Any) -> Any:
    """Return 1/Rc (M,) of the radii (2, M) of both ends; that of a wall, which is flat, is given as 0."""
    flat = radii[1] == 0
    return 1 / radii[0] + jnp.where(flat, 0.0, 1 / jnp.where(flat, 1.0, radii[1]))


def started(network: Network, pairs: Pairs, bodies: Bodies, motion: Any, values: Any) -> Carried:
    """Return what the first step begins with, of a motion after the straight way without forces from rest."""
    half = network.freedoms
    way = meetings(network, [*motion[:half], *motion[:half]], pairs, pairs.overlap > pairs.normal.end)
    memory = scaled(way.stiffness, way.slip_rate) if network.law == "incremental" else way.slip_rate
    met = meetings(network, moved(network, bodies, values, list(motion)), pairs, way.closed)
    now = acting(network, pairs, met, scaled(met.closed, memory))
    loads = pushed(network, bodies, values, resultants(pairs, now))
    slips = combined(scaled(met.closed, memory), met.tangents.along)
    return Carried(tuple(motion), slips, met.closed, times(loads, bodies.mobility))


@partial(jax.jit, static_argnums=0)
def record(run: Run, factors: Factors) -> Any:
    """Return the motions (T + 1, 2f, n) of the recorded spheres, at the start and after each sample."""
    network = run.network
    arrays, bodies = varied(network, arrays_of(run.state.pairs), on_device(Bodies.of(network, run.step)), factors)
    pairs, drives = pairs_of(network, arrays), factors.get("drives", jnp.ones(len(network.drives)))
    count = run.samples * run.every
    values = jnp.asarray(signals(network, run.step, 0, count + 1)) * drives[:, None]
    begin = started(network, pairs, bodies, jnp.asarray(run.state.motion) * factors.get("amplitude", 1.0), values[0])
    spheres = jnp.asarray(run.spheres)

    def one(now: Carried, at: Any) -> tuple[Carried, None]:
        return stepped(network, pairs, bodies, now, at), None

    def sample(now: Carried, at: Any) -> tuple[Carried, Any]:
        now = lax.scan(one, now, at)[0]
        return now, jnp.stack([row[spheres] for row in now.motion])

    def part(now: Carried, at: Any) -> tuple[Carried, Any]:
        return lax.scan(sample, now, at)

    # The way back holds the begin of each part, and the steps of the part that it runs again
    length = _part(run.samples, run.every)
    shape = run.samples // length, length, run.every, *values.shape[1:]
    found = lax.scan(jax.checkpoint(part), begin, values[1:].reshape(shape))[1]
    first = jnp.stack([row[spheres] for row in begin.motion])[None]
    return jnp.concatenate([first, found.reshape(run.samples, *first.shape[1:])])


def _part(samples: int, every: int) -> int:
    """Return how many samples a part has: a divisor of all, with about the root of all steps."""
    divisors = [each for each in range(1, samples + 1) if samples % each == 0]
    return min(divisors, key=lambda each: abs(log(each**2 * every / samples)))


@partial(jax.jit, static_argnums=(0, 1))
def _value_and_slope(run: Run, objective: Objective, factors: Factors) -> tuple[Any, Any]:
    return jax.value_and_grad(lambda factors: objective(record(run, factors)))(factors)


@partial(jax.jit, static_argnums=(0, 1))
def _along(run: Run, objective: Objective, factors: Factors, direction: Factors) -> tuple[Any, Any]:
    return jax.jvp(lambda factors: objective(record(run, factors)), (factors,), (direction,))


def gradient(
    run: Run, objective: Objective, factors: Factors, *, kinks: bool = False
) -> tuple[float, dict[str, Floats]]:
    """Return a number that is read off the record of a run, and its gradient.

    Parameters
    ----------
    run : Run
    objective : callable
        Motions (T + 1, 2f, n), an array of JAX → a number, by functions of ``jax.numpy``.
    factors : mapping
        Of `Run.ones` or near it, by name; those that are not given are 1, and have no gradient.
    kinks : bool
        Take a run in which a contact opens, closes or slides.

    Raises
    ------
    TheoryError
        For such a run without `kinks`, and for spheres that move so far that others may touch.
    """
    known = events(run, factors)
    if known.farthest > 1:
        raise TheoryError("spheres move so far that others may touch, which a gradient does not search")
    if known.trouble and not kinks:
        raise TheoryError(f"{known.trouble}; the gradient is that of one side: kinks = True takes it")
    value, slope = _value_and_slope(run, objective, on_device(dict(factors)))
    return float(value), {name: np.asarray(each) for name, each in slope.items()}


def derivative(run: Run, objective: Objective, factors: Factors, direction: Factors) -> tuple[float, Any]:
    """Return what is read off the record, of any shape, and its derivative along a direction of the factors."""
    return _along(run, objective, on_device(dict(factors)), on_device(dict(direction)))


class Events(NamedTuple):
    """What contacts did in a run.

    Attributes
    ----------
    parted, met : pairs (K,) that touched at the start and did not later, and the other way round.
    slid : pairs that slid.
    nearest : smallest overlap of pairs that touch, over the mean one at the start.
    hardest : largest share of the limit of friction; 0 without friction.
    farthest : largest displacement over that at which pairs are searched again.
    """

    parted: NDArray[np.intp]
    met: NDArray[np.intp]
    slid: NDArray[np.intp]
    nearest: float
    hardest: float
    farthest: float

    @property
    def trouble(self) -> str:
        """Return what makes a kink, "" if nothing does."""
        kinds = {"opened": self.parted, "closed": self.met, "slid": self.slid}
        found = [f"{len(which)} contacts {what}, first pair {which[0]}" for what, which in kinds.items() if len(which)]
        return "; ".join(found)


@partial(jax.jit, static_argnums=0)
def _extremes(run: Run, factors: Factors) -> tuple[Any, ...]:
    network = run.network
    arrays, bodies = varied(network, arrays_of(run.state.pairs), on_device(Bodies.of(network, run.step)), factors)
    pairs, drives = pairs_of(network, arrays), factors.get("drives", jnp.ones(len(network.drives)))
    values = jnp.asarray(signals(network, run.step, 0, run.samples * run.every + 1)) * drives[:, None]
    begin = started(network, pairs, bodies, jnp.asarray(run.state.motion) * factors.get("amplitude", 1.0), values[0])

    def seen(now: Carried) -> tuple[Any, ...]:
        met = meetings(network, now.motion, pairs, now.begun)
        parts = tuple(dot(now.memory, each) for each in met.tangents.along)
        acts = acting(network, pairs, met, parts)
        limit = network.friction * (acts.repulsion + 2 * pairs.normal.pull * pairs.F)
        share = jnp.sqrt(dot(acts.shear, acts.shear)) / jnp.where(limit > 0, limit, jnp.inf)
        far = jnp.max(jnp.stack([jnp.max(jnp.abs(a - b)) for a, b in zip(now.motion, pairs.place, strict=False)]))
        return met.overlap, met.closed, met.closed, share * met.closed, far

    def one(carry: Any, at: Any) -> tuple[Any, None]:
        now, (least, always, ever, hardest, farthest) = carry
        now = stepped(network, pairs, bodies, now, at)
        overlap, closed, _, share, far = seen(now)
        least = jnp.minimum(least, jnp.where(closed, overlap, jnp.inf))
        looks = least, always & closed, ever | closed, jnp.maximum(hardest, share), jnp.maximum(farthest, far)
        return (now, looks), None

    looks = lax.scan(one, (begin, seen(begin)), values[1:])[0][1]
    return (begin.begun, jnp.mean(seen(begin)[0]), *looks)


def events(run: Run, factors: Factors) -> Events:
    """Return which contacts opened, closed or slid in a run, and how near others were."""
    begun, mean, least, always, ever, hardest, farthest = map(np.asarray, _extremes(run, on_device(dict(factors))))
    network = run.network
    slid = np.flatnonzero(hardest >= 1 - 1e-9) if network.friction < np.inf else np.empty(0, np.intp)
    nearest = float(least[np.isfinite(least)].min(initial=np.inf) / mean) if mean else np.inf
    return Events(
        np.flatnonzero(begun & ~always),
        np.flatnonzero(~begun & ever),
        slid,
        nearest,
        float(hardest.max(initial=0.0)) if network.friction < np.inf else 0.0,
        float(farthest / (network.margin / 2)),
    )
