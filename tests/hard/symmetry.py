"""An L wave keeps its mirror symmetry; what breaks it grows at the rate that the exact lattice says."""

import numpy as np

from benchmarks.paper_rows import ring_neighbours
from granular_analysis.second_harmonic import mode
from granular_analysis.theory import lattice
from granular_analysis.theory.contact import Contact
from tests.hard.case import Case, Cases, Edits
from tests.hard.cell import Floats, running
from tests.hard.waves import ETA, NU, RATIOS, amplitude, scene

# L at 2ξ gives its energy to TR at ξ where TR(ξ) + TR(ξ) ↔ L(2ξ) resonates: 8/34 is next to ξ_res, 16/34 its double.
ROWS, PUMP, SEED = 34, 16, 8
KICK = 1e-6  # share of the pump's amplitude: linear to its square, and far above rounding


def subspace(duration: float = 60.0, edits: Edits = ()) -> Cases:
    """Return q and φ of an L wave, and the largest distance between spheres of a row, in D0."""
    wave = scene("L", 2, 16, 0.2, 0.05, duration)
    with running(wave, edits) as cell:
        cell.advance(wave.time.steps)
        place = cell.displacement() / 0.2
    apart = place.reshape(3, 16, -1)
    hard = "nothing but symmetry keeps TR and other columns out"
    reason = "rounding: positions 1e-12 nm a step, √1200 steps, over D0 = 0.05 nm; half an e-folding of growth"
    return [
        Case(f"q and φ of an L wave in D0, τ ≤ {duration:g}", hard, float(np.abs(place[1:]).max()), reason, most=1e-8),
        Case(
            f"spheres of a row apart in D0, τ ≤ {duration:g}",
            hard,
            float(np.ptp(apart, axis=-1).max()),
            reason,
            most=1e-8,
        ),
    ]


def instability(duration: float = 240.0, step: float = 0.025, edits: Edits = ()) -> Cases:
    """Growth of a small TR seed on an L pump, against the linearised exact lattice."""
    wave = scene("L", PUMP, ROWS, 0.2, step, duration)
    xi = 2 * np.pi * SEED / ROWS
    seed = mode("TR", xi, RATIOS)
    angles = xi * (np.arange(ROWS, dtype=np.float64) - wave.shape.centre_row)
    # velocities q', φ' of a TR wave; it starts forward and backward in equal parts
    kick = KICK * 0.2 * seed.frequency * np.array([seed.q * np.sin(angles), seed.f * np.cos(angles)])
    tau = np.arange(0.0, duration + 1, 10.0)
    with running(wave, edits) as cell:
        cell.kick(kick)
        states = cell.follow(tau)
    found = amplitude(states, angles, 1, seed)
    truth = amplitude(_linearised(kick, tau), angles, 1, seed)
    return [
        Case(
            f"growth of a TR seed of 1e-6 on L at 2ξ, {found[-1] / found[0]:.0f}-fold by τ = {duration:g}: error",
            "an instability of the model: a solver that damps or pumps ever so little has another rate",
            float(np.max(np.abs(found / truth - 1))),
            "Δτ shifts the detuning by 0.031Δτ² = 2e-5, over τ = 240 0.005 rad of the phase between pump and seed",
            most=0.01,
        ),
        Case(
            "growth of the same from τ = 0 to the end",
            "the comparison is empty unless it grows; it stops where L(2ξ) + TR(ξ) feeds RT(3ξ)",
            float(found[-1] / found[0]),
            "two, to be a growth; TR(ξ) + TR(ξ) ↔ L(2ξ) alone would give ½e^{haτ} = 5.8 with ha = 0.0102",
            least=2.0,
        ),
    ]


def _linearised(kick: Floats, tau: Floats) -> Floats:
    """States (T, 6, rows) of the exact ring after the kick; q and φ are linear in it to 1e-12, for they are odd."""
    contact, neighbours = Contact(NU, overlap_ratio=ETA), ring_neighbours()
    xi = 2 * np.pi * PUMP / ROWS
    phases = xi * (np.arange(ROWS, dtype=np.float64) - (ROWS - 1) // 2)
    start = lattice.initial_state(mode("L", xi, RATIOS), 0.2, phases, contact, neighbours)
    start[4:6] += kick
    scale = KICK * 0.2 * 1e-3  # the seed is to be resolved, not only the pump
    return lattice.motion(start, contact, neighbours, tau, 1e-9, scale)[:, :6]
