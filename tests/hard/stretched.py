"""JKR contacts of the network that are stretched to next to their pull-off, by the steps of LAMMPS.

Spheres fly off from held ones, with the energy to turn a share s of the pull-off distance before the contact ends, or
to come as far beyond. The reference is the curve of Johnson, Kendall and Roberts over the radius of the contact
(`cases.pull_off.jkr`). At the largest pull the force F is flat, dP/dδ = 0, so what is singular is the outcome alone: a
sphere that parts has v = √(2Fs/m), and one that turns does so between two steps.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from cases.pull_off.jkr import Contact
from granular_analysis.measure.norms import slope
from granular_analysis.theory.network import Material, Network
from granular_analysis.theory.network_laws import Jkr
from granular_analysis.theory.network_state import State, start
from granular_analysis.theory.network_verlet import march
from tests.hard.case import Case, Cases
from tests.hard.cell import Floats

WORK = 1e-7  # of adhesion, for R = E = 1
CURVE = Contact(radius=0.5, modulus=0.5, work=WORK)
END, PULL = -CURVE.pull_off_distance("load"), CURVE.pull_off_force
MASS = 4 / 3 * np.pi
SHARES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
BEGIN = 0.87  # of the pull-off distance, where spheres are let go
TIME = float(np.sqrt(2 * (1 - BEGIN) * -END * MASS / PULL))  # until they turn, were the pull the largest all the way
Law = Callable[[Jkr], None]


def as_it_is(law: Jkr) -> None:
    """Leave a law as it is."""


def a_thousandth_late(law: Jkr) -> None:
    """Let contacts hold beyond the largest pull."""
    law.end = law.end * 1.001


def one_sided(law: Jkr) -> None:
    """Let contacts end where they begin."""
    law.end = 0 * law.end


def energy(overlap: float) -> float:
    """Return the energy of a contact, 0 at the pull-off."""
    return float(CURVE.energy(CURVE.contact_radius(overlap)) - CURVE.energy(CURVE.contact_radius(END)))


def let_go(begin: Floats, beyond: Floats, law: Law) -> tuple[Network, State]:
    """Return spheres on held ones, at overlaps and with the energy to come F·`beyond` over the pull-off."""
    lanes = len(begin)
    places = np.stack([np.repeat([0.0, 2.0], lanes), np.tile(3.0 * np.arange(lanes), 2)], axis=1)
    alike = np.ones(2 * lanes)
    held = np.arange(2 * lanes) < lanes
    network = Network(places, alike, alike, (Material(1.0, 0.0, WORK),), held=held, adhesion="jkr")
    speed = np.sqrt(2 * (PULL * beyond - np.array([energy(each) for each in begin])) / MASS)
    way, rate = np.zeros((2 * lanes, 2)), np.zeros((2 * lanes, 2))
    way[lanes:, 0], rate[lanes:, 0] = -begin, speed
    state = start(network, way, rate)
    assert isinstance(state.pairs.normal, Jkr)
    law(state.pairs.normal)
    return network, replace(state, begun=np.ones(lanes, dtype=bool))


def flown(begin: Floats, beyond: Floats, steps: int, law: Law = as_it_is) -> tuple[Floats, Floats]:
    """Return overlaps and velocities (2·steps + 1, lanes) from the start on, with so many steps to `TIME`."""
    network, state = let_go(begin, beyond, law)
    motion = np.array([*march(network, state, TIME / steps, 2 * steps, 1)])
    return -motion[:, 0, len(begin) :], motion[:, 3, len(begin) :]


def outcome(steps: int, law: Law = as_it_is) -> Cases:
    """Spheres that turn and spheres that part, a share of 1e-2 to 1e-6 of the pull-off distance from the other."""
    shares = np.array(SHARES)
    beyond, begin = END * np.concatenate([shares, -shares]), np.full(2 * len(shares), BEGIN * END)
    overlap, speed = flown(begin, beyond, steps, law)
    kick, hidden = PULL * TIME / steps / MASS, PULL * (TIME / steps) ** 2 / MASS / 8
    parted = speed[-1] > 0
    exact = [brentq(lambda at, over=each: energy(at) - PULL * over, END, BEGIN * END) for each in END * shares]
    turned = np.abs(overlap.min(axis=0)[: len(shares)] - exact)
    free = np.abs(speed[-1, len(shares) :] - np.sqrt(2 * PULL * -END * shares / MASS))
    where = f"JKR contacts of the network, 1e-2 to 1e-6 of the pull-off distance from its end, {steps} steps to there"
    return [
        Case(
            f"{where}: those that part and should turn, or the other way round",
            "one in a million of the way decides",
            float(np.sum(parted != (beyond > 0))),
            f"none: between two steps Fh²/8m, {-hidden / END:.0e} of that distance, are not seen",
            most=0,
        ),
        Case(
            f"{where}: error of the overlap where they turn, over Fh²/8m",
            "the pull is the largest there",
            float(turned.max() / hidden),
            "1, of a turn midway between two steps; Verlet's shift of the energy, h²(P² − F²)/24m, is below 0.1 of it",
            most=1.1,
        ),
        Case(
            f"{where}: error of the velocity of those that part, over half a kick Fh/2m",
            "as √s goes to 0, any error of the energy is all of the velocity",
            float(free.max() / (kick / 2)),
            "1, of a contact that ends just before or after a step; h² of the energy is below 0.05 of it at s = 1e-6",
            most=1.05,
        ),
    ]


def order(law: Law = as_it_is) -> Cases:
    """Order in the step of what parts, and of what turns and comes back."""
    counts = (50, 100, 200, 400)
    lanes = 24
    begin, beyond = END * np.linspace(BEGIN, BEGIN + 0.02, lanes), np.full(lanes, -END * 1e-2)
    parting = [np.abs(flown(begin, beyond, each, law)[1][-1] - np.sqrt(2 * PULL * beyond / MASS)) for each in counts]
    begin, beyond = np.array([BEGIN * END]), np.array([1e-2 * END])
    _, state = let_go(begin, beyond, as_it_is)

    def rate(_: float, y: Floats) -> list[float]:
        return [-y[1], float(CURVE.force(CURVE.contact_radius(y[0]))) / MASS]

    exact = solve_ivp(rate, (0, 2 * TIME), [begin[0], state.motion[3, 1]], "DOP853", rtol=1e-12, atol=1e-18).y[0, -1]
    turning = [abs(float(flown(begin, beyond, each, law)[0][-1, 0]) - exact) for each in counts]
    steps = TIME / np.array(counts)
    return [
        Case(
            "order in h of the largest error of the velocity of 24 spheres that part, 1e-2 beyond a JKR pull-off",
            "the force jumps from its largest value to 0",
            slope(steps, [float(each.max()) for each in parting]),
            "1, of half a kick",
            least=0.8,
            most=1.2,
        ),
        Case(
            f"order in h of the error of a sphere that turns 1e-2 before a JKR pull-off and comes back "
            f"({turning[0] / -END:.0e} → {turning[-1] / -END:.0e} of its distance)",
            "the curve has a vertical tangent, but farther out",
            slope(steps, turning),
            "2, as of any smooth force",
            least=1.9,
            most=2.1,
        ),
    ]
