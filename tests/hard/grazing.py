"""A contact of the network that a wave takes to the edge of opening: by every law, and on both sides of the edge.

A sphere between two held ones is thrown at one of them and spins, so that the contact behind it comes within a share ε
of the way of opening, or opens by as much. Steps of LAMMPS stand beside DOP853 and the compiled forces.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from granular_analysis.theory.network import Material, Network
from granular_analysis.theory.network_ledger import energy
from granular_analysis.theory.network_motion import integrate
from granular_analysis.theory.network_state import State, meetings, present, start
from granular_analysis.theory.network_tangents import dot
from granular_analysis.theory.network_verlet import moments
from tests.hard.case import Case, Cases
from tests.hard.cell import Floats

DEPTH, RATIO = 1e-4, 0.2  # overlap at rest in R; Poisson's ratio, E is 1
LAWS: dict[str, dict[str, Any]] = {
    "Hertz": {"materials": (Material(1.0, RATIO),)},
    "DMT": {"materials": (Material(1.0, RATIO, 2e-7),)},
    "JKR": {"materials": (Material(1.0, RATIO, 2e-7),), "adhesion": "jkr"},
}
SPIN = 0.3  # R × spin over the speed
COUNT, TURNS = 200, 4.0  # steps to the end, and the end in radians of the motion there and back
ASIDE = 1e-3  # share of the speed: there steps and reference are on one side of the edge


def thrown(kind: str, shear: str, speed: Floats) -> tuple[Network, State]:
    """Return spheres between held ones, thrown at speeds of many lanes."""
    lanes = len(speed)
    places = np.stack([np.repeat((2 - DEPTH) * np.arange(3), lanes), np.tile(3.0 * np.arange(lanes), 3)], axis=1)
    alike, own = np.ones(3 * lanes), np.arange(3 * lanes) // lanes == 1
    network = Network(places, alike, alike, held=~own, law=shear, **LAWS[kind])
    rate, spin = np.zeros((3 * lanes, 2)), np.zeros(3 * lanes)
    rate[own, 0], spin[own] = speed, SPIN * speed
    return network, start(network, 0.0, rate, 0.0, spin)


def energy_of(network: Network, state: State, motion: Any, memory: Any, begun: Any) -> float:
    """Return the energy after steps of LAMMPS from a state, whose memory of slips is their vectors."""
    (along,) = meetings(network, motion, state.pairs, begun).tangents.along
    last = replace(state, motion=np.array(motion), shear=dot(memory, along)[None], begun=begun)
    return energy(network, last).total


def stepped(kind: str, shear: str, speed: Floats, step: float, count: int) -> tuple[Floats, Floats, float]:
    """Return the last motions (6, lanes), the largest stretches over those at which contacts end, and the energy."""
    network, state = thrown(kind, shear, speed)
    own = slice(len(speed), 2 * len(speed))
    found = [*moments(network, state, step, range(count + 1))]
    motion = np.array([each.now.motion for each in found])[:, :, own]
    apart = np.hypot(2 - DEPTH + motion[:, 0], motion[:, 1]) - (2 - DEPTH)
    now = found[-1].now
    left = energy_of(network, state, now.motion, now.memory, now.begun)
    reach = DEPTH - float(np.ravel(state.pairs.normal.end)[0])
    return motion[-1], np.max(apart, axis=0) / reach, left


def at_the_edge(kind: str, shear: str, step: float, speed: float) -> float:
    """Return the speed at which the largest stretch is that of the end, to rounding."""
    reach = 1e-2
    for _ in range(6):
        both = speed * np.array([1 - reach, 1 - reach / 2])
        one, other = stepped(kind, shear, both, step, COUNT // 2)[1]
        speed = both[1] + (1 - other) * (both[1] - both[0]) / (other - one)
        reach = max(reach**1.7, 1e-8)
    return float(speed)


def edge(kind: str, shear: str, reference: tuple[str, str] | None = None, sides: int = 1) -> Cases:
    """Motion and energy on both sides of the edge, and what the last digit of the speed decides."""
    network, state = thrown(kind, shear, np.zeros(1))
    still, pairs = present(network, state), state.pairs
    end = float(np.ravel(pairs.normal.end)[0])
    curve, way, mass = type(pairs.normal)(pairs.A[:1], pairs.F[:1]), DEPTH - end, float(network.mass[0])
    overlap = np.array([DEPTH + way, end, DEPTH])
    stored = curve.energy(overlap, curve.radius(overlap, np.ones(3, dtype=bool))) @ [1, 1, -2]
    first = np.sqrt(2 * stored / mass)
    step = TURNS * way / first / COUNT
    speed = at_the_edge(kind, shear, step, first) * (1 + np.array([-ASIDE, ASIDE, -1e-10, 1e-10]))
    (found, _, left), (decided, _, _) = (stepped(kind, shear, each, step, COUNT) for each in (speed[:2], speed[2:]))
    witness, begin = thrown(*(reference or (kind, shear)), speed[:2][::sides])
    run = integrate(witness, begin, [COUNT * step], rtol=1e-10, longest_step=2 * step)
    expected = run.motion[-1][:, 2:4]
    sizes = np.repeat([way, first], 3)[:, None]
    errors = np.abs(found - expected) / sizes
    jumps = [float(both[2, 1] - both[2, 0]) / way for both in (decided, expected)]
    # The fastest is the turn; where the other contact is pressed, stiffnesses are up to √2 times those at rest
    pressing, shearing = 1.5 * pairs.A[0] * np.sqrt(DEPTH), float(still.stiffness[0])
    fast = np.sqrt(2 * np.sqrt(2) * max(pressing, shearing / 0.4) / mass)
    turned, lasting = fast * step, TURNS * way / first
    kick = (pairs.normal.pull * pairs.F[0] + shearing * SPIN * way / 0.4) * step / mass / first
    order = turned / 2 if shear == "incremental" else turned**2
    bound = 1.5 * order * (fast * lasting / 24 + 1 / 8) + kick * max(1.0, lasting * first / way / 2)
    where = f"a contact of the network at the edge of opening, {kind}, {shear} law"
    hard = "a contact that opens forgets its slip, so that the tenth digit decides the motion that follows"
    return [
        Case(
            f"{where}: error of the motion, 1e-3 of the speed to both sides, over the way and the speed",
            hard,
            float(errors.max()),
            "(ΩΔτ)²(Ωτ/24 + 1/8) of Verlet, half as much again, of the incremental law ΩΔτ/2 for the first factor, "
            "whose stiffness is that of the step's end; half a kick by pull and shear where it opens, and where it "
            "closes",
            most=float(bound),
        ),
        Case(
            f"{where}: jump of the turn by the tenth digit of the speed, over that of the reference between both sides",
            hard,
            jumps[0] / jumps[1],
            "1; the pull that is missing while the contact is open, √ε of a swing for ε = 1e-3, is 6 %",
            least=0.9,
            most=1.1,
        ),
        Case(
            f"{where}: error of the energy, of that of the motion, the same",
            hard,
            float(abs(left - run.energy[-1]) / (2 * stored)),
            "that of the motion twice, as energies are squares",
            most=2 * float(bound),
        ),
    ]
