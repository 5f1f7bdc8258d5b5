"""The ends of the zone: ξ = 0.01, π − 0.01 and π, where modes meet, decouple or stand.

The group velocity of every mode is zero at π, and RT's at 0 too; nowhere between. At π, with Ω_L = 1, Ω_TR² = μ1 and
Ω_RT² = 5κ/(κ+3), L meets TR for ν = 0 and RT for ν = 0.4 (and crosses them before π for smaller and larger ν); TR and
RT would meet for ν = 2/3.
"""

import numpy as np

from granular_analysis.second_harmonic import ModeName
from granular_analysis.theory import lattice
from granular_analysis.theory.contact import Contact
from granular_analysis.theory.wave import Wave
from granular_lmp.accuracy.rounding import noise_floor
from tests.hard.case import Case, Cases, Edits
from tests.hard.cell import running
from tests.hard.waves import ETA, NU, scene, verlet_bound

ENDS = ((1, 628), (313, 628), (2, 4))  # cycles and rows: ξ = 0.010005, π − 0.010005, π
MODES: tuple[ModeName, ...] = ("L", "TR", "RT")


def end(
    name: ModeName, cycles: int, rows: int, step: float, duration: float, reference: float = NU, edits: Edits = ()
) -> Cases:
    """A mode near an end of the zone against the exact lattice, whose ν is `reference`."""
    wave = scene(name, cycles, rows, 0.2, step, duration)
    theory = Wave.of_mode(name, wave.wavenumber, 0.2, Contact(reference, overlap_ratio=ETA))
    tau = np.arange(0.0, duration + 0.25, 0.5)
    with running(wave, edits) as cell:
        found = cell.follow(tau)[:, :3, wave.shape.centre_row].T / 0.2
    truth = lattice.torus(theory, tau, rtol=1e-12)
    return [
        Case(
            f"{name}, ξ = {wave.wavenumber:.5g}, ν = {NU:g}, τ ≤ {duration:g}: error in D0",
            "long waves are a small difference of large displacements; at ξ = π modes decouple and stand (dΩ/dξ = 0)",
            float(np.abs(found - truth).max()),
            "phase (ΩΔτ)²Ωτ/24 and amplitude (ΩΔτ)²/8 of Verlet, half as much again for harmonics; noise of rounding, "
            "its law good to a factor of 3 and the largest of 700 samples 3 standard deviations",
            most=verlet_bound(wave, theory.mode.frequency),
        )
    ]


def degenerate(name: ModeName, nu: float, duration: float = 60.0, edits: Edits = ()) -> Cases:
    """ξ = π, where L and TR (ν = 0) or RT (ν = 0.4) have one frequency, and any mixture of the two is a Bloch mode."""
    wave = scene(name, 2, 4, 0.2, 0.05, duration).with_values({"sphere.poisson_ratio": nu})
    with running(wave, edits) as cell:
        cell.advance(wave.time.steps)
        p, q, phi = np.abs(cell.displacement()).max(axis=1) / 0.2
    return [
        Case(
            f"{name} at ξ = π, ν = {nu:g}, τ = {duration:g}: displacement of the other mode in D0",
            f"degenerate with {'TR' if nu == 0 else 'RT'} or L: eigenvectors are arbitrary, and what leaks resonates",
            float(max(q, phi) if name == "L" else p),
            "symmetry forbids it; rounding alone: ten times the noise of the cell",
            most=10 * noise_floor(wave),
        )
    ]
