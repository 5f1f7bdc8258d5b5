"""The steps of `granular_analysis.theory.network_verlet` by JAX: on a GPU, or on all cores of this machine.

JAX traces the lines that NumPy runs, in double precision. Motions are the same to rounding, and on one device to the
last bit: each sphere gathers the forces of its contacts, in one order.

The extra ``jax`` of this package installs it: ``pip install 'granular-lmp[jax]'``.
"""

from collections.abc import Iterator
from dataclasses import fields
from functools import partial
from typing import Any

import jax
import numpy as np
from jax import lax
from jax import numpy as jnp
from numpy.typing import NDArray

from granular_analysis.theory.network import Network
from granular_analysis.theory.network_laws import LAWS
from granular_analysis.theory.network_outside import imposed
from granular_analysis.theory.network_state import Pairs, State
from granular_analysis.theory.network_verlet import Bodies, Carried, begun, renewed, signals, stepped

__all__ = ["march"]

jax.config.update("jax_enable_x64", True)
Floats = NDArray[np.float64]
Arrays = dict[str, Any]


def arrays_of(pairs: Pairs) -> Arrays:
    """Return the arrays of pairs on the device, by their names."""
    return {each.name: jnp.asarray(getattr(pairs, each.name)) for each in fields(pairs) if each.name != "normal"}


def pairs_of(network: Network, arrays: Arrays) -> Pairs:
    """Return the pairs of traced arrays."""
    return Pairs(**arrays, normal=LAWS[network.adhesion](arrays["A"], arrays["F"]))


@partial(jax.jit, static_argnums=0)
def advanced(network: Network, arrays: Arrays, bodies: Bodies, now: Carried, values: Any) -> tuple[Carried, Any]:
    """Return the motion after as many steps as there are values, and how far spheres were at most from their search."""
    pairs = pairs_of(network, arrays)

    def one(carry: tuple[Carried, Any], at: Any) -> tuple[tuple[Carried, Any], None]:
        now, farthest = carry
        now = stepped(network, pairs, bodies, now, at)
        far = [jnp.max(jnp.abs(way - from_)) for way, from_ in zip(now.motion, pairs.place, strict=False)]
        return (now, jnp.maximum(farthest, jnp.max(jnp.stack(far)))), None

    return lax.scan(one, (now, 0.0), values)[0]


def march(network: Network, state: State, step: float, count: int, every: int) -> Iterator[Floats]:
    """Yield the motions (2f, N) as `granular_analysis.theory.network_verlet.march` does."""
    bodies = Bodies.of(network, step)
    now = begun(network, state, bodies)
    yield imposed(network.drives, 0.0, np.array(now.motion))
    arrays, bodies, now = arrays_of(state.pairs), on_device(bodies), on_device(now)
    for first in range(0, count, every):
        left, length = every, every
        while left:
            done = first + every - left
            values = signals(network, step, done + 1, length)
            after, farthest = advanced(network, arrays, bodies, now, jnp.asarray(values))
            if farthest > network.margin / 2 and length > 1:
                length = max(1, length // 2)  # contacts may have been missed: back, to fewer steps
            else:
                now, left = after, left - length
                length = min(length, left)
            if farthest > network.margin / 4:
                state, now = renewed(network, state, jax.tree.map(np.asarray, now))
                arrays, now = arrays_of(state.pairs), on_device(now)
        yield imposed(network.drives, step * (first + every), np.array(now.motion))


def on_device(tree: Any) -> Any:
    """Return a tree with its arrays on the device."""
    return jax.tree.map(jnp.asarray, tree)
