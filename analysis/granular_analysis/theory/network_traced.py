"""Steps of `granular_analysis.theory.network_verlet` by JAX, on a GPU or on all cores of the machine.

JAX traces the code that NumPy runs, in double precision. The motion is that of NumPy up to rounding. On one device it
is reproducible to the last bit, since each sphere sums the forces of its contacts in a fixed order.

When it breaks: without JAX, which ``pip install 'granular-lmp[jax]'`` installs.
"""

from collections.abc import Iterable, Iterator
from dataclasses import fields
from functools import partial
from typing import Any

import jax
import numpy as np
from jax import lax
from jax import numpy as jnp
from numpy.typing import NDArray

from granular_analysis.theory import network_verlet as verlet
from granular_analysis.theory.network import Network, Traits
from granular_analysis.theory.network_laws import LAWS
from granular_analysis.theory.network_state import Pairs, State
from granular_analysis.theory.network_verlet import (
    Bodies,
    Carried,
    Moment,
    begun,
    motions,
    renewed,
    signals,
    stepped,
)

__all__ = ["march"]

jax.config.update("jax_enable_x64", True)
Floats = NDArray[np.float64]
Arrays = dict[str, Any]
AT_ONCE = 100  # steps of one call of the device


def arrays_of(pairs: Pairs) -> Arrays:
    """Return the arrays of pairs on the device, by the names of `Pairs`."""
    return {each.name: jnp.asarray(getattr(pairs, each.name)) for each in fields(pairs) if each.name != "normal"}


def pairs_of(network: Network | Traits, arrays: Arrays) -> Pairs:
    """Return the pairs made of traced arrays."""
    return Pairs(**arrays, normal=LAWS[network.adhesion](arrays["A"], arrays["F"]))


@partial(jax.jit, static_argnums=0)
def advanced(
    traits: Traits, arrays: Arrays, bodies: Bodies, now: Carried, values: Any, count: int
) -> tuple[Carried, Any]:
    """Return the motion after `count` steps, and the largest displacement, along one axis, since the search.

    `values` has `AT_ONCE` rows, of which the first `count` are used. As `count` is traced, one compiled program serves
    all networks with equal traits and shapes.
    """
    pairs = pairs_of(traits, arrays)

    def one(number: Any, carry: tuple[Carried, Any]) -> tuple[Carried, Any]:
        now, farthest = carry
        now = stepped(traits, pairs, bodies, now, values[number])
        far = [jnp.max(jnp.abs(way - from_)) for way, from_ in zip(now.motion, pairs.place, strict=False)]
        return now, jnp.maximum(farthest, jnp.max(jnp.stack(far)))

    return lax.fori_loop(0, count, one, (now, 0.0))


@partial(jax.jit, static_argnums=0)
def _extremes(traits: Traits, arrays: Arrays, now: Carried, rested: Any, near: Any) -> tuple[Any, ...]:
    return verlet.extremes(traits, pairs_of(traits, arrays), now, rested, near)


def extremes(network: Network, arrays: Arrays, now: Carried, rested: Any, near: Any) -> tuple[Any, ...]:
    """Return the same as `granular_analysis.theory.network_verlet.extremes`."""
    return _extremes(network.traits, arrays, now, rested, near)


@jax.jit
def taken(rows: Any, spheres: Any) -> Any:
    """Return the same as `granular_analysis.theory.network_verlet.taken`, in one call of the device."""
    return jnp.stack([row[spheres] for row in rows])


def moments(
    network: Network, state: State, step: float, stops: Iterable[int], begin: Moment | None = None
) -> Iterator[Moment]:
    """Yield the motion as `granular_analysis.theory.network_verlet.moments` does, with `now` on the device."""
    bodies, traits = Bodies.of(network, step), network.traits
    done, state, now = begin or Moment(0, state, begun(network, state, bodies))
    arrays, bodies, now = arrays_of(state.pairs), on_device(bodies), on_device(now)
    for stop in stops:
        most = AT_ONCE
        while done < stop:
            count = min(most, stop - done)
            values = np.zeros((AT_ONCE, len(network.drives), 2))
            values[:count] = signals(network, step, done + 1, count)
            after, farthest = advanced(traits, arrays, bodies, now, values, count)
            if farthest > network.margin / 2 and count > 1:
                most = count // 2  # contacts may have been missed: repeat with fewer steps
            else:
                now, done = after, done + count
            if farthest > network.margin / 4:
                state, now = renewed(network, state, jax.tree.map(np.asarray, now))
                arrays, now = arrays_of(state.pairs), on_device(now)
        yield Moment(stop, state, now)


def march(network: Network, state: State, step: float, count: int, every: int) -> Iterator[Floats]:
    """Yield the motions (2f, N) as `granular_analysis.theory.network_verlet.march` does."""
    yield from motions(network, step, moments(network, state, step, range(0, count + 1, every)))


def on_device(tree: Any) -> Any:
    """Return a tree of arrays, moved to the device."""
    return jax.tree.map(jnp.asarray, tree)
