"""Points of traces (the motion of a sphere at a time) predicted by a run of the network, and their slopes.

The run takes the same steps as the LAMMPS run of its scene (`granular_analysis.theory.network_verlet`). All runs of a
fit have the same step in seconds, that of the scene from which the fit starts: so the points are smooth functions of
the keys. Between two steps, Hermite's cubic through displacement and velocity gives the motion.

The slope with respect to a key θ is dy/dθ = (∂y/∂g)(dg/dθ), where g are all numbers with which a run begins:
stiffnesses, overlaps, masses, the motion at the start, signals of sources, dashpots. dg/dθ is a difference of closed
forms, which costs no run. ∂y/∂g is exact, by forward mode over the whole run
(`granular_analysis.theory.network_gradient`, which needs JAX). So any number of a scene may be free.

Good values: time.timestep at most a third of the time in which the fastest motion turns by one radian. When it breaks:
if contacts open, close or slide, a trace has a kink, and its slope is refused.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from granular_analysis.measure.points import TRACES, Point
from granular_analysis.measure.snapshot import FirstSnapshot
from granular_analysis.measure.stepping import NetworkEngine, first_of
from granular_analysis.measure.traces import spheres_at
from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.network import Network
from granular_analysis.theory.network_compiled import fastest_march
from granular_analysis.theory.network_state import damping_ratio
from granular_lmp.runs.record import GranularError, Scene

__all__ = ["TracedRuns"]

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
# Relative change of a key for dg/dθ, a difference of fourth order: central, or one-sided next to a bound. Truncation
# changes a slope by 1e-9, because forces at rest are larger than those of a wave and cancel; rounding by at most 1e-6,
# because overlaps are small against radii
_APART = 1e-3
_BESIDE = {0: -25 / 12, 1: 4.0, 2: -3.0, 3: 4 / 3, 4: -1 / 4}
_STENCILS = (
    {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12},
    _BESIDE,
    {-far: -weight for far, weight in _BESIDE.items()},
)
# Rows of the motion of a sphere in the plane and in space; the rates follow in the same order
_ROWS = {2: ("displacement_x", "displacement_y", "rotation_z"), 3: tuple(TRACES)[:3] + tuple(TRACES)[6:9]}
_RATES = {"velocity": "displacement", "spin": "rotation"}
_TRAITS = ("viscosity", "restitution", "friction")  # constants of a compiled run


class _Begun(NamedTuple):
    """A scene at its start, the step in units of its deck, and the unit of each point in the deck, in SI (N,)."""

    first: FirstSnapshot
    step: float
    units: Floats


@dataclass(frozen=True, eq=False)
class TracedRuns:
    """Points of traces, predicted by runs of scenes that differ only in their free keys.

    Attributes
    ----------
    scene : the scene from which a fit starts; it sets the step of all runs.
    points : the measured points of traces, N.
    """

    scene: Scene
    points: Sequence[Point]

    @cached_property
    def step(self) -> float:
        """Length of a step, s."""
        return float(self.scene.time.step * self.scene.scale.time)

    @cached_property
    def _times(self) -> Floats:
        return np.array([each.time for each in self.points])

    @cached_property
    def steps(self) -> int:
        """Number of steps up to the time of the last point."""
        return max(int(np.ceil(self._times.max() / self.step - 1e-9)), 1)

    @cached_property
    def _start(self) -> _Begun:
        """The scene at its start."""
        return self._begun(self.scene)

    @cached_property
    def _chosen(self) -> tuple[Integers, Integers, Integers]:
        """Recorded spheres; and for each point the index of its sphere among them, and its row of the motion.

        Raises TheoryError for a sphere that is not there or that a source moves, for a time before the start, and for
        a motion out of the plane if the spheres stay in it.
        """
        network = self._start.first.network
        places = ((f"line {each.line}", each.row, each.column, each.layer) for each in self.points)
        spheres = spheres_at(places, self.scene, network.position)
        moved = [int(n) for each in network.drives if each.moves for n in each.spheres]
        rows, ways = _ROWS[network.dimension], []
        for each, by_source in zip(self.points, np.isin(spheres, moved), strict=True):
            if by_source:
                raise TheoryError(f"line {each.line}: a source moves the sphere of this trace; take another sphere")
            if each.time < 0:
                raise TheoryError(f"line {each.line}: time = {each.time:g} s: is before the start of the run")
            name, _, axis = each.kind.partition("_")
            still = f"{_RATES.get(name, name)}_{axis}"
            if still not in rows:
                raise TheoryError(f"line {each.line}: {each.kind}: spheres in the plane have {', '.join(rows)} only")
            ways.append(rows.index(still) + len(rows) * (name in _RATES))
        every, which = np.unique(spheres, return_inverse=True)
        return every, which, np.array(ways)

    @cached_property
    def _reading(self) -> "_Reading":
        """Steps, rows and weights that give the points from the motion of the recorded spheres."""
        _, which, row = self._chosen
        freedoms = len(_ROWS[self._start.first.network.dimension])
        before = np.minimum((self._times / self.step).astype(np.intp), self.steps - 1)
        x, rate = self._times / self.step - before, row >= freedoms
        values = [2 * x**3 - 3 * x**2 + 1, x**3 - 2 * x**2 + x, 3 * x**2 - 2 * x**3, x**3 - x**2]
        slopes = [6 * x**2 - 6 * x, 3 * x**2 - 4 * x + 1, 6 * x - 6 * x**2, 3 * x**2 - 2 * x]
        return _Reading(before, which, row % freedoms, np.where(rate, slopes, values), rate)

    def _begun(self, scene: Scene) -> _Begun:
        first, _ = first_of(scene)
        scales = first.scales
        sizes = {"displacement": scales.metre, "velocity": scales.metre / scales.second, "spin": 1 / scales.second}
        units = [sizes.get(each.kind.partition("_")[0], 1.0) for each in self.points]
        return _Begun(first, self.step / scales.second, np.array(units))

    def predicted(self, scene: Scene) -> Floats:
        """Return the points (N,) predicted for a scene, in SI units.

        The run is in compiled loops, or in NumPy without a C compiler. Raises TheoryError as the network does for a
        scene that it leaves out, and for a point without a sphere.
        """
        spheres, begun = self._chosen[0], self._begun(scene)
        run = fastest_march()(begun.first.network, begun.first.state, begun.step, self.steps, 1)
        motion = np.array([each[:, spheres] for each in run])
        return np.asarray(_read(motion, begun.step, *self._reading) * begun.units)

    def _beside(
        self, at: Callable[[Floats], Scene], values: Floats, change: Floats, here: _Begun
    ) -> tuple[list[_Begun], Sequence[float]]:
        """Return the scenes of a difference along `change`, at their start, and their weights.

        `here` is the scene of `values`. Raises TheoryError if bounds on both sides refuse every stencil.
        """
        for stencil in _STENCILS:
            try:
                begun = [self._begun(at(values + far * change)) if far else here for far in stencil]
                return begun, [*stencil.values()]
            except (GranularError, ValueError) as error:
                refused = error
        raise TheoryError(str(refused))

    def slopes(self, at: Callable[[Floats], Scene], values: Floats) -> Floats:
        """Return ∂(points)/∂(values), (N, P), in SI units; `at` makes a scene from the values (P,) of the keys.

        Raises TheoryError without JAX, if a contact opens, closes or slides, and for a key that changes which spheres
        may touch, or which effects are on.
        """
        if find_spec("jax") is None:
            raise TheoryError("JAX is not installed: pip install 'granular-lmp[jax]'")
        NetworkEngine.on("jax")  # caches compiled code for the next command
        import jax  # an extra, and slow to import

        from granular_analysis.theory import network_gradient
        from granular_analysis.theory.network_factors import Run

        reference = self._start.first.network

        def started(begun: _Begun) -> tuple[Run, dict[str, Any]]:
            """Return a run with the compiled constants of the first scene, and the factor of its dashpots instead."""
            own = begun.first.network
            network = replace(own, **{name: getattr(reference, name) for name in _TRAITS})
            run = Run(network, begun.first.state, begun.step, self.steps, 1, self._chosen[0])
            return run, {"damping": np.asarray(_loss(own) / (_loss(reference) or 1.0))}

        here = self._begun(at(values))
        run, factors = started(here)
        ways, units = [], []
        for change in np.diag(_APART * np.where(values, np.abs(values), 1.0)):
            ends, weights = self._beside(at, values, change, here)
            runs, losses = zip(*map(started, ends), strict=True)
            if not all(_alike(each, run) for each in runs):
                raise TheoryError("a change of a key changes which spheres may touch, or which effects are on")
            slope = partial(_slope, weights=weights, size=change.sum())
            ways.append(jax.tree.map(slope, *((each.given, loss) for each, loss in zip(runs, losses, strict=True))))
            units.append(slope(*(each.units for each in ends)))
        read = jax.tree_util.Partial(_read_off, reading=self._reading)
        found, slopes = network_gradient.jacobian(run, read, factors, ways)
        return np.asarray(slopes * here.units[:, None] + found[:, None] * np.array(units).T)


class _Reading(NamedTuple):
    """Steps, rows and weights that give N points from a motion (steps + 1, 2f, n).

    Attributes
    ----------
    before : (N,) last step before each point.
    which : (N,) index of its sphere among the recorded ones.
    place : (N,) row of its displacement or rotation; the velocity or spin is f rows further.
    weights : (4, N) of displacement and velocity at the step before and the step after; velocities are multiplied by
        the step.
    rate : (N,) whether the point is a velocity or a spin.
    """

    before: Integers
    which: Integers
    place: Integers
    weights: Floats
    rate: NDArray[np.bool_]


def _read(motion: Any, step: Any, before: Integers, which: Integers, place: Any, weights: Any, rate: Any) -> Any:
    """Return the points (N,), in units of the deck, of a motion (steps + 1, 2f, n) in NumPy or JAX."""
    speed = place + motion.shape[1] // 2
    ends = [(before, place), (before, speed), (before + 1, place), (before + 1, speed)]
    here, fast, there, faster = (motion[time, row, which] for time, row in ends)
    found = weights[0] * here + weights[2] * there + step * (weights[1] * fast + weights[3] * faster)
    return found * (rate / step + ~rate)


def _read_off(found: Any, reading: _Reading) -> Any:
    """Return the points (N,) of a record of `granular_analysis.theory.network_gradient`."""
    return _read(found.motion, found.times[1], *reading)


def _loss(network: Network) -> float:
    """Return the number to which all dashpots of a network are proportional."""
    return network.viscosity if network.restitution is None else damping_ratio(network.restitution)


def _alike(run: Any, other: Any) -> bool:
    """Return whether two runs have the same pairs and traits."""
    one, two = run.state.pairs, other.state.pairs
    same = np.array_equal(one.first, two.first) and np.array_equal(one.second, two.second)
    return same and run.network.traits == other.network.traits


def _slope(*values: Any, weights: Sequence[float], size: float) -> Any:
    """Return the derivative of an array from its values at the points of a stencil, `size` apart; integers stay."""
    if not np.issubdtype(values[0].dtype, np.floating):
        return values[0]
    return sum(weight * each for weight, each in zip(weights, values, strict=True)) / size
