"""The time step at its limit, a million steps, and time turned round."""

from math import inf, sqrt

import numpy as np

from analysis.norms import slope
from granular_lmp.errors import SceneError
from tests.hard.case import Case, Cases, Edits
from tests.hard.cell import running
from tests.hard.ledger import keep
from tests.hard.waves import PERIODIC, scene

LIMIT = 2 / PERIODIC.sphere.highest_frequency  # τ
SMALLEST = (1, 4)  # cycles and rows: ξ = π/2, 12 spheres
CHUNK = 1000  # steps between two looks


def refused(factors: tuple[float, ...] = (1.0, 1.0 + 1e-9, 1.5)) -> Cases:
    """Steps at and beyond 2/Ω_max that a scene lets pass, and one below that it must."""

    def passes(factor: float) -> bool:
        step = LIMIT * factor
        try:
            scene("RT", *SMALLEST, 0.02, step, 100 * step, sample=step)
        except SceneError:
            return False
        return True

    return [
        Case(
            "steps of at least 2/Ω_max that are not refused",
            "unstable runs look like physics for the first hundred steps",
            float(sum(map(passes, factors))),
            "none",
            most=0,
        ),
        Case(
            "a step of 0.999 of 2/Ω_max is refused",
            "a limit too low costs runs",
            float(not passes(0.999)),
            "no",
            most=0,
        ),
    ]


def growth(share: float, steps: int, amplitude: float = 0.02, edits: Edits = ()) -> float:
    """Largest displacement of any sphere in any component, in D0, in a run at a share of the limit."""
    allowed = min(share, 0.99) * LIMIT
    wave = scene("RT", *SMALLEST, amplitude, allowed, 2 * allowed, sample=allowed)
    beyond = tuple(
        (f"variable {name} index {value!r} ", f"variable {name} index {LIMIT * share!r} ")
        for name, value in (("timestep ", wave.time.timestep), ("sample   ", wave.time.sample))
    )
    largest = 0.0
    with running(wave, (*beyond, *edits)) as cell:
        for _ in range(steps // CHUNK):
            cell.advance(CHUNK)
            largest = max(largest, float(np.abs(cell.displacement()).max()) / amplitude)
            if not largest < 1e3:
                return inf
    return largest


def at_the_limit(steps: int, share: float = 0.95) -> Cases:
    """Bounded below the limit, and unbounded just beyond it."""
    return [
        Case(
            f"largest displacement in D0, RT, Δτ = {share:g} of the limit, {steps:.0e} steps",
            "the fastest mode turns by 2.5 rad a step: nothing is resolved, but nothing may grow",
            growth(share, steps),
            "Verlet keeps Ω²x²(1 − (ΩΔτ/2)²) + v²: a mode of amplitude 1 reaches 1/√(1 − 0.95²) = 3.2",
            most=1 / sqrt(1 - 0.95**2),
        ),
        Case(
            f"largest displacement in D0, RT, Δτ = 1.02 of the limit, {steps:.0e} steps (inf: past 1000)",
            "the limit has to be that of the lattice, not a guess below it",
            growth(1.02, steps),
            "the mode at ξ = 0 grows by e^{0.4} a step from rounding, 1e-13, on",
            least=1e3,
        ),
    ]


def drift(steps: int, stride: int = 5, edits: Edits = ()) -> Cases:
    """Slope of the energy, the works subtracted, over a long run of a small wave away from the resonance."""
    wave = scene("TR", *SMALLEST, 0.02, 0.05, 0.05 * steps)
    with running(wave, edits) as cell:
        books = keep(cell, wave.time.duration, 20, stride)
    fitted = np.polyfit(books.tau / books.tau[-1], books.gap, 1)[0]
    label = f"TR, ξ = π/2, a = 0.02, Δτ = 0.05, {steps:.0e} steps"
    return [
        Case(
            f"fitted drift of the energy less the works over the run, {label}",
            "a trend of 1e-11 a step would show",
            float(abs(fitted)),
            "Verlet keeps a shadow energy for ever; rounding adds 1e-16·√steps; required",
            most=1e-5,
        ),
        Case(
            f"oscillation of the same, {label}",
            "it must be small, not only without a trend",
            float(np.ptp(books.gap)),
            "E differs from the shadow energy by (ΩΔτ)²/4 of the part that oscillates; that part is at most all of it",
            most=(0.53 * 0.05) ** 2 / 4,
        ),
    ]


def there_and_back(amplitude: float, step: float, edits: Edits = ()) -> float:
    """Distance from the start in D0 after τ = 0 → 60 → 0, all velocities turned half-way; the largest of any sphere."""
    wave = scene("TR", 2, 16, amplitude, step, 60)
    with running(wave, edits) as cell:
        start = cell.displacement()
        cell.advance(wave.time.steps)
        cell.reverse()
        cell.advance(wave.time.steps)
        return float(np.abs(cell.displacement() - start).max()) / amplitude


def reversal(edits: Edits = ()) -> Cases:
    """How well a run comes back, and how what is missing depends on the step.

    Verlet is reversible, and LAMMPS adds v·t Δτ to the slip with the velocity of mid-step, which is too. But it takes
    the tangent t of the step's end, which on the way back is the other end: v_n v_t Δτ²/2R is left each step, over the
    run ηaΔτ∫v_n v_t dτ in D0.
    """
    steps = (0.05, 0.025, 0.0125)
    large = [there_and_back(0.2, step, edits) for step in steps]
    hard = "the shear history is a state, moved by increments, that has to unwind"
    return [
        Case(
            "distance from the start in D0, τ = 0 → 60 → 0, a = 0.02, Δτ = 0.05",
            hard,
            there_and_back(0.02, 0.05, edits),
            "required; the tangents leave ηa²Δτ = 5e-9, rounding of positions 1e-12 nm·√2400 over D0 = 0.005 nm 1e-8",
            most=1e-8,
        ),
        Case(
            "the same, a = 0.2",
            hard,
            large[0],
            "ηaΔτ, for ∫v_n v_t dτ below 1: the tangent is that of the step's end. 1e-8 is out of reach of this Δτ",
            most=PERIODIC.sphere.overlap_ratio * 0.2 * 0.05,
        ),
        Case(
            f"order in Δτ of the same ({large[0]:.1e} → {large[-1]:.1e})",
            "where it comes from",
            slope(steps, large),
            "1 for a tangent of the step's end, 2 or more for any other error of the scheme, 0 for a defect",
            least=0.9,
            most=1.1,
        ),
    ]
