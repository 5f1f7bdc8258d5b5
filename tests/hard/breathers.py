"""Breathers: one sphere of a chain that is pressed together moves strongly, and must not leak in a hundred periods."""

import numpy as np

from cases.solitary.chain import Chain, bands, compressed
from cases.solitary.chain_motion import integrate
from granular_analysis.measure.norms import slope
from granular_lmp import ImpactRecord, ImpactScene
from granular_lmp.problem import Problem, prepare
from tests.hard.case import Case, Cases, Edits
from tests.hard.strikes import struck

BREATHER = ImpactScene.load("breather")
SHARE = 0.75  # of the bottom of the optical band, the frequency of the shipped breather
MIDDLE, SAMPLES = 21, 8  # sphere; records to a period
STEPS = (0.02, 0.01, 0.005, 0.0025)


def chain_of(problem: Problem) -> tuple[Chain, float]:
    """Return the chain of the theory in the units of the scene, and the period of its breather."""
    stiffness = np.concatenate([[0.0], problem.rest.coefficients, [0.0]])
    chain = compressed(problem.rest.mass, stiffness, float(np.mean(problem.rest.rest_force)))
    light = bands(
        (float(problem.rest.mass[0]), float(problem.rest.mass[1])),
        float(problem.rest.rest_stiffness[0]),
    )[1]
    return chain, 2 * np.pi / (SHARE * light)


def breathing(step: float, sample: float, duration: float, edits: Edits = ()) -> ImpactRecord:
    """Return the record of the shipped breather with another step, whose deck is broken by edits."""
    changes = {"time.timestep": step, "time.sample": sample, "time.duration": duration * (1 + 1e-9)}
    return struck(changes, edits, BREATHER)


def breathes(periods: int, step: float = 0.0125, edits: Edits = ()) -> Cases:
    """Energy of a breather in its five central spheres, and of the whole chain."""
    chain, period = chain_of(prepare(BREATHER))
    record = breathing(step, period / SAMPLES, periods * period, edits)
    each = record.energies()
    whole, central = each.sum(axis=1), each[:, MIDDLE - 2 : MIDDLE + 3].sum(axis=1)
    # Two contacts open and close in each period, at up to the velocity of the light sphere
    fastest = float(np.max(np.abs(record.velocity)))
    events = float(np.sqrt(4 * periods) * 0.4 * (fastest * step) ** 2.5)
    top = bands((1.0, 0.1), float(record.problem.rest.rest_stiffness[0]))[2]
    return [
        Case(
            f"least share of five of 43 spheres, breather, {periods} periods",
            "contacts open and close in each period, and the step takes the exact breather off its orbit",
            float(np.min(central / whole)),
            "99 %, required; the theory has 99.8 %, and all its multipliers are 1",
            least=0.99,
        ),
        Case(
            f"energy, breather, {periods} periods of {round(period / record.scene.time.step)} steps",
            "the same",
            float(np.max(np.abs(whole / whole[0] - 1))),
            "Verlet's (ω₃Δτ)²/8 twice, for energies that are all kinetic or all stored; each event is missed by up to "
            "(2/5)(vΔτ)^{5/2}, added at random",
            most=float((top * step) ** 2 / 4 + events / whole[0]),
        ),
    ]


def order(edits: Edits = ()) -> Cases:
    """Order in the step of the error of all velocities of a breather after two periods, against DOP853."""
    problem = prepare(BREATHER)
    chain, period = chain_of(problem)
    u, end = problem.rest.state[:, 1] / BREATHER.scale.length, 2 * period
    _, (exact,) = integrate(chain, u, 0 * u, [end], 1e-12)
    found = [breathing(step, end, end, edits).velocity[-1, :, 1] for step in STEPS]
    errors = [float(np.sqrt(np.mean((each - exact) ** 2))) for each in found]
    return [
        Case(
            f"order of the error in Δτ, breather, two periods (error {errors[0]:.1e} → {errors[-1]:.1e} v)",
            "two contacts open and close inside some step of each period",
            slope(STEPS, errors),
            "Verlet's 2 in smooth motion, 5/2 where a contact closes or opens",
            least=1.9,
            most=2.6,
        )
    ]
