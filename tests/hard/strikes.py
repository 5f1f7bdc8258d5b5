"""Impacts: contacts that open and close all the time, overlaps near the rounding of positions, long chains and runs."""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cases.solitary.chain import uniform
from cases.solitary.chain_motion import integrate, march
from granular_analysis.measure.norms import slope
from granular_lmp import ImpactRecord, ImpactScene, run_impact
from granular_lmp.lammps.deck import deck_of
from granular_lmp.problem import prepare
from tests.hard.case import Case, Cases, Edits

CHAIN = ImpactScene.load("solitary_chain").with_values({"packing.last": "free"})
COUNT, STEPS = 20, (0.2, 0.1, 0.05, 0.025)
EPSILON = 1.1e-16


def struck(changes: dict[str, Any], edits: Edits = (), scene: ImpactScene = CHAIN) -> ImpactRecord:
    """Return the record of an impact with values changed, whose deck is broken by edits."""
    deck = deck_of(prepare(scene.with_values(changes)))
    for old, new in edits:
        assert old in deck.input_text, old
        deck = replace(deck, input_text=deck.input_text.replace(old, new))
    with tempfile.TemporaryDirectory() as folder:
        return run_impact(deck, Path(folder) / "run")


def last(changes: dict[str, Any], edits: Edits = ()) -> NDArray[np.float64]:
    """Return the velocities (n,) at the end of a run, the only record after its start."""
    changes = {"packing.rows": COUNT, "time.sample": 24.0, "time.duration": 24.0} | changes
    return np.asarray(struck(changes, edits).velocity[-1, :, 1])


def order(edits: Edits = ()) -> Cases:
    """Order in the step of the error of all velocities, against DOP853."""
    start = np.eye(COUNT)[0]
    _, (exact,) = integrate(uniform(COUNT), 0 * start, start, [24.0], 1e-12)
    errors = [np.sqrt(np.mean((last({"time.timestep": step}, edits) - exact) ** 2)) for step in STEPS]
    return [
        Case(
            f"order of the error in Δτ, struck chain of {COUNT} (error {errors[0]:.1e} → {errors[-1]:.1e} v)",
            "every contact closes and opens inside some step, with a force of power 3/2",
            slope(STEPS, errors),
            "Verlet's 2 in smooth motion, 5/2 where a contact closes or opens",
            least=1.9,
            most=2.6,
        )
    ]


def velocities(velocity: float, edits: Edits = ()) -> Cases:
    """Difference of the velocities of a striker from those of velocity Verlet in the units of the impact."""
    start = np.eye(COUNT)[0]
    _, (exact,) = march(uniform(COUNT), 0 * start, start, 0.1, 240)
    found = last({"striker.1.velocity": velocity, "time.timestep": 0.1}, edits)
    unit = CHAIN.with_values({"striker.1.velocity": velocity}).scale.length / CHAIN.sphere.radius
    return [
        Case(
            f"velocities, struck at {velocity:g} m/s, τ = 24",
            f"overlaps are {unit:.0e} of a radius, and positions are rounded to {COUNT} 1e-16 of it",
            float(np.max(np.abs(found - exact))),
            "ten times the rounding of positions over ℓ, added at random in 240 steps; 1e-12 for velocities themselves",
            most=10 * float(np.sqrt(240)) * EPSILON * COUNT / unit + 1e-12,
        )
    ]


def long_chain(count: int, duration: float, edits: Edits = ()) -> Cases:
    """Difference of the first spheres of a long chain, which lie far from the origin, from those of a short one."""
    changes = {"time.timestep": 0.1, "time.sample": duration, "time.duration": duration, "output.rows": [0, 9]}
    short, far = (struck(changes | {"packing.rows": rows}, edits if rows == count else ()) for rows in (60, count))
    unit = CHAIN.scale.length / CHAIN.sphere.radius
    return [
        Case(
            f"velocities at the end of a chain of {count:.0e} spheres, τ = {duration:g}",
            "the struck end is far from the origin, where positions are coarse",
            float(np.max(np.abs(far.velocity[-1] - short.velocity[-1]))),
            "ten times the rounding of positions over ℓ, added at random in all steps",
            most=10 * float(np.sqrt(duration / 0.1)) * EPSILON * count / unit,
        )
    ]


def energy(duration: float, edits: Edits = ()) -> Cases:
    """Error of the energy of a chain between held spheres, at 24 steps to a half collision."""
    step, count = 0.05, 12
    record = struck(
        {"packing.rows": count, "packing.first": "held", "packing.last": "held", "striker.1.rows": [1, 1]}
        | {"time.timestep": step, "time.sample": duration / 1000, "time.duration": duration},
        edits,
    )
    # The wave passes 0.84 contacts in τ, each of which closes and opens
    events = 2 * 0.84 * duration
    return [
        Case(
            f"energy, {count} spheres between held ends, {duration / step:.0e} steps",
            "contacts close and open at no time of a step's",
            float(np.max(np.abs(record.energy() / 0.5 - 1))),
            "each event is missed by up to the overlap vΔτ, (2/5)(vΔτ)^{5/2} of energy over mv²/2, of either sign, "
            "added at random",
            most=float(np.sqrt(events) * 0.4 * step**2.5 / 0.5),
        )
    ]
