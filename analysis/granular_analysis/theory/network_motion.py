"""Motion of a packing of spheres by an error-controlled Runge–Kutta method.

The laws are those of `granular_analysis.theory.network`. LAMMPS uses velocity Verlet with a fixed step; this module
uses DOP853, of order 8, whose error estimate sets the steps. The integrated state includes the slip of every contact
and the work W of the balance E − W (`granular_analysis.theory.network_ledger`). After every step an open contact
forgets its slip, and a sliding contact keeps the slip at its limit. If a sphere has moved far enough for new contacts,
the step is undone and the pairs are searched again.

Good values: rtol from 1e-6 (a figure) to 1e-11 (a witness). An evaluation of all forces takes 0.2 µs of processor time
per contact, a tenth of that in the compiled loop (`granular_analysis.theory.network_loop`). A wave in a crystal needs 7
(rtol 1e-6), 16 (1e-9) or 27 (1e-11) evaluations per unit of time t0.

When it breaks: if many contacts open or close in a large network. The adhesive force then jumps, and every jump costs
all spheres about thirty evaluations. A packing of 1e4 spheres of unequal radii (3e-4) released out of equilibrium takes
1 ms per sphere and t0. A contact that opens and closes again within one step keeps its slip. The force is not smooth
where a contact closes, and the error estimate misses up to 1e5 times rtol in one impact. Sliding is resolved to second
order in the step (first order in space with dashpots), which the error estimate does not include: with friction, halve
`longest_step` and compare.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from granular_analysis.theory.errors import TheoryError
from granular_analysis.theory.integrator import between, solver_of, step
from granular_analysis.theory.network import Network
from granular_analysis.theory.network_ledger import energy, work_rate
from granular_analysis.theory.network_loop import contact_loop
from granular_analysis.theory.network_outside import imposed, pushes
from granular_analysis.theory.network_state import State, contacts, present, resultants, searched_again, settled
from granular_analysis.theory.network_tangents import crossed, dot

__all__ = ["integrate"]

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]

_FIRST = 0.3  # first step over the longest one; a rule from slopes alone would depend on the units


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Motion of chosen spheres, and energy and work of the whole network, at T times.

    Attributes
    ----------
    times : (T,) times.
    spheres : (n,) indices of the recorded spheres.
    motion : (T, 2f, n) displacement, turn, velocity, spin, in the rows of `State.motion`.
    energy, work : (T,) E, and W since the start (`granular_analysis.theory.network_ledger`).
    initial_energy : E at the start.
    final : state at the last time.
    steps : number of steps that were kept.
    evaluations : number of evaluations of all forces.
    """

    times: Floats
    spheres: Integers
    motion: Floats
    energy: Floats
    work: Floats
    initial_energy: float
    final: State
    steps: int
    evaluations: int

    @property
    def displacement(self) -> Floats:
        """Return the displacements from rest (T, n, d), as `granular_analysis.measure.coherent.project` takes them."""
        return self._rows(0, 0)

    @property
    def rotation(self) -> Floats:
        """Return the turns: (T, n, 1) in the plane, (T, n, 3) in space."""
        return self._rows(0, 1)

    @property
    def velocity(self) -> Floats:
        """Return the velocities (T, n, d)."""
        return self._rows(1, 0)

    @property
    def spin(self) -> Floats:
        """Return the spins: (T, n, 1) in the plane, (T, n, 3) in space."""
        return self._rows(1, 1)

    def _rows(self, rate: int, turning: int) -> Floats:
        rows = np.split(self.motion, 2, axis=1)[rate]
        return np.moveaxis(np.split(rows, [len(self.final.pairs.place)], axis=1)[turning], 1, 2)

    @property
    def heat(self) -> Floats:
        """Return the energy (T,) lost to sliding, dashpots and drag, E(0) + W − E; without these, it is the error."""
        return self.initial_energy + self.work - self.energy


def scales(network: Network, state: State) -> tuple[float, float]:
    """Return the length x and the speed v to which errors are relative.

    Let r = √(k/m) be the fastest rate of a contact. x is the largest displacement (or Rθ) of the state, or v/r or a/r²
    if these are larger, with the largest acceleration a (or Rω̇); v is the largest speed (or Rω), or xr if that is
    larger. The size of a drive counts in x or in a. Contacts that only just touch have almost no rate, so v/r counts as
    at most the depth (mv²/A)^{2/5} of a Hertz collision, and a/r² as at most the depth (ma/A)^{2/3} under a force.

    Raises TheoryError for a state at rest without forces, in which nothing will move.
    """
    motion, pairs = state.motion, state.pairs
    now = present(network, state)
    inverse_mass = np.append(network.mobility[0], np.zeros(len(network.walls)))
    accelerations = np.abs(np.array(resultants(pairs, now))) * network.mobility
    arms = _arms(network)
    length, speed, acceleration = (float(np.max(np.abs(each) * arms)) for each in (*np.split(motion, 2), accelerations))
    stiffness = 1.5 * pairs.A * now.radius  # a Hertz contact of this radius is stiffer than an adhesive one
    for each in network.drives:
        lever = arms[each.component, each.spheres]
        reached = float(
            np.max(each.size * lever * (1.0 if each.moves else network.mobility[each.component, each.spheres]))
        )
        length, acceleration = max(length, reached * each.moves), max(acceleration, reached * (not each.moves))
    rate = float(np.sqrt(np.max(stiffness * (inverse_mass[pairs.first] + inverse_mass[pairs.second]), initial=0.0)))
    every = np.arange(len(network.position))
    softest = float(np.max(network.mass / network.coefficients(every, every)[0]))
    deepest = (softest * speed**2) ** 0.4, (softest * acceleration) ** (2 / 3)  # of contacts that just touch
    length = max(length, min(deepest[0], speed / rate if rate else np.inf))
    length = max(length, min(deepest[1], acceleration / rate**2 if rate else np.inf))
    speed = max(speed, length * rate)
    if not (length > 0 and speed > 0):
        raise TheoryError("the network is at rest and no force acts: give it a displacement, a velocity or a spin")
    return length, speed


def integrate(
    network: Network,
    state: State,
    times: ArrayLike,
    *,
    rtol: float = 1e-9,
    spheres: ArrayLike | None = None,
    longest_step: float = np.inf,
) -> Trajectory:
    """Return the motion at the given times; `state` is the motion at time 0.

    Parameters
    ----------
    network : network.
    state : from `granular_analysis.theory.network_state.start`, or the final state of another run.
    times : (T,) ascending, not negative.
    rtol : error of a step, root mean square over the network, relative to `scales` and to the motion so far. Use a
        smaller value if only a share s of the spheres moves (by √s), or if all spheres fly or turn together much
        farther than the overlaps (by this ratio).
    spheres : (n,) indices of the spheres to record; None: all.
    longest_step : bound on the step, for networks with friction. No step is longer than two thirds of a collision.

    Raises TheoryError for times out of order or a network in which nothing moves, RuntimeError if the integration
    fails.
    """
    times = np.asarray(times, dtype=float)
    if times.ndim != 1 or times.size == 0 or times[0] < 0 or np.any(np.diff(times) <= 0):
        raise TheoryError("times must be one-dimensional, not empty, not negative and ascending")
    chosen = np.arange(len(network.position)) if spheres is None else np.asarray(spheres, dtype=np.intp)
    length, speed = scales(network, state)
    # A collision lasts three times its depth over the speed; free flight gives no error that would shorten a step
    longest_step = min(longest_step, 2 * length / speed, *(each.longest for each in network.drives))
    samples: list[tuple[Floats, float, float]] = []
    rates = _Rates(network, state)
    initial_energy = energy(network, state).total
    if times[0] == 0:
        samples.append((state.motion[:, chosen], initial_energy, 0.0))
    time, work = 0.0, 0.0
    first = _FIRST * longest_step
    steps = evaluations = 0
    while time < times[-1]:
        if rates.start is not state:
            rates = _Rates(network, state)
        atol = rtol * _sizes(network, state, length, speed)
        solver = solver_of(
            *(rates, time, _packed(state, work), times[-1]),
            rtol=rtol,
            atol=atol,
            max_step=longest_step,
            first_step=min(first, times[-1] - time),
        )
        tidy = True
        while tidy and time < times[-1]:
            step(solver)
            reached = _at(network, state, solver.t, solver.y)
            if _farthest(reached) > network.margin / 2:
                # Contacts may have been missed: return to before the step, search pairs and take a shorter step
                state = searched_again(network, _at(network, state, solver.t_old, solver.y_old))
                time, work, first = solver.t_old, solver.y_old[-1], solver.step_size / 2
                break
            after, tidy = rates.settled(reached)
            due = times[(times > solver.t_old) & (times <= solver.t)]
            if due.size:
                for moment, y in zip(due, between(solver, due), strict=True):
                    sample = _at(network, state, moment, y)
                    samples.append((sample.motion[:, chosen], energy(network, sample).total, y[-1]))
            state, steps = after, steps + 1
            time, work, first = solver.t, solver.y[-1], 2 * solver.step_size
        evaluations += rates.evaluations
    motion, energies, works = (np.array(values) for values in zip(*samples, strict=True))
    return Trajectory(times, chosen, motion, energies, works, initial_energy, state, steps, evaluations)


def _packed(state: State, work: float) -> Floats:
    return np.concatenate([state.motion.ravel(), state.shear.ravel(), [work]])


def _at(network: Network, state: State, time: float, y: Floats) -> State:
    """Return the state of packed numbers y at a time, with the pairs and `begun` of `state`."""
    cut = state.motion.size
    motion = imposed(network.drives, time, y[:cut].reshape(state.motion.shape))
    return replace(state, motion=motion, shear=y[cut:-1].reshape(state.shear.shape))


def _arms(network: Network) -> Floats:
    """Return the factors (f, N) that make lengths of displacements and turns: 1 and R."""
    turns = network.freedoms - network.dimension
    return np.stack([np.ones_like(network.radius)] * network.dimension + [network.radius] * turns)


def _sizes(network: Network, state: State, length: float, speed: float) -> Floats:
    """Return the size of each entry of the packed state; the work has size inf and so does not limit the step."""
    arms = _arms(network)
    shear = np.full(state.shear.shape, length)
    if network.law == "incremental":
        pairs = state.pairs
        stiffness = pairs.B * np.sqrt(np.maximum(pairs.overlap, length))
        shear *= np.where(stiffness > 0, stiffness, 1.0)  # without shear stiffness the memory stays 0
    return np.concatenate([(length / arms).ravel(), (speed / arms).ravel(), shear.ravel(), [np.inf]])


def _farthest(state: State) -> float:
    """Return the largest distance that a sphere has moved since the pairs were searched."""
    way = state.motion[: len(state.pairs.place)] - state.pairs.place
    return float(np.sqrt(np.max(dot(way, way))))


class _Rates:
    """Time derivative of the packed state by the laws of `granular_analysis.theory.network`.

    Attributes
    ----------
    start : settled state whose pairs and `begun` are used.
    evaluations : number of evaluations so far.
    loop : the compiled loop, or None.
    plain : whether the loop found the state of the last evaluation settled; False without a loop.
    """

    def __init__(self, network: Network, start: State) -> None:
        self.network, self.start, self.loop = network, start, contact_loop(network, start)
        self.evaluations, self.plain = 0, False

    def __call__(self, time: float, y: Floats) -> Floats:
        network, start, rate = self.network, self.start, np.empty_like(y)
        freedoms, cut = network.freedoms, start.motion.size
        motion = imposed(network.drives, time, y[:cut].reshape(start.motion.shape))
        moved = rate[:cut].reshape(motion.shape)
        moved[:freedoms] = motion[freedoms:]
        if network.dimension == 3:
            moved[3:6] += _tilting(motion[3:6], motion[9:])
        load, shear = moved[freedoms:], y[cut:-1].reshape(start.shear.shape)
        rate[-1] = self._act(motion, shear, load, rate[cut:-1].reshape(shear.shape))
        if network.drives:
            push = pushes(network.drives, time, load.shape)
            rate[-1] += np.sum(push * motion[freedoms:])
            load += push
            for each in network.drives:
                if each.moves:  # a prescribed motion does work against the contact forces
                    rate[-1] -= np.sum((load * motion[freedoms:])[:, each.spheres])
        load *= network.mobility
        if network.drag is not None:
            load -= network.drag * motion[freedoms:]
        self.evaluations += 1
        return rate

    def _act(self, motion: Floats, shear: Floats, load: Floats, shear_rate: Floats) -> float:
        """Write forces and torques to `load`, and shear rates to `shear_rate`; return dW/dt of the ledger."""
        if self.loop:
            power, self.plain = self.loop(motion, shear, load, shear_rate)
            return power
        now = contacts(self.network, motion, self.start.pairs, shear, self.start.begun)
        load[...] = resultants(self.start.pairs, now)
        shear_rate[...] = now.memory_rate
        return float(work_rate(self.network, self.start.pairs, now))

    def settled(self, reached: State) -> tuple[State, bool]:
        """Return the state of the last evaluation, settled, and whether it already was: if not, its slope differs."""
        if self.plain:
            return reached, True
        state = settled(self.network, reached)
        tidy = np.array_equal(state.shear, reached.shear)
        if state.pairs.normal.lasts:
            tidy &= np.array_equal(state.begun, self.start.begun)
        return state, tidy


def _tilting(turn: Floats, spin: Floats) -> Floats:
    """Return dg/dt − ω = ½ω × g + ¼(ω·g) g, (3, N), for turns g, which are 2 tan(ϑ/2) times the axis."""
    return crossed(spin, turn) / 2 + dot(spin, turn) * turn / 4
