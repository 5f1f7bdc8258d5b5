"""Struck hexagonal sheets: what free ones keep, with and without friction, and energy between held rows."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cases.solitary.chain_motion import collision_time
from granular_analysis.measure.norms import slope
from granular_lmp import ImpactRecord, ImpactScene
from tests.hard.case import Case, Cases, Edits
from tests.hard.strikes import EPSILON, struck

Floats = NDArray[np.float64]
COLUMNS = 7
# Odd rows lie half a sphere to the left: without their first sphere the sheet is its own mirror image
SHEET = ImpactScene.load("point_impact").with_values(
    {
        "packing.rows": 7,
        "packing.columns": COLUMNS,
        "striker.1.spheres": [[0, COLUMNS // 2]],
        "inclusion": [{"spheres": [[1, 0], [3, 0], [5, 0]], "vacancy": True}],
        "time.timestep": 0.05,
    }
)
BOX = ImpactScene.load("point_impact").with_values(
    {
        "packing.rows": 8,
        "packing.columns": 6,
        "packing.sides": "periodic",
        "packing.first": "held",
        "packing.last": "held",
        "striker.1.spheres": [[1, 3]],
        "time.timestep": 0.05,
    }
)
STEPS = (0.1, 0.05, 0.025, 0.0125)
COLLISION = collision_time(1.0, 1.0, 1.0)  # t0, of two spheres that meet with the velocity of the striker


def rough(law: str) -> dict[str, Any]:
    """Return the changes that give the contacts friction."""
    return {"effects.friction": 0.3, "effects.shear_law": law}


def words(changes: dict[str, Any]) -> str:
    """Return the contacts in words."""
    return f"friction 0.3, {changes['effects.shear_law']}" if changes else "no friction"


def turned(record: ImpactRecord) -> Floats:
    """Return the angular momentum Σ (x × v + (2/5) s) of spheres of one mass, in m v R, (T,); s is Rω/v."""
    place = record.rest + record.displacement * (record.scale.length / record.scene.sphere.radius)
    about = place[..., 0] * record.velocity[..., 1] - place[..., 1] * record.velocity[..., 0]
    return np.asarray((about + 0.4 * record.spin).sum(axis=1))


def partners(record: ImpactRecord) -> NDArray[np.intp]:
    """Return the index of the mirror image of each sphere, about the column of the striker."""
    centre = record.rest[record.problem.rest.strikers[0][0], 0]
    image = record.rest * [-1, 1] + [2 * centre, 0]
    apart = np.linalg.norm(image[:, None] - record.rest, axis=-1)
    assert apart.min(axis=1).max() < 1e-9  # the sheet is symmetric
    return np.asarray(apart.argmin(axis=1))


def kept(changes: dict[str, Any], duration: float, edits: Edits = ()) -> Cases:
    """Momentum and angular momentum of a free sheet, struck at an angle: symmetry would keep the latter by itself."""
    times = {"time.duration": duration, "time.sample": 1.0, "striker.1.direction": 70.0}
    record = struck(changes | times, edits, SHEET)
    count, steps = record.velocity.shape[1], record.scene.time.steps
    momentum, angular = record.velocity.sum(axis=1), turned(record)
    farthest = float(np.abs(record.rest).max())
    wander = 10 * float(np.sqrt(steps * count)) * EPSILON
    label = f"struck sheet of {count}, {words(changes)}, {steps} steps"
    hard = "contacts open and close" + ", slide and turn spheres" * bool(changes)
    return [
        Case(
            f"momentum, {label}, of that of the striker",
            hard,
            float(np.max(np.abs(momentum - momentum[0]))),
            "forces act in exact pairs: ten times the rounding of a velocity, added at random over steps and spheres",
            most=wander,
        ),
        Case(
            f"angular momentum, {label}, in m v R",
            hard,
            float(np.max(np.abs(angular - angular[0]))),
            f"forces and torques act in exact pairs: the same, with arms of {farthest:.1f} R",
            most=wander * farthest,
        ),
    ]


def mirrored(changes: dict[str, Any], duration: float, edits: Edits = ()) -> Cases:
    """Mirror symmetry of a free sheet that is struck straight."""
    record = struck(changes | {"time.duration": duration, "time.sample": 1.0}, edits, SHEET)
    steps, mirror = record.scene.time.steps, partners(record)
    odd = np.concatenate([record.velocity[..., :1], record.spin[..., None]], axis=-1)
    even = record.velocity[..., 1]
    off = max(float(np.max(np.abs(odd + odd[:, mirror]))), float(np.max(np.abs(even - even[:, mirror]))))
    unit, farthest = record.scale.length / record.scene.sphere.radius, float(np.abs(record.rest).max())
    return [
        Case(
            f"velocities and spins off mirror symmetry, {words(changes)}, {steps} steps",
            "forces are summed in another order on the two sides, and what rounding breaks grows with each collision",
            off,
            "ten times the rounding of positions over ℓ, added at random in all steps; tenfold by collisions",
            most=10 * 10 * float(np.sqrt(steps)) * EPSILON * farthest / unit,
        ),
    ]


def energy(duration: float, edits: Edits = ()) -> Cases:
    """Error of the energy of a sheet between held rows, at 49 steps to a collision with the velocity of the striker."""
    record = struck({"time.duration": duration, "time.sample": 1.0}, edits, BOX)
    step, contacts = record.scene.time.step, record.problem.rest.contacts
    closing = np.linalg.norm(record.velocity[:, contacts.j] - record.velocity[:, contacts.i], axis=-1)
    # Slower spheres touch for longer: a contact closes and opens at most once in the shortest collision
    events = 2 * len(contacts) * duration / COLLISION * np.mean(closing**5)
    return [
        Case(
            f"energy, sheet between held rows, {record.scene.time.steps:.0e} steps",
            "contacts close and open at no time of a step's",
            float(np.max(np.abs(record.energy() / 0.5 - 1))),
            "Verlet's (ωΔτ)²/8 twice, with π/ω the time of a collision; each event is missed by up to (2/5)(vΔτ)^{5/2} "
            "over mv²/2, with the closing speed v of the contact, added at random",
            most=float((np.pi / COLLISION * step) ** 2 / 4 + np.sqrt(events) * 0.4 * step**2.5 / 0.5),
        )
    ]


def order(law: str, edits: Edits = ()) -> Cases:
    """Order in the step of the error of all velocities and spins with friction, against a run of a far smaller step."""
    second = law == "secant"
    steps = STEPS[:3] if second else STEPS
    finest = _end(law, steps[-1] / 16)
    errors = [float(np.sqrt(np.mean((_end(law, step, edits) - finest) ** 2))) for step in steps]
    return [
        Case(
            f"order of the error in Δτ, struck sheet, {words(rough(law))} (error {errors[0]:.1e} → {errors[-1]:.1e} v)",
            "contacts close, slide, hold and open inside steps",
            slope(steps, errors),
            "Verlet's 2; a contact that begins to slide inside a step leaves a kink of its force, of the same order at "
            "random"
            if second
            else "1, as the shear force grows by the stiffness at the end of each step; 0.03 for the finest run, and "
            "0.15 for what is of second order, which may be 0.4 of the error at the longest step",
            least=1.7 if second else 0.85,
            most=2.3 if second else 1.2,
        )
    ]


def _end(law: str, step: float, edits: Edits = ()) -> Floats:
    """Return vx, vy and spin (n, 3) at the end of a run."""
    times = {"time.timestep": step, "time.sample": 8.0, "time.duration": 8.0}
    record = struck(rough(law) | times, edits, SHEET)
    return np.concatenate([record.velocity[-1], record.spin[-1][:, None]], axis=-1)
