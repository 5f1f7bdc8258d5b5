"""The time step at its limit, a million steps, and time turned round."""

from math import inf, sqrt

import numpy as np

from granular_analysis.measure.norms import slope
from granular_lmp import build
from granular_lmp.crystal.lattices import unit_lattice
from granular_lmp.crystal.modes import highest_frequency
from granular_lmp.errors import SceneError
from tests.hard.case import Case, Cases, Edits
from tests.hard.cell import running
from tests.hard.ledger import keep
from tests.hard.waves import PERIODIC, scene

LIMIT = 2 / highest_frequency(unit_lattice(PERIODIC.sphere), PERIODIC.sphere)  # τ
SMALLEST = (1, 4)  # cycles and rows: ξ = π/2, 12 spheres
CHUNK = 1000  # steps between two looks


def refused(factors: tuple[float, ...] = (1.0, 1.0 + 1e-9, 1.5), allowed: float = 0.999) -> Cases:
    """Steps at and beyond 2/Ω_max that are let pass, and one below that must be."""

    def passes(factor: float) -> bool:
        step = LIMIT * factor
        try:
            build(scene("RT", *SMALLEST, 0.02, step, 100 * step, sample=step))
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
            f"a step of {allowed:g} of 2/Ω_max is refused",
            "a limit too low costs runs",
            float(not passes(allowed)),
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


def at_the_limit(steps: int, share: float = 0.95, beyond: float = 1.02) -> Cases:
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
            f"largest displacement in D0, RT, Δτ = {beyond:g} of the limit, {steps:.0e} steps (inf: past 1000)",
            "the limit has to be that of the lattice, not a guess below it",
            growth(beyond, steps),
            "the mode at ξ = 0 grows by e^{0.4} a step from rounding, 1e-13, on",
            least=1e3,
        ),
    ]


def _fitted(amplitude: float, step: float, steps: int, stride: int, edits: Edits = ()) -> tuple[float, float]:
    """Trend over the run, and range, of the energy less the works of a TR wave, over its initial energy."""
    wave = scene("TR", *SMALLEST, amplitude, step, step * steps)
    with running(wave, edits) as cell:
        books = keep(cell, wave.time.duration, 20, stride)
    return float(np.polyfit(books.tau / books.tau[-1], books.gap, 1)[0]), float(np.ptp(books.gap))


def drift(steps: int, stride: int = 5, edits: Edits = ()) -> Cases:
    """Trend of the energy, the works subtracted, over a long run of a small wave away from the resonance."""
    trend, swing = _fitted(0.02, 0.05, steps, stride, edits)
    label = f"TR, ξ = π/2, a = 0.02, Δτ = 0.05, {steps:.0e} steps"
    return [
        Case(
            f"fitted drift of the energy less the works over the run, {label}",
            "a trend of 1e-11 a step shows",
            abs(trend),
            "required. Verlet has none, but LAMMPS's slip turns with the tangent of the step's end: of the order of "
            "ηa²Δτ τ, in which a part in a hundred is in phase",
            most=1e-5,
        ),
        Case(
            f"range of the same, {label}",
            "it must be small, not only without a trend",
            swing,
            "E differs from the energy Verlet keeps by (ΩΔτ)²/4 of the part that oscillates, at most all of it",
            most=(0.53 * 0.05) ** 2 / 4,
        ),
    ]


def drift_order(duration: float = 2500.0) -> Cases:
    """Where that trend comes from: its order in the step and in the amplitude."""
    steps, amplitudes = (0.1, 0.05, 0.025), (0.02, 0.04, 0.08)
    by_step = [abs(_fitted(0.05, step, round(duration / step), 5)[0]) for step in steps]
    by_amplitude = [abs(_fitted(a, 0.05, round(duration / 0.05), 5)[0]) for a in amplitudes]
    hard = "a drift below every bound may still tell of a defect"
    reason = "ηa²Δτ, if it is the tangent of the step's end"
    return [
        Case(f"order in Δτ of the drift, τ = {duration:g}", hard, slope(steps, by_step), reason, least=0.9, most=1.1),
        Case(
            f"order in a of the drift, τ = {duration:g}",
            hard,
            slope(amplitudes, by_amplitude),
            reason,
            least=1.7,
            most=2.3,
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
