"""Which theory for which wave: one table of what this folder can say about p(τ), q(τ), φ(τ), and a rule that picks.

Every theory is a function of a `Wave` and of times; they differ in what they leave out:

| name | what it holds beyond the linear wave | fails |
|---|---|---|
| second-order | the second harmonic: the paper's order | as the phase drifts, σa²τ; at resonance and antiresonance |
| frequency-shift | and the drift of the fundamental | p is still the paper's |
| three-mode | and all exchange of energy with 2ξ and 3ξ | p at the antiresonance |
| hierarchy | all waves to order a⁶ | once any correction has grown large: long times |
| exact-lattice | everything: the lattice itself, integrated, not a formula | when contacts open |

`best` takes the hierarchy where its own last orders say that it has converged, and at the antiresonance, where nothing
else gives p; else three-mode, which holds for long times near the resonance.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from analysis.frequency_shift import shifted_second_order
from analysis.hierarchy import hierarchy, hierarchy_orders
from analysis.lattice import torus
from analysis.resonance import three_mode
from analysis.second_harmonic import Mode, Ratios, mode, ratios, second_order
from granular_lmp.record import Record

Floats = NDArray[np.float64]
Trajectory = tuple[Floats, Floats, Floats]


@dataclass(frozen=True)
class Wave:
    """What a theory needs to know: the mode at τ=0, its amplitude D0/Δ0 and phase, ν, and η = Δ0/2R of the contacts."""

    mode: Mode
    ratios: Ratios
    amplitude: float
    phase: float
    poisson_ratio: float
    overlap_ratio: float

    @classmethod
    def of(cls, record: Record) -> Self:
        """The wave that a run started with, in LAMMPS's contact geometry."""
        scene = record.scene
        overlap_ratio = scene.sphere.overlap_ratio
        constants = ratios(scene.sphere.poisson_ratio, overlap_ratio=overlap_ratio)
        return cls(
            mode(scene.wave.mode, scene.wavenumber, constants),  # type: ignore[arg-type]  # the scene checked the name
            constants,
            scene.wave.amplitude,
            scene.wave.phase,
            scene.sphere.poisson_ratio,
            overlap_ratio,
        )


def _closed(formula: Callable[..., Trajectory]) -> Callable[[Wave, Floats], Trajectory]:
    """A formula of mode, ratios, amplitude, tau and phase as a theory."""

    def theory(wave: Wave, tau: Floats) -> Trajectory:
        return formula(wave.mode, wave.ratios, wave.amplitude, tau, phase=wave.phase)

    return theory


def _integrated(method: Callable[..., Trajectory]) -> Callable[[Wave, Floats], Trajectory]:
    """An integration of mode, amplitude, tau, ν and η as a theory."""

    def theory(wave: Wave, tau: Floats) -> Trajectory:
        return method(
            wave.mode, wave.amplitude, tau, wave.poisson_ratio,
            overlap_ratio=wave.overlap_ratio, phase=wave.phase, rtol=1e-10,
        )  # fmt: skip

    return theory


THEORIES: dict[str, Callable[[Wave, Floats], Trajectory]] = {
    "second-order": _closed(second_order),
    "frequency-shift": _closed(shifted_second_order),
    "three-mode": _closed(three_mode),
    "hierarchy": _integrated(hierarchy),
    "exact-lattice": _integrated(torus),
}


CONVERGED = 0.02  # of any component, in the two last orders of the hierarchy: the error is then smaller still
LONGEST = 400.0  # τ; orders grow with time, and the hierarchy is not tried beyond


def best(wave: Wave, tau: Floats) -> str:
    """Name of the formula that holds best for the wave at the times: hierarchy or three-mode, by the module's rule."""
    if drive_cancels(wave) or (tau[-1] <= LONGEST and last_orders(wave, tau) < CONVERGED):
        return "hierarchy"
    return "three-mode"


def last_orders(wave: Wave, tau: Floats) -> float:
    """How much the two last orders of the hierarchy add to p, q or φ, whichever is worst: relative, over all rows."""
    few = np.linspace(tau[0], tau[-1], 61)
    orders = hierarchy_orders(wave.mode, few, wave.poisson_ratio, overlap_ratio=wave.overlap_ratio, rtol=1e-5)
    terms = orders * (wave.amplitude ** np.arange(len(orders)))[:, None, None, None]  # as (order, T, component, K)
    tail, total = (np.sqrt(np.sum(part.sum(axis=0) ** 2, axis=(0, 2))) for part in (terms[-2:], terms))
    return float(np.max(tail / np.where(total > 0, total, np.inf)))


def drive_cancels(wave: Wave) -> bool:
    """Whether the second harmonic of a TR wave is below the next order: its antiresonance, at this amplitude.

    The two terms of the drive, αs²Q and (β/√3) sin ξ f, cancel there. What is left of them is to be compared with the
    next order, which is smaller by a². From a = 1 on contacts open, and no order means anything.
    """
    return wave.mode.name == "TR" and wave.amplitude < 1 and cancellation(wave) < wave.amplitude**2


def cancellation(wave: Wave) -> float:
    """|A − B|/(|A| + |B|) of the terms A = αs²Q, B = (β/√3) sin ξ f of the drive of TR; 0 where p vanishes."""
    xi, constants = wave.mode.wavenumber, wave.ratios
    by_translation = constants.alpha * np.sin(xi / 2) ** 2 * wave.mode.q
    by_rotation = constants.beta / np.sqrt(3) * np.sin(xi) * wave.mode.f
    both = abs(by_translation) + abs(by_rotation)
    return float(abs(by_translation - by_rotation) / both) if both else 0.0
