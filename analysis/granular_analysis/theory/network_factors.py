"""Run as a function of factors on each sphere, each contact, the start and each signal.

A run of `granular_analysis.theory.network_traced` from a state depends on factors. A factor of 1 has no effect; a phase
or a delay has none at 0. Each factor multiplies the quantity named here, unless stated otherwise:

    density          (N,) density of each sphere
    radius           (N,) radius of each sphere; mass, stiffnesses and overlaps follow, positions stay
    overlap          (M,) overlap of each pair at rest; positions stay
    normal_stiffness (M,) normal force of each pair at a given overlap, including its pull
    shear_stiffness  (M,) shear force of each pair at a given overlap
    damping          ()   all dashpots
    amplitude        ()   displacements, turns, velocities and spins at the start
    phase            ()   phase φ added to a wave at the start: cos φ times the motion plus sin φ times its quadrature
    drives           (D,) signal of each drive
    delay            (D,) time by which each signal is late
    adhesion         (M,) pull of each pair; its overlap at rest changes so that its force at rest stays

A delay needs the derivative of the signal, so the signal must accept JAX arrays, as all of
`granular_analysis.theory.signals` do.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jax import numpy as jnp
from jax.errors import TracerArrayConversionError
from numpy.typing import NDArray

from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network import Network, Traits
from granular_analysis.theory.network_laws import LAWS
from granular_analysis.theory.network_state import Pairs, State, acting, meetings, resultants
from granular_analysis.theory.network_tangents import combined, scaled, times
from granular_analysis.theory.network_traced import Arrays, arrays_of, on_device, pairs_of
from granular_analysis.theory.network_verlet import Bodies, Carried, moved, pushed, signals

__all__ = ["Run"]

Floats = NDArray[np.float64]
Factors = Mapping[str, Any]
# For each factor, the value without effect, and what has one factor each
FACTORS = {
    "density": (1.0, "spheres"),
    "radius": (1.0, "spheres"),
    "overlap": (1.0, "pairs"),
    "normal_stiffness": (1.0, "pairs"),
    "shear_stiffness": (1.0, "pairs"),
    "damping": (1.0, "runs"),
    "amplitude": (1.0, "runs"),
    "phase": (0.0, "runs"),
    "drives": (1.0, "drives"),
    "delay": (0.0, "drives"),
    "adhesion": (1.0, "pairs"),
}


class Plan(NamedTuple):
    """Properties for which a run is compiled; runs with equal plans and equal shapes share one compiled program.

    Attributes
    ----------
    traits : traits of the network.
    samples, every : as for `Run`.
    late : the run itself if a delay traces its signals, else None.
    """

    traits: Traits
    samples: int
    every: int
    late: "Run | None"


class Given(NamedTuple):
    """Arrays of a run on the device.

    Attributes
    ----------
    arrays, bodies : arrays of the pairs and of the spheres.
    lightness : (N,) 1/m, 0 for held spheres.
    values : (steps + 1, D, 2) values and rates of the signals (`granular_analysis.theory.network_verlet.signals`).
    motion : (2f, N) motion at the start.
    quadrature, spheres, contacts : as for `Run`.
    """

    arrays: Arrays
    bodies: Bodies
    lightness: Any
    values: Any
    motion: Any
    quadrature: Any
    spheres: Any
    contacts: Any


@dataclass(frozen=True, eq=False)
class Run:
    """Run whose record can be differentiated.

    Attributes
    ----------
    network : network.
    state : start, as from `granular_analysis.theory.network_state.start`; its pairs are not searched again.
    step : length of a time step.
    samples : number of samples after the start.
    every : number of steps between two samples.
    spheres : (n,) indices of the recorded spheres.
    contacts : (C,) pairs whose power is recorded.
    quadrature : (2f, N) initial motion of the wave a quarter of a period ahead; needed for the factor `phase`.
    """

    network: Network
    state: State
    step: float
    samples: int
    every: int
    spheres: NDArray[np.intp]
    contacts: Sequence[int] | NDArray[np.intp] = ()
    quadrature: Floats | None = None

    def neutral(self, *names: str) -> dict[str, Floats]:
        """Return the named factors, with values that have no effect.

        Raises TheoryError for an unknown name, and for a phase without a quadrature.
        """
        if unknown := [name for name in names if name not in FACTORS]:
            raise TheoryError(f"{unknown[0]!r}: not a factor of a run; allowed: {', '.join(FACTORS)}")
        if "phase" in names and self.quadrature is None:
            raise TheoryError("phase: needs the quadrature of the run")
        count, pairs, drives = len(self.network.position), len(self.state.pairs.first), len(self.network.drives)
        shapes: dict[str, tuple[int, ...]] = {"spheres": (count,), "pairs": (pairs,), "drives": (drives,), "runs": ()}
        return {name: np.full(shapes[each], value) for name, (value, each) in FACTORS.items() if name in names}

    def plan(self, factors: Factors) -> Plan:
        """Return the plan for which a run with these factors is compiled."""
        return Plan(self.network.traits, self.samples, self.every, self if "delay" in factors else None)

    @cached_property
    def given(self) -> Given:
        """Return the arrays of the run on the device."""
        network = self.network
        free = 1.0 if network.held is None else 1.0 - network.held
        return Given(
            arrays_of(self.state.pairs),
            *on_device((Bodies.of(network, self.step), free / network.mass, _driven(self), self.state.motion)),
            *on_device((self.quadrature, self.spheres, np.asarray(self.contacts, dtype=np.intp))),
        )


def prepared(plan: Plan, given: Given, factors: Factors) -> tuple[Pairs, Bodies, Any, Carried]:
    """Return the pairs, spheres and signal values with their factors, and the start of the first step."""
    arrays, bodies = varied(plan.traits, given, factors)
    pairs, motion = pairs_of(plan.traits, arrays), given.motion
    values = given.values if plan.late is None else jnp.asarray(_driven(plan.late, factors["delay"]))
    values = values * jnp.asarray(factors.get("drives", jnp.ones(len(plan.traits.drives))))[:, None]
    if "phase" in factors:
        motion = jnp.cos(factors["phase"]) * motion + jnp.sin(factors["phase"]) * given.quadrature
    motion = motion * factors.get("amplitude", 1.0)
    return pairs, bodies, values, started(plan.traits, pairs, bodies, motion, values[0])


def _driven(run: Run, delays: Any = None) -> Any:
    """Return the values of the signals at all steps, (steps + 1, D, 2), delayed by `delays` (D,)."""
    network = run.network
    if delays is not None:
        late = zip(network.drives, delays, strict=True)
        network = replace(network, drives=tuple(replace(each, signal=_delayed(each.signal, by)) for each, by in late))
    return signals(network, run.step, 0, run.samples * run.every + 1)


def _delayed(signal: Callable[[Any], Any], by: Any) -> Callable[[Any], Any]:
    """Return the delayed signal; it raises TheoryError if JAX cannot trace it."""

    def late(time: Any) -> Any:
        try:
            return jnp.asarray(signal(time - by))
        except TracerArrayConversionError as why:
            said = "delay: a signal takes only NumPy arrays; write it with the functions of its array's module"
            raise TheoryError(said) from why

    return late


def varied(traits: Traits, given: Given, factors: Factors) -> tuple[Arrays, Bodies]:
    """Return the arrays of pairs and spheres with their factors."""
    arrays, bodies, count, still = given.arrays, given.bodies, len(traits.position), jnp.zeros(len(traits.walls))
    radius, density = (jnp.asarray(factors.get(name, 1.0)) * jnp.ones(count) for name in ("radius", "density"))
    lighter = 1 / (radius**3 * density)
    ways, turns = [lighter] * traits.dimension, [lighter / radius**2] * (traits.freedoms - traits.dimension)
    first, second, radii = arrays["first"], arrays["second"], arrays["radii"]
    larger = radii * jnp.stack([radius[first], jnp.concatenate([radius, still])[second]])
    wider = _curvature(radii) / _curvature(larger)
    light = jnp.concatenate([lighter * given.lightness, still])
    both = light[first] + light[second]
    normal, shear = (factors.get(name, 1.0) for name in ("normal_stiffness", "shear_stiffness"))
    if "adhesion" in factors:
        arrays = _adhering(traits, arrays, factors["adhesion"])
    arrays = arrays | {
        "radii": larger,
        "overlap": arrays["overlap"] * factors.get("overlap", 1.0) + (larger - radii).sum(axis=0),
        "mass": jnp.where(both > 0, 1 / jnp.where(both > 0, both, 1.0), 0.0),
        "A": arrays["A"] * normal * jnp.sqrt(wider),
        "F": arrays["F"] * normal * wider,
        "B": arrays["B"] * shear * jnp.sqrt(wider),
        "damping": arrays["damping"] * factors.get("damping", 1.0),
    }
    return arrays, bodies._replace(mobility=bodies.mobility * jnp.stack([*ways, *turns]))


def _adhering(traits: Traits, arrays: Arrays, factor: Any) -> Arrays:
    """Return the arrays of pairs with factors (M,) on the pull; contacts that touch at rest keep their force there."""
    before, pull = pairs_of(traits, arrays), arrays["F"] * factor
    touches = before.overlap > before.normal.end
    force = before.normal.repulsion(before.overlap, before.normal.radius(before.overlap, touches), touches)
    ends = [LAWS[traits.adhesion](arrays["A"], each).overlap(force) for each in (arrays["F"], pull)]
    return arrays | {"F": pull, "overlap": arrays["overlap"] + jnp.where(touches, ends[1] - ends[0], 0.0)}


def _curvature(radii: Any) -> Any:
    """Return 1/Rc (M,) from the radii (2, M) of both ends; a radius of 0 means a flat wall."""
    flat = radii[1] == 0
    return 1 / radii[0] + jnp.where(flat, 0.0, 1 / jnp.where(flat, 1.0, radii[1]))


def started(network: Traits, pairs: Pairs, bodies: Bodies, motion: Any, values: Any) -> Carried:
    """Return the start of the first step for a motion reached from rest on a straight path without forces."""
    half = network.freedoms
    way = meetings(network, [*motion[:half], *motion[:half]], pairs, pairs.overlap > pairs.normal.end)
    memory = scaled(way.stiffness, way.slip_rate) if network.law == "incremental" else way.slip_rate
    met = meetings(network, moved(network, bodies, values, list(motion)), pairs, way.closed)
    now = acting(network, pairs, met, scaled(met.closed, memory), stepped=True)
    loads = pushed(network, bodies, values, resultants(pairs, now))
    slips = combined(scaled(met.closed, memory), met.tangents.along)
    return Carried(tuple(motion), slips, met.closed, times(loads, bodies.mobility))
