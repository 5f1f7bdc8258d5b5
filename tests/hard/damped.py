"""Struck chains whose contacts are damped: momentum is kept, energy falls, and the step counts to first order."""

from dataclasses import replace

import numpy as np

from cases.solitary.chain import uniform
from cases.solitary.chain_motion import collision_time, integrate
from granular_analysis.measure.norms import slope
from tests.hard.case import Case, Cases, Edits
from tests.hard.strikes import COUNT, EPSILON, last, struck

RESTITUTION, STEP = 0.7, 0.0125
STEPS = (0.05, 0.025, 0.0125, 0.00625)
DAMPED = {"effects.restitution": RESTITUTION}


def kept(edits: Edits = ()) -> Cases:
    """Momentum and energy of a damped chain with free ends."""
    times = {"time.timestep": STEP, "time.sample": 0.25, "time.duration": 60.0}
    record = struck(DAMPED | times | {"packing.rows": COUNT}, edits)
    momentum, energy = record.velocity[..., 1].sum(axis=1), record.energy() / 0.5
    steps = record.scene.time.steps
    return [
        Case(
            f"momentum, chain of {COUNT}, restitution {RESTITUTION}, {steps} steps",
            "dashpots pull as contacts open",
            float(np.max(np.abs(momentum - momentum[0]))),
            "forces act in exact pairs: ten times the rounding of a velocity, added at random over steps and spheres",
            most=10 * float(np.sqrt(steps * COUNT)) * EPSILON,
        ),
        Case(
            f"largest rise of the energy in 0.25 t0, chain of {COUNT}, restitution {RESTITUTION}",
            "the dashpots take a velocity of half a step ago, also where it changes its sign",
            float(np.max(np.diff(energy))),
            "dashpots only take: what Verlet's energy is off, (ωΔτ)²/8 of that of the striker, π/ω a collision",
            most=float((np.pi / collision_time(1.0, 1.0, 1.0) * STEP) ** 2 / 8),
        ),
    ]


def order(edits: Edits = ()) -> Cases:
    """Order in the step of the error of all velocities of a damped chain, against DOP853."""
    start = np.eye(COUNT)[0]
    chain = replace(uniform(COUNT), restitution=RESTITUTION)
    _, (exact,) = integrate(chain, 0 * start, start, [24.0], 1e-8)  # errors of the steps are 1e-4
    errors = [float(np.sqrt(np.mean((last(DAMPED | {"time.timestep": step}, edits) - exact) ** 2))) for step in STEPS]
    return [
        Case(
            f"order of the error in Δτ, chain of {COUNT}, restitution {RESTITUTION} "
            f"(error {errors[0]:.1e} → {errors[-1]:.1e} v)",
            "dashpots set in as contacts close, with a force of power 1/4 of the overlap",
            slope(STEPS, errors),
            "1: LAMMPS takes the damping at the velocity of half a step ago; the second order beside it moves it by "
            "0.1",
            least=0.9,
            most=1.1,
        )
    ]
