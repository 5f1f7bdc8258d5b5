"""Large amplitudes: contacts open and close, and shear springs are lost and born again."""

import numpy as np

from granular_analysis.measure.norms import slope
from granular_lmp import Scene
from tests.hard.case import Case, Cases, Edits
from tests.hard.cell import Floats, running
from tests.hard.ledger import keep
from tests.hard.waves import scene

CELL = (2, 8)  # ξ = π/2: the largest amplitudes stretch neighbouring rows to ±a√2
DURATION = 20.0  # τ: five periods, in which every contact has opened and closed several times
STEPS = (0.05, 0.025, 0.0125, 0.00625)  # three of them show an order that is not erratic
# a from which contacts open by the adhesion law: D0 ≥ Δ0 over the largest stretch of a contact. In the JKR law contacts
# hold to an overlap of −0.397 Δ0, which the exact lattice does not reach by τ = 20 at a = 2.13
OPENING = {"dmt": 1.0, "jkr": 2.13}


def kept(amplitude: float, step: float = 0.0125, duration: float = DURATION, edits: Edits = ()) -> Cases:
    """Spheres, momentum and energy of one run."""
    wave = scene("TR", *CELL, amplitude, step, duration)
    with running(wave, edits) as cell:
        before = cell.velocity()[:2]
        books = keep(cell, duration, round(0.5 / step))
        after, place = cell.velocity()[:2], cell.displacement()
        lost = wave.shape.rows * wave.shape.columns - cell.instance.get_natoms()
    label = f"a = {amplitude:g}, ξ = π/2, τ ≤ {duration:g}"
    opened = 3 * cell.spheres - books.contacts.min()
    hard = (
        f"{opened:.0f} of {3 * cell.spheres} contacts were open at once"
        if opened
        else "no contact opens in this cell, but all are far from their rest"
    )
    released = f"; opened contacts released {-books.released[-1] / books.energy[0]:.1e}" if opened else ""
    return [
        Case(f"spheres lost or not finite, {label}", hard, float(lost + np.sum(~np.isfinite(place))), "none", most=0),
        Case(
            f"momentum, {label}, of that of all spheres one way",
            hard,
            float(np.abs((after - before).sum(axis=1)).max() / np.abs(before).sum()),
            "forces act in exact pairs: 1e-16 of rounding a step, added at random over 1600 steps and 24 spheres",
            most=1e-14,
        ),
        Case(
            f"energy less the works, over the initial energy, {label}{released}",
            hard,
            float(np.abs(books.gap).max()),
            "a contact that opens or closes within a step is pulled by F for up to half a step too long: FvΔτ/2 of "
            "energy each, of either sign"
            if opened
            else "second order: (ΩΔτ)²/4 = 4e-5 of the few percent that the law exchanges",
            most=1e-5 if not opened else opening_error(wave, float(books.energy[0])),
        ),
        Case(
            f"share of the sliding force, {label}",
            hard,
            float(books.sliding[-1]),
            "below 1 nothing slides and the ledger is complete; a contact that slides has 1 to the last digits",
            most=1 - 1e-6,
        ),
    ]


def opening_error(wave: Scene, energy: float) -> float:
    """Return the energy error by the jumps of the force: FvΔτ/2 for each opening and closing, added at random, over E.

    F = 2/3 (k1Δ0); v ≤ 2aΩ is the speed at which a contact parts, Ω ≤ 1; two jumps in 4 τ, 3 contacts a sphere.
    """
    jumps = 3 * wave.shape.rows * wave.shape.columns * wave.time.duration / 2
    return float(np.sqrt(jumps) * (2 / 3) * 2 * wave.wave.amplitude * wave.time.step / 2 / energy)


def order(amplitude: float, edits: Edits = (), law: str = "dmt") -> Cases:
    """Order in the step of the error of all displacements, against a run of a far smaller step."""
    smooth = amplitude <= OPENING[law]
    steps = STEPS[:3] if smooth else STEPS
    finest = _trajectory(amplitude, steps[-1] / 8, law=law)
    errors = [np.sqrt(np.mean((_trajectory(amplitude, step, edits, law) - finest) ** 2)) for step in steps]
    found = slope(steps, errors)
    label = f"a = {amplitude:g}" + (f", {law}" if law != "dmt" else "")
    return [
        Case(
            f"order of the error in Δτ, {label} (error {errors[0]:.1e} → {errors[-1]:.1e} D0)",
            "contacts stay closed" + ", next to pull-off" * (law == "jkr")
            if smooth
            else "the force jumps by F where a contact opens, at no time of a step's",
            found,
            "Verlet's 2 while the force is smooth"
            if smooth
            else "a jump of the force inside a step leaves FΔτ² in place and FΔτ in velocity: order 1, erratic",
            least=1.9 if smooth else 0.5,
            most=2.1 if smooth else 1.9,
        )
    ]


def _trajectory(amplitude: float, step: float, edits: Edits = (), law: str = "dmt") -> Floats:
    """Displacements (T, 3, N) in D0 every τ."""
    wave = scene("TR", *CELL, amplitude, step, DURATION).with_values({"sphere.adhesion_law": law})
    places = []
    with running(wave, edits) as cell:
        for _ in range(round(DURATION)):
            cell.advance(round(1 / step))
            places.append(cell.displacement() / amplitude)
    return np.array(places)
