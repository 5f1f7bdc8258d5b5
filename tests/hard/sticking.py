"""Adhesive collisions by JKR: a force that jumps when bodies touch and when they part, at any moment of a step."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from granular_analysis.measure.norms import slope
from granular_lmp.scene.collision import Collision
from granular_lmp.studies.collide import Result
from tests.hard.case import Case, Cases, Edits
from tests.validation.test_pull_off import SNAP, kick, sticking_speed, theory, with_deck

SHIFT, BESIDE = 4 / 9, 0.05  # of the sticking speed by the step, in FΔt/m*, and how far beside it bodies decide
HALVINGS = 7  # of the band of twice `BESIDE`
STEPS = (400, 800, 1600, 3200)  # to an elastic contact time
SPEEDS = np.linspace(1.2, 3.0, 12)  # of the sticking speed


def snap(speed: float, steps: int, edits: Edits = ()) -> Result:
    """Return a collision at a relative velocity, m/s, whose deck is broken by edits."""
    with tempfile.TemporaryDirectory() as folder:
        return with_deck(at(speed, steps), Path(folder), *edits)


def at(speed: float, steps: int) -> Collision:
    """Return the declaration of a collision at a relative velocity, m/s."""
    return SNAP.with_values({"collision.normal_velocity": speed / 2, "collision.steps": steps})


def sticking(edits: Edits = ()) -> Cases:
    """Sticking speeds at two steps, by bisection, and decisions beside the band of the step."""
    exact, off = sticking_speed(SNAP), []
    for steps in (200, 400):
        width = kick(at(exact, steps))
        low, high = (exact + share * width for share in (SHIFT - BESIDE, SHIFT + BESIDE))
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            low, high = (middle, high) if snap(middle, steps, edits).sticks else (low, middle)
        off.append(abs((low + high) / 2 - exact - SHIFT * width) / (SHIFT * width))
    wrong = 0
    for steps in (200, 400, 800, 1600):
        for share, sticks in ((SHIFT - BESIDE, True), (SHIFT + BESIDE, False)):
            wrong += snap(exact + share * kick(at(exact, steps)), steps, edits).sticks != sticks
    return [
        Case(
            "shift of the sticking speed by the step, over (4/9) FΔt/m*, 200 and 400 steps to a contact",
            "the pull of (8/9) F begins at once, in the middle of nothing",
            max(off) + 1,
            "1, as half a step of that pull is missing; a bisection to 1/1280 of FΔt/m*, and Verlet's (ωΔt)²/24 of v_s",
            least=1 - 5e-3,
            most=1 + 5e-3,
        ),
        Case(
            "bodies that stick or part against the energy, 0.05 FΔt/m* from the shifted speed, 200 to 1600 steps",
            "a swing at the sticking speed ends where the contact does",
            wrong,
            "none: the shift is of first order in the step, and what is left of second",
            most=0,
        ),
    ]


def parting(steps_to_contact: Sequence[int] = STEPS, edits: Edits = ()) -> Cases:
    """Order in the step of the error of v² after the pull-off, and that error over its bound."""
    errors, shares = [], []
    for steps in steps_to_contact:
        squares = []
        for share in SPEEDS:
            run = snap(float(share) * sticking_speed(SNAP), steps, edits)
            v, mass = run.collision.closing_speed, run.collision.effective_mass
            e = float(theory(SNAP).restitution(v, mass, "load"))
            off = abs(run.restitution**2 - e**2) * v**2
            squares.append(off**2)
            shares.append(off / (2 * kick(run.collision) * (4 / 9 * v + e * v / 2)))
        errors.append(np.sqrt(np.mean(squares)))
    return [
        Case(
            f"order of the error of v² after the pull-off in Δt (error {errors[0]:.1e} → {errors[-1]:.1e} m²/s²)",
            "the pull of F ends at once, anywhere in a step",
            -slope(steps_to_contact, errors),
            "1; the ends lie at random in a step, which leaves 0.1 of the order",
            least=0.7,
            most=1.3,
        ),
        Case(
            "error of v² after the pull-off, over that of the steps of snap-in and pull-off",
            "both jumps act on one velocity",
            max(shares),
            "1, of half a step of (8/9) F and of F; the pull changes by 4 % in a step of 1/400",
            most=1.05,
        ),
    ]
